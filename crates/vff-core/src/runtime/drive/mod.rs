//! A controller in the loop of a robot that is not ours: a state comes in, a command goes out, once per period.
//!
//! A [`Loop`] runs on a thread of its own until its time is over, somebody asks it to end, or something goes wrong. Other threads
//! talk to it by an [`Exchange`], for which it never waits. A safe start, the watchdog and the safe end are those of
//! [`control::output`](crate::control::output); what goes wrong in the robot's driver leads to the same end, and is a value, a
//! [`Fault`]. Drivers are [`Driver`]s; [`SimulatedRobot`] is one.

mod closest;
mod doubts;
mod driver;
mod ending;
mod exchange;
mod judging;
mod options;
mod receiving;
mod reference;
mod seen;
mod simulated;
#[cfg(test)]
mod tests;

pub use closest::Closest;
pub use driver::{CommandKind, Driver};
pub use ending::{Ending, Fault};
pub use exchange::{Exchange, Layout, Rows};
pub use options::{DriveError, Options, RATES};
pub use simulated::SimulatedRobot;

use super::controller::{AnyController, Reading, SuccessionError};
use super::fault::guarded;
use super::virtual_arm::{Course, VirtualArm};
use crate::control::LeftOut;
use crate::control::output::{Clock, Phase, unwrap};
use crate::simulation::Replanned;
use crate::simulation::pace::{self, Late, Timing};
use doubts::Doubts;
use ending::Off;
use exchange::ROWS;
use judging::Judge;
use reference::Reference;
use seen::Seen;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// An arm that has not come to rest by then \[s\] is left to its own brakes.
const LONGEST_STOP: f64 = 5.0;
/// So many commands in a row are refused before the drive ends at once.
const REFUSALS: u32 = 3;

/// How a drive went.
#[derive(Debug, Clone)]
pub struct Report {
    /// How it ended.
    pub ending: Ending,
    /// Times of every period. A robot that paces the loop has no latency.
    pub timing: Timing,
    /// Periods.
    pub periods: u64,
    /// Where a link came nearest to what the law knew, at the set point if there is one.
    pub closest: Closest,
    /// What else is to be told, in sentences.
    pub notes: Vec<String>,
    /// The searches for another plan.
    pub replans: Vec<Replanned>,
    /// What was left out, for lack of time or because of a bound.
    pub left_out: LeftOut,
}

/// The loop that drives a robot.
///
/// # Example
/// ```
/// use vff_core::runtime::AnyController;
/// use vff_core::runtime::drive::{Closest, Ending, Loop, Options, SimulatedRobot};
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     "#,
/// )?;
/// let robot = SimulatedRobot::new(&scenario, 1000.0, None)?;
/// let controller = AnyController::from_scenario(&scenario)?;
/// let options = Options { seconds: Some(0.05), ..Options::default() };
/// let (drive, _exchange) = Loop::new(robot, controller, options)?;
/// let report = drive.run(); // on a thread of its own beside a robot
/// assert_eq!(report.ending, Ending::Completed);
/// let Closest { distance, .. } = report.closest;
/// assert!(distance.is_infinite()); // there is nothing to come near to
/// # Ok(())
/// # }
/// ```
///
/// # See also
/// [`Driver`] is what a robot has to do; [`Exchange`] is how other threads talk to the loop.
#[derive(Debug)]
pub struct Loop<D> {
    driver: D,
    inner: Inner,
}

/// The loop without its robot.
#[derive(Debug)]
struct Inner {
    controller: AnyController,
    /// The arm whose state is the set point, and whether that is its position; of a robot that takes no torques.
    model: Option<(VirtualArm, bool)>,
    exchange: Arc<Exchange>,
    options: Options,
    paces: bool,
    /// Which joints turn without an end.
    endless: Vec<bool>,
    q: Vec<f64>,
    dq: Vec<f64>,
    /// What the robot measures of the torque from outside. Whether that is asked for in every period, or at the beginning alone.
    external: Vec<f64>,
    senses: bool,
    /// NaN for each joint.
    nothing: Vec<f64>,
    /// The robot's time at the first state \[s\], and its clock since.
    start: f64,
    clock: Clock,
    judge: Judge,
    /// Whether the velocities are none, so that they would damp nothing.
    is_blind: bool,
    /// The time of the drive at the last state \[s\].
    last: f64,
    /// Periods in a row without news.
    stale: u32,
    /// What was given last, and when by the time of the drive \[s\]; what it has come to.
    given: Option<(Reference, f64)>,
    /// Whether that was given by somebody.
    has_target: bool,
    now: Reference,
    row: Vec<f64>,
    kept: Rows,
    /// Periods until the next row is kept.
    until_row: u64,
    ending: Option<Ending>,
    /// How far off the arm was at the end of its time.
    off: Option<Off>,
    /// Periods since it was asked to end.
    ends: u64,
    refused: u32,
    closest: Closest,
    doubts: Doubts,
    seen: Seen,
    notes: Vec<String>,
}

