//! Rotations in space: unit quaternions, rotation vectors, and the error of an orientation (T91).
//!
//! A rotation vector φ is a unit axis times an angle; `exp` and `log` go between it and the unit
//! quaternion (cos ½θ, sin ½θ · axis). All rotations act on vectors from the left.

use super::Vector;
use super::quintic::Coordinates;
use nalgebra::Matrix3;
use std::ops::Mul;

/// How far from 1 the norm of a given quaternion or axis may be, which is then normalised: digits that a file left out.
pub const UNIT_TOLERANCE: f64 = 0.01;

/// No rotation as \[w, x, y, z\], where an orientation is not given.
pub(crate) fn upright() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

/// A rotation in space as a quaternion w + x i + y j + z k of norm 1.
///
/// q and −q are the same rotation; [`to_array`](Self::to_array) writes the one with w ≥ 0.
///
/// ```
/// use std::f64::consts::FRAC_PI_2;
/// use vff_core::math::{UnitQuaternion, Vector};
///
/// let quarter = UnitQuaternion::exp(&Vector::<3>::new(0.0, 0.0, FRAC_PI_2));
/// let turned = quarter.rotate(&Vector::<3>::new(1.0, 0.0, 0.0));
/// assert!((turned - Vector::<3>::new(0.0, 1.0, 0.0)).norm() < 1e-15);
/// assert!((quarter.log().z - FRAC_PI_2).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitQuaternion {
    w: f64,
    v: Vector<3>,
}

/// Four numbers that are not a rotation: their norm is not 1, or not a number.
///
/// # Example
/// ```
/// use vff_core::math::UnitQuaternion;
/// use vff_core::math::rotation::NotARotation;
///
/// assert_eq!(UnitQuaternion::new([2.0, 0.0, 0.0, 0.0]), Err(NotARotation { norm: 2.0 }));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "a quaternion [w, x, y, z] of norm {norm} is no rotation: its norm must be 1 within {UNIT_TOLERANCE}"
)]
pub struct NotARotation {
    /// The norm of what was given.
    pub norm: f64,
}

impl Default for UnitQuaternion {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl UnitQuaternion {
    /// No rotation.
    pub const IDENTITY: Self = Self { w: 1.0, v: Vector::<3>::new(0.0, 0.0, 0.0) };

    /// From `[w, x, y, z]`, normalised.
    ///
    /// # Errors
    /// When the norm differs from 1 by more than [`UNIT_TOLERANCE`].
    pub fn new([w, x, y, z]: [f64; 4]) -> Result<Self, NotARotation> {
        let v = Vector::<3>::new(x, y, z);
        let norm = (w * w + v.norm_squared()).sqrt();
        if (norm - 1.0).abs() <= UNIT_TOLERANCE {
            Ok(Self { w: w / norm, v: v / norm })
        } else {
            Err(NotARotation { norm })
        }
    }

    /// The rotation of a quaternion `[w, x, y, z]` of any length but 0.
    #[inline]
    pub fn normalised([w, x, y, z]: [f64; 4]) -> Self {
        let v = Vector::<3>::new(x, y, z);
        let norm = (w * w + v.norm_squared()).sqrt();
        Self { w: w / norm, v: v / norm }
    }

    /// `[w, x, y, z]` with w ≥ 0; of a half turn, whose w is 0, the one whose first component that
    /// is not 0 is positive.
    pub fn to_array(&self) -> [f64; 4] {
        let q = [self.w, self.v.x, self.v.y, self.v.z];
        let first = q.into_iter().find(|x| *x != 0.0).unwrap_or(1.0);
        // Adding 0 turns −0 into 0.
        q.map(|x| if first < 0.0 { -x + 0.0 } else { x + 0.0 })
    }

    /// The rotation by the vector `phi` \[rad\].
    pub fn exp(phi: &Vector<3>) -> Self {
        let angle = phi.norm();
        let (sin, w) = (0.5 * angle).sin_cos();
        let share = if angle > 0.0 { sin / angle } else { 0.5 };
        Self { w, v: phi * share }
    }

