//! The paper's explicit form: extended Jacobian, null-space basis and all (its eq. 6–23, corrected;
//! docs/theory.md, T5–T8 and T13).
//!
//! ```text
//! ν = N_M q̇            N_M = (ZᵀMZ)⁻¹ZᵀM                                    (eq. 6–8)
//! ẋ_e = [ẋ; ν] = J_e q̇,   J_e = [J; N_M],   J_e⁻¹ = [J#, Z]                     (eq. 9–12)
//! J_e⁻ᵀ(τ − g) = E_e ẍ_e + μ ẋ_e                                              (eq. 13–15)
//! E_e = blockdiag(Λ, Λ_n),   μ = J_e⁻ᵀ(C − M J_e⁻¹ J̇_e) J_e⁻¹
//! ```
//!
//! It computes the same torque as [`super::law`] from dense matrices and a basis Z, and shares no
//! code with it: each is the other's oracle. It is also what a user inspects.

use super::{Gains, Law, OperationalSpace, Projection};
use crate::interrupt;
use crate::robot::{Matrices, Robot};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SVector};

/// How many (n, n) matrices there are at once while it is built, those of the robot among them.
pub const MATRICES: usize = 24;

/// The extended Jacobian of a robot at one state, with n joints and r = n − M.
///
/// # Example
/// ```
/// use vff_core::control::extended_jacobian::ExtendedJacobian;
/// use vff_core::math::Vector;
/// use vff_core::robot::{PlanarArm, dense, planar::Link};
///
/// let arm = PlanarArm::new(vec![Link::rod(0.5, 1.0); 3], Vector::<2>::zeros());
/// let matrices = dense::planar::<2>(&arm, &[0.4, 0.5, -0.6], &[0.0; 3]);
/// let extended = ExtendedJacobian::new(&matrices).unwrap(); // None where the arm is singular
/// assert_eq!(extended.z.ncols(), 1); // one null dimension
/// assert!((&matrices.jacobian * &extended.z).norm() < 1e-12);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ExtendedJacobian {
    /// Orthonormal basis of the null space of J, (n, r).
    pub z: DMatrix<f64>,
    /// N_M = (ZᵀMZ)⁻¹ZᵀM, (r, n).
    pub n_m: DMatrix<f64>,
    /// J_e = \[J; N_M\], (n, n).
    pub j_e: DMatrix<f64>,
    /// J_e⁻¹ = \[J#, Z\], (n, n).
    pub j_e_inv: DMatrix<f64>,
    /// E_e = blockdiag(Λ, Λ_n), (n, n).
    pub e_e: DMatrix<f64>,
    /// μ, (n, n): Ė_e − 2μ is skew.
    pub mu: DMatrix<f64>,
    /// Λ, (M, M).
    pub lambda_x: DMatrix<f64>,
    /// Λ_n = ZᵀMZ, (r, r).
    pub lambda_n: DMatrix<f64>,
}

impl ExtendedJacobian {
    /// Builds every matrix from the robot's. `None` where J has not full rank or n < M: there the
    /// extended Jacobian does not exist.
    pub fn new<const M: usize>(robot: &Matrices<M>) -> Option<Self> {
        let z = null_space_basis(robot)?;
        Self::with_basis(robot, z)
    }

    /// As [`new`](Self::new), with another orthonormal basis Z of the null space, (n, r).
    pub fn with_basis<const M: usize>(robot: &Matrices<M>, z: DMatrix<f64>) -> Option<Self> {
        let Matrices { mass, coriolis, .. } = robot;
        let n = mass.nrows();
        let r = n - M;
        let j = DMatrix::from_fn(M, n, |i, k| robot.jacobian[(i, k)]);
        let j_dot = DMatrix::from_fn(M, n, |i, k| robot.jacobian_dot[(i, k)]);

        // Λ, J# and the null inertia.
        let mass_factor = factor(mass)?;
        let y = solve(&mass_factor, j.transpose());
        let lambda_x = (&j * &y).try_inverse()?;
        let pinv = &y * &lambda_x;
        let z_t = z.transpose();
        let z_t_mass = mul(&z_t, mass);
        let lambda_n = mul(&z_t_mass, &z);
        let null_factor = factor(&lambda_n)?;
        let n_m = solve(&null_factor, z_t_mass.clone());

        let j_e = stack(&j, &n_m);
        let mut j_e_inv = DMatrix::zeros(n, n);
        j_e_inv.columns_mut(0, M).copy_from(&pinv);
        j_e_inv.columns_mut(M, r).copy_from(&z);
        let mut e_e = DMatrix::zeros(n, n);
        e_e.view_mut((0, 0), (M, M)).copy_from(&lambda_x);
        e_e.view_mut((M, M), (r, r)).copy_from(&lambda_n);

        // Ż = −J⁺J̇Z keeps JZ = 0; Ṁ = C + Cᵀ; from both, Ṅ_M.
        let j_pinv = j.transpose() * (&j * j.transpose()).try_inverse()?;
        let z_dot_t = (-mul(&mul(&j_pinv, &j_dot), &z)).transpose();
        let mass_dot = coriolis + coriolis.transpose();
        let moved = mul(&z_dot_t, mass) + mul(&z_t, &mass_dot);
        let lambda_n_dot = mul(&moved, &z) + mul(&z_t_mass, &z_dot_t.transpose());
        let n_m_dot = solve(&null_factor, moved - mul(&lambda_n_dot, &n_m));

        let j_e_dot = stack(&j_dot, &n_m_dot);
        let inner = coriolis - mul(&mul(mass, &j_e_inv), &j_e_dot);
        let mu = mul(&mul(&j_e_inv.transpose(), &inner), &j_e_inv);
        Some(Self { z, n_m, j_e, j_e_inv, e_e, mu, lambda_x, lambda_n })
    }

