//! `relaxed`: near an obstacle the task is released, and the field pushes the end effector, too (T63, T64).

use super::{Situation, Way};
use crate::control::{Gains, TaskMetric, Torque, Yielding};
use crate::math::{Vector, smoothstep};
use crate::robot::Robot;

/// How far the task is released, and how hard it pulls.
#[derive(Debug, Clone)]
pub struct Relaxed<const M: usize> {
    settings: Yielding,
    metric: TaskMetric<M>,
    /// Whether the last link is to touch something, and releases nothing by being near.
    presses: bool,
}

impl<const M: usize> Relaxed<M> {
    /// As `gains` have it, in a space of dimension `D`.
    pub fn new<const D: usize>(gains: &Gains<M>) -> Self {
        Self {
            settings: gains.yielding.clone(),
            metric: gains.metric::<D>(),
            presses: gains.touch.force.is_some(),
        }
    }

    /// λ: 1 while nothing is near, 0 where the nearest obstacle is within `inner` (T63).
    fn activation(&self, clearance: &[f64]) -> f64 {
        let links = clearance.len() - usize::from(self.presses);
        let nearest = clearance[..links].iter().copied().fold(f64::INFINITY, f64::min);
        let Yielding { inner, outer, .. } = self.settings;
        smoothstep((nearest - inner) / (outer - inner))
    }
}

impl<const D: usize, const M: usize> Way<D, M> for Relaxed<M> {
    /// λ sat(e): a large error, left over from giving way, pulls no harder than `saturation`. Away from obstacles (λ = 1, and a
    /// small error) it is the error itself.
    fn pull(&self, clearance: &[f64], e: Vector<M>) -> Vector<M> {
        let (lambda, most) = (self.activation(clearance), self.settings.saturation);
        e * (lambda * (most / self.metric.norm(&e).max(most)))
    }

    /// τ += (1 − λ) JᵀJ#ᵀτ_vff: the part of the push that the projector takes away (T64).
    fn act<R: Robot<D>>(&mut self, situation: &Situation<'_, R, D, M>, torque: &mut Torque) {
        let Situation { robot, space, forces, .. } = *situation;
        let released = 1.0 - self.activation(forces.clearance());
        if released > 0.0 {
            let force = space.pinv_tr_mul(forces.torque()) * released;
            torque.add_to_task(|i| robot.jacobian_column::<M>(i).dot(&force));
        }
    }
}
