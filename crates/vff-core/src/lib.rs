//! Torque-level obstacle avoidance for redundant arms.
#![forbid(unsafe_code)]

pub mod math;
pub mod trajectory;
pub mod world;