    /// The dynamically consistent null projector N = Z N_M, (n, n).
    pub fn null_projector(&self) -> DMatrix<f64> {
        mul(&self.z, &self.n_m)
    }
}

/// An orthonormal basis of the null space of J: the last n − M columns of the orthogonal factor of
/// Jᵀ. `None` for n < M or rank-deficient J.
fn null_space_basis<const M: usize>(robot: &Matrices<M>) -> Option<DMatrix<f64>> {
    let n = robot.jacobian.ncols();
    if n < M {
        return None;
    }
    let j_t = DMatrix::from_fn(n, M, |k, i| robot.jacobian[(i, k)]);
    let qr = j_t.qr();
    let r = qr.r();
    let diagonal = r.diagonal().map(f64::abs);
    if diagonal.min() <= 1e-14 * diagonal.max() {
        return None;
    }
    let mut q_t = DMatrix::identity(n, n);
    qr.q_tr_mul(&mut q_t);
    Some(q_t.rows(M, n - M).transpose())
}

/// Columns that are worked on between two looks at the clock: those of a small matrix are worked on at once.
fn columns(rows: usize) -> usize {
    const WORK: usize = 1 << 22;
    (WORK / (rows * rows).max(1)).max(4)
}

/// a·b, interruptible.
fn mul(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let width = columns(a.nrows().max(a.ncols()));
    if b.ncols() <= width {
        return a * b;
    }
    let mut out = DMatrix::zeros(a.nrows(), b.ncols());
    for start in (0..b.ncols()).step_by(width) {
        let width = width.min(b.ncols() - start);
        interrupt::checkpoint(a.len() * width);
        a.mul_to(&b.columns(start, width), &mut out.columns_mut(start, width));
    }
    out
}

/// The Cholesky factor of a symmetric matrix, interruptible; none if it is not positive definite.
fn factor(matrix: &DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let n = matrix.nrows();
    if n <= columns(n) {
        return matrix.clone().cholesky();
    }
    let mut l = matrix.clone();
    for k in 0..n {
        interrupt::checkpoint((n - k) * k + n);
        let (done, mut rest) = l.columns_range_pair_mut(0..k, k..n);
        let mut column = rest.rows_mut(k, n - k);
        let mut column = column.column_mut(0);
        let below = done.rows(k, n - k);
        column.gemv(-1.0, &below, &done.row(k).transpose(), 1.0);
        let pivot = column[0];
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        column /= pivot.sqrt();
    }
    Some(Cholesky::pack_dirty(l))
}

/// The solution for every column of `b`, interruptible.
fn solve(factor: &Cholesky<f64, Dyn>, mut b: DMatrix<f64>) -> DMatrix<f64> {
    let (n, count) = b.shape();
    let width = columns(n);
    for start in (0..count).step_by(width) {
        let width = width.min(count - start);
        interrupt::checkpoint(n * n * width);
        factor.solve_mut(&mut b.columns_mut(start, width));
    }
    b
}

/// `upper` on top of `lower`.
fn stack(upper: &DMatrix<f64>, lower: &DMatrix<f64>) -> DMatrix<f64> {
    let (m, r) = (upper.nrows(), lower.nrows());
    let mut out = DMatrix::zeros(m + r, upper.ncols());
    out.rows_mut(0, m).copy_from(upper);
    out.rows_mut(m, r).copy_from(lower);
    out
}

