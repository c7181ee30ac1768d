//! Torque-level obstacle avoidance for redundant robot arms.
//!
//! Virtual force fields push every link away from moving obstacles; the push acts through a
//! dynamically consistent null-space projection, so the end effector feels nothing of it.
//!
//! Arrows run one way: `runtime → scenario → simulation → control → {field, robot, world, trajectory} → math`.
#![forbid(unsafe_code)]

pub mod control;
pub mod field;
pub mod math;
pub mod planning;
pub mod robot;
pub mod runtime;
pub mod scenario;
pub mod simulation;
#[cfg(test)]
mod testing;
pub mod trajectory;
pub mod world;
