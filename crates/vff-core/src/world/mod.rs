//! The obstacles: what they look like, how they move, how near the arm is to them.
//!
//! A scenario describes obstacles. A [`World`] holds them ready for queries: one
//! [`World::update`] per instant, then any number of contacts. Nothing allocates after
//! [`World::new`]. Among many obstacles the cost of both grows with what is near, not with what
//! exists; the results do not depend on it.
//!
//! Motion, the queries and the broad phase are the same in every space. What is not is an [`ObstacleGeometry`]: those of
//! the [`plane`] and of [`space`] live in directories of their own.

mod broad_phase;
mod cast;
mod contact;
mod curve;
mod futures;
mod hierarchy;
mod hull_query;
mod margin;
mod motion;
mod obstacle_geometry;
#[cfg(test)]
mod oracle;
mod outlook;
mod pairs;
mod placed;
pub mod plane;
mod query;
pub mod space;
mod turning;
mod within;

pub use crate::math::Feature;
pub use broad_phase::HORIZON;
pub use contact::{Contact, Pair};
pub use margin::PairMargin;
pub use motion::{Interpolation, Motion, MotionState};
pub use obstacle_geometry::{Asked, Description, Hierarchy, ObstacleGeometry, top_speed};
pub use outlook::{Ahead, Outlook, Rates};
pub use query::{CollisionQuery, Positions};
pub use turning::{Rotation, Spin, Turn, Turning};
pub use within::ObstacleBoxes;

use crate::interrupt;
use crate::math::{ThirdOrderFilter, Vector};
use broad_phase::BroadPhase;
use placed::{Carrier, Placed, Turned};
use std::mem::{replace, take};

pub(crate) use crate::math::TOUCHING;

pub(crate) use crate::math::RELIEF;

/// The obstacles at one instant. `S` is what they are made of: see [`plane::World`] and [`space::World`].
///
/// # Example
/// ```
/// use vff_core::math::{Capsule, Vector};
/// use vff_core::world::Motion;
/// use vff_core::world::space::{Obstacle, Shape, World};
///
/// let ball = Obstacle {
///     position: [0.0, 1.0, 0.0],
///     motion: Motion::Linear { velocity: [0.0, -0.5, 0.0] },
///     ..Obstacle::of(Shape::Sphere { radius: 0.1 })
/// };
/// let mut world = World::new(vec![ball]);
/// world.update(1.0);
/// assert_eq!(world.position(0), Vector::<3>::new(0.0, 0.5, 0.0));
/// ```
///
/// # See also
/// [`CollisionQuery`] is how it is asked.
#[derive(Debug, Clone)]
pub struct World<S: ObstacleGeometry<D>, const D: usize> {
    obstacles: Vec<Placed<S, D>>,
    /// Indices of the obstacles that are not static.
    moving: Vec<usize>,
    /// The most contacts and the most barriers that one link can have.
    contacts: usize,
    barriers: usize,
    /// The most barriers that a hull can have.
    hull_barriers: usize,
    /// The largest margin of its own that a pair has \[m\]; 0 if none has one.
    most_margin: f64,
    /// The present instant \[s\].
    time: f64,
    /// Which obstacles are asked, where these are not simply all of them, none of which turns.
    named: Named<S, D>,
    /// What was nearest to each of the first bodies when they were asked last \[m\], where some obstacle has many contacts:
    /// nothing much farther away needs to be looked at.
    remembered: [f64; REMEMBERED],
}

/// What the arm carries, among the links that an obstacle is to ignore.
pub const LOAD: &str = "load";

/// So many bodies are remembered.
const REMEMBERED: usize = 32;

/// How it is known which obstacles are asked.
#[derive(Debug, Clone, Default)]
enum Named<S: ObstacleGeometry<D>, const D: usize> {
    /// All of them; none turns.
    #[default]
    All,
    /// All that are not hidden, and some turn, are hidden, ignored, have many contacts or margins of their own. They are numbered here.
    Each(Vec<usize>),
    /// Those that may be near, where they are too many to ask each.
    BroadPhase(Box<BroadPhase<S, D>>),
}

impl<S: ObstacleGeometry<D>, const D: usize> Named<S, D> {
    /// All of these, with `room` for their numbers. Room that is there is not given back: a loop may be running.
    fn each(obstacles: &[Placed<S, D>], mut room: Vec<usize>) -> Self {
        let is_plain = |it: &Placed<S, D>| {
            let is_measured = !it.is_hidden && it.ignored.is_empty() && it.margins.is_empty();
            it.turned.is_none() && it.geometry.contacts() == 1 && is_measured
        };
        if room.capacity() == 0 && obstacles.iter().all(is_plain) {
            return Self::All;
        }
        room.clear();
        room.extend((0..obstacles.len()).filter(|&j| !obstacles[j].is_hidden));
        Self::Each(room)
    }
}

