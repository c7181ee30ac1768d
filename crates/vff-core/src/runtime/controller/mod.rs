//! The law in somebody else's loop: any arm with any task, in slices of numbers.

mod errors;
mod fading;
mod followed;
mod standalone;
mod target;
mod terms;

use super::arm::AnyArm;
use super::obstacles::AnyObstacles;
use super::points::PointsError;
use crate::control::observer::Source;
use crate::control::output::{BeginError, Phase};
use crate::control::{LeftOut, MotionLimits, Settings, StablePeriod};
use crate::math::rotation::NotARotation;
use crate::planning::motion::Jointed;
use crate::robot::Limits;
use crate::scenario::{self, AnyScene, CheckReach, Scenario, ScenarioError, Scene, dispatch};
use crate::simulation::{Replanned, System};
use crate::trajectory::JointSpline;
use crate::world::space::Points;
use nalgebra::DMatrix;
use serde::Serialize;
use standalone::Standalone;
use std::any::Any;
use std::fmt::{self, Debug};
use std::ops::{Deref, DerefMut};
use std::sync::Arc;
use toml::Table;

pub use errors::{CycleError, SuccessionError};
pub use followed::MissedStart;
pub use target::{FromNumbers, Target};
pub use terms::{Scalars, Terms, TermsView};

/// A state of the arm as the robot reports it. Its numbers may be anything.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading<'a> {
    /// When it was measured \[s\], by any clock: one that is not later than the last one is no news.
    pub t: f64,
    /// \[rad, m\], (n).
    pub q: &'a [f64],
    /// \[rad/s, m/s\], (n).
    pub dq: &'a [f64],
}

/// What is around an arm, ready to be asked: the obstacles of one controller, for another one with the same arm.
#[derive(Debug)]
pub struct Surroundings {
    world: Box<dyn Any + Send>,
    /// When its motions begin, by the clock of the loop \[s\].
    epoch: f64,
}

/// A controller of any arm with any task in a loop that is not ours.
///
/// # Example
/// ```
/// use vff_core::runtime::{AnyArm, AnyController, Target};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let arm = AnyArm::read(&toml::toml! { model = "panda" })?;
/// let mut controller = AnyController::new(&arm, &toml::toml! { stiffness = 100.0 damping = 20.0 })?;
/// controller.add(&toml::toml! { shape = { kind = "sphere", radius = 0.1 } position = [0.4, 0.5, 0.4] })?;
///
/// let (q, dq) = ([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0; 7]);
/// let target = Target { x: &[0.5, 0.0, 0.5], dx: &[0.0; 3], ddx: &[0.0; 3] };
/// let torque = controller.torque(&q, &dq, &target, 0.0)?;
/// assert!(torque.len() == 7 && torque.iter().all(|tau| tau.is_finite()));
/// # Ok(())
/// # }
/// ```
///
/// # See also
/// [`ErasedController`] for what it can do; [`Controller`](crate::control::Controller) where the types are known;
/// [`VirtualArm`](super::VirtualArm) for a robot that takes positions or velocities.
#[derive(Debug)]
pub struct AnyController(Box<dyn ErasedController>);

/// One of this system.
fn make<S, const D: usize, const M: usize>(
    arm: &Arc<S::Arm>,
    settings: Settings,
) -> Result<AnyController, ScenarioError>
where
    Standalone<S, D, M>: ErasedController + 'static,
    S: System<D, M>,
{
    Ok(AnyController(Box::new(Standalone::<S, D, M>::new(arm, settings))))
}

/// That of a scenario of this system.
fn make_for<S: CheckReach<D, M>, const D: usize, const M: usize>(
    scenario: &Scenario,
    scene: &Scene<S, D>,
) -> Result<AnyController, ScenarioError>
where
    Standalone<S, D, M>: ErasedController + 'static,
{
    Ok(AnyController(Box::new(Standalone::<S, D, M>::of(scenario, scene)?)))
}

/// The same, which makes other plans.
fn make_replanning<S: CheckReach<D, M> + 'static, const D: usize, const M: usize>(
    scenario: &Scenario,
    scene: &Scene<S, D>,
) -> Result<AnyController, ScenarioError>
where
    Standalone<S, D, M>: ErasedController + 'static,
    S::State: Jointed<D>,
{
    Ok(AnyController(Box::new(Standalone::<S, D, M>::replanning(scenario, scene)?)))
}