    /// The rotation vector of the shorter way, |φ| ≤ π \[rad\]. For a half turn both ways are equally
    /// long: the axis is that of the quaternion as it is stored.
    pub fn log(&self) -> Vector<3> {
        let sin = self.v.norm();
        let sign = if self.w < 0.0 { -1.0 } else { 1.0 };
        let share = if sin > 0.0 { 2.0 * sin.atan2(self.w.abs()) / sin } else { 2.0 };
        self.v * (sign * share)
    }

    /// The rotation matrix.
    pub fn matrix(&self) -> Matrix3<f64> {
        let Self { w, v } = *self;
        let (x, y, z) = (v.x, v.y, v.z);
        Matrix3::new(
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        )
    }

    /// The rotation of an orthonormal right-handed matrix, from the largest of the four components
    /// (Shepperd, 1978), so that no square root comes near zero.
    pub fn from_matrix(r: &Matrix3<f64>) -> Self {
        let (xx, yy, zz) = (r[(0, 0)], r[(1, 1)], r[(2, 2)]);
        let odd =
            Vector::<3>::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
        let (xy, xz, yz) = (r[(0, 1)] + r[(1, 0)], r[(0, 2)] + r[(2, 0)], r[(1, 2)] + r[(2, 1)]);
        let trace = xx + yy + zz;
        let (w, v) = if trace >= xx.max(yy).max(zz) {
            (1.0 + trace, odd)
        } else if xx >= yy.max(zz) {
            (odd.x, Vector::<3>::new(1.0 + xx - yy - zz, xy, xz))
        } else if yy >= zz {
            (odd.y, Vector::<3>::new(xy, 1.0 + yy - xx - zz, yz))
        } else {
            (odd.z, Vector::<3>::new(xz, yz, 1.0 + zz - xx - yy))
        };
        let norm = (w * w + v.norm_squared()).sqrt();
        Self { w: w / norm, v: v / norm }
    }

    /// The opposite rotation.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self { w: self.w, v: -self.v }
    }

    /// `r` turned.
    #[inline]
    pub fn rotate(&self, r: &Vector<3>) -> Vector<3> {
        let t = self.v.cross(r) * 2.0;
        r + t * self.w + self.v.cross(&t)
    }

    /// The error e_o of this orientation R against `desired` R_d, in world axes \[rad\]: a measure of
    /// the rotation R R_dᵀ that leads from R_d to R, in the direction of its axis.
    ///
    /// Both forms grow steadily up to a half turn. Across it they jump to the opposite side, as
    /// every error of an orientation does somewhere; exactly there, the axis of the stored
    /// quaternion decides.
    pub fn error(&self, desired: &Self, form: OrientationError) -> Vector<3> {
        let between = *self * desired.inverse();
        match form {
            OrientationError::Quaternion => between.v * if between.w < 0.0 { -2.0 } else { 2.0 },
            OrientationError::Logarithm => between.log(),
        }
    }

    /// The error of the direction of this tool's z axis against that of `desired`, along the tool's
    /// own x and y axes \[rad\]: a measure of the smallest rotation from the desired axis to the
    /// actual one. Where they are opposite, the tool's x axis is taken.
    pub fn pointing_error(&self, desired: &Self, form: OrientationError) -> Vector<2> {
        let z = self.inverse().rotate(&desired.rotate(&Vector::<3>::z()));
        let (sin, half_cos) = (z.x.hypot(z.y), (0.5 * (1.0 + z.z)).max(0.0).sqrt());
        let half_sin = (0.5 * (1.0 - z.z)).max(0.0).sqrt();
        // Of the two, the one that is not small is accurate.
        let size = match form {
            OrientationError::Quaternion if z.z >= 0.0 => sin / half_cos,
            OrientationError::Quaternion => 2.0 * half_sin,
            OrientationError::Logarithm => sin.atan2(z.z),
        };
        if sin > 0.0 {
            Vector::<2>::new(z.y, -z.x) * (size / sin)
        } else {
            Vector::<2>::new(size, 0.0)
        }
    }
}

impl Mul for UnitQuaternion {
    type Output = Self;

    /// First `other`, then `self`.
    #[inline]
    fn mul(self, other: Self) -> Self {
        Self {
            w: self.w * other.w - self.v.dot(&other.v),
            v: other.v * self.w + self.v * other.w + self.v.cross(&other.v),
        }
    }
}

