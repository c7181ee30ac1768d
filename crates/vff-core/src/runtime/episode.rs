//! A scenario as an episode: actions in, observations and rewards out, from a random start to an end.
//!
//! An agent is a controller, so it observes what the law observes: the state as it is measured. It is
//! rewarded for the truth.

use super::observation::{POSE_IN_SPACE, shown_axes};
use super::run::AnyRun;
use crate::math::ScalarOrVec;
use crate::scenario::{self, AnyScene, Problem, Scenario, ScenarioError};
use crate::scenario::{each, number};
use crate::settings::{NOT_NEGATIVE, POSITIVE};
use crate::simulation::PerceptionKind;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::Deserialize;
use std::sync::Arc;
use toml::Table;

/// What an action is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// A joint torque that is added to the law's after its projection into the null space.
    NullSpace,
    /// The joint torque itself, instead of the law's.
    Torque,
}

/// How a scenario becomes an episode.
///
/// # Example
/// ```
/// use vff_core::runtime::episode::{Action, EpisodeSettings, Weights};
///
/// let settings: EpisodeSettings = toml::from_str("action = \"torque\"\nweights = { effort = 0.0 }").unwrap();
/// assert_eq!(settings.action, Action::Torque);
/// assert_eq!(settings.weights, Weights { effort: 0.0, ..Weights::default() });
/// ```
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EpisodeSettings {
    /// What an action is.
    pub action: Action,
    /// How long an action lasts \[s\]: a multiple of the control period, nearest to 0.01 s if not given.
    pub period: Option<f64>,
    /// The torque of an action of 1 \[N·m\], each, > 0. Default: the limits of the arm, or what carries
    /// the stretched arm and accelerates each of its joints by 4 rad/s².
    pub torque: Option<ScalarOrVec>,
    /// The start is q0, every joint up to this far from it \[rad\], ≥ 0.
    pub start_noise: f64,
    /// Every obstacle starts up to this far from its position along each axis \[m\], ≥ 0.
    pub obstacle_noise: f64,
    /// Below this clearance \[m\] the reward falls, > 0.
    pub margin: f64,
    /// What counts for the reward.
    pub weights: Weights,
}

/// Factors of the parts of the reward, each ≥ 0.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// For every step that the episode goes on.
    pub alive: f64,
    /// Against the distance of the end effector from its reference, an angle counting as its arc at the arm's characteristic length \[1/m\].
    pub tracking: f64,
    /// Against the square of the share of `margin` that is used up.
    pub clearance: f64,
    /// Against the mean square of the action.
    pub effort: f64,
    /// Against an end by collision or divergence, once.
    pub collision: f64,
}

impl Default for EpisodeSettings {
    fn default() -> Self {
        Self {
            action: Action::NullSpace,
            period: None,
            torque: None,
            start_noise: 0.05,
            obstacle_noise: 0.1,
            margin: 0.2,
            weights: Weights::default(),
        }
    }
}

impl Default for Weights {
    fn default() -> Self {
        Self { alive: 1.0, tracking: 10.0, clearance: 1.0, effort: 0.1, collision: 100.0 }
    }
}

/// A joint faster than this ends an episode as diverged \[rad/s\]; it bounds the observation.
const MAX_SPEED: f64 = 100.0;
/// How often a start is drawn anew that touches an obstacle.
const MAX_DRAWS: usize = 100;

/// Some numbers of the observation, in a row.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// What they are.
    pub name: &'static str,
    /// One row each of this many numbers; 1 if they are a plain list.
    pub shape: [usize; 2],
    /// The largest that each of them is shown as, as is its negative.
    pub bound: f64,
}

/// What a step tells beside the observation, in this order.
pub const INFO: [&str; 9] = [
    "t",
    "clearance",
    "tracking_error",
    "reward_alive",
    "reward_tracking",
    "reward_clearance",
    "reward_effort",
    "reward_collision",
    "diverged",
];

/// What came of one step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Step {
    /// The reward: the sum of its parts in `info`.
    pub reward: f64,
    /// Whether a link touched an obstacle, but for one whose tip is to press on something, or the arm became too fast.
    pub terminated: bool,
    /// Whether the scenario is over.
    pub truncated: bool,
    /// The numbers named by [`INFO`].
    pub info: [f64; INFO.len()],
}

impl Step {
    /// Whether the episode ends with it.
    pub fn is_last(&self) -> bool {
        self.terminated || self.truncated
    }
}

/// A scenario with everything about its episodes that never changes.
#[derive(Debug)]
pub struct Task {
    scenario: Scenario,
    settings: EpisodeSettings,
    /// The range of every joint \[rad\]; empty where there is none.
    ranges: Vec<[f64; 2]>,
    /// The torque of an action of 1 \[N·m\].
    torque: Vec<f64>,
    /// Control periods per step, and plant steps per control period and episode.
    periods: usize,
    plant_steps: usize,
    last: usize,
    layout: Vec<Part>,
}