impl AnyController {
    /// A controller for `arm` with the settings of a `[controller]` table, among no obstacles.
    ///
    /// # Errors
    /// With the name of the first setting that is wrong or does not suit the arm.
    pub fn new(arm: &AnyArm, settings: &Table) -> Result<Self, ScenarioError> {
        let (name, sizes) = (arm.name(), [arm.dof(), arm.dimension()]);
        let settings = scenario::read_settings(settings, arm.limits(), name, sizes)?;
        dispatch!(arm, settings.task, AnyArm(arm) => make(arm, settings))
    }

    /// The controller of a scenario, among its obstacles, with its reference to [`follow`](ErasedController::follow).
    ///
    /// # Errors
    /// As [`Scenario::prepare`]: with the dotted path of what is wrong, or of no use to the arm.
    pub fn from_scenario(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let task = scenario.controller.task;
        dispatch!(&scenario.scene, task, AnyScene(scene) => make_for(scenario, scene))
    }

    /// The same; where the reference is a plan and the scenario has a table `replan`, other plans are searched in threads of their own,
    /// for which no torque waits, but which are begun from the loop, and that allocates.
    ///
    /// # Errors
    /// As [`from_scenario`](Self::from_scenario), or if the arm cannot be planned for.
    pub fn replanning(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let task = scenario.controller.task;
        dispatch!(&scenario.scene, task, AnyScene(scene) => make_replanning(scenario, scene))
    }

    /// The parts of the last torque. Allocates.
    pub fn terms(&self) -> Terms {
        self.terms_view().to_terms(self.null_projector())
    }

    /// A few words on it.
    pub fn summary(&self) -> String {
        let (n, settings) = (self.dof(), self.settings());
        let (task, avoidance) = (Written(settings.task), Written(settings.avoidance));
        let joints = if n == 1 { "joint" } else { "joints" };
        format!("{n} {joints}, {task} task, avoidance {avoidance}")
    }
}

/// A name as documents have it.
struct Written<T>(T);

impl<T: Serialize> fmt::Display for Written<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.serialize(f)
    }
}

impl Clone for AnyController {
    fn clone(&self) -> Self {
        self.copy()
    }
}

impl Deref for AnyController {
    type Target = dyn ErasedController;

    fn deref(&self) -> &Self::Target {
        &*self.0
    }
}

impl DerefMut for AnyController {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut *self.0
    }
}

/// What every [`AnyController`] can do, whatever its arm and its task.
///
/// A loop that is watched over begins once and then asks what is to be sent, cycle by cycle:
///
/// ```
/// use vff_core::control::output::Phase;
/// use vff_core::runtime::{AnyArm, AnyController, Reading};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let arm = AnyArm::read(&toml::toml! { model = "panda" })?;
/// let mut controller = AnyController::new(&arm, &toml::Table::new())?;
/// controller.begin(0.001, None)?;
/// let (q, dq) = ([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0; 7]);
/// let phase = controller.cycle(Some(Reading { t: 0.0, q: &q, dq: &dq }), None)?;
/// assert_eq!(phase, Phase::Starting);
/// assert!(controller.sent().is_some_and(|tau| tau.len() == 7));
/// let phase = controller.cycle(None, None)?; // no state in this cycle
/// assert_eq!(phase, Phase::Holding);
/// # Ok(())
/// # }
/// ```
pub trait ErasedController: Debug + Send {
    /// Another one in the same state. Allocates.
    fn copy(&self) -> AnyController;

    /// The number of joints n.
    fn dof(&self) -> usize;

    /// The dimension of the space that the arm moves in.
    fn dimension(&self) -> usize;

    /// The settings in use.
    fn settings(&self) -> &Settings;

    /// How many numbers a pose, a velocity and an acceleration of the reference have.
    fn widths(&self) -> [usize; 3];

    /// What a torque held over `period` \[s\] makes unstable, in sentences: see [`sampling_bounds`](crate::scenario::sampling_bounds).
    fn sampling_bounds(&self, period: f64) -> Vec<String> {
        scenario::sampling_bounds(self.settings(), period)
    }

    /// Puts it among these obstacles, from now on.
    ///
    /// # Errors
    /// If the controller has no room for so many.
    ///
    /// # Panics
    /// If the obstacles are not those of the arm's space.
    fn surround(&mut self, obstacles: AnyObstacles) -> Result<(), ScenarioError>;

    /// What it is among, as a copy.
    fn surroundings(&self) -> Surroundings;

    /// What it would be among with these obstacles around. Allocates.
    ///
    /// # Errors
    /// As [`surround`](Self::surround), which panics as this does.
    fn surroundings_of(&self, obstacles: AnyObstacles) -> Result<Surroundings, ScenarioError>;

