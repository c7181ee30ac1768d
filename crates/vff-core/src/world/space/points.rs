//! Clouds whose points are replaced.

use super::shape::Core;
use super::shape::cloud::Cloud;
use super::{Obstacle, Shape, World};
use crate::math::UnitQuaternion;
use std::mem::{replace, swap};
use std::sync::Arc;

/// Points that are ready to take the place of those of a cloud. They are made beside the world that they are for, which
/// takes them in at once: [`World::swap_points`].
///
/// # Example
/// ```
/// use vff_core::geometry::Shape;
/// use vff_core::world::space::{Obstacle, Points, World};
///
/// let upright = [1.0, 0.0, 0.0, 0.0];
/// let cloud = Obstacle {
///     position: [0.5, 0.0, 0.0],
///     ..Obstacle::of(Shape::Points { points: vec![[0.0; 3]], radius: 0.02 })
/// };
/// let mut world = World::new(vec![cloud]);
/// // Made beside the loop, swapped in within it.
/// let mut seen = Points::new(vec![[0.0; 3], [0.0, 0.1, 0.0]], upright);
/// assert!(world.swap_points(0, &mut seen));
/// assert_eq!(seen.len(), 1); // the old ones
/// ```
#[derive(Debug, Clone)]
pub struct Points {
    pub(super) given: Vec<[f64; 3]>,
    orientation: [f64; 4],
    cloud: Arc<Cloud>,
    since: Option<f64>,
}

impl Points {
    /// For a cloud with this `orientation`.
    ///
    /// # Arguments
    /// * `given`: the points \[m\], relative to its position; finite, at most [`MAX_POINTS`](super::MAX_POINTS).
    pub fn new(given: Vec<[f64; 3]>, orientation: [f64; 4]) -> Self {
        Self::moving(given, &[], None, orientation)
    }

    /// The same, of points that go on at velocities of their own (T180).
    ///
    /// # Arguments
    /// * `velocities`: one each \[m/s\], in the frame of the points; finite. Others than as many are none: all rest.
    /// * `since`: when they are where they are given \[s\]; without, when they are swapped in.
    ///
    /// # Example
    /// ```
    /// use vff_core::geometry::{Body, Shape};
    /// use vff_core::math::{Capsule, Vector};
    /// use vff_core::world::space::{Obstacle, Points, World};
    ///
    /// let upright = [1.0, 0.0, 0.0, 0.0];
    /// let cloud = Obstacle {
    ///     ..Obstacle::of(Shape::Points { points: vec![], radius: 0.1 })
    /// };
    /// let mut world = World::new(vec![cloud]);
    /// // Seen 0.5 s ago, and on its way to the link.
    /// let mut seen = Points::moving(vec![[0.0, 2.0, 0.0]], &[[0.0, -1.0, 0.0]], Some(-0.5), upright);
    /// world.swap_points(0, &mut seen);
    /// let link = Capsule::new(Vector::<3>::zeros(), Vector::<3>::new(1.0, 0.0, 0.0), 0.05);
    /// let contact = world.contact(0, &Body::new(0, link), 0);
    /// assert!((contact.distance - 1.35).abs() < 1e-15);
    /// assert_eq!(contact.velocity, Vector::<3>::new(0.0, -1.0, 0.0));
    /// world.update(1.0);
    /// assert!((world.contact(0, &Body::new(0, link), 0).distance - 0.35).abs() < 1e-15);
    /// ```
    pub fn moving(
        given: Vec<[f64; 3]>,
        velocities: &[[f64; 3]],
        since: Option<f64>,
        orientation: [f64; 4],
    ) -> Self {
        let turn = UnitQuaternion::new(orientation).unwrap_or_default();
        Self { cloud: Arc::new(Cloud::new(&given, velocities, &turn)), given, orientation, since }
    }

    /// The orientation that they were made for.
    pub fn orientation(&self) -> [f64; 4] {
        self.orientation
    }

    /// When they are where they are given \[s\]; none for when they are swapped in.
    pub fn since(&self) -> Option<f64> {
        self.since
    }

    /// Says so by another clock \[s\].
    pub fn set_since(&mut self, since: Option<f64>) {
        self.since = since;
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.given.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.given.is_empty()
    }
}

impl World {
    /// Exchanges the points of cloud `j` for others, which are then the old ones: it stays where it is, moves as before, and
    /// keeps its radius. False if obstacle `j` is no cloud. Does not allocate, but where points move for the first time in a
    /// crowd, of which every obstacle is asked from then on.
    pub fn swap_points(&mut self, j: usize, points: &mut Points) -> bool {
        let time = self.time;
        let placed = &mut self.obstacles[j];
        let Obstacle { shape: Shape::Points { points: given, .. }, .. } = &mut placed.description
        else {
            return false;
        };
        let Core::Cloud(cloud) = &mut placed.geometry.core else { return false };
        swap(given, &mut points.given);
        swap(cloud, &mut points.cloud);
        placed.since = points.since.replace(placed.since).unwrap_or(time);
        placed.may_be_faster();
        let stands_still = placed.stands_still();
        let was_static = replace(&mut placed.is_static, stands_still);
        placed.move_to(time);
        placed.state.elapsed = time - placed.since;
        if stands_still != was_static {
            self.moves_otherwise();
        }
        self.reshaped();
        true
    }
}
