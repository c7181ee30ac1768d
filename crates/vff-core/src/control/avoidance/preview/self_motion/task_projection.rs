//! Onto the configurations that hold a pose, and along them (T172).

use crate::control::metric::TaskMetric;
use crate::interrupt;
use crate::math::{Pose, Vector};
use crate::robot::Manipulator;
use nalgebra::{Cholesky, Const, SMatrix};

/// How near the task is kept \[m\], angles times the characteristic length.
const PRECISION: f64 = 1e-10;
/// Newton steps; each squares the error.
const STEPS: usize = 6;
/// A pivot of J S²Jᵀ below this share of its mean diagonal counts as a singularity.
const SINGULAR: f64 = 1e-3;

/// Newton's method on the task, with its workspace.
#[derive(Debug, Clone)]
pub struct TaskProjection<const M: usize> {
    metric: TaskMetric<M>,
    columns: Vec<Vector<M>>,
    along: Vec<f64>,
}

impl<const M: usize> TaskProjection<M> {
    /// For `n` joints, with errors measured by `metric`.
    pub fn new(n: usize, metric: TaskMetric<M>) -> Self {
        Self { metric, columns: vec![Vector::zeros(); n], along: vec![0.0; n] }
    }

    /// Takes in S J where `robot` is, and factorises S J Jᵀ S; none where that is singular.
    fn factorise<R: Manipulator<D, M>, const D: usize>(
        &mut self,
        robot: &R,
    ) -> Option<Cholesky<f64, Const<M>>> {
        interrupt::checkpoint(self.columns.len() * (16 + M * M));
        let mut gram = SMatrix::<f64, M, M>::zeros();
        for (i, column) in self.columns.iter_mut().enumerate() {
            *column = self.metric.apply(&robot.jacobian_column(i));
            gram += *column * column.transpose();
        }
        #[expect(clippy::cast_precision_loss, reason = "a small dimension")]
        let least = SINGULAR * gram.trace() / M as f64;
        let factor = gram.cholesky()?;
        let is_regular = (0..M).all(|i| factor.l_dirty()[(i, i)].powi(2) > least);
        is_regular.then_some(factor)
    }

    /// Moves `q` by the shortest way to where `robot` takes `pose`, and `robot` with it. Whether it gets there.
    pub fn project<R: Manipulator<D, M>, const D: usize>(
        &mut self,
        robot: &mut R,
        q: &mut [f64],
        pose: &R::Pose,
    ) -> bool {
        for _ in 0..STEPS {
            robot.update_positions(q);
            let error = self.metric.apply(&robot.pose().error(pose));
            if error.norm() <= PRECISION {
                return true;
            }
            let Some(factor) = self.factorise(robot) else { return false };
            let pull = factor.solve(&error);
            q.iter_mut().zip(&self.columns).for_each(|(q, column)| *q -= column.dot(&pull));
        }
        robot.update_positions(q);
        self.metric.norm(&robot.pose().error(pose)) <= PRECISION
    }

    /// Makes of `direction` the unit vector along the self-motion of `robot` where it is that is nearest to it. Whether there is one.
    pub fn align<R: Manipulator<D, M>, const D: usize>(
        &mut self,
        robot: &R,
        direction: &mut [f64],
    ) -> bool {
        let Some(factor) = self.factorise(robot) else { return false };
        let Self { columns, .. } = self;
        let seen =
            columns.iter().zip(&*direction).fold(Vector::zeros(), |sum, (c, d)| sum + c * *d);
        let pull = factor.solve(&seen);
        direction.iter_mut().zip(columns).for_each(|(d, column)| *d -= column.dot(&pull));
        let size = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
        direction.iter_mut().for_each(|d| *d /= size);
        // Of a direction across the self-motion nothing but rounding is left.
        size > 1e-6
    }

    /// Writes the unit vector along the self-motion of `robot` where it is, in one of its two directions. Whether there is one.
    pub fn direction<R: Manipulator<D, M>, const D: usize>(
        &mut self,
        robot: &R,
        direction: &mut [f64],
    ) -> bool {
        let mut along = std::mem::take(&mut self.along);
        let mut longest = 0.0;
        for i in 0..direction.len() {
            along.fill(0.0);
            along[i] = 1.0;
            // What is left of an axis is the square of its share in the unit vector, which is there on the axis itself.
            if self.align(robot, &mut along) && along[i].abs() > longest {
                longest = along[i].abs();
                direction.copy_from_slice(&along);
            }
        }
        self.along = along;
        longest > 0.0
    }
}
