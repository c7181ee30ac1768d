//! The one place where a type is chosen at run time.

use super::points::{self, PointsError};
use crate::control::{Gains, Settings, TaskKind};
use crate::math::{UnitQuaternion, Vector};
use crate::planning::motion::Jointed;
use crate::planning::replanning::Replanner;
use crate::robot::{Limits, Model};
use crate::scenario::{
    self, AnyScene, Described, Part, Prepared, Problem, Scenario, ScenarioError, Scene,
};
use crate::simulation::{Outcome, Plane, Run, Snapshot, Space, System};
use crate::world::space::{self, Points};
use crate::world::{Rotation, Turning};
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

/// A run of any arm with any task: the list of all that there are.
#[derive(Debug, Clone)]
pub enum AnyRun {
    /// In the plane, position.
    PlanarPosition(Box<Run<Plane, 2, 2>>),
    /// In the plane, position and orientation.
    PlanarPose(Box<Run<Plane, 2, 3>>),
    /// In space, position.
    SpatialPosition(Box<Run<Space, 3, 3>>),
    /// In space, position and direction of the tool.
    SpatialPointing(Box<Run<Space, 3, 5>>),
    /// In space, position and orientation.
    SpatialPose(Box<Run<Space, 3, 6>>),
}

/// Does the same with whatever run it is.
macro_rules! either {
    ($run:expr, $inner:ident => $body:expr) => {
        match $run {
            AnyRun::PlanarPosition($inner) => $body,
            AnyRun::PlanarPose($inner) => $body,
            AnyRun::SpatialPosition($inner) => $body,
            AnyRun::SpatialPointing($inner) => $body,
            AnyRun::SpatialPose($inner) => $body,
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

    /// [`ClosedLoop::drive`](crate::simulation::ClosedLoop::drive).
    pub fn drive(&mut self) -> &[f64] {
        either!(self, run => run.closed_loop_mut().drive())
    }

    /// [`ClosedLoop::torque_at`](crate::simulation::ClosedLoop::torque_at).
    pub fn torque_at(&mut self, t: f64, q: &[f64], dq: &[f64]) -> &[f64] {
        either!(self, run => run.closed_loop_mut().torque_at(t, q, dq))
    }

    /// [`Run::arrive_at`].
    pub fn arrive_at(&mut self, q: &[f64], dq: &[f64]) -> bool {
        either!(self, run => run.arrive_at(q, dq))
    }

    /// [`Run::is_over`].
    pub fn is_over(&self) -> bool {
        either!(self, run => run.is_over())
    }

    /// [`ClosedLoop::restart`](crate::simulation::ClosedLoop::restart), without record or metrics.
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
    /// `external` \[N·m\]. Returns false if the new state is not finite.
    pub fn advance(&mut self, external: Option<&[f64]>) -> bool {
        either!(self, run => run.closed_loop_mut().advance(external))
    }

    /// [`ClosedLoop::plan_beside`](crate::simulation::ClosedLoop::plan_beside).
    pub fn plan_beside(&mut self) {
        either!(self, run => run.closed_loop_mut().plan_beside());
    }

    /// Changes the gains, which must be for the same task. Allocates.
    pub fn configure(&mut self, settings: &Settings, seed: u64) {
        either!(self, run => {
            let inner = run.closed_loop_mut();
            let gains = Gains::new(settings).of_arm(settings, &**inner.arm()).with_seed(seed);
            inner.set_gains(&gains);
        });
    }

    /// [`ClosedLoop::pushes`](crate::simulation::ClosedLoop::pushes), as points and forces, one coordinate after the other.
    pub fn pushes(&mut self) -> [Vec<f64>; 2] {
        either!(self, run => {
            let pushes = run.closed_loop_mut().pushes();
            [0, 1].map(|k| pushes.iter().flat_map(|push| push[k].iter().copied()).collect())
        })
    }

    /// The position of obstacle `j` \[m\].
    pub fn obstacle_position(&self, j: usize) -> Vec<f64> {
        either!(self, run => run.closed_loop().world().position(j).as_slice().to_vec())
    }

    /// Where the obstacles are at time `t` \[m\], one coordinate after the other.
    pub fn obstacles_at(&self, t: f64) -> Vec<f64> {
        either!(self, run => {
            let world = run.closed_loop().world();
            let places = (0..world.len()).map(|j| world.position_at(j, t));
            places.flat_map(|place| place.as_slice().to_vec()).collect()
        })
    }

    /// Carries obstacle `j` to `goal` \[m\] from now on, with the pole `rate` \[1/s\]. Does not allocate.
    pub fn carry(&mut self, j: usize, goal: &[f64], rate: f64) {
        either!(self, run => {
            let goal = Vector::from_column_slice(goal);
            run.closed_loop_mut().change_world(|world| world.carry(j, goal, rate));
        });
    }

    /// Turns obstacle `j` to `orientation` the short way from now on, at `rate` \[rad/s\]. Allocates.
    ///
    /// # Errors
    /// In the plane.
    pub fn turn(
        &mut self,
        j: usize,
        orientation: UnitQuaternion,
        rate: f64,
    ) -> Result<(), ScenarioError> {
        let change = |world: &mut space::World| {
            let given = UnitQuaternion::new(world.obstacle(j).orientation).unwrap_or_default();
            let now =
                world.turn_at(j, world.time()).map_or(Rotation::identity(), |turn| turn.rotation);
            let goal = orientation * given.inverse();
            world.set_turning(j, Turning::toward(world.time(), &now, &goal, rate));
        };
        if self.change_space(change) {
            return Ok(());
        }
        let problem = Problem::Other("in the plane nobody turns it".into());
        Err(ScenarioError::new(format!("obstacles[{j}]"), problem))
    }

    /// How every obstacle is turned, compared with its description: a matrix (D, D) each, row by row.
    pub fn turns(&self) -> Vec<f64> {
        either!(self, run => {
            let world = run.closed_loop().world();
            let turns = (0..world.len()).map(|j| {
                let turn = world.turn_at(j, world.time());
                turn.map_or(Rotation::identity(), |turn| turn.rotation)
            });
            turns.flat_map(|turn| turn.transpose().as_slice().to_vec()).collect()
        })
    }

    /// Adds the obstacle of a document, the last one from now on. Allocates.
    ///
    /// # Errors
    /// With the dotted path of the first fault of the document.
    pub fn add(&mut self, document: &Table) -> Result<(), ScenarioError> {
        either!(self, run => add(run, document))
    }

    /// What is around an arm in space.
    fn space(&self) -> Result<&space::World, PointsError> {
        match self {
            Self::PlanarPosition(_) | Self::PlanarPose(_) => Err(PointsError::InThePlane),
            Self::SpatialPosition(run) => Ok(run.closed_loop().world()),
            Self::SpatialPointing(run) => Ok(run.closed_loop().world()),
            Self::SpatialPose(run) => Ok(run.closed_loop().world()),
        }
    }

    /// The orientation in which the points of obstacle `j` stand.
    ///
    /// # Errors
    /// If it is no cloud.
    pub fn orientation_of_points(&self, j: usize) -> Result<[f64; 4], PointsError> {
        points::orientation_of(self.space()?, j)
    }

    /// Puts other points in place of those of obstacle `j`, where the controller has these settings.
    ///
    /// # Errors
    /// If it is no cloud, or not the one that they were made for; then nothing has changed.
    pub fn update_points(
        &mut self,
        j: usize,
        points: &Points,
        settings: &Settings,
    ) -> Result<(), PointsError> {
        points::check(self.space()?, j, points, settings, self.sizes()[0])?;
        self.change_space(|world| _ = world.swap_points(j, &mut points.clone()));
        Ok(())
    }

    /// Changes what is around an arm in space; whether it is one.
    fn change_space(&mut self, change: impl Fn(&mut space::World)) -> bool {
        match self {
            Self::PlanarPosition(_) | Self::PlanarPose(_) => return false,
            Self::SpatialPosition(run) => run.closed_loop_mut().change_world(change),
            Self::SpatialPointing(run) => run.closed_loop_mut().change_world(change),
            Self::SpatialPose(run) => run.closed_loop_mut().change_world(change),
        }
        true
    }

    /// Takes obstacle `j` away.
    pub fn remove(&mut self, j: usize) {
        either!(self, run => run.closed_loop_mut().change_world(|world| world.remove(j)));
    }

    /// [`ClosedLoop::aim`](crate::simulation::ClosedLoop::aim). Does not allocate.
    pub fn aim(&mut self, goal: &[f64], rate: f64) {
        either!(self, run => run.closed_loop_mut().aim(goal, rate));
    }

    /// The same for a position \[m\] in space with an orientation. Does not allocate.
    pub fn aim_pose(&mut self, goal: &[f64], orientation: UnitQuaternion, rate: f64) {
        let [w, x, y, z] = orientation.to_array();
        self.aim(&[goal[0], goal[1], goal[2], w, x, y, z], rate);
    }

    /// Moves `goal` \[m\] to the position nearest to it that the end effector can take with the orientation of the
    /// reference. Does not allocate.
    pub fn make_attainable(&self, goal: &mut [f64]) {
        either!(self, run => {
            let nearest = run.closed_loop().attainable(&Vector::from_column_slice(goal));
            goal.copy_from_slice(nearest.as_slice());
        });
    }

    /// What the joints can do.
    pub fn limits(&self) -> &Limits {
        either!(self, run => run.closed_loop().limits())
    }

    /// The number of joints n and the dimension of the space.
    pub fn sizes(&self) -> [usize; 2] {
        let s = self.snapshot();
        [s.q.len(), s.dimension]
    }

    /// [`Model::slides`].
    pub fn slides(&self, joint: usize) -> bool {
        either!(self, run => run.closed_loop().arm().slides(joint))
    }

    /// [`Model::typical_torque`].
    pub fn typical_torque(&self) -> Vec<f64> {
        either!(self, run => run.closed_loop().arm().typical_torque())
    }

    /// A distance from the base that the end effector cannot exceed \[m\].
    pub fn reach(&self) -> f64 {
        either!(self, run => run.closed_loop().arm().reach())
    }
}

fn add<S: Described<D> + System<D, M>, const D: usize, const M: usize>(
    run: &mut Run<S, D, M>,
    document: &Table,
) -> Result<(), ScenarioError> {
    let obstacle = scenario::read_obstacle::<S, D>(document)?;
    run.closed_loop_mut().change_world(|world| world.add(obstacle.clone()));
    Ok(())
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
        use TaskKind::{Pointing, Pose, Position};
        match (&self.scene, self.controller.task) {
            (AnyScene::Plane(scene), Position) => {
                self.prepare_for::<Plane, 2, 2>(scene, recorded, AnyRun::PlanarPosition)
            }
            (AnyScene::Plane(scene), Pose) => {
                self.prepare_for::<Plane, 2, 3>(scene, recorded, AnyRun::PlanarPose)
            }
            (AnyScene::Space(scene), Position) => {
                self.prepare_for::<Space, 3, 3>(scene, recorded, AnyRun::SpatialPosition)
            }
            (AnyScene::Space(scene), Pointing) => {
                self.prepare_for::<Space, 3, 5>(scene, recorded, AnyRun::SpatialPointing)
            }
            (AnyScene::Space(scene), Pose) => {
                self.prepare_for::<Space, 3, 6>(scene, recorded, AnyRun::SpatialPose)
            }
            (AnyScene::Plane(_), Pointing) => unreachable!("validated: no task of the plane"),
        }
    }

    fn prepare_for<S, const D: usize, const M: usize>(
        &self,
        scene: &Scene<S, D>,
        recorded: bool,
        wrap: impl Fn(Box<Run<S, D, M>>) -> AnyRun,
    ) -> Result<Ready, ScenarioError>
    where
        S: Prepared<D, M, State: Jointed<D>> + 'static,
    {
        let (mut closed_loop, warnings) = self.closed_loop::<S, D, M>(scene)?;
        if let (Some(settings), Some(plan)) = (&self.replan, closed_loop.plan()) {
            let replanner = Replanner::new(settings, self, &closed_loop, plan)?;
            closed_loop.set_replanning(Box::new(replanner));
        }
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
pub fn check(
    part: Part,
    document: &Table,
    dimension: Option<usize>,
) -> Result<Vec<String>, ScenarioError> {
    if part == Part::Scenario {
        return Scenario::from_document(document)?.prepare().map(|ready| ready.warnings);
    }
    scenario::check(part, document, dimension)?;
    Ok(vec![])
}
