//! A posture that moves along a plan: its spring is that of every posture, here is what its motion asks for (T118).

use super::Gains;
use crate::robot::Robot;
use crate::trajectory::{JointSpline, Pace};

/// Where the posture is, how it moves, and the torque D_q q̇_d + M q̈_d that this takes. Null-space damping thereby damps
/// the motion relative to the plan, and the projector lets through what the task leaves of it.
#[derive(Debug, Clone)]
pub struct MovingPosture {
    /// q_d, q̇_d and q̈_d \[rad, rad/s, rad/s²\].
    pub state: [Vec<f64>; 3],
    /// Where the plan has the joints \[rad\], to which the posture may still be on its way.
    pub planned: Vec<f64>,
    /// The torque at the last [`update_torque`](Self::update_torque) \[N·m\].
    pub torque: Vec<f64>,
    momentum: Vec<f64>,
    scratch: Vec<f64>,
    course: Course,
    /// Where it was when the plan was left.
    leaving: [Vec<f64>; 3],
}

/// Whether a posture follows a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Course {
    /// There has been none.
    None,
    /// It does.
    Along,
    /// It has left it so long ago \[s\].
    Left(f64),
}

/// The pole with which a posture that has left its plan comes to rest \[1/s\].
const RATE: f64 = 10.0;

impl MovingPosture {
    /// At rest at 0, for `n` joints.
    pub fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self {
            state: [0; 3].map(|_| zeros()),
            planned: zeros(),
            torque: zeros(),
            momentum: zeros(),
            scratch: zeros(),
            course: Course::None,
            leaving: [0; 3].map(|_| zeros()),
        }
    }

    /// Whether it has been on a plan.
    pub fn has_moved(&self) -> bool {
        self.course != Course::None
    }

    /// Whether it is on one.
    pub fn is_along(&self) -> bool {
        self.course == Course::Along
    }

    /// Goes on as another one of as many joints.
    pub fn take_over(&mut self, other: &Self) {
        self.course = other.course;
        let Self { state, planned, torque, leaving, .. } = self;
        let theirs =
            other.state.iter().chain([&other.planned, &other.torque]).chain(&other.leaving);
        let own = state.iter_mut().chain([planned, torque]).chain(leaving);
        own.zip(theirs).for_each(|(own, theirs)| own.copy_from_slice(theirs));
    }

    /// At rest at 0 again, as if it had never moved.
    pub fn forget(&mut self) {
        self.course = Course::None;
        for numbers in self.state.iter_mut().chain([&mut self.torque]) {
            numbers.fill(0.0);
        }
    }

    /// Leaves the plan, if it is on one: from now on it comes to rest.
    pub fn leave(&mut self) {
        if self.course == Course::Along {
            self.course = Course::Left(0.0);
            for (from, state) in self.leaving.iter_mut().zip(&self.state) {
                from.copy_from_slice(state);
            }
        }
    }

    /// Lets `dt` \[s\] pass. Off a plan its velocity decays with the pole [`RATE`] twice, so that neither it nor its acceleration
    /// jumps. Whether it has moved.
    pub fn elapse(&mut self, dt: f64) -> bool {
        let Self { state: [q, dq, ddq], course, leaving: [q0, dq0, ddq0], .. } = self;
        let Course::Left(since) = course else { return false };
        *since += dt;
        let phase = RATE * *since;
        let (decay, gone) = ((-phase).exp(), -(-phase).exp_m1());
        for i in 0..q.len() {
            // q̇ = (v + b t) e^(−ωt) with b = a + ω v.
            let (v, b) = (dq0[i], ddq0[i] + RATE * dq0[i]);
            q[i] = q0[i] + v * gone / RATE + b * (gone - phase * decay) / (RATE * RATE);
            dq[i] = (v + b * *since) * decay;
            ddq[i] = (b - RATE * (v + b * *since)) * decay;
        }
        true
    }

    /// Goes to where the plan is at `pace`: q̇_d = q′σ̇ and q̈_d = q″σ̇² + q′σ̈.
    pub fn go_to(&mut self, joints: &JointSpline, pace: &Pace) {
        self.course = Course::Along;
        joints.at(pace.time, self.state.each_mut().map(Vec::as_mut_slice));
        self.planned.copy_from_slice(&self.state[0]);
        joints.draw(pace.time, self.state.each_mut().map(Vec::as_mut_slice));
        let [_, dq, ddq] = &mut self.state;
        for (dq, ddq) in dq.iter_mut().zip(ddq) {
            *ddq = *ddq * (pace.speed * pace.speed) + *dq * pace.change;
            *dq *= pace.speed;
        }
    }

    /// Finds the torque for `robot` where it is observed, of which all joints are damped by `brake` \[1/s\] beside the gains (T37): that is
    /// damping relative to the plan as well.
    pub fn update_torque<R: Robot<D>, const D: usize, const M: usize>(
        &mut self,
        robot: &R,
        gains: &Gains<M>,
        brake: f64,
    ) {
        let Self { state: [_, dq, ddq], torque, momentum, scratch, .. } = self;
        robot.mass_mul(dq, torque);
        gains.null_damping.scale_momentum(robot, brake, dq, torque, scratch);
        robot.mass_mul(ddq, momentum);
        torque.iter_mut().zip(momentum.iter()).for_each(|(tau, force)| *tau += force);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A posture that leaves its plan goes on as it was, and comes to rest.
    #[test]
    fn it_comes_to_rest_without_a_jump() {
        let joints =
            JointSpline::new(&[0.0, 1.0, 2.0], &[vec![0.0], vec![0.7], vec![1.0]]).unwrap();
        let mut posture = MovingPosture::new(1);
        posture.go_to(&joints, &Pace::of_time(0.8));
        let at = |posture: &MovingPosture| posture.state.each_ref().map(|x| x[0]);
        let bits = |state: [f64; 3]| state.map(f64::to_bits);
        let before = at(&posture);
        posture.leave();
        assert_eq!(bits(at(&posture)), bits(before));
        let mut last = before;
        for k in 0..30_000 {
            assert!(posture.elapse(1e-4));
            let now = at(&posture);
            assert!((0.5 * (last[1] + now[1]) - (now[0] - last[0]) / 1e-4).abs() < 1e-5, "{k}");
            assert!((0.5 * (last[2] + now[2]) - (now[1] - last[1]) / 1e-4).abs() < 1e-4, "{k}");
            last = now;
        }
        assert!(last[1].abs() < 1e-9 && last[2].abs() < 1e-9 && before[1] > 0.3);
        posture.leave(); // once
        assert_eq!(bits(at(&posture)), bits(last));
        posture.go_to(&joints, &Pace::of_time(0.8));
        assert_eq!(bits(at(&posture)), bits(before));
    }
}
