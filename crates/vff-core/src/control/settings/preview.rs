//! What can be set on the look-ahead.

use super::SelfMotionSettings;
use crate::settings::settings;

settings! {
    /// How the arm looks ahead: the `[controller.yielding.preview]` table of a scenario.
    pub struct PreviewSettings {
        /// Duration of a planning cycle, rounded up to whole control steps.
        period: f64 = 0.02, "s", POSITIVE;
        /// How far ahead a roll-out goes.
        horizon: f64 = 1.2, "s", POSITIVE;
        /// A contact predicted within this time, at most `horizon`, starts the search; less is less safe and costs less
        /// tracking.
        trigger: f64 = 1.2, "s", POSITIVE;
        /// Steps of a roll-out.
        steps: usize = 16, "", UP_TO_10000;
        /// An error of the end effector (angles times the characteristic length) predicted within the time `trigger` starts a
        /// search, too, within the null space alone.
        error: Option<f64> = None, "m", POSITIVE;
        /// Candidates per planning cycle.
        candidates: usize = 64, "", UP_TO_10000;
        /// A larger distance makes a candidate no better.
        clearance: f64 = 0.1, "m", POSITIVE;
        /// Standard deviation of the joint velocities of candidates.
        speed: f64 = 1.0, "rad/s", POSITIVE;
        /// Possible futures, obstacles with a `likelihood`, are left out from the least likely on while what is left out has at most this
        /// probability.
        chance: f64 = 0.0, "", PART;
        /// Where the task leaves one degree of freedom, the best way along it is searched first: a table, see
        /// \[controller.yielding.preview.self_motion\].
        self_motion: Option<SelfMotionSettings> = None, "";
    }
}
