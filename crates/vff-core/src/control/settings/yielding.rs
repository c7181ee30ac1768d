//! What can be set on how the end effector gives way.

use super::PreviewSettings;
use crate::settings::settings;
use serde::{Deserialize, Serialize};

settings! {
    /// How the end effector yields: the `[controller.yielding]` table of a scenario.
    pub struct Yielding {
        /// The distance to be kept.
        margin: f64 = 0.02, "m", POSITIVE, "priority, cbf";
        /// The k of e^(-kt), the fastest decay of a distance to the margin; joint limits likewise; none: 20 in priority, 40 in cbf.
        rate: Option<f64> = None, "1/s", POSITIVE, "priority, cbf";
        /// Nearer than this the task gives way altogether.
        inner: f64 = 0.05, "m", NOT_NEGATIVE, "relaxed, priority";
        /// Farther than this it does not; more than `inner`.
        outer: f64 = 0.3, "m", POSITIVE, "relaxed, priority";
        /// An error pulls no harder than this one.
        saturation: f64 = 0.5, "m", POSITIVE, "relaxed";
        /// Nearer pairs are constraints of the QP; none: 1.2 in the plane, 0.4 in space.
        activation: Option<f64> = None, "m", POSITIVE, "cbf";
        /// Cost of changing the end effector's acceleration; the null space costs its inertia; none: 20 in the plane, 300 in
        /// space.
        task_weight: Option<f64> = None, "kg", POSITIVE, "cbf";
        /// What of the task gives way first, then what: of `turn` (about the tool's axis), `orientation`, `approach` (along that axis) and
        /// `position`. The rest comes last, at ten times `task_weight`, and each before it counts a tenth of the next; none: all alike.
        order: Option<Vec<Part>> = None, "", "cbf";
        /// Cost of violating a barrier; none: 4e4 in the plane, 6e5 in space.
        slack_weight: Option<f64> = None, "", POSITIVE, "cbf";
        /// Joint speed to keep below where the arm has no `velocity_limits`.
        speed: f64 = 6.0, "rad/s", POSITIVE, "cbf";
        /// Look-ahead: a table, see \[controller.yielding.preview\].
        preview: Option<PreviewSettings> = None, "", "cbf";
    }
}

/// A part of what the end effector has to do, which can give way before others. The tool's axis is the z axis of its frame, in the
/// plane that of the last link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// The turn about the tool's axis, in space.
    Turn,
    /// The orientation; beside `Turn` the direction of the tool's axis alone.
    Orientation,
    /// The position along the tool's axis.
    Approach,
    /// The position; beside `Approach` what is across the tool's axis alone.
    Position,
}

impl Part {
    /// As it is written in a scenario.
    pub fn name(self) -> &'static str {
        match self {
            Self::Turn => "turn",
            Self::Orientation => "orientation",
            Self::Approach => "approach",
            Self::Position => "position",
        }
    }
}
