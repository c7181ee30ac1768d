//! A scenario becomes a run.

use super::run::{AnyRun, ErasedRun};
use crate::planning::motion::Jointed;
use crate::planning::replanning::Replanner;
use crate::scenario::{
    self, AnyScene, CheckReach, Part, Problem, Scenario, ScenarioError, Scene, dispatch,
};
use crate::simulation::{ClosedLoop, ReplanSettings, Run};
use toml::Table;

/// A scenario ready to run, and what is odd about it.
///
/// # Example
/// ```
/// use vff_core::runtime::{AnyRun, ErasedRun, Ready};
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 0.2
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     "#,
/// )?;
/// let Ready { run, warnings } = scenario.prepare()?;
/// let run: AnyRun = run;
/// let every: &dyn ErasedRun = &*run; // what a run of any arm can do
/// assert!(!every.is_over() && warnings.is_empty());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Ready {
    /// The run at t = 0.
    pub run: AnyRun,
    /// Sentences for the user.
    pub warnings: Vec<String>,
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
        let task = self.controller.task;
        dispatch!(&self.scene, task, AnyScene(scene) => prepare_for(self, scene, recorded))
    }
}

/// The same for a system.
fn prepare_for<S, const D: usize, const M: usize>(
    scenario: &Scenario,
    scene: &Scene<S, D>,
    recorded: bool,
) -> Result<Ready, ScenarioError>
where
    S: CheckReach<D, M, State: Jointed<D>> + 'static,
    Run<S, D, M>: ErasedRun,
{
    let (mut closed_loop, warnings) = scenario.closed_loop::<S, D, M>(scene)?;
    if let Some(settings) = &scenario.replan {
        watch(&mut closed_loop, scenario, settings)?;
    }
    let run = Run::new(closed_loop, &scenario.simulation, scenario.duration, recorded).map_err(
        |error| {
            ScenarioError::new(
                "simulation.record_every",
                Problem::Other(format!("{error}: record fewer of them")),
            )
        },
    )?;
    Ok(Ready { run: AnyRun::new(run), warnings })
}

/// Has somebody watch over the reference of a closed loop from now on.
///
/// # Errors
/// If a joint slides without an end, or a plan leads where its hand leans by more than it may.
#[inline(never)] // whether a document asks for it or somebody does
pub(super) fn watch<S, const D: usize, const M: usize>(
    closed_loop: &mut ClosedLoop<S, D, M>,
    scenario: &Scenario,
    settings: &ReplanSettings,
) -> Result<(), ScenarioError>
where
    S: CheckReach<D, M, State: Jointed<D>> + 'static,
{
    let (arm, world) = (closed_loop.arm(), closed_loop.world());
    let replanner = Replanner::new(settings, scenario, (arm, world), closed_loop.reference())?;
    closed_loop.set_replanning(Box::new(replanner));
    Ok(())
}

/// Reads and validates one part of a scenario, named as in [`Part`]; a whole one is prepared, too, with a record where that has to
/// fit. Returns its warnings.
///
/// # Errors
/// With the dotted path of the first fault.
pub fn check(
    part: Part,
    document: &Table,
    dimension: Option<usize>,
    recorded: bool,
) -> Result<Vec<String>, ScenarioError> {
    if part == Part::Scenario {
        let ready = Scenario::from_document(document)?.prepare_recorded(recorded);
        return ready.map(|ready| ready.warnings);
    }
    scenario::check(part, document, dimension)?;
    Ok(vec![])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::TaskKind;
    use crate::planning::{feasibility, motion};
    use crate::runtime::AnyController;

    /// Whoever changes a scenario after its validation to a task that its space does not have is told so.
    #[test]
    fn no_direction_of_the_tool_in_the_plane() {
        let mut scenario = Scenario::from_toml(
            "duration = 1.0\nq0 = [0.1, 0.2]\narm = { lengths = [1, 1], masses = 1 }\n\
             reference = { kind = \"setpoint\", point = [1.5, 0.5] }",
        )
        .unwrap();
        assert!(scenario.prepare().is_ok());
        scenario.controller.task = TaskKind::Pointing;
        let faults = [
            scenario.prepare().map(drop),
            AnyController::from_scenario(&scenario).map(drop),
            motion::plan(&scenario, &motion::PlanSettings::default()).map(drop),
            feasibility::assess(&scenario).map(drop),
        ];
        for fault in faults {
            let told = fault.unwrap_err().to_string();
            assert!(told.contains("controller.task") && told.contains("in space"), "{told}");
        }
    }
}
