//! The plane: which types fit together there.

use super::{Perception, SpaceTypes, System};
use crate::math::{PlanarPose, Vector};
use crate::robot::planar::{Annulus, Reach};
use crate::robot::{PlanarArm, PlanarState};
use crate::trajectory::{Guided, Reference};
use crate::world::plane::PlanarGeometry;

/// Planar arms among planar obstacles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane;

impl SpaceTypes<2> for Plane {
    type State = PlanarState;
    type Arm = PlanarArm;
    type Geometry = PlanarGeometry;
    type Perception = Perception;
}

/// A task of position.
impl System<2, 2> for Plane {
    type Pose = Vector<2>;

    fn attainable(arm: &PlanarArm, pose: &Vector<2>, goal: &Vector<2>) -> Vector<2> {
        inside(arm, pose, goal)
    }
}

/// A task of position and orientation.
impl System<2, 3> for Plane {
    type Pose = PlanarPose;

    fn attainable(arm: &PlanarArm, pose: &PlanarPose, goal: &Vector<2>) -> Vector<2> {
        inside(arm, pose, goal)
    }
}

/// The position nearest to `goal` that the arm can reach with the orientation of `pose`, a little inside \[m\].
fn inside<P>(arm: &PlanarArm, pose: &P, goal: &Vector<2>) -> Vector<2>
where
    PlanarArm: Reach<P>,
{
    let Annulus { inner, outer } = arm.wrist_annulus();
    let margin = 0.02 * (outer - inner);
    let wrist = arm.wrist(pose);
    let from_base = goal + wrist;
    let distance = from_base.norm();
    let allowed = distance.clamp(inner + margin, outer - margin);
    let direction = if distance > 0.0 { from_base / distance } else { Vector::x() };
    direction * allowed - wrist
}

/// What the plane knows of a task of dimension `M` beyond every [`System`]: the reach in closed form.
pub trait PlanarSystem<const M: usize>:
    System<2, M, Pose: Guided<M, Reference = Reference>>
{
    /// Where the wrist can be.
    fn annulus(arm: &PlanarArm) -> Annulus;
    /// Where it has to be for a pose \[m\].
    fn wrist(arm: &PlanarArm, pose: &Self::Pose) -> Vector<2>;
}

impl PlanarSystem<2> for Plane {
    fn annulus(arm: &PlanarArm) -> Annulus {
        Reach::<Vector<2>>::wrist_annulus(arm)
    }

    fn wrist(_: &PlanarArm, pose: &Vector<2>) -> Vector<2> {
        *pose
    }
}

impl PlanarSystem<3> for Plane {
    fn annulus(arm: &PlanarArm) -> Annulus {
        Reach::<PlanarPose>::wrist_annulus(arm)
    }

    fn wrist(arm: &PlanarArm, pose: &PlanarPose) -> Vector<2> {
        pose.0.xy() + arm.wrist(pose)
    }
}
