//! `priority`: along the shortest way out of an obstacle the distance comes first (T65, T66).

use super::Yielding;
use super::barrier::THREE_POLES;
use crate::control::distance::DistanceRate;
use crate::control::torque_range::CLOSING;
use crate::control::{Torque, TorqueRange};
use crate::interrupt;
use crate::math::{dot, smoothstep};
use crate::robot::Robot;
use crate::world::Contact;

/// k where it is not given \[1/s\]: the torque changes with k², and no QP limits it.
pub const RATE: f64 = 20.0;

/// Workspace of the law.
#[derive(Debug, Clone)]
pub struct Priority {
    gradient: Vec<f64>,
    response: Vec<f64>,
    acceleration: Vec<f64>,
    /// q̈ at present, behind a limit of the torque rate.
    present: Vec<f64>,
    scratch: Vec<f64>,
    /// Mobility along n̂ \[1/kg\] below which a point counts as hardly movable.
    threshold: f64,
}

impl Priority {
    /// For `n` joints.
    pub fn new(n: usize, threshold: f64) -> Self {
        let zeros = || vec![0.0; n];
        Self {
            gradient: zeros(),
            response: zeros(),
            acceleration: zeros(),
            present: zeros(),
            scratch: zeros(),
            threshold,
        }
    }

    /// Pair by pair, from the base outwards: what d̈ is short of is added along n̂, with everything across it
    /// left as it was. The order is fixed, so that nothing jumps when another pair becomes nearest.
    pub fn act<R: Robot<D>, const D: usize>(
        &mut self,
        settings: &Yielding,
        robot: &R,
        pairs: &[Contact<D>],
        bias: &[f64],
        range: Option<&TorqueRange>,
        torque: &mut Torque,
    ) {
        if pairs.is_empty() {
            return;
        }
        let Self { gradient, response, acceleration, present, scratch, threshold } = self;
        robot.accelerate(&torque.total, bias, scratch, acceleration);
        if let Some(range) = range {
            robot.accelerate(&range.present, bias, scratch, present);
        }
        for pair in pairs {
            interrupt::spend(64 + 16 * gradient.len());
            let share =
                smoothstep((settings.outer - pair.distance) / (settings.outer - settings.inner));
            let motion = DistanceRate::cautious(robot, pair);
            robot.point_jacobian_tr_mul(pair.link, &pair.point, &pair.normal, gradient);
            let k = settings.rate.unwrap_or(RATE);
            let height = pair.distance - settings.margin;
            let wanted = match range {
                None => -2.0 * k * motion.rate - k * k * height,
                Some(range) => {
                    robot.mass_solve(gradient, response);
                    let jerk = range.jerk(gradient, response);
                    let now = [height, motion.rate, dot(gradient, present) + motion.bias];
                    range.least_acceleration(now, jerk, CLOSING, THREE_POLES * k)
                }
            };
            let missing = wanted - motion.bias - dot(gradient, acceleration);
            if missing <= 0.0 {
                continue;
            }
            robot.mass_solve(gradient, response);
            let force = share * missing / (dot(gradient, response) + *threshold);
            torque.add_to_task(|i| gradient[i] * force);
            acceleration.iter_mut().zip(response.iter()).for_each(|(a, y)| *a += y * force);
        }
    }
}
