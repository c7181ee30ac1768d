//! The law in somebody else's loop: any arm with any task, in slices of numbers.

use super::arm::AnyArm;
use super::obstacles::AnyObstacles;
use super::points::{self, PointsError};
use crate::control::energy::{ENERGIES, PORTS};
use crate::control::output::{BeginError, Phase, Supervisor};
use crate::control::{
    Avoidance, Controller, Gains, Gravity, ObjectiveScale, Output, Settings, StablePeriod, Tank,
    TaskKind,
};
use crate::math::rotation::{NotARotation, UnitQuaternion};
use crate::math::{Pointing, Pose, SpatialPose, Vector};
use crate::robot::{Limits, Manipulator, Model, PlanarState, Robot, SpatialState};
use crate::scenario::{self, AnyScene, Prepared, Scenario, ScenarioError, Scene};
use crate::simulation::{Plane, Space, System};
use crate::trajectory::{Sample, Trajectory};
use crate::world::space::{self, Points};
use crate::world::{CollisionQuery, Solid, World, plane};
use nalgebra::DMatrix;
use std::mem::swap;
use std::sync::Arc;
use toml::Table;

/// A reference of the end effector in numbers. How many each has is said by [`AnyController::widths`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target<'a> {
    /// The pose, position \[m\] before orientation.
    pub x: &'a [f64],
    /// Its velocity \[m/s, rad/s\].
    pub dx: &'a [f64],
    /// Its acceleration \[m/s², rad/s²\].
    pub ddx: &'a [f64],
}

/// A robot that is told in numbers where its end effector has to be.
pub trait Commanded<const D: usize, const M: usize>: Manipulator<D, M> {
    /// How many numbers a pose, a velocity and an acceleration have.
    const WIDTHS: [usize; 3];

