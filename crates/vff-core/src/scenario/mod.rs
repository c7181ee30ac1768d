//! A scenario as people write it: read, validated, and made ready to run. Nothing here runs.
//!
//! This is the one place where input is validated. [`Scenario::from_toml`] and
//! [`Scenario::from_document`] read it; `prepare` checks everything that needs more than one value and
//! builds the closed loop, which [`runtime`](crate::runtime) runs.

mod any_scene;
mod dispatch;
mod document;
mod error;
mod json_schema;
mod links_of_obstacles;
mod look_ahead;
mod notes;
mod numbers;
pub mod plane;
mod prepare;
mod scene;
pub mod space;
mod stiffness;
mod tables;
mod touch;
mod validate;
mod warnings;

pub use any_scene::AnyScene;
pub(crate) use dispatch::dispatch;
pub use error::{Problem, ScenarioError};
pub use json_schema::json_schema;
pub(crate) use links_of_obstacles::known_links;
pub(crate) use look_ahead::is_seen_ahead;
pub(crate) use numbers::length as numbers_of;
pub(crate) use numbers::{bounded, each, number};
pub use plane::{ArmSpec, PlanarScene, PlantSpec};
pub(crate) use prepare::{trajectory, unusable};
pub use scene::{CheckReach, FromDocument, ObstacleOf, Scene};
pub use space::{LoadSpec, PayloadSpec, SpatialArmSpec, SpatialPlantSpec, SpatialScene};
pub use tables::WhereUnreachable;
pub(crate) use validate::{no_such_link, not_in_the_plane};
pub use warnings::sampling_bounds;
pub(crate) use warnings::{misread_obstacle, misread_scene};

use crate::control::{Gravity, Settings, settings};
use crate::math::{ScalarOrVec, memory};
use crate::robot::models::{self, Interface};
use crate::robot::{Limits, Model, PlanarArm, SpatialArm};
use crate::settings::POSITIVE;
use crate::simulation::{
    ActuatorSettings, ContactSettings, Control, MeasurementSettings, Options, PerceptionKind,
    PerceptionSettings, Plane, Pull, ReplanSettings, Space, Wrench,
};
use crate::world::{Description, Motion, ObstacleGeometry};
use any_scene::on_scene;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::mem::take;
use std::sync::Arc;
use toml::{Table, Value};

/// Every key of a scenario, with unit, default and meaning.
pub const SCHEMA: &str = include_str!("schema.md");

/// The most steps that a run may have.
const MAX_STEPS: f64 = 1e12;

/// A whole scenario.
///
/// # Example
/// ```
/// use vff_core::scenario::{AnyScene, Part, Scenario, SpatialScene, WhereUnreachable, check};
///
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
///     arm = { model = "panda" }
///     reference = { kind = "setpoint" }
///     obstacles = [{ shape = { kind = "sphere", radius = 0.1 }, position = [0.5, 0.5, 0.5] }]
///     "#,
/// )
/// .unwrap();
/// assert_eq!(scenario.unreachable, WhereUnreachable::Refuse);
/// let AnyScene::Space(scene) = &scenario.scene else { panic!("an arm in space") };
/// let scene: &SpatialScene = scene;
/// assert_eq!((scene.obstacles.len(), scene.arm.model.as_deref()), (1, Some("panda")));
/// // A part alone.
/// assert!(check(Part::Field, &toml::toml! { kind = "khatib" gain = 0.1 influence = -1.0 }, None).is_err());
/// ```
///
/// # See also
/// [`prepare`](Self::prepare) makes a run of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// A name for people.
    pub name: String,
    /// One line for people.
    pub description: String,
    /// Length of the run \[s\], > 0.
    pub duration: f64,
    /// Initial configuration \[rad, of a sliding joint m\], one number per joint.
    pub q0: Vec<f64>,
    /// Initial joint velocity \[rad/s or m/s\]; default at rest.
    pub dq0: Option<Vec<f64>>,
    /// The arm, what its end effector has to do, and what is in the way.
    pub scene: AnyScene,
    /// The controller.
    pub controller: Settings,
    /// How time advances.
    pub simulation: Options,
    /// The sensors; none if the controller knows the state.
    pub measurement: Option<MeasurementSettings>,
    /// The sensors of the obstacles; none if the controller knows them.
    pub perception: Option<PerceptionSettings>,
    /// The drives; none if the torque acts as commanded.
    pub actuator: Option<ActuatorSettings>,
    /// How a plan is watched over that the reference is; none if it is followed whatever happens.
    pub replan: Option<ReplanSettings>,
    /// What becomes of it if the arm cannot follow the reference.
    pub unreachable: WhereUnreachable,
    /// How each obstacle resists a link that presses into it, if it does; as long as the obstacles, or empty.
    pub contacts: Vec<Option<ContactSettings>>,
    /// Where the random numbers come from.
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
    validate::finite(document)?;
    document::read(document)
}

