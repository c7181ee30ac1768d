//! Everything worth knowing of the closed loop at one instant, borrowed from it.

use super::ReplanCounts;
use crate::control::{Energy, ObjectiveScale, Power, Torque};
use crate::world::Positions;

/// State, torques and what the field does, at one instant. n joints, task dimension m.
///
/// # Example
/// ```
/// use vff_core::scenario::Scenario;
/// use vff_core::simulation::Snapshot;
/// use vff_core::world::Positions;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let run = Scenario::from_toml(
///     r#"
///     duration = 0.2
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     obstacles = [{ shape = { kind = "circle", radius = 0.1 }, position = [1.2, 1.2] }]
///     "#,
/// )?
/// .prepare()?
/// .run;
/// let now: Snapshot<'_> = run.snapshot();
/// let obstacles: &dyn Positions = now.obstacles;
/// assert_eq!((now.t, now.q.len(), obstacles.count()), (0.0, 3, 1));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy)]
pub struct Snapshot<'a> {
    /// Dimension of the space, 2 or 3: how many of the error's entries are of position.
    pub dimension: usize,
    /// Time \[s\].
    pub t: f64,
    /// Configuration q \[rad\], (n).
    pub q: &'a [f64],
    /// Joint velocity q̇ \[rad/s\], (n).
    pub dq: &'a [f64],
    /// What the controller takes them for; empty without `[measurement]`.
    pub q_measured: &'a [f64],
    /// See `q_measured`.
    pub dq_measured: &'a [f64],
    /// What the controller knows of the obstacles, NaN for a ray that met nothing \[m\]; `None` without
    /// sensors of `[perception]`.
    pub sensed: Option<&'a dyn Positions>,
    /// Torque that is commanded from now on \[N·m\], (n) each.
    pub torque: &'a Torque,
    /// Torque at the joints at this instant, of the drives and of a robot that adds gravity's by itself \[N·m\]; empty where it
    /// is the commanded one.
    pub tau_applied: &'a [f64],
    /// Σ JᵀF of the virtual forces, unprojected \[N·m\], (n).
    pub tau_vff: &'a [f64],
    /// Pose of the end effector as it is written \[m, rad\].
    pub x: &'a [f64],
    /// Its rate \[m/s, rad/s\], (m).
    pub dx: &'a [f64],
    /// How fast it moves and turns, as shares of `command.tip_speed` and `tip_angular_speed`; `None` without them.
    pub tip_shares: [Option<f64>; 2],
    /// Reference, written likewise, after the governor if there is one.
    pub x_ref: &'a [f64],
    /// Path time σ \[s\]; `None` without a governor.
    pub path_time: Option<f64>,
    /// Where the plan has the joints \[rad\], (n); `None` as long as the reference is none.
    pub q_plan: Option<&'a [f64]>,
    /// What came of watching over the reference; `None` without `[replan]`.
    pub replans: Option<ReplanCounts>,
    /// x ⊖ x_ref \[m, rad\], (m), position before orientation.
    pub error: &'a [f64],
    /// Magnitude of the repulsion on each link \[N\], (n).
    pub force: &'a [f64],
    /// Signed surface distance from each link to the nearest obstacle \[m\], (n).
    pub clearance: &'a [f64],
    /// Where the tip is to press on something, how near its link is to all else \[m\].
    pub unpressed: Option<f64>,
    /// The obstacles.
    pub obstacles: &'a dyn Positions,
    /// Acceleration of the end effector by the null-space torque, ‖J M⁻¹ τ_null‖, where the law was
    /// evaluated.
    pub null_acceleration: f64,
    /// Energies \[J\].
    pub energy: Energy,
    /// Powers \[W\] of the torque that acts, and into the null space.
    pub power: Power,
    /// What the limits let through of each objective of the torque that acts; `None` without limits.
    pub objective_scale: Option<&'a ObjectiveScale>,
    /// Energy in the tank \[J\]; `None` without one.
    pub tank: Option<f64>,
    /// The torque of the wrenches that push the arm from now on \[N·m, N\], (n); `None` without any.
    pub tau_ext: Option<&'a [f64]>,
    /// The force of each obstacle on the arm \[N\], (k, D); `None` where none is felt.
    pub contact_force: Option<&'a [f64]>,
    /// The torque that the model does not know, as estimated \[N·m, N\], (n); `None` without an observer.
    pub tau_ext_estimate: Option<&'a [f64]>,
    /// The wrench at the end effector that this is \[N, N·m\], (m), in the rows of J; `None` without an observer.
    pub wrench_estimate: Option<&'a [f64]>,
    /// The link on which a contact is felt, counted from 0, or n where none is; `None` without detection.
    pub touched_link: Option<usize>,
    /// What the estimate is beyond what it has been of late \[N·m, N\], (n); `None` without detection.
    pub contact_deviation: Option<&'a [f64]>,
    /// What the estimate has to change by to be felt \[N·m, N\], (n), infinite at first; `None` without detection.
    pub contact_threshold: Option<&'a [f64]>,
    /// By how much the end effector gives way to a push \[m\]; `None` without a reaction.
    pub yielded: Option<f64>,
    /// How many parts of its task the look-ahead lets go, in their order (T193); `None` where none is given.
    pub released: Option<usize>,
    /// Whether a push has stopped the task; `None` where none ever does.
    pub is_stopped: Option<bool>,
    /// Smallest surface distance of two links that share no joint \[m\]; `None` where not measured.
    pub self_clearance: Option<f64>,
    /// Which links these are; none for the base.
    pub nearest_pair: [Option<usize>; 2],
    /// √det(J Jᵀ) \[m²\].
    pub manipulability: f64,
    /// By how much the barriers are broken at most \[m/s²\]; `None` without barriers (`cbf`).
    pub slack: Option<f64>,
    /// Whether the end effector may give way, by whatever law.
    pub yields: bool,
    /// Whether the task force was damped because of a singularity.
    pub singular: bool,
}

impl Snapshot<'_> {
    /// Whether there is a plan, or may be one later.
    pub fn has_plans(&self) -> bool {
        self.q_plan.is_some() || self.replans.is_some()
    }

    /// How near each link is to what it is not to touch \[m\]: to everything but what the tip is to press on.
    pub fn room(&self) -> impl Iterator<Item = f64> + '_ {
        let links = self.clearance.len() - usize::from(self.unpressed.is_some());
        self.clearance[..links].iter().copied().chain(self.unpressed)
    }

    /// Whether a link is inside an obstacle that it is not to touch.
    pub fn collides(&self) -> bool {
        self.room().any(|distance| distance < 0.0)
    }
}