    /// Whether the numbers, which are finite, are a reference.
    ///
    /// # Errors
    /// If they are not.
    fn check(target: &Target<'_>) -> Result<(), NotARotation>;
    /// What the numbers mean for the task of this robot at its present state.
    fn sample(&self, target: &Target<'_>) -> Sample<Self::Pose, M>;
}

/// Positions and planar poses are vectors, and so are their rates.
impl<const M: usize> Commanded<2, M> for PlanarState
where
    Self: Manipulator<2, M, Pose: From<Vector<M>>>,
{
    const WIDTHS: [usize; 3] = [M; 3];

    fn check(_: &Target<'_>) -> Result<(), NotARotation> {
        Ok(())
    }

    fn sample(&self, target: &Target<'_>) -> Sample<Self::Pose, M> {
        let [x, dx, ddx] = [target.x, target.dx, target.ddx].map(Vector::<M>::from_column_slice);
        Sample { x: x.into(), dx, ddx }
    }
}

/// A position in space is a vector.
impl Commanded<3, 3> for SpatialState {
    const WIDTHS: [usize; 3] = [3; 3];

    fn check(_: &Target<'_>) -> Result<(), NotARotation> {
        Ok(())
    }

    fn sample(&self, target: &Target<'_>) -> Sample<Vector<3>, 3> {
        let [x, dx, ddx] = [target.x, target.dx, target.ddx].map(Vector::<3>::from_column_slice);
        Sample { x, dx, ddx }
    }
}

/// Position and direction are given as a pose, and their rates as those of a pose.
impl Commanded<3, 5> for SpatialState {
    const WIDTHS: [usize; 3] = <Self as Commanded<3, 6>>::WIDTHS;

    fn check(target: &Target<'_>) -> Result<(), NotARotation> {
        orientation(target).map(drop)
    }

    fn sample(&self, target: &Target<'_>) -> Sample<Pointing, 5> {
        let Sample { x, dx, ddx } = Commanded::<3, 6>::sample(self, target);
        Sample::<Pointing, 5>::in_world_axes(x, &dx, &ddx)
    }
}

/// A pose is a position and a quaternion \[w, x, y, z\]; rates are linear, then angular, in world axes.
impl Commanded<3, 6> for SpatialState {
    const WIDTHS: [usize; 3] = [7, 6, 6];

    fn check(target: &Target<'_>) -> Result<(), NotARotation> {
        orientation(target).map(drop)
    }

    fn sample(&self, target: &Target<'_>) -> Sample<SpatialPose, 6> {
        let [dx, ddx] = [target.dx, target.ddx].map(Vector::<6>::from_column_slice);
        let position = Vector::<3>::from_column_slice(&target.x[..3]);
        let orientation = orientation(target).unwrap_or_default();
        Sample { x: SpatialPose::new(position, orientation), dx, ddx }
    }
}

/// The orientation of a pose that is given as seven numbers.
fn orientation(target: &Target<'_>) -> Result<UnitQuaternion, NotARotation> {
    UnitQuaternion::new([target.x[3], target.x[4], target.x[5], target.x[6]])
}

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

/// Why a cycle is none.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CycleError {
    /// See [`AnyController::begin`].
    #[error("the loop has not begun")]
    NotBegun,
    /// The target is no reference.
    #[error(transparent)]
    Target(#[from] NotARotation),
}

/// What is around an arm, ready to be asked.
#[derive(Debug, Clone)]
pub enum Surroundings {
    /// In the plane.
    Plane(plane::World),
    /// In space.
    Space(space::World),
}

/// The parts of the last torque, as they are shown to people.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TermsView<'a> {
    /// Joint torque, (n).
    pub tau: &'a [f64],
    /// What serves the task, and what makes it give way, (n).
    pub tau_task: &'a [f64],
    /// What acts in the null space, (n).
    pub tau_null: &'a [f64],
    /// Repulsion before its projection, (n).
    pub tau_vff: &'a [f64],
    /// Magnitude of the repulsion on each link \[N\], (n).
    pub force: &'a [f64],
    /// Signed distance of each link from the nearest obstacle \[m\], (n).
    pub clearance: &'a [f64],
    /// What is a number.
    pub scalars: Scalars,
}

/// Those parts that are numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scalars {
    /// By how much barriers are violated at most \[m/s²\]; None without barriers.
    pub slack: Option<f64>,
    /// [`ENERGIES`] \[J\].
    pub energy: [f64; ENERGIES.len()],
    /// [`PORTS`] \[W\].
    pub power: [f64; PORTS.len()],
    /// What the limits let through of each objective.
    pub objective_scale: ObjectiveScale,
    /// Energy in the tank \[J\]; None without one.
    pub tank: Option<f64>,
    /// Signed distance of the nearest two bodies that must not touch \[m\].
    pub self_clearance: f64,
    /// √det(J Jᵀ).
    pub manipulability: f64,
    /// Whether the task force is damped because of a singularity.
    pub singular: bool,
    /// ‖J M⁻¹ τ_null‖ \[m/s²\].
    pub null_acceleration: f64,
}

/// The same to be kept, with the projector.
#[derive(Debug, Clone, PartialEq)]
pub struct Terms {
    /// As in [`TermsView`].
    pub tau: Vec<f64>,
    /// As in [`TermsView`].
    pub tau_task: Vec<f64>,
    /// As in [`TermsView`].
    pub tau_null: Vec<f64>,
    /// As in [`TermsView`].
    pub tau_vff: Vec<f64>,
    /// As in [`TermsView`].
    pub force: Vec<f64>,
    /// As in [`TermsView`].
    pub clearance: Vec<f64>,
    /// As in [`TermsView`].
    pub scalars: Scalars,
    /// The null-space projector, (n, n).
    pub projector: DMatrix<f64>,
}

impl TermsView<'_> {
    fn to_terms(self, projector: DMatrix<f64>) -> Terms {
        Terms {
            tau: self.tau.to_vec(),
            tau_task: self.tau_task.to_vec(),
            tau_null: self.tau_null.to_vec(),
            tau_vff: self.tau_vff.to_vec(),
            force: self.force.to_vec(),
            clearance: self.clearance.to_vec(),
            scalars: self.scalars,
            projector,
        }
    }
}

