//! A reference that is watched over while it is followed: what is asked of whoever makes a plan where it leads nowhere (T121, T179).

use super::System;
use crate::control::{MotionLimits, Settings};
use crate::math::{ScalarOrVec, Vector};
use crate::settings::settings;
use crate::trajectory::{Pace, Trajectory};
use crate::world::World;
use std::fmt::Debug;
use std::sync::Arc;

settings! {
    /// The `[replan]` table of a scenario.
    pub struct ReplanSettings {
        /// From the question to the plan.
        latency: f64 = 0.3, "s", NOT_NEGATIVE;
        /// In what time the rest of the plan is looked through once; at most once in a period of control.
        every: f64 = 0.1, "s", POSITIVE;
        /// For how long the arm may be off its reference, or stuck.
        patience: f64 = 1.0, "s", POSITIVE;
        /// How far each joint may be from its plan.
        stray: f64 = 0.5, "rad, m", POSITIVE;
        /// An arm whose end effector is nearer to its reference is not stuck; 1 rad counts as 0.4 m.
        tolerance: f64 = 0.02, "m", NOT_NEGATIVE;
        /// In what time the difference to the reference before fades.
        blend: f64 = 0.5, "s", POSITIVE;
        /// What every link keeps from obstacles; less where start or goal have less.
        margin: f64 = 0.02, "m", POSITIVE;
        /// For how long what moves is predicted.
        horizon: f64 = 1.0, "s", NOT_NEGATIVE;
        /// How far the end effector may tilt from how it stands at `q0`, in the plane: turn. Plans keep to it, not the law that follows.
        tilt: Option<f64> = None, "rad", POSITIVE;
        /// A point that the end effector keeps in view, z in space and the last link in the plane being its axis. The same holds.
        view: Option<Vec<f64>> = None, "m";
        /// How far off that axis it may be.
        view_angle: f64 = 0.35, "rad", POSITIVE;
        /// How fast the joints of another plan may become faster; 30 in the plane and 10 in space by default.
        acceleration: Option<ScalarOrVec> = None, "rad/s², m/s²", POSITIVE;
        /// How fast that may change.
        jerk: Option<ScalarOrVec> = None, "rad/s³, m/s³", POSITIVE;
        /// The share of the limits of speed, acceleration and jerk.
        speed: f64 = 0.5, "", SHARE;
        /// Random configurations until a search gives up.
        samples: usize = 5000, "";
    }
}

/// Why there should be another plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// Something is in its way.
    Blocked,
    /// The arm has been off it for too long.
    Strayed,
    /// The arm has come no nearer to the end for too long.
    Stuck,
    /// Somebody wants one, whether the arm needs it or not.
    Wanted,
}

impl Reason {
    /// Its name in every layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blocked => "blocked",
            Self::Strayed => "strayed",
            Self::Stuck => "stuck",
            Self::Wanted => "wanted",
        }
    }
}

/// A search for another plan.
///
/// # Example
/// ```
/// use vff_core::simulation::{Reason, ReplanCounts, ReplanSettings, Replanned};
///
/// let one = Replanned { asked: 1.5, reason: Reason::Stuck, status: Some("found"), taken: Some(1.7) };
/// assert_eq!(one.reason.name(), "stuck");
/// assert_eq!(ReplanCounts { taken: 1, stuck: 1 }.taken, 1);
/// assert_eq!(ReplanSettings::default(), ReplanSettings::default());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Replanned {
    /// When it was asked for \[s\].
    pub asked: f64,
    /// Why.
    pub reason: Reason,
    /// What came of it; none before its end.
    pub status: Option<&'static str>,
    /// When it was taken over \[s\], if it was.
    pub taken: Option<f64>,
}

/// How often something was so.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ReplanCounts {
    /// Plans that were taken over.
    pub taken: usize,
    /// Times that the arm got stuck.
    pub stuck: usize,
}

/// What is known where a control period begins.
#[derive(Debug)]
pub struct Moment<'a, S: System<D, M>, const D: usize, const M: usize> {
    /// Time \[s\].
    pub t: f64,
    /// That of the obstacles: how long their motions have lasted \[s\].
    pub since: f64,
    /// The clock of the reference, which is another one where a governor makes that wait.
    pub pace: Pace,
    /// Where the joints are, as far as is known \[rad or m\].
    pub q: &'a [f64],
    /// Where the null space draws each of them \[rad or m\], with what stiffness: to where a plan has them; empty if nowhere.
    pub posture: &'a [(f64, f64)],
    /// How far the end effector is off its reference \[m, rad\].
    pub error: &'a Vector<M>,
    /// What it follows: a plan, or a curve.
    pub reference: &'a Trajectory<S::Pose, M>,
    /// What is in the way.
    pub world: &'a World<S::Geometry, D>,
    /// The law that follows.
    pub law: &'a Settings,
}

/// Somebody who makes a plan where a reference leads nowhere.
pub trait Replan<S: System<D, M>, const D: usize, const M: usize>: Debug + Send {
    /// Looks at a moment. What is to be followed from now on, if that is another plan.
    fn look(&mut self, moment: &Moment<'_, S, D, M>) -> Option<Trajectory<S::Pose, M>>;
    /// Looks for a plan at the next moment at which none is searched, whatever is in the way of what is followed.
    fn want(&mut self);
    /// Goes back to t = 0: the first reference.
    fn restart(&mut self) -> Trajectory<S::Pose, M>;
    /// From now on the arm is `arm`, in the state of `robot`, which becomes the one before.
    fn exchange_arm(&mut self, arm: &Arc<S::Arm>, robot: &mut S::State);
    /// From now on no plan asks for more than its settings say, and than this, if anything.
    fn limit(&mut self, limits: Option<&MotionLimits>);
    /// From now on plans in a thread of its own, and takes the time that it takes.
    fn plan_beside(&mut self);
    /// Every search so far.
    fn searches(&self) -> &[Replanned];
    /// What they came to.
    fn counts(&self) -> ReplanCounts;
    /// Another one in the same state, but for a search under way in another thread.
    fn copy(&self) -> Box<dyn Replan<S, D, M>>;
}

impl<S: System<D, M>, const D: usize, const M: usize> Clone for Box<dyn Replan<S, D, M>> {
    fn clone(&self) -> Self {
        self.copy()
    }
}
