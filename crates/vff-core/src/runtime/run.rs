//! A run of any arm with any task, in slices of numbers.

use super::observation;
use super::points::{self, PointsError};
use super::prepare::watch;
use super::wrenches::{ActingPull, ActingWrench};
use crate::control::{Gains, SelfMotionMap, Settings};
use crate::math::{UnitQuaternion, Vector};
use crate::planning::motion::Jointed;
use crate::robot::{Limits, Model};
use crate::scenario::{self, CheckReach, FromDocument, Problem, Scenario, ScenarioError};
use crate::simulation::{
    Acting, DepthPicture, MAX_WRENCHES, Outcome, ReplanSettings, Run, Snapshot,
};
use crate::world::space::{self, Points};
use crate::world::{Rotation, Turning};
use nalgebra::SVector;
use std::any::Any;
use std::fmt::Debug;
use std::ops::{Deref, DerefMut};
use std::time::Duration;
use toml::Table;

/// A run of any arm with any task.
///
/// # Example
/// ```
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 0.2
///     q0 = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
///     arm = { model = "panda" }
///     reference = { kind = "setpoint" }
///     "#,
/// )?;
/// let mut run = scenario.prepare()?.run;
/// while run.step() {}
/// assert!(run.is_over() && run.snapshot().error.iter().all(|e| e.abs() < 1e-3));
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct AnyRun(Box<dyn ErasedRun>);

impl AnyRun {
    /// The same behind a type that does not say which arm and which task.
    pub(super) fn new(run: impl ErasedRun) -> Self {
        Self(Box::new(run))
    }

    /// The run itself, a [`Run`] of some types, if that is what it is.
    pub fn downcast_ref<T: ErasedRun>(&self) -> Option<&T> {
        (&*self.0 as &dyn Any).downcast_ref()
    }

    /// [`Run::outcome`].
    pub fn outcome(self) -> Outcome {
        self.0.outcome()
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
        if self.change_space(&change) {
            return Ok(());
        }
        let problem = Problem::Other("in the plane nobody turns it".into());
        Err(ScenarioError::new(format!("obstacles[{j}]"), problem))
    }

    /// The same for a position \[m\] in space with an orientation. Does not allocate.
    pub fn aim_pose(&mut self, goal: &[f64], orientation: UnitQuaternion, rate: f64) {
        let [w, x, y, z] = orientation.to_array();
        self.aim(&[goal[0], goal[1], goal[2], w, x, y, z], rate);
    }

    /// The number of joints n and the dimension of the space.
    pub fn sizes(&self) -> [usize; 2] {
        let s = self.snapshot();
        [s.q.len(), s.dimension]
    }
}

impl Clone for AnyRun {
    fn clone(&self) -> Self {
        self.copy()
    }
}

impl Deref for AnyRun {
    type Target = dyn ErasedRun;

    fn deref(&self) -> &Self::Target {
        &*self.0
    }
}

impl DerefMut for AnyRun {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut *self.0
    }
}

/// What every [`AnyRun`] can do, whatever its arm and its task.
pub trait ErasedRun: Debug + Send + Any {
    /// Another one in the same state. Allocates.
    fn copy(&self) -> AnyRun;

    /// [`Run::outcome`].
    fn outcome(self: Box<Self>) -> Outcome;

    /// [`Run::run_for`].
    fn run_for(&mut self, budget: Duration) -> bool;

    /// [`Run::step`].
    fn step(&mut self) -> bool;

    /// [`ClosedLoop::drive`](crate::simulation::ClosedLoop::drive).
    fn drive(&mut self) -> &[f64];

    /// [`ClosedLoop::torque_at`](crate::simulation::ClosedLoop::torque_at).
    fn torque_at(&mut self, t: f64, q: &[f64], dq: &[f64]) -> &[f64];

    /// Lets a plant elsewhere say what is felt of the obstacles.
    fn listen(&mut self);

    /// Takes in what that says of the contacts over the plant step that it is about to end: the obstacle of each, and the
    /// force on a link.
    ///
    /// # Panics
    /// If an obstacle or a link does not exist, or a point or force has other coordinates than the arm.
    fn tell(&mut self, told: &[(usize, ActingWrench)]);

