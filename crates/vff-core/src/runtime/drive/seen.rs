//! When obstacles were seen that others follow.

/// Obstacles with smaller numbers can be followed; others are not watched over.
const MOST: usize = 4096;

/// Obstacles that somebody sees from time to time. Nothing allocates after construction.
#[derive(Debug)]
pub(super) struct Seen {
    /// When each was seen last \[s\], −∞ if it never was; up to the last one that was.
    last: Vec<f64>,
}

impl Seen {
    pub(super) fn new() -> Self {
        Self { last: Vec::with_capacity(MOST) }
    }

    /// Obstacle `j` was seen at time `t` \[s\].
    pub(super) fn add(&mut self, j: usize, t: f64) {
        if j >= self.last.len() && j < MOST {
            self.last.resize(j + 1, f64::NEG_INFINITY);
        }
        if let Some(last) = self.last.get_mut(j) {
            *last = last.max(t);
        }
    }

    /// There are others in the place of those that were seen.
    pub(super) fn forget(&mut self) {
        self.last.clear();
    }

    /// Which was last seen longer than `patience` \[s\] before `t`, and when.
    pub(super) fn missing(&self, t: f64, patience: f64) -> Option<(usize, f64)> {
        let mut seen = self.last.iter().copied().enumerate().filter(|(_, last)| last.is_finite());
        seen.find(|(_, last)| t - last > patience)
    }
}