/// The most contacts and the most barriers that one link can have.
fn most_of<S: ObstacleGeometry<D>, const D: usize>(obstacles: &[Placed<S, D>]) -> [usize; 3] {
    let most = |of: fn(&S) -> usize| {
        obstacles.iter().map(|obstacle| of(&obstacle.geometry).max(obstacle.room)).sum()
    };
    [
        most(ObstacleGeometry::contacts),
        most(ObstacleGeometry::barriers),
        most(ObstacleGeometry::hull_barriers),
    ]
}

/// The largest margin of its own that a pair has \[m\]; 0 if none has one.
fn most_margin<S: ObstacleGeometry<D>, const D: usize>(obstacles: &[Placed<S, D>]) -> f64 {
    let own = obstacles.iter().flat_map(|obstacle| &obstacle.margins);
    own.map(|margin| margin.or(0.0)).fold(0.0, f64::max)
}

impl<S: ObstacleGeometry<D>, const D: usize> World<S, D> {
    /// The given obstacles at t = 0.
    ///
    /// Their values must have been validated before: unusable ones do not panic, but distances to
    /// them mean nothing.
    pub fn new(obstacles: Vec<S::Obstacle>) -> Self {
        let place = |obstacle| {
            interrupt::checkpoint(256);
            Placed::new(obstacle)
        };
        let obstacles: Vec<Placed<S, D>> = obstacles.into_iter().map(place).collect();
        let is_there = |obstacle: &Placed<S, D>| !obstacle.is_hidden;
        let has_broad_phase =
            obstacles.len() >= broad_phase::LEAST && obstacles.iter().all(is_there);
        Self::of(obstacles, has_broad_phase)
    }

    /// Of obstacles at t = 0.
    fn of(mut obstacles: Vec<Placed<S, D>>, has_broad_phase: bool) -> Self {
        futures::weigh(&mut obstacles);
        // Room for all, as any may be placed elsewhere later.
        let mut moving = Vec::with_capacity(obstacles.len());
        moving.extend((0..obstacles.len()).filter(|&j| !obstacles[j].is_static));
        let named = if has_broad_phase {
            Named::BroadPhase(Box::new(BroadPhase::new(&obstacles)))
        } else {
            Named::each(&obstacles, vec![])
        };
        let [contacts, barriers, hull_barriers] = most_of(&obstacles);
        Self {
            most_margin: most_margin(&obstacles),
            obstacles,
            moving,
            contacts,
            barriers,
            hull_barriers,
            time: 0.0,
            named,
            remembered: [f64::INFINITY; REMEMBERED],
        }
    }

    /// What stands still, and what moves or turns, as worlds of their own at t = 0. Allocates.
    #[must_use]
    pub fn parted(&self) -> [Self; 2] {
        [true, false].map(|stands_still| {
            self.only((0..self.len()).filter(|j| self.stands_still(*j) == stands_still))
        })
    }

    /// Whether obstacle `j` rests at time `t` \[s\].
    pub fn rests_at(&self, j: usize, t: f64) -> bool {
        self.obstacles[j].rests_at(t)
    }

    /// The obstacles with these numbers, as a world of their own at t = 0. Allocates.
    ///
    /// # Panics
    /// If there is none of such a number.
    #[must_use]
    pub fn only(&self, numbers: impl IntoIterator<Item = usize>) -> Self {
        let mut obstacles: Vec<Placed<S, D>> =
            numbers.into_iter().map(|j| self.obstacles[j].clone()).collect();
        obstacles.iter_mut().for_each(|obstacle| obstacle.move_to(0.0));
        // Where every one is asked, one may move as no hierarchy is made for.
        let has_broad_phase =
            matches!(self.named, Named::BroadPhase(_)) && obstacles.len() >= broad_phase::LEAST;
        Self::of(obstacles, has_broad_phase)
    }

    /// Number of obstacles. Their indices `j` below run from 0 to `len() − 1`; the methods
    /// that take one panic beyond, as a slice does.
    pub fn len(&self) -> usize {
        self.obstacles.len()
    }

    /// Whether there is no obstacle at all.
    pub fn is_empty(&self) -> bool {
        self.obstacles.is_empty()
    }

