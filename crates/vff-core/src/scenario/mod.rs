//! A scenario as people write it: read, validated, and made ready to run. Nothing here runs.
//!
//! This is the one place where input is validated. [`Scenario::from_toml`] and
//! [`Scenario::from_document`] read it; `prepare` checks everything that needs more than one value and
//! builds the closed loop, which [`runtime`](crate::runtime) runs.

pub mod arm;
mod document;
mod error;
mod json_schema;
pub mod plant;
mod prepare;
mod validate;
mod warnings;

pub use arm::ArmSpec;
pub use error::{Problem, ScenarioError};
pub use json_schema::json_schema;
pub use plant::PlantSpec;
pub use warnings::sampling_bounds;

use crate::control::Settings;
use crate::math::memory;
use crate::robot::description::ArmDescription;
use crate::robot::{Model, PlanarArm};
use crate::simulation::{
    ActuatorSettings, Control, MeasurementSettings, Options, PerceptionSettings,
};
use crate::trajectory::Reference;
use crate::world::plane::Obstacle;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;
use toml::{Table, Value};

/// Every key of a scenario, with unit, default and meaning.
pub const SCHEMA: &str = include_str!("schema.md");

/// The most steps that a run may have.
const MAX_STEPS: f64 = 1e12;

/// A whole scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// A name for people.
    #[serde(default)]
    pub name: String,
    /// One line for people.
    #[serde(default)]
    pub description: String,
    /// Length of the run \[s\], > 0.
    pub duration: f64,
    /// Initial configuration \[rad\], one angle per joint.
    pub q0: Vec<f64>,
    /// Initial joint velocity \[rad/s\]; default at rest.
    #[serde(default)]
    pub dq0: Option<Vec<f64>>,
    /// The arm.
    pub arm: ArmSpec,
    /// The controller.
    #[serde(default)]
    pub controller: Settings,
    /// What the end effector has to do.
    pub reference: Reference,
    /// What is in the way.
    #[serde(default)]
    pub obstacles: Vec<Obstacle>,
    /// How time advances.
    #[serde(default)]
    pub simulation: Options,
    /// The physical arm, where it is not the controller's model.
    #[serde(default)]
    pub plant: PlantSpec,
    /// The sensors; none if the controller knows the state.
    #[serde(default)]
    pub measurement: Option<MeasurementSettings>,
    /// The sensors of the obstacles; none if the controller knows them.
    #[serde(default)]
    pub perception: Option<PerceptionSettings>,
    /// The drives; none if the torque acts as commanded.
    #[serde(default)]
    pub actuator: Option<ActuatorSettings>,
    /// Where the random numbers come from.
    #[serde(default)]
    pub seed: u64,
}

/// Reads TOML text as a document, whatever it contains.
///
/// # Errors
/// With line and column if it is not TOML.
pub fn parse_toml(text: &str) -> Result<Table, ScenarioError> {
    text.parse().map_err(|error: toml::de::Error| {
        ScenarioError::new("", Problem::Syntax(error.to_string().trim_end().into()))
    })
}

/// Reads a part of a document whose numbers are all finite.
pub(crate) fn read<T: DeserializeOwned>(document: &Table) -> Result<T, ScenarioError> {
    let value = Value::Table(document.clone());
    validate::finite(&value)?;
    document::read(&value)
}

/// Reads and validates one part of a scenario on its own; of the whole, each of its parts.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn check(part: Part, document: &Table) -> Result<(), ScenarioError> {
    match part {
        Part::Scenario => Scenario::from_document(document).map(drop),
        Part::Arm => read_arm(document).map(drop),
        Part::Controller => validate::controller(&read(document)?, None),
        Part::Field => validate::field(&read(document)?),
        Part::Obstacle => read_obstacle(document).map(drop),
        Part::Motion => validate::motion(&read(document)?),
        Part::Reference => read::<Reference>(document).map(drop),
        Part::Simulation => validate::simulation(&read(document)?),
    }
}

/// A part of a scenario that can be validated on its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// The whole.
    Scenario,
    /// `[arm]`.
    Arm,
    /// `[controller]`.
    Controller,
    /// `[controller.field]`.
    Field,
    /// One of `[[obstacles]]`.
    Obstacle,
    /// The motion of an obstacle.
    Motion,
    /// `[reference]`.
    Reference,
    /// `[simulation]`.
    Simulation,
}

impl Part {
    /// The part of that name.
    ///
    /// # Errors
    /// If there is none.
    pub fn named(name: &str) -> Result<Self, ScenarioError> {
        document::read(&Value::String(name.into()))
    }
}

