//! What could be done: a motion to a goal before anything moves, and what those could have done who know the future.

pub mod feasibility;
pub mod motion;
pub mod replanning;
