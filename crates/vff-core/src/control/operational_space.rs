//! The task's inertia and the null projector, without forming either as an n×n matrix.

use super::TaskMetric;
use crate::math::symmetric;
use crate::robot::Robot;
use nalgebra::{SMatrix, SVector};

/// Y = M⁻¹Jᵀ, Λ = (J Y)⁻¹ and ẋ at one state; J# = Y Λ and N = I − J#J act through them.
#[derive(Debug, Clone)]
pub struct OperationalSpace<const M: usize> {
    /// Y = M⁻¹Jᵀ, one row per joint.
    pub y: Vec<SVector<f64, M>>,
    /// Λ = (J M⁻¹ Jᵀ)⁻¹, the inertia seen at the end effector. Where the arm cannot move in some
    /// direction, the inverse on the directions that remain.
    pub lambda: SMatrix<f64, M, M>,
    /// Λ for the task force: as `lambda`, damped close to a singularity (T25), so that the
    /// force stays finite while the projector stays exact.
    pub lambda_damped: SMatrix<f64, M, M>,
    /// ẋ = J q̇.
    pub dx: SVector<f64, M>,
    /// Whether the damping was active.
    pub singular: bool,
    threshold: f64,
    pub(super) metric: TaskMetric<M>,
}

impl<const M: usize> OperationalSpace<M> {
    /// For `n` joints; damping starts when an eigenvalue of Λ⁻¹ falls below `threshold` \[1/kg\],
    /// with angles measured by `metric`.
    pub fn new(n: usize, threshold: f64, metric: TaskMetric<M>) -> Self {
        Self {
            y: vec![SVector::zeros(); n],
            lambda: SMatrix::zeros(),
            lambda_damped: SMatrix::zeros(),
            dx: SVector::zeros(),
            singular: false,
            threshold,
            metric,
        }
    }

    /// Moves `robot` to the state (q, q̇) and takes it over (T3).
    pub fn update<R: Robot<D>, const D: usize>(&mut self, robot: &mut R, q: &[f64], dq: &[f64]) {
        let lambda_inv = robot.update_with_response(q, dq, &mut self.y);
        self.take_over(robot, lambda_inv);
    }

    /// Takes over the state of `robot`.
    pub fn refresh<R: Robot<D>, const D: usize>(&mut self, robot: &R) {
        let lambda_inv = robot.task_response(&mut self.y);
        self.take_over(robot, lambda_inv);
    }

    fn take_over<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        lambda_inv: SMatrix<f64, M, M>,
    ) {
        self.dx = robot.task_velocity();
        // 1/tr Λ bounds the smallest eigenvalue of Λ⁻¹ from below: the usual case costs no more
        // than the inverse.
        self.lambda = lambda_inv;
        let is_regular = symmetric::invert(&mut self.lambda) && {
            let trace = self.metric.trace(&self.lambda);
            trace > 0.0 && trace * self.threshold < 1.0
        };
        self.singular = !is_regular;
        if is_regular {
            self.lambda_damped = self.lambda;
        } else {
            (self.lambda, self.lambda_damped) = self.near_singularity(lambda_inv);
        }
    }

    /// Per eigenvalue σ of Λ⁻¹: 1/σ for the projector as long as σ is distinguishable from zero,
    /// and σ/(σ² + λ²) for the task force with λ² = σ₀²(1 − σ²/σ₀²)² below the threshold σ₀.
    #[cold]
    fn near_singularity(
        &self,
        lambda_inv: SMatrix<f64, M, M>,
    ) -> (SMatrix<f64, M, M>, SMatrix<f64, M, M>) {
        let lambda_inv = self.metric.scaled(&lambda_inv);
        let (values, vectors) = symmetric::eigen(lambda_inv);
        let rank_floor = 1e-13 * lambda_inv.trace();
        let exact = values.map(|s| if s > rank_floor { 1.0 / s } else { 0.0 });
        let damped = values.map(|s| {
            let ratio = s / self.threshold;
            let fade = (1.0 - ratio * ratio).max(0.0);
            let lambda = if s < self.threshold { self.threshold * fade } else { 0.0 };
            s / (s * s + lambda * lambda).max(f64::MIN_POSITIVE)
        });
        let compose = |d: &SVector<f64, M>| {
            let d = SMatrix::from_fn(|i, j| if i == j { d[i] } else { 0.0 });
            self.metric.scaled(&(vectors * d * vectors.transpose()))
        };
        (compose(&exact), compose(&damped))
    }

    /// `J M⁻¹ y = Yᵀ y`, the end effector's acceleration per joint torque.
    #[inline]
    pub fn response(&self, torque: &[f64]) -> SVector<f64, M> {
        // Two sums side by side: one alone would wait for itself.
        let (rows, torques) = (self.y.as_chunks::<2>(), torque.as_chunks::<2>());
        let (mut even, mut odd) = (SVector::zeros(), SVector::zeros());
        for (row, t) in rows.0.iter().zip(torques.0) {
            even += row[0] * t[0];
            odd += row[1] * t[1];
        }
        for (row, t) in rows.1.iter().zip(torques.1) {
            even += row * *t;
        }
        even + odd
    }

    /// `J#ᵀ y = Λ Yᵀ y`, the task force of a joint torque.
    #[inline]
    pub fn pinv_tr_mul(&self, torque: &[f64]) -> SVector<f64, M> {
        self.lambda * self.response(torque)
    }

    /// `out = J# v = Y Λ v`, the least-kinetic-energy joint velocity of a task velocity.
    #[inline]
    pub fn pinv_mul(&self, v: &SVector<f64, M>, out: &mut [f64]) {
        self.response_mul(&(self.lambda * v), out);
    }

    /// `out = M⁻¹Jᵀ f = Y f`, the joint acceleration per task force.
    #[inline]
    pub fn response_mul(&self, force: &SVector<f64, M>, out: &mut [f64]) {
        for (row, out) in self.y.iter().zip(out) {
            *out = row.dot(force);
        }
    }
}

/// √det(J Jᵀ), Yoshikawa's manipulability \[m²; m² too with an orientation\]; 0 in a singularity.
pub fn manipulability<R: Robot<D>, const D: usize, const M: usize>(robot: &R) -> f64 {
    let mut gram = SMatrix::<f64, M, M>::zeros();
    for i in 0..robot.dof() {
        let column = robot.jacobian_column::<M>(i);
        gram += column * column.transpose();
    }
    symmetric::determinant(gram).max(0.0).sqrt()
}

/// What tests ask of it.
#[cfg(test)]
impl<const M: usize> OperationalSpace<M> {
    /// How far a state is from a singularity: the smallest eigenvalue of Λ⁻¹ over the largest, about.
    pub(crate) fn conditioning(&self) -> f64 {
        let inverse = self.lambda.try_inverse().map_or(f64::INFINITY, |inverse| inverse.norm());
        1.0 / (self.lambda.norm() * inverse)
    }

    /// What the projection may leave of an acceleration of the hand that it has `taken` away, by Λ, which is known to ε times its condition.
    pub(crate) fn rounding_of(&self, taken: f64) -> f64 {
        32.0 * f64::EPSILON / self.conditioning() * taken
    }
}
