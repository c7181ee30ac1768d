//! The obstacles: what they look like, how they move, how near the arm is to them.
//!
//! A scenario describes [`Obstacle`]s. A [`World`] holds them ready for queries: one
//! [`World::update`] per instant, then any number of contacts. Nothing allocates after
//! [`World::new`].

mod contact;
mod motion;
mod obstacle;
mod proximity;
mod shape;

pub use contact::{Contact, Feature};
pub use motion::{Motion, MotionState};
pub use obstacle::Obstacle;
pub use shape::{Shape, counter_clockwise, is_convex};

use crate::math::{Capsule, Vector};
use proximity::Core;

/// What a controller asks of the world around the arm: the nearest points of every link to
/// everything that it knows of.
pub trait Surroundings<const D: usize> {
    /// Calls `distance` with every link's index and its signed distance to everything around [m],
    /// and `visit` with the contacts nearer than `reach` [m].
    fn for_each_contact(
        &self,
        links: impl IntoIterator<Item = Capsule<D>>,
        reach: f64,
        distance: impl FnMut(usize, f64),
        visit: impl FnMut(&Contact<D>),
    );
}

/// The obstacles at one instant.
#[derive(Debug, Clone)]
pub struct World {
    bodies: Vec<Body>,
    /// Indices of the obstacles that are not static: all that an update has to visit.
    moving: Vec<usize>,
    /// The instant that the states belong to [s].
    time: f64,
}

/// An obstacle with what is computed once (`core`) and once per instant (`state`).
#[derive(Debug, Clone)]
struct Body {
    obstacle: Obstacle,
    core: Core,
    state: MotionState,
}

impl Body {
    fn state_at(&self, t: f64) -> MotionState {
        self.obstacle.motion.at(t, Vector::from(self.obstacle.position))
    }
}

impl World {
    /// The given obstacles at t = 0.
    ///
    /// Their values must have been judged before (see [`Shape`] and [`Motion`] for what is
    /// expected): unusable ones do not panic, but distances to them mean nothing.
    pub fn new(obstacles: Vec<Obstacle>) -> Self {
        let bodies: Vec<Body> = obstacles
            .into_iter()
            .map(|obstacle| Body {
                core: Core::new(&obstacle.shape, obstacle.angle),
                state: obstacle.motion.at(0.0, Vector::from(obstacle.position)),
                obstacle,
            })
            .collect();
        let moving =
            (0..bodies.len()).filter(|&j| !bodies[j].obstacle.motion.is_static()).collect();
        Self { bodies, moving, time: 0.0 }
    }

    /// Number of obstacles. Their indices `j` below run from 0 to `len() − 1`; the methods
    /// that take one panic beyond, as a slice does.
    pub fn len(&self) -> usize {
        self.bodies.len()
    }

    /// Whether there is no obstacle at all.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// Moves all obstacles to time `t` [s]. Free of cost when they are there already.
    pub fn update(&mut self, t: f64) {
        // Compared as bits: only the very same instant may be skipped.
        if t.to_bits() == self.time.to_bits() {
            return;
        }
        self.time = t;
        for &j in &self.moving {
            self.bodies[j].state = self.bodies[j].state_at(t);
        }
    }

    /// The instant of the last update [s]; 0 before the first.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Description of obstacle `j`, as given.
    pub fn obstacle(&self, j: usize) -> &Obstacle {
        &self.bodies[j].obstacle
    }

    /// Position of obstacle `j` [m].
    #[inline]
    pub fn position(&self, j: usize) -> Vector<2> {
        self.bodies[j].state.position
    }

    /// Velocity of obstacle `j` [m/s].
    #[inline]
    pub fn velocity(&self, j: usize) -> Vector<2> {
        self.bodies[j].state.velocity
    }

    /// Acceleration of obstacle `j` [m/s²].
    #[inline]
    pub fn acceleration(&self, j: usize) -> Vector<2> {
        self.bodies[j].state.acceleration
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(position: [f64; 2], motion: Motion) -> Obstacle {
        Obstacle { shape: Shape::Circle { radius: 0.5 }, position, angle: 0.0, motion }
    }

    #[test]
    fn update_moves_what_moves() {
        let velocity = [1.0, -2.0];
        let mut world = World::new(vec![
            disc([1.0, 1.0], Motion::default()),
            disc([0.0, 3.0], Motion::Linear { velocity }),
        ]);
        assert_eq!(world.len(), 2);
        assert!(!world.is_empty());
        assert_eq!(world.position(1), Vector::<2>::new(0.0, 3.0));
        assert_eq!(world.velocity(1), Vector::from(velocity));
        world.update(2.0);
        assert_eq!(world.time().to_bits(), 2f64.to_bits());
        assert_eq!(world.position(0), Vector::<2>::new(1.0, 1.0));
        assert_eq!(world.velocity(0), Vector::<2>::zeros());
        assert_eq!(world.position(1), Vector::<2>::new(2.0, -1.0));
        assert_eq!(world.acceleration(1), Vector::<2>::zeros());
        assert_eq!(world.obstacle(1).shape, Shape::Circle { radius: 0.5 });
        world.update(0.0);
        assert_eq!(world.position(1), Vector::<2>::new(0.0, 3.0));
    }

    #[test]
    fn all_pairs_are_visited_in_order() {
        let mut world = World::new(vec![
            disc([0.0, 2.0], Motion::Linear { velocity: [0.0, 1.0] }),
            disc([2.0, -1.0], Motion::default()),
        ]);
        world.update(1.0);
        let joints = [[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]].map(Vector::<2>::from);
        let links = joints.windows(2).map(|pair| Capsule::new(pair[0], pair[1], 0.1));
        let (mut found, mut distances) = (Vec::new(), Vec::new());
        world.for_each_contact(
            links.clone(),
            f64::INFINITY,
            |link, distance| distances.push((link, distance)),
            |contact| found.push(*contact),
        );
        let pairs: Vec<_> = found.iter().map(|c| (c.link, c.obstacle)).collect();
        assert_eq!(pairs, [(0, 0), (0, 1), (1, 0), (1, 1)]);
        for (contact, distance) in found.iter().zip(distances) {
            assert_eq!((contact.link, contact.distance), distance);
            let capsule = links.clone().nth(contact.link).unwrap();
            assert_eq!(*contact, world.contact(contact.link, &capsule, contact.obstacle));
        }
        assert!((found[0].distance - 2.4).abs() < 1e-15);
        assert_eq!(found[0].velocity, Vector::<2>::new(0.0, 1.0));
        assert!((found[3].distance - 0.4).abs() < 1e-15);
        assert_eq!(found[3].normal, Vector::<2>::new(0.0, 1.0));
    }
}