/// A controller of any arm with any task in a loop that is not ours: the list of all that there are.
#[derive(Debug, Clone)]
pub enum AnyController {
    /// In the plane, position.
    PlanarPosition(Box<Standalone<Plane, 2, 2>>),
    /// In the plane, position and orientation.
    PlanarPose(Box<Standalone<Plane, 2, 3>>),
    /// In space, position.
    SpatialPosition(Box<Standalone<Space, 3, 3>>),
    /// In space, position and direction of the tool.
    SpatialPointing(Box<Standalone<Space, 3, 5>>),
    /// In space, position and orientation.
    SpatialPose(Box<Standalone<Space, 3, 6>>),
}

/// Does the same with whatever controller it is.
macro_rules! either {
    ($controller:expr, $inner:ident => $body:expr) => {
        match $controller {
            AnyController::PlanarPosition($inner) => $body,
            AnyController::PlanarPose($inner) => $body,
            AnyController::SpatialPosition($inner) => $body,
            AnyController::SpatialPointing($inner) => $body,
            AnyController::SpatialPose($inner) => $body,
        }
    };
}

/// The same with whatever controller of an arm in space it is; in the plane there are no clouds.
macro_rules! in_space {
    ($controller:expr, $inner:ident => $body:expr) => {
        match $controller {
            AnyController::PlanarPosition(_) | AnyController::PlanarPose(_) => {
                Err(PointsError::InThePlane)
            }
            AnyController::SpatialPosition($inner) => $body,
            AnyController::SpatialPointing($inner) => $body,
            AnyController::SpatialPose($inner) => $body,
        }
    };
}

impl AnyController {
    /// A controller for `arm` with the settings of a `[controller]` table, among no obstacles.
    ///
    /// # Errors
    /// With the name of the first setting that is wrong or does not suit the arm.
    pub fn new(arm: &AnyArm, settings: &Table) -> Result<Self, ScenarioError> {
        match arm {
            AnyArm::Planar(arm) => {
                let settings =
                    scenario::read_settings(settings, arm.limits(), None, [arm.dof(), 2])?;
                Ok(match settings.task {
                    TaskKind::Position => {
                        Self::PlanarPosition(Box::new(Standalone::new(arm, settings)))
                    }
                    TaskKind::Pose => Self::PlanarPose(Box::new(Standalone::new(arm, settings))),
                    TaskKind::Pointing => unreachable!("validated: no task of the plane"),
                })
            }
            AnyArm::Spatial(arm) => {
                let (limits, name) = (Model::limits(&**arm), arm.description().name.as_deref());
                let settings = scenario::read_settings(settings, limits, name, [arm.dof(), 3])?;
                Ok(match settings.task {
                    TaskKind::Position => {
                        Self::SpatialPosition(Box::new(Standalone::new(arm, settings)))
                    }
                    TaskKind::Pointing => {
                        Self::SpatialPointing(Box::new(Standalone::new(arm, settings)))
                    }
                    TaskKind::Pose => Self::SpatialPose(Box::new(Standalone::new(arm, settings))),
                })
            }
        }
    }

    /// The controller of a scenario, among its obstacles, with its reference to [`follow`](Self::follow).
    ///
    /// # Errors
    /// As [`Scenario::prepare`]: with the dotted path of what is wrong, or of no use to the arm.
    pub fn from_scenario(scenario: &Scenario) -> Result<Self, ScenarioError> {
        use TaskKind::{Pointing, Pose, Position};
        Ok(match (&scenario.scene, scenario.controller.task) {
            (AnyScene::Plane(scene), Position) => {
                Self::PlanarPosition(Standalone::of(scenario, scene)?)
            }
            (AnyScene::Plane(scene), Pose) => Self::PlanarPose(Standalone::of(scenario, scene)?),
            (AnyScene::Space(scene), Position) => {
                Self::SpatialPosition(Standalone::of(scenario, scene)?)
            }
            (AnyScene::Space(scene), Pointing) => {
                Self::SpatialPointing(Standalone::of(scenario, scene)?)
            }
            (AnyScene::Space(scene), Pose) => Self::SpatialPose(Standalone::of(scenario, scene)?),
            (AnyScene::Plane(_), Pointing) => unreachable!("validated: no task of the plane"),
        })
    }

