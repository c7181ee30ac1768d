//! A motion of all joints to a goal, around what is in the way: found before anything moves, and smooth in time.
//!
//! A path is searched by two trees of configurations (`tree`) among those that touch nothing (`free_space`), shortened,
//! rounded (`curve`), and gone along as fast as the joints allow (`time_law`). The same seed gives the same motion.

mod curve;
mod free_space;
mod time_law;
mod tree;
mod why;

use super::feasibility::{MAX_ACCELERATION, MAX_SPEED};
use crate::control::{SelfCollision, TaskKind};
use crate::interrupt;
use crate::inverse_kinematics::Solver;
use crate::math::Noise;
use crate::robot::Manipulator;
use crate::robot::{Limits, Model, Robot};
use crate::scenario::{
    AnyScene, Prepared, Problem, Scenario, ScenarioError, Scene, not_negative, number, numbers_of,
    positive, unusable,
};
use crate::simulation::{Plane, Space, System};
use crate::trajectory::{Guided, JointSpline, Trajectory};
use crate::world::World;
use curve::Curve;
pub use free_space::Jointed;
use free_space::{FreeSpace, Window};
use std::f64::consts::{PI, TAU};
use std::fmt::Write;
use std::sync::Arc;
use time_law::{Bounds, LONGEST, Stop, TimeLaw};
use why::beyond;

/// Where the random numbers of planning come from.
const STREAM: u64 = 7;
/// Configurations from which inverse kinematics is tried, where one is free by then, and at most; and free ones that
/// are enough.
const SEEDS: [usize; 2] = [64, 512];
const GOALS: usize = 8;
/// Configurations nearer than this are one goal \[rad\].
const SAME: f64 = 0.1;
/// Joints stay within this of 0 \[rad or m\]: searches, paths and their checks are as long as the way.
const FARTHEST: f64 = 100.0;
/// Paths that are searched, of which the shortest is taken.
const ATTEMPTS: usize = 4;
/// Shortcuts that are tried on each.
const SHORTCUTS: usize = 200;
/// What is kept of the margin of the path where corners are rounded.
const ROUNDED: f64 = 0.5;
/// Share of the torque limits that a plan uses: the rest is for reacting.
const TORQUE: f64 = 0.8;
/// Time between two configurations of a plan \[s\], and how often it is halved.
const STEP: f64 = 0.04;
const REFINEMENTS: u32 = 3;
/// Instants per knot at which a motion is checked.
const CHECKS: u32 = 4;

/// What is planned, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanSettings {
    /// Where the joints are \[rad\]; by default the scenario's `q0`.
    pub start: Option<Vec<f64>>,
    /// Where they have to go \[rad\]; by default whatever puts the end effector where the reference ends.
    pub goal: Option<Vec<f64>>,
    /// When it starts \[s\].
    pub time: f64,
    /// What every link keeps from obstacles \[m\], ≥ 0; less where start or goal have less.
    pub margin: f64,
    /// For how long the places that moving obstacles will pass are kept free \[s\], ≥ 0; None leaves them out.
    pub horizon: Option<f64>,
    /// The share of the limits of speed and acceleration that is used, in (0, 1].
    pub speed: f64,
    /// How many random configurations are tried.
    pub samples: usize,
    /// Where the random numbers come from.
    pub seed: u64,
}

impl Default for PlanSettings {
    fn default() -> Self {
        Self {
            start: None,
            goal: None,
            time: 0.0,
            margin: 0.02,
            horizon: Some(1.0),
            speed: 0.5,
            samples: 20_000,
            seed: 0,
        }
    }
}

/// What planning has come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlanStatus {
    /// A motion to the goal.
    Found,
    /// The start touches something, or will be passed by something within the horizon.
    StartBlocked,
    /// No configuration within the joint limits puts the end effector there.
    GoalOutOfReach,
    /// Every configuration that was found for the goal touches something.
    GoalBlocked,
    /// No path among so many samples. It is no proof that there is none.
    NotFound,
    /// There is a path, but the joints cannot hold the arm somewhere on it.
    TooHeavy,
}

