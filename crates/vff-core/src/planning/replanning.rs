//! Makes a plan while a reference is being followed, where that leads nowhere: another plan (T121), or the first one (T179).

mod ahead;
mod braking;
mod change;
mod progress;
mod search;
mod worker;

use super::feasibility::{MAX_ACCELERATION, MAX_SPEED};
use super::motion::{
    Goal, Jointed, Plan, PlanSettings, PlanStatus, Task, has_ends, leads_upright, pointings,
    ranges_of,
};
use crate::control::output::unwrap;
use crate::control::{MotionLimits, SelfCollision, speed_shares};
use crate::interrupt::{self, Watch};
use crate::inverse_kinematics::Solver;
use crate::math::{Pose, ScalarOrVec, Vector, short_way};
use crate::planned_reference::follow_plan;
use crate::robot::{Limits, Manipulator, Model, Robot};
use crate::scenario::{CheckReach, Scenario, ScenarioError};
use crate::simulation::{Moment, Reason, Replan, ReplanCounts, ReplanSettings, Replanned, System};
use crate::trajectory::Trajectory;
use crate::world::World;
use ahead::Ahead;
use braking::Braking;
use change::{Change, place_at};
use progress::{Place, Progress};
use search::{Found, Search};
use std::mem::{replace, swap};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::channel;
use worker::Worker;

/// What is left of the margin in a plan's corners, and a little less.
const KEPT: f64 = 0.45;
/// So much later than it has to begin a plan is of no use any more that lets something pass \[s\].
const LATE: f64 = 0.05;
/// How often what passes by is waited for before another plan is searched.
const WAITS: u32 = 3;
/// Beyond its limits by no more than this, a joint counts as being at them \[rad or m\].
const AT_LIMIT: f64 = 0.02;
/// An end effector that is turned away by 1 rad counts as being so far off \[m\].
const LEVER: f64 = 0.4;
/// After a search that finds nothing the next one waits, twice as long each time, from so long to so long \[s\].
const PAUSES: [f64; 2] = [0.1, 3.2];

/// Watches over the reference that an arm follows: a plan, or a curve that comes to rest.
///
/// # Example
/// A closed loop asks for it; a document has `[replan]`:
/// ```
/// use vff_core::planning::replanning::Replanner;
/// use vff_core::simulation::{Moment, Replan, Space};
///
/// fn asks<R: Replan<Space, 3, 6>>(replanner: &mut R, moment: &Moment<'_, Space, 3, 6>) -> bool {
///     replanner.look(moment).is_some()
/// }
///
/// let ask: fn(&mut Replanner<Space, 3, 6>, &Moment<'_, Space, 3, 6>) -> bool = asks;
/// ```
#[derive(Debug)]
pub struct Replanner<S: System<D, M>, const D: usize, const M: usize> {
    settings: ReplanSettings,
    given: ReplanSettings,
    seed: u64,
    arm: Arc<S::Arm>,
    /// Which of its joints turn without an end.
    endless: Vec<bool>,
    /// Where the end effector stands upright \[rad or m\].
    upright: Vec<f64>,
    /// As it is at the beginning.
    world: World<S::Geometry, D>,
    first: Trajectory<S::Pose, M>,
    /// Where that, or what somebody has put in its place, comes to rest.
    goal: S::Pose,
    /// Whether the goal of a plan is where that puts another tip.
    is_exchanged: bool,
    /// Where searches are made while the loop goes on; None in a simulation.
    beside: Option<Worker>,
    search: Option<Search>,
    searches: Vec<Replanned>,
    /// What the plan keeps from everything \[m\], where it does not say so itself.
    kept: f64,
    /// How often what passes by has been waited for.
    waits: u32,
    ahead: Ahead<S, D, M>,
    progress: Progress,
    /// Whether somebody wants a plan now.
    is_wanted: bool,
    /// What moves the joints, where that is not a torque.
    able: Option<MotionLimits>,
    /// No search before this \[s\], and how long the last wait was.
    wait: [f64; 2],
}

