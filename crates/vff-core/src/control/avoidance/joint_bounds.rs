//! How fast a joint may be, and become: near its largest speed, and towards its stops.

use crate::control::{CommandSettings, Gains, MotionLimits, TorqueRange};
use crate::interrupt;
use crate::math::ScalarOrVec;
use crate::robot::Robot;

/// From which share of its largest speed on a joint is braked gently by ways that are no program.
const GUARDED: f64 = 0.5;

/// Slower than that, a joint does not come to its largest speed within 1/this \[1/s\]: a few periods of a loop.
const AT_ONCE: f64 = 250.0;

/// In parts of a joint's largest speed: what a torque that is held for a period may miss it by.
const TOLERATED: f64 = 1.001;

/// c in (T163): a joint that comes to a stop brakes with 0.29 c of what its torque can do, and at last with 0.39 c.
const BRAKING: f64 = 2.0;

/// The share of the joint jerk of (T176) that a joint uses along its way to a stop; to get onto that way takes as much again (T200).
const STOPPING: f64 = 0.5;

/// The slowest pole of (T162) \[1/s\]: a joint whose torque hardly carries it is not braked half a turn before its stop.
const SLOWEST: f64 = 4.0;

/// How a joint comes to its stops where a robot wants it slower the nearer it is.
#[derive(Debug, Clone, Copy)]
pub struct Braking {
    /// b \[rad/s²\].
    deceleration: f64,
    /// o \[rad/s\].
    offset: f64,
}

impl Braking {
    /// Of `n` joints, if anything is said of it.
    fn of(command: &CommandSettings, n: usize) -> Vec<Self> {
        let of = |given: &ScalarOrVec, i| Self {
            deceleration: given.get(i),
            offset: command.stop_offset.get(i),
        };
        command
            .stop_deceleration
            .as_ref()
            .map_or(vec![], |given| (0..n).map(|i| of(given, i)).collect())
    }

    /// √(o² + 2 b h) − o, the largest speed towards a stop that is h away, and how fast it changes at the speed `dq` (T152).
    fn towards(self, height: f64, dq: f64) -> [f64; 2] {
        let Self { deceleration: b, offset: o } = self;
        let root = (o * o + 2.0 * b * height.max(0.0)).sqrt();
        let most = root - o;
        [most, if most > 0.0 { -b * dq.clamp(0.0, most) / root } else { 0.0 }]
    }
}

/// What of the joints is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Joints {
    /// Angles and speeds.
    All,
    /// Of an arm without velocity limits.
    Angles,
    /// Angles and speeds, where a joint would come to a stop or be too fast (T153, T162).
    Guarded,
}

/// What torques act: now, and what the drives accept next.
#[derive(Debug, Clone, Copy)]
pub struct Acting<'a> {
    /// C q̇ + g, less the external torque that is known \[N·m, N\].
    pub bias: &'a [f64],
    /// Behind a limit of the torque rate what can be sent next, and q̈ under what was sent last.
    pub range: Option<(&'a TorqueRange, &'a [f64])>,
}

/// The bounds of the accelerations of all joints.
#[derive(Debug, Clone)]
pub struct JointBounds {
    /// k, see [`Yielding`](crate::control::Yielding).
    rate: f64,
    /// Largest speed of every joint \[rad/s\].
    speed: Vec<f64>,
    joints: Joints,
    /// Whether they have limits of speed.
    has_speeds: bool,
    /// How far a joint keeps from its stops \[rad, m\], and the share of its largest speed that it keeps.
    angle: f64,
    share: f64,
    /// How every joint comes to its stops; empty if `rate` alone says it.
    braking: Vec<Braking>,
    /// How fast every joint can lose acceleration behind a rate while all of them do (T176) \[rad/s³\].
    together: Vec<f64>,
    /// The largest accelerations \[rad/s², m/s²\] of joints that are moved by other means than a torque (T201); empty for any.
    able: Vec<f64>,
}

impl JointBounds {
    /// For the joints of `robot`, which keep `angle` \[rad, m\] from their stops and a `share` of their speeds.
    pub fn new<R: Robot<D>, const D: usize, const M: usize>(
        robot: &R,
        gains: &Gains<M>,
        [angle, share]: [f64; 2],
    ) -> Self {
        Self {
            rate: super::barrier::rate(&gains.yielding),
            speed: gains.joint_speeds(robot),
            has_speeds: !gains.speed_limits(robot).is_empty(),
            joints: Joints::All,
            angle,
            share,
            braking: Braking::of(&gains.command, robot.dof()),
            together: vec![f64::INFINITY; robot.dof()],
            able: vec![],
        }
    }