    /// Moves all obstacles to time `t` \[s\]. Free of cost when they are there already.
    ///
    /// In a crowd only the obstacles that may be near are moved, when they are asked for.
    pub fn update(&mut self, t: f64) {
        if t.to_bits() == self.time.to_bits() {
            return;
        }
        match &mut self.named {
            Named::BroadPhase(broad_phase) => broad_phase.update(&self.obstacles, self.time, t),
            _ => self.moving.iter().for_each(|&j| self.obstacles[j].move_to(t)),
        }
        self.time = t;
    }

    /// The instant of the last update \[s\]; 0 before the first.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Description of obstacle `j`, as given.
    pub fn obstacle(&self, j: usize) -> &S::Obstacle {
        &self.obstacles[j].description
    }

    /// Whether obstacle `j` neither moves nor turns.
    pub fn stands_still(&self, j: usize) -> bool {
        self.obstacles[j].is_static
    }

    /// A speed that obstacle `j` does not exceed from one time ≥ 0 to another \[s\], with all points of its surface \[m/s\]; if it is
    /// without end, with those that come to a ball of this `center` and `radius` \[m\].
    pub fn top_speed(&self, j: usize, times: [f64; 2], center: Vector<D>, radius: f64) -> f64 {
        self.obstacles[j].top_speed(times, Some((center, radius)))
    }

    /// Of how many convex bodies obstacle `j` is made.
    pub fn bodies(&self, j: usize) -> usize {
        self.obstacles[j].geometry.contacts()
    }

    /// Whether obstacle `j` is one convex body, which has one contact with another.
    pub fn is_convex(&self, j: usize) -> bool {
        self.bodies(j) == 1
    }

    /// Position of obstacle `j` \[m\].
    #[inline]
    pub fn position(&self, j: usize) -> Vector<D> {
        self.obstacles[j].state_at(self.time).position
    }

    /// Where obstacle `j` is at time `t` \[m\]; moves nothing.
    pub fn position_at(&self, j: usize, t: f64) -> Vector<D> {
        self.obstacles[j].state_at(t).position
    }

    /// How obstacle `j` is turned at time `t` \[s\], compared with its description; none if it does not turn.
    pub fn turn_at(&self, j: usize, t: f64) -> Option<Turn<D>> {
        self.obstacles[j].turn_at(t)
    }

    /// Lets go of the motion of obstacle `j` and carries it to `goal` \[m\] from now on, smoothly, with
    /// the pole `rate` \[1/s\]. It turns as before.
    ///
    /// Drags change a motion at any time, which the hierarchy of a crowd is not made for: from
    /// then on every obstacle is asked.
    pub fn carry(&mut self, j: usize, goal: Vector<D>, rate: f64) {
        let obstacle = &mut self.obstacles[j];
        let MotionState { position, velocity, acceleration, .. } = obstacle.state_at(self.time);
        let now = [position, velocity, acceleration];
        let filter = ThirdOrderFilter::new(self.time, now, goal, rate);
        obstacle.set_motion(Motion::Dragged(filter));
        obstacle.is_static = false;
        self.rearrange();
    }

    /// Lets obstacle `j` turn otherwise from now on. In a crowd every obstacle is asked from then on, as after
    /// [`carry`](Self::carry). Allocates.
    pub fn set_turning(&mut self, j: usize, turning: Turning<D>) {
        let obstacle = &mut self.obstacles[j];
        (obstacle.state, obstacle.time) = (obstacle.state_at(self.time), self.time);
        obstacle.turned = Some(Box::new(Turned { now: turning.at(self.time), turning }));
        obstacle.may_be_faster();
        obstacle.is_static = false;
        self.rearrange();
    }

    /// From now on, obstacle `j` is turned as `now` at time `t` \[s\], compared with its description, and goes on so. It moves as
    /// before. Allocates if it has not turned before.
    pub fn turn(&mut self, j: usize, t: f64, now: &Turn<D>) {
        let obstacle = &mut self.obstacles[j];
        (obstacle.state, obstacle.time) = (obstacle.state_at(self.time), self.time);
        match &mut obstacle.turned {
            Some(turned) => {
                turned.turning.go_on(t, now);
                turned.now = turned.turning.at(self.time);
            }
            none => {
                let turning = Turning::from(t, now);
                *none = Some(Box::new(Turned { now: turning.at(self.time), turning }));
            }
        }
        obstacle.may_be_faster();
        obstacle.is_static = false;
        self.rearrange();
    }

