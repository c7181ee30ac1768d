//! What a pose is to a task: something that differs from another by a vector, and can be moved along one.

use super::{Vector, whole_turns};
use std::f64::consts::PI;
use std::fmt::Debug;

/// Where an end effector is, as far as a task of dimension `M` cares. Differences and displacements are
/// vectors of the task; the pose itself need not be one.
///
/// # Example
/// ```
/// use vff_core::math::{PlanarPose, Pose, Vector};
///
/// let there = PlanarPose(Vector::<3>::new(1.0, 0.5, 0.2));
/// let here = there.moved(&Vector::<3>::new(0.1, 0.0, 0.0));
/// assert!((here.error(&there) - Vector::<3>::new(0.1, 0.0, 0.0)).norm() < 1e-15);
/// assert_eq!(there.as_slice(), [1.0, 0.5, 0.2]);
/// ```
///
/// # See also
/// [`SpatialPose`](super::SpatialPose), [`Pointing`](super::Pointing); a position is a [`Vector`].
pub trait Pose<const M: usize>: Copy + Debug + PartialEq + Send + 'static {
    /// How many numbers a pose takes when it is written.
    const WIDTH: usize;

    /// x ⊖ x_r: the error of this pose against `reference` \[m, rad\].
    fn error(&self, reference: &Self) -> Vector<M>;
    /// x ⊕ δ: this pose after a small displacement \[m, rad\].
    #[must_use]
    fn moved(&self, displacement: &Vector<M>) -> Self;
    /// The pose as it is written: [`WIDTH`](Self::WIDTH) numbers, the position \[m\] before the orientation.
    fn as_slice(&self) -> &[f64];
}

/// A position \[m\] is a vector.
impl Pose<2> for Vector<2> {
    const WIDTH: usize = 2;

    #[inline]
    fn error(&self, reference: &Self) -> Vector<2> {
        self - reference
    }

    #[inline]
    fn moved(&self, displacement: &Vector<2>) -> Self {
        self + displacement
    }

    fn as_slice(&self) -> &[f64] {
        self.as_slice()
    }
}

/// A position in space \[m\] is a vector, too.
impl Pose<3> for Vector<3> {
    const WIDTH: usize = 3;

    #[inline]
    fn error(&self, reference: &Self) -> Vector<3> {
        self - reference
    }

    #[inline]
    fn moved(&self, displacement: &Vector<3>) -> Self {
        self + displacement
    }

    fn as_slice(&self) -> &[f64] {
        self.as_slice()
    }
}

/// A position in the plane \[m\] and an orientation \[rad\], which counts turns: it is not wrapped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPose(pub Vector<3>);

impl From<Vector<3>> for PlanarPose {
    #[inline]
    fn from(coordinates: Vector<3>) -> Self {
        Self(coordinates)
    }
}

impl From<PlanarPose> for Vector<3> {
    #[inline]
    fn from(pose: PlanarPose) -> Self {
        pose.0
    }
}

impl Pose<3> for PlanarPose {
    const WIDTH: usize = 3;

    /// The paper's eq. 16: a difference in position, the angle from reference to pose in (−π, π] in
    /// orientation, so that a full turn is no error.
    #[inline]
    fn error(&self, reference: &Self) -> Vector<3> {
        let mut e = self.0 - reference.0;
        if e[2].abs() > PI {
            e[2] -= whole_turns(e[2]);
        }
        e
    }

    #[inline]
    fn moved(&self, displacement: &Vector<3>) -> Self {
        Self(self.0 + displacement)
    }

    fn as_slice(&self) -> &[f64] {
        self.0.as_slice()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Orientation is not a vector: poses one turn apart are the same pose.
    #[test]
    fn orientation_error_takes_the_short_way() {
        let at = |phi| PlanarPose(Vector::<3>::new(1.0, 2.0, phi));
        assert!((at(3.0).error(&at(-3.0))[2] - (6.0 - TAU)).abs() < 1e-15);
        assert!(at(0.5 + 3.0 * TAU).error(&at(0.5)).norm() < 1e-14);
        assert!((at(0.4).error(&at(0.1))[2] - 0.3).abs() < 1e-15);
    }

    /// x ⊕ (y ⊖ x) is y, for every kind of pose.
    #[test]
    fn a_pose_moved_by_the_error_is_the_other_pose() {
        fn check<P: Pose<M>, const M: usize>(x: P, y: P) {
            assert_eq!(x.as_slice().len(), P::WIDTH);
            let there = x.moved(&y.error(&x));
            assert!(there.error(&y).norm() < 1e-14, "{there:?} is not {y:?}");
        }
        let (x, y) = (Vector::<3>::new(1.0, -2.0, 0.4), Vector::<3>::new(0.3, 0.1, 2.9));
        check::<Vector<2>, 2>(x.xy(), y.xy());
        check::<Vector<3>, 3>(x, y);
        check::<PlanarPose, 3>(PlanarPose(x), PlanarPose(y));
    }
}
