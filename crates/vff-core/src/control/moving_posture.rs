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
    /// The torque at the last [`update_torque`](Self::update_torque) \[N·m\].
    pub torque: Vec<f64>,
    momentum: Vec<f64>,
    scratch: Vec<f64>,
}

impl MovingPosture {
    /// At rest at 0, for `n` joints.
    pub fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self {
            state: [0; 3].map(|_| zeros()),
            torque: zeros(),
            momentum: zeros(),
            scratch: zeros(),
        }
    }

    /// Goes to where the plan is at `pace`: q̇_d = q′σ̇ and q̈_d = q″σ̇² + q′σ̈.
    pub fn go_to(&mut self, joints: &JointSpline, pace: &Pace) {
        joints.at(pace.time, self.state.each_mut().map(Vec::as_mut_slice));
        let [_, dq, ddq] = &mut self.state;
        for (dq, ddq) in dq.iter_mut().zip(ddq) {
            *ddq = *ddq * (pace.speed * pace.speed) + *dq * pace.change;
            *dq *= pace.speed;
        }
    }

    /// Finds the torque for `robot` where it is observed.
    pub fn update_torque<R: Robot<D>, const D: usize, const M: usize>(
        &mut self,
        robot: &R,
        gains: &Gains<M>,
    ) {
        let Self { state: [_, dq, ddq], torque, momentum, scratch } = self;
        robot.mass_mul(dq, torque);
        gains.null_damping.scale_momentum(robot, 0.0, dq, torque, scratch);
        robot.mass_mul(ddq, momentum);
        torque.iter_mut().zip(momentum.iter()).for_each(|(tau, force)| *tau += force);
    }
}
