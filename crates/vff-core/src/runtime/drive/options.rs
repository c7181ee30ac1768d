//! How a robot is driven, and why it cannot be.

use super::super::virtual_arm::{SetPointLimits, VirtualArmError};
use crate::control::output::BeginError;

/// The rates that are accepted \[Hz\]: at the lowest, a wish to end is heard within a tenth of a second.
pub const RATES: std::ops::RangeInclusive<f64> = 10.0..=20_000.0;

/// How a robot is driven.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Periods per second \[Hz\], in [`RATES`].
    pub rate: f64,
    /// How long, by the robot's clock \[s\]; until somebody ends it, if it is not said.
    pub seconds: Option<f64>,
    /// How long a reference is carried on without a new one \[s\], ≥ 0.
    pub patience: f64,
    /// How long an obstacle may go unseen that [points](super::Exchange::update_points) or [places](super::Exchange::place) have come for \[s\], > 0:
    /// then the drive ends. What was seen last counts for ever, if it is not said.
    pub sight_patience: Option<f64>,
    /// Periods per row that is kept for a file; 0 keeps none.
    pub record_every: u64,
    /// What the set points of a robot that takes positions or velocities keep to; such a robot needs them.
    pub limits: Option<SetPointLimits>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rate: 1000.0,
            seconds: None,
            patience: 0.1,
            sight_patience: None,
            record_every: 0,
            limits: None,
        }
    }
}

/// Why there is no such drive.
///
/// # Example
/// ```
/// use vff_core::runtime::AnyController;
/// use vff_core::runtime::drive::{DriveError, Loop, Options, SimulatedRobot};
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     controller = { stiffness = 900.0, damping = 60.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     "#,
/// )?;
/// let robot = SimulatedRobot::new(&scenario, 10.0, None)?;
/// let controller = AnyController::from_scenario(&scenario)?;
/// let refused = Loop::new(robot, controller, Options { rate: 10.0, ..Options::default() });
/// assert!(matches!(refused.map(drop), Err(DriveError::Begin(_)))); // its damping is unstable at 10 Hz
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DriveError {
    /// The law is not for this rate.
    #[error(transparent)]
    Begin(#[from] BeginError),
    /// A limit of the set points is none.
    #[error("limits: {0}")]
    Limits(#[from] VirtualArmError),
    /// There are no limits.
    #[error("limits: a robot that takes positions or velocities needs some")]
    NoLimits,
}
