//! Time as a loop counts it, whatever the robot's clock says.

/// A robot's clock. Time goes on as it does; where it is set, back or by more than a second ahead, time goes on by the periods
/// that have passed.
#[derive(Debug, Clone)]
pub struct Clock {
    period: f64,
    /// What it said last, and whether it was set back to there; None before the first reading.
    said: Option<(f64, bool)>,
    now: f64,
}

impl Clock {
    /// The longest way from reading to reading that is not taken for its being set \[s\].
    pub const LONGEST: f64 = 1.0;

    /// The clock of a loop of `period` \[s\].
    pub fn new(period: f64) -> Self {
        Self { period, said: None, now: 0.0 }
    }

    /// The time at the last reading that was [taken](Self::take) \[s\].
    pub fn now(&self) -> f64 {
        self.now
    }

    /// Whether there has been a reading.
    pub fn is_read(&self) -> bool {
        self.said.is_some()
    }

    /// How far the clock is ahead of the time \[s\].
    pub fn ahead(&self) -> f64 {
        self.said.map_or(0.0, |(said, _)| said - self.now)
    }

    /// The time at a reading of `t` \[s\] so many `cycles` after the last one; None if that is no later. A clock that was set back
    /// counts from there on.
    pub fn read(&mut self, t: f64, cycles: usize) -> Option<f64> {
        let Some((said, back)) = self.said else { return Some(t) };
        if t < said {
            self.said = Some((t, true));
        }
        #[expect(clippy::cast_precision_loss, reason = "far fewer than 2⁵³ cycles")]
        let counted = self.period * cycles as f64;
        let passed = if back || t - said > Self::LONGEST { counted } else { t - said };
        (t > said).then_some(self.now + passed)
    }

    /// The reading of `t` \[s\] was news, at this `time`.
    pub fn take(&mut self, t: f64, time: f64) {
        (self.said, self.now) = (Some((t, false)), time);
    }
}
