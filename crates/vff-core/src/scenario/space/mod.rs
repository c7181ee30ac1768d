//! Scenarios in space.

mod arm;
mod load;
mod plant;

pub use arm::SpatialArmSpec;
pub use load::LoadSpec;
pub use plant::{PayloadSpec, SpatialPlantSpec};

use super::error::{Problem, ScenarioError};
use super::scene::{CheckReach, FromDocument, Scene};
use super::{links_of_obstacles, look_ahead, validate};
use crate::inverse_kinematics::{Residual, Solver, Unreachable};
use crate::perception::PerceptionError;
use crate::robot::{Robot, SpatialArm, SpatialState};
use crate::simulation::{
    Control, Options, PerceptionSettings, Physics, Space, SpatialPerception, System,
};
use crate::trajectory::{Guided, Knots, SpatialReference, Trajectory};
use crate::world::Motion;
use crate::world::space::Obstacle;
use std::sync::Arc;

/// The tables of a scenario in space that depend on its dimension.
pub type SpatialScene = Scene<Space, 3>;

impl FromDocument<3> for Space {
    type ArmTable = SpatialArmSpec;
    type PlantTable = SpatialPlantSpec;
    type Reference = SpatialReference;

    fn arm(table: &SpatialArmSpec) -> Result<SpatialArm, ScenarioError> {
        table.build()
    }

    fn plant(
        table: &SpatialPlantSpec,
        spec: &SpatialArmSpec,
        model: &Arc<SpatialArm>,
    ) -> Result<Physics<SpatialArm>, ScenarioError> {
        table.build(spec, model)
    }

    fn plan(reference: &SpatialReference) -> Option<Knots<'_>> {
        reference.plan()
    }

    fn comes_to_rest(reference: &SpatialReference) -> bool {
        use SpatialReference::{Circle, Lissajous, Polynomial};
        !matches!(reference, Circle { .. } | Lissajous { .. } | Polynomial { .. })
    }

    fn validate_obstacle(obstacle: &Obstacle) -> Result<(), ScenarioError> {
        obstacle.shape.check()?;
        links_of_obstacles::margins(obstacle)?;
        look_ahead::likelihood(obstacle)?;
        let Obstacle { orientation, angular_velocity, motion, position, .. } = obstacle;
        validate::orientation("orientation", orientation)?;
        validate::motion_from(motion, *position)?;
        let Motion::Waypoints { orientations, .. } = motion else { return Ok(()) };
        let spins = angular_velocity.iter().any(|rate| *rate != 0.0);
        validate::turning(spins, "orientations", orientations, orientation)
    }

    fn orientation_of(obstacle: &Obstacle) -> Option<[f64; 4]> {
        Some(obstacle.orientation)
    }

    fn orientations(scene: &SpatialScene) -> Vec<(String, [f64; 4])> {
        let mount =
            scene.arm.mount.map(|mount| ("arm.mount.orientation".into(), mount.orientation));
        let obstacles = scene.obstacles.iter().enumerate();
        let obstacles = obstacles
            .map(|(j, obstacle)| (format!("obstacles[{j}].orientation"), obstacle.orientation));
        let reference = scene.reference.orientation();
        let reference = reference.map(|given| ("reference.orientation".into(), given));
        mount.into_iter().chain(obstacles).chain(reference).collect()
    }

    fn perception(
        settings: &PerceptionSettings,
        robot: &SpatialState,
        seed: u64,
        options: &Options,
    ) -> Result<SpatialPerception, ScenarioError> {
        let (dt, sampled) = (options.dt, options.control != Control::Continuous);
        validate::perception(settings, robot.body_count(), 3, dt, sampled)?;
        SpatialPerception::new(settings, seed, robot, dt).map_err(|error| {
            let path = match &error {
                PerceptionError::Setting { key, .. } => format!("perceiver.{key}"),
                _ => "perceiver".into(),
            };
            let problem = match error {
                PerceptionError::Setting { problem, .. } => problem,
                other => other.to_string(),
            };
            ScenarioError::new(&path, Problem::Other(problem))
        })
    }
}

impl<const M: usize> CheckReach<3, M> for Space
where
    Space: System<3, M, Pose: Guided<M, Reference = SpatialReference>>,
{
    fn reachable(
        arm: &Arc<SpatialArm>,
        trajectory: &Trajectory<Self::Pose, M>,
        q0: &[f64],
        options: &Options,
        duration: f64,
        length: f64,
    ) -> Result<(), ScenarioError> {
        let samples = options.steps(duration).clamp(1, 2_000);
        Solver::new(arm.dof(), length)
            .follow(&mut arm.state(), trajectory, q0, duration, samples)
            .map_err(|Unreachable { time, error }| {
                let Residual { position, angle } = error;
                let angle = (M > 3).then_some(angle);
                ScenarioError::new("reference", Problem::OutOfReach { time, position, angle })
            })
    }
}
