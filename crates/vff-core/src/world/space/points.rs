//! Clouds whose points are replaced.

use super::shape::Core;
use super::shape::cloud::Cloud;
use super::{Obstacle, Shape, World};
use crate::math::UnitQuaternion;
use std::mem::swap;
use std::sync::Arc;

/// Points that are ready to take the place of those of a cloud. They are made beside the world that they are for, which
/// takes them in at once: [`World::swap_points`].
///
/// # Example
/// ```
/// use vff_core::geometry::Shape;
/// use vff_core::world::Motion;
/// use vff_core::world::space::{Obstacle, Points, World};
///
/// let upright = [1.0, 0.0, 0.0, 0.0];
/// let cloud = Obstacle {
///     shape: Shape::Points { points: vec![[0.0; 3]], radius: 0.02 },
///     position: [0.5, 0.0, 0.0],
///     orientation: upright,
///     angular_velocity: [0.0; 3],
///     motion: Motion::Static {},
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
}

impl Points {
    /// For a cloud with this `orientation`.
    ///
    /// # Arguments
    /// * `given`: the points \[m\], relative to its position; finite, at most [`MAX_POINTS`](super::MAX_POINTS).
    pub fn new(given: Vec<[f64; 3]>, orientation: [f64; 4]) -> Self {
        let turn = UnitQuaternion::new(orientation).unwrap_or_default();
        Self { cloud: Arc::new(Cloud::new(&given, &turn)), given, orientation }
    }

    /// The orientation that they were made for.
    pub fn orientation(&self) -> [f64; 4] {
        self.orientation
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
    /// keeps its radius. False if obstacle `j` is no cloud. Does not allocate.
    pub fn swap_points(&mut self, j: usize, points: &mut Points) -> bool {
        let placed = &mut self.obstacles[j];
        let Obstacle { shape: Shape::Points { points: given, .. }, .. } = &mut placed.description
        else {
            return false;
        };
        let Core::Cloud(cloud) = &mut placed.solid.core else { return false };
        swap(given, &mut points.given);
        swap(cloud, &mut points.cloud);
        self.reshaped();
        true
    }
}