    /// Exchanges what it is among for what is [asked](Self::surroundings_of) about, and back. Allocates.
    ///
    /// # Panics
    /// If they are not those of the arm's space.
    fn lend(&mut self, other: &mut Surroundings);

    /// Exchanges what it is among for the [`surroundings`](Self::surroundings) of another controller with the same arm and
    /// settings, whose motions begin at time `epoch` \[s\]. Allocates where there is more in them than ever before.
    ///
    /// # Panics
    /// If they are not those of the arm's space.
    fn exchange(&mut self, other: &mut Surroundings, epoch: f64);

    /// The orientation in which the points of obstacle `j` stand.
    ///
    /// # Errors
    /// If it is no cloud.
    fn orientation_of_points(&mut self, j: usize) -> Result<[f64; 4], PointsError>;

    /// Exchanges the points of obstacle `j` for others, which are then the old ones. The next torque allocates where there
    /// are more of them than ever before.
    ///
    /// # Errors
    /// If it is no cloud, or not the one that the others were made for; then nothing has changed.
    fn swap_points(&mut self, j: usize, points: &mut Points) -> Result<(), PointsError>;

    /// Makes room for clouds of up to `most` points in obstacle `j`, so that no later torque allocates for them.
    ///
    /// # Errors
    /// If it is no cloud, or for so many there is no room; then nothing has changed.
    fn make_room(&mut self, j: usize, most: usize) -> Result<(), PointsError>;

    /// How many obstacles there are.
    fn obstacle_count(&self) -> usize;

    /// What is odd about the scenario that it was made of, in sentences that begin with a dotted path: numbers that were probably
    /// meant in other units or in another order, and a reference out of reach that is followed nevertheless.
    fn warnings(&self) -> &[String];

    /// Adds the obstacle of a document, the last one from now on. Allocates, so that no later torque does for it. Returns what is
    /// odd about it, as [`warnings`](Self::warnings), with paths in the document.
    ///
    /// # Errors
    /// With the dotted path of its first fault, or if the controller has no room for it; then nothing has changed.
    fn add(&mut self, document: &Table) -> Result<Vec<String>, ScenarioError>;

    /// Takes obstacle `j` away; those behind it move up.
    fn remove(&mut self, j: usize);

    /// From now on, obstacle `j` is at `position` \[m\] at time `t` \[s\] and goes on at `velocity` \[m/s\], a number per
    /// axis each. It turns as before. With `command.obstacle_speed`, one that cannot have come there since it was placed last is
    /// doubted: it goes there at that speed, until it is placed again. Returns how far away that is \[m\]; 0 if it is believed.
    fn place(&mut self, j: usize, t: f64, position: &[f64], velocity: &[f64]) -> f64;

    /// From now on, obstacle `j` has this orientation at time `t` \[s\] and turns on at this rate: an angle \[rad\] and its rate in the
    /// plane, a quaternion `[w, x, y, z]` and an angular velocity in world axes \[rad/s\] in space. It moves as before. Allocates if it has
    /// not turned before.
    ///
    /// # Errors
    /// If the quaternion is none; then nothing has changed.
    ///
    /// # Panics
    /// If there are not as many numbers.
    fn turn(
        &mut self,
        j: usize,
        t: f64,
        orientation: &[f64],
        rate: &[f64],
    ) -> Result<(), NotARotation>;

    /// Writes the distance \[m\] of every link from obstacle `j` at the observed state, (n), infinite of one without a shape, and, if it is
    /// asked for, how it changes with the joints, (n, n), row by row.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    fn write_distances(&self, j: usize, distance: &mut [f64], gradient: Option<&mut [f64]>);

    /// Forgets the past and the obstacles.
    fn begin_anew(&mut self);

    /// Begins a loop of `period` \[s\], in which [`cycle`](Self::cycle) says what is to be sent to the robot. Its torque is
    /// blended in over `command.blend_time`, from the `measured` one \[N·m, N\], (n), which contains gravity only if what is sent does,
    /// or from what holds the arm still; one that is not finite, beyond the torque limits, or farther from that than half of them, is
    /// not believed. Until the first state it is held; where none is known, nothing is sent. Allocates, so that no cycle does.
    ///
    /// # Errors
    /// If the period is none, or too long for `command.stop_damping`; then nothing has changed.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    fn begin(&mut self, period: f64, measured: Option<&[f64]>) -> Result<(), BeginError>;