impl<D: Driver> Loop<D> {
    /// The loop of a robot, and what others talk to it by. Nothing is asked of the robot yet.
    ///
    /// # Errors
    /// If the damping of the law or of its `command` is unstable at this rate, or the limits of set points are none.
    pub fn new(
        driver: D,
        mut controller: AnyController,
        options: Options,
    ) -> Result<(Self, Arc<Exchange>), DriveError> {
        let period = 1.0 / options.rate;
        controller.begin(period, None)?;
        let (n, widths) = (controller.dof(), controller.widths());
        let model = match driver.kind() {
            CommandKind::Torque => None,
            kind => {
                let limits = options.limits.as_ref().ok_or(DriveError::NoLimits)?;
                let model = VirtualArm::anywhere(&controller, limits, period)?;
                controller.limit_motion(Some(model.able())); // which other laws will keep, too
                Some((model, kind == CommandKind::Position))
            }
        };
        // Set points go on from a model: what is measured damps nothing.
        let endless = controller.endless();
        let judged = if model.is_none() { endless.clone() } else { vec![] };
        let names = ["q", "dq", "tau", "tau_task", "tau_null", "tau_vff", "command"];
        let mut columns = vec![("t", 1)];
        columns.extend(names.map(|name| (name, n)));
        columns.extend([("x", widths[0]), ("x_ref", widths[0]), ("force", n), ("clearance", n)]);
        columns.push(("tau_ext_estimate", n)); // NaN without an observer, which another law may bring
        if controller.has_reference() {
            columns.push(("path_time", 1));
        }
        if controller.has_plans() {
            columns.push(("q_plan", n));
        }
        let layout = Layout(columns);
        let row = vec![f64::NAN; layout.width()];
        let room = if options.record_every > 0 { ROWS * row.len() } else { 0 };
        let exchange = Arc::new(Exchange::new(controller.clone(), layout, room));
        let inner = Inner {
            model,
            paces: driver.paces(),
            endless,
            q: vec![0.0; n],
            dq: vec![0.0; n],
            external: vec![0.0; n],
            nothing: vec![f64::NAN; n],
            senses: controller.senses(),
            start: 0.0,
            clock: Clock::new(period),
            judge: Judge::new(judged, period),
            is_blind: false,
            last: 0.0,
            stale: 0,
            given: None,
            has_target: false,
            now: Reference::room(widths),
            row,
            kept: Rows { values: Vec::with_capacity(room), lost: 0 },
            until_row: 0,
            ending: None,
            off: None,
            ends: 0,
            refused: 0,
            closest: Closest::default(),
            doubts: Doubts::default(),
            seen: Seen::new(),
            notes: vec![],
            controller,
            exchange: Arc::clone(&exchange),
            options,
        };
        Ok((Self { driver, inner }, exchange))
    }

    /// Drives, on the calling thread, until the end. Whatever the robot's driver does, it comes back.
    pub fn run(mut self) -> Report {
        let mut timing = Timing::default();
        let began = guarded(|| {
            let Self { driver, inner } = &mut self;
            driver.cycle(|driver| inner.begin(driver))
        });
        if let Err(fault) = began.unwrap_or_else(|text| Err(Fault::Program(text))) {
            self.inner.ending = Some(Ending::Faulted(fault));
        } else {
            self.drive(&mut timing);
        }
        let Self { mut driver, mut inner } = self;
        let left = guarded(|| driver.cycle(Driver::end));
        if let Err(text) = left.unwrap_or_else(Err) {
            inner.notes.push(format!("the robot did not take leave: {text}"));
        }
        inner.close(timing)
    }