impl<S, const D: usize, const M: usize> Replanner<S, D, M>
where
    S: CheckReach<D, M> + 'static,
    S::State: Jointed<D>,
{
    /// For what `arm` follows in `world`.
    ///
    /// # Errors
    /// If a joint slides without an end.
    pub fn new(
        settings: &ReplanSettings,
        scenario: &Scenario,
        (arm, world): (&Arc<S::Arm>, &World<S::Geometry, D>),
        reference: &Trajectory<S::Pose, M>,
    ) -> Result<Self, ScenarioError> {
        let mut state = arm.state();
        has_ends(&state, arm.limits())?;
        let pointings =
            pointings::<_, D>(&mut state, &scenario.q0, settings.tilt, view(settings).as_ref());
        leads_upright(&mut state, &pointings, reference.joints())?;
        state.update_positions(&scenario.q0);
        let mut this = Self {
            arm: Arc::clone(arm),
            endless: arm.endless(),
            upright: scenario.q0.clone(),
            world: world.clone(),
            goal: Manipulator::<D, M>::pose(&state),
            settings: copied(settings),
            given: copied(settings),
            seed: scenario.seed,
            first: reference.clone(),
            is_exchanged: false,
            beside: None,
            search: None,
            searches: vec![],
            kept: 0.0,
            waits: 0,
            ahead: Ahead::new(state, world),
            progress: Progress::default(),
            is_wanted: false,
            able: None,
            wait: [f64::NEG_INFINITY, PAUSES[0]],
        };
        this.begin();
        Ok(this)
    }

    fn begin(&mut self) {
        let Self { first, settings, ahead, arm, world, .. } = self;
        *ahead = Ahead::new(arm.state(), world);
        self.kept = 0.0;
        if let Some(plan) = first.joints() {
            let [start, end] = plan.span();
            let room = [(plan.first(), start), (plan.last(), end)]
                .map(|(q, t)| 0.9 * ahead.least(q, t, settings.margin))
                .into_iter()
                .fold(settings.margin, f64::min);
            self.kept = room.max(0.0);
        }
        self.goal = first.end().unwrap_or(self.goal);
        self.progress = Progress::default();
        self.waits = 0;
    }

    /// Turns to where `reference` leads, if that is a curve that leads elsewhere: what was searched is of no use there. Whether there
    /// is a place where it comes to rest.
    fn turn_to(&mut self, reference: &Trajectory<S::Pose, M>) -> bool {
        if reference.joints().is_some() {
            if replace(&mut self.is_exchanged, false) {
                self.goal = reference.end().unwrap_or(self.goal);
            }
            return true;
        }
        let Some(end) = reference.end() else { return false };
        if self.goal != end {
            self.goal = end;
            self.give_up();
        }
        true
    }

    /// Lets go of what is being searched, and of why.
    fn give_up(&mut self) {
        if self.search.take().is_some()
            && let Some(search) = self.searches.last_mut()
        {
            search.status = Some("given up");
        }
        self.progress = Progress::default();
        self.waits = 0;
        self.wait = [f64::NEG_INFINITY, PAUSES[0]];
    }

    /// Where the arm is on its way.
    fn place(&mut self, moment: &Moment<'_, S, D, M>) -> Place {
        let is_off = size::<D, M>(moment.error) > self.settings.tolerance;
        match moment.reference.joints() {
            Some(plan) => {
                let planned = moment.posture.iter().map(|(planned, _)| planned);
                let left = farthest(&self.endless, plan.last(), moment.q.iter());
                Place { is_off, from_plan: farthest(&self.endless, moment.q, planned), left }
            }
            None if is_off => {
                let robot = &mut self.ahead.robot;
                robot.update_positions(moment.q);
                let left = size::<D, M>(&Manipulator::<D, M>::pose(robot).error(&self.goal));
                Place { is_off, from_plan: 0.0, left }
            }
            None => Place { is_off, from_plan: 0.0, left: f64::INFINITY },
        }
    }

    /// Where the joints are, those that turn without an end in the turn of what is followed \[rad or m\]: a plan takes its place.
    fn in_turn(&self, moment: &Moment<'_, S, D, M>) -> Vec<f64> {
        let mut start = moment.q.to_vec();
        let planned: Vec<f64> = moment.posture.iter().map(|(planned, _)| *planned).collect();
        unwrap(&mut start, &planned, &self.endless);
        start
    }

    /// Whether the arm could go straight from `task.start` to the end, were nothing to move.
    fn is_straight(&mut self, task: &Task<S, D, M>, moment: &Moment<'_, S, D, M>) -> bool {
        match moment.reference.joints() {
            Some(plan) => task.is_straight(plan.last()),
            None => {
                let mut q = task.start.clone();
                let length = task.arm.characteristic_length();
                let mut solver = Solver::<M>::new(q.len(), length);
                solver.solve(&mut self.ahead.robot, &mut q, &self.goal).is_reached()
                    && task.is_straight(&q)
            }
        }
    }

    /// Whether a plan comes too late: the old one, where it is now, cannot be left for it within `blend` with what `speed` leaves of
    /// the limits. An arm that is not on the old one any more has another way to go.
    fn is_late(&self, plan: &Plan, moment: &Moment<'_, S, D, M>) -> bool {
        let is_blocked = self.searches.last().is_some_and(|asked| asked.reason == Reason::Blocked);
        let old =
            moment.reference.joints().filter(|_| is_blocked && plan.status == PlanStatus::Found);
        let Some(old) = old else { return false };
        let ReplanSettings { blend, speed, .. } = self.settings;
        let limits = (self.arm.limits().velocity.as_slice(), MAX_ACCELERATION[D - 2]);
        Change { time: moment.pace.time, blend }.is_far(old, &plan.q, limits, 1.0 - speed)
    }

    /// Takes a plan over that has come.
    fn receive(&mut self, moment: &Moment<'_, S, D, M>) -> Option<Trajectory<S::Pose, M>> {
        let found = self.search.as_mut()?.take(moment.t)?;
        self.search = None;
        let is_late = found.as_ref().is_some_and(|Found { plan, braking, .. }| match braking {
            Some(braking) => braking.is_over(moment.pace.time),
            // What lets something pass does so at its time.
            None => {
                plan.begins.is_some_and(|begins| moment.since > begins + LATE)
                    || self.is_late(plan, moment)
            }
        });
        let status = found.as_ref().map_or("failed", |found| found.plan.status.name());
        let asked = self.searches.last_mut().expect("there has been one");
        asked.status = Some(if is_late { "given up" } else { status });
        let of_use = |found: &Found| found.plan.status == PlanStatus::Found && !is_late;
        let Some(Found { plan, braking, .. }) = found.filter(of_use) else {
            self.wait[0] = moment.t + self.wait[1];
            self.wait[1] = (2.0 * self.wait[1]).min(PAUSES[1]);
            return None;
        };
        asked.taken = Some(moment.t);
        let reason = asked.reason;
        self.wait = [moment.t + PAUSES[0], PAUSES[0]];
        self.kept = plan.margin;
        self.waits = 0;
        self.ahead.begin_anew();
        let last = plan.q.rchunks(moment.q.len()).next().unwrap_or_default();
        self.progress.nearest = [farthest(&self.endless, last, moment.q.iter()), moment.t];
        let Moment { pace, reference, posture, .. } = *moment;
        let change = Change { time: pace.time, blend: self.settings.blend };
        let usual = moment.law.yielding.margin;
        let old = reference.joints();
        let joints = change.motion(&plan, moment.q.len(), braking.as_ref(), old, usual)?;
        let follow = |joints| follow_plan::<S::State, D, M>(self.arm.state(), joints);
        // An arm that is on its plan goes over to the new one with it. Any other may be far from it, and is let go.
        Some(match old {
            Some(old) if reason == Reason::Blocked => {
                follow(joints.taking_over(old, change.time, change.blend)).displaced_like(reference)
            }
            _ => {
                let joints = change.draw(joints, old, posture);
                follow(joints).taking_over(reference, &pace, change.blend)
            }
        })
    }

    /// Begins a search.
    fn ask(&mut self, reason: Reason, moment: &Moment<'_, S, D, M>) {
        let ReplanSettings { latency, blend, speed, .. } = self.settings;
        let plan = moment.reference.joints();
        let seed = self.seed.wrapping_add(self.searches.len() as u64);
        let settings = asked(&self.settings, moment.since + latency, &self.upright, seed);
        let mut task = Task::<S, D, M> {
            arm: Arc::clone(&self.arm),
            world: moment.world.clone(),
            command: moment.law.command.clone(),
            kept: speed_shares(&moment.law.command, moment.law.observer.is_some()),
            keeps_apart: moment.law.self_collision != SelfCollision::Ignore,
            goal: Goal::Pose(self.goal),
            start: self.in_turn(moment),
        };
        come_inside(&mut task.start, task.arm.limits());
        // A plan that is over pulls straight to its end, as a curve does: if that way is free, what is passing by has to be waited
        // for, but not for ever.
        let is_over = plan.is_none_or(|plan| moment.pace.time >= plan.span()[1]);
        let (world, now) = (moment.world, moment.world.time());
        let moves = (0..world.len()).any(|j| !world.rests_at(j, now));
        let may_wait = reason != Reason::Wanted && is_over && moves && self.waits < WAITS;
        if may_wait && self.is_straight(&task, moment) {
            self.waits += 1;
            self.wait[0] = moment.t + self.settings.patience;
            return;
        }
        // Where the plan is left, it is that which is gone on from; else the arm.
        let left = plan.filter(|_| reason == Reason::Blocked);
        let start = moment.pace.time + latency;
        let from_plan = left.map(|plan| {
            let [here, there] = [moment.pace.time, start].map(|time| place_at(plan, time));
            (Task { start: here, ..task.clone() }, there)
        });
        let slow = left.zip(self.able.as_ref()).map(|(plan, able)| (plan.clone(), copied(able)));
        // An arm that has lost its way needs one, even if something will pass: the law makes room for that.
        let whatever_moves =
            reason != Reason::Blocked && (0..world.len()).any(|j| !world.stands_still(j));
        let at = settings.time;
        let search = move || {
            let braking = slow
                .and_then(|(plan, able)| Braking::along(&plan, start, &able, [blend, 1.0 - speed]));
            let time = settings.time + braking.as_ref().map_or(0.0, Braking::duration);
            let settings = PlanSettings { time, ..settings };
            let from_plan = from_plan.map(|(here, there)| match &braking {
                Some(braking) => (here, braking.end().to_vec()),
                None => (here, there),
            });
            // Beyond what is in the way there is no way around it.
            let from_plan = from_plan.filter(|(here, there)| here.is_straight(there));
            let from_plan = from_plan
                .and_then(|(here, there)| Task { start: there, ..here }.plan(&settings).ok());
            if let Some(plan) = from_plan.filter(|plan| plan.status != PlanStatus::StartBlocked) {
                return Some(Found { plan: Box::new(plan), is_ahead: true, braking });
            }
            let found = |plan| Some(Found { plan: Box::new(plan), is_ahead: false, braking: None });
            let settings = PlanSettings { time: at, ..settings };
            let plan = task.plan(&settings).ok()?;
            match plan.status {
                PlanStatus::Found => found(plan),
                _ if whatever_moves => {
                    found(task.plan(&PlanSettings { horizon: None, ..settings }).ok()?)
                }
                _ => found(plan),
            }
        };
        let arrives = moment.t + latency;
        self.search = Some(if let Some(worker) = &self.beside {
            let given_up = Arc::new(AtomicBool::new(false));
            let watch = Watch::Flag(Arc::clone(&given_up));
            let (answers, answer) = channel();
            // Whoever waits no more does not hear it; a search that fails lets the channel go.
            worker.ask(move || {
                if let Ok(Some(found)) = interrupt::watched(watch, search) {
                    let _ = answers.send(found);
                }
            });
            Search::Beside { answer, found: None, arrives, given_up }
        } else {
            Search::Simulated { found: search(), arrives }
        });
        self.searches.push(Replanned { asked: moment.t, reason, status: None, taken: None });
    }
}