    /// For joints that are moved within these limits, whatever the torque.
    pub fn move_within(&mut self, limits: &MotionLimits) {
        self.able.clone_from(&limits.acceleration);
    }

    /// Leaves the speeds of an arm without velocity limits alone.
    pub fn leave_speeds(&mut self) {
        if !self.has_speeds {
            self.joints = Joints::Angles;
        }
    }

    /// Leaves alone what is neither too fast nor about to come to a stop.
    pub fn guard(&mut self) {
        self.joints = Joints::Guarded;
        if !self.has_speeds {
            self.speed.fill(f64::INFINITY);
        }
    }

    /// Whether every joint may have the acceleration `ddq`; `work` has twice as many numbers as there are joints.
    pub fn is_calm<R: Robot<D>, const D: usize>(
        &self,
        robot: &R,
        ddq: &[f64],
        bias: &[f64],
        work: [&mut [f64]; 2],
    ) -> bool {
        let Self { rate, speed, angle, .. } = self;
        let [column, unit] = work;
        let k = rate.min(SLOWEST);
        (0..ddq.len()).all(|i| {
            let (q, dq, ddq, most) =
                (robot.configuration()[i], robot.velocity()[i], ddq[i], speed[i]);
            let bound = |dq| self.towards_speed(i, dq);
            // The first is never more than either bound, and nearly always enough.
            let is_slow =
                ddq.abs() <= rate * (most - dq.abs()) || (-bound(-dq) <= ddq && ddq <= bound(dq));
            is_slow
                && robot.limits().kept_angles(i, *angle).is_none_or(|[low, high]| {
                    // With the slowest pole, which is the most cautious one as long as k h is more than the speed.
                    let height = (q - low).min(high - q);
                    let is_far = height > 0.0
                        && dq.abs() <= k * height
                        && ddq.abs() + 2.0 * k * dq.abs() <= k * k * height;
                    is_far || {
                        let [lower, upper] =
                            self.stopping(robot, i, [low, high], bias, [&mut *column, &mut *unit]);
                        lower <= ddq && ddq <= upper
                    }
                })
        })
    }

    /// Reckons with joints that all brake at the same time behind this limit of the torque rate, with the masses M row by row.
    pub fn brake_together(&mut self, range: &TorqueRange, mass: &[f64]) {
        range.jerks_together(mass, &self.speed, &mut self.together);
    }

    /// The least and the largest q̈ of joint `i`; `work` has twice as many numbers as there are joints.
    pub fn accelerations<R: Robot<D>, const D: usize>(
        &self,
        robot: &R,
        i: usize,
        acting: &Acting<'_>,
        work: [&mut [f64]; 2],
    ) -> [f64; 2] {
        match acting.range {
            None => {
                let bounds = self.at_once(robot, i, acting.bias, work);
                let able = self.able.get(i);
                able.map_or(bounds, |most| bounds.map(|bound| bound.max(-most).min(*most)))
            }
            Some((range, present)) => self.behind_a_rate(robot, i, range, present, work),
        }
    }

    /// Where the torque can change at once: |q̈| ≤ k(q̇_max − |q̇|) for the speed (T68), or (T153) where it is guarded, and (T162)
    /// for the angle.
    fn at_once<R: Robot<D>, const D: usize>(
        &self,
        robot: &R,
        i: usize,
        bias: &[f64],
        work: [&mut [f64]; 2],
    ) -> [f64; 2] {
        let Self { rate: k, angle, share, braking, .. } = self;
        let (q, dq) = (robot.configuration()[i], robot.velocity()[i]);
        let [mut lower, mut upper] = [-self.towards_speed(i, -dq), self.towards_speed(i, dq)];
        if let Some([low, high]) = robot.limits().kept_angles(i, *angle) {
            if let Some(braking) = braking.get(i) {
                let towards = |height: f64, dq: f64| {
                    let [speed, change] = braking.towards(height, dq);
                    share * change + k * (share * speed - dq)
                };
                lower = lower.max(-towards(q - low, -dq));
                upper = upper.min(towards(high - q, dq));
            }
            let [least, most] = self.stopping(robot, i, [low, high], bias, work);
            (lower, upper) = (lower.max(least), upper.min(most));
        }
        [lower, upper]
    }