    fn drive(&mut self, timing: &mut Timing) {
        let period = Duration::from_secs_f64(1.0 / self.inner.options.rate);
        let (exchange, paces) = (Arc::clone(&self.inner.exchange), self.inner.paces);
        let mut work = || {
            let Self { driver, inner } = self;
            let done = guarded(|| driver.cycle(|driver| inner.period(driver)));
            done.unwrap_or_else(|text| {
                // The controller is in no known state: nothing more can be computed.
                inner.fail(Fault::Program(text));
                (Instant::now(), false)
            })
        };
        let (never, done) = (AtomicBool::new(false), &exchange.periods);
        if paces {
            pace::accompany(timing, period, u64::MAX, done, work);
        } else {
            pace::keep(timing, period, Late::Skip, u64::MAX, &never, done, || work().1);
        }
    }
}

impl Inner {
    /// Begins with the first state.
    fn begin<D: Driver>(&mut self, driver: &mut D) -> Result<(), Fault> {
        driver.begin().map_err(Fault::Begin)?;
        self.start = driver.read(&mut self.q, &mut self.dq).map_err(Fault::Read)?;
        self.is_finite(self.start)?;
        let (sensed, is_observed) =
            (self.sense(driver), self.controller.external_torque().is_some());
        self.exchange.measures.store(sensed == Ok(true), Ordering::Release);
        let is_felt = is_observed && sensed?;
        if self.senses && !is_felt {
            return Err(Fault::Begin(SuccessionError::Unmeasured.to_string()));
        }
        self.last = f64::NEG_INFINITY;
        let refused = |why: &dyn ToString| Fault::Begin(why.to_string());
        self.controller.begin_at_rest(&self.q, None).map_err(|beyond| refused(&beyond))?;
        self.controller.observe(&self.q, &self.dq, 0.0);
        let mut measured = vec![0.0; self.q.len()];
        if is_felt {
            // What holds it now, a load included that the robot may not have been told of.
            self.controller.holding_torque(&mut measured);
            measured.iter_mut().zip(&self.external).for_each(|(tau, external)| *tau -= external);
        } else if !driver.torque(&mut measured).map_err(Fault::Read)? {
            self.controller.holding_torque(&mut measured);
        }
        let begun = self.controller.begin(1.0 / self.options.rate, Some(&measured));
        begun.map_err(|error| refused(&error))?;
        if let Some((model, _)) = &mut self.model {
            model.rests(&self.dq).map_err(|error| refused(&error))?;
            model.begin(&mut self.controller, &self.q).map_err(|error| refused(&error))?;
        }
        // It goes on from here if no reference comes, unless the controller has one of its own.
        self.controller.observe(&self.q, &self.dq, 0.0);
        self.controller.forget();
        let Self { now, controller, external, .. } = self;
        now.rest_at(|pose| controller.write_pose(pose));
        if is_felt {
            controller.sense(external);
        }
        if !controller.has_reference() {
            self.given = Some((now.clone(), 0.0));
        } else if let Some(missed) = controller.missed_start(&self.q) {
            return Err(refused(&missed));
        }
        Ok(())
    }

    /// Lets the controller know what the robot measures from outside. Whether it measures any.
    fn sense<D: Driver>(&mut self, driver: &mut D) -> Result<bool, Fault> {
        let Self { controller, external, .. } = self;
        let measured = driver.external_torque(external).map_err(Fault::Read)?;
        if measured {
            Fault::unless_finite("external_torque", external)?;
            controller.sense(external);
        }
        Ok(measured)
    }

    fn is_finite(&self, t: f64) -> Result<(), Fault> {
        Fault::unless_finite("time", &[t])?;
        Fault::unless_finite("q", &self.q)?;
        Fault::unless_finite("dq", &self.dq)
    }

