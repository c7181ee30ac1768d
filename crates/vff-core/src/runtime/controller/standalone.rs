//! A controller that is called from outside, with what is around it and what it remembers.

use super::{
    AnyController, CycleError, ErasedController, FromNumbers, Reading, Scalars, Surroundings,
    Target, TermsView,
};
use crate::control::output::{BeginError, Phase, Supervisor};
use crate::control::{Controller, Gains, Gravity, Output, Settings, StablePeriod, Tank};
use crate::math::rotation::NotARotation;
use crate::math::{Pose, Vector};
use crate::robot::{Limits, Model, Robot};
use crate::runtime::obstacles::AnyObstacles;
use crate::runtime::points::{self, PointsError};
use crate::scenario::{self, CheckReach, FromDocument, Scenario, ScenarioError, Scene};
use crate::simulation::System;
use crate::trajectory::{Sample, Trajectory};
use crate::world::space::{self, Points};
use crate::world::{CollisionQuery, Solid, World};
use nalgebra::DMatrix;
use std::any::Any;
use std::mem::swap;
use std::sync::Arc;
use toml::Table;

/// A controller that is called from outside, and what is around it.
#[derive(Debug, Clone)]
pub(super) struct Standalone<S: System<D, M>, const D: usize, const M: usize> {
    controller: Controller<S::State, D, M>,
    settings: Settings,
    world: World<S::Solid, D>,
    /// When the motions of the obstacles begin \[s\].
    epoch: f64,
    /// When each obstacle was placed last, from there \[s\]; None if it never was.
    placed: Vec<Option<f64>>,
    /// What stands between the law and the robot, where that is not nothing.
    output: Option<Box<Output>>,
    /// The watch over the loop that it is in.
    supervisor: Option<Box<Supervisor<S::State, D>>>,
    scratch: Vec<f64>,
    /// The reference of its scenario.
    trajectory: Option<Trajectory<S::Pose, M>>,
    /// What is odd about that.
    warnings: Vec<String>,
    /// How far the arm reaches \[m\].
    reach: f64,
    /// The instant of the last call \[s\].
    last: Option<f64>,
    /// Whether the last call came to no good: it was broken off, or its torque is not finite.
    spoilt: bool,
}

impl<S: System<D, M>, const D: usize, const M: usize> Standalone<S, D, M> {
    /// Among no obstacles.
    pub fn new(arm: &Arc<S::Arm>, settings: Settings) -> Self {
        let (robot, gains) = (arm.state(), Gains::new(&settings).of_arm(&settings, &**arm));
        let controller = Controller::new(robot, gains);
        let command = &settings.command;
        let output = command.changes_torque().then(|| Box::new(Output::new(command, arm.dof())));
        let mut this = Self {
            controller,
            world: World::new(vec![]),
            epoch: 0.0,
            placed: vec![],
            output,
            supervisor: None,
            scratch: vec![0.0; arm.dof()],
            trajectory: None,
            warnings: vec![],
            reach: arm.reach(),
            last: None,
            spoilt: false,
            settings,
        };
        this.reserve();
        this
    }

    /// The controller of a scenario.
    pub fn of(scenario: &Scenario, scene: &Scene<S, D>) -> Result<Self, ScenarioError>
    where
        S: CheckReach<D, M>,
    {
        let (arm, trajectory, odd) = scenario.arm_and_reference::<S, D, M>(scene)?;
        let mut this = Self::new(&arm, scenario.controller.clone());
        this.set_obstacles(scene.obstacles.clone())?;
        this.trajectory = Some(trajectory);
        this.warnings =
            odd.into_iter().chain(scenario::misread_scene(scene, arm.reach())).collect();
        Ok(this)
    }

    fn set_obstacles(
        &mut self,
        obstacles: Vec<<S::Solid as Solid<D>>::Obstacle>,
    ) -> Result<(), ScenarioError> {
        let world = World::<S::Solid, D>::new(obstacles);
        self.fits(world.barrier_count())?;
        self.world = world;
        self.placed.clear();
        self.reserve();
        Ok(())
    }

