//! The planning cycle: when to look ahead, how far the work has come, and what becomes of its result (T72, T73).
//!
//! The work of a cycle is spread over the control steps of its period, so that no step takes much longer than the
//! others. The first finds out by a roll-out whether a contact is predicted. If so, the closed loop itself is rolled
//! out, and only if that is hit, too, every step tries its share of the candidates.
//!
//! Where the time of a control cycle is over, all of this stops, and goes on in the next: every roll-out is done instant by
//! instant. The best candidate so far is followed meanwhile; what was not tried when the period is over is left out.

#[cfg(test)]
mod tests;

use super::candidate::{Candidate, Forecast, cost};
use super::closed_loop_rollout::{ClosedLoopRollout, Foreseen};
use super::prediction::Prediction;
use super::rollout::{RATE, Rollout};
use super::self_motion::{SelfMotion, SelfMotionMap};
use super::{Present, due};
use crate::control::PreviewSettings;
use crate::control::deadline::{Budget, LeftOut};
use crate::control::{Gains, OperationalSpace, Torque};
use crate::math::Noise;
use crate::robot::Manipulator;
use crate::trajectory::Sample;

/// The stream of random numbers that candidates are drawn from.
const STREAM: u64 = 4;

/// How fast the nominal motion changes over to another candidate \[1/s\].
const BLEND: f64 = 60.0;

/// How fast parts of a task are taken up again that were let go \[1/s\]: they may be far off.
const TAKE_UP: f64 = 10.0;

/// Roll-outs at the beginning of a cycle: of the law as it is, and of the candidate that is being followed.
const FIRST: usize = 2;

/// The share of an error of the task that triggers the search down to which a candidate is kept.
const KEPT_UP: f64 = 0.5;

/// Planning cycles that a closed-loop rollout takes.
const CYCLES: f64 = 2.0;

/// Whose roll-out is under way.
#[derive(Debug, Clone, Copy, PartialEq)]
enum UnderWay {
    Nothing,
    /// That of the law as it is.
    Idle,
    /// That of the candidate that is being followed; with the cost of the law as it is.
    Present {
        of_idle: f64,
    },
    /// That of the candidate on trial.
    Trial,
}

/// The share that a candidate lets go of the parts of a task.
#[expect(clippy::cast_precision_loss, reason = "few parts")]
fn share_of(candidate: &Candidate, parts: usize) -> f64 {
    candidate.released as f64 / parts as f64
}

