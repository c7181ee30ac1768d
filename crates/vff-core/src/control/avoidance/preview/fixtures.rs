//! The arm and the obstacles of the tests of look-ahead.

use crate::geometry::Body;
use crate::math::Vector;
use crate::robot::{Manipulator, Model, PlanarArm, PlanarState, Robot, planar::Link};
use crate::trajectory::Sample;
use crate::world::plane::{Obstacle, Shape, World};
use crate::world::{CollisionQuery, Contact, Motion};
use std::cell::Cell;
use std::sync::Arc;

pub const START: [f64; 4] = [0.4, 0.5, -0.6, 0.3];

pub fn robot() -> PlanarState {
    let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 4], Vector::<2>::zeros()));
    let mut state = arm.state();
    state.update(&START, &[0.0; 4]);
    state
}

pub fn disc(position: [f64; 2], velocity: [f64; 2]) -> Obstacle {
    let shape = Shape::Circle { radius: 0.2 };
    Obstacle { position, motion: Motion::Linear { velocity }, ..Obstacle::of(shape) }
}

pub fn holding(robot: &PlanarState) -> Sample<Vector<2>, 2> {
    Sample::at_rest(Manipulator::<2, 2>::pose(robot))
}

pub fn closing() -> World {
    World::new(vec![disc([1.4, 2.4], [0.0, -0.8]), disc([1.4, -0.6], [0.0, 0.8])])
}

/// A world that counts how often it is asked for a contact to come.
pub struct Asked {
    pub world: World,
    pub times: Cell<usize>,
}

impl CollisionQuery<2> for Asked {
    fn obstacle_count(&self) -> usize {
        self.world.obstacle_count()
    }

    fn for_each_contact<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, 2>>,
        reach: f64,
        distance: impl FnMut(usize, f64),
        visit: impl FnMut(&Contact<2>),
    ) {
        self.world.for_each_contact(bodies, reach, distance, visit);
    }

    fn contact_after(&self, i: usize, body: &Body<'_, 2>, j: usize, after: f64) -> Contact<2> {
        self.times.set(self.times.get() + 1);
        self.world.contact_after(i, body, j, after)
    }
}
