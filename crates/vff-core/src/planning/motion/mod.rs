//! A motion of all joints to a goal, around what is in the way: found before anything moves, and smooth in time.
//!
//! A path is searched by two trees of configurations (`tree`) among those that touch nothing (`free_space`), shortened,
//! rounded (`curve`), and gone along as fast as the joints allow (`time_law`). The same seed gives the same motion.

mod around;
mod bundle;
mod curve;
mod free_space;
mod goals;
mod in_time;
mod knots;
mod levers;
mod margins;
mod own_room;
mod plan;
mod planner;
mod pointing;
mod report;
mod straight;
mod time_law;
mod timing;
mod tree;
mod why;

use super::feasibility::{MAX_ACCELERATION, MAX_SPEED};
use crate::control::{CommandSettings, Gravity, SelfCollision, speed_shares};
use crate::interrupt;
use crate::inverse_kinematics::{Residual, Solver};
use crate::math::{Noise, ScalarOrVec, sort_by_first, whole_turns};
use crate::robot::Manipulator;
use crate::robot::{Limits, Model, Robot};
use crate::scenario::{
    AnyScene, CheckReach, Problem, Scenario, ScenarioError, Scene, bounded, dispatch, each, number,
    numbers_of, unusable,
};
use crate::settings::{FINITE, NOT_NEGATIVE, POSITIVE};
use crate::simulation::{SpaceTypes, System, hide_unseen};
use crate::trajectory::{Guided, JointSpline, Knots, Peaks, Trajectory};
use crate::world::World;
use around::Window;
use curve::Curve;
use free_space::FreeSpace;
pub use levers::Jointed;
use margins::{APART, End, Margins, SHARE};
pub use plan::{Plan, PlanSettings, PlanStatus};
pub(super) use planner::ranges_of;
use planner::{Aim, Planner, STREAM};
use pointing::Pointing;
pub(super) use pointing::leads_upright;
use std::f64::consts::PI;
use std::fmt::Write;
use std::sync::Arc;
use time_law::{Bounds, LONGEST, Stop, TimeLaw};
use timing::CHECKS;
pub(super) use timing::STEP;
use why::{beyond, length, too_far};

/// Joints stay within this of 0 \[rad or m\]: searches, paths and their checks are as long as the way.
const FARTHEST: f64 = 100.0;

/// Plans a motion of the arm of `scenario` among its obstacles.
///
/// # Errors
/// If a setting or the scenario is of no use. That nothing is found is no error: see [`Plan::status`].
///
/// # Example
/// ```
/// use vff_core::planning::motion::{PlanSettings, PlanStatus, plan};
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     obstacles = [{ shape = { kind = "circle", radius = 0.1 }, position = [1.2, 1.2] }]
///     "#,
/// )?;
/// let goal = Some(vec![1.2, 0.5, -0.6]);
/// let found = plan(&scenario, &PlanSettings { goal, ..PlanSettings::default() })?;
/// assert_eq!(found.status, PlanStatus::Found);
/// assert_eq!(found.q.len(), 3 * found.times.len());
/// assert!(found.clearance >= found.margin);
/// # Ok(())
/// # }
/// ```
///
/// # See also
/// [`JointSpline`] makes a reference of it; [`Replanner`](super::replanning::Replanner) finds another one on the way.
pub fn plan(scenario: &Scenario, settings: &PlanSettings) -> Result<Plan, ScenarioError> {
    let task = scenario.controller.task;
    dispatch!(&scenario.scene, task, AnyScene(scene) => plan_for(scenario, scene, settings))
}