impl<S, const D: usize, const M: usize> Replan<S, D, M> for Replanner<S, D, M>
where
    S: CheckReach<D, M> + 'static,
    S::State: Jointed<D>,
{
    fn look(&mut self, moment: &Moment<'_, S, D, M>) -> Option<Trajectory<S::Pose, M>> {
        if !self.turn_to(moment.reference) {
            return None;
        }
        let place = self.place(moment);
        let off = self.progress.look(moment.t, place, &self.settings);
        if self.search.is_some() {
            return self.receive(moment);
        }
        let blocked = self.ahead.look(moment, &self.settings, KEPT * self.kept) < 0.0;
        let seen = off.or(blocked.then_some(Reason::Blocked)).filter(|_| moment.t >= self.wait[0]);
        let wanted = replace(&mut self.is_wanted, false).then_some(Reason::Wanted);
        if let Some(reason) = wanted.or(seen) {
            self.ask(reason, moment);
        }
        None
    }

    fn want(&mut self) {
        self.is_wanted = true;
    }

    fn restart(&mut self) -> Trajectory<S::Pose, M> {
        self.search = None;
        self.searches.clear();
        self.is_wanted = false;
        self.wait = [f64::NEG_INFINITY, PAUSES[0]];
        self.begin();
        self.first.clone()
    }

    fn exchange_arm(&mut self, arm: &Arc<S::Arm>, robot: &mut S::State) {
        if !Arc::ptr_eq(&self.arm, arm) {
            self.arm.clone_from(arm);
            self.endless = arm.endless();
            swap(&mut self.ahead.robot, robot);
            self.ahead.begin_anew();
            self.give_up();
            self.is_exchanged = true;
        }
    }

    fn limit(&mut self, limits: Option<&MotionLimits>) {
        let speeds = &self.arm.limits().velocity;
        self.settings = limited(&self.given, limits, speeds, MAX_ACCELERATION[D - 2]);
        self.able = limits.map(copied);
    }

    fn plan_beside(&mut self) {
        self.beside = Some(Worker::new());
    }

    fn searches(&self) -> &[Replanned] {
        &self.searches
    }

    fn counts(&self) -> ReplanCounts {
        let taken = self.searches.iter().filter(|search| search.taken.is_some()).count();
        ReplanCounts { taken, stuck: self.progress.times_stuck }
    }

    fn copy(&self) -> Box<dyn Replan<S, D, M>> {
        let search = match &self.search {
            Some(Search::Simulated { found, arrives }) => {
                Some(Search::Simulated { found: found.clone(), arrives: *arrives })
            }
            _ => None,
        };
        Box::new(Self {
            settings: copied(&self.settings),
            given: copied(&self.given),
            arm: Arc::clone(&self.arm),
            endless: copied(&self.endless),
            upright: copied(&self.upright),
            world: self.world.clone(),
            first: self.first.clone(),
            beside: self.beside.as_ref().map(|_| Worker::new()),
            search,
            searches: copied(&self.searches),
            ahead: self.ahead.clone(),
            progress: self.progress.clone(),
            able: copied(&self.able),
            ..*self
        })
    }
}

