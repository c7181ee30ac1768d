//! What a user can set on a controller, and the same resolved for one robot.

use super::avoidance::Yielding;
use super::metric::TaskMetric;
use super::output::{self, CommandSettings};
use super::tank::TankSettings;
use crate::field::Field;
use crate::math::ScalarOrVec;
use crate::robot::{Model, Robot};
use crate::trajectory::GovernorSettings;
use nalgebra::SVector;
use serde::Deserialize;

/// Which form of the law computes the torque. Both give the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Formulation {
    /// The basis-free law on O(n) operators.
    #[default]
    Recursive,
    /// The paper's explicit form with Z, N_M, J_e and μ; O(n³), allocates.
    ExtendedJacobian,
}

/// Through which projector the secondary torque acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Projection {
    /// W = M: no acceleration of the end effector.
    #[default]
    Dynamic,
    /// W = I: statically consistent only, for comparison.
    Kinematic,
    /// Not projected, as the paper prints τ_total, for comparison.
    None,
}

/// What happens when the null space alone cannot avoid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Avoidance {
    /// The end effector's task always wins.
    #[default]
    NullSpace,
    /// Near an obstacle the task is released and the field pushes the end effector.
    Relaxed,
    /// Along the shortest way out of an obstacle the distance comes first.
    Priority,
    /// The nearest acceleration that keeps all distances and limits, by control barrier functions.
    Cbf,
}

/// What is done about links that come near each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SelfCollision {
    /// Nothing.
    #[default]
    Ignore,
    /// Links that share no joint are measured against each other.
    Report,
    /// They are, and repel each other by the field.
    Avoid,
}

/// What the end effector has to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TaskKind {
    /// Position of the end effector.
    #[default]
    Position,
    /// Position and orientation.
    Pose,
    /// In space, position and the direction of the tool's z axis: the turn about it is free.
    Pointing,
}

impl TaskKind {
    /// The number m of task coordinates in `space` dimensions; none if there is no such task.
    pub fn dimension(self, space: usize) -> Option<usize> {
        match (self, space) {
            (Self::Position, _) => Some(space),
            (Self::Pose, _) => Some(space * (space + 1) / 2),
            (Self::Pointing, 3) => Some(5),
            (Self::Pointing, _) => None,
        }
    }
}

/// Everything that can be set on a controller: the `[controller]` table of a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// What the end effector has to do.
    pub task: TaskKind,
    /// K \[1/s²\] per axis or for all, ≥ 0.
    pub stiffness: ScalarOrVec,
    /// D \[1/s\] per axis or for all, ≥ 0.
    pub damping: ScalarOrVec,
    /// d \[1/s\] per joint or for all, ≥ 0: D_q = √d M √d.
    pub null_damping: ScalarOrVec,
    /// Preferred configuration q_d \[rad\] of the posture spring.
    pub posture: Option<Vec<f64>>,
    /// K_v \[N·m/rad\] of the posture spring per joint or for all, ≥ 0.
    pub posture_stiffness: ScalarOrVec,
    /// The virtual force field.
    pub field: Field,
    /// What is done about links that come near each other.
    pub self_collision: SelfCollision,
    /// A field over the angle that is left to the joint limits; none by default. Its lengths are
    /// angles \[rad\], its forces torques \[N·m\].
    pub joint_limit_field: Option<Field>,
    /// Whether the torque and the speed limits of the arm hold for the controller.
    pub enforce_limits: bool,
    /// The energy that avoidance may inject; unlimited by default.
    pub tank: Option<TankSettings>,
    /// Which form of the law.
    pub formulation: Formulation,
    /// Which projector.
    pub projection: Projection,
    /// What happens where the null space is not enough.
    pub avoidance: Avoidance,
    /// How the end effector yields, where it does.
    pub yielding: Yielding,
    /// How the reference waits for the end effector; it does not by default.
    pub governor: Option<GovernorSettings>,
    /// What stands between the torque and the robot; nothing by default.
    #[serde(deserialize_with = "output::read")]
    pub command: CommandSettings,
    /// L \[m\], > 0: where metres and radians of the task are put together, an angle counts as its arc at this radius.
    /// Default: [`Model::characteristic_length`].
    pub characteristic_length: Option<f64>,
    /// Damping of the task force starts when an eigenvalue of Λ⁻¹ falls below this fraction of
    /// 1/(mass of the arm), > 0.
    pub singularity: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            task: TaskKind::Position,
            stiffness: ScalarOrVec::Uniform(16.0),
            damping: ScalarOrVec::Uniform(8.0),
            null_damping: ScalarOrVec::Uniform(2.0),
            posture: None,
            posture_stiffness: ScalarOrVec::Uniform(0.0),
            field: Field::OFF,
            self_collision: SelfCollision::Ignore,
            joint_limit_field: None,
            enforce_limits: true,
            tank: None,
            formulation: Formulation::Recursive,
            projection: Projection::Dynamic,
            avoidance: Avoidance::NullSpace,
            yielding: Yielding::default(),
            governor: None,
            command: CommandSettings::default(),
            characteristic_length: None,
            singularity: 3e-2,
        }
    }
}

/// Damping of the null space, proportional to M: its sampled bound d·dt < 2 is the same in every
/// configuration (T31).
#[derive(Debug, Clone, PartialEq)]
pub enum NullDamping {
    /// D_q = d M with d \[1/s\].
    Uniform(f64),
    /// D_q = √d M √d, the diagonal √d \[1/√s\] one per joint.
    Each(Vec<f64>),
}

impl NullDamping {
    fn new(d: &ScalarOrVec) -> Self {
        match d {
            ScalarOrVec::Uniform(d) => Self::Uniform(*d),
            ScalarOrVec::Each(each) => Self::Each(each.iter().map(|d| d.sqrt()).collect()),
        }
    }

