//! The one place where a type is chosen at run time.

use crate::control::TaskKind;
use crate::scenario::{self, Part, Problem, Scenario, ScenarioError};
use crate::simulation::{Outcome, Run, Snapshot};
use std::time::Duration;
use toml::Table;

/// A scenario ready to run, and what is odd about it.
#[derive(Debug, Clone)]
pub struct Ready {
    /// The run at t = 0.
    pub run: AnyRun,
    /// Sentences for the user.
    pub warnings: Vec<String>,
}

/// A run of either task dimension.
#[derive(Debug, Clone)]
pub enum AnyRun {
    /// Position.
    Position(Box<Run<2>>),
    /// Position and orientation.
    Pose(Box<Run<3>>),
}

macro_rules! either {
    ($run:expr, $inner:ident => $body:expr) => {
        match $run {
            AnyRun::Position($inner) => $body,
            AnyRun::Pose($inner) => $body,
        }
    };
}

pub(super) use either;

impl AnyRun {
    /// [`Run::run_for`].
    pub fn run_for(&mut self, budget: Duration) -> bool {
        either!(self, run => run.run_for(budget))
    }

    /// [`Run::step`].
    pub fn step(&mut self) -> bool {
        either!(self, run => run.step())
    }

    /// [`ClosedLoop::restart`], without record or metrics.
    pub fn restart(&mut self) {
        either!(self, run => run.closed_loop_mut().restart());
    }

    /// [`Run::outcome`].
    pub fn outcome(self) -> Outcome {
        either!(self, run => (*run).outcome())
    }

    /// The present instant.
    pub fn snapshot(&self) -> Snapshot<'_> {
        either!(self, run => run.closed_loop().snapshot())
    }

    /// Advances the closed loop alone, without record or metrics, under its own torque or under
    /// `external` [N·m]. Returns false if the new state is not finite.
    pub fn advance(&mut self, external: Option<&[f64]>) -> bool {
        either!(self, run => run.closed_loop_mut().advance(external))
    }
}

impl Scenario {
    /// Builds the run.
    ///
    /// # Errors
    /// If the reference does not fit the task or leaves the reach of the arm, or the record does not
    /// fit into memory.
    pub fn prepare(&self) -> Result<Ready, ScenarioError> {
        self.prepare_recorded(true)
    }

    /// The same, with a record or with nothing but metrics.
    ///
    /// # Errors
    /// As [`prepare`](Self::prepare).
    pub fn prepare_recorded(&self, recorded: bool) -> Result<Ready, ScenarioError> {
        match self.controller.task {
            TaskKind::Position => self.prepare_for::<2>(recorded, AnyRun::Position),
            TaskKind::Pose => self.prepare_for::<3>(recorded, AnyRun::Pose),
        }
    }

    fn prepare_for<const M: usize>(
        &self,
        recorded: bool,
        wrap: impl Fn(Box<Run<M>>) -> AnyRun,
    ) -> Result<Ready, ScenarioError> {
        let (closed_loop, warnings) = self.closed_loop::<M>()?;
        let run =
            Run::new(closed_loop, &self.simulation, self.duration, recorded).map_err(|error| {
                ScenarioError::new(
                    "simulation.record_every",
                    Problem::Other(format!("{error}: record fewer of them")),
                )
            })?;
        Ok(Ready { run: wrap(Box::new(run)), warnings })
    }
}

/// Reads and validates one part of a scenario, named as in [`Part`]; a whole one is prepared, too. Returns its warnings.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn check(part: Part, document: &Table) -> Result<Vec<String>, ScenarioError> {
    if part == Part::Scenario {
        return Scenario::from_document(document)?.prepare().map(|ready| ready.warnings);
    }
    scenario::check(part, document)?;
    Ok(vec![])
}