    /// One period. Returns the instant at which its state had come, and whether it goes on.
    fn period<D: Driver>(&mut self, driver: &mut D) -> (Instant, bool) {
        let read = driver.read(&mut self.q, &mut self.dq);
        let sensed = |t| if self.senses { self.sense(driver).map(|_| t) } else { Ok(t) };
        let read = read.map_err(Fault::Read).and_then(sensed);
        let state = read.and_then(|t| self.is_finite(t).map(|()| t));
        let begin = Instant::now();
        if let Err(fault) = &state {
            self.fail(fault.clone());
            if self.paces {
                thread::sleep(Duration::from_secs_f64(1.0 / self.options.rate)); // nobody else paces now
            }
        }
        let judged = state.as_ref().ok().and_then(|t| self.judge.look(*t, &self.q, &self.dq));
        if let Some(fault) = judged {
            self.is_blind |= matches!(fault, Fault::Velocity { .. });
            self.fail(fault);
        }
        let t = state.ok().map(|t| self.time_at(t));
        let time = t.unwrap_or(self.last).max(0.0);
        self.receive(time, driver);
        let unseen = self.options.sight_patience.and_then(|it| self.seen.missing(time, it));
        if let Some((obstacle, since)) = unseen {
            self.fail(Fault::Unseen { obstacle, since });
        }
        if self.exchange.end.load(Ordering::Acquire) {
            self.end(Ending::Stopped);
        }
        if self.options.seconds.is_some_and(|seconds| t.is_some_and(|t| t >= seconds)) {
            if self.ending.is_none() {
                self.off = self.off();
            }
            self.end(Ending::Completed);
        }
        // A robot that was elsewhere all at once is not believed any more: in time it could have gone there.
        let lost = matches!(self.ending, Some(Ending::Faulted(Fault::Impossible { .. })));
        let phase = self.command(t.filter(|_| !lost));
        let goes_on = self.send(driver, phase);
        self.keep_row(time);
        self.exchange.enter(phase);
        (begin, goes_on)
    }

    /// The time of the drive when the robot's clock says `t` \[s\]; that of the last state where this is no later.
    fn time_at(&mut self, t: f64) -> f64 {
        let Self { clock, stale, start, .. } = self;
        let t = t - *start;
        if let Some(time) = clock.read(t, *stale as usize + 1) {
            clock.take(t, time);
        }
        clock.now()
    }

    /// What the state comes to, if there is one.
    fn command(&mut self, t: Option<f64>) -> Phase {
        let Self { controller, model, given, now, options, q, dq, last, stale, .. } = self;
        let time = t.unwrap_or_else(|| last.max(0.0));
        let target = given.as_ref().map(|(given, since)| {
            now.coast_from(given, time - since, options.patience);
            now.target()
        });
        let news = t.is_some_and(|t| t > *last);
        *stale = if news { 0 } else { stale.saturating_add(1) };
        let phase = match model {
            None => {
                let reading = t.map(|t| Reading { t, q, dq });
                controller.cycle(reading, target.as_ref()).map_err(|error| error.to_string())
            }
            Some((model, _)) => {
                let measured = news.then_some([&q[..], &dq[..]]);
                let course = model.step(controller, time, target.as_ref(), measured);
                course.map(phase_of).map_err(|error| error.to_string())
            }
        };
        match &phase {
            Ok(Phase::Damping | Phase::Released | Phase::Lost) if !self.has_failed() => {
                let fault = self.why_damped(t, news);
                self.fail(fault);
            }
            Ok(_) => {}
            Err(text) => self.fail(Fault::Program(text.clone())),
        }
        self.last = t.map_or(self.last, |t| t.max(self.last));
        phase.unwrap_or(Phase::Lost)
    }

    /// Why the watchdog damps the arm although nobody has asked for it.
    fn why_damped(&self, t: Option<f64>, news: bool) -> Fault {
        let finite = self.controller.terms_view().tau.iter().all(|tau| tau.is_finite());
        match t {
            _ if !finite => Fault::Torque,
            Some(t) if self.controller.brakes() => Fault::TooFast { t: t + self.start },
            Some(t) if news => Fault::Impossible { t: t + self.start },
            _ => Fault::Stale { t: self.last + self.start, periods: self.stale },
        }
    }

    /// Sends what the controller says. Whether the loop goes on.
    fn send<D: Driver>(&mut self, driver: &mut D, phase: Phase) -> bool {
        if self.is_blind {
            return false; // the arm is left to its own brakes
        }
        let command = match &self.model {
            None => self.controller.sent(),
            Some((model, positions)) => Some(model.set_point()[usize::from(!positions)]),
        };
        if let Some(command) = command {
            match driver.write(command) {
                Ok(()) => self.refused = 0,
                Err(text) => {
                    self.refused += 1;
                    self.fail(Fault::Write(text));
                }
            }
        }
        self.ends += u64::from(self.ending.is_some());
        #[expect(clippy::cast_precision_loss, reason = "some thousands")]
        let too_long = self.ends as f64 > LONGEST_STOP * self.options.rate;
        if too_long {
            let fault = Fault::Moves(LONGEST_STOP);
            match self.has_failed() {
                true => self.notes.push(fault.to_string()),
                false => self.fail(fault),
            }
        }
        !(phase.is_over() || too_long || self.refused >= REFUSALS)
    }

