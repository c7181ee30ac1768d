//! Cycle by cycle: whether the torque of the law is sent, blended in, or replaced by damping.
//!
//! What goes wrong in a loop is a value, a [`Phase`], never a panic. A state that does not come, comes again, is not finite or
//! cannot be counts as missing. Fewer than `patience` missing in a row: what was sent last is held. From there on the arm is
//! damped as if its velocity decayed from the last one known (T115), then nothing but gravity is sent, then it is lost.

use super::{CommandSettings, Output};
use crate::control::Controller;
use crate::math::smoothstep;
use crate::robot::{Manipulator, Robot};

/// What a cycle came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The torque is being blended in: at a safe start, and after an interruption.
    Starting,
    /// The torque of the law is sent.
    Running,
    /// The state is missing, for fewer than `patience` cycles: what was sent last is held.
    Holding,
    /// The state is missing for longer, or the torque of the law is not finite: damping only.
    Damping,
    /// It has been missing for 5/d: nothing is sent but gravity, if it is ours.
    Released,
    /// It has been missing for 10/d. Nothing leads out of this but a new beginning.
    Lost,
    /// The end was asked for: damping only, until the arm stands.
    Stopping,
    /// It stands. Nothing is sent but gravity, if it is ours.
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

/// Why a loop cannot begin.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum BeginError {
    /// The period is no duration.
    #[error("period must be finite and greater than 0, got {0}")]
    Period(f64),
    /// Damping held over the period would accelerate the arm.
    #[error(
        "command.stop_damping: {damping} 1/s is unstable at a control period of {period} s; below {} 1/s it is not",
        2.0 / period
    )]
    Damping {
        /// d \[1/s\].
        damping: f64,
        /// \[s\].
        period: f64,
    },
}

/// Where the torque is blended from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Origin {
    /// The measured torque, if it can be, at the first state.
    Measured,
    /// What holds the arm still, at the first state.
    Rest,
    /// What is sent already.
    Sent,
}

/// The watch over one loop: safe start, safe end, watchdog. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub struct Supervisor {
    output: Output,
    period: f64,
    blend: f64,
    patience: usize,
    damping: f64,
    /// The speed that no joint exceeds \[rad/s, m/s\], (n).
    speed: Vec<f64>,
    phase: Phase,
    /// When the last state was taken in \[s\]; None before the first.
    last: Option<f64>,
    q: Vec<f64>,
    /// Cycles in a row without a state.
    missed: usize,
    /// Whether the end was asked for.
    stops: bool,
    /// Cycles in a row in which the arm has stood.
    still: usize,
    /// What the torque is blended from, and for how long it has been \[s\].
    from: Origin,
    origin: Vec<f64>,
    blended: f64,
    /// What was sent before this cycle.
    sent: Vec<f64>,
}

impl Supervisor {
    /// A joint speed that a state is not believed beyond where the arm says nothing of its own \[rad/s, m/s\].
    const TOP_SPEED: f64 = 50.0;
    /// A joint that is no faster stands \[rad/s, m/s\].
    const STANDS: f64 = 0.02;
    /// For so many cycles it has to, until the arm has stopped.
    const STILL: usize = 10;
    /// Damping lasts for so many of its time constants.
    const DECAYED: f64 = 5.0;

