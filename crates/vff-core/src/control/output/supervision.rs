//! Cycle by cycle: whether the torque of the law is sent, blended in, or replaced by damping.
//!
//! What goes wrong in a loop is a value, a [`Phase`], never a panic. A state that does not come, comes again, is not finite or
//! cannot be (`Admission`) counts as missing. Fewer than `missed_cycles` missing in a row: what was sent last is held. From there on the arm is
//! damped as if its velocity decayed from the last one known (T115), then nothing but gravity is sent, then it is lost. As long as there is
//! a state, an arm that is too fast, or a law without a torque, is damped where it is, and held there once it is slow (`Hold`).
//!
//! The arm that is damped is at the last state of the loop, whatever else the law was asked.

use super::Output;
use super::admission::Admission;
use super::begin::BeginError;
use super::hold::Hold;
use crate::control::{Controller, Settings};
use crate::math::smoothstep;
use crate::robot::{Limits, Manipulator, Robot};
use std::mem::{replace, swap};

/// What a cycle came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The torque is being blended in: at a safe start, and after an interruption.
    Starting,
    /// The torque of the law is sent.
    Running,
    /// The state is missing, for fewer than `missed_cycles` cycles: what was sent last is held.
    Holding,
    /// The state is missing for longer, the torque of the law is not finite, or a joint is faster than twice its limit: the arm is
    /// damped and, at a state that comes, held once it is slow.
    Damping,
    /// It has been missing for 5/d: nothing is sent but gravity, if it is ours.
    Released,
    /// It has been missing for 10/d. Nothing leads out of this but another beginning, or forgetting that there was a loop.
    Lost,
    /// The end was asked for: the arm is damped and, once it is slow, held, until it stands.
    Stopping,
    /// It stands, and is held as long as there are cycles.
    Finished,
}

impl Phase {
    /// The name in every layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Holding => "holding",
            Self::Damping => "damping",
            Self::Released => "released",
            Self::Lost => "lost",
            Self::Stopping => "stopping",
            Self::Finished => "finished",
        }
    }

    /// Whether the loop is over: finished, or lost.
    pub fn is_over(self) -> bool {
        matches!(self, Self::Lost | Self::Finished)
    }
}

/// The watch over one loop: safe start, safe end, watchdog. Nothing allocates after construction.
///
/// # Example
/// [`AnyController`](crate::runtime::AnyController) has one; alone, where no state arrives:
/// ```
/// use std::sync::Arc;
/// use vff_core::control::output::{BeginError, Phase, Supervisor};
/// use vff_core::control::settings::Settings;
/// use vff_core::math::Vector;
/// use vff_core::robot::{Model, PlanarArm, planar::Link};
///
/// let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 2], Vector::<2>::zeros()));
/// let settings = Settings::default();
/// let mut supervisor = Supervisor::new(&settings, arm.state(), 0.001, None).unwrap();
/// assert_eq!(supervisor.phase(), Phase::Starting);
/// supervisor.stop();
/// assert!(!supervisor.phase().is_over());
/// let refused = Supervisor::new(&settings, arm.state(), -1.0, None).unwrap_err();
/// assert_eq!(refused, BeginError::Period(-1.0));
/// ```
#[derive(Debug, Clone)]
pub struct Supervisor<R, const D: usize> {
    output: Output,
    admission: Admission,
    /// The arm, and whether it is at the last state.
    robot: R,
    is_there: bool,
    period: f64,
    blend: f64,
    missed_cycles: usize,
    damping: f64,
    phase: Phase,
    /// Cycles in a row without a state, and without a torque of the law.
    missed: usize,
    speechless: usize,
    /// Whether a joint has been too fast and is not slow again.
    brakes: bool,
    /// Whether the end was asked for.
    stops: bool,
    /// Cycles in a row in which the arm has stood, for how many it has to, and where \[rad, m\].
    still: usize,
    still_for: usize,
    stood: Vec<f64>,
    /// The torque that the arm may have had before the first state; None if nobody knows it.
    measured: Option<Vec<f64>>,
    /// Whether there has been a state, and whether anything was sent.
    has_begun: bool,
    has_sent: bool,
    /// For how long the torque of the law has been blended in \[s\].
    blended: f64,
    /// What the arm before held beside what this one holds, and how long it is until that is left off, of how long \[s\].
    before: Vec<f64>,
    leaves: [f64; 2],
    /// What was sent before this cycle.
    sent: Vec<f64>,
    /// What is wanted, as a torque of the law.
    acting: Vec<f64>,
    /// Whether that has acted since the last state, and for how long before this one \[s\], if it has.
    is_known: bool,
    acted: Option<f64>,
    /// What the law adds for a load that the model does not know: an arm that is damped holds it, too.
    carried: Vec<f64>,
    /// That, and what holds it: what has held the arm beside gravity, from which the torque of the law is blended in.
    beside: Vec<f64>,
    /// What holds an arm that is damped where it comes to rest.
    hold: Hold,
}

