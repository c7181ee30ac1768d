//! The nearest pair of points between a link and an obstacle.

use crate::math::Vector;

/// Where one link and one obstacle come nearest, in the world frame.
///
/// Moving the link by a small δ changes `distance` by `normal · δ`, outside and inside the
/// obstacle alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact<const D: usize> {
    /// Index of the link, from 0 at the base.
    pub link: usize,
    /// Index of the obstacle.
    pub obstacle: usize,
    /// Signed distance between the two surfaces [m], negative when they overlap.
    pub distance: f64,
    /// Unit vector from the obstacle towards the link: the shortest way out.
    pub normal: Vector<D>,
    /// Point of the link's axis nearest to the obstacle [m]: where a repulsion acts.
    pub point: Vector<D>,
    /// Point of the obstacle's surface nearest to the link [m].
    pub witness: Vector<D>,
    /// Velocity of the obstacle at the witness [m/s].
    pub velocity: Vector<D>,
    /// Acceleration of the obstacle at the witness [m/s²].
    pub acceleration: Vector<D>,
}
