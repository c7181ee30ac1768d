//! Scenarios in the plane.

mod arm;
mod plant;

pub use arm::{ArmSpec, Nested};
pub use plant::PlantSpec;

use super::error::{Problem, ScenarioError};
use super::scene::{CheckReach, FromDocument, Scene};
use super::{links_of_obstacles, look_ahead, validate};
use crate::interrupt;
use crate::robot::planar::Annulus;
use crate::robot::{Model, PlanarArm, PlanarState, Robot};
use crate::simulation::{
    Control, Options, Perception, PerceptionSettings, Physics, PlanarSystem, Plane,
};
use crate::trajectory::{Knots, Reference, Trajectory};
use crate::world::Motion;
use crate::world::plane::Obstacle;
use std::sync::Arc;

/// The tables of a scenario in the plane that depend on its dimension.
pub type PlanarScene = Scene<Plane, 2>;

impl FromDocument<2> for Plane {
    type ArmTable = ArmSpec;
    type PlantTable = PlantSpec;
    type Reference = Reference;

    fn arm(table: &ArmSpec) -> Result<PlanarArm, ScenarioError> {
        table.build()
    }

    fn plant(
        table: &PlantSpec,
        arm: &ArmSpec,
        model: &Arc<PlanarArm>,
    ) -> Result<Physics<PlanarArm>, ScenarioError> {
        table.build(arm, model)
    }

    fn plan(reference: &Reference) -> Option<Knots<'_>> {
        reference.plan()
    }

    fn comes_to_rest(reference: &Reference) -> bool {
        use Reference::{Circle, Lissajous, Polynomial};
        !matches!(reference, Circle { .. } | Lissajous { .. } | Polynomial { .. })
    }

    fn validate_obstacle(obstacle: &Obstacle) -> Result<(), ScenarioError> {
        obstacle.shape.check()?;
        links_of_obstacles::margins(obstacle)?;
        look_ahead::likelihood(obstacle)?;
        let Obstacle { angle, angular_velocity, motion, position, .. } = obstacle;
        validate::motion_from(motion, *position)?;
        let Motion::Waypoints { angles, .. } = motion else { return Ok(()) };
        validate::turning(*angular_velocity != 0.0, "angles", angles, angle)
    }

    fn perception(
        settings: &PerceptionSettings,
        robot: &PlanarState,
        seed: u64,
        options: &Options,
    ) -> Result<Perception, ScenarioError> {
        let (dt, sampled) = (options.dt, options.control != Control::Continuous);
        validate::perception(settings, robot.body_count(), 2, dt, sampled)?;
        Ok(Perception::new(settings, seed, robot, dt))
    }
}

impl<const M: usize> CheckReach<2, M> for Plane
where
    Plane: PlanarSystem<M>,
{
    fn reachable(
        arm: &Arc<PlanarArm>,
        trajectory: &Trajectory<Self::Pose, M>,
        _: &[f64],
        options: &Options,
        duration: f64,
        _: f64,
    ) -> Result<(), ScenarioError> {
        let Annulus { inner, outer } = Self::annulus(arm);
        let slack = 1e-9 * outer.max(arm.links()[arm.dof() - 1].length);
        let point = |t: f64| {
            interrupt::checkpoint(64);
            Self::wrist(arm, &trajectory.at(t).x)
        };
        let inside = |t: f64| {
            let distance = point(t).norm();
            inner - slack <= distance && distance <= outer + slack
        };
        let samples = options.steps(duration).clamp(1, 100_000);
        #[expect(clippy::cast_precision_loss, reason = "at most 100 000")]
        let time = |k: usize| duration * (k as f64 / samples as f64);
        let Some(k) = (0..=samples).find(|&k| !inside(time(k))) else { return Ok(()) };
        let (mut before, mut after) = (time(k.saturating_sub(1)), time(k));
        for _ in 0..60 {
            let middle = 0.5 * (before + after);
            if inside(middle) { before = middle } else { after = middle }
        }
        let at = point(after);
        let (x, y, distance) = (at.x, at.y, at.norm());
        let problem = Problem::Unreachable { time: after, x, y, distance, inner, outer };
        Err(ScenarioError::new("reference", problem))
    }
}
