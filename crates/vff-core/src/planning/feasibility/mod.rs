//! Whether a scene can be survived at all, by a planner that knows the future and no controller.
//!
//! **The rule**, fixed before any controller was run on random scenes. A *motion* is a sequence of
//! joint angles from the scene's start, [`STEP`] apart, straight in between, within the arm's joint
//! limits, with speeds up to the arm's limits or, where it has none, up to [`MAX_SPEED`], which change
//! from one piece to the next by at most [`MAX_ACCELERATION`] times [`STEP`]. It is *clear* if every
//! link keeps [`CLEARANCE`] or more from every obstacle at all instants 5 ms apart, and it *holds the
//! tip* if the tip is never more than [`TIP`] from its reference and, where the task has an
//! orientation, never turned from it by more than [`ANGLE`]. The [`Verdict`] on a scene is what a
//! search with a given budget finds.
//!
//! The search (`search`) follows the first of [`WIDTHS`] motions at once. Each is continued in four
//! random ways per piece: what the task asks for, a push away from where the obstacles are now or will
//! be soon and from joint limits, and noise, in random shares; with the tip held, every continuation is
//! put back onto the reference by Newton's method. Continuations that come within [`MARGIN`] of an
//! obstacle or break a bound are dropped. Of the rest as many are followed as before: half of them for
//! the room that they have, now and later, half at random. A search that dies out is repeated once,
//! with the second width. What it asks of an arm is said by `chain`.
//!
//! What is found is a motion, checked; "none found" is no proof that there is none. Links may cross
//! each other, as they may in the plant; torques are not looked at. The random numbers are always the
//! same.

mod chain;
mod search;

use crate::robot::Model;
use crate::scenario::{AnyScene, Scenario, ScenarioError, Scene, dispatch, trajectory};
use crate::world::World;
use chain::{Chain, Judged};
use search::Search;
use std::sync::Arc;

/// Duration of one piece of a motion \[s\].
pub const STEP: f64 = 0.05;
/// Largest joint speed where the arm has no limit \[rad/s\].
pub const MAX_SPEED: f64 = 3.0;
/// Largest change of a joint's speed from piece to piece, relative to [`STEP`] \[rad/s²\]: in the plane and in space, where
/// it is about what the makers of published arms allow.
pub const MAX_ACCELERATION: [f64; 2] = [30.0, 10.0];
/// What a motion has to keep from every obstacle \[m\].
pub const CLEARANCE: f64 = 1e-3;
/// What the search keeps at the ends and in the middle of its pieces \[m\].
pub const MARGIN: f64 = 1e-2;
/// How far the tip may be from its reference where it is held \[m\].
pub const TIP: f64 = 1e-2;
/// How far it may be turned from it, where the task has an orientation \[rad\].
pub const ANGLE: f64 = 5e-2;
/// How many motions the first and the second attempt follow.
pub const WIDTHS: [usize; 2] = [64, 256];

/// What the search has found.
///
/// # Example
/// ```
/// use vff_core::planning::feasibility::{Motion, Verdict, assess};
/// use vff_core::scenario::Scenario;
///
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 0.5
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "line", end = [1.2, 0.5], duration = 0.5 }
///     "#,
/// )
/// .unwrap();
/// let (verdict, motion): (Verdict, Option<Motion>) = assess(&scenario).unwrap();
/// assert_eq!(verdict.name(), "with tip");
/// assert!(motion.is_some());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// A clear motion that holds the tip.
    WithTip,
    /// A clear motion, but none that holds the tip.
    WithoutTip,
    /// No clear motion.
    NoneFound,
}

impl Verdict {
    /// Its name in every layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::WithTip => "with tip",
            Self::WithoutTip => "without tip",
            Self::NoneFound => "none found",
        }
    }
}

/// The joint angles of a motion \[rad\], one vector per instant, [`STEP`] apart.
pub type Motion = Vec<Vec<f64>>;

/// Assesses a scene; with the motion that was found.
///
/// # Errors
/// If the arm or the reference is unusable, or the search does not fit into memory.
pub fn assess(scenario: &Scenario) -> Result<(Verdict, Option<Motion>), ScenarioError> {
    let task = scenario.controller.task;
    dispatch!(&scenario.scene, task, AnyScene(scene) => assess_for(scenario, scene))
}

