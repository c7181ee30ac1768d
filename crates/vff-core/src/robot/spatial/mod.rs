//! A serial arm of `n` joints in space, every operator in O(n).
//!
//! All recursions run in one common frame: world axes, origin at the robot's base. Twists and
//! wrenches of all links are then added as they are; nothing is transformed from link to link. The
//! position of the base in the world is added outside of them, for their accuracy falls with the
//! square of the distance from the origin (docs/theory-spatial.md).

mod algebra;
mod arm;
#[cfg(test)]
pub(crate) mod cases;
pub mod dense;
mod joint;
mod kinematics;
mod mobility;
mod operators;
mod state;
mod task;

pub use algebra::Spatial;
pub use arm::SpatialArm;
pub use mobility::Mobility;
pub use state::SpatialState;
