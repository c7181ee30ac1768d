//! Poses in space: with the whole orientation, or with the direction of the tool alone.

use super::rotation::{OrientationError, UnitQuaternion};
use super::{Pose, Vector};

/// A position \[m\] and an orientation, as the seven numbers that are written: x, y, z, then the quaternion w, x, y, z
/// with w ≥ 0.
///
/// # Example
/// ```
/// use vff_core::math::{Pointing, Pose, SpatialPose, UnitQuaternion, Vector};
///
/// let turn = UnitQuaternion::exp(&Vector::<3>::new(0.0, 0.0, 0.3));
/// let reference = SpatialPose::new(Vector::<3>::new(0.4, 0.0, 0.5), UnitQuaternion::IDENTITY);
/// let tool = SpatialPose::new(reference.position(), turn);
/// assert!((tool.error(&reference).norm() - 0.3).abs() < 1e-2);
/// // About the axis that points a turn is free.
/// assert!(Pointing(tool).error(&Pointing(reference)).norm() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialPose {
    orientation: UnitQuaternion,
    written: [f64; 7],
}

impl SpatialPose {
    /// The pose at a position \[m\] with an orientation.
    pub fn new(position: Vector<3>, orientation: UnitQuaternion) -> Self {
        let [w, i, j, k] = orientation.to_array();
        Self { orientation, written: [position.x, position.y, position.z, w, i, j, k] }
    }

    /// Position \[m\].
    #[inline]
    pub fn position(&self) -> Vector<3> {
        Vector::<3>::new(self.written[0], self.written[1], self.written[2])
    }

    /// Orientation.
    #[inline]
    pub fn orientation(&self) -> UnitQuaternion {
        self.orientation
    }

    /// ẋ_r and ẍ_r of a reference as what a law commands to a tool that turns with `omega`: with α_r + ω_r × ω the
    /// error, seen from the reference, moves as if that stood still (T104).
    #[inline]
    pub fn resolve(omega: &Vector<3>, dx: &Vector<6>, ddx: &Vector<6>) -> [Vector<6>; 2] {
        let carried = Vector::<3>::new(dx[3], dx[4], dx[5]).cross(omega);
        let mut out = [*dx, *ddx];
        (0..3).for_each(|k| out[1][3 + k] += carried[k]);
        out
    }
}

/// Errors and displacements are linear, then angular, in world axes; the angular error is 2 sgn(η) ε of the quaternion
/// (η, ε) from the reference to the pose. Across half a turn it jumps to the other side.
impl Pose<6> for SpatialPose {
    const WIDTH: usize = 7;

    #[inline]
    fn error(&self, reference: &Self) -> Vector<6> {
        let p = self.position() - reference.position();
        let o = self.orientation.error(&reference.orientation, OrientationError::Quaternion);
        Vector::<6>::new(p.x, p.y, p.z, o.x, o.y, o.z)
    }

    #[inline]
    fn moved(&self, d: &Vector<6>) -> Self {
        let turn = UnitQuaternion::exp(&Vector::<3>::new(d[3], d[4], d[5]));
        Self::new(self.position() + d.fixed_rows::<3>(0), turn * self.orientation)
    }

    fn as_slice(&self) -> &[f64] {
        &self.written
    }
}

/// A position \[m\] and the direction of the tool's z axis: the turn about that axis is free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pointing(pub SpatialPose);

impl Pointing {
    /// Rates of a reference at this pose, of its position and, along its own x and y axes, of its direction z:
    /// z × ż. What turns about z has no part in them.
    #[inline]
    pub(crate) fn velocity(&self, linear: &Vector<3>, omega: &Vector<3>) -> Vector<5> {
        let w = self.0.orientation.inverse().rotate(omega);
        Vector::<5>::new(linear.x, linear.y, linear.z, w.x, w.y)
    }

    /// The same of second order: z × z̈, which is α across z plus (ω·z) z × ω (T103).
    #[inline]
    pub(crate) fn acceleration(
        &self,
        linear: &Vector<3>,
        omega: &Vector<3>,
        alpha: &Vector<3>,
    ) -> Vector<5> {
        let own = self.0.orientation.inverse();
        let (w, a) = (own.rotate(omega), own.rotate(alpha));
        Vector::<5>::new(linear.x, linear.y, linear.z, a.x - w.z * w.y, a.y + w.z * w.x)
    }