    /// [`Run::arrive_at`].
    fn arrive_at(&mut self, q: &[f64], dq: &[f64]) -> bool;

    /// [`Run::is_over`].
    fn is_over(&self) -> bool;

    /// [`ClosedLoop::restart`](crate::simulation::ClosedLoop::restart), without record or metrics.
    fn restart(&mut self);

    /// The present instant.
    fn snapshot(&self) -> Snapshot<'_>;

    /// [`ClosedLoop::left_out`](crate::simulation::ClosedLoop::left_out).
    fn left_out(&self) -> [Option<u64>; 5];

    /// [`ClosedLoop::left_of_reference`](crate::simulation::ClosedLoop::left_of_reference).
    fn left_of_reference(&self) -> [Option<f64>; 2];

    /// Advances the closed loop alone, without record or metrics, under its own torque or under
    /// `external` \[N·m\]. Returns false if the new state is not finite.
    fn advance(&mut self, external: Option<&[f64]>) -> bool;

    /// [`ClosedLoop::plan_beside`](crate::simulation::ClosedLoop::plan_beside).
    fn plan_beside(&mut self);

    /// Has a motion planned from where the arm is to where its reference comes to rest, in a thread of its own, which is followed when
    /// it is found. Without a `[replan]` in `scenario` others follow only where that is blocked.
    ///
    /// # Errors
    /// If the reference never comes to rest, or a joint slides without an end.
    fn plan_now(&mut self, scenario: &Scenario) -> Result<(), ScenarioError>;

    /// What came of the last search for a plan, "searching" before its end; None if there was none.
    fn last_search(&self) -> Option<&'static str>;

    /// Changes the gains, which must be for the same task. Allocates.
    fn configure(&mut self, settings: &Settings, seed: u64);

    /// [`ClosedLoop::pushes`](crate::simulation::ClosedLoop::pushes), as points and forces, one coordinate after the other.
    fn pushes(&mut self) -> [Vec<f64>; 2];

    /// Pushes the arm with the wrench of a document, whose start counts from now.
    ///
    /// # Errors
    /// With the dotted path of the first fault of the document, or if too many push already.
    fn push(&mut self, document: &Table) -> Result<(), ScenarioError>;

    /// Lets somebody pull at a link as a document says, or let go.
    ///
    /// # Errors
    /// With the dotted path of the first fault of the document; then all is as before.
    fn pull(&mut self, document: Option<&Table>) -> Result<(), ScenarioError>;

    /// Lets whoever pulls do so towards another place \[m\]. Does not allocate.
    fn pull_towards(&mut self, anchor: &[f64]);

    /// What somebody pulls with.
    fn pulled(&self) -> Option<ActingPull>;

    /// [`ClosedLoop::make_touchable`](crate::simulation::ClosedLoop::make_touchable).
    fn make_touchable(&mut self);

    /// [`ClosedLoop::pictures`](crate::simulation::ClosedLoop::pictures).
    fn pictures(&self) -> Vec<DepthPicture>;

    /// [`Controller::self_motion_map`](crate::control::Controller::self_motion_map).
    fn self_motion_map(&self) -> Option<SelfMotionMap>;

    /// Every wrench that acts now.
    fn wrenches(&self) -> Vec<ActingWrench>;

    /// Every wrench at another instant `t` \[s\] of an arm elsewhere, at the joint angles `q`.
    fn wrenches_at(&mut self, t: f64, q: &[f64]) -> Vec<ActingWrench>;

    /// The position of obstacle `j` \[m\].
    fn obstacle_position(&self, j: usize) -> Vec<f64>;

    /// Where the obstacles are at time `t` \[m\], one coordinate after the other.
    fn obstacles_at(&self, t: f64) -> Vec<f64>;

    /// Carries obstacle `j` to `goal` \[m\] from now on, with the pole `rate` \[1/s\]. Does not allocate.
    fn carry(&mut self, j: usize, goal: &[f64], rate: f64);

    /// How every obstacle is turned, compared with its description: a matrix (D, D) each, row by row.
    fn turns(&self) -> Vec<f64>;