    /// The number of joints n.
    pub fn dof(&self) -> usize {
        either!(self, inner => inner.controller.robot().dof())
    }

    /// The dimension of the space that the arm moves in.
    pub fn dimension(&self) -> usize {
        match self {
            Self::PlanarPosition(_) | Self::PlanarPose(_) => 2,
            Self::SpatialPosition(_) | Self::SpatialPointing(_) | Self::SpatialPose(_) => 3,
        }
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        either!(self, inner => &inner.settings)
    }

    /// How many numbers a pose, a velocity and an acceleration of the reference have.
    pub fn widths(&self) -> [usize; 3] {
        fn of<S: System<D, M, State: Commanded<D, M>>, const D: usize, const M: usize>(
            _: &Standalone<S, D, M>,
        ) -> [usize; 3] {
            S::State::WIDTHS
        }
        either!(self, inner => of(inner))
    }

    /// What a torque held over `period` \[s\] makes unstable, in sentences: see [`scenario::sampling_bounds`].
    pub fn sampling_bounds(&self, period: f64) -> Vec<String> {
        fn of<S: System<D, M>, const D: usize, const M: usize>(
            inner: &Standalone<S, D, M>,
            period: f64,
        ) -> Vec<String> {
            scenario::sampling_bounds(&inner.settings, M, period)
        }
        either!(self, inner => of(inner, period))
    }

    /// Puts it among these obstacles, from now on.
    ///
    /// # Errors
    /// If the controller has no room for so many.
    ///
    /// # Panics
    /// If the obstacles are not those of the arm's space.
    pub fn surround(&mut self, obstacles: AnyObstacles) -> Result<(), ScenarioError> {
        match (self, obstacles) {
            (Self::PlanarPosition(inner), AnyObstacles::Plane(given)) => inner.surround(given),
            (Self::PlanarPose(inner), AnyObstacles::Plane(given)) => inner.surround(given),
            (Self::SpatialPosition(inner), AnyObstacles::Space(given)) => inner.surround(given),
            (Self::SpatialPointing(inner), AnyObstacles::Space(given)) => inner.surround(given),
            (Self::SpatialPose(inner), AnyObstacles::Space(given)) => inner.surround(given),
            _ => panic!("obstacles of another space"),
        }
    }

    /// What it is among, as a copy.
    pub fn surroundings(&self) -> Surroundings {
        match self {
            Self::PlanarPosition(inner) => Surroundings::Plane(inner.world.clone()),
            Self::PlanarPose(inner) => Surroundings::Plane(inner.world.clone()),
            Self::SpatialPosition(inner) => Surroundings::Space(inner.world.clone()),
            Self::SpatialPointing(inner) => Surroundings::Space(inner.world.clone()),
            Self::SpatialPose(inner) => Surroundings::Space(inner.world.clone()),
        }
    }

    /// Exchanges what it is among for the [`surroundings`](Self::surroundings) of another controller with the same arm and
    /// settings, whose motions begin at time `epoch` \[s\]. Allocates where there is more in them than ever before.
    ///
    /// # Panics
    /// If they are not those of the arm's space.
    pub fn exchange(&mut self, other: &mut Surroundings, epoch: f64) {
        match (self, other) {
            (Self::PlanarPosition(inner), Surroundings::Plane(world)) => {
                inner.exchange(world, epoch);
            }
            (Self::PlanarPose(inner), Surroundings::Plane(world)) => inner.exchange(world, epoch),
            (Self::SpatialPosition(inner), Surroundings::Space(world)) => {
                inner.exchange(world, epoch);
            }
            (Self::SpatialPointing(inner), Surroundings::Space(world)) => {
                inner.exchange(world, epoch);
            }
            (Self::SpatialPose(inner), Surroundings::Space(world)) => inner.exchange(world, epoch),
            _ => panic!("obstacles of another space"),
        }
    }

    /// What is around an arm in space.
    fn space(&mut self) -> Result<&mut space::World, PointsError> {
        in_space!(self, inner => Ok(&mut inner.world))
    }

    /// The orientation in which the points of obstacle `j` stand.
    ///
    /// # Errors
    /// If it is no cloud.
    pub fn orientation_of_points(&mut self, j: usize) -> Result<[f64; 4], PointsError> {
        points::orientation_of(self.space()?, j)
    }

