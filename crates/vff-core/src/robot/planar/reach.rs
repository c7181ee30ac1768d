//! Where a planar arm can put its end effector.

use super::PlanarArm;
use crate::math::{PlanarPose, Vector};
use crate::robot::Model;

/// An annulus around the base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Annulus {
    /// Smallest distance from the base \[m\].
    pub inner: f64,
    /// Largest distance from the base \[m\].
    pub outer: f64,
}

/// What a planar arm can reach of poses `P`.
///
/// # Example
/// ```
/// use vff_core::math::{PlanarPose, Vector};
/// use vff_core::robot::planar::{Link, Reach};
/// use vff_core::robot::PlanarArm;
///
/// let arm = PlanarArm::new(vec![Link::rod(0.5, 1.0); 3], Vector::<2>::zeros());
/// // The last link is turned as the pose says: its beginning is behind the end effector.
/// let wrist = arm.wrist(&PlanarPose(Vector::<3>::new(1.0, 0.0, 0.0)));
/// assert!((wrist - Vector::<2>::new(-0.5, 0.0)).norm() < 1e-15);
/// ```
pub trait Reach<P> {
    /// Where the far end of all links that are free to take any angle can be.
    fn wrist_annulus(&self) -> Annulus;
    /// Where that end is relative to the end effector, for a pose \[m\].
    fn wrist(&self, pose: &P) -> Vector<2>;
}

/// All links take any angle.
impl Reach<Vector<2>> for PlanarArm {
    fn wrist_annulus(&self) -> Annulus {
        self.annulus(self.dof())
    }

    fn wrist(&self, _: &Vector<2>) -> Vector<2> {
        Vector::zeros()
    }
}

/// The pose puts the last joint in its place.
impl Reach<PlanarPose> for PlanarArm {
    fn wrist_annulus(&self) -> Annulus {
        self.annulus(self.dof() - 1)
    }

    fn wrist(&self, pose: &PlanarPose) -> Vector<2> {
        let last = self.links()[self.dof() - 1].length;
        let (sin, cos) = pose.0[2].sin_cos();
        Vector::<2>::new(-last * cos, -last * sin)
    }
}