    /// The largest q̈ of joint `i` towards its largest speed, at the speed `dq`, which has that sign: (T68), or (T153) where it is guarded,
    /// and beyond that speed (T164).
    fn towards_speed(&self, i: usize, dq: f64) -> f64 {
        let Self { rate: k, speed, joints, share, .. } = self;
        let most = speed[i];
        let towards = match joints {
            Joints::All => k * (share * most - dq),
            Joints::Angles => return f64::INFINITY,
            Joints::Guarded => guarded_acceleration(*k, most, dq),
        };
        towards - brake_beyond(*k, most, dq)
    }

    /// The least and the largest q̈ with which joint `i` stays between these angles, or comes back to them (T162).
    fn stopping<R: Robot<D>, const D: usize>(
        &self,
        robot: &R,
        i: usize,
        [low, high]: [f64; 2],
        bias: &[f64],
        [column, unit]: [&mut [f64]; 2],
    ) -> [f64; 2] {
        let (q, dq) = (robot.configuration()[i], robot.velocity()[i]);
        let deceleration = robot.limits().torque.get(i).map_or(f64::INFINITY, |most| {
            interrupt::checkpoint(16 * unit.len());
            unit.fill(0.0);
            unit[i] = 1.0;
            robot.mass_mul(unit, column);
            (most - bias[i].abs()).max(0.0) / column[i]
        });
        let deceleration = self.able.get(i).map_or(deceleration, |most| most.min(deceleration));
        let k = stopping_pole(self.rate, deceleration, dq);
        let towards = |height, dq| stopped(height, dq, self.speed[i], k);
        [-towards(q - low, -dq), towards(high - q, dq)]
    }

    /// Behind a limit of the torque rate: (T131) and (T200) for the angle and (T132) for the speed.
    fn behind_a_rate<R: Robot<D>, const D: usize>(
        &self,
        robot: &R,
        i: usize,
        range: &TorqueRange,
        present: &[f64],
        [unit, response]: [&mut [f64]; 2],
    ) -> [f64; 2] {
        let Self { rate: k, speed, joints, angle, share, braking, together, .. } = self;
        let (q, dq, ddq, most) =
            (robot.configuration()[i], robot.velocity()[i], present[i], speed[i]);
        interrupt::checkpoint(8 * unit.len());
        unit.fill(0.0);
        unit[i] = 1.0;
        robot.mass_solve(unit, response);
        let jerk = range.jerk(unit, response);
        // For how long, and how, the joint goes on before anything can be changed.
        let period = range.period;
        let next = dq + period * ddq;
        let braking_jerk = TorqueRange::braking_jerk(jerk).min(together[i]);
        let faster = |left| TorqueRange::most_acceleration(left, braking_jerk, *k);
        let stopping_jerk = STOPPING * together[i];
        let [mut lower, mut upper] = [f64::NEG_INFINITY, f64::INFINITY];
        if *joints == Joints::All {
            let kept = share * most;
            [lower, upper] = [-faster(kept + next), faster(kept - next)];
        }
        if let Some([low, high]) = robot.limits().kept_angles(i, *angle) {
            if let Some(braking) = braking.get(i) {
                let towards = |height: f64, sign: f64| {
                    let next = sign * next;
                    let [speed, change] = braking.towards(height - sign * period * dq, next);
                    share * change + faster(share * speed - next)
                };
                lower = lower.max(-towards(q - low, -1.0));
                upper = upper.min(towards(high - q, 1.0));
            }
            let away = |height: f64, sign: f64| {
                let now = [height, sign * dq, sign * ddq];
                let least = range.least_acceleration(now, jerk, most, *k);
                let next = [height + sign * period * dq, -sign * next];
                let [speed, change] = TorqueRange::speed_towards(stopping_jerk, next);
                let jerk = braking_jerk.min(stopping_jerk);
                least.max(-change - TorqueRange::most_acceleration(speed - next[1], jerk, *k))
            };
            lower = lower.max(away(q - low, 1.0));
            upper = upper.min(-away(high - q, -1.0));
        }
        [lower, upper]
    }
}

/// k_i of (T162) \[1/s\]: `rate`, or less where a joint at the speed `dq` would have to brake faster than its `deceleration` (T163).
fn stopping_pole(rate: f64, deceleration: f64, dq: f64) -> f64 {
    rate.min(BRAKING * deceleration / dq.abs()).max(rate.min(SLOWEST))
}