fn assess_for<S: Judged<D, M>, const D: usize, const M: usize>(
    scenario: &Scenario,
    scene: &Scene<S, D>,
) -> Result<(Verdict, Option<Motion>), ScenarioError> {
    let arm = Arc::new(S::arm(&scene.arm).map_err(|error| error.inside("arm"))?);
    let mut chain = S::chain(&arm);
    let mut world = World::new(scene.obstacles.clone());
    world.know_links(&arm.link_names());
    chain.move_to(&scenario.q0);
    let search = Search::<S::Chain, S::Geometry, D, M> {
        pieces: search::pieces(scenario.duration, scenario.q0.len())?,
        start: scenario.q0.clone(),
        length: scenario.controller.length_of(&*arm),
        trajectory: trajectory::<S, D, M>(&scene.reference, &arm, &chain.pose())?,
        world,
        chain,
    };
    Ok(search.verdict())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(obstacle: &str) -> Verdict {
        let text = format!(
            "duration = 4.0\nq0 = [1.2, -0.6, -0.6, -0.5, 0.3, 0.4]\n\
             arm = {{ lengths = [1, 1, 1, 1, 1, 1], masses = 1.0 }}\n\
             reference = {{ kind = \"setpoint\", point = [5.025409086959208, 1.0172560207580585] }}\n{obstacle}"
        );
        assess(&Scenario::from_toml(&text).unwrap()).unwrap().0
    }

    /// Nothing in the way; a disc that pushes into the links; one that goes over the tip's place;
    /// one that goes over the base, from which no joint can take the first link away.
    #[test]
    fn scenes_whose_answer_is_known() {
        let disc = |position: &str, velocity: &str| {
            verdict(&format!(
                "[[obstacles]]\nshape = {{ kind = \"circle\", radius = 0.15 }}\nposition = {position}\n\
                 motion = {{ kind = \"linear\", velocity = {velocity} }}"
            ))
        };
        assert_eq!(verdict(""), Verdict::WithTip);
        assert_eq!(disc("[1.6, 2.9]", "[0.0, -0.35]"), Verdict::WithTip);
        assert_eq!(disc("[5.0, 3.0]", "[0.0, -0.6]"), Verdict::WithoutTip);
        assert_eq!(disc("[-1.0, 0.0]", "[0.5, 0.0]"), Verdict::NoneFound);
    }

    /// A Panda that holds its tool: nothing in the way; a ball through the elbow, from which one free joint
    /// swings away; a ball through the hand, which has to give way; one through the first link, which cannot.
    #[cfg(feature = "models")]
    #[test]
    fn scenes_in_space_whose_answer_is_known() {
        let panda = |task: &str, more: &str| {
            let text = format!(
                "duration = 4.0\nq0 = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]\n\
                 controller = {{ task = \"{task}\" }}\nreference = {{ kind = \"setpoint\" }}\n{more}"
            );
            let (verdict, motion) = assess(&Scenario::from_toml(&text).unwrap()).unwrap();
            assert_eq!(motion.is_some(), verdict != Verdict::NoneFound);
            verdict
        };
        let ball = |task: &str, arm: &str, position: &str, velocity: &str| {
            panda(
                task,
                &format!(
                    "arm = {{ model = \"panda\"{arm} }}\n[[obstacles]]\n\
                 shape = {{ kind = \"sphere\", radius = 0.08 }}\nposition = {position}\n\
                 motion = {{ kind = \"linear\", velocity = {velocity} }}"
                ),
            )
        };
        assert_eq!(panda("pose", "arm = { model = \"panda\" }"), Verdict::WithTip);
        for task in ["position", "pointing", "pose"] {
            let elbow = ball(task, "", "[-0.05, -0.6, 0.62]", "[0.0, 0.3, 0.0]");
            assert_eq!(elbow, Verdict::WithTip, "{task}");
            let hand = ball(task, "", "[0.3, -0.7, 0.54]", "[0.0, 0.4, 0.0]");
            assert_eq!(hand, Verdict::WithoutTip, "{task}");
        }
        let shoulder = ball("position", "", "[0.0, -0.7, 0.25]", "[0.0, 0.4, 0.0]");
        assert_eq!(shoulder, Verdict::NoneFound);
        // The same elbow, of joints that hardly move, or slowly.
        let stiff = ", joint_limits = [[-0.02, 0.02], [-0.81, -0.76], [-0.02, 0.02], [-2.38, -2.33], \
                     [-0.02, 0.02], [1.55, 1.59], [0.76, 0.81]]";
        let slow = ", velocity_limits = [0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01]";
        for arm in [stiff, slow] {
            let elbow = ball("position", arm, "[-0.05, -0.6, 0.62]", "[0.0, 0.3, 0.0]");
            assert_eq!(elbow, Verdict::NoneFound, "{arm}");
        }
    }

    /// A motion stays within joint limits that the same scene without them leaves.
    #[test]
    fn planar_joint_limits_are_kept() {
        let limits = [[1.15, 1.5], [-0.9, 0.0], [-1.0, 0.2], [-0.9, 0.1], [-0.4, 0.9], [-0.4, 1.0]];
        let kept = |more: &str| {
            let text = format!(
                "duration = 3.0\nq0 = [1.2, -0.6, -0.6, -0.5, 0.3, 0.4]\n\
                 arm = {{ lengths = [1, 1, 1, 1, 1, 1], masses = 1.0{more} }}\n\
                 reference = {{ kind = \"setpoint\", point = [5.025409086959208, 1.0172560207580585] }}\n\
                 [[obstacles]]\nshape = {{ kind = \"circle\", radius = 0.15 }}\nposition = [1.6, 2.9]\n\
                 motion = {{ kind = \"linear\", velocity = [0.0, -0.35] }}"
            );
            let (verdict, motion) = assess(&Scenario::from_toml(&text).unwrap()).unwrap();
            assert_eq!(verdict, Verdict::WithTip);
            let inside = |(q, [lower, upper]): (&f64, &[f64; 2])| lower <= q && q <= upper;
            motion.unwrap().iter().all(|q| q.iter().zip(&limits).all(inside))
        };
        assert!(!kept(""));
        assert!(kept(&format!(", joint_limits = {limits:?}")));
    }
}
