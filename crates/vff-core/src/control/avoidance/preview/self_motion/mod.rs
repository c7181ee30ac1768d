//! The search of the self-motion (T172–T175): where the task leaves one degree of freedom, the configurations that hold it are a
//! curve, and the best way along it among moving obstacles is found exactly, on a grid of postures and instants.
//!
//! - `task_projection`: onto the task by Newton's method, and along it.
//! - `grid`: the postures along the self-motion, now and later, and their distances to the predicted obstacles.
//! - `cost`: what a path costs by these.
//! - `cheapest_path`: dynamic programming on that grid.
//! - `search`: how this is spread over control cycles, and what is followed.
//! - `map`: what of it can be looked at.

mod cheapest_path;
mod cost;
mod grid;
mod map;
mod search;
mod task_projection;

pub use map::SelfMotionMap;
pub(super) use search::SelfMotion;