/// Reads and validates one part of a scenario on its own; of the whole, each of its parts.
///
/// # Arguments
/// * `dimension`: of the space, 2 or 3; if it is not given, the part itself says which, as far as it does.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn check(part: Part, document: &Table, dimension: Option<usize>) -> Result<(), ScenarioError> {
    match (part, dimension.unwrap_or_else(|| tables::dimension_of(part, document))) {
        (Part::Scenario, _) => Scenario::from_document(document).map(drop),
        (Part::Simulation, _) => validate::simulation(&read(document)?),
        (Part::Field, _) => validate::field(&read(document)?),
        (Part::Controller, _) => validate::controller(&read(document)?, None),
        (_, 3) => check_in::<Space, 3>(part, document),
        _ => check_in::<Plane, 2>(part, document),
    }
}

/// A part that has the dimension of its arm.
fn check_in<S: FromDocument<D>, const D: usize>(
    part: Part,
    document: &Table,
) -> Result<(), ScenarioError> {
    match part {
        Part::Arm => S::arm(&read(document)?).map(drop),
        Part::Obstacle => read_felt_obstacle::<S, D>(document).map(drop),
        Part::Wrench => validate::wrench::<D>(&read(document)?),
        Part::Motion => validate::motion::<D>(&read(document)?),
        _ => read::<S::Reference>(&tables::reference(document)?.0).map(drop),
    }
}

/// A speed \[m/s\] and an acceleration \[m/s²\] that a motion of an obstacle never exceeds, jumps of its velocity not counted.
///
/// # Errors
/// With the dotted path of the first fault.
///
/// # Example
/// ```
/// let motion = vff_core::scenario::parse_toml(
///     "kind = \"sinusoid\"\namplitude = [0.0, 0.5, 0.0]\nangular_frequency = 2.0",
/// );
/// assert_eq!(vff_core::scenario::motion_bounds(&motion.unwrap()), Ok([1.0, 2.0]));
/// ```
pub fn motion_bounds(document: &Table) -> Result<[f64; 2], ScenarioError> {
    fn bounds<const D: usize>(document: &Table) -> Result<[f64; 2], ScenarioError> {
        let motion: Motion<D> = read(document)?;
        validate::motion(&motion)?;
        Ok([motion.top_speed(), motion.top_acceleration()])
    }
    match tables::dimension_of(Part::Motion, document) {
        3 => bounds::<3>(document),
        _ => bounds::<2>(document),
    }
}

/// The parts of the task of a `[controller]` table in a space of so many dimensions, as [`Yielding::parts`] has them.
///
/// # Errors
/// With the dotted path of the first fault.
///
/// # Example
/// ```
/// use vff_core::control::settings::Part;
/// use vff_core::scenario::{parse_toml, parts_of_task};
///
/// let controller = parse_toml("task = \"pose\"\nyielding = { order = [\"turn\"] }").unwrap();
/// assert_eq!(parts_of_task(&controller, 3), Ok(vec![Some(Part::Turn), None]));
/// ```
///
/// [`Yielding::parts`]: crate::control::settings::Yielding::parts
pub fn parts_of_task(
    document: &Table,
    dimension: usize,
) -> Result<Vec<Option<settings::Part>>, ScenarioError> {
    let Settings { yielding, task, .. } = read(document)?;
    Ok(yielding.parts(dimension, task))
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
    /// One of `[[wrenches]]`.
    Wrench,
}