    /// Both, from derivatives as others have them: linear, then angular, in world axes.
    pub(crate) fn seen_in_world_axes(&self, dx: &Vector<6>, ddx: &Vector<6>) -> [Vector<5>; 2] {
        let [[v, omega], [a, alpha]] = [dx, ddx].map(|rate| {
            [rate.fixed_rows::<3>(0).into_owned(), rate.fixed_rows::<3>(3).into_owned()]
        });
        [self.velocity(&v, &omega), self.acceleration(&a, &omega, &alpha)]
    }

    /// ẋ_r and ẍ_r of a reference at this pose, which has them in its own axes, as what a law commands to `tool`,
    /// in the tool's, while that turns with `omega` in world axes (T105).
    #[inline]
    pub fn resolve(
        &self,
        tool: &Self,
        omega: &Vector<3>,
        dx: &Vector<5>,
        ddx: &Vector<5>,
    ) -> [Vector<5>; 2] {
        let to_tool = tool.0.orientation.inverse();
        let between = to_tool * self.0.orientation;
        let w_r = between.rotate(&Vector::<3>::new(dx[3], dx[4], 0.0));
        let a_r = between.rotate(&Vector::<3>::new(ddx[3], ddx[4], 0.0));
        let w = to_tool.rotate(omega);
        let own = 2.0 * w_r.z - w.z;
        let mut out = [*dx, *ddx];
        (out[0][3], out[0][4]) = (w_r.x, w_r.y);
        out[1][3] = a_r.x - own * w.y + w_r.z * w_r.y;
        out[1][4] = a_r.y + own * w.x - w_r.z * w_r.x;
        out
    }
}

/// Angular components are those along the x and y axes of the tool itself, as the rows of its Jacobian.
impl Pose<5> for Pointing {
    const WIDTH: usize = 7;

    #[inline]
    fn error(&self, reference: &Self) -> Vector<5> {
        let p = self.0.position() - reference.0.position();
        let (own, wanted) = (self.0.orientation, reference.0.orientation);
        let o = own.pointing_error(&wanted, OrientationError::Quaternion);
        Vector::<5>::new(p.x, p.y, p.z, o.x, o.y)
    }

    #[inline]
    fn moved(&self, d: &Vector<5>) -> Self {
        let turn = UnitQuaternion::exp(&Vector::<3>::new(d[3], d[4], 0.0));
        let position = self.0.position() + d.fixed_rows::<3>(0);
        Self(SpatialPose::new(position, self.0.orientation * turn))
    }

    fn as_slice(&self) -> &[f64] {
        self.0.as_slice()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = SpatialPose> {
        let three = |size: f64| [-size..size, -size..size, -size..size];
        (three(2.0), three(1.8)).prop_map(|(position, turn)| {
            SpatialPose::new(position.into(), UnitQuaternion::exp(&turn.into()))
        })
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(128))]

        /// The error is the displacement to first order, at the pose itself: e(x ⊕ δ, x) = δ + O(δ³).
        #[test]
        fn small_errors_are_displacements(x in pose(), d in prop::array::uniform6(-1e-3..1e-3)) {
            let d = Vector::from(d);
            let e = x.moved(&d).error(&x);
            prop_assert!((e - d).norm() < 1e-9, "{e} is not {d}");
            let d = Vector::<5>::from_column_slice(&d.as_slice()[..5]);
            let e = Pointing(x).moved(&d).error(&Pointing(x));
            // In the axes of the moved tool, which have turned with the displacement, but not about it.
            prop_assert!((e - d).norm() < 1e-9, "{e} is not {d}");
        }

        /// What is written has a unit quaternion with w ≥ 0, and turning about the tool's z axis is no error of pointing.
        #[test]
        fn a_turn_about_the_tool_is_free(x in pose(), turn in -3.0..3.0) {
            let written = x.as_slice();
            prop_assert!(written[3] >= 0.0);
            prop_assert!((written[3..].iter().map(|q| q * q).sum::<f64>() - 1.0).abs() < 1e-14);
            let about = UnitQuaternion::exp(&Vector::<3>::new(0.0, 0.0, turn));
            let turned = SpatialPose::new(x.position(), x.orientation() * about);
            prop_assert!(Pointing(turned).error(&Pointing(x)).norm() < 1e-14);
            prop_assert!((turned.error(&x).norm() - 2.0 * (0.5 * turn).sin().abs()).abs() < 1e-14);
        }
    }
}
