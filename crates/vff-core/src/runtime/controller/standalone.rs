//! A controller that is called from outside, with what is around it and what it remembers.

mod aside;
mod beginning;
mod made;
mod placing;
mod succession;
mod watched;

use super::fading::Fading;
use super::followed::Followed;
use super::{
    AnyController, CycleError, ErasedController, FromNumbers, MissedStart, MotionLimits, Reading,
    Scalars, SuccessionError, Surroundings, Target, TermsView,
};
use crate::control::output::{BeginError, Phase, Supervisor};
use crate::control::{Controller, Gravity, LeftOut, Output, Settings, StablePeriod, Tank};
use crate::math::rotation::NotARotation;
use crate::math::{Pose, Vector};
use crate::robot::{Limits, Model, Robot};
use crate::runtime::obstacles::AnyObstacles;
use crate::runtime::points::{self, PointsError};
use crate::scenario::{self, FromDocument, ScenarioError};
use crate::simulation::{Replanned, System};
use crate::trajectory::{JointSpline, Sample};
use crate::world::space::{self, Points};
use crate::world::{CollisionQuery, Contact, Description, ObstacleGeometry, World};
use aside::Aside;
use nalgebra::DMatrix;
use std::any::Any;
use std::mem::swap;
use std::sync::Arc;
use toml::Table;

/// A controller that is called from outside, and what is around it.
#[derive(Clone)]
pub(super) struct Standalone<S: System<D, M>, const D: usize, const M: usize> {
    arm: Arc<S::Arm>,
    /// Laws with the same number have the same joints and the same `command`: copies of one, and successors that were made for it.
    kin: u64,
    controller: Controller<S::State, D, M>,
    settings: Settings,
    world: World<S::Geometry, D>,
    /// When the motions of the obstacles begin \[s\].
    epoch: f64,
    /// When each obstacle was placed last, from there \[s\]; None if it never was.
    placed: Vec<Option<f64>>,
    /// The law that this one has taken the place of, or room for one.
    fading: Option<Box<Fading<S, D, M>>>,
    /// What stands between the law and the robot, where that is not nothing.
    output: Option<Box<Output>>,
    /// The watch over the loop that it is in.
    supervisor: Option<Box<Supervisor<S::State, D>>>,
    scratch: Vec<f64>,
    /// The reference of its scenario.
    followed: Option<Box<Followed<S, D, M>>>,
    /// What is odd about that.
    warnings: Vec<String>,
    /// How far the arm reaches \[m\].
    reach: f64,
    /// The time of the obstacles at the last state of a loop that is watched over or sets points \[s\].
    reached: Option<f64>,
    /// The instant of the last call \[s\].
    last: Option<f64>,
    /// The period of the loop that it is in \[s\], if that is known.
    period: Option<f64>,
    /// What laws have left out that others took the place of.
    left_out: LeftOut,
    /// Whether the last call came to no good: it was broken off, or its torque is not finite.
    spoilt: bool,
    /// The other controller of a loop that is watched over: what is asked between two cycles is not asked of that of the loop.
    aside: Option<Box<Aside<S, D, M>>>,
    /// Whether that of the loop is the one aside.
    is_aside: bool,
    /// Whether the joints are moved within limits, which makes set points, and whether these are over.
    sets_points: bool,
    are_points_over: bool,
}

