//! One scale for metres and radians.
//!
//! A task of a pose has lengths and angles among its coordinates. Wherever a norm, an eigenvalue or a weight puts them
//! together, an angle counts as the arc that it makes at the characteristic length of the controller, and
//! S = diag(1, …, L, …) turns a task velocity into metres per second (docs/theory.md, section 9).

use nalgebra::{SMatrix, SVector};

/// S for a task of dimension `M`.
///
/// ```
/// use nalgebra::Vector3;
/// use vff_core::control::TaskMetric;
///
/// // In the plane an angle counts as its arc at 0.5 m.
/// let metric = TaskMetric::<3>::new::<2>(0.5);
/// assert_eq!(metric.norm(&Vector3::new(0.3, 0.0, 0.8)), 0.5);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaskMetric<const M: usize> {
    scale: SVector<f64, M>,
}

impl<const M: usize> TaskMetric<M> {
    /// With `length` \[m\] > 0 in a space of dimension `D`, whose task coordinates from the `D`-th on are angles.
    pub fn new<const D: usize>(length: f64) -> Self {
        Self { scale: SVector::from_fn(|i, _| if i < D { 1.0 } else { length }) }
    }

    /// S v \[m, or that per s or s²\].
    #[inline]
    pub fn apply(&self, v: &SVector<f64, M>) -> SVector<f64, M> {
        v.component_mul(&self.scale)
    }

    /// ‖S v‖ \[m, or that per s or s²\].
    #[inline]
    pub fn norm(&self, v: &SVector<f64, M>) -> f64 {
        v.component_mul(&self.scale).norm()
    }

    /// tr S⁻¹ A S⁻¹ of an inertia A: that of `A` with every angle as an arc.
    #[inline]
    pub fn trace(&self, inertia: &SMatrix<f64, M, M>) -> f64 {
        let part = |i| inertia[(i, i)] / (self.scale[i] * self.scale[i]);
        (0..M).fold(0.0, |sum, i| sum + part(i))
    }

    /// S A S, which makes an inverse inertia of coordinates one of metres alone, and back again its pseudoinverse.
    pub fn scaled(&self, a: &SMatrix<f64, M, M>) -> SMatrix<f64, M, M> {
        SMatrix::from_fn(|i, j| self.scale[i] * a[(i, j)] * self.scale[j])
    }

    /// S², which weighs a squared velocity of the task.
    pub fn weight(&self) -> SMatrix<f64, M, M> {
        SMatrix::from_diagonal(&self.scale.component_mul(&self.scale))
    }

    /// S⁻².
    pub fn inverse_weight(&self) -> SMatrix<f64, M, M> {
        SMatrix::from_diagonal(&self.scale.map(|s| 1.0 / (s * s)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A planar pose has one angle, a position none: in the plane and in space.
    #[test]
    fn angles_follow_the_lengths() {
        let pose = TaskMetric::<3>::new::<2>(0.5);
        assert!((pose.norm(&SVector::from([3.0, 0.0, 8.0])) - 5.0).abs() < 1e-15);
        let position = TaskMetric::<3>::new::<3>(0.5);
        assert!((position.norm(&SVector::from([2.0, 3.0, 6.0])) - 7.0).abs() < 1e-15);
        let spatial = TaskMetric::<6>::new::<3>(0.5);
        let v = SVector::from([1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
        assert!((spatial.norm(&v) - 6f64.sqrt()).abs() < 1e-15);
    }
}
