//! A scenario made ready to run: everything that needs more than one value is checked here.

use super::scene::{CheckReach, FromDocument, Scene};
use super::{Problem, Scenario, ScenarioError, WhereUnreachable, numbers, validate};
use crate::control::{Gains, Gravity};
use crate::planned_reference::follow_plan;
use crate::robot::{Limits, Manipulator, Model, Robot};
use crate::settings::{FROM_NONE_TO_ALL, NOT_NEGATIVE};
use crate::simulation::{
    Actuator, ClosedLoop, Control, Measurement, PerceptionKind, Physics, Reality, Sizes,
    SpaceTypes, System, orientation_width,
};
use crate::trajectory::{Guided, JointSpline, Knots, Trajectory, TrajectoryError};
use crate::world::World;
use std::sync::Arc;

/// What is wrong with `[reference]`.
pub(crate) fn unusable(error: &TrajectoryError) -> ScenarioError {
    ScenarioError::new(format!("reference.{}", error.field()), Problem::Other(error.to_string()))
}

/// The joints of a plan for an arm of `n` joints with these limits.
fn joints(
    Knots { times, points, margins, shares }: Knots<'_>,
    limits: &Limits,
    n: usize,
) -> Result<JointSpline, ScenarioError> {
    for (i, point) in points.iter().enumerate() {
        numbers::length(&format!("reference.points[{i}]"), point.len(), n)?;
        for (k, (q, [lower, upper])) in point.iter().zip(&limits.joint).enumerate() {
            if q < lower || upper < q {
                let requirement = format!("within the limits of the joint, {lower} to {upper}");
                let path = format!("reference.points[{i}][{k}]");
                return Err(ScenarioError::out_of_range(&path, &requirement, q));
            }
        }
    }
    let spline = JointSpline::new(times, points).map_err(|error| unusable(&error))?;
    for (name, rows, range) in
        [("margins", margins, &NOT_NEGATIVE), ("shares", shares, &FROM_NONE_TO_ALL)]
    {
        for (i, row) in rows.unwrap_or_default().iter().enumerate() {
            for (k, kept) in row.iter().enumerate() {
                if !(range.holds)(*kept) {
                    let path = format!("reference.{name}[{i}][{k}]");
                    return Err(ScenarioError::out_of_range(&path, range.words, *kept));
                }
            }
        }
    }
    match (margins, shares) {
        (Some(margins), _) => spline.keeping(margins, shares).map_err(|error| unusable(&error)),
        (None, Some(_)) => {
            let problem = "says of what is kept a share alone: needs `reference.margins` beside it";
            Err(ScenarioError::new("reference.shares", Problem::Other(problem.into())))
        }
        (None, None) => Ok(spline),
    }
}

/// Where the end effector of `arm`, which is at `start` at t = 0, has to be: as a reference says, or where the joints of a plan put it.
///
/// # Errors
/// If the reference does not fit the task or the arm.
pub(crate) fn trajectory<S: CheckReach<D, M>, const D: usize, const M: usize>(
    reference: &S::Reference,
    arm: &Arc<S::Arm>,
    start: &S::Pose,
) -> Result<Trajectory<S::Pose, M>, ScenarioError> {
    match S::Pose::plan(reference) {
        Some(knots) => {
            let joints = joints(knots, arm.limits(), arm.dof())?;
            Ok(follow_plan::<S::State, D, M>(arm.state(), joints))
        }
        None => Trajectory::new(reference, start).map_err(|error| unusable(&error)),
    }
}

/// Which arm, where its end effector has to be, and what is odd about that.
type ArmAndReference<S, const D: usize, const M: usize> =
    (Arc<<S as SpaceTypes<D>>::Arm>, Trajectory<<S as System<D, M>>::Pose, M>, Option<String>);

impl Scenario {
    /// The physical arm, the sensors and the drives.
    pub(super) fn reality<S: FromDocument<D>, const D: usize>(
        &self,
        scene: &Scene<S, D>,
        model: &Arc<S::Arm>,
    ) -> Result<Reality<S::Arm, S::Perception, D>, ScenarioError> {
        let (n, dt) = (model.dof(), self.simulation.dt);
        let mut plant =
            S::plant(&scene.plant, &scene.arm, model).map_err(|error| error.inside("plant"))?;
        plant.compensates_gravity = self.controller.command.gravity == Gravity::Robot;
        let sampled = self.simulation.control != Control::Continuous;
        if let Some(settings) = &self.measurement {
            validate::measurement(settings, n, dt, sampled)
                .map_err(|error| error.inside("measurement"))?;
        }
        let perception = self
            .perception
            .as_ref()
            .filter(|given| given.kind != PerceptionKind::Ideal)
            .map(|given| S::perception(given, &model.state(), self.seed, &self.simulation))
            .transpose()
            .map_err(|error| error.inside("perception"))?;
        if let Some(settings) = &self.actuator {
            validate::actuator(settings, n, sampled).map_err(|error| error.inside("actuator"))?;
        }
        let measurement = self.measurement.as_ref();
        Ok(Reality {
            plant,
            measurement: measurement.map(|given| Measurement::new(given, self.seed, n, dt)),
            perception,
            actuator: self.actuator.as_ref().map(|given| Actuator::new(given, n, dt)),
            wrenches: scene.wrenches.clone(),
            contacts: self.contacts.clone(),
        })
    }