impl Part {
    /// The part of that name.
    ///
    /// # Errors
    /// If there is none.
    pub fn named(name: &str) -> Result<Self, ScenarioError> {
        document::read_value(&Value::String(name.into()))
    }
}

/// Reads and validates an arm in space: a bundled one, or all joints one by one.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn read_spatial_arm(document: &Table) -> Result<SpatialArm, ScenarioError> {
    Space::arm(&read(document)?)
}

/// Reads what the tool of an arm in space carries: a table `[arm.load]`.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn read_load(document: &Table) -> Result<LoadSpec, ScenarioError> {
    read(document)
}

/// Whether a table `[arm]` is that of an arm in space.
pub fn is_spatial(arm: &Table) -> bool {
    tables::dimension_of(Part::Arm, arm) == 3
}

/// Reads and validates an arm in the plane.
///
/// # Errors
/// With the name of the first parameter that is wrong.
pub fn read_arm(document: &Table) -> Result<PlanarArm, ScenarioError> {
    Plane::arm(&read(document)?)
}

/// Takes what the settings leave to the robot of that name.
///
/// # Errors
/// If nothing is known of its interface.
pub(crate) fn take_from_robot(
    settings: &mut Settings,
    robot: Option<&str>,
) -> Result<(), ScenarioError> {
    let command = &mut settings.command;
    if !take(&mut command.of_the_robot) {
        return Ok(());
    }
    let Some(interface) = robot.and_then(models::interface) else {
        let known: Vec<_> = models::with_interface().collect();
        let whose =
            robot.map_or("an arm without a name".into(), |name| format!("the arm `{name}`"));
        let problem = format!(
            "what the interface of {whose} takes is not known here, only that of {}: give a table, with \
             `gravity` and `torque_rate` as the robot's manual says",
            known.join(", ")
        );
        return Err(ScenarioError::new("command", Problem::Other(problem)));
    };
    let Interface { adds_gravity, torque_rate, tip_speed, tip_angular_speed, stops } = interface;
    command.gravity = if adds_gravity { Gravity::Robot } else { Gravity::Controller };
    command.torque_rate = torque_rate.map(ScalarOrVec::Uniform);
    command.tip_speed = tip_speed;
    command.tip_angular_speed = tip_angular_speed;
    if let Some([deceleration, offset]) = stops {
        command.stop_deceleration = Some(ScalarOrVec::Each(deceleration.to_vec()));
        command.stop_offset = ScalarOrVec::Each(offset.to_vec());
    }
    if torque_rate.is_some() {
        // In a loop of samples, then: what nobody knows of counts for the limits at which the robot ends a motion.
        settings.observer.get_or_insert_default();
    }
    Ok(())
}

/// Reads and validates the settings of a controller for an arm of n joints in so many dimensions, and of that name, if it has one.
///
/// # Errors
/// With the name of the first setting that is wrong.
pub fn read_settings(
    document: &Table,
    limits: &Limits,
    robot: Option<&str>,
    sizes: [usize; 2],
) -> Result<Settings, ScenarioError> {
    let settings = read_settings_of_scenario(document, limits, robot, sizes)?;
    validate::posture(&settings)?;
    Ok(settings)
}

/// The same for a scenario, whose reference may bring the posture that its spring pulls to.
///
/// # Errors
/// As [`read_settings`].
pub fn read_settings_of_scenario(
    document: &Table,
    limits: &Limits,
    robot: Option<&str>,
    [n, dimension]: [usize; 2],
) -> Result<Settings, ScenarioError> {
    let mut settings: Settings = read(document)?;
    take_from_robot(&mut settings, robot)?;
    validate::controller(&settings, Some((n, dimension)))?;
    validate::controller_of(&settings, limits)?;
    validate::size(&settings, n, 0, 1)?;
    Ok(settings)
}

