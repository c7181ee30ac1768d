//! Scenarios that run: one or many, against the clock, while people interact with them, or step by step for an
//! agent that learns.

pub mod any;
pub mod arm;
#[cfg(feature = "parallel")]
pub mod batch;
pub mod controller;
pub mod episode;
#[cfg(all(feature = "parallel", feature = "realtime"))]
pub mod live;
pub mod obstacles;
pub mod points;
#[cfg(feature = "realtime")]
pub mod real_time;
#[cfg(feature = "parallel")]
pub mod vector;

pub use any::{AnyRun, Ready};
pub use arm::{AnyArm, AnyState, DistanceTable};
pub use controller::{AnyController, Target};
pub use obstacles::AnyObstacles;
pub use points::PointsError;
