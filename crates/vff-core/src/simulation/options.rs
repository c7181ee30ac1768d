//! How time advances: the `[simulation]` table of a scenario.

use serde::Deserialize;

/// The integrator of the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Integrator {
    /// Classical fourth-order Runge–Kutta.
    #[default]
    Rk4,
    /// Velocity first, then position with the new velocity; first order.
    SemiImplicitEuler,
}

/// When the law is evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Control {
    /// Inside every stage of the integrator: the continuous-time law.
    Continuous,
    /// Once per control period at its start, held until the next: zero-order hold.
    #[default]
    Hold,
    /// Zero-order hold of the law at the state predicted for the middle of the period,
    /// (q + q̇ h/2 + q̈ h²/8, q̇ + q̈ h/2).
    Predictor,
}

/// Steps, integrator and sampling.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Step of the plant \[s\], > 0.
    pub dt: f64,
    /// Integrator of the plant.
    pub integrator: Integrator,
    /// When the law is evaluated.
    pub control: Control,
    /// Plant steps per control period, ≥ 1; 1 with `continuous`.
    pub control_every: usize,
    /// Plant steps per recorded row, ≥ 1.
    pub record_every: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            dt: 1e-3,
            integrator: Integrator::default(),
            control: Control::default(),
            control_every: 1,
            record_every: 1,
        }
    }
}

impl Options {
    /// The number of plant steps in `duration` \[s\].
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "validated before")]
    pub fn steps(&self, duration: f64) -> usize {
        (duration / self.dt).round() as usize
    }

    /// The number of recorded rows in `duration` \[s\].
    pub fn rows(&self, duration: f64) -> usize {
        self.steps(duration) / self.record_every + 1
    }

    /// The time of step `k` \[s\].
    #[expect(clippy::cast_precision_loss, reason = "far fewer than 2⁵³ steps")]
    pub fn time(&self, k: usize) -> f64 {
        k as f64 * self.dt
    }

    /// The control period \[s\].
    #[expect(clippy::cast_precision_loss, reason = "far fewer than 2⁵³ steps")]
    pub fn control_period(&self) -> f64 {
        self.control_every as f64 * self.dt
    }
}