impl Task {
    /// Reads and validates the settings, and the scenario with them.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn new(scenario: Scenario, settings: &Table) -> Result<Self, ScenarioError> {
        let settings: EpisodeSettings = scenario::read(settings)?;
        let options = &scenario.simulation;
        let run = scenario.prepare_recorded(false)?.run;
        let limits = run.limits();
        let n = run.snapshot().q.len();
        validate(&settings, n)?;
        if let (Action::Torque, Some(given)) = (settings.action, &settings.torque)
            && scenario.controller.enforce_limits
        {
            for (i, limit) in limits.torque.iter().enumerate() {
                if given.get(i) > *limit {
                    let path = match given {
                        ScalarOrVec::Uniform(_) => "torque".into(),
                        ScalarOrVec::Each(_) => format!("torque[{i}]"),
                    };
                    let requirement = format!("within the limit {limit} of joint {i}");
                    return Err(ScenarioError::out_of_range(&path, &requirement, given.get(i)));
                }
            }
        }
        let torque = match &settings.torque {
            Some(given) => (0..n).map(|i| given.get(i)).collect(),
            None if limits.torque.is_empty() => run.typical_torque(),
            None => limits.torque.clone(),
        };
        Ok(Self {
            periods: periods(settings.period, options.control_period())?,
            plant_steps: options.control_every,
            last: options.steps(scenario.duration),
            layout: layout(&scenario, &run, &torque, settings.start_noise),
            ranges: limits.joint.clone(),
            torque,
            settings,
            scenario,
        })
    }

    /// The number of joints, which is that of an action's numbers.
    pub fn joints(&self) -> usize {
        self.torque.len()
    }

    /// The torque of an action of 1 \[N·m\], (n).
    pub fn torque(&self) -> &[f64] {
        &self.torque
    }

    /// How long an action lasts \[s\].
    #[expect(clippy::cast_precision_loss, reason = "few periods")]
    pub fn period(&self) -> f64 {
        self.periods as f64 * self.scenario.simulation.control_period()
    }

    /// [`Scenario::run_numbers`].
    pub fn run_numbers(&self) -> f64 {
        self.scenario.run_numbers()
    }

    /// What an observation consists of.
    pub fn layout(&self) -> &[Part] {
        &self.layout
    }

    /// The length of an observation.
    pub fn width(&self) -> usize {
        self.layout.iter().map(|part| part.shape[0] * part.shape[1]).sum()
    }

    /// A scenario with another start, random if the settings say so.
    fn draw(&self, random: &mut ChaCha8Rng) -> Scenario {
        let EpisodeSettings { start_noise, obstacle_noise, .. } = self.settings;
        let mut scenario = self.scenario.clone();
        for (i, q) in scenario.q0.iter_mut().enumerate() {
            *q += start_noise * uniform(random);
            if let Some([lower, upper]) = self.ranges.get(i)
                && start_noise > 0.0
            {
                *q = q.clamp(*lower, *upper);
            }
        }
        scenario.scene.shift_obstacles(|| obstacle_noise * uniform(random));
        scenario.seed = random.next_u64();
        scenario
    }
}

fn validate(settings: &EpisodeSettings, n: usize) -> Result<(), ScenarioError> {
    if let Some(torque) = &settings.torque {
        each("torque", torque, n, &POSITIVE)?;
    }
    number("start_noise", settings.start_noise, &NOT_NEGATIVE)?;
    number("obstacle_noise", settings.obstacle_noise, &NOT_NEGATIVE)?;
    number("margin", settings.margin, &POSITIVE)?;
    let Weights { alive, tracking, clearance, effort, collision } = settings.weights;
    number("weights.alive", alive, &NOT_NEGATIVE)?;
    number("weights.tracking", tracking, &NOT_NEGATIVE)?;
    number("weights.clearance", clearance, &NOT_NEGATIVE)?;
    number("weights.effort", effort, &NOT_NEGATIVE)?;
    number("weights.collision", collision, &NOT_NEGATIVE)
}

/// How many control periods of `h` \[s\] an action lasts.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "validated here")]
fn periods(given: Option<f64>, h: f64) -> Result<usize, ScenarioError> {
    let period = given.unwrap_or(0.01);
    let count = (period / h).round().max(1.0);
    if given.is_some() && (count * h - period).abs() > 1e-6 * h {
        let requirement = format!("a multiple of the control period {h} s");
        return Err(ScenarioError::out_of_range("period", &requirement, period));
    }
    if count > 1e9 {
        return Err(ScenarioError::out_of_range("period", "at most 1e9 control periods", period));
    }
    Ok(count as usize)
}

