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
