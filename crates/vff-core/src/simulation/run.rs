//! A scenario from its first step to its outcome.

use super::chatter::Chatter;
use super::closed_loop::ClosedLoop;
use super::metrics::{Metric, Metrics, Value};
use super::recorder::{Record, RecordTooLarge};
use super::{Options, Replanned, System};
use std::fmt;
use std::time::{Duration, Instant};

/// How a run ended. Everything until then is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// It reached its end and no link touched an obstacle.
    Completed,
    /// It reached its end, but a link has been inside an obstacle.
    Collided,
    /// The state became non-finite or absurdly fast.
    Diverged,
    /// It was stopped from outside.
    Interrupted,
    /// A fault of the program itself ended it; nothing of it is kept.
    Failed,
}

impl Status {
    /// The name in every layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Collided => "collided",
            Self::Diverged => "diverged",
            Self::Interrupted => "interrupted",
            Self::Failed => "failed",
        }
    }
}

/// The outcome of a run.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// How it ended.
    pub status: Status,
    /// One sentence that says why.
    pub message: String,
    /// When it ended \[s\].
    pub end_time: f64,
    /// What it is validated by.
    pub metrics: Vec<(&'static Metric, Value)>,
    /// What happened.
    pub record: Record,
    /// Searches for another plan, with `[replan]`.
    pub replans: Vec<Replanned>,
    /// What was odd on the way.
    pub warnings: Vec<String>,
}

/// A closed loop with its record and metrics.
#[derive(Clone)]
pub struct Run<S: System<D, M>, const D: usize, const M: usize> {
    closed_loop: ClosedLoop<S, D, M>,
    record: Record,
    metrics: Metrics,
    /// None where noise decides.
    chatter: Option<Chatter>,
    steps: usize,
    /// Plant steps per recorded row; nothing is recorded without.
    record_every: Option<usize>,
    diverged: bool,
}

/// Briefly: everything in it, for each space and task, would be a part of every program.
impl<S: System<D, M>, const D: usize, const M: usize> fmt::Debug for Run<S, D, M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut told = f.debug_struct("Run");
        told.field("dimension", &D).field("steps", &self.steps).field("diverged", &self.diverged);
        told.finish_non_exhaustive()
    }
}

impl<S: System<D, M>, const D: usize, const M: usize> Run<S, D, M> {
    /// Prepares a run over `duration` \[s\], recorded or not.
    ///
    /// # Errors
    /// If the record does not fit into memory.
    pub fn new(
        closed_loop: ClosedLoop<S, D, M>,
        options: &Options,
        duration: f64,
        recorded: bool,
    ) -> Result<Self, RecordTooLarge> {
        let s = closed_loop.snapshot();
        let steps = options.steps(duration);
        let rows = if recorded { options.rows(duration) } else { 0 };
        let record = Record::with_capacity(rows, &s)?;
        let metrics = Metrics::new(s.q.len(), duration, options.dt, closed_loop.limits().clone());
        let record_every = recorded.then_some(options.record_every);
        let diverged = !closed_loop.is_defined();
        let chatter = (!closed_loop.is_measured()).then(|| Chatter::new(&s.torque.total));
        let mut run = Self { closed_loop, record, metrics, chatter, steps, record_every, diverged };
        run.take_in();
        Ok(run)
    }

    /// The closed loop at its present instant.
    pub fn closed_loop(&self) -> &ClosedLoop<S, D, M> {
        &self.closed_loop
    }

    /// The closed loop, to be advanced by hand.
    pub fn closed_loop_mut(&mut self) -> &mut ClosedLoop<S, D, M> {
        &mut self.closed_loop
    }

    /// Takes one plant step. Returns false when there is none left to take.
    pub fn step(&mut self) -> bool {
        if self.is_over() {
            return false;
        }
        self.diverged = !self.closed_loop.advance(None);
        if !self.diverged {
            self.take_in();
        }
        true
    }

    /// Takes over the state to which a plant elsewhere has come within one plant step. Returns false when there is
    /// none left to take.
    pub fn arrive_at(&mut self, q: &[f64], dq: &[f64]) -> bool {
        if self.is_over() {
            return false;
        }
        self.diverged = !self.closed_loop.arrive_at(q, dq);
        if !self.diverged {
            self.take_in();
        }
        true
    }

    /// Steps until the run is over (returns true) or about `budget` of wall time is used up.
    pub fn run_for(&mut self, budget: Duration) -> bool {
        const STEPS_PER_CHECK: usize = 16;
        let start = Instant::now();
        loop {
            for _ in 0..STEPS_PER_CHECK {
                if !self.step() {
                    return true;
                }
            }
            if start.elapsed() >= budget {
                return self.is_over();
            }
        }
    }

    /// Whether no step is left to take.
    pub fn is_over(&self) -> bool {
        self.diverged || self.closed_loop.step_count() >= self.steps
    }

    fn take_in(&mut self) {
        let snapshot = self.closed_loop.snapshot();
        self.metrics.update(&snapshot);
        if let Some(chatter) = &mut self.chatter {
            chatter.take_in(&snapshot.torque.total);
        }
        let step = self.closed_loop.step_count();
        if self.record_every.is_some_and(|every| step.is_multiple_of(every)) {
            self.record.push(&snapshot);
        }
    }

    /// The outcome; `Interrupted` if the run is not over.
    pub fn outcome(mut self) -> Outcome {
        if self.diverged {
            self.record.end_with_finite_row();
        }
        let end_time = self.closed_loop.time();
        let told = (1e9 * end_time).round() / 1e9; // without what steps add up to by rounding
        let (status, message) = if self.diverged {
            let braked = self.closed_loop.is_braked();
            let stiff = if braked { ", or viscous friction of the joints," } else { "" };
            let message = format!(
                "the state left the finite range after t = {told} s: the torque{stiff} is too stiff \
                 for the step, or the scenario is unstable"
            );
            (Status::Diverged, message)
        } else if !self.is_over() {
            (Status::Interrupted, format!("interrupted at t = {told} s"))
        } else {
            let collided = self.metrics.collision_time().is_some();
            let status = if collided { Status::Collided } else { Status::Completed };
            (status, format!("reached its end at t = {told} s"))
        };
        let metrics =
            self.metrics.values(self.closed_loop.left_out(), self.closed_loop.left_of_reference());
        let replans = self.closed_loop.replans().to_vec();
        let chatter = self.chatter.filter(|_| !self.diverged);
        let warnings = chatter.and_then(|chatter| chatter.sentence()).into_iter().collect();
        Outcome { status, message, end_time, metrics, record: self.record, replans, warnings }
    }
}
