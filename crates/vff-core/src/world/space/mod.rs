//! Obstacles in space.
//!
//! As in the [plane](super::plane), a link is queried as its axis and an obstacle as its *core*: what remains when the
//! radius is taken away (sphere → point, capsule → segment, box, hull and half-space → themselves). The radii are subtracted
//! afterwards. Where the axis itself meets the core, the distance is minus the penetration depth: the shortest
//! translation of the link that frees it.
//!
//! Distances are exact to rounding, all in closed form (T92–T95, T107, T122). parry's general routines are not used, for the
//! reasons given there; its hierarchy of boxes ([`Boxes`]) finds what is near among many.
//!
//! `shape` has what becomes of the list of shapes, its one dispatch, and a file for each with all its answers. A file per question that is
//! put to any of them: `barriers`, `link_hull_query` (a hull that a link carries), `hierarchy` of boxes around obstacles;
//! `point_bvh` is around points, of which `needed_points` says which ones a program needs.

mod barriers;
mod contact;
mod geometry;
mod hierarchy;
mod link_hull_query;
mod needed_points;
mod obstacle;
#[cfg(test)]
pub(crate) mod oracle;
mod point_bvh;
mod points;
mod rays;
mod shape;
#[cfg(test)]
mod tests;

pub use crate::geometry::{
    HullError, MAX_CORNERS, MAX_POINTS, Probe, Shape, check_hull, faces_of_hull, perpendicular,
};
pub use geometry::SpatialGeometry;
pub use hierarchy::Boxes;
pub use link_hull_query::{contact_with_point, distance_of_point};
pub use obstacle::Obstacle;
pub use points::Points;
pub use rays::{cast_at_body, cast_at_hull};

/// The obstacles of a space.
pub type World = super::World<SpatialGeometry, 3>;
