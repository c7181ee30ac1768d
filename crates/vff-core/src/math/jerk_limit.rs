//! One joint within limits of position, speed, acceleration and jerk, from sample to sample (T116).

/// What a joint may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointBounds {
    /// Where it ends \[rad, m\]; infinite if it does not.
    pub position: [f64; 2],
    /// \[rad/s, m/s\], > 0.
    pub speed: f64,
    /// \[rad/s², m/s²\], > 0.
    pub acceleration: f64,
    /// \[rad/s³, m/s³\], > 0.
    pub jerk: f64,
}

/// Position, velocity and acceleration of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointMotion {
    /// \[rad, m\].
    pub q: f64,
    /// \[rad/s, m/s\].
    pub dq: f64,
    /// \[rad/s², m/s²\].
    pub ddq: f64,
}

/// Share of acceleration and jerk with which the joint plans to brake: what a sampled braking lacks of a continuous one is taken
/// from the rest.
const PLANNED: f64 = 0.8;

impl JointMotion {
    /// After `h` \[s\] of constant jerk, at whose end the acceleration is `ddq`.
    fn after(self, h: f64, ddq: f64) -> Self {
        let change = ddq - self.ddq;
        Self {
            q: self.q + h * (self.dq + h * (0.5 * self.ddq + change / 6.0)),
            dq: self.dq + h * (self.ddq + 0.5 * change),
            ddq,
        }
    }

    fn mirrored(self) -> Self {
        Self { q: -self.q, dq: -self.dq, ddq: -self.ddq }
    }

    /// The greatest speed and the farthest position upwards, if it brakes from now on with at most this acceleration and
    /// jerk.
    fn extremes(self, most: f64, jerk: f64) -> [f64; 2] {
        let Self { q, dq, ddq } = self;
        let ramp = ddq.abs() / jerk;
        let share = 0.5 * ddq * ramp; // what the ramp adds to the speed, with its sign
        if ddq >= 0.0 {
            let peak = dq + share;
            let reached = q + ramp * (dq + ddq * ramp / 3.0);
            return [peak, reached + braking_distance(peak, most, jerk)];
        }
        // It brakes already, as if it had begun a ramp ago.
        if dq <= 0.0 {
            return [dq, q];
        }
        if dq + share >= 0.0 {
            let began = dq - share;
            let back = ramp * (began + ddq * ramp / 6.0);
            return [dq, q - back + braking_distance(began, most, jerk)];
        }
        // More than it has to: it turns round before the ramp is over.
        let turn = (-ddq - (ddq * ddq - 2.0 * jerk * dq).max(0.0).sqrt()) / jerk;
        [dq, q + turn * (dq + turn * (0.5 * ddq + jerk * turn / 6.0))]
    }
}

/// How far a joint goes that brakes from a speed, without acceleration at first and in the end.
fn braking_distance(speed: f64, most: f64, jerk: f64) -> f64 {
    if speed <= 0.0 {
        return 0.0;
    }
    let time = if speed * jerk <= most * most {
        2.0 * (speed / jerk).sqrt()
    } else {
        speed / most + most / jerk
    };
    0.5 * speed * time
}

impl JointBounds {
    /// The motion in `h` \[s\], with the acceleration there as near to `wanted` as all bounds allow, those of the future as
    /// well: from there on the joint can brake within them. One that is beyond its position limits comes back.
    pub fn advance(&self, now: JointMotion, wanted: f64, h: f64) -> JointMotion {
        let Self { acceleration, jerk, .. } = *self;
        let least = (now.ddq - jerk * h).max(-acceleration);
        let most = (now.ddq + jerk * h).min(acceleration).max(least);
        let most = self.highest(now, [least, most], h);
        let mirrored = self.mirrored();
        let least = -mirrored.highest(now.mirrored(), [-most, -least], h);
        now.after(h, wanted.max(least).min(most.max(least)))
    }

    fn mirrored(&self) -> Self {
        let [lower, upper] = self.position;
        Self { position: [-upper, -lower], ..*self }
    }

    /// The highest acceleration between these from which on it can still brake below its bounds; the lowest if there is none.
    fn highest(&self, now: JointMotion, [least, most]: [f64; 2], h: f64) -> f64 {
        let Self { position: [_, upper], speed, acceleration, jerk } = *self;
        // A ramp that ends within a sample is held to its end: so much farther the joint may go.
        let upper = upper - 2.0 * (jerk * h).min(acceleration) * h * h;
        let can_brake = |ddq: f64| {
            let then = now.after(h, ddq);
            let [fastest, farthest] = then.extremes(PLANNED * acceleration, PLANNED * jerk);
            fastest <= speed && farthest <= upper
        };
        if can_brake(most) {
            return most;
        }
        let (mut good, mut bad) = (least, most);
        for _ in 0..40 {
            let middle = 0.5 * (good + bad);
            if can_brake(middle) {
                good = middle;
            } else {
                bad = middle;
            }
        }
        good
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever is wanted, no bound is exceeded, and the jerk of the samples is within its own.
        #[test]
        fn no_bound_is_exceeded(
            h in prop_oneof![Just(1e-3), Just(2e-3), Just(8e-3)],
            speed in 0.2..4.0,
            acceleration in 1.0..20.0,
            jerk in 20.0..10_000.0,
            start in -0.9..0.9,
            wanted in prop::collection::vec((-100.0..100.0, 1..400_usize), 1..12),
        ) {
            let bounds = JointBounds { position: [-1.0, 1.0], speed, acceleration, jerk };
            let mut now = JointMotion { q: start, ..JointMotion::default() };
            for (wanted, cycles) in wanted {
                for _ in 0..cycles {
                    let next = bounds.advance(now, wanted, h);
                    let rate = (next.ddq - now.ddq) / h;
                    prop_assert!(rate.abs() <= jerk * (1.0 + 1e-9), "jerk {rate}");
                    prop_assert!(next.ddq.abs() <= acceleration * (1.0 + 1e-12), "{next:?}");
                    prop_assert!(next.dq.abs() <= speed * (1.0 + 1e-9), "{next:?} {bounds:?}");
                    prop_assert!(next.q.abs() <= 1.0 + 1e-9, "{next:?} {bounds:?}");
                    now = next;
                }
            }
        }

        /// What is wanted is done where it is allowed.
        #[test]
        fn what_is_allowed_is_done(wanted in -2.0..2.0, dq in -0.5..0.5) {
            let bounds = JointBounds { position: [-9.0, 9.0], speed: 2.0, acceleration: 5.0, jerk: 1e4 };
            let next = bounds.advance(JointMotion { q: 0.1, dq, ddq: 0.0 }, wanted, 1e-3);
            prop_assert!((next.ddq - wanted).abs() < 1e-15);
            prop_assert!((next.dq - dq - 0.5e-3 * wanted).abs() < 1e-15);
        }
    }

    /// A joint that is pushed against its end gets near to it, and one that is beyond comes back.
    #[test]
    fn at_the_end() {
        let bounds =
            JointBounds { position: [-1.0, 1.0], speed: 2.0, acceleration: 10.0, jerk: 5000.0 };
        let mut now = JointMotion::default();
        for _ in 0..4000 {
            now = bounds.advance(now, 1e3, 1e-3);
        }
        assert!(now.q > 0.999 && now.q <= 1.0 + 1e-9, "{now:?}");
        let mut now = JointMotion { q: 1.3, ..JointMotion::default() };
        for _ in 0..4000 {
            now = bounds.advance(now, 1e3, 1e-3);
        }
        assert!(now.q > 0.99 && now.q <= 1.0 + 1e-6, "{now:?}");
    }
}
