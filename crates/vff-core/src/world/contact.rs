//! The nearest pair of points between a body of the robot and an obstacle.

use super::Spin;
use crate::math::Vector;

/// Where a body of the robot and an obstacle come nearest, in the world frame.
///
/// Moving the link by a small δ changes `distance` by `normal · δ`, outside and inside the
/// obstacle alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact<const D: usize> {
    /// Index of the body of the robot.
    pub body: usize,
    /// Index of the link that carries it, from 0 at the base.
    pub link: usize,
    /// Index of the obstacle.
    pub obstacle: usize,
    /// Signed distance between the two surfaces \[m\], negative when they overlap.
    pub distance: f64,
    /// Unit vector from the obstacle towards the link: the shortest way out.
    pub normal: Vector<D>,
    /// Point of the link's axis nearest to the obstacle \[m\]: where a repulsion acts.
    pub point: Vector<D>,
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pair {
    /// Index of the body.
    pub body: usize,
    /// Index of the link that carries it.
    pub link: usize,
    /// Index of the obstacle.
    pub obstacle: usize,
}

impl<const D: usize> Contact<D> {
    /// What meets here.
    #[inline]
    pub fn pair(&self) -> Pair {
        let Self { body, link, obstacle, .. } = *self;
        Pair { body, link, obstacle }
    }
}

/// The features of the link's axis and of the obstacle that are nearest. The obstacle counts without
/// its radius: a circle or a sphere as its centre, a capsule as a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Feature<const D: usize> {
    /// The inside of the axis and a point of the obstacle (a centre or a corner): the normal turns
    /// with the link.
    Side {
        /// Signed distance of the axis from that point \[m\].
        distance: f64,
    },
    /// An end of the axis and a point of the obstacle: the normal points from one to the other.
    End {
        /// Their distance \[m\], > 0.
        distance: f64,
    },
    /// An end of the axis and a flat face of the obstacle: the normal is that of the face.
    Face,
    /// An end of the axis and the inside of a straight edge of the obstacle; in space only.
    Edge {
        /// Unit vector along the edge.
        edge: Vector<D>,
        /// Their distance \[m\], > 0.
        distance: f64,
    },
    /// The insides of the axis and of a straight edge of the obstacle, which are not parallel: the normal
    /// is across both; in space only.
    Crossing {
        /// Unit vector along the edge.
        edge: Vector<D>,
        /// Signed distance of the two lines along the normal \[m\].
        distance: f64,
    },
}
