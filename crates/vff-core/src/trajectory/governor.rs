//! A reference that waits: its clock slows down while the end effector is off it (T74–T76).
//!
//! The reference becomes x_r(t) = x(σ(t)) with a path time σ whose rate depends on the error. Its derivatives are
//! exact, so the controller keeps compensating for them, and the error obeys (T9) as before.

use super::{Guided, Sample, Trajectory};
use crate::math::smoothstep;
use crate::settings::settings;

settings! {
    /// When and how the reference waits: the `[controller.governor]` table of a scenario.
    #[derive(Copy)]
    pub struct GovernorSettings {
        /// Up to this distance of the end effector the clock runs normally.
        inner: f64 = 0.02, "m", NOT_NEGATIVE;
        /// From this distance on, more than `inner`, it runs at `floor` times its speed.
        outer: f64 = 0.1, "m", POSITIVE;
        /// How fast its speed changes, through two first-order lags.
        rate: f64 = 20.0, "1/s", POSITIVE;
        /// The share of the speed that is always left: 0 stops it, possibly forever if an obstacle on the path does not move.
        floor: f64 = 0.2, "", PART;
    }
}

/// How far the clock of the reference is behind.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Delay {
    /// t − σ \[s\].
    lag: f64,
    /// Its rate r = 1 − σ̇, in \[0, 1\].
    rate: f64,
    /// What the rate follows, in \[0, 1\].
    lead: f64,
}

/// The clock of the reference at one instant.
///
/// # Example
/// ```
/// use vff_core::trajectory::Pace;
///
/// let Pace { time, speed, change } = Pace::of_time(2.0);
/// assert_eq!((time, speed, change), (2.0, 1.0, 0.0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// σ \[s\].
    pub time: f64,
    /// σ̇, in \[0, 1\].
    pub speed: f64,
    /// σ̈ \[1/s\].
    pub change: f64,
}

impl Pace {
    /// On time.
    pub fn of_time(t: f64) -> Self {
        Self { time: t, speed: 1.0, change: 0.0 }
    }
}

/// The clock of the reference. It is known in closed form over a control period, at the beginning of which
/// it hears of the error.
///
/// # Example
/// ```
/// use vff_core::trajectory::{Governor, GovernorSettings};
///
/// let mut governor = Governor::new(GovernorSettings::default(), 0.0);
/// for k in 0..1000 {
///     governor.begin(1e-3 * f64::from(k));
///     governor.hear(1.0); // the end effector is a metre behind
/// }
/// assert!(governor.path_time(1.0) < 1.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Governor {
    /// None if it does not slow down any more.
    settings: Option<GovernorSettings>,
    /// ω, the pole of what it does \[1/s\].
    pole: f64,
    /// The beginning of the period \[s\], and the delay then.
    start: f64,
    delay: Delay,
    /// The rate of the delay that is wanted in this period.
    wanted: f64,
    /// The same of the period before.
    before: (f64, Delay, f64),
}

impl Governor {
    /// A clock that is on time at `start` \[s\].
    pub fn new(settings: GovernorSettings, start: f64) -> Self {
        let delay = Delay { lag: 0.0, rate: 0.0, lead: 0.0 };
        let before = (start, delay, 0.0);
        Self { settings: Some(settings), pole: settings.rate, start, delay, wanted: 0.0, before }
    }

    /// Takes over other settings, without a jump; with None the reference comes back to full speed and
    /// stays as late as it is.
    pub fn configure(&mut self, settings: Option<GovernorSettings>, t: f64) {
        self.begin(t);
        self.pole = settings.map_or(self.pole, |given| given.rate);
        self.settings = settings;
    }

    /// The delay at `t` \[s\], not before the present period, and r' \[1/s\]: two first-order lags in a row behind
    /// what is wanted, solved exactly (T75).
    fn at(&self, t: f64) -> (Delay, f64) {
        let Self { pole, wanted, delay: Delay { lag, rate, lead }, .. } = *self;
        let tau = t - self.start;
        let phase = pole * tau;
        let decay = (-phase).exp();
        let gone = -(-phase).exp_m1();
        let (lead_left, rate_left) = (lead - wanted, rate - wanted);
        let mean = gone / pole;
        let delay = Delay {
            lag: lag + wanted * tau + rate_left * mean + lead_left * (mean - tau * decay),
            rate: wanted + (rate_left + lead_left * phase) * decay,
            lead: wanted + lead_left * decay,
        };
        (delay, pole * (lead - rate - lead_left * phase) * decay)
    }

    /// The path time σ \[s\] at `t` \[s\].
    pub fn path_time(&self, t: f64) -> f64 {
        t - self.at(t).0.lag
    }

    /// The clock at `t` \[s\], were the error to stay.
    pub fn pace(&self, t: f64) -> Pace {
        let (delay, change) = self.at(t);
        Pace { time: t - delay.lag, speed: 1.0 - delay.rate, change: -change }
    }