impl PlanStatus {
    /// Its name in every layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::Found => "found",
            Self::StartBlocked => "start blocked",
            Self::GoalOutOfReach => "goal out of reach",
            Self::GoalBlocked => "goal blocked",
            Self::NotFound => "not found",
            Self::TooHeavy => "too heavy",
        }
    }
}

/// A motion to a goal; or how far the search came.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Whether it leads to the goal, and if not, why.
    pub status: PlanStatus,
    /// The same in a sentence, with what is in the way and what would help.
    pub message: String,
    /// Instants \[s\] from the start on; none if nothing was found.
    pub times: Vec<f64>,
    /// The configuration at each instant \[rad\], one after the other; if nothing was found, the path to where a goal was
    /// nearest.
    pub q: Vec<f64>,
    /// Velocities \[rad/s\].
    pub dq: Vec<f64>,
    /// Accelerations \[rad/s²\].
    pub ddq: Vec<f64>,
    /// The smallest distance from obstacles on the way \[m\]; ∞ if there are none, and at the start if nothing was found.
    pub clearance: f64,
    /// What was kept of the margin \[m\].
    pub margin: f64,
    /// What is left to a goal \[rad\]; of one out of reach \[m\]; 0 if it was found.
    pub gap: f64,
    /// How many random configurations were tried.
    pub samples: usize,
    /// How many configurations the trees had.
    pub nodes: usize,
}

/// Plans a motion of the arm of `scenario` among its obstacles.
///
/// # Errors
/// If a setting or the scenario is of no use. That nothing is found is no error: see [`Plan::status`].
pub fn plan(scenario: &Scenario, settings: &PlanSettings) -> Result<Plan, ScenarioError> {
    use TaskKind::{Pointing, Pose, Position};
    match (&scenario.scene, scenario.controller.task) {
        (AnyScene::Plane(scene), Position) => plan_for::<Plane, 2, 2>(scenario, scene, settings),
        (AnyScene::Plane(scene), Pose) => plan_for::<Plane, 2, 3>(scenario, scene, settings),
        (AnyScene::Space(scene), Position) => plan_for::<Space, 3, 3>(scenario, scene, settings),
        (AnyScene::Space(scene), Pointing) => plan_for::<Space, 3, 5>(scenario, scene, settings),
        (AnyScene::Space(scene), Pose) => plan_for::<Space, 3, 6>(scenario, scene, settings),
        (AnyScene::Plane(_), Pointing) => unreachable!("validated: no task of the plane"),
    }
}