/// Look-ahead with its workspace.
#[derive(Debug, Clone)]
pub struct Preview<R: Manipulator<D, M>, const D: usize, const M: usize> {
    settings: PreviewSettings,
    margin: f64,
    seed: u64,
    noise: Noise,
    /// Time since the beginning of the cycle, and since the last control step \[s\]; infinite before the first.
    elapsed: f64,
    since: f64,
    /// What the law as it is leads to, how long ago that began \[s\], and what the last one has come to.
    closed_loop: ClosedLoopRollout<R, D, M>,
    begun: f64,
    foreseen: Foreseen,
    /// Whether the best candidate so far is being followed, whether it must hold the task, that candidate, and its cost.
    active: bool,
    holds: bool,
    best: Candidate,
    cost: f64,
    /// How many candidates this cycle has tried, and how many it is to try.
    tried: usize,
    count: usize,
    /// The nominal motion, which follows the candidate with a lag, so that no torque jumps: the joint
    /// velocity that is aimed at \[rad/s\], and how far, from 0 to 1, the end effector holds each part of its task and
    /// the candidate counts.
    aim: Vec<f64>,
    hold: Vec<f64>,
    weight: f64,
    trial: Candidate,
    rollout: Rollout<R, D, M>,
    under_way: UnderWay,
    /// When, since the beginning of the cycle, it was found out what the law as it is leads to \[s\]: at once, if there is time.
    judged: f64,
    left_out: LeftOut,
    /// What searches the self-motion, where that is asked for.
    self_motion: Option<Box<SelfMotion<R, D, M>>>,
    change: Vec<f64>,
    scratch: Vec<f64>,
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> Preview<R, D, M> {
    /// For the law with these gains on `robot`.
    pub fn new(robot: &R, gains: &Gains<M>, settings: &PreviewSettings) -> Self {
        let n = robot.dof();
        let rollout = Rollout::new(
            robot,
            (&gains.yielding, gains.joint_speeds(robot)),
            settings,
            gains.metric::<D>(),
        );
        // Where the self-motion is searched, that prepares for what may come, and nothing is let go for it.
        let chance = settings.self_motion.as_ref().map_or(settings.chance, |_| f64::MAX);
        Self {
            settings: PreviewSettings { chance, ..settings.clone() },
            margin: gains.yielding.margin,
            seed: gains.seed,
            noise: Noise::new(gains.seed, STREAM),
            elapsed: f64::INFINITY,
            since: f64::INFINITY,
            closed_loop: ClosedLoopRollout::new(robot, gains, settings.trigger, settings.error),
            begun: 0.0,
            foreseen: Foreseen::Nothing,
            active: false,
            holds: false,
            best: Candidate::idle(n),
            cost: 0.0,
            tried: 0,
            count: 0,
            aim: vec![0.0; n],
            hold: vec![1.0; rollout.order.count()],
            weight: 0.0,
            trial: Candidate::idle(n),
            rollout,
            under_way: UnderWay::Nothing,
            judged: 0.0,
            left_out: LeftOut::default(),
            self_motion: settings
                .self_motion
                .as_ref()
                .map(|given| Box::new(SelfMotion::new(robot, gains, given, settings.trigger))),
            change: vec![0.0; n],
            scratch: vec![0.0; n],
        }
    }

    /// Makes room for so many more obstacles, and contacts of each body.
    pub fn reserve(&mut self, obstacles: usize, contacts: usize) {
        self.rollout.reserve(obstacles, contacts);
        self.closed_loop.reserve(contacts);
        if let Some(search) = &mut self.self_motion {
            search.reserve(obstacles);
        }
    }

    /// Takes over the posture of the law with these gains, at rest.
    pub fn rest_at_posture_of(&mut self, gains: &Gains<M>) {
        self.closed_loop.rest_at_posture_of(gains);
        if let Some(search) = &mut self.self_motion {
            search.rest_at_posture_of(gains);
        }
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.noise = Noise::new(self.seed, STREAM);
        self.rest();
        self.weight = 0.0;
        self.left_out = LeftOut::default();
        if let Some(search) = &mut self.self_motion {
            search.reset();
        }
    }

    /// Gives up what is under way and what is followed: the next control step begins a cycle.
    fn rest(&mut self) {
        (self.elapsed, self.since) = (f64::INFINITY, f64::INFINITY);
        (self.tried, self.count) = (0, 0);
        self.closed_loop.stop();
        self.foreseen = Foreseen::Nothing;
        self.active = false;
        self.holds = false;
        self.best.make_idle();
        (self.under_way, self.judged) = (UnderWay::Nothing, 0.0);
    }

    /// What was left out for lack of time.
    pub fn left_out(&self) -> LeftOut {
        self.left_out
    }

    /// What the last search of the self-motion has found; None without one, and while nothing comes near. Allocates.
    pub fn self_motion_map(&self) -> Option<SelfMotionMap> {
        self.self_motion.as_ref()?.map()
    }

    /// Lets `dt` \[s\] pass.
    pub fn elapse(&mut self, dt: f64) {
        self.elapsed += dt;
        self.since += dt;
        self.begun += dt;
        if let Some(search) = &mut self.self_motion {
            search.elapse(dt);
        }
        if !self.counts() {
            return;
        }
        let share = 1.0 - (-BLEND * dt).exp();
        let go = |from: &mut f64, to: f64| *from += share * (to - *from);
        let back = if self.hold.len() > 1 { 1.0 - (-TAKE_UP * dt).exp() } else { share };
        let go_back = |from: &mut f64, to: f64| *from += back * (to - *from);
        let path = self.self_motion.as_ref().filter(|search| !self.active && search.has_path());
        let (wanted, released) = match path {
            Some(search) => {
                search.write_velocity(&mut self.scratch);
                (&*self.scratch, 0)
            }
            None => (self.best.at(self.elapsed), self.best.released),
        };
        self.aim.iter_mut().zip(wanted).for_each(|(aim, u)| go(aim, *u));
        let parts = self.hold.iter_mut().enumerate();
        parts.for_each(|(place, hold)| match place >= released {
            true => go_back(hold, 1.0),
            false => go(hold, 0.0),
        });
        let is_followed = self.active || path.is_some();
        match is_followed {
            true => go(&mut self.weight, 1.0),
            false => go_back(&mut self.weight, 0.0),
        }
        if !is_followed && self.weight < 1e-6 {
            self.weight = 0.0;
        }
    }

    /// Begins a cycle at `present` if it is time, and does the work that is due as far as there is time for it;
    /// `reference(s)` is that in s seconds.
    pub fn advance(
        &mut self,
        present: &Present<'_, R>,
        surroundings: &mut dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
        budget: &Budget,
    ) {
        let is_done = self.work(present, surroundings, reference, budget).is_some();
        if !is_done {
            self.left_out.cut += 1;
            self.give_up_what_is_old();
        }
        self.since = 0.0;
    }

    /// None where the time of this control cycle is over before all that is due is done.
    fn work(
        &mut self,
        present: &Present<'_, R>,
        surroundings: &mut dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
        budget: &Budget,
    ) -> Option<()> {
        let robot = present.robot;
        if let Some(search) = &mut self.self_motion {
            let robot = present.robot;
            let velocity = if self.weight > 0.0 { &self.aim } else { robot.velocity() };
            search.advance(robot, surroundings, reference, velocity, budget)?;
            if search.has_path() && self.weight == 0.0 {
                self.aim.copy_from_slice(robot.velocity());
            }
            if search.is_clear() {
                self.rest();
                return Some(());
            }
        }
        if self.is_over() {
            budget.is_left().then_some(())?;
            self.begin(robot, surroundings, reference);
        }
        if self.is_judging() || self.closed_loop.is_running() || self.tried < self.count {
            if self.rollout.forget(surroundings.count()) {
                self.rollout.begin();
            }
            self.judge(present, surroundings, budget)?;
            self.roll_out_closed_loop(surroundings, reference, budget)?;
            self.search(surroundings, budget)?;
        }
        Some(())
    }

    /// Whether it is not yet known what the law as it is leads to, or the candidate that is being followed.
    fn is_judging(&self) -> bool {
        matches!(self.under_way, UnderWay::Idle | UnderWay::Present { .. })
    }

    /// Whether it is time for another cycle. The search has a period, however long it took until it could begin.
    fn is_over(&self) -> bool {
        let Self { settings: PreviewSettings { period, horizon, .. }, elapsed, judged, .. } = self;
        *elapsed >= if self.is_judging() { *horizon } else { judged + period } - 1e-9
    }

    /// Without time for another look, a candidate is followed no longer than it was looked at, and a prediction is none of what
    /// has passed.
    fn give_up_what_is_old(&mut self) {
        if self.elapsed > self.settings.horizon {
            self.active = false;
            self.best.make_idle();
        }
        if self.closed_loop.is_running() && self.begun > self.settings.trigger {
            self.closed_loop.stop();
        }
    }

    /// How many candidates must have been tried by now, for the cycle to end in the last control step of its period:
    /// all of them in the very first step, which does not know how long a step is.
    fn due(&self) -> usize {
        let share = (self.elapsed - self.judged + self.since) / self.settings.period;
        due(FIRST + self.settings.candidates, share).saturating_sub(FIRST).min(self.count)
    }

    /// Begins a cycle: takes in what is, to find out whether a contact is predicted for the law as it is.
    fn begin(
        &mut self,
        robot: &R,
        surroundings: &mut dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
    ) {
        let Self { settings, rollout, best, trial, active, holds, closed_loop, .. } = self;
        self.left_out.rollouts += (self.count - self.tried) as u64;
        best.switch -= self.elapsed;
        self.elapsed = 0.0;
        (self.tried, self.count) = (0, 0);
        (self.under_way, self.judged) = (UnderWay::Nothing, 0.0);
        if closed_loop.is_running() {
            return;
        }
        rollout.prepare(settings, robot, surroundings, reference);
        closed_loop.reserve(surroundings.most_contacts());
        trial.make_idle();
        match std::mem::take(&mut self.foreseen) {
            Foreseen::Contact => (*active, *holds) = (true, false),
            Foreseen::Error if !*active => (*active, *holds) = (true, true),
            _ => {}
        }
        rollout.begin();
        self.under_way = UnderWay::Idle;
    }

    /// Finds out whether a contact is predicted for the law as it is, and whether the candidate that is being followed still
    /// does better than that.
    fn judge(
        &mut self,
        present: &Present<'_, R>,
        surroundings: &dyn Prediction<D>,
        budget: &Budget,
    ) -> Option<()> {
        let Self { settings, rollout, best, trial, active, holds, closed_loop, .. } = self;
        let (horizon, margin) = (settings.horizon, self.margin);
        if self.under_way == UnderWay::Idle {
            // A candidate is given up only once the law as it is keeps the margin over the whole horizon.
            let (until, enough) = if *active { (horizon, margin) } else { (settings.trigger, 0.0) };
            let most =
                settings.error.map_or(f64::INFINITY, |e| if *active { KEPT_UP * e } else { e });
            let step = rollout.step;
            let free =
                |so_far: Forecast, s: f64| s + step > until + 1e-9 && so_far.distance >= enough;
            let idle = rollout.go_on(trial, surroundings, self.elapsed, &free, budget)?;
            self.under_way = UnderWay::Nothing;
            let contact = idle.distance < enough;
            let ahead = !rollout.obstacles.is_empty() && (contact || idle.worst > most);
            if !*active && ahead {
                closed_loop.begin(present);
                self.begun = 0.0;
            }
            *active &= ahead;
            if !*active {
                best.make_idle();
                return Some(());
            }
            if self.weight == 0.0 {
                self.aim.copy_from_slice(present.robot.velocity());
            }
            rollout.begin();
            self.under_way = UnderWay::Present { of_idle: cost(settings, margin, idle, 0.0) };
        }
        if let UnderWay::Present { of_idle } = self.under_way {
            let all = |_: Forecast, _: f64| false;
            let followed = rollout.go_on(best, surroundings, self.elapsed, &all, budget)?;
            (self.under_way, self.judged) = (UnderWay::Nothing, self.elapsed);
            // The null space alone was not enough.
            *holds &= followed.distance >= margin;
            let released = share_of(best, rollout.order.count());
            self.cost = cost(settings, margin, followed, released);
            if of_idle <= self.cost {
                self.cost = of_idle;
                best.make_idle();
            }
            // A candidate that keeps its distance needs little more than to be kept up to date.
            let settled = followed.distance >= settings.clearance;
            self.count = if settled { settings.candidates / 8 } else { settings.candidates };
        }
        Some(())
    }

    /// Does its share of the closed-loop rollout, if one is running, so that it takes so many cycles.
    fn roll_out_closed_loop(
        &mut self,
        surroundings: &dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
        budget: &Budget,
    ) -> Option<()> {
        let Self { settings, closed_loop, rollout, since, begun, .. } = self;
        if closed_loop.is_running() {
            let share = (*begun + *since) / (CYCLES * settings.period);
            let obstacles = &rollout.obstacles;
            self.foreseen =
                closed_loop.go_on(share, *begun, surroundings, obstacles, reference, budget)?;
        }
        Some(())
    }

    /// Tries the candidates that are due, new ones and variations of the best so far, and keeps the best (T73).
    fn search(&mut self, surroundings: &dyn Prediction<D>, budget: &Budget) -> Option<()> {
        let due = self.due();
        let Self { settings, margin, noise, best, cost: least, holds, trial, rollout, .. } = self;
        let parts = rollout.order.count();
        while self.tried < due {
            if self.under_way != UnderWay::Trial {
                let k = self.tried;
                if 2 * k >= self.count || k.is_multiple_of(2) {
                    trial.copy_from(best);
                    trial.vary(noise, settings.speed * if k % 4 < 2 { 0.3 } else { 0.1 });
                    if k % 8 == 7 {
                        trial.released = (trial.released + 1) % (parts + 1);
                    }
                } else {
                    let speed = settings.speed * if k.is_multiple_of(3) { 0.4 } else { 1.0 };
                    trial.draw(noise, parts, speed);
                }
                if *holds {
                    trial.released = 0;
                }
                trial.limit(&rollout.speed);
                rollout.begin();
                self.under_way = UnderWay::Trial;
            }
            let released = share_of(trial, parts);
            let price = |forecast| cost(settings, *margin, forecast, released);
            let worse = |so_far, _| price(so_far) > *least;
            let found = rollout.go_on(trial, surroundings, self.elapsed, &worse, budget)?;
            self.under_way = UnderWay::Nothing;
            self.tried += 1;
            let found = price(found);
            if found < *least {
                *least = found;
                std::mem::swap(best, trial);
            }
        }
        Some(())
    }

    /// How many parts of its task the end effector lets go (T193): 0 while it is held; None without an order of them.
    pub fn released(&self) -> Option<usize> {
        (self.hold.len() > 1).then_some(if self.active { self.best.released } else { 0 })
    }

    /// Whether a candidate is being followed.
    pub fn is_active(&self) -> bool {
        self.active
    }

    /// Whether the nominal motion is, if only a little, that of a candidate or of a path.
    fn counts(&self) -> bool {
        let has_path = self.self_motion.as_ref().is_some_and(|search| search.has_path());
        self.active || self.weight > 0.0 || has_path
    }

    /// Makes the candidate the nominal motion (T72): changes the torque of the null-space law into one that gives
    /// q̈ = RATE (u − q̇), in the null space alone of what the end effector holds of its task.
    pub fn act(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        bias: &[f64],
        torque: &mut Torque,
    ) {
        if !self.counts() {
            return;
        }
        let Self { change, scratch, .. } = self;
        robot.accelerate(&torque.total, bias, scratch, change);
        for ((change, u), dq) in change.iter_mut().zip(&self.aim).zip(robot.velocity()) {
            *change = RATE * (u - dq) - *change;
        }
        let whole = robot.jacobian_mul::<M>(change);
        for (place, hold) in self.hold.iter().enumerate() {
            space.pinv_mul(&self.rollout.order.part::<R, D, M>(robot, place, &whole), scratch);
            change.iter_mut().zip(scratch.iter()).for_each(|(change, task)| *change -= hold * task);
        }
        change.iter_mut().for_each(|change| *change *= self.weight);
        robot.mass_mul(change, scratch);
        torque.add_to_task(|i| scratch[i]);
    }
}
