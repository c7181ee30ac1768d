//! A scenario that runs for ever against the wall clock while people interfere with it.

use super::drag::{DragTarget, DragTurn};
use super::fault::guarded;
use super::points::PointsError;
use super::real_time::at_rate;
use super::run::AnyRun;
use super::wrenches::{ActingPull, ActingWrench};
use crate::control::settings::Part;
use crate::control::{SelfMotionMap, Settings};
use crate::math::UnitQuaternion;
use crate::scenario::{self, Problem, Scenario, ScenarioError};
use crate::simulation::pace::wait_until;
use crate::simulation::{DepthPicture, Metric, Metrics, Record, RecordTooLarge, Snapshot, Value};
use crate::world::space::Points;
use std::mem;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use toml::Table;

/// Control periods per second \[Hz\].
pub const RATE: f64 = 1000.0;
const PERIOD: Duration = Duration::from_millis(1);
/// How far the loop may be behind before it gives up catching up: after a night's sleep of the machine
/// nobody wants to see the night simulated.
const PATIENCE: Duration = Duration::from_millis(100);
/// How often a loop that stands still looks whether it is to go on.
const LOOK: Duration = Duration::from_millis(10);
/// Over which the rate is measured.
const WINDOW: Duration = Duration::from_millis(500);
/// Poles of what carries an obstacle and of what moves the target \[1/s\]. Browsers tell of a drag about
/// 20 times a second; between two of them neither velocity nor acceleration may jump.
const CARRY: f64 = 25.0;
const AIM: f64 = 12.0;
/// How fast what is turned by hand turns: an obstacle, and the target \[rad/s\].
const TURN: f64 = 4.0;
const TURN_TARGET: f64 = 1.0;
/// How fast the place goes that a link is pulled to \[reaches/s\].
const HAND: f64 = 2.0;
/// Control periods per recorded row.
const RECORD_EVERY: u64 = 10;
/// Rows that wait to be taken \[10 s\].
const ROWS: usize = 1000;

/// How the loop is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum State {
    /// It runs.
    Running,
    /// It stands still until it is told to go on.
    Paused,
    /// It stands still: the next state would not have been finite. A reset helps.
    Diverged,
    /// It stands still: a fault of the program, in its words. A reset helps.
    Failed(String),
}

/// How well the clock is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopStats {
    /// Periods per second of late \[Hz\].
    pub rate: f64,
    /// Periods so far.
    pub periods: u64,
    /// Of these, how many were not over when the next one should have begun.
    pub missed: u64,
    /// The longest computation so far \[s\].
    pub worst: f64,
}

/// A closed loop that people interact with. One [`tick`](Self::tick) is one control period; it does not
/// allocate. Everything else may.
///
/// # Example
/// ```
/// use vff_core::runtime::live::{Live, LoopStats, State};
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let mut live = Live::new(&Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     "#,
/// )?)?;
/// live.aim(&[1.1, 0.6]); // where the target is dragged
/// live.tick();
/// assert_eq!(live.state(), &State::Running);
/// live.configure_as(&toml::toml! { stiffness = 100.0 damping = 20.0 })?;
/// let LoopStats { rate, .. } = live.stats();
/// assert!(rate >= 0.0);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Live {
    scenario: Scenario,
    run: AnyRun,
    state: State,
    /// Where the obstacles are being carried, one per obstacle; None for what moves by itself.
    drags: Vec<Option<DragTarget>>,
    /// Where the target is being moved, if it is.
    target: DragTarget,
    aims: bool,
    /// How the target is being turned, if it is.
    turned: Option<DragTurn>,
    /// Where a link was taken hold of, and where it is pulled to from there, if it is.
    pulled: Option<Grip>,
    /// Of the control periods since the start or the last reset.
    metrics: Metrics,
    record: Option<Record>,
    dropped: u64,
    stats: LoopStats,
    window: (Instant, u64),
    /// What was changed for the clock or is odd, in sentences.
    pub notes: Vec<String>,
}

/// Somebody has hold of a link.
#[derive(Debug)]
struct Grip {
    /// Where the point was when it was taken hold of \[m\].
    from: Vec<f64>,
    /// Where it is pulled to.
    anchor: DragTarget,
}

