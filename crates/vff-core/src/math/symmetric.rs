//! Small symmetric matrices: inverse, determinant, eigenvalues.
//!
//! nalgebra's own need bounds that a generic `M` cannot state, or make no use of the symmetry.

use nalgebra::{SMatrix, SVector};

/// The inverse of a symmetric positive definite matrix; None where it is found not to be one.
#[inline]
pub fn inverse<const M: usize>(a: &SMatrix<f64, M, M>) -> Option<SMatrix<f64, M, M>> {
    let mut inverse = *a;
    invert(&mut inverse).then_some(inverse)
}

/// The same in its place, where something else is left if it is found not to be one: whether it was inverted.
///
/// Closed forms up to three rows; beyond, Gauss–Jordan elimination, which needs no pivoting here and is as
/// accurate as Cholesky's factorisation (Peters and Wilkinson, 1975).
#[inline]
pub fn invert<const M: usize>(a: &mut SMatrix<f64, M, M>) -> bool {
    if M < 4 {
        let inverse = a.try_inverse();
        *a = inverse.unwrap_or(*a);
        return inverse.is_some();
    }
    for k in 0..M {
        let pivot = a[(k, k)];
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        // Symmetric after every sweep; after the last it is −A⁻¹.
        let (scale, column) = (1.0 / pivot, SVector::<f64, M>::from(a.column(k)));
        let scaled = column * scale;
        for j in 0..M {
            for i in 0..M {
                a[(i, j)] -= scaled[i] * column[j];
            }
        }
        for i in 0..M {
            (a[(i, k)], a[(k, i)]) = (scaled[i], scaled[i]);
        }
        a[(k, k)] = -scale;
    }
    a.neg_mut();
    true
}

/// The determinant of a symmetric positive semidefinite matrix, by elimination.
pub fn determinant<const M: usize>(mut a: SMatrix<f64, M, M>) -> f64 {
    let mut product = 1.0;
    for k in 0..M {
        let pivot = a[(k, k)];
        product *= pivot;
        if pivot <= 0.0 {
            return 0.0;
        }
        for i in k + 1..M {
            let factor = a[(i, k)] / pivot;
            for j in k + 1..M {
                a[(i, j)] -= factor * a[(k, j)];
            }
        }
    }
    product
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix by cyclic Jacobi rotations.
pub fn eigen<const M: usize>(mut a: SMatrix<f64, M, M>) -> (SVector<f64, M>, SMatrix<f64, M, M>) {
    let mut v = SMatrix::<f64, M, M>::identity();
    for _ in 0..16 {
        for p in 0..M {
            for q in p + 1..M {
                if a[(p, q)].abs() <= f64::EPSILON * f64::EPSILON * a.trace().abs() {
                    continue;
                }
                let theta = (a[(q, q)] - a[(p, p)]) / (2.0 * a[(p, q)]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for k in 0..M {
                    let (x, y) = (a[(p, k)], a[(q, k)]);
                    (a[(p, k)], a[(q, k)]) = (c * x - s * y, s * x + c * y);
                }
                for m in [&mut a, &mut v] {
                    for k in 0..M {
                        let (x, y) = (m[(k, p)], m[(k, q)]);
                        (m[(k, p)], m[(k, q)]) = (x * c - y * s, x * s + y * c);
                    }
                }
            }
        }
    }
    (a.diagonal(), v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Matrix6};

    /// A = V diag(σ) Vᵀ with orthonormal V, also with repeated and zero eigenvalues.
    #[test]
    fn jacobi_diagonalises() {
        for a in [
            Matrix3::new(2.0, 0.3, -0.1, 0.3, 1.0, 0.7, -0.1, 0.7, 3.0),
            Matrix3::new(1.0, 2.0, 3.0, 2.0, 4.0, 6.0, 3.0, 6.0, 9.0),
            Matrix3::identity() * 2.0,
        ] {
            let (values, v) = eigen(a);
            let back = v * Matrix3::from_diagonal(&values) * v.transpose();
            assert!((back - a).norm() < 1e-14 * a.norm());
            assert!((v.transpose() * v - Matrix3::identity()).norm() < 1e-14);
        }
    }

    /// A A⁻¹ = 1 as well as the condition of A allows, from well to badly conditioned; the determinant is the
    /// product of the eigenvalues.
    #[test]
    fn inverse_and_determinant() {
        for spread in [0.0, 1.0, 4.0, 8.0] {
            let mixed = Matrix6::from_fn(|i, j| f64::sin(1.0 + 2.3 * i as f64 + 5.1 * j as f64));
            let (_, v) = eigen(mixed * mixed.transpose());
            let values =
                SVector::<f64, 6>::from_fn(|i, _| 3.0 * 10.0_f64.powf(-spread * i as f64 / 5.0));
            let a = v * Matrix6::from_diagonal(&values) * v.transpose();
            let inverse = inverse(&a).unwrap();
            let condition = 10.0_f64.powf(spread);
            assert!((a * inverse - Matrix6::identity()).norm() < 2e-15 * condition);
            let product: f64 = values.iter().product();
            assert!((determinant(a) / product - 1.0).abs() < 1e-14 * condition);
        }
    }

    /// What is not positive definite has no inverse here.
    #[test]
    fn indefinite_matrices_are_refused() {
        let mut a = Matrix6::identity();
        a[(3, 3)] = -1.0;
        assert!(inverse(&a).is_none());
        a[(3, 3)] = f64::NAN;
        assert!(inverse(&a).is_none());
        assert!(inverse(&Matrix6::<f64>::zeros()).is_none());
    }
}
