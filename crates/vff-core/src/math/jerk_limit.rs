//! One joint within limits of position, speed, acceleration and jerk, from sample to sample (T116, T140).

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

/// A way to stand still, in whole samples: the acceleration at the end of each phase, and its samples. The jerk of a phase is
/// constant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Stop([(f64, f64); 3]);

/// A joint that goes from sample to sample, and can always stop within its bounds. It is made at rest.
///
/// # Example
/// ```
/// use vff_core::math::{JointBounds, JointMotion, LimitedJoint};
///
/// let bounds = JointBounds { position: [-1.0, 1.0], speed: 0.5, acceleration: 2.0, jerk: 20.0 };
/// let mut joint = LimitedJoint::new(bounds, 0.0);
/// for _ in 0..1000 {
///     joint.advance(9.0, 1e-3);
/// }
/// let JointMotion { q, dq, .. } = joint.motion();
/// assert!(q < 1.0 && dq <= 0.5);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitedJoint {
    bounds: JointBounds,
    motion: JointMotion,
    /// How it stops if nothing else is possible.
    stop: Stop,
}

/// At what share of its largest speed a joint comes back that is beyond its position limits, and how soon it is that fast \[1/s\].
const RETURN: [f64; 2] = [0.025, 10.0];
/// How often the interval between what is possible and what is wanted is halved.
const HALVINGS: usize = 16;
/// Rounding of a bound, relative to it.
const ROUNDING: f64 = 1e-12;

impl JointMotion {
    /// After `time` \[s\] of constant jerk, at whose end the acceleration is `ddq`.
    fn after(self, time: f64, ddq: f64) -> Self {
        let change = ddq - self.ddq;
        Self {
            q: self.q + time * (self.dq + time * (0.5 * self.ddq + change / 6.0)),
            dq: self.dq + time * (self.ddq + 0.5 * change),
            ddq,
        }
    }

    fn mirrored(self) -> Self {
        Self { q: -self.q, dq: -self.dq, ddq: -self.ddq }
    }
}

impl Stop {
    /// The acceleration one sample later than `ddq`, and how it goes on.
    fn next(mut self, ddq: f64) -> (f64, Self) {
        for (end, samples) in &mut self.0 {
            if *samples > 0.0 {
                let next = ddq + (*end - ddq) / *samples;
                *samples -= 1.0;
                return (next, self);
            }
        }
        (0.0, self)
    }

    /// The quickest stop of a joint: the acceleration goes to −p, stays, and goes to 0 with the velocity, in so many samples of
    /// `h` \[s\] that p is within the bounds (T140).
    fn of(motion: JointMotion, bounds: &JointBounds, h: f64) -> Option<Self> {
        let JointBounds { acceleration, jerk, .. } = *bounds;
        let ramp = jerk * h;
        // Where the joint goes if its acceleration ends: that is to be stopped.
        let ends = motion.dq + 0.5 * h * motion.ddq * (motion.ddq.abs() / ramp).ceil();
        let JointMotion { dq, ddq, .. } = if ends < 0.0 { motion.mirrored() } else { motion };
        let peak = (jerk * dq + 0.5 * ddq * ddq).max(0.0).sqrt().min(acceleration);
        // Rather too few: one that began before has a part of these behind it.
        let few = |change: f64| ((change / ramp).ceil() - 1.0).max(1.0);
        let mut samples = [few(ddq + peak), 0.0, few(peak)];
        for _ in 0..Self::TRIES {
            let [there, stays, back] = samples;
            let p = (dq / h + 0.5 * there * ddq) / (0.5 * (there + back) + stays);
            if p.abs() > acceleration {
                let least = (dq / h + 0.5 * there * ddq) / acceleration - 0.5 * (there + back);
                samples[1] = least.ceil().max(stays + 1.0);
            } else if p.abs() > ramp * back {
                samples[2] += 1.0;
            } else if (ddq + p).abs() > ramp * there {
                samples[0] += 1.0;
            } else {
                let sign = if ends < 0.0 { 1.0 } else { -1.0 };
                return Some(Self([(sign * p, there), (sign * p, stays), (0.0, back)]));
            }
        }
        None
    }

