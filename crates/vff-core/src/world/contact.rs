//! The nearest pair of points between a body of the robot and an obstacle.

use super::{PairMargin, Spin};
use crate::math::{Feature, Vector};

/// Where a body of the robot and an obstacle come nearest, in the world frame.
///
/// Moving the link by a small δ changes `distance` by `normal · δ`, outside and inside the
/// obstacle alike.
///
/// # Example
/// ```
/// use vff_core::geometry::{Body, Shape};
/// use vff_core::math::{Capsule, Vector};
/// use vff_core::world::space::{Obstacle, World};
/// use vff_core::world::{Contact, Motion};
///
/// let ball = Obstacle {
///     position: [0.0, 0.5, 0.2],
///     motion: Motion::Linear { velocity: [0.0, -0.3, 0.0] },
///     ..Obstacle::of(Shape::Sphere { radius: 0.1 })
/// };
/// let link = Capsule::new(Vector::<3>::zeros(), Vector::<3>::new(0.0, 0.0, 0.4), 0.05);
/// let Contact { distance, normal, velocity, .. } = World::new(vec![ball]).contact(0, &Body::new(0, link), 0);
/// assert!((distance - 0.35).abs() < 1e-15);
/// assert_eq!(normal, Vector::<3>::new(0.0, -1.0, 0.0)); // from the obstacle to the link
/// assert_eq!(velocity, Vector::<3>::new(0.0, -0.3, 0.0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact<const D: usize> {
    /// Index of the body of the robot.
    pub body: usize,
    /// Index of the link that carries it, from 0 at the base.
    pub link: usize,
    /// Index of the obstacle.
    pub obstacle: usize,
    /// What the two keep.
    pub margin: PairMargin,
    /// Signed distance between the two surfaces \[m\], negative when they overlap.
    pub distance: f64,
    /// Unit vector from the obstacle towards the link: the shortest way out.
    pub normal: Vector<D>,
    /// Point of the link's axis nearest to the obstacle \[m\], of a hull that of its surface: where a repulsion acts.
    pub point: Vector<D>,
    /// Unit vector along that axis, or along the edge of a hull on which the point lies; zero where it lies on none.
    pub axis: Vector<D>,
    /// Point of the obstacle's surface nearest to the link \[m\].
    pub witness: Vector<D>,
    /// Velocity of the obstacle at the witness \[m/s\].
    pub velocity: Vector<D>,
    /// Acceleration of the obstacle at the witness \[m/s²\].
    pub acceleration: Vector<D>,
    /// How the obstacle turns.
    pub spin: Spin<D>,
    /// What meets what: how the normal turns when the two move.
    pub feature: Feature<D>,
}

/// What meets: a body of the robot and an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pair {
    /// Index of the body.
    pub body: usize,
    /// Index of the link that carries it.
    pub link: usize,
    /// Index of the obstacle.
    pub obstacle: usize,
    /// What the two keep.
    pub margin: PairMargin,
}

impl<const D: usize> Contact<D> {
    /// What meets here.
    #[inline]
    pub fn pair(&self) -> Pair {
        let Self { body, link, obstacle, margin, .. } = *self;
        Pair { body, link, obstacle, margin }
    }
}