    /// The watch over a loop of `period` \[s\] with an arm of these velocity limits, which may be none, and `n` joints.
    /// The torque is blended in from the `measured` one \[N·m, N\], gravity included only if it is sent too, or from what holds the arm
    /// still.
    ///
    /// # Errors
    /// If the period is none, or too long for the damping.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn new(
        settings: &CommandSettings,
        n: usize,
        velocity_limits: &[f64],
        period: f64,
        measured: Option<&[f64]>,
    ) -> Result<Self, BeginError> {
        if !(period.is_finite() && period > 0.0) {
            return Err(BeginError::Period(period));
        }
        let damping = settings.stop_damping;
        if damping * period >= 2.0 {
            return Err(BeginError::Damping { damping, period });
        }
        let top = |i: usize| velocity_limits.get(i).map_or(Self::TOP_SPEED, |limit| 2.0 * limit);
        let mut origin = vec![0.0; n];
        if let Some(measured) = measured {
            origin.copy_from_slice(measured);
        }
        Ok(Self {
            output: Output::new(settings, n),
            period,
            blend: settings.start,
            patience: settings.patience,
            damping,
            speed: (0..n).map(top).collect(),
            phase: Phase::Starting,
            last: None,
            q: vec![0.0; n],
            missed: 0,
            stops: false,
            still: 0,
            from: if measured.is_some() { Origin::Measured } else { Origin::Rest },
            origin,
            blended: 0.0,
            sent: vec![0.0; n],
        })
    }

    /// What is sent in this cycle \[N·m, N\].
    pub fn sent(&self) -> &[f64] {
        self.output.sent()
    }

    /// What the last cycle came to.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Asks for the end: damping only from the next cycle on, until the arm stands.
    pub fn stop(&mut self) {
        self.stops = true;
    }

    /// Whether the law is asked for, now that there is a new state.
    pub fn wants_torque(&self) -> bool {
        !(self.stops || self.phase.is_over())
    }

    /// Whether (q, q̇) at `t` \[s\] is a state that is new and can be; it is taken in then.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn admit(&mut self, t: f64, q: &[f64], dq: &[f64]) -> bool {
        assert!(q.len() == self.q.len() && dq.len() == self.q.len(), "a number per joint");
        let finite = t.is_finite() && q.iter().chain(dq).all(|x| x.is_finite());
        let slow = dq.iter().zip(&self.speed).all(|(dq, most)| dq.abs() <= *most);
        let comes_from = |elapsed: f64| {
            let elapsed = elapsed.max(self.period);
            let joints = q.iter().zip(&self.q).zip(&self.speed);
            joints
                .fold(true, |all, ((q, before), most)| all & ((q - before).abs() <= most * elapsed))
        };
        let follows = self.last.is_none_or(|last| t > last && comes_from(t - last));
        let can_be = finite && slow && follows;
        if can_be {
            self.last = Some(t);
            self.q.copy_from_slice(q);
        }
        can_be
    }

    /// Lets the next command of `controller`, which has observed the state, ask for what can be sent in this cycle.
    pub fn announce<R: Manipulator<D, M> + Clone, const D: usize, const M: usize>(
        &mut self,
        controller: &mut Controller<R, D, M>,
    ) {
        self.take_up(controller.robot());
        self.sent.copy_from_slice(self.output.sent());
        controller.expect(&mut self.output, &self.sent, self.period);
    }

    /// A cycle with a new state, at which `robot` is, and the torque `tau` of the law there, where `bias` is C q̇ + g.
    pub fn follow<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        bias: &[f64],
        tau: &[f64],
    ) -> Phase {
        if !tau.iter().chain(bias).all(|x| x.is_finite()) {
            return self.miss(robot);
        }
        self.take_up(robot);
        self.output.convert(robot, bias, tau);
        self.phase = Phase::Running;
        if self.blended < self.blend {
            let share = smoothstep(self.blended / self.blend);
            self.output.blend(robot, &self.origin, self.damping, share);
            self.blended += self.period;
            self.phase = Phase::Starting;
        }
        self.output.send(self.period);
        self.phase
    }

    /// A cycle with a new state, at which `robot` is, where the law is not asked for: the arm is damped.
    pub fn rest<R: Robot<D>, const D: usize>(&mut self, robot: &R) -> Phase {
        self.take_up(robot);
        let stands = robot.velocity().iter().all(|dq| dq.abs() <= Self::STANDS);
        self.still = if stands { self.still + 1 } else { 0 };
        if self.phase != Phase::Lost {
            let stopped = self.phase == Phase::Finished || self.still >= Self::STILL;
            self.phase = if stopped { Phase::Finished } else { Phase::Stopping };
        }
        self.damp(robot, self.damping)
    }

    /// A cycle without a state, or without a torque; `robot` is at the last one there was.
    pub fn miss<R: Robot<D>, const D: usize>(&mut self, robot: &R) -> Phase {
        self.missed = self.missed.saturating_add(1);
        self.still = 0;
        if self.phase.is_over() {
            return self.phase;
        }
        if self.missed < self.patience {
            self.phase = Phase::Holding;
            return self.phase;
        }
        #[expect(clippy::cast_precision_loss, reason = "far fewer than 2⁵³ cycles")]
        let decay = self.damping * self.period * (self.missed - self.patience) as f64;
        self.phase = match decay {
            decay if decay < Self::DECAYED => Phase::Damping,
            decay if decay < 2.0 * Self::DECAYED => Phase::Released,
            _ => Phase::Lost,
        };
        if self.last.is_none() {
            return self.phase; // Nothing is known of the arm: nothing is sent.
        }
        let left = if self.phase == Phase::Damping { (-decay).exp() } else { 0.0 };
        self.damp(robot, left * self.damping)
    }

    fn damp<R: Robot<D>, const D: usize>(&mut self, robot: &R, d: f64) -> Phase {
        self.output.damp(robot, d);
        self.output.send(self.period);
        self.phase
    }

    /// There is a state again, or for the first time: what is sent goes on from there without a jump.
    fn take_up<R: Robot<D>, const D: usize>(&mut self, robot: &R) {
        if self.from != Origin::Sent {
            self.output.begin_at_rest(robot);
            let limits = &robot.limits().torque;
            if self.from == Origin::Measured && can_be(&self.origin, self.output.sent(), limits) {
                self.output.begin_at(&self.origin);
            }
            self.from = Origin::Sent;
            self.origin.copy_from_slice(self.output.sent());
        } else if self.missed >= self.patience {
            self.origin.copy_from_slice(self.output.sent());
            self.blended = 0.0;
        }
        self.missed = 0;
    }
}

/// Whether the torque of an arm that is held may have been measured: within the limits, and half of them from what holds it by
/// the model.
fn can_be(measured: &[f64], model: &[f64], limits: &[f64]) -> bool {
    let near = |(i, (measured, model)): (usize, (&f64, &f64))| {
        let limit = limits.get(i).copied().unwrap_or(f64::MAX);
        measured.abs() <= limit && (measured - model).abs() <= 0.5 * limit
    };
    measured.iter().zip(model).enumerate().all(near)
}
