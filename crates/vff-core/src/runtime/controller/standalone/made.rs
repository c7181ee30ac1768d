//! How a controller is made, of settings or of a scenario, and what is around it.

use super::super::followed::Followed;
use super::Standalone;
use crate::control::{Budget, Controller, Gains, LeftOut, MotionLimits, Output, Settings};
use crate::planning::motion::Jointed;
use crate::planning::replanning::Replanner;
use crate::robot::{Manipulator, Model, Robot};
use crate::scenario::{self, CheckReach, Scenario, ScenarioError, Scene};
use crate::simulation::{System, hide_unseen};
use crate::world::{CollisionQuery, ObstacleGeometry, World};
use std::fmt;
use std::mem::swap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// How many controllers have been made of settings.
static KIN: AtomicU64 = AtomicU64::new(USED + 1);
/// The number of a law that has taken the place of another one, and has what is left of that.
pub(super) const USED: u64 = 0;

impl<S: System<D, M>, const D: usize, const M: usize> Standalone<S, D, M> {
    /// Among no obstacles.
    pub fn new(arm: &Arc<S::Arm>, settings: Settings) -> Self {
        let (robot, gains) = (arm.state(), Gains::new(&settings).of_arm(&settings, &**arm));
        let controller = Controller::new(robot, gains);
        let command = &settings.command;
        let output = command.changes_torque().then(|| Box::new(Output::new(command, arm.dof())));
        let mut this = Self {
            arm: Arc::clone(arm),
            kin: KIN.fetch_add(1, Ordering::Relaxed),
            controller,
            world: World::new(vec![]),
            epoch: 0.0,
            placed: vec![],
            fading: None,
            output,
            supervisor: None,
            scratch: vec![0.0; arm.dof()],
            followed: None,
            warnings: vec![],
            reach: arm.reach(),
            reached: None,
            last: None,
            period: None,
            left_out: LeftOut::default(),
            spoilt: false,
            aside: None,
            is_aside: false,
            sets_points: false,
            are_points_over: false,
            settings,
        };
        this.keep_time();
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
        hide_unseen(&mut this.world, &scenario.contacts);
        let mut start = arm.state();
        start.update(&scenario.q0, &vec![0.0; arm.dof()]);
        this.followed = Some(Box::new(Followed::new(trajectory, start.pose())));
        this.reserve();
        this.warnings =
            odd.into_iter().chain(scenario::misread_scene(scene, arm.reach())).collect();
        if scenario.perception.is_some() {
            let told = "perception: is of simulations; this law knows the obstacles of the scenario, until it is told of others";
            this.warnings.push(told.into());
        }
        Ok(this)
    }

    /// The same, which plans in another thread where the reference leads nowhere, if the scenario says so.
    pub fn replanning(scenario: &Scenario, scene: &Scene<S, D>) -> Result<Self, ScenarioError>
    where
        S: CheckReach<D, M> + 'static,
        S::State: Jointed<D>,
    {
        let mut this = Self::of(scenario, scene)?;
        let Self { followed, world, .. } = &mut this;
        if let (Some(settings), Some(followed)) = (&scenario.replan, followed) {
            let arm = Arc::new(S::arm(&scene.arm)?);
            let reference = followed.trajectory();
            let replanner =
                Replanner::<S, D, M>::new(settings, scenario, (&arm, world), reference)?;
            followed.watch(Box::new(replanner));
        }
        Ok(this)
    }

    /// From now on the joints are moved within these limits, or, without any, by the torque. Forgets the past.
    #[inline(never)]
    pub(super) fn move_within(&mut self, limits: Option<&MotionLimits>) {
        self.come_back();
        self.end_watch();
        (self.sets_points, self.are_points_over) = (limits.is_some(), false);
        self.placed.fill(None); // on a clock that may be another one
        // A plan that is followed was made within them, and what stands around is counted in it.
        let mut moved = limits.cloned();
        if let Some(moved) = &mut moved {
            // What moves the joints may be able to more than the arm is to do.
            let both = moved.speed.iter_mut().zip(&self.arm.limits().velocity);
            both.for_each(|(speed, of_arm)| *speed = speed.min(*of_arm));
        }
        self.reset_with(self.controller.gains().clone().moved_within(moved));
        if let Some(followed) = &mut self.followed {
            followed.limit(limits);
        }
    }

