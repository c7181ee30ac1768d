//! The parts strung together: observe, then command.
//!
//! [`ReactiveController`] sees the present alone. [`Controller`] is the same with look-ahead on top of it, if the
//! settings ask for that; the look-ahead runs a reactive controller of its own.

mod reactive;
mod readings;
#[cfg(test)]
mod tests;

pub use reactive::ReactiveController;

use super::avoidance::preview::{Preview, SelfMotionMap};
use super::deadline::{Budget, LeftOut};
use super::{Gains, Law, Output, Torque};
use crate::math::Vector;
use crate::robot::Manipulator;
use crate::trajectory::{JointSpline, Pace, Sample};
use crate::world::CollisionQuery;
use std::ops::Deref;

/// A torque controller for a robot `R` with a task of dimension `M`.
///
/// Call [`observe`](Self::observe) with the state and the surroundings, [`look_ahead`](Self::look_ahead) if the
/// settings ask for look-ahead, then [`command`](Self::command) with the reference. Nothing allocates after
/// construction (`formulation = recursive`). Everything that can be read is that of the [`ReactiveController`]
/// below.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::control::{Controller, Gains, ReactiveController, Settings};
/// use vff_core::robot::{SpatialState, models};
/// use vff_core::trajectory::Sample;
/// use vff_core::world::space::World;
///
/// let arm = Arc::new(models::named("panda").unwrap().build().unwrap());
/// let settings = Settings::default();
/// let gains = Gains::new(&settings).of_arm(&settings, &*arm);
/// let mut controller = Controller::<_, 3, 3>::new(arm.state(), gains); // a task of position
/// let mut world = World::new(vec![]);
/// controller.observe(&[0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], &[0.0; 7], &mut world);
/// let hold = Sample::at_rest(controller.pose());
/// assert_eq!(controller.command(&hold).total.len(), 7);
/// // What sees the present alone is behind it.
/// let present: &ReactiveController<SpatialState, 3, 3> = &controller;
/// assert!(present.error().norm() < 1e-12);
/// ```
///
/// # See also
/// [`AnyController`](crate::runtime::AnyController), where a document says which arm and which task.
#[derive(Debug)]
pub struct Controller<R: Manipulator<D, M>, const D: usize, const M: usize> {
    reactive: ReactiveController<R, D, M>,
    preview: Option<Box<Preview<R, D, M>>>,
    /// How long a cycle may take: that of a simulation, unless somebody says otherwise.
    budget: Budget,
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> Clone for Controller<R, D, M> {
    #[inline(never)] // compiled once, wherever one is copied
    fn clone(&self) -> Self {
        let Self { reactive, preview, budget } = self;
        Self { reactive: reactive.clone(), preview: preview.clone(), budget: budget.clone() }
    }
}

impl<R: Manipulator<D, M>, const D: usize, const M: usize> Deref for Controller<R, D, M> {
    type Target = ReactiveController<R, D, M>;

