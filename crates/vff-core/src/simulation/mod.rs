//! The closed loop over time: plant, controller, world, record and metrics.

mod actuator;
mod chatter;
mod closed_loop;
mod contact;
mod impulses;
mod integrator;
mod measurement;
mod metrics;
mod options;
mod output_stage;
#[cfg(feature = "realtime")]
pub mod pace;
mod perception;
mod plane;
mod plant;
mod pull;
mod recorder;
mod replanning;
mod run;
mod snapshot;
mod space;
mod system;
mod wrench;
mod wrenches;

pub use actuator::{Actuator, ActuatorSettings};
pub use closed_loop::{ClosedLoop, Reality};
pub use contact::{ContactSettings, hide_unseen};
pub use measurement::{Measurement, MeasurementSettings};
pub use metrics::{METRICS, Metric, Metrics, Value};
pub use options::{Control, Integrator, Options};
pub use perception::{
    Camera, DepthPicture, Kind as PerceptionKind, MAX_READINGS, MAX_STEPS, Perceive, Perception,
    PerceptionSettings, SpatialPerception,
};
pub use plane::{PlanarSystem, Plane};
pub use plant::Physics;
pub use pull::Pull;
pub use recorder::{Array, MAX_BYTES, Record, RecordTooLarge, Sizes, orientation_width};
pub use replanning::{Moment, Reason, Replan, ReplanCounts, ReplanSettings, Replanned};
pub use run::{Outcome, Run, Status};
pub use snapshot::Snapshot;
pub use space::Space;
pub use system::{SpaceTypes, System};
pub use wrench::{Acting, Axes, MAX_WRENCHES, Profile, TIP, Torque, Wrench};
pub use wrenches::Wrenches;
