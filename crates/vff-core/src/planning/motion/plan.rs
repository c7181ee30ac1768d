//! What is asked of a planner, and what it answers.

use crate::math::ScalarOrVec;

/// What is planned, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanSettings {
    /// Where the joints are \[rad\]; by default the scenario's `q0`.
    pub start: Option<Vec<f64>>,
    /// Where they have to go \[rad\]; by default whatever puts the end effector where the reference ends.
    pub goal: Option<Vec<f64>>,
    /// When it starts \[s\].
    pub time: f64,
    /// What every link keeps from obstacles \[m\], ≥ 0; less near a start or goal that has less. Pairs with a margin of their own
    /// keep that in its place.
    pub margin: f64,
    /// For how long the places that moving obstacles will pass are kept free \[s\], ≥ 0; None leaves out those
    /// that move at its beginning.
    pub horizon: Option<f64>,
    /// How far the end effector may tilt from how it stands at the start \[rad\], > 0, whichever way it turns about the vertical; in the plane
    /// how far it may turn. None: that does not matter.
    pub tilt: Option<f64>,
    /// Where it stands upright, if that is not the start \[rad\].
    pub upright: Option<Vec<f64>>,
    /// A point that the end effector keeps in view \[m\], and how far off its axis that may be, z in space and the last link in the plane
    /// \[rad\], > 0. What is in between does not matter. None: neither does where it looks.
    pub view: Option<(Vec<f64>, f64)>,
    /// How far the end effector comes straight to the goal, without turning \[m\], ≥ 0: along what it has in front of it there, z in space and
    /// the last link in the plane; or the vector along which it comes. None: that does not matter.
    pub approach: Option<ScalarOrVec>,
    /// The same of how it leaves the start: backwards, or along a vector.
    pub retreat: Option<ScalarOrVec>,
    /// How fast the joints may become faster \[rad/s², m/s²\], > 0. By default 30 in the plane, 10 in space.
    pub acceleration: Option<ScalarOrVec>,
    /// How fast that may change \[rad/s³, m/s³\], > 0; where a motion begins and ends, within the time between two of its instants. None:
    /// that does not matter.
    pub jerk: Option<ScalarOrVec>,
    /// The share of the limits of speed, acceleration and jerk that is used, in (0, 1].
    pub speed: f64,
    /// How many random configurations are tried.
    pub samples: usize,
    /// How many paths are searched, ≥ 1, of which the shortest is taken: one is there soonest.
    pub paths: usize,
    /// Where the random numbers come from.
    pub seed: u64,
}

impl Default for PlanSettings {
    fn default() -> Self {
        Self {
            start: None,
            goal: None,
            time: 0.0,
            margin: 0.02,
            horizon: Some(1.0),
            tilt: None,
            upright: None,
            view: None,
            approach: None,
            retreat: None,
            acceleration: None,
            jerk: None,
            speed: 0.5,
            samples: 20_000,
            paths: 4,
            seed: 0,
        }
    }
}

/// What planning has come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlanStatus {
    /// A motion to the goal.
    Found,
    /// The start touches something, or will be passed by something within the horizon.
    StartBlocked,
    /// No configuration within the joint limits puts the end effector there.
    GoalOutOfReach,
    /// Every configuration that was found for the goal touches something.
    GoalBlocked,
    /// No path among so many samples. It is no proof that there is none.
    NotFound,
    /// There is a path, but the joints cannot hold the arm somewhere on it.
    TooHeavy,
}

impl PlanStatus {
    /// Its name in every layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::Found => "found",
            Self::StartBlocked => "start blocked",
            Self::GoalOutOfReach => "goal out of reach",
            Self::GoalBlocked => "goal blocked",
            Self::NotFound => "not found",
            Self::TooHeavy => "too heavy",
        }
    }
}

/// A motion to a goal; or how far the search came.
///
/// # Example
/// See [`plan`](super::plan()), which finds one:
/// ```
/// use vff_core::planning::motion::{Plan, PlanStatus};
/// use vff_core::trajectory::JointSpline;
///
/// fn followed(found: &Plan, n: usize) -> Option<JointSpline> {
///     let points: Vec<_> = found.q.chunks(n).map(<[f64]>::to_vec).collect();
///     (found.status == PlanStatus::Found).then(|| JointSpline::new(&found.times, &points).ok())?
/// }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Whether it leads to the goal, and if not, why.
    pub status: PlanStatus,
    /// The same in a sentence, with what is in the way and what would help.
    pub message: String,
    /// Instants \[s\] from the start on; none if nothing was found.
    pub times: Vec<f64>,
    /// The configuration at each instant \[rad\], one after the other; if nothing was found, the path to where a goal was
    /// nearest.
    pub q: Vec<f64>,
    /// Velocities \[rad/s\].
    pub dq: Vec<f64>,
    /// Accelerations \[rad/s²\].
    pub ddq: Vec<f64>,
    /// Where the tip of the end effector is at each configuration of `q` \[m\], one after the other.
    pub tip: Vec<f64>,
    /// The smallest distance from obstacles on the way \[m\]; ∞ if there are none. Where start or goal are blocked, the
    /// distance of what is; at the start if nothing was found otherwise.
    pub clearance: f64,
    /// What was kept of the margin by the path where it keeps least, before corners were rounded \[m\]: of a margin of a pair's own the same
    /// share was kept.
    pub margin: f64,
    /// What each link is certain to keep between each instant and the next: the smaller of both \[m\], one instant after the
    /// other; none if nothing was found.
    pub margins: Vec<f64>,
    /// The same of margins of their own, as a share of each that is 1 at most; none where no pair has one.
    pub shares: Vec<f64>,
    /// How far the end effector tilts at most where it is looked at between instants \[rad\]; None where that does not matter, or nothing was
    /// found.
    pub tilt: Option<f64>,
    /// The same of how far off its axis it has the point that it keeps in view.
    pub view: Option<f64>,
    /// When it has to begin \[s\], if it keeps from what moves only when that passes; None if it keeps from all places that are passed within
    /// the horizon.
    pub begins: Option<f64>,
    /// What is left to a goal \[rad\]; of one out of reach \[m\]; 0 if it was found.
    pub gap: f64,
    /// How many random configurations were tried.
    pub samples: usize,
    /// How many configurations the trees had.
    pub nodes: usize,
}