/// The torque of the explicit form (T13), written into `law`:
///
/// ```text
/// J_e⁻ᵀ(τ − g) = [ Λ ẍ_c + μ_xx ẋ + μ_xn ν ;  μ_nx ẋ + Zᵀ(τ_sec − D_q Z ν) ]
/// ```
///
/// Where the extended Jacobian does not exist (rank-deficient J), the recursive law takes over.
pub fn evaluate<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    space: &OperationalSpace<M>,
    gains: &Gains<M>,
    ddx_c: &SVector<f64, M>,
    tau_sec: &[f64],
    law: &mut Law,
) {
    let matrices = robot.matrices::<M>();
    let extended = if space.singular { None } else { ExtendedJacobian::new(&matrices) };
    let Some(extended) = extended else {
        law.evaluate(robot, space, gains, ddx_c, tau_sec);
        return;
    };
    let ExtendedJacobian { z, n_m, j_e, mu, lambda_x, .. } = &extended;
    let r = z.ncols();
    let n = robot.dof();
    let root = |i| (gains.null_damping.get(i) + law.brake).sqrt();
    let root_d = DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| root(i)));
    let damping = &root_d * &matrices.mass * &root_d; // D_q = √d M √d
    let tau_sec = DVector::from_column_slice(tau_sec);

    let dx_e = j_e * &matrices.velocity; // [ẋ; ν]
    let nu = dx_e.rows(M, r).into_owned();
    let coupling = mu.rows(0, M) * &dx_e; // μ_xx ẋ + μ_xn ν
    let task_force = lambda_x * DVector::from_column_slice(ddx_c.as_slice()) + coupling;
    let null_damping = &damping * z * &nu;
    let secondary = &tau_sec - &null_damping;
    let mu_nx_dx = mu.view((M, 0), (r, M)) * dx_e.rows(0, M);

    let jacobian_t = j_e.rows(0, M).transpose();
    let tau_task = &matrices.gravity + jacobian_t * task_force;
    // μ_nx ẋ is an r-vector; N_Mᵀ carries it to the joints in every variant.
    let tau_null = match gains.projection {
        Projection::Dynamic => n_m.transpose() * (z.transpose() * secondary + mu_nx_dx),
        Projection::Kinematic => {
            z * (z.transpose() * (secondary + coupling_torque(&extended, &matrices, &dx_e)))
        }
        Projection::None => secondary + coupling_torque(&extended, &matrices, &dx_e),
    };
    law.null_energy = 0.5 * nu.dot(&(&extended.lambda_n * &nu));
    law.damping_power = (z * &nu).dot(&null_damping);
    let bias = &matrices.coriolis * &matrices.velocity + &matrices.gravity;
    law.bias.copy_from_slice(bias.as_slice());
    law.torque.task.copy_from_slice(tau_task.as_slice());
    law.torque.null.copy_from_slice(tau_null.as_slice());
    law.torque.total.copy_from_slice((tau_task + tau_null).as_slice());
}

/// −Sᵀẋ with S = J#ᵀC − ΛJ̇, the coupling before projection; only the comparison projectors need
/// it in joint space.
fn coupling_torque<const M: usize>(
    extended: &ExtendedJacobian,
    robot: &Matrices<M>,
    dx_e: &DVector<f64>,
) -> DVector<f64> {
    let dx = dx_e.rows(0, M);
    let pinv = extended.j_e_inv.columns(0, M);
    let j_dot_t = robot.jacobian_dot.transpose();
    let momentum = SVector::<f64, M>::from_column_slice((&extended.lambda_x * dx).as_slice());
    j_dot_t * momentum - robot.coriolis.transpose() * (pinv * dx)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In pieces as at once, also where the pieces are many.
    #[test]
    fn large_matrices_are_worked_on_in_pieces() {
        let n = 300;
        assert!(n > columns(n) && columns(6) > 6);
        let wave = |i: usize, k: usize| ((7 * i + 3 * k * k) as f64).sin();
        let a = DMatrix::from_fn(n, n, wave);
        let matrix = &a * a.transpose() + DMatrix::identity(n, n);
        assert!((mul(&a, &matrix) - &a * &matrix).norm() < 1e-9 * matrix.norm() * a.norm());
        let whole = matrix.clone().cholesky().unwrap();
        let pieces = factor(&matrix).unwrap();
        assert!((pieces.l() - whole.l()).norm() < 1e-10 * whole.l().norm());
        assert!((solve(&pieces, a.clone()) - whole.solve(&a)).norm() < 1e-8 * a.norm());
        assert!(factor(&-matrix).is_none());
    }
}
