//! What a user can set on a controller: the `[controller]` table of a scenario and those inside of it. What they are
//! resolved to for one robot is [`Gains`](super::Gains).

mod command;
mod preview;
mod self_motion;
mod yielding;

pub use command::{CommandSettings, Gravity, OF_THE_ROBOT};
pub use preview::PreviewSettings;
pub use self_motion::SelfMotionSettings;
pub use yielding::{Part, Yielding};

use super::deadline::Deadline;
use super::observer::{ObserverSettings, Touch};
use super::tank::TankSettings;
use crate::field::Field;
use crate::math::ScalarOrVec;
use crate::settings::settings;
use crate::trajectory::GovernorSettings;
use serde::{Deserialize, Serialize};

/// Which form of the law computes the torque. Both give the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Formulation {
    /// The basis-free law on O(n) operators.
    #[default]
    Recursive,
    /// The paper's explicit form with Z, N_M, J_e and μ; O(n³), allocates.
    ExtendedJacobian,
}

/// Through which projector the secondary torque acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
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

settings! {
    /// Everything that can be set on a controller: the `[controller]` table of a scenario.
    ///
    /// # Example
    /// ```
    /// use vff_core::control::settings::{
    ///     Avoidance, CommandSettings, Formulation, Part, PreviewSettings, Projection, SelfCollision, SelfMotionSettings, TaskKind,
    ///     Yielding,
    /// };
    /// use vff_core::control::{Deadline, Settings};
    ///
    /// let settings: Settings = toml::from_str(
    ///     r#"
    ///     task = "pose"
    ///     avoidance = "cbf"
    ///     self_collision = "avoid"
    ///     deadline = 300
    ///     yielding = { margin = 0.03, order = ["turn", "orientation"], preview = {} }
    ///     "#,
    /// )
    /// .unwrap();
    /// assert_eq!((settings.task, settings.avoidance), (TaskKind::Pose, Avoidance::Cbf));
    /// assert_eq!(settings.self_collision, SelfCollision::Avoid);
    /// assert_eq!(settings.deadline, Some(Deadline::Micros(300.0)));
    /// let order = Some(vec![Part::Turn, Part::Orientation]);
    /// let preview = Some(PreviewSettings::default());
    /// assert_eq!(settings.yielding, Yielding { margin: 0.03, order, preview, ..Yielding::default() });
    /// // What the search of the self-motion takes where nothing is said.
    /// assert_eq!(SelfMotionSettings::default().horizon, 3.0);
    /// // What is not said is as by default.
    /// let defaults = Settings::default();
    /// assert_eq!((defaults.formulation, defaults.projection), (Formulation::Recursive, Projection::Dynamic));
    /// assert_eq!(defaults.command, CommandSettings::default());
    /// ```
    pub struct Settings {
        /// `position` (m = 2) or `pose` (m = 3, with the orientation); in space m = 3, 6, and `pointing` (m = 5: the turn about the
        /// tool's z axis is free).
        task: TaskKind = TaskKind::Position, "";
        /// K of the end effector, per task axis.
        stiffness: ScalarOrVec = ScalarOrVec::Uniform(16.0), "1/s²", NOT_NEGATIVE;
        /// D of the end effector, per task axis.
        damping: ScalarOrVec = ScalarOrVec::Uniform(8.0), "1/s", NOT_NEGATIVE;
        /// Damping of the null space relative to inertia, per joint.
        null_damping: ScalarOrVec = ScalarOrVec::Uniform(2.0), "1/s", NOT_NEGATIVE;
        /// Joint angles that the posture spring pulls to; n numbers.
        posture: Option<Vec<f64>> = None, "rad";
        /// K_v; needs `posture` or a plan, and for set points `null_damping`.
        posture_stiffness: ScalarOrVec = ScalarOrVec::Uniform(0.0), "N·m/rad", NOT_NEGATIVE;
        /// The virtual force field; off by default.
        field: Field = Field::OFF;
        /// `ignore`, `report`: links that share no joint are measured against each other; `avoid`: `field` pushes them apart too,
        /// and `cbf` keeps 5 mm.
        self_collision: SelfCollision = SelfCollision::Ignore, "";
        /// A field over the angle that is left to the joint limits. Its lengths are angles \[rad\], its forces torques
        /// \[N·m\].
        joint_limit_field: Option<Field> = None;
        /// Whether the arm's limits of torque, speed and angle hold for the controller: see below.
        enforce_limits: bool = true, "";
        /// The energy that avoidance may inject; unlimited by default.
        tank: Option<TankSettings> = None;
        /// What estimates the torque that the model does not know.
        observer: Option<ObserverSettings> = None;
        /// What the law does about that torque.
        touch: Touch = Touch::default();
        /// `recursive`, or `extended_jacobian`: same torque, slow, explicit.
        formulation: Formulation = Formulation::Recursive, "";
        /// `dynamic`; `kinematic` and `none` leak into the task (comparison).
        projection: Projection = Projection::Dynamic, "";
        /// `null_space`: the task always wins; `relaxed`, `priority` or `cbf`: it gives way, see \[controller.yielding\].
        avoidance: Avoidance = Avoidance::NullSpace, "";
        /// How the end effector yields, where it does.
        yielding: Yielding = Yielding::default();
        /// How the reference waits for the end effector; it does not by default.
        governor: Option<GovernorSettings> = None;
        /// What stands between the torque and the robot; nothing by default.
        #[serde(deserialize_with = "command::read")]
        command: CommandSettings = CommandSettings::default();
        /// How long a cycle may take, look-ahead included, or `"unlimited"`; none: three tenths of the period in a loop whose period
        /// is known, where the clock counts, unlimited in a simulation, where 1000 units of work count as a microsecond.
        deadline: Option<Deadline> = None, "µs", POSITIVE;
        /// Where metres and radians of a task are put together, an angle counts as its arc at this radius; none: 1 in the
        /// plane, in space a sixth of links and tool in one line.
        characteristic_length: Option<f64> = None, "m", POSITIVE;
        /// The task force is damped where an eigenvalue of the inverse task inertia is below this / (mass of the arm).
        singularity: f64 = 0.03, "", POSITIVE;
    }
}