impl<R: Robot<D>, const D: usize> Supervisor<R, D> {
    /// A joint that goes no faster on average stands \[rad/s, m/s\]: what is measured of its velocity may be mere noise.
    const STANDS: f64 = 0.02;
    /// For so long it has to, and for so many cycles, until the arm has stopped \[s\]: at high rates ten of them are over before what
    /// nobody holds has begun to sink.
    const STILL: (f64, usize) = (0.2, 10);
    /// Damping lasts for so many of its time constants.
    const DECAYED: f64 = 5.0;

    /// The watch over a loop of `period` \[s\] with an arm like `robot`. The torque is blended in from the `measured` one
    /// \[N·m, N\], gravity included only if it is sent too, or from what holds the arm still.
    ///
    /// # Errors
    /// If the period is none, or too long.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn new(
        settings: &Settings,
        robot: R,
        period: f64,
        measured: Option<&[f64]>,
    ) -> Result<Self, BeginError> {
        BeginError::check(settings, period)?;
        let settings = &settings.command;
        let damping = settings.stop_damping;
        let (n, limits) = (robot.dof(), robot.limits());
        let mut output = Output::new(settings, n);
        let measured = measured.filter(|tau| is_within(tau, limits)).map(<[f64]>::to_vec);
        if let Some(measured) = &measured {
            output.begin_at(measured);
        }
        Ok(Self {
            output,
            admission: Admission::new(period, n, &limits.velocity),
            robot,
            is_there: false,
            period,
            blend: settings.blend_time,
            missed_cycles: settings.missed_cycles,
            damping,
            phase: Phase::Starting,
            missed: 0,
            speechless: 0,
            brakes: false,
            stops: false,
            still: 0,
            still_for: cycles_in(Self::STILL.0, period).max(Self::STILL.1),
            stood: vec![f64::NAN; n],
            measured,
            has_begun: false,
            has_sent: false,
            blended: 0.0,
            before: vec![0.0; n],
            leaves: [0.0; 2],
            sent: vec![0.0; n],
            acting: vec![0.0; n],
            carried: vec![0.0; n],
            beside: vec![0.0; n],
            hold: Hold::new(n, damping, period),
            is_known: false,
            acted: None,
        })
    }

    /// For an arm of which these joints turn without an end, (n): whole turns are nothing to them, and a reading may leave them out.
    pub fn counting_turns(mut self, endless: Vec<bool>) -> Self {
        self.admission.count_turns(endless);
        self
    }

    /// What is sent in this cycle \[N·m, N\].
    pub fn sent(&self) -> &[f64] {
        self.output.sent()
    }

    /// Whether there has been a cycle with a state.
    pub fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Whether there has been a cycle.
    pub fn has_sent(&self) -> bool {
        self.has_sent
    }

    /// What the last cycle came to.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Whether the arm is damped because a joint is, or was, faster than twice its limit.
    pub fn brakes(&self) -> bool {
        self.brakes
    }

    /// q and q̇ of the last state that was believed; of a joint that turns without an end, q goes on where its reading begins anew.
    pub fn state(&self) -> [&[f64]; 2] {
        self.admission.state()
    }

    /// How far the clock of the states is ahead of the time of the loop \[s\].
    pub fn clock_ahead(&self) -> f64 {
        self.admission.clock().ahead()
    }

    /// The time of the loop now \[s\], by the cycles since the last state; None before the first.
    pub fn now(&self) -> Option<f64> {
        let clock = self.admission.clock();
        #[expect(clippy::cast_precision_loss, reason = "far fewer than 2⁵³ cycles")]
        clock.is_read().then(|| clock.now() + self.period * self.missed as f64)
    }

    /// Asks for the end: from the next cycle on the arm is damped and held, until it stands.
    pub fn stop(&mut self) {
        self.stops = true;
    }

    /// Whether the law is asked for, now that there is a new state.
    pub fn wants_torque(&self) -> bool {
        !(self.stops || self.brakes || self.phase.is_over())
    }

    /// The time of the loop \[s\] at (q, q̇), which came at `t` \[s\] of the robot's clock, if that is a state that is new and can
    /// be; it is taken in then.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn admit(&mut self, t: f64, q: &[f64], dq: &[f64]) -> Option<f64> {
        let time = self.admission.admit(self.missed.saturating_add(1), t, q, dq)?;
        self.is_there = false;
        self.brakes = self.admission.is_fast() || self.brakes && self.admission.exceeds(1.0);
        Some(time)
    }

    /// Lets `controller`, which has observed the new state, know what has been sent before it: the robot has held that since the
    /// last state, `elapsed` \[s\] before, as many periods as that may be. Counted in whole periods, however a clock jitters.
    pub fn report<const M: usize>(&mut self, controller: &mut Controller<R, D, M>, elapsed: f64)
    where
        R: Manipulator<D, M> + Clone,
    {
        self.take_up();
        self.sent.copy_from_slice(self.output.sent());
        let elapsed = (elapsed / self.period).round().max(1.0) * self.period;
        #[expect(clippy::cast_precision_loss, reason = "far fewer than 2⁵³ cycles")]
        let longest = f64::max(HELD, self.period * self.missed_cycles as f64);
        let is_known = replace(&mut self.is_known, true) && elapsed <= longest;
        self.acted = is_known.then_some(elapsed);
        controller.hear(Some(&mut self.output), &self.sent, self.acted);
        controller.write_held(&mut self.carried);
    }

    /// The same for another law in this loop, after that.
    pub fn report_too<const M: usize>(&mut self, controller: &mut Controller<R, D, M>)
    where
        R: Manipulator<D, M> + Clone,
    {
        controller.hear(Some(&mut self.output), &self.sent, self.acted);
    }

    /// Whether the torque of the law is being blended in, even if a state is missing meanwhile.
    pub fn is_blending(&self) -> bool {
        0.0 < self.blended && self.blended < self.blend
    }

    /// From now on the arm is like `robot`, which becomes the one before, and `controller` says what it carries. What that changes of what
    /// holds an arm that is damped comes within `duration` \[s\].
    pub fn exchange_robot<const M: usize>(
        &mut self,
        robot: &mut R,
        controller: &Controller<R, D, M>,
        duration: f64,
    ) where
        R: Manipulator<D, M> + Clone,
    {
        let share = self.share_before();
        self.before.iter_mut().for_each(|before| *before *= share);
        self.add_held(1.0);
        swap(&mut self.robot, robot);
        self.is_there = false;
        controller.write_held(&mut self.carried);
        self.add_held(-1.0);
        self.leaves = [duration; 2];
        self.admission.be_limited(&self.robot.limits().velocity);
    }

    /// Adds what holds the arm, so many `times`, to what the arm before held beside it.
    fn add_held(&mut self, times: f64) {
        if !self.admission.is_empty() {
            self.place();
            self.output.add_gravity(&self.robot, times, &mut self.before);
            let carried = self.before.iter_mut().zip(&self.carried);
            carried.for_each(|(before, carried)| *before += times * carried);
        }
    }

    /// How much is left of what the arm before held.
    fn share_before(&self) -> f64 {
        let [left, whole] = self.leaves;
        if left > 0.0 { smoothstep(left / whole) } else { 0.0 }
    }

    /// Lets the next command of `controller` ask for what can be sent in this cycle, after [`report`](Self::report).
    pub fn announce<const M: usize>(&mut self, controller: &mut Controller<R, D, M>)
    where
        R: Manipulator<D, M> + Clone,
    {
        controller.expect(&mut self.output, &self.sent, self.period);
    }

    /// A cycle with a new state, at which `controller` has been observed, reported to and asked for its torque.
    pub fn follow<const M: usize>(&mut self, controller: &mut Controller<R, D, M>) -> Phase
    where
        R: Manipulator<D, M> + Clone,
    {
        self.take_up();
        let tau = &controller.torque().total;
        if !tau.iter().chain(controller.bias()).all(|x| x.is_finite()) {
            self.speechless = self.speechless.saturating_add(1);
            return match self.speechless < self.missed_cycles {
                true => self.hold(),
                false => self.damp_here(Phase::Damping, self.damping),
            };
        }
        self.speechless = 0;
        self.hold.release();
        self.phase = Phase::Running;
        self.output.convert(controller.robot(), tau);
        if self.blended < self.blend {
            let share = smoothstep(self.blended / self.blend);
            self.output.blend(controller.robot(), &self.beside, self.damping, share);
            self.confine(controller, true); // what keeps limits and distances is but a share of the law's by now
            self.blended += self.period;
            self.phase = Phase::Starting;
        }
        self.send()
    }

    /// A cycle with a new state where the law is not asked for, at which `controller` has been observed and reported to: the arm is
    /// damped.
    pub fn rest<const M: usize>(&mut self, controller: &mut Controller<R, D, M>) -> Phase
    where
        R: Manipulator<D, M> + Clone,
    {
        self.take_up();
        let [q, _] = self.admission.state();
        #[expect(clippy::cast_precision_loss, reason = "far fewer than 2⁵³ cycles")]
        let room = Self::STANDS * self.period * self.still_for as f64;
        if self.stood.iter().zip(q).all(|(stood, q)| (q - stood).abs() <= room) {
            self.still += 1;
        } else {
            self.stood.copy_from_slice(q);
            self.still = 0;
        }
        let phase = match self.phase {
            over if over.is_over() => over,
            _ if !self.stops => Phase::Damping,
            _ if self.still >= self.still_for => Phase::Finished,
            _ => Phase::Stopping,
        };
        self.place();
        let sharpest = SHARPEST.min(1.0 / self.period); // held over a period, more would turn the arm round
        let d = self.damping.max(damping_before_stops(&self.robot, sharpest));
        self.hold.update(&self.robot, d);
        self.want_damping(d, 1.0);
        if !self.brakes {
            // Damping takes energy out of all joints together, and what moves one may be thrown into another; behind a rate the
            // torques come one after the other, besides. What stops keeps to itself: it gives way to nothing.
            if self.confine(controller, false) {
                self.hold.be_overruled(&self.robot);
            }
        }
        self.send_damping(phase)
    }

    /// Lets `controller`, which is at the same state, change what is wanted so that limits are kept, and distances where it
    /// `spares_distances`. Whether it does.
    fn confine<const M: usize>(
        &mut self,
        controller: &mut Controller<R, D, M>,
        spares_distances: bool,
    ) -> bool
    where
        R: Manipulator<D, M> + Clone,
    {
        let Self { output, acting, sent, period, .. } = self;
        if *period * SHARPEST > 1.0 {
            return false; // the program reckons with shorter ones
        }
        controller.expect(output, sent, *period);
        output.write_wanted(controller.robot(), acting);
        let kept = controller.confine(acting, spares_distances);
        let Some(kept) = kept.filter(|kept| kept.iter().all(|tau| tau.is_finite())) else {
            return false;
        };
        let most = acting.iter().fold(0.0_f64, |most, tau| most.max(tau.abs()));
        let changes = acting.iter().zip(kept).any(|(a, b)| (a - b).abs() > CHANGED * most);
        acting.copy_from_slice(kept);
        output.want(controller.robot(), acting);
        changes
    }

    /// A cycle without a state.
    pub fn miss(&mut self) -> Phase {
        self.missed = self.missed.saturating_add(1);
        if self.phase.is_over() {
            return self.phase;
        }
        if self.missed < self.missed_cycles {
            return self.hold(); // the same goes on to act
        }
        (self.still, self.is_known) = (0, false);
        #[expect(clippy::cast_precision_loss, reason = "far fewer than 2⁵³ cycles")]
        let decay = self.damping * self.period * (self.missed - self.missed_cycles) as f64;
        let (phase, left) = match decay {
            decay if decay < Self::DECAYED => (Phase::Damping, (-decay).exp()),
            decay if decay < 2.0 * Self::DECAYED => (Phase::Released, 0.0),
            _ => (Phase::Lost, 0.0),
        };
        if self.admission.is_empty() {
            // Nothing is known of the arm but the torque that it may have had.
            (self.phase, self.has_sent) = (phase, true);
            return phase;
        }
        if self.missed == self.missed_cycles {
            self.hold.leave_motion(&self.robot);
        }
        self.damp_as(phase, left)
    }

    /// What was sent last is sent again.
    fn hold(&mut self) -> Phase {
        self.has_sent = true;
        self.phase = Phase::Holding;
        self.phase
    }

    /// Damps the arm at a new state, and holds it there once it is slow.
    fn damp_here(&mut self, phase: Phase, d: f64) -> Phase {
        self.place();
        self.hold.update(&self.robot, d);
        self.want_damping(d, 1.0);
        self.send_damping(phase)
    }

    /// Damps the arm at the last state by what is `left` of that, from 0 to 1; the torque of the law is blended in anew after that.
    fn damp_as(&mut self, phase: Phase, left: f64) -> Phase {
        self.want_damping(left * self.damping, left);
        self.send_damping(phase)
    }

    /// With so much of what the arm was known to carry, from 0 to 1: what was a push may be over.
    fn want_damping(&mut self, d: f64, known: f64) {
        self.place();
        let share = self.share_before();
        let Self { beside, carried, before, hold, .. } = self;
        let held =
            carried.iter().zip(hold.torque()).map(|(carried, hold)| known * (carried + hold));
        beside
            .iter_mut()
            .zip(held.zip(before))
            .for_each(|(out, (held, before))| *out = held + share * *before);
        self.output.damp(&self.robot, d, &self.beside);
    }

    fn send_damping(&mut self, phase: Phase) -> Phase {
        (self.phase, self.blended) = (phase, 0.0);
        self.send()
    }

    fn send(&mut self) -> Phase {
        self.has_sent = true;
        self.leaves[0] -= self.period;
        self.output.send(self.period);
        self.phase
    }

    /// Moves the arm to the last state.
    fn place(&mut self) {
        if !self.is_there {
            let [q, dq] = self.admission.state();
            self.robot.update(q, dq);
            self.is_there = true;
        }
    }

    /// There is a state. The torque of the first is blended in from what was measured, if that can be, or from what holds the
    /// arm still; what is sent goes on from what was sent before it, if anything was.
    fn take_up(&mut self) {
        self.missed = 0;
        if replace(&mut self.has_begun, true) {
            return;
        }
        self.place();
        self.output.damp(&self.robot, 0.0, &[]);
        let (rest, limits) = (self.output.wanted(), self.robot.limits());
        let measured = self.measured.as_deref().filter(|tau| can_be(tau, rest, limits));
        self.beside.copy_from_slice(measured.unwrap_or(rest));
        if !self.has_sent {
            self.output.begin_at(&self.beside);
        }
        self.output.add_gravity(&self.robot, -1.0, &mut self.beside);
    }
}

