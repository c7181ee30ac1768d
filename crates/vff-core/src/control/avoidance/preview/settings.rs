//! What can be set on the look-ahead.

use serde::Deserialize;

/// How the arm looks ahead: the `[controller.yielding.preview]` table of a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PreviewSettings {
    /// Duration of a planning cycle \[s\], > 0, rounded up to whole control steps.
    pub period: f64,
    /// How far ahead a roll-out goes \[s\], > 0.
    pub horizon: f64,
    /// A contact predicted within this time \[s\], > 0 and at most `horizon`, triggers the search for a motion that
    /// avoids it.
    pub trigger: f64,
    /// An error of the end effector \[m\], > 0, angles times the characteristic length: a larger one predicted within the
    /// time `trigger` triggers the search for a motion that avoids it within the null space. By default none does.
    pub error: Option<f64>,
    /// Steps of a roll-out, ≥ 1.
    pub steps: usize,
    /// Candidates per planning cycle, ≥ 1.
    pub candidates: usize,
    /// Distance \[m\], > 0: a larger one makes a candidate no better.
    pub clearance: f64,
    /// Standard deviation of the joint velocities of the candidates \[rad/s\], > 0.
    pub speed: f64,
}

impl Default for PreviewSettings {
    fn default() -> Self {
        Self {
            period: 0.02,
            horizon: 1.2,
            trigger: 1.2,
            error: None,
            steps: 16,
            candidates: 64,
            clearance: 0.1,
            speed: 1.0,
        }
    }
}