fn validate(settings: &PlanSettings, n: usize) -> Result<(), ScenarioError> {
    for (path, given) in [("start", &settings.start), ("goal", &settings.goal)] {
        if let Some(given) = given {
            numbers_of(path, given.len(), n)?;
            near_enough(path, given)?;
        }
    }
    number("margin", settings.margin, not_negative)?;
    let finite = ("finite", f64::is_finite as fn(f64) -> bool);
    number("margin", settings.margin, finite)?;
    number("time", settings.time, finite)?;
    if let Some(horizon) = settings.horizon {
        number("horizon", horizon, not_negative)?;
        number("horizon", horizon, finite)?;
    }
    number("speed", settings.speed, positive)?;
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
    S: Prepared<D, M>,
    S::State: Jointed<D>,
{
    let arm = Arc::new(S::arm(&scene.arm).map_err(|error| error.inside("arm"))?);
    validate(settings, arm.dof())?;
    let start = settings.start.clone().unwrap_or_else(|| scenario.q0.clone());
    near_enough("q0", &start)?;
    let mut state = arm.state();
    has_ends(&state, arm.limits())?;
    let goal = match (&settings.goal, S::Pose::plan(&scene.reference)) {
        (Some(goal), _) => Goal::Configuration(goal.clone()),
        (None, Some((_, points))) => {
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
    let world = World::new(scene.obstacles.clone());
    Task::<S, D, M> { arm, world, keeps_apart, goal, start }.plan(settings)
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
    pub world: World<S::Solid, D>,
    /// Whether bodies of the arm must not touch each other.
    pub keeps_apart: bool,
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
        let Self { arm, world, keeps_apart, goal, start } = self;
        let PlanSettings { time, horizon, margin, .. } = *settings;
        let window = horizon.map(|duration| Window { start: time, duration });
        let mut planner = Planner::<S, D, M> {
            space: FreeSpace::new(arm.state(), world, window, *keeps_apart, margin),
            arm: Arc::clone(arm),
            settings,
            start: start.clone(),
            noise: Noise::new(settings.seed, STREAM),
        };
        planner.plan(goal)
    }

    /// Whether the straight motion to `end` touches nothing that stands still.
    pub fn is_straight(&self, end: &[f64]) -> bool {
        let Self { arm, world, keeps_apart, start, .. } = self;
        let mut space = FreeSpace::new(arm.state(), world, None, *keeps_apart, 0.0);
        space.is_free_between(start, end)
    }
}

/// A search under way.
struct Planner<'a, S: System<D, M>, const D: usize, const M: usize> {
    arm: Arc<S::Arm>,
    space: FreeSpace<S::State, S::Solid, D>,
    settings: &'a PlanSettings,
    start: Vec<f64>,
    noise: Noise,
}

/// The range of joint `i`, infinite where it has no limits.
fn ranges_of(limits: &Limits, i: usize) -> [f64; 2] {
    limits.joint.get(i).copied().unwrap_or([f64::NEG_INFINITY, f64::INFINITY])
}

/// Why a path is of no use that cannot be rounded, or not followed smoothly.
fn too_tight() -> (PlanStatus, String) {
    let why = "there is a path, and no smooth motion near it keeps half of the margin; another seed or margin may help";
    (PlanStatus::NotFound, why.to_owned())
}

/// Which number makes a motion along `path` take this long \[s\].
fn too_slow(path: &[Vec<f64>], duration: f64, velocity: &[f64], bounds: &Bounds) -> ScenarioError {
    let travel =
        |i: usize| path.windows(2).map(|pair| (pair[1][i] - pair[0][i]).abs()).sum::<f64>();
    let most = format!("motions are planned that take up to {LONGEST} s");
    let slowest = (0..bounds.speed.len())
        .map(|i| (i, travel(i), bounds.speed[i]))
        .max_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)))
        .filter(|(_, way, speed)| way / speed > 0.5 * LONGEST || bounds.torque.is_empty());
    let (at, problem) = match slowest {
        Some((i, way, speed)) => {
            let limit = velocity.get(i).filter(|limit| way / **limit > 0.5 * LONGEST);
            let at = limit.map_or("speed".into(), |_| format!("arm.velocity_limits[{i}]"));
            let problem = format!(
                "joint {i} has {way:.3} to go at up to {speed:e} a second, which makes it {duration:.0e} s: {most}"
            );
            (at, problem)
        }
        None => {
            let problem = if duration.is_finite() {
                format!("too little to get anywhere in less than {duration:.0e} s: {most}")
            } else {
                format!("too little to get anywhere: {most}")
            };
            ("arm.torque_limits".into(), problem)
        }
    };
    ScenarioError::new(at, Problem::Other(problem))
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