    /// Exchanges the points of obstacle `j` for others, which are then the old ones. The next torque allocates where there
    /// are more of them than ever before.
    ///
    /// # Errors
    /// If it is no cloud, or not the one that the others were made for; then nothing has changed.
    pub fn swap_points(&mut self, j: usize, points: &mut Points) -> Result<(), PointsError> {
        in_space!(self, inner => inner.swap_points(j, points))
    }

    /// Makes room for clouds of up to `most` points in obstacle `j`, so that no later torque allocates for them.
    ///
    /// # Errors
    /// If it is no cloud, or for so many there is no room; then nothing has changed.
    pub fn make_room(&mut self, j: usize, most: usize) -> Result<(), PointsError> {
        in_space!(self, inner => inner.make_room(j, most))
    }

    /// How many obstacles there are.
    pub fn obstacle_count(&self) -> usize {
        either!(self, inner => inner.world.len())
    }

    /// Adds the obstacle of a document, the last one from now on. Allocates, so that no later torque does for it.
    ///
    /// # Errors
    /// With the dotted path of its first fault, or if the controller has no room for it; then nothing has changed.
    pub fn add(&mut self, document: &Table) -> Result<(), ScenarioError> {
        either!(self, inner => inner.add(document))
    }

    /// Takes obstacle `j` away; those behind it move up.
    pub fn remove(&mut self, j: usize) {
        either!(self, inner => {
            inner.world.remove(j);
            inner.placed.remove(j);
        });
    }

    /// From now on, obstacle `j` is at `position` \[m\] at time `t` \[s\] and goes on at `velocity` \[m/s\], a number per
    /// axis each. It turns as before. With `command.obstacle_speed`, one that cannot have come there since it was placed last is
    /// doubted: it goes there at that speed, until it is placed again. Returns how far away that is \[m\]; 0 if it is believed.
    pub fn place(&mut self, j: usize, t: f64, position: &[f64], velocity: &[f64]) -> f64 {
        either!(self, inner => {
            let [position, velocity] = [position, velocity].map(Vector::from_column_slice);
            inner.place(j, t, position, velocity)
        })
    }

    /// Forgets the past and the obstacles.
    pub fn begin_anew(&mut self) {
        either!(self, inner => {
            inner.reset();
            inner.world = World::new(vec![]);
            inner.placed.clear();
        });
    }