/// Which measure of a rotation is an error of orientation.
///
/// # Example
/// ```
/// use vff_core::math::rotation::OrientationError;
/// use vff_core::math::{UnitQuaternion, Vector};
///
/// let turned = UnitQuaternion::exp(&Vector::<3>::new(0.0, 0.0, 0.2));
/// let error = |form| turned.error(&UnitQuaternion::IDENTITY, form).z;
/// assert!((error(OrientationError::Logarithm) - 0.2).abs() < 1e-15);
/// assert!((error(OrientationError::Quaternion) - 2.0 * 0.1_f64.sin()).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OrientationError {
    /// 2 sgn(η) ε of the quaternion (η, ε): 2 sin ½θ along the axis. Smooth and without a division.
    #[default]
    Quaternion,
    /// The rotation vector itself, θ along the axis: ë + D ė + K e = 0 can hold for it exactly.
    Logarithm,
}

/// The quaternions of `orientations`, each with the sign that brings it nearest to the one before.
pub(crate) fn continued(orientations: &[UnitQuaternion]) -> Vec<Vector<4>> {
    let mut before = Vector::<4>::zeros();
    let quaternion = |orientation: &UnitQuaternion| {
        let q = Vector::from(orientation.to_array());
        before = if q.dot(&before) < 0.0 { -q } else { q };
        before
    };
    orientations.iter().map(quaternion).collect()
}

/// The orientation of a quaternion p of any length, with its angular velocity \[rad/s\] and acceleration \[rad/s²\] in world
/// axes (T102): ω = 2 Im(ṗ p*)/|p|².
pub(crate) fn along(p: &Coordinates<4>) -> (UnitQuaternion, Vector<3>, Vector<3>) {
    let square = p.x.norm_squared();
    let imaginary = |a: &Vector<4>, b: &Vector<4>| {
        let (a_imaginary, b_imaginary) =
            (Vector::<3>::new(a[1], a[2], a[3]), Vector::<3>::new(b[1], b[2], b[3]));
        a_imaginary * b[0] - b_imaginary * a[0] - a_imaginary.cross(&b_imaginary)
    };
    let omega = imaginary(&p.dx, &p.x) * (2.0 / square);
    let alpha = imaginary(&p.ddx, &p.x) * (2.0 / square) - omega * (2.0 * p.x.dot(&p.dx) / square);
    (UnitQuaternion::normalised(p.x.into()), omega, alpha)
}

