//! From state and contacts to joint torque.
//!
//! [`ReactiveController`] strings the parts together: [`operational_space`] (Λ and the null projector),
//! [`virtual_forces`] (the field's push), [`task`] (what acceleration the end effector should
//! have), [`law`] or [`extended_jacobian`] (which torque does all of it) and [`avoidance`] (what gives way
//! where that is not enough); [`observer`] estimates what its model does not know, [`detection`] tells contacts from the rest of that,
//! [`reaction`] yields to them and [`force`] presses on them. [`Controller`] is what to use: the same, with look-ahead if the settings ask for it.
//! [`output`] is what stands between its torque and a robot.

pub mod avoidance;
mod controller;
pub mod deadline;
pub mod detection;
pub mod distance;
pub mod energy;
pub mod extended_jacobian;
pub mod force;
mod gains;
pub mod law;
pub mod limits;
pub mod metric;
mod motion_limits;
mod moving_posture;
pub mod observer;
pub mod operational_space;
pub mod output;
mod push_of_many;
pub mod quadratic_program;
pub mod reaction;
pub mod sampling;
pub mod settings;
mod soft_posture;
pub mod tank;
pub mod task;
pub mod torque_range;
pub mod virtual_forces;

pub(crate) use avoidance::barrier::speed_shares;
pub use avoidance::preview::SelfMotionMap;
pub use controller::{Controller, ReactiveController};
pub use deadline::{Budget, Deadline, LeftOut};
pub use energy::{Energy, Power};
pub use gains::{Gains, NullDamping};
pub use law::{Law, Torque};
pub use limits::ObjectiveScale;
pub use metric::TaskMetric;
pub use motion_limits::MotionLimits;
pub use operational_space::OperationalSpace;
pub use output::Output;
pub use sampling::{StablePeriod, Unstable};
pub use settings::{
    Avoidance, CommandSettings, Formulation, Gravity, Part, PreviewSettings, Projection,
    SelfCollision, SelfMotionSettings, Settings, TaskKind, Yielding,
};
pub use tank::Tank;
pub use torque_range::TorqueRange;
pub use virtual_forces::VirtualForces;