    /// d of joint `i` \[1/s\].
    pub fn get(&self, i: usize) -> f64 {
        match self {
            Self::Uniform(d) => *d,
            Self::Each(roots) => roots[i] * roots[i],
        }
    }

    /// Turns the momentum `M v` in `out` into `D_q v`, with `brake` added to every d.
    pub fn scale_momentum<R: Robot<D>, const D: usize>(
        &self,
        robot: &R,
        brake: f64,
        v: &[f64],
        out: &mut [f64],
        scratch: &mut [f64],
    ) {
        match self {
            Self::Uniform(d) => out.iter_mut().for_each(|p| *p *= d + brake),
            Self::Each(roots) => {
                let root = |root: &f64| (root * root + brake).sqrt();
                let scaled = v.iter().zip(roots);
                scratch.iter_mut().zip(scaled).for_each(|(s, (v, r))| *s = v * root(r));
                robot.mass_mul(scratch, out);
                out.iter_mut().zip(roots).for_each(|(p, r)| *p *= root(r));
            }
        }
    }
}

/// [`Settings`] resolved for a robot of n joints and a task of dimension `M`.
#[derive(Debug, Clone, PartialEq)]
pub struct Gains<const M: usize> {
    /// K \[1/s²\].
    pub stiffness: SVector<f64, M>,
    /// D \[1/s\].
    pub damping: SVector<f64, M>,
    /// D_q.
    pub null_damping: NullDamping,
    /// Posture spring: (q_d \[rad\], K_v \[N·m/rad\]) per joint, empty without posture.
    pub posture: Vec<(f64, f64)>,
    /// K_v, for the posture of a plan.
    pub posture_stiffness: ScalarOrVec,
    /// The virtual force field.
    pub field: Field,
    /// What is done about links that come near each other.
    pub self_collision: SelfCollision,
    /// The field over the angle that is left to the joint limits.
    pub joint_limit_field: Option<Field>,
    /// Whether the torque and the speed limits of the arm hold for the controller.
    pub enforce_limits: bool,
    /// The energy that avoidance may inject.
    pub tank: Option<TankSettings>,
    /// Which form of the law.
    pub formulation: Formulation,
    /// Which projector.
    pub projection: Projection,
    /// What happens where the null space is not enough.
    pub avoidance: Avoidance,
    /// How the end effector yields.
    pub yielding: Yielding,
    /// How the reference waits.
    pub governor: Option<GovernorSettings>,
    /// What stands between the torque and the robot.
    pub command: CommandSettings,
    /// See [`Settings::characteristic_length`].
    pub characteristic_length: f64,
    /// See [`Settings::singularity`].
    pub singularity: f64,
    /// Where the random numbers of look-ahead come from.
    pub seed: u64,
}

impl<const M: usize> Gains<M> {
    /// Resolves settings whose lengths `scenario` has validated.
    pub fn new(settings: &Settings) -> Self {
        let posture = settings.posture.as_deref().unwrap_or_default();
        Self {
            stiffness: SVector::from_fn(|i, _| settings.stiffness.get(i)),
            damping: SVector::from_fn(|i, _| settings.damping.get(i)),
            null_damping: NullDamping::new(&settings.null_damping),
            posture: posture
                .iter()
                .enumerate()
                .map(|(i, q)| (*q, settings.posture_stiffness.get(i)))
                .collect(),
            posture_stiffness: settings.posture_stiffness.clone(),
            field: settings.field,
            self_collision: settings.self_collision,
            joint_limit_field: settings.joint_limit_field,
            enforce_limits: settings.enforce_limits,
            tank: settings.tank,
            formulation: settings.formulation,
            projection: settings.projection,
            avoidance: settings.avoidance,
            yielding: settings.yielding.clone(),
            governor: settings.governor,
            command: settings.command.clone(),
            characteristic_length: settings.characteristic_length.unwrap_or(1.0),
            singularity: settings.singularity,
            seed: 0,
        }
    }

    /// The same with the characteristic length of `arm`, where the settings leave it open.
    #[must_use]
    pub fn of_arm<A: Model<D>, const D: usize>(self, settings: &Settings, arm: &A) -> Self {
        let characteristic_length =
            settings.characteristic_length.unwrap_or_else(|| arm.characteristic_length());
        Self { characteristic_length, ..self }
    }

    /// The same with random numbers from `seed`.
    #[must_use]
    pub fn with_seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// How lengths and angles of the task are put together in a space of dimension `D`.
    pub fn metric<const D: usize>(&self) -> TaskMetric<M> {
        TaskMetric::new::<D>(self.characteristic_length)
    }

    /// Moves the posture to `q` \[rad\]. Allocates where there was none.
    pub fn move_posture(&mut self, q: &[f64]) {
        let Self { posture, posture_stiffness, .. } = self;
        if posture.is_empty() {
            posture.extend(q.iter().enumerate().map(|(i, q)| (*q, posture_stiffness.get(i))));
        }
        posture.iter_mut().zip(q).for_each(|((rest, _), q)| *rest = *q);
    }

    /// `out += K_v (q_d − q)` (T10), nothing without a posture.
    pub fn add_posture_torque(&self, q: &[f64], out: &mut [f64]) {
        for ((out, q), (rest, stiffness)) in out.iter_mut().zip(q).zip(&self.posture) {
            *out += stiffness * (rest - q);
        }
    }

    /// ½ (q_d − q)ᵀ K_v (q_d − q) \[J\].
    pub fn posture_energy(&self, q: &[f64]) -> f64 {
        q.iter().zip(&self.posture).map(|(q, (rest, k))| 0.5 * k * (rest - q) * (rest - q)).sum()
    }
}
