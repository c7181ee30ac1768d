//! A scenario as people write it, judged, and made ready to run.
//!
//! This is the one place where input is judged. [`Scenario::from_toml`] and
//! [`Scenario::from_document`] read it, [`Scenario::prepare`] checks everything that needs more than
//! one value and builds the run.

pub mod arm;
pub mod batch;
mod document;
pub mod episode;
mod error;
pub mod feasibility;
mod judge;
pub mod live;
pub mod plant;
pub mod real_time;
pub mod vector;

pub use arm::ArmSpec;
pub use error::{Problem, ScenarioError};
pub use plant::PlantSpec;

use crate::control::{Controller, Gains, Settings, TaskKind};
use crate::math::Vector;
use crate::robot::{PlanarArm, PlanarState, Robot};
use crate::simulation::{
    Actuator, ActuatorSettings, ClosedLoop, Control, Measurement, MeasurementSettings, Options,
    Outcome, Perception, PerceptionKind, PerceptionSettings, Reality, Record, Run, Snapshot,
};
use crate::trajectory::{Reference, Trajectory};
use crate::world::{Obstacle, World};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;
use std::time::Duration;
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
    /// Length of the run [s], > 0.
    pub duration: f64,
    /// Initial configuration [rad], one angle per joint.
    pub q0: Vec<f64>,
    /// Initial joint velocity [rad/s]; default at rest.
    #[serde(default)]
    pub dq0: Option<Vec<f64>>,
    /// The arm.
    pub arm: ArmSpec,
    /// The controller.
    #[serde(default)]
    pub controller: Settings,
    /// What the end effector shall do.
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
fn read<T: DeserializeOwned>(document: &Table) -> Result<T, ScenarioError> {
    let value = Value::Table(document.clone());
    judge::finite(&value)?;
    document::read(&value)
}

/// Reads and judges one part of a scenario, named as in [`Part`].
///
/// # Errors
/// With the dotted path of the first fault.
pub fn check(part: Part, document: &Table) -> Result<Vec<String>, ScenarioError> {
    match part {
        Part::Scenario => {
            return Scenario::from_document(document)?.prepare().map(|ready| ready.warnings);
        }
        Part::Arm => drop(read_arm(document)?),
        Part::Controller => judge::controller(&read(document)?, None)?,
        Part::Field => judge::field(&read(document)?)?,
        Part::Obstacle => drop(read_obstacle(document)?),
        Part::Motion => judge::motion(&read(document)?)?,
        Part::Reference => drop(read::<Reference>(document)?),
        Part::Simulation => judge::simulation(&read(document)?)?,
    }
    Ok(vec![])
}

/// A part of a scenario that can be judged on its own.
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

/// Reads and judges an arm.
///
/// # Errors
/// With the name of the first parameter that is wrong.
pub fn read_arm(document: &Table) -> Result<PlanarArm, ScenarioError> {
    read::<ArmSpec>(document)?.build()
}

/// Reads and judges the settings of a controller for an arm.
///
/// # Errors
/// With the name of the first setting that is wrong.
pub fn read_settings(document: &Table, arm: &PlanarArm) -> Result<Settings, ScenarioError> {
    let settings = read(document)?;
    judge::controller(&settings, Some(arm.dof()))?;
    judge::controller_of(&settings, arm.limits())?;
    Ok(settings)
}

/// Reads and judges an obstacle.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn read_obstacle(document: &Table) -> Result<Obstacle, ScenarioError> {
    let obstacle = read(document)?;
    judge::obstacle(&obstacle)?;
    Ok(obstacle)
}

/// A scenario ready to run, and what is odd about it.
#[derive(Debug, Clone)]
pub struct Ready {
    /// The run at t = 0.
    pub run: AnyRun,
    /// Sentences for the user.
    pub warnings: Vec<String>,
}

/// A run of either task dimension.
#[derive(Debug, Clone)]
pub enum AnyRun {
    /// Position.
    Position(Box<Run<2>>),
    /// Position and orientation.
    Pose(Box<Run<3>>),
}

macro_rules! either {
    ($run:expr, $inner:ident => $body:expr) => {
        match $run {
            AnyRun::Position($inner) => $body,
            AnyRun::Pose($inner) => $body,
        }
    };
}

use either;

impl AnyRun {
    /// [`Run::run_for`].
    pub fn run_for(&mut self, budget: Duration) -> bool {
        either!(self, run => run.run_for(budget))
    }

