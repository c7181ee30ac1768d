//! What meets what where two things come nearest.

use super::Vector;

/// The features of the link's axis (of a hull one of its edges) and of the obstacle that are nearest. The obstacle counts without
/// its radius: a circle or a sphere as its centre, a capsule as a segment.
///
/// # Example
/// ```
/// use vff_core::math::{Capsule, Feature, Vector};
/// use vff_core::world::{CollisionQuery, Pair};
/// use vff_core::geometry::Body;
/// use vff_core::world::plane::{Obstacle, Shape, World};
///
/// let disc = Obstacle {
///     position: [0.5, 0.4],
///     ..Obstacle::of(Shape::Circle { radius: 0.1 })
/// };
/// let link = Capsule::new(Vector::<2>::zeros(), Vector::<2>::new(1.0, 0.0), 0.05);
/// let contact = World::new(vec![disc]).contact(0, &Body::new(0, link), 0);
/// assert_eq!(contact.pair(), Pair::default());
/// assert!((contact.distance - 0.25).abs() < 1e-15);
/// assert!(matches!(contact.feature, Feature::Side { .. })); // beside the link, before neither of its ends
/// ```
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
    /// A point of the obstacle (a centre, an end or a corner) and a flat face of the link: the normal is against that of the
    /// face and turns with the link; in space only.
    LinkFace {
        /// Signed distance of that point from the face \[m\].
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
