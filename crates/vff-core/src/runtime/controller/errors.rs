//! What a loop is refused.

use super::MissedStart;
use crate::control::output::BeginError;
use crate::math::rotation::NotARotation;
use crate::scenario::ScenarioError;

/// Why a cycle is none.
///
/// # Example
/// ```
/// use vff_core::runtime::controller::Surroundings;
/// use vff_core::runtime::{AnyArm, AnyController, CycleError, Reading};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let arm = AnyArm::read(&toml::toml! { lengths = [0.5, 0.5] masses = 2.0 })?;
/// let mut controller = AnyController::new(&arm, &toml::Table::new())?;
/// let state = Reading { t: 0.0, q: &[0.4, 0.5], dq: &[0.0; 2] };
/// assert_eq!(controller.cycle(Some(state), None), Err(CycleError::NotBegun));
/// // Obstacles that another thread has made ready take the place of those that are there.
/// let mut around: Surroundings = controller.surroundings();
/// controller.exchange(&mut around, 0.0);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CycleError {
    /// See [`begin`](super::ErasedController::begin).
    #[error("the loop has not begun")]
    NotBegun,
    /// The target is no reference.
    #[error(transparent)]
    Target(#[from] NotARotation),
    /// A loop does not begin where the robot is.
    #[error(transparent)]
    Elsewhere(#[from] MissedStart),
}

/// Why a law does not take the place of another one.
///
/// # Example
/// ```
/// use vff_core::runtime::{AnyArm, AnyController, ErasedController, SuccessionError};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let arm = AnyArm::read(&toml::toml! { model = "panda" })?;
/// let mut controller = AnyController::new(&arm, &toml::Table::new())?;
/// controller.begin(0.001, None)?;
/// let pose = AnyController::new(&arm, &toml::toml! { task = "pose" })?;
/// let law: &dyn ErasedController = &*controller;
/// assert!(matches!(law.successor(&pose), Err(SuccessionError::Another)));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SuccessionError {
    /// Its robot or task is another one.
    #[error("a loop keeps its joints, by number and name, its task and its space")]
    Another,
    /// It has taken its place before.
    #[error("a law takes the place of another one once: make another successor")]
    Used,
    /// Its `command` is another one.
    #[error("command: a loop keeps what it has begun with")]
    Command,
    /// Its joints have other limits, in a drive of set points.
    #[error(
        "joint_limits and velocity_limits: set points keep those of the arm that they began with"
    )]
    Limits,
    /// The last succession is under way, or the torque is still blended in.
    #[error("the law before is still being left, or blended in")]
    Succeeding,
    /// Its observer follows what the robot does not measure.
    #[error(
        "observer.source = \"measured\": the robot measures no torque from outside; \"momentum\" estimates it"
    )]
    Unmeasured,
    /// It is not for the period of the loop.
    #[error(transparent)]
    Period(#[from] BeginError),
    /// It has no room for the obstacles, or does not see one of them: a possible future, without look-ahead.
    #[error(transparent)]
    Room(#[from] ScenarioError),
}
