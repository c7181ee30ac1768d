//! What pushes an arm, in slices of numbers.

use crate::interrupt;
use crate::robot::{Model, Robot};
use crate::scenario::{AnyScene, FromDocument, Scenario, ScenarioError, Scene};
use crate::simulation::Acting;
use std::sync::Arc;

/// A wrench at one instant, in world axes, one coordinate after the other.
///
/// # Example
/// ```
/// use vff_core::runtime::{ActingPull, ActingWrench, wrenches_along};
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     wrenches = [{ link = "tip", force = [0.0, -5.0], start = 0.5 }]
///     "#,
/// )?;
/// let q = [0.4, 0.5, -0.6, 0.4, 0.5, -0.6];
/// let acting: Vec<Vec<ActingWrench>> = wrenches_along(&scenario, &[0.0, 1.0], &q)?;
/// assert_eq!(acting[1][0].force, [0.0, -5.0]);
/// // Nobody pulls in a document: that is for live runs.
/// let pulled: Option<ActingPull> = scenario.prepare()?.run.pulled();
/// assert!(pulled.is_none());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ActingWrench {
    /// The index of the link that it acts on.
    pub link: usize,
    /// Where the force acts \[m\].
    pub point: Vec<f64>,
    /// The force \[N\].
    pub force: Vec<f64>,
    /// The torque beside that of the force \[N·m\], along three axes.
    pub torque: [f64; 3],
}

impl<const D: usize> From<Acting<D>> for ActingWrench {
    fn from(acting: Acting<D>) -> Self {
        let Acting { link, point, force, torque } = acting;
        let [point, force] = [point, force].map(|vector| vector.as_slice().to_vec());
        Self { link, point, force, torque: torque.into() }
    }
}

/// What somebody pulls with at one instant, one coordinate after the other.
#[derive(Debug, Clone, PartialEq)]
pub struct ActingPull {
    /// The force and where it acts.
    pub wrench: ActingWrench,
    /// The place that it pulls to \[m\].
    pub anchor: Vec<f64>,
}

/// The wrenches of a scenario at instants `times` \[s\] of a run in which its arm has the joint angles `q` \[rad, m\], n numbers
/// each: those over the plant steps that begin then.
///
/// # Errors
/// If the scenario cannot be run.
pub fn wrenches_along(
    scenario: &Scenario,
    times: &[f64],
    q: &[f64],
) -> Result<Vec<Vec<ActingWrench>>, ScenarioError> {
    match &scenario.scene {
        AnyScene::Plane(scene) => along(scenario, scene, times, q),
        AnyScene::Space(scene) => along(scenario, scene, times, q),
    }
}

fn along<S: FromDocument<D>, const D: usize>(
    scenario: &Scenario,
    scene: &Scene<S, D>,
    times: &[f64],
    q: &[f64],
) -> Result<Vec<Vec<ActingWrench>>, ScenarioError> {
    let arm = Arc::new(S::arm(&scene.arm)?);
    let mut wrenches = scene.wrenches_on(&*arm)?;
    let (mut state, half) = (arm.state(), 0.5 * scenario.simulation.dt);
    let at = |(t, q): (&f64, &[f64])| {
        interrupt::checkpoint(64 * (q.len() + scene.wrenches.len()));
        state.update_positions(q);
        wrenches.go_to(t + half);
        wrenches.acting(&state).map(ActingWrench::from).collect()
    };
    Ok(times.iter().zip(q.chunks_exact(arm.dof())).map(at).collect())
}
