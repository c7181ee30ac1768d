//! Joints that are moved by other means than a torque (T201).

use std::f64::consts::E;

/// Share of the largest acceleration that damps where a law wants more than there is; the rest follows the law.
const BRAKED: f64 = 0.5;

/// What whatever moves the joints can do, n numbers each.
///
/// # Example
/// ```
/// use vff_core::control::MotionLimits;
///
/// let slow = MotionLimits { speed: vec![2.0], acceleration: vec![4.0], jerk: vec![50.0] };
/// assert!(slow.barrier_rate() < 5.5);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct MotionLimits {
    /// \[rad/s, m/s\].
    pub speed: Vec<f64>,
    /// \[rad/s², m/s²\].
    pub acceleration: Vec<f64>,
    /// \[rad/s³, m/s³\].
    pub jerk: Vec<f64>,
}

impl MotionLimits {
    /// ω \[1/s\], the rate at which what moves the joints stops by itself.
    pub const RATE: f64 = 10.0;

    /// The share of an acceleration `ddq` that is for a change of velocity at a `rate` \[1/s\], ddq/rate, which a joint behind a limit of
    /// jerk can take back in time: with √(jerk·change) the acceleration ends as the change does.
    pub fn behind_jerk(ddq: f64, rate: f64, jerk: f64) -> f64 {
        (jerk / (rate * ddq.abs())).sqrt().min(1.0)
    }

    /// The share of what a law wants, `ddq` \[rad/s², m/s²\] at the speeds `dq` \[rad/s, m/s\], for which all joints have the acceleration at
    /// the same time, so that the way is the one it wants, and with what they are damped for what is missing \[1/s\]: a law that does not
    /// know these limits would swing ever farther.
    pub fn share(&self, ddq: &[f64], dq: &[f64]) -> [f64; 2] {
        let (mut share, mut brake) = (1.0_f64, f64::INFINITY);
        for (acceleration, (ddq, dq)) in self.acceleration.iter().zip(ddq.iter().zip(dq)) {
            share = share.min(acceleration / ddq.abs());
            brake = brake.min(BRAKED * acceleration / dq.abs());
        }
        [share, brake.min((1.0 - share) * Self::RATE)]
    }

    /// Makes of what a law that reacts with `rate` \[1/s\] wants what the joints can do: that [share](Self::share), and of what is beyond
    /// `planned` as much as a limit of jerk can take back in time. A plan keeps that limit by itself.
    pub fn fit(&self, ddq: &mut [f64], planned: Option<&[f64]>, dq: &[f64], rate: f64) {
        let along = |i: usize| planned.map_or(0.0, |planned| planned[i]);
        let [strong, brake] = self.share(ddq, dq);
        let soon = |(i, ddq): (usize, &f64)| Self::behind_jerk(ddq - along(i), rate, self.jerk[i]);
        let share = ddq.iter().enumerate().map(soon).fold(strong, f64::min);
        for (i, ddq) in ddq.iter_mut().enumerate() {
            *ddq = strong * along(i) + share * (*ddq - along(i)) - brake * dq[i];
        }
    }

    /// The largest k \[1/s\] of barriers that such joints can keep from whatever speed they have (T201).
    pub fn barrier_rate(&self) -> f64 {
        let Self { speed, acceleration, jerk } = self;
        let joints = speed.iter().zip(acceleration).zip(jerk);
        let rates = joints.map(|((v, a), j)| (E * a / v).min((j / v).sqrt()));
        rates.fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A barrier that is come upon at full speed takes all of the acceleration at most, and no more of the jerk than there is.
    #[test]
    fn a_barrier_takes_what_there_is() {
        for (v, a, j) in [(2.0, 4.0, 1e6), (2.0, 1e6, 50.0), (0.5, 3.0, 40.0)] {
            let limits = MotionLimits { speed: vec![v], acceleration: vec![a], jerk: vec![j] };
            let k = limits.barrier_rate();
            // From where it begins to act: ḧ = −2kḣ − k²h, as long as that brakes.
            let (mut h, mut rate, dt) = (2.0 * v / k, -v, 1e-5 / k);
            let (mut hardest, mut before, mut steepest) = (0.0_f64, 0.0, 0.0_f64);
            for _ in 0..1_000_000 {
                let pull = -2.0 * k * rate - k * k * h;
                hardest = hardest.max(pull);
                steepest = steepest.max((pull - before) / dt);
                before = pull;
                rate += dt * pull;
                h += dt * rate;
            }
            assert!(h > 0.0 && rate > -1e-3 * v, "{h} {rate}");
            let shares = [hardest / a, steepest / j];
            assert!(shares.iter().all(|share| *share < 1.001), "{shares:?}");
            assert!(shares.iter().any(|share| *share > 0.99), "{shares:?}");
        }
    }
}