    /// The reference at `t` \[s\], were the error to stay (T74).
    pub fn sample<P: Guided<M>, const M: usize>(
        &self,
        trajectory: &Trajectory<P, M>,
        t: f64,
    ) -> Sample<P, M> {
        trajectory.at_pace(&self.pace(t))
    }

    /// Begins the control period at `t` \[s\].
    pub fn begin(&mut self, t: f64) {
        if t > self.start {
            self.before = (self.start, self.delay, self.wanted);
            self.delay = self.at(t).0;
            self.start = t;
        }
    }

    /// Takes back the beginning of a control period after `t` \[s\].
    pub fn undo(&mut self, t: f64) {
        if t < self.start {
            (self.start, self.delay, self.wanted) = self.before;
        }
    }

    /// Tells it the distance of the end effector from the reference \[m\] at the beginning of the period (T76).
    pub fn hear(&mut self, error: f64) {
        self.wanted =
            self.settings.map_or(0.0, |GovernorSettings { inner, outer, floor, .. }| {
                (1.0 - floor) * smoothstep((error - inner) / (outer - inner))
            });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vector;
    use crate::trajectory::Reference;
    use proptest::prelude::*;

    const PERIOD: f64 = 2e-3;

    fn circle() -> Trajectory<Vector<2>, 2> {
        let circle = Reference::Circle {
            center: [1.0, 2.0],
            radius: 0.7,
            angular_velocity: 1.3,
            phase: 0.2,
            orientation: None,
        };
        Trajectory::new(&circle, &Vector::zeros()).unwrap()
    }

    fn time(k: usize) -> f64 {
        PERIOD * f64::from(u32::try_from(k).unwrap())
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Whatever the error does, σ runs between 0 and the speed of time; x_r, ẋ_r and ẍ_r do not jump
        /// from period to period, and the latter are the derivatives of the former.
        #[test]
        fn the_clock_is_smooth(
            errors in proptest::collection::vec(0.0..0.3, 60),
            rate in 1.0..60.0,
            floor in 0.0..0.9,
        ) {
            let settings = GovernorSettings { rate, floor, ..GovernorSettings::default() };
            let (mut governor, path) = (Governor::new(settings, 0.0), circle());
            let mut last = 0.0;
            for (k, error) in errors.iter().enumerate() {
                let t = time(k);
                let old = governor.sample(&path, t);
                governor.begin(t);
                governor.hear(*error);
                let new = governor.sample(&path, t);
                prop_assert!((new.x - old.x).norm() < 1e-14);
                prop_assert!((new.dx - old.dx).norm() < 1e-13);
                prop_assert!((new.ddx - old.ddx).norm() < 1e-11);

                let middle = t + 0.5 * PERIOD;
                let step = governor.path_time(middle) - last;
                last = governor.path_time(middle);
                let passed = if k == 0 { 0.5 * PERIOD } else { PERIOD };
                prop_assert!(floor * passed - 1e-15 <= step && step <= passed + 1e-15, "{step}");

                let h = 1e-5;
                let [a, b, c] = [-h, 0.0, h].map(|s| governor.sample(&path, middle + s));
                prop_assert!(((c.x - a.x) / (2.0 * h) - b.dx).norm() < 1e-6);
                // The third derivative is of the order of ω².
                prop_assert!(((c.dx - a.dx) / (2.0 * h) - b.ddx).norm() < 1e-8 * (10.0 + rate.powi(3)));
            }
        }

        /// Two periods with the same error are one twice as long: the closed form is exact.
        #[test]
        fn periods_add_up(error in 0.0..0.3, later in 0.0..0.3) {
            let mut one = Governor::new(GovernorSettings::default(), 0.0);
            one.hear(error);
            one.begin(0.1);
            one.hear(later);
            let mut two = one;
            two.begin(0.13);
            two.hear(later);
            prop_assert!((one.path_time(0.2) - two.path_time(0.2)).abs() < 1e-15);
            two.undo(0.12);
            prop_assert!(one.sample(&circle(), 0.2) == two.sample(&circle(), 0.2));
        }
    }

    /// As long as the error is small, the reference is what it is without a governor, to the last bit.
    #[test]
    fn it_does_nothing_while_the_error_is_small() {
        let (mut governor, path) = (Governor::new(GovernorSettings::default(), 0.0), circle());
        for k in 0..1000 {
            governor.begin(time(k));
            governor.hear(0.0199);
            let t = time(k) + 1e-3;
            assert_eq!(governor.sample(&path, t), path.at(t));
        }
    }

    /// A large error slows it down to its floor within a few time constants; without settings it comes back
    /// to full speed and stays late.
    #[test]
    fn it_waits_and_goes_on() {
        let mut governor = Governor::new(GovernorSettings::default(), 0.0);
        governor.hear(1.0);
        // The lag of two equal poles behind a step of the rate is (1 − φ)(t − 2/ω).
        assert!((governor.path_time(2.0) - (2.0 - 0.8 * 1.9)).abs() < 1e-12);
        governor.configure(None, 2.0);
        governor.hear(1.0);
        assert!((governor.path_time(4.0) - (4.0 - 0.8 * 2.0)).abs() < 1e-12);
    }
}
