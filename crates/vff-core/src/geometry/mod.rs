//! The shapes that links carry, and where they come nearest to axes and to each other.
//!
//! What is here knows neither robots nor obstacles, and does not move: both sides use it. A file per pair: an `axis`, which is what
//! remains of a capsule without its radius, and a `point`, a `segment` or a `hull`; a hull and anything convex, their `meeting`; two
//! bodies of an arm, their `encounter`.

pub(crate) mod axis;
mod body;
mod encounter;
mod fewest;
mod hull;
mod meeting;
pub(crate) mod point;
pub(crate) mod segment;

pub use axis::{Probe, perpendicular};
pub use body::{Body, Carried, StillBody};
pub use encounter::{Encounter, encounter};
pub(crate) use fewest::Fewest;
pub use hull::{Hull, HullError, MOST_CORNERS, check_hull, faces_of_hull};
pub(crate) use meeting::{Convex, MOST_ROWS, Meeting, Onward, averted};
