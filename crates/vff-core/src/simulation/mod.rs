//! The closed loop over time: plant, controller, world, record and metrics.

mod closed_loop;
mod integrator;
mod metrics;
mod options;
pub mod pace;
mod recorder;
mod run;
mod snapshot;

pub use closed_loop::ClosedLoop;
pub use metrics::{METRICS, Metric, Metrics, Value};
pub use options::{Control, Integrator, Options};
pub use recorder::{MAX_BYTES, Record, RecordTooLarge};
pub use run::{Outcome, Run, Status};
pub use snapshot::Snapshot;
