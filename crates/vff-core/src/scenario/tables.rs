//! The tables of a scenario, as they stand in a document.

use super::any_scene::AnyScene;
use super::document;
use super::scene::{FromDocument, ObstacleOf, Scene};
use super::{Part, Scenario, ScenarioError, validate};
use crate::control::Settings;
use crate::simulation::{
    ActuatorSettings, ContactSettings, MeasurementSettings, Options, PerceptionSettings, Plane,
    ReplanSettings, Space, Wrench,
};
use serde::Deserialize;
use toml::{Table, Value};

/// All of them, with an arm in `D` dimensions.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, bound = "")]
pub(super) struct Tables<S: FromDocument<D>, const D: usize> {
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
    wrenches: Vec<Wrench<D>>,
    #[serde(default)]
    measurement: Option<MeasurementSettings>,
    #[serde(default)]
    perception: Option<PerceptionSettings>,
    #[serde(default)]
    actuator: Option<ActuatorSettings>,
    #[serde(default)]
    replan: Option<ReplanSettings>,
    #[serde(default)]
    seed: u64,
}

/// What becomes of a scenario whose reference the arm cannot follow: a key that all references share.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WhereUnreachable {
    /// It is not run.
    #[default]
    Refuse,
    /// It is run, with a warning.
    Warn,
}

/// The key in `[reference]`.
pub(super) const UNREACHABLE: &str = "unreachable";

/// A table `[reference]` without that key, and what it says; a plan, which joints follow, does not have it.
pub(super) fn reference(table: &Table) -> Result<(Table, WhereUnreachable), ScenarioError> {
    let mut rest = table.clone();
    let is_plan = table.get("kind").and_then(Value::as_str) == Some("plan");
    let choice = if is_plan { None } else { rest.remove(UNREACHABLE) };
    let choice = choice.as_ref().map(document::read_value).transpose();
    let choice = choice.map_err(|error| error.inside(UNREACHABLE))?;
    Ok((rest, choice.unwrap_or_default()))
}

/// The key in one of `[[obstacles]]`.
pub(super) const CONTACT: &str = "contact";

/// Takes that key out of the table of an obstacle; what it says.
pub(super) fn contact(obstacle: &mut Table) -> Result<Option<ContactSettings>, ScenarioError> {
    let given = obstacle.remove(CONTACT);
    let settings = given.as_ref().map(document::read_value::<ContactSettings>).transpose();
    let settings = settings.map_err(|error| error.inside(CONTACT))?;
    if let Some(settings) = &settings {
        validate::contact(settings).map_err(|error| error.inside(CONTACT))?;
    }
    Ok(settings)
}

/// A scenario without that key in any obstacle, and what each says, where one says it.
#[expect(clippy::type_complexity, reason = "a table, and a list as long as that of its obstacles")]
fn contacts(
    document: &Table,
) -> Result<Option<(Table, Vec<Option<ContactSettings>>)>, ScenarioError> {
    let has = |obstacle: &Value| obstacle.as_table().is_some_and(|it| it.contains_key(CONTACT));
    let given = document.get("obstacles").and_then(Value::as_array);
    if !given.is_some_and(|given| given.iter().any(has)) {
        return Ok(None);
    }
    let mut rest = document.clone();
    let obstacles = rest.get_mut("obstacles").and_then(Value::as_array_mut).into_iter().flatten();
    let taken = obstacles.enumerate().map(|(j, obstacle)| match obstacle.as_table_mut() {
        Some(obstacle) => {
            contact(obstacle).map_err(|error| error.inside(&format!("obstacles[{j}]")))
        }
        None => Ok(None),
    });
    let contacts = taken.collect::<Result<_, _>>()?;
    Ok(Some((rest, contacts)))
}

/// Reads a scenario, whose arm says of how many dimensions it is.
pub(super) fn read(document: &Table) -> Result<Scenario, ScenarioError> {
    validate::finite(document)?;
    let given = document.get("reference").and_then(Value::as_table);
    if let Some(given) = given.filter(|given| given.contains_key(UNREACHABLE)) {
        let (rest, unreachable) = reference(given).map_err(|error| error.inside("reference"))?;
        if rest.len() < given.len() {
            let mut document = document.clone();
            document.insert("reference".into(), Value::Table(rest));
            return Ok(Scenario { unreachable, ..read(&document)? });
        }
    }
    if let Some((rest, contacts)) = contacts(document)? {
        return Ok(Scenario { contacts, ..read(&rest)? });
    }
    match dimension_of(Part::Scenario, document) {
        2 => document::read::<Tables<Plane, 2>>(document)
            .map(|tables| tables.into_scenario(|scene| AnyScene::Plane(Box::new(scene)))),
        _ => document::read::<Tables<Space, 3>>(document)
            .map(|tables| tables.into_scenario(|scene| AnyScene::Space(Box::new(scene)))),
    }
}

/// The keys of `[arm]` by one of which an arm in space is known.
pub(super) const SPATIAL_KEYS: [&str; 4] = ["model", "urdf", "mjcf", "joints"];

/// The dimension of the space that a part of a scenario is about, as far as it says so; otherwise 2.
pub(super) fn dimension_of(part: Part, document: &Table) -> usize {
    let inside = |key: &str| document.get(key).and_then(Value::as_table);
    let spatial = match part {
        Part::Arm => SPATIAL_KEYS.iter().any(|key| document.contains_key(*key)),
        Part::Scenario => inside("arm").is_some_and(|arm| dimension_of(Part::Arm, arm) == 3),
        Part::Obstacle => document.get("position").is_some_and(has_three_coordinates),
        Part::Motion => ["velocity", "amplitude", "points"]
            .iter()
            .any(|key| document.get(*key).is_some_and(has_three_coordinates)),
        Part::Wrench => ["point", "force", "torque"]
            .iter()
            .any(|key| document.get(*key).is_some_and(has_three_coordinates)),
        _ => false,
    };
    if spatial { 3 } else { 2 }
}

/// Of a point, or of the first of several.
fn has_three_coordinates(value: &Value) -> bool {
    value.as_array().is_some_and(|values| match values.first() {
        Some(first @ Value::Array(_)) => has_three_coordinates(first),
        Some(_) => values.len() == 3,
        None => false,
    })
}

impl<S: FromDocument<D>, const D: usize> Tables<S, D> {
    fn into_scenario(self, scene: impl Fn(Scene<S, D>) -> AnyScene) -> Scenario {
        let Self { arm, reference, obstacles, plant, wrenches, .. } = self;
        Scenario {
            name: self.name,
            description: self.description,
            duration: self.duration,
            q0: self.q0,
            dq0: self.dq0,
            scene: scene(Scene { arm, reference, obstacles, plant, wrenches }),
            controller: self.controller,
            simulation: self.simulation,
            measurement: self.measurement,
            perception: self.perception,
            actuator: self.actuator,
            replan: self.replan,
            unreachable: WhereUnreachable::default(),
            contacts: vec![],
            seed: self.seed,
        }
    }
}