/// The largest acceleration with the pole `k` towards a stop that is `height` away, at the speed `dq` towards it (T162); from beyond it,
/// where `height` is less than 0, a joint comes back with half of its largest speed `most`.
fn stopped(height: f64, dq: f64, most: f64, k: f64) -> f64 {
    k * k * height.max(-most / k) - 2.0 * k * dq
}

/// What is added to the braking of a joint beyond its largest speed `most` at the speed `dq`, which has that sign (T164).
fn brake_beyond(k: f64, most: f64, dq: f64) -> f64 {
    (AT_ONCE - k).max(0.0) * (dq - TOLERATED * most).max(0.0)
}

/// The largest acceleration of a joint towards its largest speed `most` at the speed `dq`, which has that sign (T153).
fn guarded_acceleration(k: f64, most: f64, dq: f64) -> f64 {
    let left = most - dq;
    let beyond = dq - GUARDED * most;
    if left <= 0.0 {
        k * left
    } else if beyond <= 0.0 {
        AT_ONCE * left
    } else {
        left * AT_ONCE.min(k * (1.0 - GUARDED) * most / beyond)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    properties! {
        /// A joint that is asked for whatever its torque can do comes to rest before its stop, from wherever it could still
        /// be stopped with half of that torque, and does not stay away from it: (T162) asks for no more than there is.
        #[test]
        fn a_joint_comes_to_rest_before_its_stop(
            deceleration in 15.0..300.0, speed in 0.0..6.0, extra in 0.0..1.0, asked in 0.1..1.0,
        ) {
            const PERIOD: f64 = 1e-3;
            let (mut height, mut dq) = (speed * speed / deceleration + 0.02 + extra, speed);
            let mut least = f64::INFINITY;
            for _ in 0..20_000 {
                let k = stopping_pole(40.0, deceleration, dq);
                let most = stopped(height, dq, 6.0, k);
                let ddq = f64::min(asked * deceleration, most).max(-deceleration);
                dq += PERIOD * ddq;
                height -= PERIOD * dq;
                least = least.min(height);
            }
            prop_assert!(least > -1e-3, "{least}"); // half of what is kept, by sampling
            prop_assert!(height < 1e-3 && dq.abs() < 1e-3, "{height} {dq}");
        }

        /// From a uniform approach on, no more than 0.8 of its torque brakes it (T163).
        #[test]
        fn braking_leaves_torque(deceleration in 15.0..300.0, speed in 0.1..6.0) {
            const PERIOD: f64 = 1e-4;
            let (mut height, mut dq) = (speed * speed / deceleration + 2.0, speed);
            let mut hardest: f64 = 0.0;
            while dq > 1e-3 {
                let k = stopping_pole(40.0, deceleration, dq);
                let ddq = stopped(height, dq, 6.0, k).min(0.0);
                hardest = hardest.max(-ddq);
                dq += PERIOD * ddq;
                height -= PERIOD * dq;
            }
            prop_assert!(hardest < 0.8 * deceleration, "{hardest}");
            // One that is slow comes to the pole of all others before it brakes that hard.
            if 40.0 * speed > 4.0 * deceleration {
                prop_assert!(hardest > 0.5 * deceleration, "{hardest}");
            }
        }
    }

    /// Stops that move past a joint, as of another arm in a loop, do not throw it, and bring it back.
    #[test]
    fn a_joint_beyond_its_stop_comes_back_slowly() {
        const PERIOD: f64 = 1e-3;
        for beyond in [0.01, 0.1, 0.5, 2.0] {
            let (mut height, mut dq, mut fastest) = (-beyond, 0.0_f64, 0.0_f64);
            for _ in 0..4000 {
                dq += PERIOD * stopped(height, dq, 2.0, 40.0);
                height -= PERIOD * dq;
                fastest = fastest.max(-dq);
            }
            assert!(fastest < 1.01 && height.abs() < 1e-3, "{beyond} {fastest} {height}");
        }
        assert!((stopped(-0.04, 0.0, 2.0, 40.0) + 64.0).abs() < 1e-12); // a little beyond, as before
    }

    /// (T164) leaves a joint alone that is within a thousandth of its limit, and is continuous there.
    #[test]
    fn what_is_tolerated_is_not_braked_harder() {
        assert!(brake_beyond(40.0, 2.0, 2.0019).abs() < 1e-15);
        assert!(brake_beyond(40.0, 2.0, 2.0021) < 0.03);
        assert!(brake_beyond(40.0, f64::INFINITY, 10.0) == 0.0);
        assert!(brake_beyond(300.0, 2.0, 3.0) == 0.0);
    }
}