    /// Adds the obstacle of a document, the last one from now on. Allocates.
    ///
    /// # Errors
    /// With the dotted path of the first fault of the document.
    fn add(&mut self, document: &Table) -> Result<(), ScenarioError>;

    /// The orientation in which the points of obstacle `j` stand.
    ///
    /// # Errors
    /// If it is no cloud.
    fn orientation_of_points(&self, j: usize) -> Result<[f64; 4], PointsError>;

    /// Puts other points in place of those of obstacle `j`, where the controller has these settings.
    ///
    /// # Errors
    /// If it is no cloud, or not the one that they were made for; then nothing has changed.
    fn update_points(
        &mut self,
        j: usize,
        points: &Points,
        settings: &Settings,
    ) -> Result<(), PointsError>;

    /// Takes obstacle `j` away.
    fn remove(&mut self, j: usize);

    /// [`ClosedLoop::aim`](crate::simulation::ClosedLoop::aim). Does not allocate.
    fn aim(&mut self, goal: &[f64], rate: f64);

    /// Moves `goal` \[m\] to the position nearest to it that the end effector can take with the orientation of the
    /// reference. Does not allocate.
    fn make_attainable(&self, goal: &mut [f64]);

    /// What the joints can do.
    fn limits(&self) -> &Limits;

    /// [`Model::slides`].
    fn slides(&self, joint: usize) -> bool;

    /// [`Model::typical_torque`].
    fn typical_torque(&self) -> Vec<f64>;

    /// A distance from the base that the end effector cannot exceed \[m\].
    fn reach(&self) -> f64;

    /// Changes what is around an arm in space; whether it is one.
    fn change_space(&mut self, change: &dyn Fn(&mut space::World)) -> bool;

    /// The true joint velocity \[rad/s\].
    fn velocity(&self) -> &[f64];

    /// [`ClosedLoop::least_clearance`](crate::simulation::ClosedLoop::least_clearance).
    fn least_clearance(&self) -> f64;

    /// [`ClosedLoop::nearest`](crate::simulation::ClosedLoop::nearest).
    fn nearest(&self) -> Option<[usize; 2]>;

    /// [`ClosedLoop::add_in_null_space`](crate::simulation::ClosedLoop::add_in_null_space).
    fn add_in_null_space(&mut self, tau: &mut [f64]);

    /// The error of the task at present \[m\], an angle as its arc at the characteristic length.
    fn task_error(&self) -> f64;

    /// Appends what the controller knows, in the order of [`Task::layout`](super::episode::Task::layout).
    fn observe(&mut self, out: &mut Vec<f64>);
}

/// Why there is no plan to the end of what never comes to rest.
#[inline(never)] // compiled once, as the next one
fn leads_nowhere() -> ScenarioError {
    let problem = "never comes to rest, so that no plan leads there";
    ScenarioError::new("reference", Problem::Other(problem.into()))
}

/// Of a plan that is made because somebody wants it: others follow where that is blocked, not where the arm is stuck.
#[inline(never)]
fn when_wanted() -> ReplanSettings {
    let never = f64::INFINITY;
    ReplanSettings { patience: never, stray: never, ..Default::default() }
}

/// What is around an arm, if that is in space.
fn in_space(world: &dyn Any) -> Result<&space::World, PointsError> {
    world.downcast_ref().ok_or(PointsError::InThePlane)
}

