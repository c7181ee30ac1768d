//! Obstacles in space: the only directory that names parry3d.
//!
//! As in the [plane](super::plane), a link is queried as its axis and an obstacle as its *core*: what remains when the
//! radius is taken away (sphere → point, capsule → segment, box, hull and half-space → themselves). The radii are subtracted
//! afterwards. Where the axis itself meets the core, the distance is minus the penetration depth: the shortest
//! translation of the link that frees it.
//!
//! Distances are exact to rounding, all in closed form (T92–T95, T107). parry's general routines are not used, for the
//! reasons given there; its hierarchy of boxes ([`Boxes`]) finds what is near among many.
//!
//! A file per pair: axis and `point`, `segment`, `cuboid`, `hull`, `half_space`, `cloud` of points. A file per question: `barriers`, `rays`,
//! `hierarchy` of boxes around obstacles, `runs` of points.

mod axis;
mod barriers;
mod cloud;
mod cuboid;
mod half_space;
mod hierarchy;
mod hull;
mod obstacle;
#[cfg(test)]
pub(super) mod oracle;
mod point;
mod rays;
mod runs;
mod segment;
mod shape;
mod volume;

pub use axis::{Probe, perpendicular};
pub use cloud::{MOST_POINTS, Points};
pub use hierarchy::Boxes;
pub use hull::{HullError, MOST_CORNERS, check_hull, faces_of_hull};
pub use obstacle::Obstacle;
pub use point::contact_with_point;
pub use rays::cast_at_body;
pub use shape::Shape;
pub use volume::Volume;

/// The obstacles of a space.
pub type World = super::World<Volume, 3>;