/// A distance from the base beyond which the end effector does not come in this scenario \[m\], where it starts so far from q0: a
/// joint slides as far as it comes in that time, and no farther than to its ends.
fn reach(scenario: &Scenario, run: &AnyRun, noise: f64) -> f64 {
    let AnyScene::Space(scene) = &scenario.scene else { return run.reach() };
    let Ok(arm) = scene.arm.build() else { return run.reach() };
    let limits = run.limits();
    arm.stretched(|i| {
        let end =
            limits.joint.get(i).map_or(f64::INFINITY, |[low, high]| low.abs().max(high.abs()));
        let speed = limits.velocity.get(i).map_or(MAX_SPEED, |limit| limit.min(MAX_SPEED));
        end.min(scenario.q0[i].abs() + noise + speed * scenario.duration)
    })
}

/// What an observation of this scenario consists of, where an action of 1 is this `torque` \[N·m, N\] and a joint starts within
/// `noise` of q0 \[rad, m\].
fn layout(scenario: &Scenario, run: &AnyRun, torque: &[f64], noise: f64) -> Vec<Part> {
    let s = run.snapshot();
    let (d, n, m, k) = (s.dimension, s.q.len(), s.error.len(), scenario.scene.obstacle_count());
    let reach = reach(scenario, run, noise);
    let far = 2.0 * reach;
    let top_speed = scenario.scene.top_speed().max(1.0);
    let part = |name, shape, bound| Part { name, shape, bound };
    let turning = (0..n).filter(|&i| !run.slides(i)).count();
    let mut parts = vec![part("cos_q", [turning, 1], 1.0), part("sin_q", [turning, 1], 1.0)];
    if turning < n {
        parts.push(part("slide", [n - turning, 1], far));
    }
    parts.extend([
        part("dq", [n, 1], MAX_SPEED),
        part("tip", [d, 1], far),
        part("reference", [d, 1], far),
        part("reference_velocity", [d, 1], 10.0 * reach),
        part("error", [m, 1], far.max(std::f64::consts::PI)),
    ]);
    if s.x_ref.len() == POSE_IN_SPACE {
        let axes = shown_axes(m).len();
        parts.extend([
            part("tip_axes", [axes, 3], 1.0),
            part("reference_axes", [axes, 3], 1.0),
            part("reference_angular_velocity", [m - d, 1], MAX_SPEED),
        ]);
    }
    if scenario.controller.observer.is_some() {
        parts.push(part("tau_ext_estimate", [n, 1], largest(torque)));
    }
    let sensed =
        scenario.perception.as_ref().is_some_and(|given| given.kind != PerceptionKind::Ideal);
    let sees_all = !sensed && scenario.contacts.iter().flatten().all(|contact| contact.seen);
    if sensed || k > 0 {
        parts.push(part("clearance", [n, 1], far));
    }
    if sees_all && k > 0 {
        parts.extend([
            part("nearest", [n, d], far),
            part("obstacles", [k, d], far),
            part("obstacle_velocities", [k, d], top_speed),
        ]);
    }
    parts
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// A number between −1 and 1, evenly spread.
#[expect(clippy::cast_precision_loss, reason = "53 bits fit")]
fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// One episode after the other.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::runtime::episode::{Episode, Part, Step, Task};
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 0.05
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     "#,
/// )?;
/// let task = Arc::new(Task::new(scenario, &toml::toml! { action = "torque" })?);
/// let layout: &[Part] = task.layout();
/// assert!(!layout.is_empty() && task.torque().len() == 3);
/// let mut episode = Episode::new(&task, 1)?;
/// episode.reset(None)?;
/// let Step { reward, terminated, .. } = episode.step(&[0.0; 3]);
/// assert!(reward.is_finite() && !terminated);
/// let mut observation = vec![];
/// episode.observe(&mut observation);
/// assert_eq!(observation.len(), task.width());
/// # Ok(())
/// # }
/// ```
///
/// # See also
/// [`EpisodeSettings`] and its [`Weights`]; [`Episodes`](super::vector::Episodes) steps many at once.
#[derive(Debug)]
pub struct Episode {
    task: Arc<Task>,
    random: ChaCha8Rng,
    run: AnyRun,
    /// Plant steps so far.
    elapsed: usize,
    tau: Vec<f64>,
}

impl Episode {
    /// A first episode; the same seed gives the same ones.
    ///
    /// # Errors
    /// If a start cannot be run.
    pub fn new(task: &Arc<Task>, seed: u64) -> Result<Self, ScenarioError> {
        let scenario = &task.scenario;
        let mut this = Self {
            task: Arc::clone(task),
            random: ChaCha8Rng::seed_from_u64(seed),
            run: scenario.prepare_recorded(false)?.run,
            elapsed: 0,
            tau: vec![0.0; task.joints()],
        };
        this.reset(None)?;
        Ok(this)
    }

    /// Begins another episode, the first of `seed` if there is one.
    ///
    /// # Errors
    /// If the start cannot be run, or all that were drawn touch an obstacle.
    pub fn reset(&mut self, seed: Option<u64>) -> Result<(), ScenarioError> {
        if let Some(seed) = seed {
            self.random = ChaCha8Rng::seed_from_u64(seed);
        }
        let EpisodeSettings { start_noise, obstacle_noise, .. } = self.task.settings;
        let draws = if start_noise + obstacle_noise > 0.0 { MAX_DRAWS } else { 1 };
        self.elapsed = 0;
        for _ in 0..draws {
            let scenario = self.task.draw(&mut self.random);
            self.run = scenario.prepare_recorded(false)?.run;
            if self.run.least_clearance() > 0.0 {
                return Ok(());
            }
        }
        Err(self.touches_always(draws))
    }

    /// That all of so many starts touch an obstacle, with what is in the way in the last of them.
    fn touches_always(&self, draws: usize) -> ScenarioError {
        let EpisodeSettings { start_noise, obstacle_noise, .. } = self.task.settings;
        let [what, obstacle] = match self.run.nearest() {
            Some([link, obstacle]) => [format!("link {link}"), format!("obstacles[{obstacle}]")],
            None => ["a link".into(), "an obstacle that is not seen".into()],
        };
        let of = if draws > 1 {
            format!(
                " in the last of {draws} starts, all in contact, drawn with start_noise {start_noise} \
                 and obstacle_noise {obstacle_noise}"
            )
        } else {
            " at the start".into()
        };
        ScenarioError::new("", Problem::Other(format!("{what} touches {obstacle}{of}")))
    }

    /// Acts for one period. An action's numbers count from −1 to 1, beyond as the nearer of them.
    pub fn step(&mut self, action: &[f64]) -> Step {
        let Self { task, run, elapsed, tau, .. } = self;
        act(run, task, action, elapsed, tau)
    }

    /// What the controller knows, in the order of [`Task::layout`].
    pub fn observe(&mut self, out: &mut Vec<f64>) {
        let Self { task, run, .. } = self;
        out.clear();
        run.observe(out);
        let bounds = task
            .layout
            .iter()
            .flat_map(|part| std::iter::repeat_n(part.bound, part.shape[0] * part.shape[1]));
        for (value, bound) in out.iter_mut().zip(bounds) {
            *value = value.clamp(-bound, bound);
        }
    }

    /// The present instant as [`INFO`], before any step.
    pub fn info(&mut self) -> [f64; INFO.len()] {
        let mut info = [0.0; INFO.len()];
        info[0] = self.run.snapshot().t;
        info[1] = self.run.least_clearance();
        info[2] = self.run.task_error();
        info
    }
}

fn act(
    run: &mut AnyRun,
    task: &Task,
    action: &[f64],
    elapsed: &mut usize,
    tau: &mut [f64],
) -> Step {
    let EpisodeSettings { margin, weights, action: kind, .. } = &task.settings;
    let (mut clearance, mut diverged, mut effort) = (f64::INFINITY, false, 0.0);
    for value in action {
        effort += value.clamp(-1.0, 1.0).powi(2);
    }
    'step: for _ in 0..task.periods {
        for ((tau, action), torque) in tau.iter_mut().zip(action).zip(&task.torque) {
            *tau = action.clamp(-1.0, 1.0) * torque;
        }
        if *kind == Action::NullSpace {
            run.add_in_null_space(tau);
        }
        for _ in 0..task.plant_steps {
            if *elapsed >= task.last {
                break 'step;
            }
            let slow = |dq: &[f64]| dq.iter().all(|v| v.abs() <= MAX_SPEED);
            diverged = !run.advance(Some(tau)) || !slow(run.velocity());
            *elapsed += 1;
            clearance = clearance.min(run.least_clearance());
            if diverged || clearance < 0.0 {
                break 'step;
            }
        }
    }
    let error = run.task_error();
    let terminated = diverged || clearance < 0.0;
    let used = (1.0 - clearance / margin).clamp(0.0, 1.0);
    let parts = [
        weights.alive,
        -weights.tracking * error,
        -weights.clearance * used * used,
        -weights.effort * effort / task.torque.len() as f64,
        if terminated { -weights.collision } else { 0.0 },
    ];
    let mut info = [0.0; INFO.len()];
    info[..3].copy_from_slice(&[run.snapshot().t, clearance, error]);
    info[3..8].copy_from_slice(&parts);
    info[8] = f64::from(u8::from(diverged));
    let truncated = *elapsed >= task.last && !terminated;
    Step { reward: parts.iter().sum(), terminated, truncated, info }
}