    /// Whether there is room for so many distances of each link.
    fn fits(&self, barriers: usize) -> Result<(), ScenarioError> {
        scenario::validate_size(&self.settings, self.controller.robot().dof(), barriers)
    }

    /// Allocates all that the next torques need among these obstacles.
    fn reserve(&mut self) {
        self.placed.resize(self.world.len(), None);
        self.controller.reserve(&self.world);
    }

    fn reset(&mut self) {
        let (robot, gains) = (self.controller.robot().clone(), self.controller.gains().clone());
        self.controller = Controller::new(robot, gains);
        self.reserve();
        (self.last, self.spoilt) = (None, false);
    }

    /// The time of the loop \[s\] when the clock of its states says `t`: another one where that was set.
    fn loop_time(&self, t: f64) -> f64 {
        t - self.supervisor.as_ref().map_or(0.0, |supervisor| supervisor.clock_ahead())
    }

    /// Takes in a state at a time of the loop, and returns the time since the last one \[s\].
    fn observe_at(&mut self, q: &[f64], dq: &[f64], t: f64) -> f64 {
        if self.spoilt {
            self.reset();
        }
        self.spoilt = true;
        let Self { controller, world, epoch, .. } = self;
        world.update(t - *epoch);
        let elapsed = self.last.replace(t).map_or(0.0, |last| (t - last).max(0.0));
        controller.elapse(elapsed);
        controller.observe(q, dq, world);
        self.spoilt = false;
        elapsed
    }

    /// The law at the observed state; `later` is the reference in so many seconds.
    fn act(&mut self, reference: &Sample<S::Pose, M>, later: impl Fn(f64) -> Sample<S::Pose, M>) {
        self.spoilt = true;
        let Self { controller, world, .. } = self;
        controller.look_ahead(world, later);
        let total = controller.command(reference).total.as_slice();
        self.spoilt = !total.iter().all(|tau| tau.is_finite());
    }

    /// Its torque as the robot wants it.
    fn converted(&mut self) -> &[f64] {
        let Self { controller, output, .. } = self;
        let tau = controller.torque().total.as_slice();
        match output {
            Some(output) => output.convert(controller.robot(), tau),
            None => tau,
        }
    }
}

impl<S, const D: usize, const M: usize> Standalone<S, D, M>
where
    S: System<D, M, State: FromNumbers<D, M, Pose = <S as System<D, M>>::Pose>>,
{
    /// The law at the observed state, for a target, or for the reference of the scenario, or to stay where it is.
    fn act_for(&mut self, target: Option<&Target<'_>>) {
        if let Some(target) = target {
            let reference = self.controller.robot().sample(target);
            self.act(&reference, |ahead| reference.carried_on(ahead));
        } else if let Some(trajectory) = self.trajectory.take() {
            let now = self.world.time() + self.epoch;
            self.act(&trajectory.at(now), |ahead| trajectory.at(now + ahead));
            self.trajectory = Some(trajectory);
        } else {
            let here = Sample::at_rest(self.controller.pose());
            self.act(&here, |_| here);
        }
    }
}

/// What is around an arm, if that is in space.
fn in_space(world: &mut dyn Any) -> Result<&mut space::World, PointsError> {
    world.downcast_mut().ok_or(PointsError::InThePlane)
}

