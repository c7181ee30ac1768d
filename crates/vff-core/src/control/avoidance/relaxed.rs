//! `relaxed`: near an obstacle the task is released, and the field pushes the end effector, too (T63, T64).

use super::Yielding;
use crate::control::{OperationalSpace, TaskMetric, Torque, VirtualForces};
use crate::math::{Vector, smoothstep};
use crate::robot::Robot;

/// λ: 1 while nothing is near, 0 where the nearest obstacle is within `inner` (T63).
pub fn activation(settings: &Yielding, clearance: &[f64]) -> f64 {
    let nearest = clearance.iter().copied().fold(f64::INFINITY, f64::min);
    smoothstep((nearest - settings.inner) / (settings.outer - settings.inner))
}

/// λ sat(e): a large error, left over from giving way, pulls no harder than `saturation`.
///
/// Away from obstacles (λ = 1, and a small error) it is the error itself.
pub fn pull<const M: usize>(
    settings: &Yielding,
    metric: &TaskMetric<M>,
    e: Vector<M>,
    lambda: f64,
) -> Vector<M> {
    e * (lambda * (settings.saturation / metric.norm(&e).max(settings.saturation)))
}

/// τ += (1 − λ) JᵀJ#ᵀτ_vff: the part of the push that the projector takes away (T64).
pub fn act<R: Robot<D>, const D: usize, const M: usize>(
    settings: &Yielding,
    robot: &R,
    space: &OperationalSpace<M>,
    forces: &VirtualForces<R::Wrench, D>,
    torque: &mut Torque,
) {
    let released = 1.0 - activation(settings, forces.clearance());
    if released > 0.0 {
        let force = space.pinv_tr_mul(forces.torque()) * released;
        torque.add_to_task(|i| robot.jacobian_column::<M>(i).dot(&force));
    }
}