/// Whether a controller with these settings has room for `barriers` distances of each of its n links.
///
/// # Errors
/// If it takes too much memory.
pub fn validate_size(settings: &Settings, n: usize, barriers: usize) -> Result<(), ScenarioError> {
    validate::size(settings, n, barriers, 1)
}

/// An obstacle, and how it resists, if it does.
pub type FeltObstacle<S, const D: usize> = (ObstacleOf<S, D>, Option<ContactSettings>);

/// Reads and validates an obstacle for a controller that is to know of it.
///
/// # Errors
/// With the dotted path of the first fault, or if it is one that the controller does not see.
pub fn read_seen_obstacle<S: FromDocument<D>, const D: usize>(
    document: &Table,
) -> Result<ObstacleOf<S, D>, ScenarioError> {
    let (obstacle, contact) = read_felt_obstacle::<S, D>(document)?;
    if contact.is_some_and(|contact| !contact.seen) {
        let problem = "is for the obstacles of a scenario: whoever is given one knows of it";
        return Err(ScenarioError::new("contact.seen", Problem::Other(problem.into())));
    }
    Ok(obstacle)
}

/// Reads and validates an obstacle, and how it resists a link that presses into it, if it does.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn read_felt_obstacle<S: FromDocument<D>, const D: usize>(
    document: &Table,
) -> Result<FeltObstacle<S, D>, ScenarioError> {
    let mut rest = document.clone();
    let contact = tables::contact(&mut rest)?;
    let obstacle = read(&rest)?;
    S::validate_obstacle(&obstacle)?;
    Ok((obstacle, contact))
}

/// Reads and validates a wrench on some arm.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn read_wrench<const D: usize>(document: &Table) -> Result<Wrench<D>, ScenarioError> {
    let wrench = read(document)?;
    validate::wrench(&wrench)?;
    Ok(wrench)
}

