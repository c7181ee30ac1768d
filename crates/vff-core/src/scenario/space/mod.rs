//! Scenarios in space.

mod arm;
mod plant;

pub use arm::SpatialArmSpec;
pub use plant::{PayloadSpec, SpatialPlantSpec};

use super::error::{Problem, ScenarioError};
use super::numbers::{not_negative, number, positive};
use super::scene::{Described, Prepared, Scene};
use super::validate;
use crate::inverse_kinematics::{Residual, Solver, Unreachable};
use crate::math::Vector;
use crate::robot::{Model, Robot, SpatialArm, SpatialState};
use crate::simulation::{
    Control, Options, PerceptionSettings, Physics, Space, SpatialPerception, System,
};
use crate::trajectory::{Guided, SpatialReference, Trajectory};
use crate::world::Motion;
use crate::world::space::{MOST_POINTS, Obstacle, Shape, check_hull};
use std::sync::Arc;

/// The tables of a scenario in space that depend on its dimension.
pub type SpatialScene = Scene<Space, 3>;

impl Described<3> for Space {
    type ArmTable = SpatialArmSpec;
    type PlantTable = SpatialPlantSpec;
    type Reference = SpatialReference;

    fn arm(table: &SpatialArmSpec) -> Result<SpatialArm, ScenarioError> {
        table.build()
    }

    fn plant(
        table: &SpatialPlantSpec,
        _: &SpatialArmSpec,
        model: &Arc<SpatialArm>,
    ) -> Result<Physics<SpatialArm>, ScenarioError> {
        table.build(model)
    }

    fn is_plan(reference: &SpatialReference) -> bool {
        matches!(reference, SpatialReference::Plan { .. })
    }

    fn validate_obstacle(obstacle: &Obstacle) -> Result<(), ScenarioError> {
        shape(&obstacle.shape).map_err(|error| error.inside("shape"))?;
        let Obstacle { orientation, angular_velocity, motion, position, .. } = obstacle;
        validate::orientation("orientation", orientation)?;
        validate::motion_from(motion, *position)?;
        let Motion::Waypoints { orientations, .. } = motion else { return Ok(()) };
        let spins = angular_velocity.iter().any(|rate| *rate != 0.0);
        validate::turning(spins, "orientations", orientations, orientation)
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
        Ok(SpatialPerception::new(settings, seed, robot, dt))
    }
}

fn shape(shape: &Shape) -> Result<(), ScenarioError> {
    match shape {
        Shape::Sphere { radius } => number("radius", *radius, positive),
        Shape::Capsule { a, b, radius } => {
            number("radius", *radius, not_negative)?;
            if validate::same(a, b) {
                return Err(ScenarioError::out_of_range("b", "another point than a", b));
            }
            Ok(())
        }
        Shape::Box { size } => {
            (0..3).try_for_each(|axis| number(&format!("size[{axis}]"), size[axis], positive))
        }
        Shape::Convex { vertices } => check_hull(vertices).map_err(|error| {
            ScenarioError::new("vertices", Problem::Other(format!("expected {error}")))
        }),
        Shape::HalfSpace { normal } => {
            let norm = Vector::from(*normal).norm();
            if (norm - 1.0).abs() <= crate::math::rotation::UNIT_TOLERANCE {
                return Ok(());
            }
            let requirement = format!("a vector of norm 1, not {norm}");
            Err(ScenarioError::out_of_range("normal", &requirement, normal))
        }
        Shape::Points { points, radius } => {
            number("radius", *radius, not_negative)?;
            match points.len() <= MOST_POINTS {
                true => Ok(()),
                false => {
                    let problem =
                        format!("expected at most {MOST_POINTS} of them, got {}", points.len());
                    Err(ScenarioError::new("points", Problem::Other(problem)))
                }
            }
        }
    }
}

impl<const M: usize> Prepared<3, M> for Space
where
    Space: System<3, M, Pose: Guided<M, Reference = SpatialReference>>,
{
    fn reachable(
        arm: &Arc<SpatialArm>,
        trajectory: &Trajectory<Self::Pose, M>,
        q0: &[f64],
        options: &Options,
        duration: f64,
    ) -> Result<(), ScenarioError> {
        let samples = options.steps(duration).clamp(1, 2_000);
        Solver::new(arm.dof(), arm.characteristic_length())
            .follow(&mut arm.state(), trajectory, q0, duration, samples)
            .map_err(|Unreachable { time, error }| {
                let Residual { position, angle } = error;
                let angle = (M > 3).then_some(angle);
                ScenarioError::new("reference", Problem::OutOfReach { time, position, angle })
            })
    }
}