fn validate(settings: &PlanSettings, n: usize, dimension: usize) -> Result<(), ScenarioError> {
    let PlanSettings { start, goal, upright, .. } = settings;
    for (path, given) in [("start", start), ("goal", goal), ("upright", upright)] {
        if let Some(given) = given {
            numbers_of(path, given.len(), n)?;
            near_enough(path, given)?;
        }
    }
    number("margin", settings.margin, &NOT_NEGATIVE)?;
    bounded("margin", settings.margin)?;
    bounded("time", settings.time)?;
    if let Some(horizon) = settings.horizon {
        number("horizon", horizon, &NOT_NEGATIVE)?;
        bounded("horizon", horizon)?;
    }
    for (path, given) in [("approach", &settings.approach), ("retreat", &settings.retreat)] {
        match given {
            None => {}
            Some(ScalarOrVec::Uniform(far)) => {
                number(path, *far, &NOT_NEGATIVE)?;
                near_enough(path, &[*far])?;
            }
            Some(ScalarOrVec::Each(along)) => {
                numbers_of(path, along.len(), dimension)?;
                near_enough(path, along)?;
            }
        }
    }
    if let Some(tilt) = settings.tilt {
        number("tilt", tilt, &POSITIVE)?;
        number("tilt", tilt, &FINITE)?;
    }
    if let Some((point, angle)) = &settings.view {
        numbers_of("view", point.len(), dimension)?;
        near_enough("view", point)?;
        number("view_angle", *angle, &POSITIVE)?;
        number("view_angle", *angle, &FINITE)?;
    }
    for (path, given) in [("acceleration", &settings.acceleration), ("jerk", &settings.jerk)] {
        if let Some(given) = given {
            each(path, given, n, &POSITIVE)?;
            each(path, given, n, &FINITE)?;
        }
    }
    number("speed", settings.speed, &POSITIVE)?;
    if settings.paths == 0 {
        return Err(ScenarioError::out_of_range("paths", "at least 1", 0.0));
    }
    if settings.speed > 1.0 {
        return Err(ScenarioError::out_of_range("speed", "at most 1", settings.speed));
    }
    Ok(())
}

/// Whether a motion may begin or end at `q`.
fn near_enough(path: &str, q: &[f64]) -> Result<(), ScenarioError> {
    let far = |q: &f64| q.is_nan() || q.abs() > FARTHEST;
    q.iter().position(far).map_or(Ok(()), |i| {
        let within = format!("within {FARTHEST} rad or m of 0, where motions are planned");
        Err(ScenarioError::out_of_range(format!("{path}[{i}]"), &within, q[i]))
    })
}

fn plan_for<S, const D: usize, const M: usize>(
    scenario: &Scenario,
    scene: &Scene<S, D>,
    settings: &PlanSettings,
) -> Result<Plan, ScenarioError>
where
    S: CheckReach<D, M>,
    S::State: Jointed<D>,
{
    let arm = Arc::new(S::arm(&scene.arm).map_err(|error| error.inside("arm"))?);
    validate(settings, arm.dof(), D)?;
    let start = settings.start.clone().unwrap_or_else(|| scenario.q0.clone());
    near_enough("q0", &start)?;
    let mut state = arm.state();
    has_ends(&state, arm.limits())?;
    let goal = match (&settings.goal, S::Pose::plan(&scene.reference)) {
        (Some(goal), _) => Goal::Configuration(goal.clone()),
        (None, Some(Knots { points, .. })) => {
            let last = points.last().cloned().unwrap_or_default();
            numbers_of("reference.points", last.len(), start.len())?;
            near_enough(&format!("reference.points[{}]", points.len() - 1), &last)?;
            Goal::Configuration(last)
        }
        (None, None) => {
            state.update_positions(&scenario.q0);
            let tip = Manipulator::<D, M>::pose(&state);
            let trajectory = Trajectory::<S::Pose, M>::new(&scene.reference, &tip)
                .map_err(|error| unusable(&error))?;
            Goal::Pose(trajectory.at(scenario.duration).x)
        }
    };
    let keeps_apart = scenario.controller.self_collision != SelfCollision::Ignore;
    let mut world = World::new(scene.obstacles.clone());
    hide_unseen(&mut world, &scenario.contacts);
    world.know_links(&arm.link_names());
    let command = scenario.controller.command.clone();
    let kept = speed_shares(&command, scenario.controller.observer.is_some());
    Task::<S, D, M> { arm, world, keeps_apart, command, kept, goal, start }.plan(settings)
}

/// A joint that slides needs an end, as random configurations are between its ends.
pub(super) fn has_ends<R: Jointed<D>, const D: usize>(
    robot: &R,
    limits: &Limits,
) -> Result<(), ScenarioError> {
    for i in 0..robot.dof() {
        if robot.slides(i) && ranges_of(limits, i).iter().any(|end| end.is_infinite()) {
            let problem = format!("joint {i} slides without an end: a plan needs `joint_limits`");
            return Err(ScenarioError::new("arm", Problem::Other(problem)));
        }
    }
    Ok(())
}

