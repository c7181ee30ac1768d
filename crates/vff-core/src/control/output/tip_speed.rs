//! The tip is kept below a speed: the least constraint on its acceleration along its own velocity (T114).

use crate::control::limits::largest_share;
use crate::math::dot;
use crate::robot::Robot;
use nalgebra::SVector;

/// γ \[1/s\]: kinetic reserve v̄² − v² is used up no faster than at this rate.
const RATE: f64 = 20.0;

/// A limit of the tip's speed, with its workspaces.
#[derive(Debug, Clone)]
pub struct TipSpeed {
    /// v̄ \[m/s\].
    most: f64,
    /// Jᵀv and M⁻¹Jᵀv.
    row: Vec<f64>,
    response: Vec<f64>,
}

impl TipSpeed {
    /// A limit \[m/s\] for `n` joints.
    pub fn new(most: f64, n: usize) -> Self {
        Self { most, row: vec![0.0; n], response: vec![0.0; n] }
    }

    /// Takes from `tau` what would make the tip too fast, where `bias` is C q̇ + g. The torque limits come first.
    pub fn brake<R: Robot<D>, const D: usize>(&mut self, robot: &R, bias: &[f64], tau: &mut [f64]) {
        let Self { most, row, response } = self;
        let v: SVector<f64, D> = robot.task_velocity();
        robot.jacobian_tr_mul(&v, row);
        robot.mass_solve(row, response);
        // vᵀv̇ as the torque would have it, and as it may be.
        let drift = v.dot(&robot.task_bias_acceleration());
        let along = dot(response, tau) - dot(response, bias) + drift;
        let allowed = 0.5 * RATE * (*most * *most - v.norm_squared());
        let mobility = dot(row, response);
        let multiplier = (along - allowed) / mobility;
        if !(multiplier > 0.0 && multiplier.is_finite()) {
            return;
        }
        row.iter_mut().for_each(|row| *row *= -multiplier);
        let share = largest_share(tau, row, &robot.limits().torque).unwrap_or(1.0);
        tau.iter_mut().zip(row).for_each(|(tau, row)| *tau += share * *row);
    }
}
