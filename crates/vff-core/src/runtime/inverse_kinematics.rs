//! Postures for poses, of arms of every kind.

use super::arm::AnyArm;
use crate::inverse_kinematics::{Residual, Solver};
use crate::math::rotation::{NotARotation, UnitQuaternion};
use crate::math::{PlanarPose, SpatialPose, Vector};
use crate::robot::{Manipulator, Model};
use std::sync::Arc;

/// Moves `q` to where the tip is as near to `pose` as a search finds.
fn solve<A, const D: usize, const M: usize>(
    arm: &Arc<A>,
    q: &mut [f64],
    pose: &<A::State as Manipulator<D, M>>::Pose,
) -> Residual
where
    A: Model<D, State: Manipulator<D, M>>,
{
    let mut solver = Solver::<M>::new(arm.dof(), arm.characteristic_length());
    solver.solve_from_anywhere(&mut arm.state(), q, pose)
}

impl AnyArm {
    /// Moves `q` \[rad, m\] to where the tip is as near to `pose` as searches from there and from elsewhere find, within the joint limits
    /// (T106). A pose is a position \[m\], of 2 or 3 numbers, or has an orientation: an angle \[rad\] in the plane, 3 numbers, a quaternion
    /// `[w, x, y, z]` in space, 7 numbers. How far away the tip stays. Allocates.
    ///
    /// # Errors
    /// If the quaternion is none.
    ///
    /// # Panics
    /// If a slice has another length.
    pub fn inverse_kinematics(
        &self,
        pose: &[f64],
        q: &mut [f64],
    ) -> Result<Residual, NotARotation> {
        assert_eq!(q.len(), self.dof());
        Ok(match (self, pose.len()) {
            (Self::Plane(arm), 2) => solve::<_, 2, 2>(arm, q, &Vector::from_column_slice(pose)),
            (Self::Plane(arm), 3) => {
                solve::<_, 2, 3>(arm, q, &PlanarPose(Vector::from_column_slice(pose)))
            }
            (Self::Space(arm), 3) => solve::<_, 3, 3>(arm, q, &Vector::from_column_slice(pose)),
            (Self::Space(arm), 7) => {
                let turn = UnitQuaternion::new([pose[3], pose[4], pose[5], pose[6]])?;
                let place = Vector::<3>::from_column_slice(&pose[..3]);
                solve::<_, 3, 6>(arm, q, &SpatialPose::new(place, turn))
            }
            (_, other) => panic!("a pose of {other} numbers"),
        })
    }
}