    /// Nobody watches over a loop of torques any more.
    #[inline(never)]
    pub(super) fn end_watch(&mut self) {
        (self.supervisor, self.aside) = (None, None);
    }

    /// Makes it as new, among the same obstacles.
    pub(super) fn reset(&mut self) {
        self.reset_with(self.controller.gains().clone());
    }

    /// The same with other gains.
    fn reset_with(&mut self, gains: Gains<M>) {
        self.controller = Controller::new(self.controller.robot().clone(), gains);
        self.keep_time();
        self.end_fading();
        self.reserve();
        (self.last, self.spoilt) = (None, false);
    }

    /// Lets the cycles of the law end in time.
    pub(super) fn keep_time(&mut self) {
        let aside = self.aside.as_mut().map(|aside| &mut aside.controller);
        for controller in std::iter::once(&mut self.controller).chain(aside) {
            controller.keep_to(Budget::of_loop(self.settings.deadline, self.period));
        }
    }

    /// No law is being left any more.
    pub(super) fn end_fading(&mut self) {
        if let Some(fading) = &mut self.fading {
            fading.end();
        }
    }

    pub(super) fn set_obstacles(
        &mut self,
        obstacles: Vec<<S::Geometry as ObstacleGeometry<D>>::Obstacle>,
    ) -> Result<(), ScenarioError> {
        let mut world = self.world_of(obstacles)?;
        self.be_among(&mut world, 0.0);
        Ok(())
    }

    /// Exchanges what is around for what begins to move when the clock of the states says `epoch` \[s\].
    #[inline(never)]
    pub(super) fn be_among(&mut self, world: &mut World<S::Geometry, D>, epoch: f64) {
        let now = self.world.time() + self.epoch;
        swap(&mut self.world, world);
        self.epoch = self.loop_time(epoch);
        self.world.update((now - self.epoch).max(0.0)); // what points have no time of is of now
        self.reached = None;
        self.placed.clear();
        self.reserve();
    }

    /// What is around with these obstacles.
    #[inline(never)]
    pub(super) fn world_of(
        &self,
        obstacles: Vec<<S::Geometry as ObstacleGeometry<D>>::Obstacle>,
    ) -> Result<World<S::Geometry, D>, ScenarioError> {
        let links = self.arm.link_names();
        for (j, obstacle) in obstacles.iter().enumerate() {
            scenario::known_links(obstacle, &links)
                .and_then(|()| self.sees(obstacle))
                .map_err(|error| error.inside(&format!("obstacles[{j}]")))?;
        }
        let mut world = World::<S::Geometry, D>::new(obstacles);
        world.know_links(&links);
        self.fits(world.barrier_count())?;
        Ok(world)
    }

    /// Whether the law sees an obstacle, if it is a possible future.
    pub(super) fn sees(
        &self,
        obstacle: &<S::Geometry as ObstacleGeometry<D>>::Obstacle,
    ) -> Result<(), ScenarioError> {
        scenario::is_seen_ahead(obstacle, self.settings.looks_ahead())
    }

    /// Whether there is room for so many distances of each link.
    pub(super) fn fits(&self, barriers: usize) -> Result<(), ScenarioError> {
        scenario::validate_size(&self.settings, self.controller.robot().dof(), barriers)
    }

    /// Allocates all that the next torques need among these obstacles.
    pub(super) fn reserve(&mut self) {
        self.placed.resize(self.world.len().max(self.placed.len()), None);
        let Self { controller, aside, fading, followed, world, .. } = self;
        let (other, left) = match aside.as_deref_mut() {
            Some(aside) => (Some(&mut aside.controller), aside.fading.as_mut()),
            None => (None, None),
        };
        for fading in fading.iter_mut().chain(left) {
            fading.controller.reserve(world);
        }
        for controller in std::iter::once(controller).chain(other) {
            controller.reserve(world);
            if let Some(followed) = followed {
                followed.reserve(controller);
            }
        }
    }
}

/// Briefly: everything in it, for each space and task, would be a part of every program.
impl<S: System<D, M>, const D: usize, const M: usize> fmt::Debug for Standalone<S, D, M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let joints = self.scratch.len();
        let mut told = f.debug_struct("Controller");
        told.field("joints", &joints).field("dimension", &D).field("last", &self.last);
        told.finish_non_exhaustive()
    }
}