/// The matrix of the cross product: `skew(a) b = a × b`.
#[inline]
pub fn skew(a: &Vector<3>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// J_l(φ), which makes an angular velocity of a rate of the rotation vector: ω = J_l(φ) φ̇.
pub fn left_jacobian(phi: &Vector<3>) -> Matrix3<f64> {
    let k = skew(phi);
    let Coefficients { a, b, .. } = Coefficients::at(phi.norm());
    Matrix3::identity() + k * a + k * k * b
}

/// J_l(φ)⁻¹: φ̇ = J_l(φ)⁻¹ ω; |φ| < 2π.
pub fn left_jacobian_inverse(phi: &Vector<3>) -> Matrix3<f64> {
    let k = skew(phi);
    let Coefficients { a, a_rate, .. } = Coefficients::at(phi.norm());
    Matrix3::identity() - k * 0.5 - k * k * (0.5 * a_rate / a)
}

/// d/dt J_l(φ) while φ moves with `rate`: ω̇ = J_l φ̈ + J̇_l φ̇.
pub fn left_jacobian_rate(phi: &Vector<3>, rate: &Vector<3>) -> Matrix3<f64> {
    let (k, dk) = (skew(phi), skew(rate));
    let Coefficients { a, b, a_rate, b_rate } = Coefficients::at(phi.norm());
    let along = phi.dot(rate);
    dk * a + k * (a_rate * along) + (k * dk + dk * k) * b + k * k * (b_rate * along)
}

/// a = (1 − cos θ)/θ², b = (θ − sin θ)/θ³ and their derivatives by θ over θ.
struct Coefficients {
    a: f64,
    b: f64,
    a_rate: f64,
    b_rate: f64,
}

impl Coefficients {
    fn at(angle: f64) -> Self {
        let square = angle * angle;
        if angle < 1.0 {
            return Self::series(square);
        }
        let (sin, cos) = angle.sin_cos();
        let (a, b) = ((1.0 - cos) / square, (angle - sin) / (square * angle));
        Self { a, b, a_rate: (sin / angle - 2.0 * a) / square, b_rate: (a - 3.0 * b) / square }
    }

    /// Σ (−θ²)ᵏ/(2k+2)! and its like: small angles cancel in the closed form.
    fn series(square: f64) -> Self {
        let mut sum = Self { a: 0.0, b: 0.0, a_rate: 0.0, b_rate: 0.0 };
        // (−θ²)ᵏ/(2k+2)! at k, and −(−θ²)ᵏ⁻¹/(2k+2)!.
        let (mut term, mut slope) = (0.5, 0.0);
        for k in 0..10 {
            let k = f64::from(k);
            sum.a += term;
            sum.b += term / (2.0 * k + 3.0);
            sum.a_rate += 2.0 * k * slope;
            sum.b_rate += 2.0 * k * slope / (2.0 * k + 3.0);
            let next = (2.0 * k + 3.0) * (2.0 * k + 4.0);
            slope = -term / next;
            term *= -square / next;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::close::assert_close;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// A rotation vector of any direction, of lengths from next to nothing to a half turn.
    fn rotation_vector() -> impl Strategy<Value = Vector<3>> {
        let direction = prop::array::uniform3(-1.0..1.0_f64)
            .prop_filter_map("no direction", |x| Vector::<3>::from(x).try_normalize(1e-3));
        let angle = prop_oneof![
            0.0..PI,
            (-16.0..0.0).prop_map(|x: f64| 10.0_f64.powf(x)),
            (-15.0..0.0).prop_map(|x: f64| PI - 10.0_f64.powf(x)),
        ];
        (direction, angle).prop_map(|(direction, angle)| direction * angle)
    }

    fn cases() -> ProptestConfig {
        ProptestConfig::with_cases(512)
    }

    properties! {
        #![proptest_config(cases())]

        /// exp and log undo each other up to a half turn, through the matrix too.
        #[test]
        fn exp_and_log(phi in rotation_vector()) {
            let q = UnitQuaternion::exp(&phi);
            assert_close(q.log().as_slice(), phi.as_slice(), 1e-14);
            let r = q.matrix();
            prop_assert!((r.transpose() * r - Matrix3::identity()).norm() < 4e-15);
            let back = UnitQuaternion::from_matrix(&r);
            assert_close(&back.to_array(), &q.to_array(), 1e-14);
            assert_close(UnitQuaternion::new(q.to_array()).unwrap().matrix().as_slice(), r.as_slice(), 4e-15);
            prop_assert!(q.to_array()[0] >= 0.0);
        }

        /// Rodrigues' formula, whose terms come from nowhere else; each entry is the sum of four, rounded.
        #[test]
        fn matrix_is_that_of_rodrigues(phi in rotation_vector(), r in prop::array::uniform3(-2.0..2.0)) {
            let (angle, r) = (phi.norm(), Vector::from(r));
            let k = phi.try_normalize(1e-300).map_or(Matrix3::zeros(), |axis| skew(&axis));
            let expected = Matrix3::identity() + k * angle.sin() + k * k * (1.0 - angle.cos());
            let q = UnitQuaternion::exp(&phi);
            assert_close(q.matrix().as_slice(), expected.as_slice(), 2e-15);
            assert_close(q.rotate(&r).as_slice(), (expected * r).as_slice(), 2e-15);
        }

        #[test]
        fn product_and_inverse(a in rotation_vector(), b in rotation_vector()) {
            let (a, b) = (UnitQuaternion::exp(&a), UnitQuaternion::exp(&b));
            assert_close((a * b).matrix().as_slice(), (a.matrix() * b.matrix()).as_slice(), 2e-15);
            let inverse = a.inverse().matrix();
            assert_close(inverse.as_slice(), a.matrix().transpose().as_slice(), 1e-15);
        }

        /// ω = J_l φ̇ and ω̇ = J_l φ̈ + J̇_l φ̇ against differences of the rotation; J_l⁻¹ inverts.
        #[test]
        fn left_jacobian_and_its_rate(phi in rotation_vector(), rate in prop::array::uniform3(-1.0..1.0)) {
            let (h, rate) = (1e-5, Vector::from(rate));
            let at = |t: f64| phi + rate * t;
            let between = UnitQuaternion::exp(&at(h)) * UnitQuaternion::exp(&at(-h)).inverse();
            let omega = left_jacobian(&phi) * rate;
            assert_close(omega.as_slice(), (between.log() / (2.0 * h)).as_slice(), 1e-9);
            let difference = (left_jacobian(&at(h)) - left_jacobian(&at(-h))) / (2.0 * h);
            assert_close(left_jacobian_rate(&phi, &rate).as_slice(), difference.as_slice(), 1e-9);
            let identity = left_jacobian_inverse(&phi) * left_jacobian(&phi);
            assert_close(identity.as_slice(), Matrix3::<f64>::identity().as_slice(), 1e-14);
        }

        /// Both errors lie along the axis of the rotation from R_d to R: 2 sin ½θ and θ.
        #[test]
        fn orientation_errors(phi in rotation_vector(), desired in rotation_vector()) {
            let desired = UnitQuaternion::exp(&desired);
            let actual = UnitQuaternion::exp(&phi) * desired;
            let angle = phi.norm();
            let log = actual.error(&desired, OrientationError::Logarithm);
            let chord = actual.error(&desired, OrientationError::Quaternion);
            // Within rounding of a half turn the error may jump to the other side.
            let side = if log.dot(&phi) < 0.0 && angle > PI - 1e-14 { -1.0 } else { 1.0 };
            assert_close((log * side).as_slice(), phi.as_slice(), 4e-15);
            let expected = phi * if angle > 0.0 { 2.0 * (0.5 * angle).sin() / angle } else { 1.0 };
            assert_close((chord * side).as_slice(), expected.as_slice(), 4e-15);
        }

        /// A turn about the tool's z axis is no error of pointing; one about an axis across is, all
        /// of it, in tool axes.
        #[test]
        fn pointing_errors(desired in rotation_vector(), across in -PI..PI, angle in 0.0..3.1_f64, turn in -3.0..3.0) {
            let desired = UnitQuaternion::exp(&desired);
            let axis = Vector::<3>::new(across.cos(), across.sin(), 0.0);
            let own = UnitQuaternion::exp(&(Vector::<3>::z() * turn));
            let tool = desired * UnitQuaternion::exp(&(axis * angle)) * own;
            let in_tool = own.inverse().rotate(&axis);
            for (form, size) in [
                (OrientationError::Logarithm, angle),
                (OrientationError::Quaternion, 2.0 * (0.5 * angle).sin()),
            ] {
                let expected = Vector::<2>::new(in_tool.x, in_tool.y) * size;
                assert_close(tool.pointing_error(&desired, form).as_slice(), expected.as_slice(), 2e-14);
            }
        }
    }

    #[test]
    fn quaternions_that_are_none() {
        assert_eq!(UnitQuaternion::new([2.0, 0.0, 0.0, 0.0]), Err(NotARotation { norm: 2.0 }));
        assert!(UnitQuaternion::new([f64::NAN, 0.0, 0.0, 1.0]).is_err());
        assert!(UnitQuaternion::new([0.0; 4]).is_err());
        assert!(UnitQuaternion::new([1.011, 0.0, 0.0, 0.0]).is_err());
        let near = UnitQuaternion::new([0.0, -0.991, 0.0, 0.0]).unwrap();
        assert_close(&near.to_array(), &[0.0, 1.0, 0.0, 0.0], 1e-16);
    }

    /// A half turn: an error of full size, and a rotation vector of length π, about every axis.
    #[test]
    fn half_turns() {
        for axis in [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.6, 0.0, -0.8]] {
            let half = UnitQuaternion::new([0.0, axis[0], axis[1], axis[2]]).unwrap();
            let error = |form| half.error(&UnitQuaternion::IDENTITY, form).norm();
            assert!((error(OrientationError::Logarithm) - PI).abs() < 1e-15);
            assert!((error(OrientationError::Quaternion) - 2.0).abs() < 1e-15);
        }
        let over = UnitQuaternion::new([0.0, 1.0, 0.0, 0.0]).unwrap();
        let error = |form| over.pointing_error(&UnitQuaternion::IDENTITY, form);
        assert_eq!(error(OrientationError::Quaternion), Vector::<2>::new(2.0, 0.0));
        assert_eq!(error(OrientationError::Logarithm), Vector::<2>::new(PI, 0.0));
    }
}
