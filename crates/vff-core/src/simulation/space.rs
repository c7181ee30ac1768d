//! Space: which types fit together there.

use super::{SpaceTypes, SpatialPerception, System};
use crate::math::{Pointing, SpatialPose, Vector};
use crate::robot::{Model, SpatialArm, SpatialState};
use crate::world::space::SpatialGeometry;

/// Arms among obstacles in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Space;

impl SpaceTypes<3> for Space {
    type State = SpatialState;
    type Arm = SpatialArm;
    type Geometry = SpatialGeometry;
    type Perception = SpatialPerception;
}

/// A task of position.
impl System<3, 3> for Space {
    type Pose = Vector<3>;

    fn attainable(arm: &SpatialArm, _: &Vector<3>, goal: &Vector<3>) -> Vector<3> {
        inside(arm, goal)
    }
}

/// A task of position and of the direction of the tool.
impl System<3, 5> for Space {
    type Pose = Pointing;

    fn attainable(arm: &SpatialArm, _: &Pointing, goal: &Vector<3>) -> Vector<3> {
        inside(arm, goal)
    }
}

/// A task of position and orientation.
impl System<3, 6> for Space {
    type Pose = SpatialPose;

    fn attainable(arm: &SpatialArm, _: &SpatialPose, goal: &Vector<3>) -> Vector<3> {
        inside(arm, goal)
    }
}

/// The position nearest to `goal` in a ball around the base in which the arm reaches nearly everything \[m\].
fn inside(arm: &SpatialArm, goal: &Vector<3>) -> Vector<3> {
    const SHARE: f64 = 0.6;
    let from_base = goal - arm.base();
    let (distance, most) = (from_base.norm(), SHARE * arm.reach());
    if distance <= most { *goal } else { arm.base() + from_base * (most / distance) }
}