impl<S: System<D, M>, const D: usize, const M: usize> Standalone<S, D, M> {
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
        let Self { controller, fading, world, epoch, .. } = self;
        world.update(t - *epoch);
        let elapsed = self.last.replace(t).map_or(0.0, |last| (t - last).max(0.0));
        controller.elapse(elapsed);
        controller.observe(q, dq, world);
        if let Some(fading) = fading {
            fading.observe([q, dq], elapsed, world);
        }
        self.spoilt = false;
        elapsed
    }

    /// The law at the observed state; `later` is the reference in so many seconds.
    fn act(&mut self, reference: &Sample<S::Pose, M>, later: impl Fn(f64) -> Sample<S::Pose, M>) {
        self.spoilt = true;
        let Self { controller, fading, world, .. } = self;
        let is_left = fading.as_ref().is_some_and(|fading| fading.is_left());
        controller.share_cycle(if is_left { 2 } else { 1 });
        controller.look_ahead(world, &later);
        controller.command(reference);
        if let Some(fading) = fading {
            fading.blend_into(controller, world, reference, later);
        }
        let total = controller.torque().total.as_slice();
        self.spoilt = !total.iter().all(|tau| tau.is_finite());
    }

    /// The law that is being left, if there is one.
    fn left(&mut self) -> Option<&mut Controller<S::State, D, M>> {
        let fading = self.fading.as_mut().filter(|fading| fading.is_left());
        fading.map(|fading| &mut fading.controller)
    }

    /// The law hears what became of its last torque, `elapsed` \[s\] ago, where nobody watches over that.
    fn hear_wanted(&mut self, elapsed: f64) {
        if self.sets_points {
            self.left().into_iter().for_each(|left| left.hear_of_time(elapsed));
            return self.controller.hear_of_time(elapsed);
        }
        let Self { controller, fading, output, .. } = self;
        let mut output = output.as_deref_mut();
        if let Some(fading) = fading.as_mut().filter(|fading| fading.is_left()) {
            let total = &controller.torque().total;
            fading.controller.hear_wanted(output.as_deref_mut(), Some(total), elapsed);
        }
        controller.hear_wanted(output, None, elapsed);
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
    /// The law at the observed state, for a target, or for the reference of the scenario, which `goes_on` by that, or to stay
    /// where it is.
    fn act_for(&mut self, target: Option<&Target<'_>>, goes_on: bool) {
        // The arm is not thrown to where that begins: it waits until the arm is there.
        let waits = goes_on && target.is_none() && self.missed().is_some();
        if let Some(target) = target {
            if self.followed.is_some() {
                self.controller.leave_plan();
                self.left().into_iter().for_each(Controller::leave_plan);
            }
            let reference = self.controller.robot().sample(target);
            self.act(&reference, |ahead| reference.carried_on(ahead));
        } else if let Some(mut followed) = self.followed.take_if(|_| !waits) {
            let since = self.world.time();
            let now = since + self.epoch;
            if goes_on {
                followed.go_to(now, self.settings.command.blend_time, &mut self.controller);
            } else {
                followed.move_posture(now, &mut self.controller);
            }
            self.left().into_iter().for_each(|left| followed.move_posture(now, left));
            self.act(&followed.at(now), |ahead| followed.at(now + ahead));
            if goes_on {
                followed.look([now, since], &self.controller, &self.world);
            }
            self.followed = Some(followed);
        } else {
            let here = Sample::at_rest(self.controller.pose());
            self.act(&here, |_| here);
        }
    }

    /// The same asked by somebody, which is no cycle of a loop that is watched over or sets points.
    fn ask_for(&mut self, target: Option<&Target<'_>>) {
        self.step_aside();
        self.act_for(target, !self.is_in_loop());
    }
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

    fn surround(&mut self, obstacles: AnyObstacles) -> Result<(), ScenarioError> {
        self.set_obstacles(obstacles.into_vec().expect("obstacles of the arm's space"))
    }

    fn surroundings(&self) -> Surroundings {
        Surroundings { world: Box::new(self.world.clone()), epoch: self.epoch }
    }

    fn surroundings_of(&self, obstacles: AnyObstacles) -> Result<Surroundings, ScenarioError> {
        let obstacles = obstacles.into_vec().expect("obstacles of the arm's space");
        Ok(Surroundings { world: Box::new(self.world_of(obstacles)?), epoch: self.loop_time(0.0) })
    }

    fn lend(&mut self, other: &mut Surroundings) {
        let world = other.world.downcast_mut().expect("obstacles of the arm's space");
        swap(&mut self.world, world);
        swap(&mut self.epoch, &mut other.epoch);
        self.reserve();
    }

    fn exchange(&mut self, other: &mut Surroundings, epoch: f64) {
        self.be_among(other.world.downcast_mut().expect("obstacles of the arm's space"), epoch);
    }

    fn orientation_of_points(&mut self, j: usize) -> Result<[f64; 4], PointsError> {
        points::orientation_of(points::in_space(&mut self.world)?, j)
    }

    fn swap_points(&mut self, j: usize, points: &mut Points) -> Result<(), PointsError> {
        let n = self.dof();
        // Without a time of its own it is of the last state, whatever was asked since.
        let last = self.reached.filter(|_| self.is_in_loop());
        let since = points.since().map_or(last, |t| Some(self.world_time(t)));
        let world = points::in_space(&mut self.world)?;
        points::check(world, j, points, &self.settings, n)?;
        points.set_since(since);
        world.swap_points(j, points);
        Ok(())
    }

    fn make_room(&mut self, j: usize, most: usize) -> Result<(), PointsError> {
        self.orientation_of_points(j)?;
        if most > space::MAX_POINTS {
            return Err(PointsError::TooMany(most));
        }
        self.fits(self.world.barrier_count().saturating_add(most))?; // more than it will be
        points::in_space(&mut self.world)?.make_room(j, most);
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
        let obstacle = scenario::read_seen_obstacle::<S, D>(document)?;
        let odd = scenario::misread_obstacle::<S, D>(&obstacle, self.reach);
        let links = self.arm.link_names();
        scenario::known_links(&obstacle, &links)?;
        self.sees(&obstacle)?;
        let more = S::Geometry::new(&obstacle).barriers();
        self.fits(self.world.barrier_count().saturating_add(more))?;
        self.world.add(obstacle);
        self.world.know_links(&links);
        self.reserve();
        Ok(odd)
    }

    fn remove(&mut self, j: usize) {
        self.world.remove(j);
        self.placed.remove(j);
    }

    fn place(&mut self, j: usize, t: f64, position: &[f64], velocity: &[f64]) -> f64 {
        self.place_at(j, t, [position, velocity].map(Vector::<D>::from_column_slice))
    }

    fn turn(
        &mut self,
        j: usize,
        t: f64,
        orientation: &[f64],
        rate: &[f64],
    ) -> Result<(), NotARotation> {
        let now = self.world.obstacle(j).turned(orientation, rate)?;
        let t = self.world_time(t);
        self.world.turn(j, t, &now);
        Ok(())
    }

    fn write_distances(&self, j: usize, distance: &mut [f64], mut gradient: Option<&mut [f64]>) {
        let (n, robot) = (self.dof(), self.controller.robot());
        distance.fill(f64::INFINITY);
        if let Some(gradient) = &mut gradient {
            gradient.fill(0.0);
        }
        self.world.for_each_pair(robot.bodies(), |contact: &Contact<D>| {
            let Contact { link, point, normal, .. } = contact;
            if contact.obstacle != j || *link >= n || contact.distance >= distance[*link] {
                return;
            }
            distance[*link] = contact.distance;
            if let Some(gradient) = &mut gradient {
                let row = &mut gradient[link * n..][..n];
                robot.point_jacobian_tr_mul(*link, point, normal, row);
            }
        });
    }

    fn begin_anew(&mut self) {
        self.come_back();
        self.reset();
        self.left_out = LeftOut::default();
        self.world = World::new(vec![]);
        self.reached = None;
        self.placed.clear();
    }

    fn begin(&mut self, period: f64, measured: Option<&[f64]>) -> Result<(), BeginError> {
        self.watch_over(period, measured)
    }

    fn cycle(
        &mut self,
        reading: Option<Reading<'_>>,
        target: Option<&Target<'_>>,
    ) -> Result<Phase, CycleError> {
        self.watched_cycle(reading, target)
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
        self.step_aside();
        let elapsed = self.observe_at(q, dq, self.loop_time(t));
        if self.aside.is_none() {
            self.hear_wanted(elapsed); // a loop of the caller's own
        }
    }

    fn sense(&mut self, tau_ext: &[f64]) {
        assert_eq!(tau_ext.len(), self.dof());
        self.controller.sense(tau_ext);
        self.aside.iter_mut().for_each(|aside| aside.sense(tau_ext));
        self.left().into_iter().for_each(|left| left.sense(tau_ext));
    }

    fn external_torque(&self) -> Option<&[f64]> {
        self.controller.external_torque()
    }

    fn external_wrench(&self) -> Option<&[f64]> {
        self.controller.external_wrench()
    }

    fn touched_link(&self) -> Option<usize> {
        self.controller.touched_link().filter(|link| *link < self.dof())
    }

    fn command(&mut self, target: &Target<'_>) -> Result<&[f64], NotARotation> {
        S::State::check(target)?;
        self.ask_for(Some(target));
        Ok(self.converted())
    }

    fn set_point(
        &mut self,
        [q, dq]: [&[f64]; 2],
        t: f64,
        target: Option<&Target<'_>>,
        out: &mut [f64],
    ) -> Result<(), NotARotation> {
        target.map_or(Ok(()), S::State::check)?;
        self.come_back();
        let elapsed = self.take_in(q, dq, t, self.last.is_none());
        self.hear_wanted(elapsed);
        self.act_for(target, true);
        let Self { controller, scratch, .. } = self;
        controller.robot().accelerate(&controller.torque().total, controller.bias(), scratch, out);
        Ok(())
    }

    fn endless(&self) -> Vec<bool> {
        self.arm.endless()
    }

    fn limits(&self) -> &Limits {
        self.controller.robot().limits()
    }

    fn check(&self, target: &Target<'_>) -> Result<(), NotARotation> {
        S::State::check(target)
    }

    fn has_reference(&self) -> bool {
        self.followed.is_some()
    }

    fn missed_start(&self, q: &[f64]) -> Option<MissedStart> {
        self.far_beyond(q).or_else(|| self.missed_at(q))
    }

    fn begin_at_rest(
        &mut self,
        q: &[f64],
        set_points: Option<(&MotionLimits, f64)>,
    ) -> Result<(), MissedStart> {
        self.far_beyond(q).map_or(Ok(()), Err)?;
        if let Some((limits, period)) = set_points {
            self.period = self.period.and(Some(period)); // time counts where it has counted
            self.move_within(Some(limits));
        }
        self.stand_at(q);
        self.forget();
        if self.sets_points {
            self.aside = Some(Aside::like(&self.controller));
            self.reserve();
        }
        self.followed.iter_mut().for_each(|followed| followed.restart(true));
        Ok(())
    }

    fn path_time(&self) -> Option<f64> {
        let now = self.world.time() + self.epoch;
        self.followed.as_ref().map(|followed| followed.path_time(now))
    }

    fn planned(&self) -> Option<&[f64]> {
        self.followed.as_ref()?.joints().and(self.controller.planned())
    }

    fn planned_acceleration(&self) -> Option<&[f64]> {
        self.followed.as_ref()?.joints().and(self.controller.planned_acceleration())
    }

    fn has_plans(&self) -> bool {
        self.followed.as_ref().is_some_and(|followed| followed.has_plans())
    }

    fn limit_motion(&mut self, limits: Option<&MotionLimits>) {
        self.move_within(limits);
    }

    fn sets_points(&self) -> bool {
        self.sets_points
    }

    fn end_set_points(&mut self) {
        self.are_points_over = self.sets_points;
    }

    fn plan(&self) -> Option<&JointSpline> {
        self.followed.as_ref()?.joints()
    }

    fn replans(&self) -> &[Replanned] {
        self.followed.as_ref().map_or(&[], |followed| followed.searches())
    }

    fn write_reference(&self, out: &mut [f64]) {
        out.copy_from_slice(self.controller.reference().x.as_slice());
    }

    fn follow(&mut self) -> &[f64] {
        self.ask_for(None);
        self.converted()
    }

    fn write_pose(&self, out: &mut [f64]) {
        out.copy_from_slice(self.controller.pose().as_slice());
    }

    fn left_out(&self) -> LeftOut {
        let aside = self.aside.as_ref().filter(|_| self.is_aside);
        self.left_out.with(aside.map_or(&self.controller, |aside| &aside.controller).left_out())
    }

    fn forget(&mut self) {
        self.forget_past();
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

    fn as_any(&self) -> &dyn Any {
        self
    }

    fn as_any_mut(&mut self) -> &mut dyn Any {
        self
    }

    fn successor(&self, like: &AnyController) -> Result<AnyController, SuccessionError> {
        let like = like.as_any().downcast_ref::<Self>().ok_or(SuccessionError::Another)?;
        Ok(AnyController(Box::new(self.made_like(like)?)))
    }

    fn is_succeeding(&self) -> bool {
        self.changes_over()
    }

    fn succeed(
        &mut self,
        next: &mut AnyController,
        duration: f64,
    ) -> Result<bool, SuccessionError> {
        let next = next.as_any_mut().downcast_mut::<Self>().ok_or(SuccessionError::Another)?;
        self.give_way_to(next, duration)
    }

    fn stable_period(&mut self, q: &[f64], t: f64) -> StablePeriod {
        self.stable_period_at(q, t)
    }
}