/// How many periods there are in a time \[s\].
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative")]
fn cycles_in(time: f64, period: f64) -> usize {
    (time / period).ceil() as usize
}

/// Whether these are torques that the arm can have.
fn is_within(tau: &[f64], limits: &Limits) -> bool {
    let limit = |i: usize| limits.torque.get(i).copied().unwrap_or(f64::MAX);
    tau.iter().enumerate().all(|(i, tau)| tau.abs() <= limit(i))
}

/// Whether a torque that the arm can have is one of an arm that is held: not farther than half its limits from what holds it
/// by the model.
fn can_be(measured: &[f64], model: &[f64], limits: &Limits) -> bool {
    let mut joints = measured.iter().zip(model).zip(&limits.torque);
    joints.all(|((measured, model), limit)| (measured - model).abs() <= 0.5 * limit)
}

/// The damping \[1/s\] at which no joint comes to its stop, as far as that is no sharper than `sharpest`: one that would be there
/// after a time T at its speed never is if it is damped by 1/T or more, because it goes as far as its speed in 1/d (T115).
fn damping_before_stops<R: Robot<D>, const D: usize>(robot: &R, sharpest: f64) -> f64 {
    let limits = robot.limits();
    let moves = robot.configuration().iter().zip(robot.velocity()).enumerate();
    moves.fold(0.0, |most, (i, (q, dq))| match limits.kept_angles(i, KEPT_ANGLE) {
        Some([low, high]) if *dq != 0.0 => {
            let left = if *dq < 0.0 { q - low } else { high - q };
            f64::max(most, if left > 0.0 { (dq.abs() / left).min(sharpest) } else { sharpest })
        }
        _ => most,
    })
}

/// For so long, or for `missed_cycles` periods, a robot of which nothing is heard is taken to hold what it was sent last \[s\].
const HELD: f64 = 0.02;

/// A torque is another one that is off by more than this part of the largest.
const CHANGED: f64 = 1e-3;

/// What a stop keeps from the stops of joints \[rad, m\].
const KEPT_ANGLE: f64 = 0.01;

/// The largest damping before a stop \[1/s\].
const SHARPEST: f64 = 40.0;