/// Reads and validates how a link of some arm is pulled.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn read_pull<const D: usize>(document: &Table) -> Result<Pull<D>, ScenarioError> {
    let pull = read(document)?;
    validate::pull(&pull)?;
    Ok(pull)
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
        let mut scenario = tables::read(document)?;
        let name = scenario.robot_name().map(String::from);
        take_from_robot(&mut scenario.controller, name.as_deref())
            .map_err(|error| error.inside("controller"))?;
        scenario.validate()?;
        Ok(scenario)
    }

    /// The name of its arm, if it has one.
    pub fn robot_name(&self) -> Option<&str> {
        match &self.scene {
            AnyScene::Plane(_) => None,
            AnyScene::Space(scene) => scene.arm.name.as_deref().or(scene.arm.model.as_deref()),
        }
    }

    /// How many `[[wrenches]]` it has.
    pub fn wrench_count(&self) -> usize {
        on_scene!(&self.scene, scene => scene.wrenches.len())
    }

    pub(crate) fn validate(&self) -> Result<(), ScenarioError> {
        on_scene!(&self.scene, scene => self.validate_with(scene))
    }

    fn validate_with<S: FromDocument<D>, const D: usize>(
        &self,
        scene: &Scene<S, D>,
    ) -> Result<(), ScenarioError> {
        number("duration", self.duration, &POSITIVE)?;
        let model = Arc::new(S::arm(&scene.arm).map_err(|error| error.inside("arm"))?);
        let n = model.dof();
        numbers::length("q0", self.q0.len(), n)?;
        if let Some(dq0) = &self.dq0 {
            numbers::length("dq0", dq0.len(), n)?;
        }
        validate::controller(&self.controller, Some((n, D)))
            .and_then(|()| validate::controller_of(&self.controller, model.limits()))
            .and_then(|()| match S::plan(&scene.reference).is_some() || self.replan.is_some() {
                true => Ok(()),
                false => validate::posture(&self.controller),
            })
            .map_err(|error| error.inside("controller"))?;
        touch::sampled(&self.controller, self.simulation.control_period())?;
        let Settings { tank, observer, governor, command, .. } = &self.controller;
        let rate = command.torque_rate.is_some();
        for (key, given, what) in [
            ("controller.tank", tank.is_some(), "fills and empties from sample to sample"),
            ("controller.observer", observer.is_some(), "compares from sample to sample"),
            ("controller.governor", governor.is_some(), "hears of the error from sample to sample"),
            ("controller.command.torque_rate", rate, "limits the change from sample to sample"),
        ] {
            if given && self.simulation.control == Control::Continuous {
                let problem = Problem::Other(format!(
                    "{what}: it needs simulation.control = \"hold\" or \"predictor\""
                ));
                return Err(ScenarioError::new(key, problem));
            }
        }
        if let Some(settings) = &self.replan {
            let knows = self.knows_obstacles();
            let rests = S::plan(&scene.reference).is_some_and(|plan| plan.rest_between());
            let problem = match (S::comes_to_rest(&scene.reference), rests, knows) {
                (false, ..) => {
                    Some("needs a reference that comes to rest, so that there is a place to go to")
                }
                (_, true, _) => Some(
                    "needs a plan without rests on the way: another one would leave out the goals there",
                ),
                (.., false) => Some("needs obstacles that are known, without `perception`"),
                _ => None,
            };
            if let Some(problem) = problem {
                return Err(ScenarioError::new("replan", Problem::Other(problem.into())));
            }
            validate::replan(settings, self.q0.len(), D).map_err(|error| error.inside("replan"))?;
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
        if self.reality(scene, &model)?.plant.has_impulses() {
            memory::fits(n.saturating_mul(n)).map_err(|error| {
                let problem = format!("stops and dry friction of {n} joints take {error}");
                ScenarioError::new("plant", Problem::Other(problem))
            })?;
        }
        let links = model.link_names();
        let mut barriers = 0;
        for (j, obstacle) in scene.obstacles.iter().enumerate() {
            S::validate_obstacle(obstacle)
                .and_then(|()| known_links(obstacle, &links))
                .and_then(|()| self.knows_what_links_keep(obstacle))
                .and_then(|()| is_seen_ahead(obstacle, self.controller.looks_ahead()))
                .and_then(|()| self.can_come_true(obstacle, j))
                .map_err(|error| error.inside(&format!("obstacles[{j}]")))?;
            barriers += S::Geometry::new(obstacle).barriers();
        }
        if let Some(given) = self.perception.as_ref().filter(|it| it.kind == PerceptionKind::Depth)
        {
            barriers = given.points_of(0, D); // a cloud is all that it knows
        }
        validate::wrenches(&scene.wrenches)?;
        scene.wrenches_on(&model)?;
        let copies = if self.simulation.control == Control::Predictor { 2 } else { 1 };
        validate::size(&self.controller, n, barriers, copies)
            .map_err(|error| error.inside("controller"))
    }

    /// Whether the controller knows the obstacles, and does not see points of them.
    fn knows_obstacles(&self) -> bool {
        self.perception.as_ref().is_none_or(|it| it.kind == PerceptionKind::Ideal)
    }

    /// Whether obstacle `j` can be known as a possible future, if it is one.
    fn can_come_true<const D: usize>(
        &self,
        obstacle: &impl Description<D>,
        j: usize,
    ) -> Result<(), ScenarioError> {
        let is_felt = self.contacts.get(j).is_some_and(Option::is_some);
        let problem = match obstacle.likelihood() {
            Some(_) if is_felt => {
                "nothing is there that resists: a possible future has no `contact`"
            }
            Some(_) if !self.knows_obstacles() => {
                "needs obstacles that are known, without `perception`: cameras do not see what may come"
            }
            _ => return Ok(()),
        };
        Err(ScenarioError::new("likelihood", Problem::Other(problem.into())))
    }

    /// Whether the controller knows which obstacle is which, if this one says something of links.
    fn knows_what_links_keep<const D: usize>(
        &self,
        obstacle: &impl Description<D>,
    ) -> Result<(), ScenarioError> {
        // Whoever sees points alone cannot know whose they are.
        let Some(key) = obstacle.key_of_links().filter(|_| !self.knows_obstacles()) else {
            return Ok(());
        };
        let problem = "needs obstacles that are known, without `perception`: points do not say whose they are";
        Err(ScenarioError::new(key, Problem::Other(problem.into())))
    }
}