    /// Begins the end, if it has not begun.
    fn end(&mut self, ending: Ending) {
        if self.ending.is_none() {
            self.controller.stop();
            if let Some((model, _)) = &mut self.model {
                model.stop();
            }
            self.ending = Some(ending);
        }
    }

    /// Begins the end with a fault, or lets an end that has begun be one. What goes wrong later follows from the first.
    fn fail(&mut self, fault: Fault) {
        self.end(Ending::Stopped);
        if !self.has_failed() {
            self.ending = Some(Ending::Faulted(fault));
        }
    }

    fn has_failed(&self) -> bool {
        matches!(self.ending, Some(Ending::Faulted(_)))
    }

    /// Shows the period, and keeps it for a file.
    fn keep_row(&mut self, time: f64) {
        let Self { row, controller, model, exchange, given, now, kept, .. } = self;
        let Self { options, until_row, endless, q, dq, nothing, closest, .. } = self;
        let terms = controller.terms_view();
        closest.look(time, terms.clearance);
        let command = match model {
            None => controller.sent().unwrap_or_default(),
            Some((model, positions)) => model.set_point()[usize::from(!*positions)],
        };
        let mut rest = &mut row[..];
        let mut put = |values: &[f64]| {
            let (place, others) = std::mem::take(&mut rest).split_at_mut(values.len());
            place.copy_from_slice(values);
            rest = others;
        };
        put(&[time]);
        for values in [q, dq, terms.tau, terms.tau_task, terms.tau_null, terms.tau_vff, command] {
            put(values);
        }
        let mut pose = [0.0; 7];
        let pose = &mut pose[..now.pose().len()];
        controller.write_pose(pose);
        put(pose);
        match given {
            Some(_) => put(now.pose()),
            None => {
                controller.write_reference(pose);
                put(pose);
            }
        }
        for values in [terms.force, terms.clearance] {
            put(values);
        }
        match controller.external_torque() {
            Some(estimate) => put(estimate),
            None => put(nothing),
        }
        put(controller.path_time().as_slice());
        // What somebody gives takes the place of a plan.
        match controller.planned().filter(|_| given.is_none()) {
            Some(planned) => {
                rest.copy_from_slice(planned);
                unwrap(rest, q, endless);
            }
            None => rest.fill(f64::NAN),
        }
        exchange.show(row);
        exchange.count(controller.left_out());
        if options.record_every == 0 {
            return;
        }
        if *until_row == 0 {
            *until_row = options.record_every;
            if kept.values.len() + row.len() <= kept.values.capacity() {
                kept.values.extend_from_slice(row);
            } else {
                kept.lost += 1;
            }
        }
        *until_row -= 1;
        exchange.hand_on(kept);
    }

    /// What is to be told when it is over.
    fn close(mut self, timing: Timing) -> Report {
        let mut end = std::mem::take(&mut self.kept);
        self.exchange.append(&mut end);
        self.notes.extend(self.closest.note());
        self.notes.extend(self.doubts.note());
        self.notes.extend(self.off.and_then(Off::note));
        if !self.exchange.phase().is_over() {
            self.exchange.enter(Phase::Lost);
        }
        Report {
            ending: self.ending.unwrap_or(Ending::Stopped),
            periods: self.exchange.periods(),
            timing,
            closest: self.closest,
            notes: self.notes,
            replans: self.controller.replans().to_vec(),
            left_out: self.controller.left_out(),
        }
    }
}

/// What the course of the set points is in the words of the output stage.
fn phase_of(course: Course) -> Phase {
    match course {
        Course::Following => Phase::Running,
        Course::Rejoining => Phase::Holding,
        Course::Waiting => Phase::Damping,
        Course::Stopping => Phase::Stopping,
        Course::Finished => Phase::Finished,
    }
}