    /// Samples that are added at most to what is too few.
    const TRIES: usize = 16;
}

impl LimitedJoint {
    /// A joint at rest at `q` \[rad, m\].
    pub fn new(bounds: JointBounds, q: f64) -> Self {
        let motion = JointMotion { q, ..JointMotion::default() };
        Self { bounds, motion, stop: Stop::default() }
    }

    /// Puts it at rest at `q` \[rad, m\].
    pub fn rest_at(&mut self, q: f64) {
        *self = Self::new(self.bounds, q);
    }

    /// What it may do.
    pub fn bounds(&self) -> &JointBounds {
        &self.bounds
    }

    /// Where it is.
    pub fn motion(&self) -> JointMotion {
        self.motion
    }

    /// Goes on for `h` \[s\] with constant jerk, to an acceleration as near to `wanted` as all bounds allow, those of the future as
    /// well: from there on it can stop within them. One that is beyond its position limits comes back.
    pub fn advance(&mut self, wanted: f64, h: f64) {
        let JointBounds { position: [lower, upper], speed, acceleration, jerk } = self.bounds;
        let JointMotion { q, dq, ddq } = self.motion;
        let room = ROUNDING * (1.0 + q.abs());
        let back = |side: f64| RETURN[1] * (side * RETURN[0] * speed - dq);
        let wanted = if q > upper + room { wanted.min(back(-1.0)) } else { wanted };
        let wanted = if q < lower - room { wanted.max(back(1.0)) } else { wanted };
        let least = (ddq - jerk * h).max(-acceleration);
        let most = (ddq + jerk * h).min(acceleration);
        let wanted = wanted.max(least).min(most);
        // This is possible, because it has been found to be.
        let (mut good, mut stop) = self.stop.next(ddq);
        if let Some(found) = self.stop_after(wanted, h) {
            (good, stop) = (wanted, found);
        } else {
            let mut bad = wanted;
            for _ in 0..HALVINGS {
                let middle = 0.5 * (good + bad);
                match self.stop_after(middle, h) {
                    Some(found) => (good, stop) = (middle, found),
                    None => bad = middle,
                }
            }
        }
        self.motion = self.motion.after(h, good);
        self.stop = stop;
    }

    /// How it stops after a sample at whose end its acceleration is `ddq`, if it can within its bounds.
    fn stop_after(&self, ddq: f64, h: f64) -> Option<Stop> {
        let mut motion = self.keeps(self.motion, h, ddq)?;
        let stop = Stop::of(motion, &self.bounds, h)?;
        for (end, samples) in stop.0 {
            motion = self.keeps(motion, h * samples, end)?;
        }
        Some(stop)
    }

