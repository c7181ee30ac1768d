//! The same robot as matrices, for people, for the explicit form of the law and for tests.
//!
//! Textbook formulas over the Jacobians of the centres of mass (Murray, Li and Sastry, 1994,
//! ch. 4): nothing here shares code with the recursions of [`super::planar`], so each checks the
//! other. Cost O(n³), allocates.

use super::{Model, PlanarArm};
use crate::interrupt;
use crate::math::{Vector, perp};
use nalgebra::{DMatrix, DVector, Dyn, OMatrix};

/// A matrix of `M` rows and one column per joint.
pub type TaskMatrix<const M: usize> = OMatrix<f64, nalgebra::Const<M>, Dyn>;

/// The matrices of a robot at one state (q, q̇), task dimension `M`.
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::robot::dense::{TaskMatrix, planar};
/// use vff_core::robot::{Matrices, PlanarArm, planar::Link};
///
/// let arm = PlanarArm::new(vec![Link::rod(1.0, 1.0); 2], Vector::<2>::new(0.0, -9.81));
/// let Matrices { mass, jacobian, .. } = planar::<2>(&arm, &[0.3, -0.5], &[0.0; 2]);
/// let jacobian: TaskMatrix<2> = jacobian;
/// assert_eq!((mass.nrows(), jacobian.ncols()), (2, 2));
/// assert_eq!(mass, mass.transpose());
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Matrices<const M: usize> {
    /// Mass matrix M, (n, n).
    pub mass: DMatrix<f64>,
    /// Christoffel matrix C, (n, n): Ṁ = C + Cᵀ.
    pub coriolis: DMatrix<f64>,
    /// Gravity torque g, (n).
    pub gravity: DVector<f64>,
    /// Jacobian J of the task, (M, n).
    pub jacobian: TaskMatrix<M>,
    /// Its time derivative J̇, (M, n).
    pub jacobian_dot: TaskMatrix<M>,
    /// Joint velocity q̇, (n).
    pub velocity: DVector<f64>,
}

/// The matrices of a planar arm at (q \[rad\], q̇ \[rad/s\]).
///
/// M = Σ m JᵀJ + I ωᵀω and C = Σ m JᵀJ̇ over the centres of mass; the latter is the Christoffel
/// matrix because in the plane ω does not depend on q.
pub fn planar<const M: usize>(arm: &PlanarArm, q: &[f64], dq: &[f64]) -> Matrices<M> {
    let n = arm.dof();
    let mut joints = vec![Vector::<2>::zeros(); n + 1];
    let mut rates = vec![Vector::<2>::zeros(); n + 1];
    let mut centres = vec![Vector::<2>::zeros(); n];
    let mut centre_rates = vec![Vector::<2>::zeros(); n];
    let (mut angle, mut w) = (0.0, 0.0);
    for (i, link) in arm.links().iter().enumerate() {
        angle += q[i];
        w += dq[i];
        let x = Vector::<2>::new(f64::cos(angle), f64::sin(angle));
        let com = x * link.com.x + perp(x) * link.com.y;
        centres[i] = joints[i] + com;
        centre_rates[i] = rates[i] + perp(com) * w;
        joints[i + 1] = joints[i] + x * link.length;
        rates[i + 1] = rates[i] + perp(x) * (link.length * w);
    }

    let mut mass = DMatrix::zeros(n, n);
    let mut coriolis = DMatrix::zeros(n, n);
    let mut gravity = DVector::zeros(n);
    for (i, link) in arm.links().iter().enumerate() {
        let column = |k: usize| perp(centres[i] - joints[k]);
        let column_dot = |k: usize| perp(centre_rates[i] - rates[k]);
        for k in 0..=i {
            interrupt::checkpoint(8 * i);
            for j in 0..=i {
                mass[(k, j)] += link.mass * column(k).dot(&column(j)) + link.inertia;
                coriolis[(k, j)] += link.mass * column(k).dot(&column_dot(j));
            }
            gravity[k] -= link.mass * column(k).dot(&arm.gravity());
        }
    }
    let tip = |row: usize, v: Vector<2>, angular| if row < 2 { v[row] } else { angular };
    Matrices {
        mass,
        coriolis,
        gravity,
        jacobian: TaskMatrix::<M>::from_fn(n, |row, k| tip(row, perp(joints[n] - joints[k]), 1.0)),
        jacobian_dot: TaskMatrix::<M>::from_fn(n, |row, k| {
            tip(row, perp(rates[n] - rates[k]), 0.0)
        }),
        velocity: DVector::from_column_slice(dq),
    }
}