    /// [`Run::step`].
    pub fn step(&mut self) -> bool {
        either!(self, run => run.step())
    }

    /// [`ClosedLoop::restart`], without record or metrics.
    pub fn restart(&mut self) {
        either!(self, run => run.closed_loop_mut().restart());
    }

    /// [`Run::outcome`].
    pub fn outcome(self) -> Outcome {
        either!(self, run => (*run).outcome())
    }

    /// The present instant.
    pub fn snapshot(&self) -> Snapshot<'_> {
        either!(self, run => run.closed_loop().snapshot())
    }

    /// Advances the closed loop alone, without record or metrics, under its own torque or under
    /// `external` [N·m]. Returns false if the new state is not finite.
    pub fn advance(&mut self, external: Option<&[f64]>) -> bool {
        either!(self, run => run.closed_loop_mut().advance(external))
    }
}

impl Scenario {
    /// Reads a scenario from TOML text.
    ///
    /// # Errors
    /// With line and column, or the dotted path of the first fault.
    pub fn from_toml(text: &str) -> Result<Self, ScenarioError> {
        Self::from_document(&parse_toml(text)?)
    }

    /// Reads a scenario from a document, and judges each of its parts.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn from_document(document: &Table) -> Result<Self, ScenarioError> {
        let scenario: Self = read(document)?;
        scenario.judge()?;
        Ok(scenario)
    }

    fn judge(&self) -> Result<(), ScenarioError> {
        let n = self.arm.dof();
        arm::number("duration", self.duration, arm::positive)?;
        let model = Arc::new(self.arm.build().map_err(|error| error.inside("arm"))?);
        arm::length("q0", self.q0.len(), n)?;
        if let Some(dq0) = &self.dq0 {
            arm::length("dq0", dq0.len(), n)?;
        }
        judge::controller(&self.controller, Some(n))
            .and_then(|()| judge::controller_of(&self.controller, model.limits()))
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
        judge::simulation(&self.simulation).map_err(|error| error.inside("simulation"))?;
        if self.duration / self.simulation.dt > MAX_STEPS {
            let requirement = format!("at most {MAX_STEPS:e} steps of {} s", self.simulation.dt);
            return Err(ScenarioError::out_of_range("duration", &requirement, self.duration));
        }
        if self.duration < self.simulation.dt {
            let requirement = format!("at least one step of {} s", self.simulation.dt);
            return Err(ScenarioError::out_of_range("duration", &requirement, self.duration));
        }
        self.reality(&model).map(drop)?;
        for (j, obstacle) in self.obstacles.iter().enumerate() {
            judge::obstacle(obstacle).map_err(|error| error.inside(&format!("obstacles[{j}]")))?;
        }
        Ok(())
    }

    /// The physical arm, the sensors and the drives.
    fn reality(&self, model: &Arc<PlanarArm>) -> Result<Reality, ScenarioError> {
        let (n, dt) = (model.dof(), self.simulation.dt);
        let plant = self.plant.build(&self.arm, model).map_err(|error| error.inside("plant"))?;
        let sampled = self.simulation.control != Control::Continuous;
        if let Some(settings) = &self.measurement {
            judge::measurement(settings, n, dt, sampled)
                .map_err(|error| error.inside("measurement"))?;
        }
        let perception =
            self.perception.as_ref().filter(|given| given.kind == PerceptionKind::Range);
        if let Some(settings) = perception {
            judge::perception(settings, n, dt, sampled)
                .map_err(|error| error.inside("perception"))?;
        }
        if let Some(settings) = &self.actuator {
            judge::actuator(settings, n, sampled).map_err(|error| error.inside("actuator"))?;
        }
        let measurement = self.measurement.as_ref();
        Ok(Reality {
            plant,
            measurement: measurement.map(|given| Measurement::new(given, self.seed, n, dt)),
            perception: perception.map(|given| Perception::new(given, self.seed, n, dt)),
            actuator: self.actuator.as_ref().map(|given| Actuator::new(given, n, dt)),
        })
    }

    /// The physical arm, payload included.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn plant_arm(&self) -> Result<Arc<PlanarArm>, ScenarioError> {
        let model = Arc::new(self.arm.build().map_err(|error| error.inside("arm"))?);
        Ok(self.reality(&model)?.plant.arm)
    }

    /// Builds the run.
    ///
    /// # Errors
    /// If the reference does not fit the task or leaves the reach of the arm, or the record does not
    /// fit into memory.
    pub fn prepare(&self) -> Result<Ready, ScenarioError> {
        self.prepare_recorded(true)
    }

    /// The same, with a record or with nothing but metrics.
    ///
    /// # Errors
    /// As [`prepare`](Self::prepare).
    pub fn prepare_recorded(&self, recorded: bool) -> Result<Ready, ScenarioError> {
        let arm = Arc::new(self.arm.build().map_err(|error| error.inside("arm"))?);
        match self.controller.task {
            TaskKind::Position => self.prepare_for::<2>(&arm, recorded, AnyRun::Position),
            TaskKind::Pose => self.prepare_for::<3>(&arm, recorded, AnyRun::Pose),
        }
    }

    fn prepare_for<const M: usize>(
        &self,
        arm: &Arc<PlanarArm>,
        recorded: bool,
        wrap: impl Fn(Box<Run<M>>) -> AnyRun,
    ) -> Result<Ready, ScenarioError> {
        let n = arm.dof();
        let dq0 = self.dq0.clone().unwrap_or_else(|| vec![0.0; n]);
        let mut state = arm.state();
        state.update(&self.q0, &dq0);
        let trajectory = Trajectory::<M>::new(&self.reference, state.pose()).map_err(|error| {
            ScenarioError::new(
                format!("reference.{}", error.field()),
                Problem::Other(error.to_string()),
            )
        })?;
        self.reachable(arm, &trajectory)?;
        let gains = Gains::<M>::new(&self.controller).with_seed(self.seed);
        let world = World::new(self.obstacles.clone());
        let options = self.simulation.clone();
        let reality = self.reality(arm)?;
        let stops = reality.plant.stops.clone();
        let start = [self.q0.clone(), dq0];
        let closed_loop = ClosedLoop::new(arm, gains, world, trajectory, options, reality, start);
        let mut warnings = self.oddities(&closed_loop.snapshot(), &stops);
        if self.simulation.control != Control::Continuous {
            let period = self.simulation.control_period();
            warnings.extend(
                sampling_bounds(&self.controller, period)
                    .into_iter()
                    .map(|warning| format!("controller.{warning}")),
            );
            warnings.extend(self.field_bound(closed_loop.controller()));
        }
        let run =
            Run::new(closed_loop, &self.simulation, self.duration, recorded).map_err(|error| {
                ScenarioError::new(
                    "simulation.record_every",
                    Problem::Other(format!("{error}: record fewer of them")),
                )
            })?;
        Ok(Ready { run: wrap(Box::new(run)), warnings })
    }

    /// What the record of a whole run takes [bytes].
    #[expect(clippy::cast_precision_loss, reason = "a size to compare")]
    pub fn record_bytes(&self) -> f64 {
        let (n, m) = (self.arm.dof(), self.controller.task.dimension());
        let rows = self.simulation.rows(self.duration);
        let rays = self.perception.as_ref().map_or(0, |given| given.rays_of(n));
        rows as f64 * Record::row_bytes(n, m, self.obstacles.len(), rays) as f64
    }

    /// The whole reference lies where the arm can put its end effector.
    fn reachable<const M: usize>(
        &self,
        arm: &PlanarArm,
        trajectory: &Trajectory<M>,
    ) -> Result<(), ScenarioError> {
        // A pose is reachable if the last joint can be where the pose puts it.
        let last = arm.links()[arm.dof() - 1].length;
        let (inner, outer) = arm.reach(if M > 2 { arm.dof() - 1 } else { arm.dof() });
        let slack = 1e-9 * outer.max(last);
        let point = |t: f64| {
            let x = trajectory.at(t).x;
            let wrist = if M > 2 { last } else { 0.0 };
            let angle = if M > 2 { x[2] } else { 0.0 };
            Vector::<2>::new(x[0] - wrist * angle.cos(), x[1] - wrist * angle.sin())
        };
        let inside = |t: f64| {
            let distance = point(t).norm();
            inner - slack <= distance && distance <= outer + slack
        };
        let samples = self.simulation.steps(self.duration).clamp(1, 100_000);
        #[expect(clippy::cast_precision_loss, reason = "at most 100 000")]
        let time = |k: usize| self.duration * (k as f64 / samples as f64);
        let Some(k) = (0..=samples).find(|&k| !inside(time(k))) else { return Ok(()) };
        let (mut before, mut after) = (time(k.saturating_sub(1)), time(k));
        for _ in 0..60 {
            let middle = 0.5 * (before + after);
            if inside(middle) { before = middle } else { after = middle }
        }
        let at = point(after);
        let (x, y, distance) = (at.x, at.y, at.norm());
        let problem = Problem::Unreachable { time: after, x, y, distance, inner, outer };
        Err(ScenarioError::new("reference", problem))
    }

    /// What is allowed but probably not meant.
    fn oddities(&self, start: &Snapshot<'_>, stops: &[[f64; 2]]) -> Vec<String> {
        let mut warnings = vec![];
        for (link, clearance) in start.clearance.iter().enumerate() {
            if *clearance < 0.0 {
                warnings.push(format!(
                    "obstacles: link {link} is {:.4} m inside an obstacle at t = 0",
                    -clearance
                ));
            }
        }
        for (i, (q, [lower, upper])) in start.q.iter().zip(stops).enumerate() {
            if q < lower || upper < q {
                warnings.push(format!(
                    "q0[{i}]: {q} rad is beyond the stops of the joint at {lower} and {upper}; the first \
                     step puts it there (plant.joint_stops = false takes them away)"
                ));
            }
        }
        let steps = self.simulation.steps(self.duration);
        let end = self.simulation.time(steps);
        if (end - self.duration).abs() > 1e-6 * self.simulation.dt {
            warnings.push(format!(
                "duration: {} s is no multiple of simulation.dt = {} s; the run ends at {end} s",
                self.duration, self.simulation.dt
            ));
        }
        let delays = self.measurement.iter().flat_map(|given| given.delay.values());
        let dt = self.simulation.dt;
        for delay in delays {
            let late = MeasurementSettings::steps(*delay, dt) * dt;
            if (late - delay).abs() > 1e-6 * dt {
                warnings.push(format!(
                    "measurement.delay: {delay} s is no multiple of simulation.dt = {dt} s; readings are \
                     {late} s old"
                ));
            }
        }
        warnings
    }

    /// A field too stiff for the control period: where the obstacles stand at the start, or at the
    /// clearance that the fastest of them is to be expected to come to (T29, T34).
    fn field_bound<const M: usize>(
        &self,
        controller: &Controller<PlanarState, 2, M>,
    ) -> Option<String> {
        if self.controller.field.gain == 0.0 {
            return None;
        }
        let h = self.simulation.control_period();
        let speed = self.obstacles.iter().map(|o| o.motion.top_speed()).fold(0.0, f64::max);
        let now = controller.stable_period(&mut World::new(self.obstacles.clone()));
        let (worst, when) = match controller.stable_period_against(speed) {
            coming if speed > 0.0 && coming.period < now.period => {
                (coming, "which is to be expected")
            }
            _ => (now, "as at the start"),
        };
        // One that stands inside the arm has its own warning.
        (worst.stiffness > 0.0 && worst.clearance >= 0.0 && h >= worst.period).then(|| {
            format!(
                "controller.field: at a clearance of {:.3} m, {when}, its stiffness is {:.3} N/m, for \
                 which the null space is stable up to a control period of {:.6} s; it is {h} s. More \
                 null_damping, a lower gain or a shorter period helps",
                worst.clearance, worst.stiffness, worst.period
            )
        })
    }
}