    /// The motion after `time` \[s\] of constant jerk to `ddq`, if speed and position are within their bounds all the way; beyond
    /// a position limit, no farther than it is.
    fn keeps(&self, from: JointMotion, time: f64, ddq: f64) -> Option<JointMotion> {
        let JointBounds { position: [lower, upper], speed, .. } = self.bounds;
        let to = from.after(time, ddq);
        let jerk = if time > 0.0 { (ddq - from.ddq) / time } else { 0.0 };
        let at = |t: f64| from.after(t, from.ddq + jerk * t);
        let inside = |t: &f64| *t > 0.0 && *t < time;
        let fastest = Some(-from.ddq / jerk).filter(inside).map_or(to.dq, |t| at(t).dq);
        let most = speed * (1.0 + ROUNDING);
        if to.dq.abs() > most || fastest.abs() > most {
            return None;
        }
        let q = self.motion.q;
        let room = ROUNDING * (1.0 + q.abs());
        let (lower, upper) = ((lower - room).min(q), (upper + room).max(q));
        let contains = |q: f64| lower <= q && q <= upper;
        let turns = || {
            // Where dq + ddq t + jerk t²/2 = 0, without cancellation.
            let root = (from.ddq * from.ddq - 2.0 * jerk * from.dq).sqrt();
            let sum = -(from.ddq + root.copysign(from.ddq));
            [sum / jerk, 2.0 * from.dq / sum]
        };
        let turns_inside = contains(to.q)
            && (from.dq * to.dq > 0.0 && from.dq * fastest > 0.0
                || turns().iter().filter(|t| inside(t)).all(|t| contains(at(*t).q)));
        turns_inside.then_some(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BOUNDS: JointBounds =
        JointBounds { position: [-1.0, 1.0], speed: 2.0, acceleration: 10.0, jerk: 5000.0 };

    properties! {
        /// Whatever is wanted, at every period, no bound is exceeded, in the samples and between them.
        #[test]
        fn no_bound_is_exceeded(
            h in 1e-3..2e-2,
            speed in 0.05..4.0,
            acceleration in 0.5..30.0,
            jerk in 5.0..20_000.0,
            start in -1.0..1.0,
            wanted in prop::collection::vec((-100.0..100.0, 1..400_usize), 1..12),
        ) {
            let bounds = JointBounds { position: [-1.0, 1.0], speed, acceleration, jerk };
            let mut joint = LimitedJoint::new(bounds, start);
            for (wanted, cycles) in wanted {
                for _ in 0..cycles {
                    let from = joint.motion();
                    joint.advance(wanted, h);
                    let to = joint.motion();
                    let rate = (to.ddq - from.ddq) / h;
                    prop_assert!(rate.abs() <= jerk * (1.0 + 1e-9), "jerk {rate}");
                    prop_assert!(to.ddq.abs() <= acceleration * (1.0 + 1e-12), "{to:?}");
                    for k in 1..=4 {
                        let share = 0.25 * f64::from(k);
                        let now = from.after(share * h, from.ddq + share * (to.ddq - from.ddq));
                        prop_assert!(now.dq.abs() <= speed * (1.0 + 1e-9), "{now:?} {bounds:?}");
                        prop_assert!(now.q.abs() <= 1.0 + 1e-9, "{now:?} {bounds:?}");
                    }
                }
            }
        }

        /// What is wanted is done where it is allowed.
        #[test]
        fn what_is_allowed_is_done(wanted in -2.0..2.0, before in -2.0..2.0) {
            let bounds = JointBounds { position: [-9.0, 9.0], acceleration: 5.0, jerk: 1e4, ..BOUNDS };
            let mut joint = LimitedJoint::new(bounds, 0.1);
            for wanted in [before, wanted] {
                let from = joint.motion();
                joint.advance(wanted, 1e-3);
                let to = joint.motion();
                prop_assert!((to.ddq - wanted).abs() < 1e-15);
                prop_assert!((to.dq - from.dq - 0.5e-3 * (from.ddq + wanted)).abs() < 1e-15);
            }
        }
    }

    /// A joint that is pushed against its end gets there as fast as its bounds allow and stays, and one that is beyond comes back.
    #[test]
    fn at_the_end() {
        for h in [1e-3, 8e-3, 2e-2] {
            let mut joint = LimitedJoint::new(BOUNDS, -1.0);
            let (mut t, mut arrived) = (0.0, f64::INFINITY);
            while t < 4.0 {
                joint.advance(1e3, h);
                t += h;
                if joint.motion().q > 0.99 && arrived.is_infinite() {
                    arrived = t;
                }
            }
            let now = joint.motion();
            assert!(now.q > 0.999 && now.q <= 1.0 + 1e-9, "{h}: {now:?}");
            // 2 rad at 2 rad/s, 0.2 s for speeding up and braking, a sample for each of six corners.
            assert!(arrived < 1.2 + 6.0 * h, "{h}: {arrived}");
            let mut joint = LimitedJoint::new(BOUNDS, 1.3);
            let (mut t, mut fastest) = (0.0, 0.0_f64);
            while t < 0.5 + 0.3 / (RETURN[0] * BOUNDS.speed) {
                joint.advance(1e3, h);
                fastest = fastest.max(joint.motion().dq.abs());
                t += h;
            }
            assert!(fastest <= RETURN[0] * BOUNDS.speed * (1.0 + 1e-9), "{h}: {fastest}");
            let now = joint.motion();
            assert!(now.q > 0.99 && now.q <= 1.0 + 1e-6, "{h}: {now:?}");
        }
    }
}
