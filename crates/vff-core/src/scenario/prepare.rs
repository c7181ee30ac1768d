//! A scenario made ready to run: everything that needs more than one value is checked here.

use super::{Problem, Scenario, ScenarioError, validate};
use crate::control::Gains;
use crate::interrupt;
use crate::robot::planar::Annulus;
use crate::robot::{Model, PlanarArm, Robot};
use crate::simulation::{
    Actuator, ClosedLoop, Control, Measurement, Perception, PerceptionKind, PlanarSystem, Reality,
    Sizes,
};
use crate::trajectory::Trajectory;
use crate::world::plane::World;
use std::sync::Arc;

impl Scenario {
    /// The physical arm, the sensors and the drives.
    pub(super) fn reality(
        &self,
        model: &Arc<PlanarArm>,
    ) -> Result<Reality<PlanarArm, Perception>, ScenarioError> {
        let (n, dt) = (model.dof(), self.simulation.dt);
        let state = model.state();
        let plant = self.plant.build(&self.arm, model).map_err(|error| error.inside("plant"))?;
        let sampled = self.simulation.control != Control::Continuous;
        if let Some(settings) = &self.measurement {
            validate::measurement(settings, n, dt, sampled)
                .map_err(|error| error.inside("measurement"))?;
        }
        let perception =
            self.perception.as_ref().filter(|given| given.kind == PerceptionKind::Range);
        if let Some(settings) = perception {
            validate::perception(settings, state.body_count(), dt, sampled)
                .map_err(|error| error.inside("perception"))?;
        }
        if let Some(settings) = &self.actuator {
            validate::actuator(settings, n, sampled).map_err(|error| error.inside("actuator"))?;
        }
        let measurement = self.measurement.as_ref();
        Ok(Reality {
            plant,
            measurement: measurement.map(|given| Measurement::new(given, self.seed, n, dt)),
            perception: perception.map(|given| Perception::new(given, self.seed, &state, dt)),
            actuator: self.actuator.as_ref().map(|given| Actuator::new(given, n, dt)),
        })
    }

    /// The physical arm, payload included.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn plant_arm(&self) -> Result<Arc<PlanarArm>, ScenarioError> {
        let model = Arc::new(self.arm.build().map_err(|error| error.inside("arm"))?);
        Ok(self.reality(&model)?.plant.arm)
    }

    /// The closed loop at t = 0 for a task of dimension `M`, and what is odd about it, in sentences.
    ///
    /// # Errors
    /// If the reference does not fit the task or leaves the reach of the arm.
    pub(crate) fn closed_loop<S: PlanarSystem<M>, const M: usize>(
        &self,
    ) -> Result<(ClosedLoop<S, 2, M>, Vec<String>), ScenarioError> {
        let arm = Arc::new(self.arm.build().map_err(|error| error.inside("arm"))?);
        let n = arm.dof();
        let dq0 = self.dq0.clone().unwrap_or_else(|| vec![0.0; n]);
        let start = S::pose(&arm, &self.q0, &dq0);
        let trajectory = Trajectory::new(&self.reference, &start).map_err(|error| {
            ScenarioError::new(
                format!("reference.{}", error.field()),
                Problem::Other(error.to_string()),
            )
        })?;
        self.reachable::<S, M>(&arm, &trajectory)?;
        let gains = Gains::<M>::new(&self.controller).with_seed(self.seed);
        let world = World::new(self.obstacles.clone());
        let options = self.simulation.clone();
        let reality = self.reality(&arm)?;
        let stops = reality.plant.stops.clone();
        let start = [self.q0.clone(), dq0];
        let closed_loop = ClosedLoop::new(&arm, gains, world, trajectory, options, reality, start);
        let warnings = self.warnings(&closed_loop, &stops);
        Ok((closed_loop, warnings))
    }

    /// What the record of a whole run takes \[bytes\].
    #[expect(clippy::cast_precision_loss, reason = "a size to compare")]
    pub fn record_bytes(&self) -> f64 {
        let (joints, task) = (self.arm.dof(), self.controller.task.dimension(2));
        let sizes = Sizes {
            dimension: 2,
            joints,
            task,
            pose: task,
            obstacles: self.obstacles.len(),
            rays: self.perception.as_ref().map_or(0, |given| given.rays_of(joints)),
        };
        self.simulation.rows(self.duration) as f64 * sizes.row_bytes() as f64
    }

    /// The whole reference lies where the arm can put its end effector.
    fn reachable<S: PlanarSystem<M>, const M: usize>(
        &self,
        arm: &PlanarArm,
        trajectory: &Trajectory<S::Pose, M>,
    ) -> Result<(), ScenarioError> {
        let Annulus { inner, outer } = S::annulus(arm);
        let slack = 1e-9 * outer.max(arm.links()[arm.dof() - 1].length);
        let point = |t: f64| {
            interrupt::spend(64);
            S::wrist(arm, &trajectory.at(t).x)
        };
        let inside = |t: f64| {
            let distance = point(t).norm();
            inner - slack <= distance && distance <= outer + slack
        };
        let samples = self.simulation.steps(self.duration).clamp(1, 100_000);
        #[expect(clippy::cast_precision_loss, reason = "at most 100 000")]
        let time = |k: usize| self.duration * (k as f64 / samples as f64);
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
