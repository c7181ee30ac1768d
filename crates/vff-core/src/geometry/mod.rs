//! The shapes of bodies, and where they come nearest to axes and to each other.
//!
//! What is here knows neither robots nor obstacles, and does not move: both sides use it. `shape` has the one list of shapes in space,
//! and `shape_fault` what can be wrong with one. A file per pair: an `axis`, which is what
//! remains of a capsule without its radius, and a `point`, a `segment` or a `hull`; a hull and anything
//! convex, `convex_hull_query`, or how far these are apart at least, `gap`; two bodies of an arm, their `contact_features`.

pub(crate) mod axis;
mod body;
#[cfg(test)]
pub(crate) mod cases;
mod contact_features;
mod convex_hull_query;
mod directions;
mod gap;
mod hull;
mod k_smallest;
pub(crate) mod point;
pub(crate) mod segment;
mod shape;
mod shape_fault;

pub use axis::{Probe, perpendicular};
pub use body::{Body, PlacedHull, StillBody};
pub(crate) use contact_features::Form;
pub use contact_features::{ContactFeature, contact_features};
pub(crate) use convex_hull_query::{Convex, HullContact, MAX_FEATURES, Onward, averted};
pub(crate) use directions::{GOLDEN_ANGLE, directions};
pub(crate) use gap::gap_between;
pub use hull::{Hull, HullError, MAX_CORNERS, check_hull, faces_of_hull};
pub(crate) use hull::{box_around, extent};
pub(crate) use k_smallest::KSmallest;
pub(crate) use shape::WithKind;
pub use shape::{MAX_POINTS, Shape};
pub use shape_fault::ShapeFault;