/// Gains that a torque held over the control period `h` [s] makes unstable (T31, T32).
pub fn sampling_bounds(settings: &Settings, h: f64) -> Vec<String> {
    let Settings { stiffness, damping, null_damping, task, .. } = settings;
    let mut warnings = vec![];
    let strongest = null_damping.values().iter().copied().fold(0.0, f64::max);
    if strongest * h >= 2.0 {
        warnings.push(format!(
            "null_damping: {strongest} 1/s is unstable at a control period of {h} s; below {} 1/s it \
             is not",
            2.0 / h
        ));
    }
    let axis = (0..task.dimension()).map(|i| (stiffness.get(i), damping.get(i)));
    if let Some((k, d)) = axis.into_iter().find(|(k, d)| *k > 0.0 && 0.5 * h * k >= *d) {
        warnings.push(format!(
            "damping: {d} 1/s is too little for a stiffness of {k} 1/s² at a control period of {h} s; \
             above {} 1/s it is enough",
            0.5 * h * k
        ));
    }
    if let Some(d) = damping.values().iter().find(|d| **d * h >= 2.0) {
        warnings.push(format!(
            "damping: {d} 1/s is unstable at a control period of {h} s; below {} 1/s it is not",
            2.0 / h
        ));
    }
    warnings
}