    /// Begins a loop of `period` \[s\], in which [`cycle`](Self::cycle) says what is to be sent to the robot. Its torque is
    /// blended in over `command.start`, from the `measured` one \[N·m, N\], (n), which contains gravity only if what is sent does,
    /// or from what holds the arm still; one that is not finite, beyond the torque limits, or farther from that than half of them, is
    /// not believed. Until the first state it is held; where none is known, nothing is sent. Allocates, so that no cycle does.
    ///
    /// # Errors
    /// If the period is none, or too long for `command.stop_damping`; then nothing has changed.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn begin(&mut self, period: f64, measured: Option<&[f64]>) -> Result<(), BeginError> {
        either!(self, inner => inner.begin(period, measured))
    }

    /// One cycle of the loop: what the state and the reference come to. Without a target, the reference is that of the scenario, or
    /// the observed pose at rest. [`sent`](Self::sent) is to be sent in any case.
    ///
    /// Does not allocate, and whatever the robot reports is allowed: a state that is missing, old, not finite, or cannot
    /// follow the one before, is a [`Phase`]. What is sent is finite, within the torque limits and the rate of `command`, and
    /// does not depend on other calls with other states in between.
    ///
    /// # Errors
    /// If there is no loop, or the target is no reference; then nothing has changed.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn cycle(
        &mut self,
        reading: Option<Reading<'_>>,
        target: Option<&Target<'_>>,
    ) -> Result<Phase, CycleError> {
        either!(self, inner => inner.cycle(reading, target))
    }

    /// What is to be sent to the robot in this cycle \[N·m, N\]; None without a loop.
    pub fn sent(&self) -> Option<&[f64]> {
        either!(self, inner => inner.supervisor.as_ref().map(|supervisor| supervisor.sent()))
    }

    /// What the last cycle came to; None without a loop.
    pub fn phase(&self) -> Option<Phase> {
        either!(self, inner => inner.supervisor.as_ref().map(|supervisor| supervisor.phase()))
    }

    /// Whether the loop damps the arm because a joint is, or was, faster than twice its limit.
    pub fn brakes(&self) -> bool {
        either!(self, inner => inner.supervisor.as_ref().is_some_and(|supervisor| supervisor.brakes()))
    }

    /// What holds the arm still at the observed state \[N·m, N\], as it would be sent.
    ///
    /// # Panics
    /// If the slice has the wrong length.
    pub fn holding_torque(&self, out: &mut [f64]) {
        match self.settings().command.gravity {
            Gravity::Controller => {
                either!(self, inner => inner.controller.robot().gravity_torque(out));
            }
            Gravity::Robot => out.fill(0.0),
        }
    }

    /// Ends the loop safely: from the next cycle on the arm is damped until it stands. Nothing without a loop.
    pub fn stop(&mut self) {
        either!(self, inner => if let Some(supervisor) = &mut inner.supervisor {
            supervisor.stop();
        });
    }

    /// The joint torque at (q, q̇) and time `t` \[s\] \[N·m, N\], as `command` asks for it, but for its rate: that is limited
    /// by [`cycle`](Self::cycle), which knows the period. An energy tank fills or empties by the time
    /// since the last call. After a torque that is not finite the controller is as new.
    ///
    /// # Errors
    /// With a sentence, if the target is no reference.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn torque(
        &mut self,
        q: &[f64],
        dq: &[f64],
        target: &Target<'_>,
        t: f64,
    ) -> Result<&[f64], NotARotation> {
        either!(self, inner => inner.torque(q, dq, target, t))
    }

    /// The first half of [`torque`](Self::torque): takes in the state.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn observe(&mut self, q: &[f64], dq: &[f64], t: f64) {
        either!(self, inner => inner.observe(q, dq, inner.loop_time(t)));
    }

    /// The second half of [`torque`](Self::torque): the torque at the observed state.
    ///
    /// # Errors
    /// If the target is no reference.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn command(&mut self, target: &Target<'_>) -> Result<&[f64], NotARotation> {
        either!(self, inner => inner.command(target))
    }

    /// What the torque of the law would do to the joints of the model at the observed state \[rad/s², m/s²\], (n): for this target, or
    /// for the reference of the scenario, or to stay where it is. `command.tip_speed` holds.
    ///
    /// # Errors
    /// If the target is no reference.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn accelerate(
        &mut self,
        target: Option<&Target<'_>>,
        out: &mut [f64],
    ) -> Result<(), NotARotation> {
        either!(self, inner => inner.accelerate(target, out))
    }

    /// What the joints of the arm can do.
    pub fn limits(&self) -> &Limits {
        either!(self, inner => inner.controller.robot().limits())
    }

    /// Whether the numbers, which are finite, are a reference.
    ///
    /// # Errors
    /// If they are not.
    pub fn check(&self, target: &Target<'_>) -> Result<(), NotARotation> {
        fn of<S: System<D, M, State: Commanded<D, M>>, const D: usize, const M: usize>(
            _: &Standalone<S, D, M>,
            target: &Target<'_>,
        ) -> Result<(), NotARotation> {
            S::State::check(target)
        }
        either!(self, inner => of(inner, target))
    }

    /// Whether it has a reference of its own, that of its scenario.
    pub fn has_reference(&self) -> bool {
        either!(self, inner => inner.trajectory.is_some())
    }

    /// The torque at the observed state for that reference, or for the observed pose at rest if it has none.
    pub fn follow(&mut self) -> &[f64] {
        either!(self, inner => inner.follow())
    }

    /// The observed pose of the end effector; it has the first of the [`widths`](Self::widths).
    pub fn write_pose(&self, out: &mut [f64]) {
        either!(self, inner => out.copy_from_slice(inner.controller.pose().as_slice()));
    }

    /// Forgets the past, not the obstacles. Does not allocate.
    pub fn forget(&mut self) {
        either!(self, inner => {
            inner.controller.reset();
            inner.last = None;
        });
    }

    /// The parts of the last torque. Allocates.
    pub fn terms(&self) -> Terms {
        either!(self, inner => inner.terms().to_terms(inner.controller.null_projector()))
    }

    /// The parts of the last torque, borrowed.
    pub fn terms_view(&self) -> TermsView<'_> {
        either!(self, inner => inner.terms())
    }

    /// The null-space projector at the observed state, (n, n). Allocates.
    pub fn null_projector(&self) -> DMatrix<f64> {
        either!(self, inner => inner.controller.null_projector())
    }

    /// How long a torque may be held at q and time `t` \[s\], at rest, before the null space oscillates (T34).
    /// Allocates.
    pub fn stable_period(&mut self, q: &[f64], t: f64) -> StablePeriod {
        either!(self, inner => inner.stable_period(q, t))
    }

    /// A few words on it.
    pub fn summary(&self) -> String {
        let (n, settings) = (self.dof(), self.settings());
        let task = match settings.task {
            TaskKind::Position => "position",
            TaskKind::Pose => "pose",
            TaskKind::Pointing => "pointing",
        };
        let avoidance = match settings.avoidance {
            Avoidance::NullSpace => "null_space",
            Avoidance::Relaxed => "relaxed",
            Avoidance::Priority => "priority",
            Avoidance::Cbf => "cbf",
        };
        let joints = if n == 1 { "joint" } else { "joints" };
        format!("{n} {joints}, {task} task, avoidance {avoidance}")
    }
}

