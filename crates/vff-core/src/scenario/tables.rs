//! The tables of a scenario, as they stand in a document.

use super::document;
use super::scene::{AnyScene, Described, ObstacleOf, Scene};
use super::{Scenario, ScenarioError, validate};
use crate::control::Settings;
use crate::simulation::{
    ActuatorSettings, MeasurementSettings, Options, PerceptionSettings, Plane,
};
use serde::Deserialize;
use toml::{Table, Value};

/// All of them, with an arm in `D` dimensions.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, bound = "")]
pub(super) struct Tables<S: Described<D>, const D: usize> {
    #[serde(default)]
    name: String,
    #[serde(default)]
    description: String,
    duration: f64,
    q0: Vec<f64>,
    #[serde(default)]
    dq0: Option<Vec<f64>>,
    arm: S::ArmTable,
    #[serde(default)]
    controller: Settings,
    reference: S::Reference,
    #[serde(default)]
    obstacles: Vec<ObstacleOf<S, D>>,
    #[serde(default)]
    simulation: Options,
    #[serde(default)]
    plant: S::PlantTable,
    #[serde(default)]
    measurement: Option<MeasurementSettings>,
    #[serde(default)]
    perception: Option<PerceptionSettings>,
    #[serde(default)]
    actuator: Option<ActuatorSettings>,
    #[serde(default)]
    seed: u64,
}

/// Reads a scenario, whose arm says of how many dimensions it is.
pub(super) fn read(document: &Table) -> Result<Scenario, ScenarioError> {
    let value = Value::Table(document.clone());
    validate::finite(&value)?;
    document::read::<Tables<Plane, 2>>(&value).map(|tables| tables.into_scenario(AnyScene::Plane))
}

impl<S: Described<D>, const D: usize> Tables<S, D> {
    fn into_scenario(self, scene: impl Fn(Scene<S, D>) -> AnyScene) -> Scenario {
        let Self { arm, reference, obstacles, plant, .. } = self;
        Scenario {
            name: self.name,
            description: self.description,
            duration: self.duration,
            q0: self.q0,
            dq0: self.dq0,
            scene: scene(Scene { arm, reference, obstacles, plant }),
            controller: self.controller,
            simulation: self.simulation,
            measurement: self.measurement,
            perception: self.perception,
            actuator: self.actuator,
            seed: self.seed,
        }
    }
}