impl Live {
    /// The scenario at t = 0. Its duration is of no meaning.
    ///
    /// # Errors
    /// If it cannot be run.
    pub fn new(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let (scenario, mut notes) = at_rate(scenario, RATE);
        scenario.validate()?;
        let ready = scenario.prepare_recorded(false)?;
        notes.extend(ready.warnings);
        let mut this = Self {
            drags: vec![None; scenario.scene.obstacle_count()],
            target: DragTarget::at(vec![0.0; ready.run.snapshot().dimension]),
            aims: false,
            turned: None,
            pulled: None,
            metrics: unmeasured(&ready.run),
            run: ready.run,
            state: State::Running,
            record: None,
            dropped: 0,
            stats: LoopStats { rate: 0.0, periods: 0, missed: 0, worst: 0.0 },
            window: (Instant::now(), 0),
            notes,
            scenario,
        };
        this.run.plan_beside();
        this.run.make_touchable();
        this.observe();
        Ok(this)
    }

    /// Goes back to t = 0 of the scenario, with the present settings; where it stands still it stays there
    /// until it is told to go on. The record goes on only if there are as many obstacles as before.
    ///
    /// # Errors
    /// None that [`new`](Self::new) and [`configure`](Self::configure) have not found.
    pub fn reset(&mut self) -> Result<(), ScenarioError> {
        let Live { run, drags, notes, .. } = Self::new(&self.scenario)?;
        (self.run, self.drags, self.notes) = (run, drags, notes);
        if self.state != State::Paused {
            self.state = State::Running;
        }
        (self.aims, self.turned, self.pulled) = (false, None, None);
        self.metrics = unmeasured(&self.run);
        let count = self.snapshot().obstacles.count();
        self.record = self.record.take().filter(|record| record.sizes.obstacles == count);
        self.observe();
        Ok(())
    }

    /// Stands still, or goes on.
    pub fn pause(&mut self, paused: bool) {
        match (&self.state, paused) {
            (State::Running, true) => self.state = State::Paused,
            (State::Paused, false) => self.state = State::Running,
            _ => {}
        }
    }

    /// How it is.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// How well the clock is kept.
    pub fn stats(&self) -> LoopStats {
        self.stats
    }