/// A controller that is called from outside, and what is around it.
#[derive(Debug, Clone)]
pub struct Standalone<S: System<D, M>, const D: usize, const M: usize> {
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
    /// The instant of the last call \[s\].
    last: Option<f64>,
    /// Whether the last call came to no good: it was broken off, or its torque is not finite.
    spoilt: bool,
}

impl<S: System<D, M>, const D: usize, const M: usize> Standalone<S, D, M> {
    fn new(arm: &Arc<S::Arm>, settings: Settings) -> Self {
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
            last: None,
            spoilt: false,
            settings,
        };
        this.reserve();
        this
    }

    /// The controller of a scenario.
    fn of(scenario: &Scenario, scene: &Scene<S, D>) -> Result<Box<Self>, ScenarioError>
    where
        S: Prepared<D, M>,
    {
        let (arm, trajectory, _) = scenario.arm_and_reference::<S, D, M>(scene)?;
        let mut this = Self::new(&arm, scenario.controller.clone());
        this.surround(scene.obstacles.clone())?;
        this.trajectory = Some(trajectory);
        Ok(Box::new(this))
    }

    fn surround(
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

    fn add(&mut self, document: &Table) -> Result<(), ScenarioError>
    where
        S: scenario::Described<D>,
    {
        let obstacle = scenario::read_obstacle::<S, D>(document)?;
        let more = S::Solid::new(&obstacle).barriers();
        self.fits(self.world.barrier_count().saturating_add(more))?;
        self.world.add(obstacle);
        self.reserve();
        Ok(())
    }

    fn place(&mut self, j: usize, t: f64, position: Vector<D>, velocity: Vector<D>) -> f64 {
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

    fn exchange(&mut self, world: &mut World<S::Solid, D>, epoch: f64) {
        swap(&mut self.world, world);
        self.epoch = self.loop_time(epoch);
        self.placed.clear();
        self.reserve();
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

    fn torque(
        &mut self,
        q: &[f64],
        dq: &[f64],
        target: &Target<'_>,
        t: f64,
    ) -> Result<&[f64], NotARotation>
    where
        S::State: Commanded<D, M, Pose = S::Pose>,
    {
        S::State::check(target)?;
        self.observe(q, dq, self.loop_time(t));
        self.command(target)
    }

    /// The time of the loop \[s\] when the clock of its states says `t`: another one where that was set.
    fn loop_time(&self, t: f64) -> f64 {
        t - self.supervisor.as_ref().map_or(0.0, |supervisor| supervisor.clock_ahead())
    }

    fn observe(&mut self, q: &[f64], dq: &[f64], t: f64) {
        if self.spoilt {
            self.reset();
        }
        self.spoilt = true;
        let Self { controller, world, epoch, .. } = self;
        world.update(t - *epoch);
        controller.elapse(self.last.replace(t).map_or(0.0, |last| (t - last).max(0.0)));
        controller.observe(q, dq, world);
        self.spoilt = false;
    }

    fn command(&mut self, target: &Target<'_>) -> Result<&[f64], NotARotation>
    where
        S::State: Commanded<D, M, Pose = S::Pose>,
    {
        S::State::check(target)?;
        self.act_for(Some(target));
        Ok(self.converted())
    }

    fn follow(&mut self) -> &[f64]
    where
        S::State: Commanded<D, M, Pose = S::Pose>,
    {
        self.act_for(None);
        self.converted()
    }

    /// The law at the observed state, for a target, or for the reference of the scenario, or to stay where it is.
    fn act_for(&mut self, target: Option<&Target<'_>>)
    where
        S::State: Commanded<D, M, Pose = S::Pose>,
    {
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

    fn accelerate(
        &mut self,
        target: Option<&Target<'_>>,
        out: &mut [f64],
    ) -> Result<(), NotARotation>
    where
        S::State: Commanded<D, M, Pose = S::Pose>,
    {
        target.map_or(Ok(()), S::State::check)?;
        self.act_for(target);
        let Self { controller, output, scratch, .. } = self;
        let (robot, bias) = (controller.robot(), controller.bias());
        let law = controller.torque().total.as_slice();
        match output {
            Some(output) => output.accelerate(robot, bias, law, out),
            None => robot.accelerate(law, bias, scratch, out),
        }
        Ok(())
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
            Some(output) => output.convert(controller.robot(), controller.bias(), tau),
            None => tau,
        }
    }

    fn begin(&mut self, period: f64, measured: Option<&[f64]>) -> Result<(), BeginError> {
        let robot = self.controller.robot().clone();
        let supervisor = Supervisor::new(&self.settings.command, robot, period, measured)?;
        self.supervisor = Some(Box::new(supervisor));
        self.controller.reset();
        self.last = None;
        Ok(())
    }

    fn cycle(
        &mut self,
        reading: Option<Reading<'_>>,
        target: Option<&Target<'_>>,
    ) -> Result<Phase, CycleError>
    where
        S::State: Commanded<D, M, Pose = S::Pose>,
    {
        target.map_or(Ok(()), S::State::check)?;
        let mut supervisor = self.supervisor.take().ok_or(CycleError::NotBegun)?;
        let admitted = |Reading { t, q, dq }| Some((supervisor.admit(t, q, dq)?, q, dq));
        let news = reading.and_then(admitted);
        if let Some((t, q, dq)) = news {
            self.observe(q, dq, t);
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

    fn terms(&self) -> TermsView<'_> {
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

    fn stable_period(&mut self, q: &[f64], t: f64) -> StablePeriod {
        if self.spoilt {
            self.reset();
        }
        self.world.update(self.loop_time(t) - self.epoch);
        self.controller.observe(q, &vec![0.0; q.len()], &mut self.world);
        self.controller.stable_period(&mut self.world)
    }
}

/// Among obstacles of space.
impl<const M: usize> Standalone<Space, 3, M>
where
    Space: System<3, M>,
{
    fn swap_points(&mut self, j: usize, points: &mut Points) -> Result<(), PointsError> {
        let n = self.controller.robot().dof();
        points::check(&self.world, j, points, &self.settings, n)?;
        self.world.swap_points(j, points);
        Ok(())
    }

    fn make_room(&mut self, j: usize, most: usize) -> Result<(), PointsError> {
        points::orientation_of(&self.world, j)?;
        if most > space::MOST_POINTS {
            return Err(PointsError::TooMany(most));
        }
        self.fits(self.world.barrier_count().saturating_add(most))?; // more than it will be
        self.world.make_room(j, most);
        self.reserve();
        Ok(())
    }
}