/// Reads and validates an arm.
///
/// # Errors
/// With the name of the first parameter that is wrong.
pub fn read_arm(document: &Table) -> Result<PlanarArm, ScenarioError> {
    read::<ArmSpec>(document)?.build()
}

/// Reads and validates the explicit description of an arm in space.
///
/// # Errors
/// With the dotted path of the first value that is wrong.
pub fn read_description(document: &Table) -> Result<ArmDescription, ScenarioError> {
    // Limits may be infinite: what must be finite is checked one by one.
    let description: ArmDescription = document::read(&Value::Table(document.clone()))?;
    Ok(description.checked()?)
}

/// Reads and validates the settings of a controller for an arm.
///
/// # Errors
/// With the name of the first setting that is wrong.
pub fn read_settings(document: &Table, arm: &PlanarArm) -> Result<Settings, ScenarioError> {
    let settings = read(document)?;
    validate::controller(&settings, Some(arm.dof()))?;
    validate::controller_of(&settings, arm.limits())?;
    validate::size(&settings, arm.dof(), 0, 1)?;
    Ok(settings)
}

/// Whether a controller with these settings has room for `barriers` distances of each of its n links.
///
/// # Errors
/// If it takes too much memory.
pub fn validate_size(settings: &Settings, n: usize, barriers: usize) -> Result<(), ScenarioError> {
    validate::size(settings, n, barriers, 1)
}

/// Reads and validates an obstacle.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn read_obstacle(document: &Table) -> Result<Obstacle, ScenarioError> {
    let obstacle = read(document)?;
    validate::obstacle(&obstacle)?;
    Ok(obstacle)
}

impl Scenario {
    /// Reads a scenario from TOML text.
    ///
    /// # Errors
    /// With line and column, or the dotted path of the first fault.
    pub fn from_toml(text: &str) -> Result<Self, ScenarioError> {
        Self::from_document(&parse_toml(text)?)
    }

    /// Reads a scenario from a document, and validates each of its parts.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn from_document(document: &Table) -> Result<Self, ScenarioError> {
        let scenario: Self = read(document)?;
        scenario.validate()?;
        Ok(scenario)
    }

    pub(crate) fn validate(&self) -> Result<(), ScenarioError> {
        let n = self.arm.dof();
        arm::number("duration", self.duration, arm::positive)?;
        let model = Arc::new(self.arm.build().map_err(|error| error.inside("arm"))?);
        arm::length("q0", self.q0.len(), n)?;
        if let Some(dq0) = &self.dq0 {
            arm::length("dq0", dq0.len(), n)?;
        }
        validate::controller(&self.controller, Some(n))
            .and_then(|()| validate::controller_of(&self.controller, model.limits()))
            .map_err(|error| error.inside("controller"))?;
        let Settings { tank, governor, .. } = &self.controller;
        for (key, given, what) in [
            ("controller.tank", tank.is_some(), "fills and empties from sample to sample"),
            ("controller.governor", governor.is_some(), "hears of the error from sample to sample"),
        ] {
            if given && self.simulation.control == Control::Continuous {
                let problem = Problem::Other(format!(
                    "{what}: it needs simulation.control = \"hold\" or \"predictor\""
                ));
                return Err(ScenarioError::new(key, problem));
            }
        }
        validate::simulation(&self.simulation).map_err(|error| error.inside("simulation"))?;
        if self.duration / self.simulation.dt > MAX_STEPS {
            let requirement = format!("at most {MAX_STEPS:e} steps of {} s", self.simulation.dt);
            return Err(ScenarioError::out_of_range("duration", &requirement, self.duration));
        }
        if self.duration < self.simulation.dt {
            let requirement = format!("at least one step of {} s", self.simulation.dt);
            return Err(ScenarioError::out_of_range("duration", &requirement, self.duration));
        }
        if self.reality(&model)?.plant.has_impulses() {
            memory::fits(n.saturating_mul(n)).map_err(|error| {
                let problem = format!("stops and dry friction of {n} joints take {error}");
                ScenarioError::new("plant", Problem::Other(problem))
            })?;
        }
        for (j, obstacle) in self.obstacles.iter().enumerate() {
            validate::obstacle(obstacle)
                .map_err(|error| error.inside(&format!("obstacles[{j}]")))?;
        }
        let barriers = self.obstacles.iter().map(|obstacle| obstacle.shape.barriers()).sum();
        let copies = if self.simulation.control == Control::Predictor { 2 } else { 1 };
        validate::size(&self.controller, n, barriers, copies)
            .map_err(|error| error.inside("controller"))
    }
}
