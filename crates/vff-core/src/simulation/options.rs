//! How time advances: the `[simulation]` table of a scenario.

use crate::settings::settings;
use serde::{Deserialize, Serialize};

/// The integrator of the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Integrator {
    /// Classical fourth-order Runge–Kutta.
    #[default]
    Rk4,
    /// Velocity first, then position with the new velocity; first order.
    SemiImplicitEuler,
}

/// When the law is evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
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

settings! {
    /// Steps, integrator and sampling.
    ///
    /// # Example
    /// ```
    /// use vff_core::simulation::{Control, Integrator, Options};
    ///
    /// let options = Options { control: Control::Hold, integrator: Integrator::Rk4, dt: 0.001, ..Options::default() };
    /// assert_eq!(options.steps(2.0), 2000);
    /// ```
    pub struct Options {
        /// Step of the plant.
        dt: f64 = 1e-3, "s", POSITIVE;
        /// `rk4` or `semi_implicit_euler`.
        integrator: Integrator = Integrator::Rk4, "";
        /// `continuous`, `hold` or `predictor`: see below.
        control: Control = Control::Hold, "";
        /// Steps per control period; 1 with continuous.
        control_every: usize = 1, "steps", AT_LEAST_ONE;
        /// Steps per recorded row; metrics use every step.
        record_every: usize = 1, "steps", AT_LEAST_ONE;
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