    /// The present instant.
    pub fn snapshot(&self) -> Snapshot<'_> {
        self.run.snapshot()
    }

    /// [`ErasedRun::pushes`](crate::runtime::ErasedRun::pushes).
    pub fn pushes(&mut self) -> [Vec<f64>; 2] {
        self.run.pushes()
    }

    /// [`ErasedRun::wrenches`](crate::runtime::ErasedRun::wrenches).
    pub fn wrenches(&self) -> Vec<ActingWrench> {
        self.run.wrenches()
    }

    /// [`ErasedRun::pictures`](crate::runtime::ErasedRun::pictures).
    pub fn pictures(&self) -> Vec<DepthPicture> {
        self.run.pictures()
    }

    /// [`ErasedRun::self_motion_map`](crate::runtime::ErasedRun::self_motion_map).
    pub fn self_motion_map(&self) -> Option<SelfMotionMap> {
        self.run.self_motion_map()
    }

    /// The parts of its task that the look-ahead lets go at present, in their order; None among them is what is not named. None
    /// at all without such an order.
    pub fn released(&self) -> Option<Vec<Option<Part>>> {
        let released = self.run.snapshot().released?;
        let Settings { yielding, task, .. } = &self.scenario.controller;
        let mut parts = yielding.parts(self.scenario.scene.dimension(), *task);
        parts.truncate(released);
        Some(parts)
    }

    /// Smallest signed surface distance since the start or the last reset \[m\], but from what a tip presses on; ∞ without obstacles.
    pub fn min_clearance(&self) -> f64 {
        self.metrics.min_room()
    }

    /// What has been measured since the start or the last reset, of every control period. There is no tail.
    pub fn metrics(&self) -> Vec<(&'static Metric, Value)> {
        self.metrics.values(self.run.left_out(), self.run.left_of_reference())
    }

    /// Takes over the settings of a `[controller]` table.
    ///
    /// # Errors
    /// If they are wrong, do not fit, or ask for another task.
    pub fn configure_as(&mut self, table: &Table) -> Result<(), ScenarioError> {
        let (limits, sizes) = (self.run.limits(), self.run.sizes());
        let robot = self.scenario.robot_name();
        let settings = scenario::read_settings_of_scenario(table, limits, robot, sizes)
            .map_err(|error| error.inside("controller"))?;
        self.configure(settings)
    }

    /// Takes over other settings of the controller, which the scenario validates.
    ///
    /// # Errors
    /// If they do not fit, or ask for another task.
    pub fn configure(&mut self, settings: Settings) -> Result<(), ScenarioError> {
        if settings.task != self.scenario.controller.task {
            let problem = Problem::Other("cannot change while the loop runs".into());
            return Err(ScenarioError::new("controller.task", problem));
        }
        let scenario = Scenario { controller: settings, ..self.scenario.clone() };
        scenario.validate()?;
        let settings = &scenario.controller;
        self.run.configure(settings, scenario.seed);
        self.scenario = scenario;
        Ok(())
    }

    /// Wants obstacle `j` to be at `place` \[m\], where it goes at half the reach of the arm per second at
    /// most.
    ///
    /// # Errors
    /// If there is none of that number.
    pub fn carry(&mut self, j: usize, place: &[f64]) -> Result<(), ScenarioError> {
        self.exists(j)?;
        let now = || DragTarget::at(self.run.obstacle_position(j));
        self.drags[j].get_or_insert_with(now).wanted.copy_from_slice(place);
        Ok(())
    }

    /// Wants the end effector to be at `place` \[m\], or as near as it can reach, where the reference goes
    /// at a quarter of the reach per second at most.
    pub fn aim(&mut self, place: &[f64]) {
        let Self { run, target, aims, .. } = self;
        let s = run.snapshot();
        if !*aims {
            target.goal.copy_from_slice(&s.x_ref[..s.dimension]);
            *aims = true;
        }
        let wanted = &mut target.wanted;
        wanted.copy_from_slice(place);
        run.make_attainable(wanted);
    }

    /// Wants the end effector to be turned like this, where the reference goes at 1 rad/s at most.
    ///
    /// # Errors
    /// If the task has no orientation in space.
    pub fn turn_target(&mut self, orientation: UnitQuaternion) -> Result<(), ScenarioError> {
        let x_ref = self.run.snapshot().x_ref;
        let Some(Ok(now)) = x_ref.get(3..7).map(|q| UnitQuaternion::new([q[0], q[1], q[2], q[3]]))
        else {
            let problem = Problem::Other("the task has no orientation in space".into());
            return Err(ScenarioError::new("orientation", problem));
        };
        if !self.aims {
            let place = x_ref[..3].to_vec();
            self.aim(&place);
        }
        self.turned.get_or_insert(DragTurn { goal: now, wanted: now }).wanted = orientation;
        Ok(())
    }

    /// Has a motion planned to where the reference comes to rest, such as where the target is, and follows it when it is found: see
    /// [`ErasedRun::plan_now`](crate::runtime::ErasedRun::plan_now). Ends a recording that has no plans.
    ///
    /// # Errors
    /// If the reference never comes to rest, or a joint slides without an end.
    pub fn plan(&mut self) -> Result<(), ScenarioError> {
        let had_plans = self.snapshot().has_plans();
        self.run.plan_now(&self.scenario)?;
        if !had_plans {
            self.record = None;
        }
        Ok(())
    }

    /// [`ErasedRun::last_search`](crate::runtime::ErasedRun::last_search).
    pub fn last_search(&self) -> Option<&'static str> {
        self.run.last_search()
    }

    /// Wants obstacle `j` to be turned like this, at 4 rad/s. It goes on moving as before. Not without a jump of its rate,
    /// as one does that follows waypoints.
    ///
    /// # Errors
    /// If there is none of that number, or in the plane.
    pub fn turn(&mut self, j: usize, orientation: UnitQuaternion) -> Result<(), ScenarioError> {
        self.exists(j)?;
        self.run.turn(j, orientation, TURN)
    }

    /// Takes hold of a link at a point, as the keys `link` and `point` of a document say, with a spring that does not pull
    /// yet ([`Pull`](crate::simulation::Pull)).
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn grab(&mut self, document: &Table) -> Result<(), ScenarioError> {
        self.run.pull(Some(document))?;
        self.pulled = self
            .run
            .pulled()
            .map(|pull| Grip { from: pull.wrench.point, anchor: DragTarget::at(pull.anchor) });
        Ok(())
    }

    /// Pulls towards the place that is so far from where the link was taken hold of \[m\]. Nothing if nobody has.
    pub fn pull_by(&mut self, offset: &[f64]) {
        if let Some(Grip { from, anchor }) = &mut self.pulled {
            for ((wanted, from), by) in anchor.wanted.iter_mut().zip(from).zip(offset) {
                *wanted = *from + by;
            }
        }
    }

    /// Lets go of the link.
    ///
    /// # Errors
    /// None that [`grab`](Self::grab) has not found.
    pub fn let_go(&mut self) -> Result<(), ScenarioError> {
        self.pulled = None;
        self.run.pull(None)
    }

    /// What a link is pulled with.
    pub fn pulled(&self) -> Option<ActingPull> {
        self.run.pulled()
    }

    /// [`ErasedRun::orientation_of_points`](crate::runtime::ErasedRun::orientation_of_points).
    ///
    /// # Errors
    /// If it is no cloud.
    pub fn orientation_of_points(&self, j: usize) -> Result<[f64; 4], PointsError> {
        self.run.orientation_of_points(j)
    }

    /// Puts other points in place of those of obstacle `j`.
    ///
    /// # Errors
    /// If it is no cloud, or not the one that they were made for; then nothing has changed.
    pub fn update_points(&mut self, j: usize, points: &Points) -> Result<(), PointsError> {
        self.run.update_points(j, points, &self.scenario.controller)
    }

    /// [`ErasedRun::turns`](crate::runtime::ErasedRun::turns).
    pub fn turns(&self) -> Vec<f64> {
        self.run.turns()
    }

    /// The number of coordinates of a place, 2 or 3.
    pub fn dimension(&self) -> usize {
        self.run.snapshot().dimension
    }

    /// Adds the obstacle of a document, the last one from now on. Ends a recording.
    ///
    /// # Errors
    /// With the dotted path of the first fault of the document.
    pub fn add(&mut self, document: &Table) -> Result<(), ScenarioError> {
        self.run.add(document)?;
        self.record = None;
        self.drags.push(None);
        Ok(())
    }

    /// Takes obstacle `j` away; those behind it move up. Ends a recording.
    ///
    /// # Errors
    /// If there is none of that number.
    pub fn remove(&mut self, j: usize) -> Result<(), ScenarioError> {
        self.exists(j)?;
        self.run.remove(j);
        self.record = None;
        self.drags.remove(j);
        Ok(())
    }

    /// Begins to record, or ends it: every hundredth of a second a row, to be taken with
    /// [`take`](Self::take).
    ///
    /// # Errors
    /// If there is not enough memory.
    pub fn record(&mut self, on: bool) -> Result<(), RecordTooLarge> {
        self.record = on.then(|| Record::with_capacity(ROWS, &self.snapshot())).transpose()?;
        self.dropped = 0;
        Ok(())
    }

    /// Whether it records.
    pub fn is_recording(&self) -> bool {
        self.record.is_some()
    }

    /// The rows recorded since the last call, and how many were lost since the recording began because
    /// nobody took them in time.
    ///
    /// # Errors
    /// If there is not enough memory.
    pub fn take(&mut self) -> Result<(Option<Record>, u64), RecordTooLarge> {
        let fresh = Record::with_capacity(ROWS, &self.run.snapshot())?;
        Ok((self.record.as_mut().map(|record| mem::replace(record, fresh)), self.dropped))
    }

    /// One control period. A fault ends in a state that says so.
    pub fn tick(&mut self) {
        if self.state != State::Running {
            return;
        }
        match guarded(|| self.advance()) {
            Ok(true) => self.observe(),
            Ok(false) => self.state = State::Diverged,
            Err(fault) => self.state = State::Failed(fault),
        }
    }

    /// Moves what people drag and takes the steps of one control period; false if it cannot go on.
    fn advance(&mut self) -> bool {
        let Self { run, drags, target, aims, turned, pulled, scenario, .. } = self;
        let step = 0.5 * run.reach() / RATE;
        for (j, drag) in drags.iter_mut().enumerate() {
            if let Some(drag) = drag
                && drag.advance(step)
            {
                run.carry(j, &drag.goal, CARRY);
            }
        }
        if let Some(Grip { anchor, .. }) = pulled
            && anchor.advance(HAND * run.reach() / RATE)
        {
            run.pull_towards(&anchor.goal);
        }
        if *aims {
            let moved = target.advance(0.5 * step);
            let turns = turned.as_mut().is_some_and(|turn| turn.advance(TURN_TARGET / RATE));
            match turned {
                Some(turn) if turns || moved => run.aim_pose(&target.goal, turn.goal, AIM),
                None if moved => run.aim(&target.goal, AIM),
                _ => {}
            }
        }
        (0..scenario.simulation.control_every).all(|_| run.advance(None))
    }

    /// Takes note of the present instant.
    fn observe(&mut self) {
        let Self { run, record, metrics, stats, dropped, .. } = self;
        let snapshot = run.snapshot();
        metrics.update(&snapshot);
        if let Some(record) = record
            && stats.periods.is_multiple_of(RECORD_EVERY)
        {
            if record.rows < ROWS {
                record.push(&snapshot);
            } else {
                *dropped += 1;
            }
        }
    }

    /// Counts a period from its `begin` to its `end` that had to be over by `deadline`.
    fn count(&mut self, begin: Instant, end: Instant, deadline: Instant) {
        let Self { stats, window, .. } = self;
        stats.periods += 1;
        stats.missed += u64::from(end > deadline);
        stats.worst = stats.worst.max((end - begin).as_secs_f64());
        let (since, before) = *window;
        if end - since >= WINDOW {
            #[expect(clippy::cast_precision_loss, reason = "some hundreds")]
            let periods = (stats.periods - before) as f64;
            stats.rate = periods / (end - since).as_secs_f64();
            *window = (end, stats.periods);
        }
    }

    fn exists(&self, j: usize) -> Result<(), ScenarioError> {
        let count = self.drags.len();
        if j < count {
            return Ok(());
        }
        let problem = Problem::Other(format!("there is none, only {count} obstacles"));
        Err(ScenarioError::new(format!("obstacles[{j}]"), problem))
    }
}

