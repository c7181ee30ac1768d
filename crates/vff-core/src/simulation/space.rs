//! Space: which types fit together there.

use super::perception::Perceive;
use super::{Setting, System};
use crate::math::{Body, Pointing, SpatialPose, Vector};
use crate::robot::{Model, Robot, SpatialArm, SpatialState};
use crate::world::space::{Volume, World};
use crate::world::{CollisionQuery, Contact, Positions};

/// Arms among obstacles in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Space;

impl Setting<3> for Space {
    type State = SpatialState;
    type Arm = SpatialArm;
    type Solid = Volume;
    type Perception = Unsensed;
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

/// Sensors on arms in space: there are none so far, and no value of this type.
#[derive(Debug, Clone)]
pub enum Unsensed {}

impl Perceive<Volume, 3> for Unsensed {
    fn start(&mut self, _: &impl Robot<3>, _: &World) {
        match *self {}
    }

    fn advance(&mut self, _: &impl Robot<3>, _: &World) {
        match *self {}
    }

    fn undo(&mut self) {
        match *self {}
    }
}

impl Positions for Unsensed {
    fn count(&self) -> usize {
        match *self {}
    }

    fn append_to(&self, _: &mut Vec<f64>) {
        match *self {}
    }
}

impl CollisionQuery<3> for Unsensed {
    fn obstacle_count(&self) -> usize {
        match *self {}
    }

    fn for_each_contact(
        &mut self,
        _: impl IntoIterator<Item = Body<3>>,
        _: f64,
        _: impl FnMut(usize, f64),
        _: impl FnMut(&Contact<3>),
    ) {
        match *self {}
    }

    fn contact_after(&self, _: usize, _: &Body<3>, _: usize, _: f64) -> Contact<3> {
        match *self {}
    }
}
