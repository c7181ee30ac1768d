//! A reference of the end effector in numbers, and what they mean for a task.

use crate::math::rotation::{NotARotation, UnitQuaternion};
use crate::math::{Pointing, SpatialPose, Vector};
use crate::robot::{Manipulator, PlanarState, SpatialState};
use crate::trajectory::Sample;

/// A reference of the end effector in numbers. How many each has is said by [`widths`](super::ErasedController::widths).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target<'a> {
    /// The pose, position \[m\] before orientation.
    pub x: &'a [f64],
    /// Its velocity \[m/s, rad/s\].
    pub dx: &'a [f64],
    /// Its acceleration \[m/s², rad/s²\].
    pub ddx: &'a [f64],
}

/// A robot that is told in numbers where its end effector has to be.
///
/// # Example
/// ```
/// use vff_core::robot::{PlanarState, SpatialState};
/// use vff_core::runtime::controller::FromNumbers;
///
/// assert_eq!(<PlanarState as FromNumbers<2, 3>>::WIDTHS, [3, 3, 3]);
/// assert_eq!(<SpatialState as FromNumbers<3, 6>>::WIDTHS, [7, 6, 6]); // a pose has a quaternion
/// ```
pub trait FromNumbers<const D: usize, const M: usize>: Manipulator<D, M> {
    /// How many numbers a pose, a velocity and an acceleration have.
    const WIDTHS: [usize; 3];

    /// Whether the numbers, which are finite, are a reference.
    ///
    /// # Errors
    /// If they are not.
    fn check(target: &Target<'_>) -> Result<(), NotARotation>;
    /// What the numbers mean for the task of this robot at its present state.
    fn sample(&self, target: &Target<'_>) -> Sample<Self::Pose, M>;
}

/// Positions and planar poses are vectors, and so are their rates.
impl<const M: usize> FromNumbers<2, M> for PlanarState
where
    Self: Manipulator<2, M, Pose: From<Vector<M>>>,
{
    const WIDTHS: [usize; 3] = [M; 3];

    fn check(_: &Target<'_>) -> Result<(), NotARotation> {
        Ok(())
    }

    fn sample(&self, target: &Target<'_>) -> Sample<Self::Pose, M> {
        let [x, dx, ddx] = [target.x, target.dx, target.ddx].map(Vector::<M>::from_column_slice);
        Sample { x: x.into(), dx, ddx }
    }
}

/// A position in space is a vector.
impl FromNumbers<3, 3> for SpatialState {
    const WIDTHS: [usize; 3] = [3; 3];

    fn check(_: &Target<'_>) -> Result<(), NotARotation> {
        Ok(())
    }

    fn sample(&self, target: &Target<'_>) -> Sample<Vector<3>, 3> {
        let [x, dx, ddx] = [target.x, target.dx, target.ddx].map(Vector::<3>::from_column_slice);
        Sample { x, dx, ddx }
    }
}

/// Position and direction are given as a pose, and their rates as those of a pose.
impl FromNumbers<3, 5> for SpatialState {
    const WIDTHS: [usize; 3] = <Self as FromNumbers<3, 6>>::WIDTHS;

    fn check(target: &Target<'_>) -> Result<(), NotARotation> {
        orientation(target).map(drop)
    }

    fn sample(&self, target: &Target<'_>) -> Sample<Pointing, 5> {
        let Sample { x, dx, ddx } = FromNumbers::<3, 6>::sample(self, target);
        Sample::<Pointing, 5>::in_world_axes(x, &dx, &ddx)
    }
}

/// A pose is a position and a quaternion \[w, x, y, z\]; rates are linear, then angular, in world axes.
impl FromNumbers<3, 6> for SpatialState {
    const WIDTHS: [usize; 3] = [7, 6, 6];

    fn check(target: &Target<'_>) -> Result<(), NotARotation> {
        orientation(target).map(drop)
    }

    fn sample(&self, target: &Target<'_>) -> Sample<SpatialPose, 6> {
        let [dx, ddx] = [target.dx, target.ddx].map(Vector::<6>::from_column_slice);
        let position = Vector::<3>::from_column_slice(&target.x[..3]);
        let orientation = orientation(target).unwrap_or_default();
        Sample { x: SpatialPose::new(position, orientation), dx, ddx }
    }
}

/// The orientation of a pose that is given as seven numbers.
fn orientation(target: &Target<'_>) -> Result<UnitQuaternion, NotARotation> {
    UnitQuaternion::new([target.x[3], target.x[4], target.x[5], target.x[6]])
}