    fn deref(&self) -> &Self::Target {
        &self.reactive
    }
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> Controller<R, D, M> {
    /// A controller for `robot`, with gains resolved for its number of joints.
    pub fn new(robot: R, gains: Gains<M>) -> Self {
        let given = gains.yielding.preview.as_ref().filter(|_| gains.looks_ahead());
        let preview = given.map(|settings| Box::new(Preview::new(&robot, &gains, settings)));
        let budget = Budget::of_simulation(gains.deadline);
        Self { reactive: ReactiveController::new(robot, gains), preview, budget }
    }

    /// Lets cycles take no longer than `budget` says, from now on.
    pub fn keep_to(&mut self, budget: Budget) {
        self.budget = budget;
    }

    /// Whether cycles have a deadline.
    pub fn is_limited(&self) -> bool {
        self.budget.is_limited()
    }

    /// So many controllers share a cycle from now on, a part each.
    pub fn share_cycle(&mut self, parts: u64) {
        self.budget.share(parts);
    }

    /// What was left out since the beginning: for lack of time, or because of a bound.
    pub fn left_out(&self) -> LeftOut {
        let of_preview = self.preview.as_ref().map(|preview| preview.left_out());
        let late = LeftOut { late: self.budget.late(), ..LeftOut::default() };
        late.with(of_preview.unwrap_or_default()).with(self.reactive.left_out())
    }

    /// What the last search of the self-motion has found; None without one, and while nothing comes near. Allocates.
    pub fn self_motion_map(&self) -> Option<SelfMotionMap> {
        self.preview.as_ref()?.self_motion_map()
    }

    /// How many parts of its task the look-ahead lets go at present, in the `order` of the settings (T193); None without both.
    pub fn released(&self) -> Option<usize> {
        self.preview.as_ref()?.released()
    }

    /// Takes in the state (q, q̇) and what is around: clearances and forces.
    pub fn observe(&mut self, q: &[f64], dq: &[f64], surroundings: &mut impl CollisionQuery<D>) {
        self.budget.begin();
        self.reactive.observe(q, dq, surroundings);
        self.budget.suspend();
    }

    /// Makes room for all contacts with these surroundings, so that the next observation, look-ahead and command among
    /// them do not allocate. What was observed is to be observed again.
    pub fn reserve(&mut self, surroundings: &impl CollisionQuery<D>) {
        let most = surroundings.contact_count().max(surroundings.barrier_count());
        self.reactive.reserve(most);
        if let Some(preview) = &mut self.preview {
            preview.reserve(surroundings.obstacle_count(), most);
        }
    }

    /// [`ReactiveController::followed_error`].
    pub fn followed_error(&self) -> Vector<M> {
        self.reactive.followed_error()
    }

    /// [`ReactiveController::planned`].
    pub fn planned(&self) -> Option<&[f64]> {
        self.reactive.planned()
    }

    /// [`ReactiveController::planned_acceleration`].
    pub fn planned_acceleration(&self) -> Option<&[f64]> {
        self.reactive.planned_acceleration()
    }

    /// [`ReactiveController::move_posture`]; the look-ahead takes the posture for one at rest.
    pub fn move_posture(&mut self, joints: &JointSpline, pace: &Pace) {
        self.reactive.move_posture(joints, pace);
        if let Some(preview) = &mut self.preview {
            preview.rest_at_posture_of(&self.reactive.gains);
        }
    }

    /// [`ReactiveController::reserve_plan`].
    pub fn reserve_plan(&mut self, joints: &JointSpline) {
        self.reactive.reserve_plan(joints);
        if let Some(preview) = &mut self.preview {
            // Room for a posture is had by having one.
            let mut moved = self.reactive.gains.clone();
            moved.move_posture(joints.first());
            preview.rest_at_posture_of(&moved);
            preview.rest_at_posture_of(&self.reactive.gains);
        }
    }

    /// [`ReactiveController::keep_posture_of`].
    pub fn keep_posture_of(&mut self, other: &Self, has_own: bool) {
        self.reactive.keep_posture_of(&other.reactive, has_own);
        if let Some(preview) = &mut self.preview {
            preview.rest_at_posture_of(&self.reactive.gains);
        }
    }

    /// [`ReactiveController::leave_plan`].
    pub fn leave_plan(&mut self) {
        self.reactive.leave_plan();
    }

    /// [`ReactiveController::expect`].
    pub fn expect(&mut self, output: &mut Output, sent: &[f64], period: f64) {
        self.reactive.expect(output, sent, period);
    }

    /// [`ReactiveController::confine`].
    pub fn confine(&mut self, wanted: &[f64], spares_distances: bool) -> Option<&[f64]> {
        self.reactive.confine(wanted, spares_distances)
    }

    /// [`ReactiveController::hear`].
    pub fn hear(&mut self, output: Option<&mut Output>, sent: &[f64], elapsed: Option<f64>) {
        self.reactive.hear(output, sent, elapsed);
    }

    /// [`ReactiveController::sense`].
    pub fn sense(&mut self, measured: &[f64]) {
        self.reactive.sense(measured);
    }

    /// [`ReactiveController::hear_wanted`].
    pub fn hear_wanted(&mut self, output: Option<&mut Output>, law: Option<&[f64]>, elapsed: f64) {
        self.reactive.hear_wanted(output, law, elapsed);
    }

    /// [`ReactiveController::hear_of_time`].
    pub fn hear_of_time(&mut self, elapsed: f64) {
        self.reactive.hear_of_time(elapsed);
    }

    /// [`ReactiveController::believe`].
    pub fn believe(&mut self, other: &Self) {
        self.reactive.believe(&other.reactive);
    }

    /// [`ReactiveController::take_over`].
    pub fn take_over(&mut self, other: &Self) {
        self.reactive.take_over(&other.reactive);
    }

    /// Looks ahead from the observed state, and from what was sent last if [`expect`](Self::expect) said so, if it is time and as far as there is time left in this cycle: `reference(s)` is
    /// that in s seconds.
    pub fn look_ahead(
        &mut self,
        surroundings: &mut impl CollisionQuery<D>,
        reference: impl Fn(f64) -> Sample<R::Pose, M>,
    ) {
        let Self { reactive, preview, budget } = self;
        if let Some(preview) = preview {
            budget.go_on();
            preview.advance(&reactive.present(), surroundings, &reference, budget);
            budget.suspend();
        }
    }

    /// The torque at the observed state for this reference.
    pub fn command(&mut self, reference: &Sample<R::Pose, M>) -> &Torque {
        let Self { reactive, preview, budget } = self;
        budget.reserve();
        reactive.follow(reference);
        if let Some(preview) = preview {
            let Law { bias, torque, .. } = &mut reactive.law;
            preview.act(&reactive.robot, &reactive.space, bias, torque);
        }
        reactive.give_way();
        budget.end();
        &reactive.law.torque
    }

    /// Keeps a `share` of the torque of the last command; the rest is `other` with `more` \[N·m, N\].
    pub fn blend(&mut self, other: &Torque, more: &[f64], share: f64) {
        self.reactive.law.torque.blend(other, more, share);
    }

    /// `tau ← Nᵀ tau` at the observed state, N of the chosen projection (T4).
    pub fn project(&mut self, tau: &mut [f64]) {
        self.reactive.project(tau);
    }

    /// Forgets what it remembers of the past: the tank is as full as at the start, and no candidate is taken.
    pub fn reset(&mut self) {
        self.budget.reset();
        self.reactive.reset();
        if let Some(preview) = &mut self.preview {
            preview.reset();
            preview.rest_at_posture_of(&self.reactive.gains);
        }
    }

    /// Lets `dt` \[s\] pass under the last command: the tank fills or empties, the look-ahead's time goes on.
    pub fn elapse(&mut self, dt: f64) {
        if let Some(preview) = &mut self.preview {
            preview.elapse(dt);
        }
        self.reactive.elapse(dt);
    }
}
