//! Scenarios that run: one or many, against the clock, while people interact with them, or step by step for an
//! agent that learns.

pub mod arm;
#[cfg(feature = "parallel")]
pub mod batch;
pub mod controller;
#[cfg(feature = "realtime")]
mod drag;
#[cfg(feature = "realtime")]
pub mod drive;
pub mod episode;
#[cfg(any(feature = "parallel", feature = "realtime"))]
mod fault;
mod inverse_kinematics;
#[cfg(feature = "realtime")]
pub mod live;
mod load;
mod observation;
pub mod obstacles;
mod perceiver;
pub mod points;
mod prepare;
#[cfg(feature = "realtime")]
pub mod real_time;
pub mod run;
#[cfg(feature = "parallel")]
pub mod vector;
pub mod virtual_arm;
pub mod wrenches;

pub use arm::{AnyArm, AnyState, DistanceTable};
pub use controller::{
    AnyController, CycleError, ErasedController, MissedStart, Reading, SuccessionError, Target,
};
pub use obstacles::AnyObstacles;
pub use perceiver::read_perceiver;
pub use points::PointsError;
pub use prepare::{Ready, check};
pub use run::{AnyRun, ErasedRun};
pub use virtual_arm::{Course, SetPointLimits, VirtualArm, VirtualArmError};
pub use wrenches::{ActingPull, ActingWrench, wrenches_along};
