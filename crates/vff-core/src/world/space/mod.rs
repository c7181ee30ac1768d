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
//! A file per pair, where that is not [`geometry`](crate::geometry): axis and `cuboid`, `half_space`, `cloud` of points; a hull that is
//! `carried` by a link, and any of these. A file per question: `barriers`, `rays`, `hierarchy` of boxes around obstacles, `runs` of points.

mod barriers;
mod carried;
mod cloud;
mod cuboid;
mod half_space;
mod hierarchy;
mod obstacle;
#[cfg(test)]
pub(crate) mod oracle;
mod rays;
mod runs;
mod shape;
mod volume;

pub use crate::geometry::{
    HullError, MOST_CORNERS, Probe, check_hull, faces_of_hull, perpendicular,
};
pub use carried::{contact_with_point, distance_of_point};
pub use cloud::{MOST_POINTS, Points};
pub use hierarchy::Boxes;
pub use obstacle::Obstacle;
pub use rays::{cast_at_body, cast_at_hull};
pub use shape::Shape;
pub use volume::Volume;

/// The obstacles of a space.
pub type World = super::World<Volume, 3>;