/// Where the end effector has to point that may lean by `tilt` \[rad\] from how it stands at `upright`, and keeps what it is to `view`.
pub(super) fn pointings<R: Jointed<D>, const D: usize>(
    robot: &mut R,
    upright: &[f64],
    tilt: Option<f64>,
    view: Option<&(Vec<f64>, f64)>,
) -> Vec<Pointing> {
    let tilt = tilt.map(|most| Pointing::upright(robot, upright, most));
    let view = view.map(|(point, angle)| Pointing::in_view::<D>(point, *angle));
    tilt.into_iter().chain(view).collect()
}

/// Where the arm has to go.
#[derive(Debug, Clone)]
pub(super) enum Goal<P> {
    /// All joints \[rad or m\].
    Configuration(Vec<f64>),
    /// The end effector.
    Pose(P),
}

/// Who goes where, and what is in the way.
#[derive(Debug, Clone)]
pub(super) struct Task<S: System<D, M>, const D: usize, const M: usize> {
    pub arm: Arc<S::Arm>,
    pub world: World<S::Geometry, D>,
    /// Whether bodies of the arm must not touch each other.
    pub keeps_apart: bool,
    /// What the law that will follow sends to the robot.
    pub command: CommandSettings,
    /// The shares of the largest speeds of joints and of the tip that it keeps.
    pub kept: [f64; 2],
    pub goal: Goal<S::Pose>,
    /// Where the joints are \[rad or m\].
    pub start: Vec<f64>,
}

impl<S: System<D, M>, const D: usize, const M: usize> Task<S, D, M>
where
    S::State: Jointed<D>,
{
    /// The motion, with settings that have been validated; their start and goal are not looked at.
    ///
    /// # Errors
    /// If limits make it take too long.
    pub fn plan(&self, settings: &PlanSettings) -> Result<Plan, ScenarioError> {
        let plan = self.plan_by(settings, false)?;
        let Self { world, .. } = self;
        let is_lost = matches!(
            plan.status,
            PlanStatus::StartBlocked | PlanStatus::GoalBlocked | PlanStatus::NotFound
        );
        let passes = settings.horizon.is_some_and(|horizon| horizon > 0.0)
            && (0..world.len()).any(|j| !world.stands_still(j));
        if !(is_lost && passes) {
            return Ok(plan);
        }
        let in_time = self.plan_by(settings, true).ok();
        Ok(in_time.filter(|it| it.status == PlanStatus::Found).unwrap_or(plan))
    }

    /// The motion that keeps from all places that things pass, or from each when it is passed.
    fn plan_by(&self, settings: &PlanSettings, in_time: bool) -> Result<Plan, ScenarioError> {
        let Self { arm, world, keeps_apart, command, kept, goal, start } = self;
        let PlanSettings { time, horizon, margin, .. } = *settings;
        let window = Some(Window { start: time, duration: horizon, in_time });
        let mut space = FreeSpace::new(arm.state(), world, window, *keeps_apart, margin);
        let upright = settings.upright.as_ref().unwrap_or(start);
        space.pointings = pointings(space.robot(), upright, settings.tilt, settings.view.as_ref());
        let mut planner = Planner::<S, D> {
            space,
            arm: Arc::clone(arm),
            settings,
            start: start.clone(),
            command,
            kept: *kept,
            noise: Noise::new(settings.seed, STREAM),
        };
        let mut plan = match goal {
            Goal::Configuration(q) => planner.plan(Aim::At(q)),
            Goal::Pose(pose) => planner.plan(Aim::Found {
                find: &mut |planner, limits| planner.configurations::<M>(pose, limits),
                is_turned: M > D,
            }),
        }?;
        let robot = planner.space.robot();
        plan.tip.reserve(plan.q.len() / start.len() * D);
        for q in plan.q.chunks(start.len()) {
            robot.update_positions(q);
            plan.tip.extend_from_slice(robot.tip().as_slice());
        }
        Ok(plan)
    }

    /// Whether the straight motion to `end` touches nothing that rests at present.
    pub fn is_straight(&self, end: &[f64]) -> bool {
        let Self { arm, world, keeps_apart, start, .. } = self;
        let now = Some(Window { start: world.time(), duration: None, in_time: false });
        let mut space = FreeSpace::new(arm.state(), world, now, *keeps_apart, 0.0);
        space.is_free_between(start, end)
    }
}

#[cfg(test)]
mod tests;
