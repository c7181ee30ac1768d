//! The types of one closed loop: which arm, which task, which geometry.

use super::perception::Perceive;
use crate::math::Vector;
use crate::robot::{Manipulator, Model, Robot};
use crate::trajectory::Guided;
use crate::world::ObstacleGeometry;
use std::fmt::Debug;

/// Which arms and which obstacles meet in `D` dimensions.
pub trait SpaceTypes<const D: usize>: Debug + Clone {
    /// The arm at one instant.
    type State: Robot<D> + Clone + Debug + Send + 'static;
    /// What is immutable of the arm.
    type Arm: Model<D, State = Self::State>;
    /// What obstacles are made of.
    type Geometry: ObstacleGeometry<D>;
    /// What the controller may see of the obstacles instead of knowing them.
    type Perception: Perceive<Self::State, Self::Geometry, D> + Clone + Debug;
}

/// An arm in `D`-dimensional space, its task of dimension `M`, and the geometry around it.
///
/// # Example
/// The types of a space ([`SpaceTypes`]) and of a task in it:
/// ```
/// use vff_core::simulation::{PlanarSystem, Plane, SpaceTypes, Space, System};
/// use vff_core::math::{PlanarPose, SpatialPose};
/// use vff_core::robot::SpatialArm;
///
/// fn pose_of<S: System<D, M, Pose = P>, P, const D: usize, const M: usize>() {}
/// pose_of::<Plane, PlanarPose, 2, 3>();
/// pose_of::<Space, SpatialPose, 3, 6>();
/// fn arm_of<S: SpaceTypes<D, Arm = A>, A, const D: usize>() {}
/// arm_of::<Space, SpatialArm, 3>();
/// fn has_reach<S: PlanarSystem<M>, const M: usize>() {}
/// has_reach::<Plane, 2>();
/// ```
pub trait System<const D: usize, const M: usize>:
    SpaceTypes<D, State: Manipulator<D, M, Pose = Self::Pose>>
{
    /// What the task means by a pose.
    type Pose: Guided<M>;

    /// The position nearest to `goal` \[m\], or close to it, that the end effector can take with the orientation of
    /// `pose`.
    fn attainable(arm: &Self::Arm, pose: &Self::Pose, goal: &Vector<D>) -> Vector<D>;
}
