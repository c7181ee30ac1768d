//! Scenarios that run: one or many, against the clock, while people interact with them, or step by step for an
//! agent that learns.

pub mod any;
pub mod arm;
#[cfg(feature = "parallel")]
pub mod batch;
pub mod controller;
#[cfg(all(feature = "parallel", feature = "realtime"))]
mod drag;
#[cfg(all(feature = "parallel", feature = "realtime"))]
pub mod drive;
pub mod episode;
#[cfg(all(feature = "parallel", feature = "realtime"))]
pub mod live;
pub mod obstacles;
pub mod points;
#[cfg(feature = "realtime")]
pub mod real_time;
#[cfg(feature = "parallel")]
pub mod vector;
pub mod virtual_arm;

pub use any::{AnyRun, Ready};
pub use arm::{AnyArm, AnyState, DistanceTable};
pub use controller::{AnyController, CycleError, Reading, Target};
pub use obstacles::AnyObstacles;
pub use points::PointsError;
pub use virtual_arm::{Course, SetPointLimits, VirtualArm, VirtualArmError};