/// The point that the end effector keeps in view, and how far off its axis that may be.
fn view(settings: &ReplanSettings) -> Option<(Vec<f64>, f64)> {
    settings.view.as_ref().map(|point| (point.clone(), settings.view_angle))
}

/// What is asked of a plan that begins at `time` \[s\].
#[inline(never)] // compiled once, not for every kind of arm and task
fn asked(settings: &ReplanSettings, time: f64, upright: &[f64], seed: u64) -> PlanSettings {
    let ReplanSettings { margin, horizon, tilt, speed, samples, .. } = *settings;
    PlanSettings {
        time,
        margin,
        horizon: Some(horizon),
        tilt,
        upright: tilt.map(|_| upright.to_vec()),
        view: view(settings),
        acceleration: settings.acceleration.clone(),
        jerk: settings.jerk.clone(),
        speed,
        samples,
        seed,
        ..PlanSettings::default()
    }
}

/// The `given` settings, with which plans ask for no more than these `limits`, of an arm with these largest `speeds` \[rad/s, m/s\] whose
/// joints are accelerated by so much usually.
#[inline(never)]
fn limited(
    given: &ReplanSettings,
    limits: Option<&MotionLimits>,
    speeds: &[f64],
    usual: f64,
) -> ReplanSettings {
    let mut own = given.clone();
    let Some(MotionLimits { speed, acceleration, jerk }) = limits else { return own };
    // The share is that of accelerations, too, which need not be slower for the sake of speeds.
    let most = |i: usize| speeds.get(i).copied().unwrap_or(MAX_SPEED);
    let share = speed.iter().enumerate().map(|(i, v)| v / most(i)).fold(own.speed, f64::min);
    let more = replace(&mut own.speed, share) / share;
    let least = |own: Option<&ScalarOrVec>, usual: f64, given: &[f64]| {
        let own = |i| own.map_or(usual, |own| own.get(i));
        let each = given.iter().enumerate().map(|(i, given)| more * given.min(own(i)));
        Some(ScalarOrVec::Each(each.collect()))
    };
    own.acceleration = least(own.acceleration.as_ref(), usual, acceleration);
    own.jerk = least(own.jerk.as_ref(), f64::INFINITY, jerk);
    own
}

/// A joint that is pushed against its limit may be a little beyond it.
#[inline(never)]
fn come_inside(q: &mut [f64], limits: &Limits) {
    for (i, q) in q.iter_mut().enumerate() {
        let [lower, upper] = ranges_of(limits, i);
        let inside = q.max(lower).min(upper);
        if (*q - inside).abs() <= AT_LIMIT {
            *q = inside;
        }
    }
}

/// A copy, which is compiled once, not once for every kind of arm and task.
#[inline(never)]
fn copied<T: Clone>(it: &T) -> T {
    it.clone()
}

/// The difference of the joint that differs most, of which some turn without an end \[rad or m\].
fn farthest<'a>(endless: &[bool], a: &[f64], b: impl Iterator<Item = &'a f64>) -> f64 {
    let ways = a.iter().zip(b).map(|(a, b)| a - b).zip(endless);
    ways.map(|(way, endless)| short_way(way, *endless).abs()).fold(0.0, f64::max)
}

/// How much an error is, of position or of orientation \[m\].
fn size<const D: usize, const M: usize>(error: &Vector<M>) -> f64 {
    error.fixed_rows::<D>(0).norm().max(LEVER * error.rows(D, M - D).norm())
}

#[cfg(test)]
mod tests;
