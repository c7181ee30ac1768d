//! Inertia tensors: which are possible, and the nearest possible one.

use nalgebra::{Isometry3, Matrix3, SymmetricEigen, Vector3};

/// An inertia tensor that no distribution of mass has.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "no distribution of mass has this inertia tensor: its principal moments {a:.6e}, {b:.6e}, {c:.6e} \
     kg·m² break the triangle inequality {a:.3e} + {b:.3e} ≥ {c:.3e} by {excess:.3e} kg·m²"
)]
pub struct Impossible {
    /// The smallest principal moment \[kg·m²\].
    pub a: f64,
    /// The one between \[kg·m²\].
    pub b: f64,
    /// The largest \[kg·m²\].
    pub c: f64,
    /// c − a − b \[kg·m²\].
    pub excess: f64,
}

/// The matrix of `[xx, yy, zz, xy, xz, yz]`.
pub fn tensor(&[xx, yy, zz, xy, xz, yz]: &[f64; 6]) -> Matrix3<f64> {
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

/// The six numbers of a symmetric matrix.
pub fn six(m: &Matrix3<f64>) -> [f64; 6] {
    [m[(0, 0)], m[(1, 1)], m[(2, 2)], m[(0, 1)], m[(0, 2)], m[(1, 2)]]
}

/// Checks `[xx, yy, zz, xy, xz, yz]` of a body.
///
/// What rounding to six digits explains is allowed, as is what a body of this mass and 30 µm would have.
///
/// # Errors
/// With the triangle inequality that is broken.
pub fn check(inertia: &[f64; 6], mass: f64) -> Result<(), Impossible> {
    let mut moments: [f64; 3] = tensor(inertia).symmetric_eigenvalues().into();
    moments.sort_by(f64::total_cmp);
    let [a, b, c] = moments;
    let excess = c - a - b;
    if excess > 1e-6 * c.abs() + 1e-9 * mass {
        return Err(Impossible { a, b, c, excess });
    }
    Ok(())
}

/// What a second moment of mass is at least, as a share of them all: so that rounding does not make it negative again.
const LEAST_MOMENT: f64 = 1e-9;

/// The nearest possible tensor: Σ = ½tr(J)1 − J, the second moments of mass, with its negative eigenvalues put to 0, which is nearest in Σ's
/// Frobenius norm, and as little above that as rounding asks for.
pub fn repair(inertia: &[f64; 6]) -> [f64; 6] {
    let j = tensor(inertia);
    let eigen = SymmetricEigen::new(Matrix3::identity() * (0.5 * j.trace()) - j);
    let all: f64 = eigen.eigenvalues.iter().map(|x| x.max(0.0)).sum();
    let moments = eigen.eigenvalues.map(|x| x.max(LEAST_MOMENT * all));
    let q = eigen.eigenvectors;
    let sigma = q * Matrix3::from_diagonal(&moments) * q.transpose();
    six(&(Matrix3::identity() * sigma.trace() - sigma))
}

/// Mass, centre of mass and inertia about it of bodies that move as one.
///
/// # Example
/// ```
/// use nalgebra::{Isometry3, Matrix3, Vector3};
/// use vff_core::robot::inertia::{Body, Impossible, check};
///
/// let ball = Body { mass: 1.0, com: Vector3::zeros(), inertia: Matrix3::identity() * 0.01 };
/// let pair = ball.joined(&ball.moved(&Isometry3::translation(0.2, 0.0, 0.0)));
/// assert_eq!(pair.mass, 2.0);
/// assert!((pair.com.x - 0.1).abs() < 1e-15);
/// let Impossible { excess, .. } = check(&[1.0, 1.0, 3.0, 0.0, 0.0, 0.0], 1.0).unwrap_err();
/// assert!((excess - 1.0).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// \[kg\].
    pub mass: f64,
    /// \[m\].
    pub com: Vector3<f64>,
    /// About the centre of mass \[kg·m²\].
    pub inertia: Matrix3<f64>,
}

impl Default for Body {
    fn default() -> Self {
        Self { mass: 0.0, com: Vector3::zeros(), inertia: Matrix3::zeros() }
    }
}

impl Body {
    /// The same body in a frame in which its own has this pose.
    #[must_use]
    pub fn moved(&self, pose: &Isometry3<f64>) -> Self {
        let r = pose.rotation.to_rotation_matrix();
        Self {
            mass: self.mass,
            com: (pose * nalgebra::Point3::from(self.com)).coords,
            inertia: r * self.inertia * r.transpose(),
        }
    }

    /// Both as one, by parallel axes.
    #[must_use]
    pub fn joined(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        let mut inertia = self.inertia + other.inertia;
        if mass <= 0.0 {
            return Self { mass, com: self.com, inertia };
        }
        let apart = other.com - self.com;
        let com = self.com + apart * (other.mass / mass);
        let reduced = self.mass * other.mass / mass;
        inertia +=
            reduced * (Matrix3::identity() * apart.norm_squared() - apart * apart.transpose());
        Self { mass, com, inertia }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_broken_inequality_is_named() {
        let fault = check(&[1.0, 2.0, 3.5, 0.0, 0.0, 0.0], 1.0).unwrap_err();
        assert!((fault.excess - 0.5).abs() < 1e-12, "{fault}");
        assert!(fault.to_string().contains("5.000e-1"), "{fault}");
        assert!(check(&[1.0, 2.0, 3.0, 0.0, 0.0, 0.0], 1.0).is_ok());
        assert!(check(&[-1.0, -1.0, -1.0, 0.0, 0.0, 0.0], 1.0).is_err());
    }

    #[test]
    fn repair_leaves_what_is_possible_and_mends_the_rest() {
        let fine = [0.02, 0.03, 0.04, 1e-3, -2e-3, 3e-3];
        for (a, b) in repair(&fine).iter().zip(fine) {
            assert!((a - b).abs() < 1e-15);
        }
        let mended = repair(&[0.01, 0.01, 0.1, 1e-3, 0.0, -2e-3]);
        assert!(check(&mended, 0.0).is_ok());
        for (a, b) in repair(&mended).iter().zip(mended) {
            assert!((a - b).abs() < 1e-15, "a projection does nothing the second time");
        }
    }

    #[test]
    fn two_halves_of_a_rod_are_the_rod() {
        let rod = |m: f64, l: f64, x: f64| Body {
            mass: m,
            com: Vector3::new(x, 0.0, 0.0),
            inertia: Matrix3::from_diagonal(&Vector3::new(0.0, 1.0, 1.0)) * (m * l * l / 12.0),
        };
        let whole = rod(1.0, 1.0, 0.25).joined(&rod(3.0, 3.0, 2.25));
        let expected = rod(4.0, 4.0, 1.75);
        assert!((whole.com - expected.com).norm() < 1e-15);
        assert!((whole.inertia - expected.inertia).norm() < 1e-14);
    }
}