    /// The physical arm, payload included, with its friction and stops.
    ///
    /// # Errors
    /// With the dotted path of the first fault.
    pub fn physics<S: FromDocument<D>, const D: usize>(
        &self,
        scene: &Scene<S, D>,
    ) -> Result<Physics<S::Arm>, ScenarioError> {
        let model = Arc::new(S::arm(&scene.arm).map_err(|error| error.inside("arm"))?);
        Ok(self.reality(scene, &model)?.plant)
    }

    /// The arm of the controller, and the reference that it can follow from `q0` on.
    ///
    /// # Errors
    /// If the reference does not fit the task or leaves the reach of the arm.
    pub(crate) fn arm_and_reference<S: CheckReach<D, M>, const D: usize, const M: usize>(
        &self,
        scene: &Scene<S, D>,
    ) -> Result<ArmAndReference<S, D, M>, ScenarioError> {
        let arm = Arc::new(S::arm(&scene.arm).map_err(|error| error.inside("arm"))?);
        validate::angles(&self.q0, &*arm)?;
        let mut state = arm.state();
        let rest = vec![0.0; arm.dof()];
        state.update(&self.q0, self.dq0.as_deref().unwrap_or(&rest));
        let trajectory = trajectory::<S, D, M>(&scene.reference, &arm, &state.pose())?;
        // Joints within their limits reach where they put the end effector.
        let odd = match trajectory.joints() {
            Some(_) => None,
            None => {
                let length = self.controller.length_of(&*arm);
                S::reachable(&arm, &trajectory, &self.q0, &self.simulation, self.duration, length)
                    .err()
            }
        };
        match (odd, self.unreachable) {
            (Some(error), WhereUnreachable::Refuse) => Err(error),
            (odd, _) => Ok((arm, trajectory, odd.map(|error| error.to_string()))),
        }
    }

    /// The closed loop at t = 0 for a task of dimension `M`, and what is odd about it, in sentences.
    ///
    /// # Errors
    /// If the reference does not fit the task or leaves the reach of the arm.
    pub(crate) fn closed_loop<S: CheckReach<D, M>, const D: usize, const M: usize>(
        &self,
        scene: &Scene<S, D>,
    ) -> Result<(ClosedLoop<S, D, M>, Vec<String>), ScenarioError> {
        let (arm, trajectory, odd) = self.arm_and_reference::<S, D, M>(scene)?;
        let dq0 = self.dq0.clone().unwrap_or_else(|| vec![0.0; arm.dof()]);
        let gains =
            Gains::<M>::new(&self.controller).of_arm(&self.controller, &*arm).with_seed(self.seed);
        let world = World::new(scene.obstacles.clone());
        let options = self.simulation.clone();
        let reality = self.reality(scene, &arm)?;
        let stops = reality.plant.stops.clone();
        let friction = self.stiff_friction(&reality.plant);
        let start = [self.q0.clone(), dq0];
        let closed_loop = ClosedLoop::new(&arm, gains, world, trajectory, options, reality, start);
        let warnings = self.warnings(scene, &closed_loop, &stops);
        Ok((closed_loop, odd.into_iter().chain(warnings).chain(friction).collect()))
    }

    /// About how many numbers a run keeps beside its record: arm, world, law and sensors. Measured, and rounded up.
    #[expect(clippy::cast_precision_loss, reason = "a size to compare")]
    pub fn run_numbers(&self) -> f64 {
        // In the plane, and in space.
        const BASE: [f64; 2] = [3e3, 1e4];
        const JOINT: [f64; 2] = [6e2, 3e3];
        const OBSTACLE: [f64; 2] = [1e3, 3e3];
        const PREVIEW: f64 = 5e4;
        const POINT: f64 = 40.0;
        let (dimension, bodies) = (self.scene.dimension(), self.scene.body_count());
        let [base, joint, obstacle] = [BASE, JOINT, OBSTACLE].map(|each| each[dimension - 2]);
        let preview = if self.controller.yielding.preview.is_some() { PREVIEW } else { 0.0 };
        let copies = if self.simulation.control == Control::Predictor { 2.0 } else { 1.0 };
        let law = base + joint * self.q0.len() as f64 + preview;
        let world = obstacle * self.scene.obstacle_count() as f64
            + POINT * self.scene.cloud_points() as f64;
        let sensed = self.perception.as_ref().map_or(0.0, |given| {
            given.readings_under_way(bodies, dimension, self.simulation.dt) * dimension as f64
                + POINT * given.points_of(bodies, dimension) as f64
                + given.cells_of_the_room()
        });
        copies * (law + world) + sensed
    }

    /// What the record of a whole run takes \[bytes\].
    #[expect(clippy::cast_precision_loss, reason = "a size to compare")]
    pub fn record_bytes(&self) -> f64 {
        let (joints, dimension) = (self.q0.len(), self.scene.dimension());
        let task = self.controller.task.dimension(dimension).unwrap_or_default();
        let width = if dimension == 3 && task > 3 { 7 } else { task };
        let orientation = orientation_width(dimension, width);
        let sizes = Sizes {
            dimension,
            joints,
            task,
            pose: width - orientation,
            orientation,
            obstacles: self.scene.obstacle_count(),
            rays: self.perception.as_ref().map_or(0, |given| match given.kind {
                PerceptionKind::Range => given.points_of(self.scene.body_count(), dimension),
                _ => given.points_of(0, dimension),
            }),
        };
        self.simulation.rows(self.duration) as f64 * sizes.row_bytes() as f64
    }
}
