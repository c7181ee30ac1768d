//! Obstacles in the plane: the only directory that names parry2d and glam.
//!
//! A link is queried as its axis and an obstacle as its *core*: what remains when the radius
//! is taken away (circle → point, capsule → segment, box and polygon → themselves). The radii
//! are subtracted afterwards, so the direction survives their overlap until the axis itself
//! meets the core. Beyond that the distance is minus the penetration depth: the shortest
//! translation of the link that frees it.
//!
//! Distances are exact to rounding. In the plane, two convex bodies that do not overlap are
//! nearest at a vertex of one of them; if they overlap, the shortest way out is along a normal
//! of one of them. Both need only projections of points. Points and segments, by far the most
//! frequent, have closed forms. parry's general routines are not used: GJK has no direction at
//! contact, EPA allocates, and segment–segment errs by 3e-8 m on nearly parallel segments. Its
//! hierarchy of boxes (`hierarchy`) finds what is near among many.
//!
//! A file per pair: axis and `point`, `segment`, `convex` polygon. A file per question:
//! `barriers`, `rays`, `hierarchy`.

mod axis;
mod barriers;
mod convex;
mod face;
mod geometry;
mod hierarchy;
mod obstacle;
#[cfg(test)]
pub(super) mod oracle;
mod point;
mod rays;
mod segment;
mod shape;

pub use axis::Probe;
pub use geometry::PlanarGeometry;
pub use hierarchy::Boxes;
pub use obstacle::Obstacle;
pub use shape::{Shape, counter_clockwise, is_convex};

use crate::math::Vector;
use parry2d_f64::math::Vector as Vec2;

/// The obstacles of a plane.
pub type World = super::World<PlanarGeometry, 2>;

#[inline]
fn to_glam(v: Vector<2>) -> Vec2 {
    Vec2::new(v.x, v.y)
}

#[inline]
fn from_glam(v: Vec2) -> Vector<2> {
    Vector::<2>::new(v.x, v.y)
}