impl<S: System<D, M>, const D: usize, const M: usize> Planner<'_, S, D, M>
where
    S::State: Jointed<D>,
{
    fn plan(&mut self, goal: &Goal<S::Pose>) -> Result<Plan, ScenarioError> {
        let start = self.start.clone();
        let limits = self.arm.limits().clone();
        let inside = |q: &[f64]| {
            q.iter().enumerate().all(|(i, q)| {
                let [lower, upper] = ranges_of(&limits, i);
                lower <= *q && *q <= upper
            })
        };
        let at_start = self.space.clearance(&start);
        let nothing = |status, message, gap, margin| Plan {
            status,
            message,
            times: vec![],
            q: start.clone(),
            dq: vec![],
            ddq: vec![],
            clearance: at_start,
            margin,
            gap,
            samples: 0,
            nodes: 0,
        };
        self.space.margin = self.settings.margin.min(0.9 * at_start);
        if at_start <= 0.0 || !inside(&start) || !self.space.is_free(&start) {
            let beyond = beyond(&start, &limits, "start", |i| self.space.robot().joint_name(i));
            let why = beyond.unwrap_or_else(|| self.obstruction(&start, "start"));
            return Ok(nothing(PlanStatus::StartBlocked, why, f64::INFINITY, 0.0));
        }
        let candidates = match goal {
            Goal::Configuration(q) if !inside(q) => {
                let why = beyond(q, &limits, "goal", |i| self.space.robot().joint_name(i));
                Err((f64::INFINITY, why.unwrap_or_default()))
            }
            Goal::Configuration(q) => Ok(vec![q.clone()]),
            Goal::Pose(pose) => self.configurations(pose, &limits).map_err(|gap| {
                let why = "no configuration within the joint limits was found nearer to the goal than";
                (gap, format!("{why} {gap:.3} m; a goal nearer to the arm, or without an orientation, helps"))
            }),
        };
        let mut candidates = match candidates {
            Ok(candidates) => candidates,
            Err((gap, why)) => {
                return Ok(nothing(PlanStatus::GoalOutOfReach, why, gap, self.space.margin));
            }
        };
        let room: Vec<f64> = candidates.iter().map(|q| self.space.clearance(q)).collect();
        let most = room.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        self.space.margin = self.space.margin.min(0.9 * most);
        let margin = self.space.margin;
        let best = (0..room.len()).max_by(|a, b| room[*a].total_cmp(&room[*b])).unwrap_or(0);
        let roomiest = candidates[best].clone();
        candidates.retain(|q| most > 0.0 && self.space.is_free(q));
        if candidates.is_empty() {
            let why = self.obstruction(&roomiest, "goal");
            return Ok(nothing(PlanStatus::GoalBlocked, why, f64::INFINITY, margin.max(0.0)));
        }
        let ranges: Vec<[f64; 2]> = (0..start.len())
            .map(|i| match ranges_of(&limits, i) {
                [lower, upper] if (upper - lower).is_finite() => {
                    [lower.max(-FARTHEST), upper.min(FARTHEST)]
                }
                [lower, upper] => {
                    [lower.max(start[i] - 1.25 * PI), upper.min(start[i] + 1.25 * PI)]
                }
            })
            .collect();
        let found = self.search(&candidates, &ranges);
        let Some(first) = found.iter().find(|found| found.gap == 0.0) else {
            let found = &found[0];
            let why = format!(
                "the search came to {:.3} rad from the goal after {} samples; more samples, another seed or a smaller \
                 margin may help",
                found.gap, found.samples,
            );
            return Ok(Plan {
                q: found.path.concat(),
                samples: found.samples,
                nodes: found.nodes,
                ..nothing(PlanStatus::NotFound, why, found.gap, margin)
            });
        };
        self.space.margin = ROUNDED * margin;
        let (mut status, mut why) = (PlanStatus::NotFound, String::new());
        for found in &found {
            match self.timed(&found.path, &limits)? {
                Ok(spline) => return Ok(self.finished(&spline, found, margin)),
                Err(error) => (status, why) = error,
            }
        }
        Ok(Plan {
            q: first.path.concat(),
            samples: first.samples,
            nodes: first.nodes,
            ..nothing(status, why, 0.0, margin)
        })
    }

    /// Several paths to `goals`, shortened, the shortest first; or, if the first search finds none, how far it came.
    fn search(&mut self, goals: &[Vec<f64>], ranges: &[[f64; 2]]) -> Vec<tree::Found> {
        let Self { space, settings, noise, start, .. } = self;
        let mut samples = settings.samples;
        let mut all: Vec<tree::Found> = vec![];
        for _ in 0..ATTEMPTS {
            let mut found = tree::search(space, start, goals, ranges, samples, noise);
            if found.gap > 0.0 {
                if all.is_empty() {
                    return vec![found];
                }
                continue;
            }
            let is_direct = found.samples == 0;
            samples = samples.min(4 * found.samples + 100);
            tree::shorten(space, &mut found.path, SHORTCUTS, noise);
            all.push(found);
            if is_direct {
                break;
            }
        }
        all.sort_by(|a, b| tree::length(&a.path).total_cmp(&tree::length(&b.path)));
        all
    }

    /// Free or not, configurations that put the end effector at `pose`, each with its joints as near to the start as
    /// full turns bring them. If there are none: how far it stays away \[m\].
    fn configurations(&mut self, pose: &S::Pose, limits: &Limits) -> Result<Vec<Vec<f64>>, f64> {
        let n = self.start.len();
        let length = self.arm.characteristic_length();
        let mut solver = Solver::<M>::new(n, length);
        let (mut found, mut free): (Vec<Vec<f64>>, usize) = (vec![], 0);
        let mut nearest = f64::INFINITY;
        for k in 0..SEEDS[1] {
            // What was not reached from so many is out of reach.
            if k >= SEEDS[0] && (free > 0 || found.is_empty()) {
                break;
            }
            let mut q = self.start.clone();
            if k > 0 {
                for (i, q) in q.iter_mut().enumerate() {
                    let [lower, upper] = ranges_of(limits, i);
                    let [lower, upper] = [lower.max(*q - PI), upper.min(*q + PI)];
                    *q = lower + (upper - lower) * self.noise.share();
                }
            }
            let residual = solver.solve(self.space.robot(), &mut q, pose);
            nearest = nearest.min(residual.size(length));
            if !residual.is_reached() {
                continue;
            }
            for (i, q) in q.iter_mut().enumerate() {
                if ranges_of(limits, i) == [f64::NEG_INFINITY, f64::INFINITY] {
                    *q -= TAU * ((*q - self.start[i]) / TAU).round();
                }
            }
            if found.iter().any(|known| apart(known, &q) < SAME) {
                continue;
            }
            free += usize::from(self.space.is_free(&q));
            found.push(q);
            if free == GOALS {
                break;
            }
        }
        found.sort_by(|a, b| apart(a, &self.start).total_cmp(&apart(b, &self.start)));
        if found.is_empty() { Err(nearest) } else { Ok(found) }
    }

    /// What blocks the arm at `q`, which is not free.
    fn obstruction(&mut self, q: &[f64], place: &str) -> String {
        let found = self.space.obstruction(q);
        let told = |found: why::Obstruction| found.told(place, self.settings.horizon);
        found.map_or_else(|| format!("a distance is undefined at the {place}"), told)
    }

    /// The motion along `path`, or why there is none.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "few knots")]
    fn timed(
        &mut self,
        path: &[Vec<f64>],
        limits: &Limits,
    ) -> Result<Result<JointSpline, (PlanStatus, String)>, ScenarioError> {
        let n = self.start.len();
        let Some(curve) = Curve::round(&mut self.space, path) else {
            return Ok(Err(too_tight()));
        };
        let share = self.settings.speed;
        let or = |given: &[f64], most: f64| -> Vec<f64> {
            (0..n).map(|i| share * given.get(i).copied().unwrap_or(most)).collect()
        };
        let bounds = Bounds {
            speed: or(&limits.velocity, MAX_SPEED),
            acceleration: or(&[], MAX_ACCELERATION[D - 2]),
            torque: limits.torque.iter().map(|most| TORQUE * most).collect(),
        };
        let law = match TimeLaw::fastest(self.space.robot(), &curve, &bounds) {
            Ok(law) => law,
            Err(Stop::Heavy(heavy)) => {
                let (robot, joint) = (self.space.robot(), heavy.joint);
                let why = heavy.told(&robot.joint_name(joint), robot.slides(joint), TORQUE);
                return Ok(Err((PlanStatus::TooHeavy, why)));
            }
            Err(Stop::Winding) => return Ok(Err(too_tight())),
            Err(Stop::Slow(duration)) => {
                return Err(too_slow(path, duration, &limits.velocity, &bounds));
            }
        };
        let mut state = [0; 3].map(|_| vec![0.0; n]);
        for refinement in 0..=REFINEMENTS {
            let step = STEP / f64::from(1 << refinement);
            let knots = (law.duration() / step).ceil().max(2.0) as u32;
            let mut points = vec![];
            for k in 0..=knots {
                let share = f64::from(k) / f64::from(knots);
                curve.at(law.at(law.duration() * share), &mut state);
                points.push(state[0].clone());
            }
            // To the last bit.
            let last = points.len() - 1;
            points[0].clone_from(&path[0]);
            points[last].clone_from(&path[path.len() - 1]);
            // Knots follow the law, not the spline between them: stretched until that keeps its limits, too.
            let mut stretch = 1.0;
            for _ in 0..8 {
                let duration = stretch * law.duration();
                let times: Vec<f64> =
                    (0..=knots).map(|k| duration * f64::from(k) / f64::from(knots)).collect();
                let Ok(spline) = JointSpline::new(&times, &points) else {
                    return Ok(Err(too_tight()));
                };
                let over = self.excess(&spline, &bounds, knots);
                if over > 1.0 {
                    stretch *= over.sqrt().max(1.002);
                } else if self.is_free_along(&spline, knots) {
                    return Ok(Ok(spline));
                } else {
                    break;
                }
            }
        }
        Ok(Err(too_tight()))
    }

    /// By what factor a motion exceeds a limit of acceleration or torque, or the square of one of speed.
    fn excess(&mut self, spline: &JointSpline, bounds: &Bounds, knots: u32) -> f64 {
        let n = self.start.len();
        let mut state = [0; 3].map(|_| vec![0.0; n]);
        let (mut scratch, mut torque) = (vec![0.0; n], vec![0.0; n]);
        let mut most: f64 = 0.0;
        for k in 0..=CHECKS * knots {
            interrupt::spend(64 * n);
            let [_, end] = spline.span();
            spline.at(
                end * f64::from(k) / f64::from(CHECKS * knots),
                state.each_mut().map(Vec::as_mut_slice),
            );
            let [q, dq, ddq] = &state;
            for i in 0..n {
                most = most.max((dq[i] / bounds.speed[i]).powi(2));
                most = most.max(ddq[i].abs() / bounds.acceleration[i]);
            }
            if !bounds.torque.is_empty() {
                let robot = self.space.robot();
                robot.update(q, dq);
                robot.inverse_dynamics(ddq, &mut scratch, &mut torque);
                for (tau, limit) in torque.iter().zip(&bounds.torque) {
                    most = most.max(tau.abs() / limit);
                }
            }
        }
        // The time law was rounded by as much at most.
        if most <= 1.0 + 1e-9 { 1.0 } else { most }
    }

    fn is_free_along(&mut self, spline: &JointSpline, knots: u32) -> bool {
        let n = self.start.len();
        let mut state = [0; 3].map(|_| vec![0.0; n]);
        let mut before = spline.first().to_vec();
        let [_, end] = spline.span();
        (1..=2 * knots).all(|k| {
            spline.at(
                end * f64::from(k) / f64::from(2 * knots),
                state.each_mut().map(Vec::as_mut_slice),
            );
            let free = self.space.is_free_between(&before, &state[0]);
            before.copy_from_slice(&state[0]);
            free
        })
    }

    fn finished(&mut self, spline: &JointSpline, found: &tree::Found, margin: f64) -> Plan {
        let n = self.start.len();
        let mut state = [0; 3].map(|_| vec![0.0; n]);
        let mut plan = Plan {
            status: PlanStatus::Found,
            message: String::new(),
            times: spline.times().to_vec(),
            q: vec![],
            dq: vec![],
            ddq: vec![],
            clearance: f64::INFINITY,
            margin,
            gap: 0.0,
            samples: found.samples,
            nodes: found.nodes,
        };
        for t in spline.times() {
            spline.at(*t, state.each_mut().map(Vec::as_mut_slice));
            // Its knots are within the limits but for rounding.
            plan.q.extend(state[0].iter().enumerate().map(|(i, q)| {
                let [lower, upper] = ranges_of(self.arm.limits(), i);
                q.clamp(lower, upper)
            }));
            plan.dq.extend_from_slice(&state[1]);
            plan.ddq.extend_from_slice(&state[2]);
        }
        for pair in spline.times().windows(2) {
            for k in 0..=2 * CHECKS {
                let share = f64::from(k) / f64::from(2 * CHECKS);
                let t = pair[0] + share * (pair[1] - pair[0]);
                spline.at(t, state.each_mut().map(Vec::as_mut_slice));
                plan.clearance = plan.clearance.min(self.space.clearance(&state[0]));
            }
        }
        plan.message = format!("a motion of {:.3} s", spline.span()[1]);
        if plan.clearance.is_finite() {
            let _ = write!(plan.message, " that keeps {:.1} mm", 1e3 * plan.clearance);
        }
        plan
    }
}

#[cfg(test)]
mod tests;