impl<S, const D: usize, const M: usize> ErasedController for Standalone<S, D, M>
where
    S: FromDocument<D>
        + System<D, M, State: FromNumbers<D, M, Pose = <S as System<D, M>>::Pose>>
        + 'static,
    Self: Clone + Send,
{
    fn copy(&self) -> AnyController {
        AnyController(Box::new(self.clone()))
    }

    fn dof(&self) -> usize {
        self.controller.robot().dof()
    }

    fn dimension(&self) -> usize {
        D
    }

    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn widths(&self) -> [usize; 3] {
        S::State::WIDTHS
    }

    fn sampling_bounds(&self, period: f64) -> Vec<String> {
        scenario::sampling_bounds(&self.settings, M, period)
    }

    fn surround(&mut self, obstacles: AnyObstacles) -> Result<(), ScenarioError> {
        self.set_obstacles(obstacles.into_vec().expect("obstacles of the arm's space"))
    }

    fn surroundings(&self) -> Surroundings {
        Surroundings(Box::new(self.world.clone()))
    }

    fn exchange(&mut self, other: &mut Surroundings, epoch: f64) {
        swap(&mut self.world, other.0.downcast_mut().expect("obstacles of the arm's space"));
        self.epoch = self.loop_time(epoch);
        self.placed.clear();
        self.reserve();
    }

    fn orientation_of_points(&mut self, j: usize) -> Result<[f64; 4], PointsError> {
        points::orientation_of(in_space(&mut self.world)?, j)
    }

    fn swap_points(&mut self, j: usize, points: &mut Points) -> Result<(), PointsError> {
        let n = self.dof();
        let world = in_space(&mut self.world)?;
        points::check(world, j, points, &self.settings, n)?;
        world.swap_points(j, points);
        Ok(())
    }

    fn make_room(&mut self, j: usize, most: usize) -> Result<(), PointsError> {
        self.orientation_of_points(j)?;
        if most > space::MAX_POINTS {
            return Err(PointsError::TooMany(most));
        }
        self.fits(self.world.barrier_count().saturating_add(most))?; // more than it will be
        in_space(&mut self.world)?.make_room(j, most);
        self.reserve();
        Ok(())
    }

    fn obstacle_count(&self) -> usize {
        self.world.len()
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn add(&mut self, document: &Table) -> Result<Vec<String>, ScenarioError> {
        let obstacle = scenario::read_obstacle::<S, D>(document)?;
        let odd = scenario::misread_obstacle::<S, D>(&obstacle, self.reach);
        let more = S::Solid::new(&obstacle).barriers();
        self.fits(self.world.barrier_count().saturating_add(more))?;
        self.world.add(obstacle);
        self.reserve();
        Ok(odd)
    }

    fn remove(&mut self, j: usize) {
        self.world.remove(j);
        self.placed.remove(j);
    }

    fn place(&mut self, j: usize, t: f64, position: &[f64], velocity: &[f64]) -> f64 {
        let [position, velocity] = [position, velocity].map(Vector::<D>::from_column_slice);
        let t = self.loop_time(t) - self.epoch;
        let Self { world, placed, settings, .. } = self;
        let Some(speed) = settings.command.obstacle_speed else {
            world.place(j, t, position, velocity);
            return 0.0;
        };
        let here = world.position_at(j, t);
        let (way, since) = (position - here, placed[j].replace(t).map(|last| t - last));
        let distance = way.norm();
        if since.is_none_or(|since| distance <= speed * since) {
            world.place(j, t, position, velocity.cap_magnitude(speed));
            return 0.0;
        }
        world.place(j, t, here, way * (speed / distance));
        distance
    }

    fn begin_anew(&mut self) {
        self.reset();
        self.world = World::new(vec![]);
        self.placed.clear();
    }

    fn begin(&mut self, period: f64, measured: Option<&[f64]>) -> Result<(), BeginError> {
        let robot = self.controller.robot().clone();
        let supervisor = Supervisor::new(&self.settings.command, robot, period, measured)?;
        self.supervisor = Some(Box::new(supervisor));
        self.forget();
        Ok(())
    }

    fn cycle(
        &mut self,
        reading: Option<Reading<'_>>,
        target: Option<&Target<'_>>,
    ) -> Result<Phase, CycleError> {
        target.map_or(Ok(()), S::State::check)?;
        let mut supervisor = self.supervisor.take().ok_or(CycleError::NotBegun)?;
        let admitted = |Reading { t, q, dq }| Some((supervisor.admit(t, q, dq)?, q, dq));
        let news = reading.and_then(admitted);
        if let Some((t, q, dq)) = news {
            self.observe_at(q, dq, t);
            supervisor.report(&mut self.controller);
        }
        let wanted = news.is_some() && supervisor.wants_torque();
        if wanted {
            supervisor.announce(&mut self.controller);
            self.act_for(target);
        }
        let law = &self.controller;
        let phase = match news {
            Some(_) if wanted => supervisor.follow(law.robot(), law.bias(), &law.torque().total),
            Some(_) => supervisor.rest(),
            None => supervisor.miss(),
        };
        self.supervisor = Some(supervisor);
        Ok(phase)
    }

    fn sent(&self) -> Option<&[f64]> {
        self.supervisor.as_ref().map(|supervisor| supervisor.sent())
    }

    fn phase(&self) -> Option<Phase> {
        self.supervisor.as_ref().map(|supervisor| supervisor.phase())
    }

    fn brakes(&self) -> bool {
        self.supervisor.as_ref().is_some_and(|supervisor| supervisor.brakes())
    }

    fn holding_torque(&self, out: &mut [f64]) {
        match self.settings.command.gravity {
            Gravity::Controller => self.controller.robot().gravity_torque(out),
            Gravity::Robot => out.fill(0.0),
        }
    }

    fn stop(&mut self) {
        if let Some(supervisor) = &mut self.supervisor {
            supervisor.stop();
        }
    }

    fn torque(
        &mut self,
        q: &[f64],
        dq: &[f64],
        target: &Target<'_>,
        t: f64,
    ) -> Result<&[f64], NotARotation> {
        S::State::check(target)?;
        self.observe(q, dq, t);
        self.command(target)
    }

    fn observe(&mut self, q: &[f64], dq: &[f64], t: f64) {
        let elapsed = self.observe_at(q, dq, self.loop_time(t));
        // A loop of the caller's own, where none is watched.
        if self.supervisor.is_none() {
            self.controller.hear_itself(elapsed);
        }
    }

    fn sense(&mut self, tau_ext: &[f64]) {
        assert_eq!(tau_ext.len(), self.dof());
        self.controller.sense(tau_ext);
    }

    fn external_torque(&self) -> Option<&[f64]> {
        self.controller.external_torque()
    }

    fn external_wrench(&self) -> Option<&[f64]> {
        self.controller.external_wrench()
    }

    fn command(&mut self, target: &Target<'_>) -> Result<&[f64], NotARotation> {
        S::State::check(target)?;
        self.act_for(Some(target));
        Ok(self.converted())
    }

    fn accelerate(
        &mut self,
        target: Option<&Target<'_>>,
        out: &mut [f64],
    ) -> Result<(), NotARotation> {
        target.map_or(Ok(()), S::State::check)?;
        self.act_for(target);
        let Self { controller, scratch, .. } = self;
        controller.robot().accelerate(&controller.torque().total, controller.bias(), scratch, out);
        Ok(())
    }

    fn limits(&self) -> &Limits {
        self.controller.robot().limits()
    }

    fn check(&self, target: &Target<'_>) -> Result<(), NotARotation> {
        S::State::check(target)
    }

    fn has_reference(&self) -> bool {
        self.trajectory.is_some()
    }

    fn follow(&mut self) -> &[f64] {
        self.act_for(None);
        self.converted()
    }

    fn write_pose(&self, out: &mut [f64]) {
        out.copy_from_slice(self.controller.pose().as_slice());
    }

    fn forget(&mut self) {
        self.controller.reset();
        self.last = None;
    }

    fn terms_view(&self) -> TermsView<'_> {
        let law = &self.controller;
        TermsView {
            tau: &law.torque().total,
            tau_task: &law.torque().task,
            tau_null: &law.torque().null,
            tau_vff: law.forces().torque(),
            force: law.forces().magnitude(),
            clearance: law.forces().clearance(),
            scalars: Scalars {
                slack: law.slack(),
                energy: law.energy().values(),
                power: law.power(&law.torque().total).values(),
                objective_scale: *law.objective_scale(),
                tank: law.tank().map(Tank::level),
                self_clearance: law.forces().self_clearance(),
                manipulability: law.manipulability(),
                singular: law.space().singular,
                null_acceleration: law.null_acceleration(),
            },
        }
    }

    fn null_projector(&self) -> DMatrix<f64> {
        self.controller.null_projector()
    }

    fn stable_period(&mut self, q: &[f64], t: f64) -> StablePeriod {
        if self.spoilt {
            self.reset();
        }
        self.world.update(self.loop_time(t) - self.epoch);
        self.controller.observe(q, &vec![0.0; q.len()], &mut self.world);
        self.controller.stable_period(&mut self.world)
    }
}