impl<S, const D: usize, const M: usize> ErasedRun for Run<S, D, M>
where
    S: FromDocument<D> + CheckReach<D, M, State: Jointed<D>> + 'static,
    Self: Clone + Send,
{
    fn copy(&self) -> AnyRun {
        AnyRun::new(self.clone())
    }

    fn outcome(self: Box<Self>) -> Outcome {
        (*self).outcome()
    }

    fn run_for(&mut self, budget: Duration) -> bool {
        self.run_for(budget)
    }

    fn step(&mut self) -> bool {
        self.step()
    }

    fn drive(&mut self) -> &[f64] {
        self.closed_loop_mut().drive()
    }

    fn torque_at(&mut self, t: f64, q: &[f64], dq: &[f64]) -> &[f64] {
        self.closed_loop_mut().torque_at(t, q, dq)
    }

    fn listen(&mut self) {
        self.closed_loop_mut().listen();
    }

    fn tell(&mut self, told: &[(usize, ActingWrench)]) {
        let there = told.iter().map(|(obstacle, ActingWrench { link, point, force, torque })| {
            let [point, force] = [point, force].map(|given| Vector::from_column_slice(given));
            (*obstacle, Acting { link: *link, point, force, torque: (*torque).into() })
        });
        self.closed_loop_mut().tell(there);
    }

    fn arrive_at(&mut self, q: &[f64], dq: &[f64]) -> bool {
        self.arrive_at(q, dq)
    }

    fn is_over(&self) -> bool {
        self.is_over()
    }

    fn restart(&mut self) {
        self.closed_loop_mut().restart();
    }

    fn snapshot(&self) -> Snapshot<'_> {
        self.closed_loop().snapshot()
    }

    fn left_out(&self) -> [Option<u64>; 5] {
        self.closed_loop().left_out()
    }

    fn left_of_reference(&self) -> [Option<f64>; 2] {
        self.closed_loop().left_of_reference()
    }

    fn advance(&mut self, external: Option<&[f64]>) -> bool {
        self.closed_loop_mut().advance(external)
    }

    fn plan_beside(&mut self) {
        self.closed_loop_mut().plan_beside();
    }

    fn plan_now(&mut self, scenario: &Scenario) -> Result<(), ScenarioError> {
        let closed_loop = self.closed_loop_mut();
        if closed_loop.reference().end().is_none() {
            return Err(leads_nowhere());
        }
        if !closed_loop.want_plan() {
            watch(closed_loop, scenario, &when_wanted())?;
            closed_loop.plan_beside();
            closed_loop.want_plan();
        }
        Ok(())
    }

    fn last_search(&self) -> Option<&'static str> {
        let last = self.closed_loop().replans().last()?;
        Some(last.status.unwrap_or("searching"))
    }

    fn configure(&mut self, settings: &Settings, seed: u64) {
        let inner = self.closed_loop_mut();
        let gains = Gains::new(settings).of_arm(settings, &**inner.arm()).with_seed(seed);
        inner.set_gains(&gains);
    }

    fn pushes(&mut self) -> [Vec<f64>; 2] {
        let pushes = self.closed_loop_mut().pushes();
        [0, 1].map(|k| pushes.iter().flat_map(|push| push[k].iter().copied()).collect())
    }

    fn push(&mut self, document: &Table) -> Result<(), ScenarioError> {
        let wrench = scenario::read_wrench::<D>(document)?;
        let link = wrench.link.clone();
        self.closed_loop_mut().push(wrench).map_err(|known| match known.is_empty() {
            true => {
                let problem = format!("{MAX_WRENCHES} of them push already, and none is over");
                ScenarioError::new("", Problem::Other(problem))
            }
            false => scenario::no_such_link(&link, known),
        })
    }

    fn pull(&mut self, document: Option<&Table>) -> Result<(), ScenarioError> {
        let pull = document.map(scenario::read_pull::<D>).transpose()?;
        self.closed_loop_mut().pull(pull.as_ref()).map_err(|known| {
            scenario::no_such_link(pull.as_ref().map_or("", |pull| &pull.link), known)
        })
    }

    fn pull_towards(&mut self, anchor: &[f64]) {
        self.closed_loop_mut().pull_towards(Vector::from_column_slice(anchor));
    }

    fn pulled(&self) -> Option<ActingPull> {
        let (wrench, anchor) = self.closed_loop().pulled()?;
        Some(ActingPull { wrench: wrench.into(), anchor: anchor.as_slice().to_vec() })
    }

    fn make_touchable(&mut self) {
        self.closed_loop_mut().make_touchable();
    }

    fn pictures(&self) -> Vec<DepthPicture> {
        self.closed_loop().pictures()
    }

    fn self_motion_map(&self) -> Option<SelfMotionMap> {
        self.closed_loop().self_motion_map()
    }

    fn wrenches(&self) -> Vec<ActingWrench> {
        self.closed_loop().wrenches().into_iter().map(ActingWrench::from).collect()
    }

    fn wrenches_at(&mut self, t: f64, q: &[f64]) -> Vec<ActingWrench> {
        self.closed_loop_mut().wrenches_at(t, q).into_iter().map(ActingWrench::from).collect()
    }

    fn obstacle_position(&self, j: usize) -> Vec<f64> {
        self.closed_loop().world().position(j).as_slice().to_vec()
    }

    fn obstacles_at(&self, t: f64) -> Vec<f64> {
        let world = self.closed_loop().world();
        let places = (0..world.len()).map(|j| world.position_at(j, t));
        places.flat_map(|place| place.as_slice().to_vec()).collect()
    }

    fn carry(&mut self, j: usize, goal: &[f64], rate: f64) {
        let goal = Vector::from_column_slice(goal);
        self.closed_loop_mut().change_world(|world| world.carry(j, goal, rate));
    }

    fn turns(&self) -> Vec<f64> {
        let world = self.closed_loop().world();
        let turns = (0..world.len()).map(|j| {
            let turn = world.turn_at(j, world.time());
            turn.map_or(Rotation::identity(), |turn| turn.rotation)
        });
        turns.flat_map(|turn| turn.transpose().as_slice().to_vec()).collect()
    }

    fn add(&mut self, document: &Table) -> Result<(), ScenarioError> {
        let (obstacle, contact) = scenario::read_felt_obstacle::<S, D>(document)?;
        let closed_loop = self.closed_loop();
        scenario::known_links(&obstacle, &closed_loop.arm().link_names())?;
        scenario::is_seen_ahead(&obstacle, closed_loop.controller().gains().looks_ahead())?;
        self.closed_loop_mut().add_obstacle(&obstacle, contact);
        Ok(())
    }

    fn orientation_of_points(&self, j: usize) -> Result<[f64; 4], PointsError> {
        points::orientation_of(in_space(self.closed_loop().world())?, j)
    }

    fn update_points(
        &mut self,
        j: usize,
        points: &Points,
        settings: &Settings,
    ) -> Result<(), PointsError> {
        points::check(
            in_space(self.closed_loop().world())?,
            j,
            points,
            settings,
            self.closed_loop().arm().dof(),
        )?;
        self.change_space(&|world| _ = world.swap_points(j, &mut points.clone()));
        Ok(())
    }

    fn remove(&mut self, j: usize) {
        self.closed_loop_mut().remove_obstacle(j);
    }

    fn aim(&mut self, goal: &[f64], rate: f64) {
        self.closed_loop_mut().aim(goal, rate);
    }

    fn make_attainable(&self, goal: &mut [f64]) {
        let nearest = self.closed_loop().attainable(&Vector::from_column_slice(goal));
        goal.copy_from_slice(nearest.as_slice());
    }

    fn limits(&self) -> &Limits {
        self.closed_loop().limits()
    }

    fn slides(&self, joint: usize) -> bool {
        self.closed_loop().arm().slides(joint)
    }

    fn typical_torque(&self) -> Vec<f64> {
        self.closed_loop().arm().typical_torque()
    }

    fn reach(&self) -> f64 {
        self.closed_loop().arm().reach()
    }

    fn change_space(&mut self, change: &dyn Fn(&mut space::World)) -> bool {
        let is_there = in_space(self.closed_loop().world()).is_ok();
        if is_there {
            self.closed_loop_mut().change_world(|world| {
                (world as &mut dyn Any).downcast_mut().into_iter().for_each(change);
            });
        }
        is_there
    }

    fn velocity(&self) -> &[f64] {
        self.closed_loop().velocity()
    }

    fn least_clearance(&self) -> f64 {
        self.closed_loop().least_clearance()
    }

    fn nearest(&self) -> Option<[usize; 2]> {
        self.closed_loop().nearest()
    }

    fn add_in_null_space(&mut self, tau: &mut [f64]) {
        self.closed_loop_mut().add_in_null_space(tau);
    }

    fn task_error(&self) -> f64 {
        let inner = self.closed_loop();
        let metric = inner.controller().gains().metric::<D>();
        metric.norm(&SVector::from_column_slice(inner.snapshot().error))
    }

    fn observe(&mut self, out: &mut Vec<f64>) {
        observation::append(self.closed_loop_mut(), out);
    }
}