    /// From now on, obstacle `j` is at `position` \[m\] at time `t` \[s\] and goes on at `velocity` \[m/s\]. It turns as
    /// before. In a crowd every obstacle is asked from then on, as after [`carry`](Self::carry). Does not allocate;
    /// the first time, what the motion and the broad phase took is freed.
    pub fn place(&mut self, j: usize, t: f64, position: Vector<D>, velocity: Vector<D>) {
        let obstacle = &mut self.obstacles[j];
        obstacle.description.set_position(position - velocity * t);
        obstacle.set_motion(Motion::Linear { velocity: velocity.into() });
        obstacle.state = obstacle.moved_to(self.time);
        obstacle.time = self.time;
        let was_static = replace(&mut obstacle.is_static, false);
        if was_static || matches!(self.named, Named::BroadPhase(_)) {
            self.rearrange();
        } else if let Some(turned) = &mut obstacle.turned {
            turned.now = turned.turning.at(self.time);
        }
    }

    /// From now on nobody finds obstacle `j`: no question for contacts, no ray, no plan. It is there still, and
    /// [`contact`](Self::contact) has it. In a crowd every obstacle is asked from then on. Allocates.
    pub fn hide(&mut self, j: usize) {
        self.obstacles[j].is_hidden = true;
        self.rearrange();
    }

    /// From now on, links are not measured against obstacles that [`ignore`](Description::ignored) them: no question for contacts,
    /// no plan. Rays find them, and [`contact`](Self::contact) has them. And pairs have the margins that obstacles
    /// [say](Description::margin_of). Allocates.
    ///
    /// # Arguments
    /// * `links`: what the links of the arm are called, from the base on.
    pub fn know_links(&mut self, links: &[String]) {
        for obstacle in &mut self.obstacles {
            obstacle.know_links(links);
        }
        self.most_margin = most_margin(&self.obstacles);
        if !matches!(self.named, Named::BroadPhase(_)) {
            self.named = Named::each(&self.obstacles, vec![]);
        }
    }

    /// Whether some obstacle is there and hidden.
    pub fn hides_any(&self) -> bool {
        self.obstacles.iter().any(|obstacle| obstacle.is_hidden && !obstacle.is_future())
    }

    /// Counts obstacle `j` as one of at least so many contacts and barriers: what is allocated by
    /// their number then suffices when it becomes one.
    pub fn make_room(&mut self, j: usize, contacts: usize) {
        let room = &mut self.obstacles[j].room;
        *room = contacts.max(*room);
        [self.contacts, self.barriers, self.hull_barriers] = most_of(&self.obstacles);
    }

    /// As how many contacts and barriers obstacle `j` counts at least.
    pub fn room(&self, j: usize) -> usize {
        self.obstacles[j].room
    }

    /// Adds an obstacle, the last one from now on. Allocates.
    pub fn add(&mut self, obstacle: S::Obstacle) {
        self.obstacles.push(Placed::new(obstacle));
        futures::weigh(&mut self.obstacles);
        self.moving.reserve(self.obstacles.len());
        self.rearrange();
    }

    /// Takes obstacle `j` away; those behind it move up.
    pub fn remove(&mut self, j: usize) {
        self.obstacles.remove(j);
        futures::weigh(&mut self.obstacles);
        self.rearrange();
    }

    /// Does what has to be done when a geometry is not what it was.
    fn reshaped(&mut self) {
        [self.contacts, self.barriers, self.hull_barriers] = most_of(&self.obstacles);
        if let Named::BroadPhase(broad_phase) = &mut self.named {
            broad_phase.renew(&self.obstacles);
        }
    }

    /// Does what has to be done when the obstacles are not what they were. Allocates only when there are
    /// more that move than ever before.
    fn rearrange(&mut self) {
        let room = match take(&mut self.named) {
            Named::Each(numbers) => numbers,
            _ => vec![],
        };
        self.named = Named::each(&self.obstacles, room);
        [self.contacts, self.barriers, self.hull_barriers] = most_of(&self.obstacles);
        self.most_margin = most_margin(&self.obstacles);
        self.list_moving();
        for obstacle in &mut self.obstacles {
            obstacle.move_to(self.time);
        }
    }

    /// Does what has to be done when some obstacle moves that stood, or stands that moved, and is where it is at this time.
    fn moves_otherwise(&mut self) {
        match self.named {
            Named::BroadPhase(_) => self.rearrange(),
            _ => self.list_moving(),
        }
    }

    fn list_moving(&mut self) {
        self.moving.clear();
        self.moving.extend((0..self.obstacles.len()).filter(|&j| !self.obstacles[j].is_static));
    }

    /// Velocity of obstacle `j` \[m/s\].
    #[inline]
    pub fn velocity(&self, j: usize) -> Vector<D> {
        self.obstacles[j].state_at(self.time).velocity
    }

    /// Acceleration of obstacle `j` \[m/s²\].
    #[inline]
    pub fn acceleration(&self, j: usize) -> Vector<D> {
        self.obstacles[j].state_at(self.time).acceleration
    }
}

#[cfg(test)]
mod tests;