    /// One cycle of the loop: what the state and the reference come to. Without a target, the reference is that of the scenario, or
    /// the observed pose at rest. [`sent`](Self::sent) is to be sent in any case.
    ///
    /// Does not allocate, and whatever the robot reports is allowed: a state that is missing, old, not finite, or cannot
    /// follow the one before, is a [`Phase`]. What is sent is finite, within the torque limits and the rate of `command`, and
    /// does not depend on other calls with other states in between.
    ///
    /// # Errors
    /// If there is no loop, or the target is no reference; then nothing has changed. If the loop would begin with an arm far beyond
    /// its stops or, without a target, not where the reference of the scenario begins; then nothing is to be sent.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    fn cycle(
        &mut self,
        reading: Option<Reading<'_>>,
        target: Option<&Target<'_>>,
    ) -> Result<Phase, CycleError>;

    /// What is to be sent to the robot in this cycle \[N·m, N\]; None without a loop.
    fn sent(&self) -> Option<&[f64]>;

    /// What the last cycle came to; None without a loop.
    fn phase(&self) -> Option<Phase>;

    /// Whether the loop damps the arm because a joint is, or was, faster than twice its limit.
    fn brakes(&self) -> bool;

    /// What holds the arm still at the observed state \[N·m, N\], as it would be sent.
    ///
    /// # Panics
    /// If the slice has the wrong length.
    fn holding_torque(&self, out: &mut [f64]);

    /// Ends the loop safely: from the next cycle on the arm is damped until it stands. Nothing without a loop.
    fn stop(&mut self);

    /// The joint torque at (q, q̇) and time `t` \[s\] \[N·m, N\], as `command` asks for it, but for its rate: that is limited
    /// by [`cycle`](Self::cycle), which knows the period. An energy tank fills or empties by the time
    /// since the last call. After a torque that is not finite the controller is as new.
    ///
    /// # Errors
    /// With a sentence, if the target is no reference.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    fn torque(
        &mut self,
        q: &[f64],
        dq: &[f64],
        target: &Target<'_>,
        t: f64,
    ) -> Result<&[f64], NotARotation>;

    /// The first half of [`torque`](Self::torque): takes in the state.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    fn observe(&mut self, q: &[f64], dq: &[f64], t: f64);

    /// Takes in what the robot measures of the torque from outside \[N·m, N\], for the states that are observed from now on, with
    /// `observer.source = "measured"`; numbers that are not finite change nothing.
    ///
    /// # Panics
    /// If the slice has the wrong length.
    fn sense(&mut self, tau_ext: &[f64]);

    /// Whether it wants to know that.
    fn senses(&self) -> bool {
        let observer = self.settings().observer.as_ref();
        observer.is_some_and(|observer| observer.source == Source::Measured)
    }

    /// Whether its torque depends on what has been before, and so on the time from state to state.
    fn remembers(&self) -> bool {
        self.settings().observer.is_some() || self.settings().tank.is_some()
    }

    /// The torque from outside, as estimated at the observed state \[N·m, N\], (n); None without an observer.
    fn external_torque(&self) -> Option<&[f64]>;

    /// The wrench at the end effector that this is \[N, N·m\], (m); None without an observer.
    fn external_wrench(&self) -> Option<&[f64]>;

    /// The link on which a contact is felt at the observed state, or one beyond it, counted from 0; None while none is, and
    /// without `observer.detection`.
    fn touched_link(&self) -> Option<usize>;

    /// The second half of [`torque`](Self::torque): the torque at the observed state.
    ///
    /// # Errors
    /// If the target is no reference.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    fn command(&mut self, target: &Target<'_>) -> Result<&[f64], NotARotation>;

    /// A cycle of set points: what the torque of the law at the state \[q, q̇\] of time `t` \[s\] would do to the joints of the model
    /// \[rad/s², m/s²\], (n), for this target, or for the reference of the scenario, which goes on by that, or to stay where it is.
    /// `command.tip_speed` holds.
    ///
    /// # Errors
    /// If the target is no reference.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    fn set_point(
        &mut self,
        state: [&[f64]; 2],
        t: f64,
        target: Option<&Target<'_>>,
        out: &mut [f64],
    ) -> Result<(), NotARotation>;

    /// What the joints of the arm can do.
    fn limits(&self) -> &Limits;
    /// Whether each of these joints turns without an end, (n). Allocates.
    fn endless(&self) -> Vec<bool>;

    /// Whether the numbers, which are finite, are a reference.
    ///
    /// # Errors
    /// If they are not.
    fn check(&self, target: &Target<'_>) -> Result<(), NotARotation>;

    /// Whether it has a reference of its own, that of its scenario.
    fn has_reference(&self) -> bool;

    /// Why no loop may begin with the arm at `q` \[rad, m\], (n), on this reference; None if it may. Allocates.
    fn missed_start(&self, q: &[f64]) -> Option<MissedStart>;

    /// Forgets the past of an arm that is at rest at `q` \[rad, m\], (n). The reference of its scenario begins with the first cycle. If
    /// set points begin, these are the [limits](Self::limit_motion) of the joints and the period \[s\].
    ///
    /// # Errors
    /// If a joint is far beyond its stops; then nothing has changed.
    fn begin_at_rest(
        &mut self,
        q: &[f64],
        set_points: Option<(&MotionLimits, f64)>,
    ) -> Result<(), MissedStart>;

    /// Where the clock of this reference is \[s\]: in a loop that is watched over it begins when the torque has been blended in, and
    /// with `governor` it waits. None without such a reference.
    fn path_time(&self) -> Option<f64>;

    /// Where the plan that this reference is has the joints \[rad, m\], (n); None as long as it is none.
    fn planned(&self) -> Option<&[f64]>;

    /// How that accelerates them \[rad/s², m/s²\], (n).
    fn planned_acceleration(&self) -> Option<&[f64]>;

    /// The plan that this reference is, if it is one.
    fn plan(&self) -> Option<&JointSpline>;
    /// Whether it may become one, too.
    fn has_plans(&self) -> bool;

    /// The joints are moved within these limits from now on, or, without any, by the torque: barriers and other plans reckon with that
    /// (T201). Forgets the past, and ends a loop of torques that is watched over.
    fn limit_motion(&mut self, limits: Option<&MotionLimits>);

    /// Whether they are, which makes set points.
    fn sets_points(&self) -> bool;

    /// The set points are over: [`forget`](Self::forget) leaves them, and the joints are moved by the torque then.
    fn end_set_points(&mut self);

    /// The searches for another plan so far.
    fn replans(&self) -> &[Replanned];

    /// The reference of the last torque; it has the first of the [`widths`](Self::widths).
    fn write_reference(&self, out: &mut [f64]);

    /// The torque at the observed state for that reference, or for the observed pose at rest if it has none.
    fn follow(&mut self) -> &[f64];

    /// The observed pose of the end effector; it has the first of the [`widths`](Self::widths).
    fn write_pose(&self, out: &mut [f64]);

    /// What was left out since the loop began: for lack of time before its deadline, or because of a bound.
    fn left_out(&self) -> LeftOut;

    /// Forgets the past, not the obstacles. Does not allocate, but where it leaves a loop that is over, or set points.
    fn forget(&mut self);

    /// What it is, for those who know.
    fn as_any(&self) -> &dyn Any;

    /// What it is, for those who know and change it.
    fn as_any_mut(&mut self) -> &mut dyn Any;

    /// A law `like` another one, with its arm and settings, that can [`succeed`](Self::succeed) this one among these obstacles.
    /// Allocates all that this needs.
    ///
    /// # Errors
    /// If it is for another kind of arm or task, or for other drives.
    fn successor(&self, like: &AnyController) -> Result<AnyController, SuccessionError>;

    /// Lets `next`, a [`successor`](Self::successor) of this law, take its place within `duration` \[s\], in which the torque goes over
    /// from the one to the other without a step; `next` has then what is to be freed. Obstacles, reference and loop stay, and what
    /// an observer and a tank know; a look-ahead begins anew. Whether both have the same tip: if not, references that are given mean another one from now on, and
    /// where a plan is followed it allocates.
    ///
    /// # Errors
    /// If it is no successor of this law, or the last one has not taken over yet, or is blended in; then nothing has changed.
    fn succeed(&mut self, next: &mut AnyController, duration: f64)
    -> Result<bool, SuccessionError>;

    /// Whether a succession is under way, or a law is blended in: another law waits for that.
    fn is_succeeding(&self) -> bool;

    /// The parts of the last torque, borrowed.
    fn terms_view(&self) -> TermsView<'_>;

    /// The null-space projector at the observed state, (n, n). Allocates.
    fn null_projector(&self) -> DMatrix<f64>;

    /// How long a torque may be held at q and time `t` \[s\], at rest, before the null space oscillates (T34). Allocates.
    fn stable_period(&mut self, q: &[f64], t: f64) -> StablePeriod;
}