/// Metrics of a run without an end.
fn unmeasured(run: &AnyRun) -> Metrics {
    Metrics::new(run.sizes()[0], f64::INFINITY, PERIOD.as_secs_f64(), run.limits().clone())
}

/// Whoever panicked while it held the lock left nothing half done: [`Live::tick`] catches its own.
pub fn lock(live: &Mutex<Live>) -> MutexGuard<'_, Live> {
    live.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ticks at [`RATE`] until `stop` is set. Nothing allocates.
///
/// The deadlines are absolute; what is late is caught up with, unless it is later than 0.1 s. A loop that
/// stands still leaves the processor to others, and looks every 10 ms whether it is to go on.
pub fn serve(live: &Mutex<Live>, stop: &AtomicBool) {
    let mut deadline = Instant::now() + PERIOD;
    while wait_until(deadline, stop).is_some() {
        let mut live = lock(live);
        let begin = Instant::now();
        if live.state != State::Running {
            live.window = (begin, live.stats.periods);
            deadline = begin + LOOK;
            continue;
        }
        live.tick();
        let end = Instant::now();
        deadline += PERIOD;
        live.count(begin, end, deadline);
        if end > deadline + PATIENCE {
            deadline = end + PERIOD;
        }
    }
}

#[cfg(test)]
mod tests;
