//! Whether an arm comes nearer to where its reference leads.

use crate::simulation::{Reason, ReplanSettings};

/// Where an arm is on its way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Whether its end effector is not where the reference is.
    pub is_off: bool,
    /// How far the joint is from the plan that is farthest from it \[rad or m\].
    pub from_plan: f64,
    /// How much is left to the end: of the joint that has farthest to go along a plan, or of the end effector to where a curve leads
    /// \[rad or m\].
    pub left: f64,
}

/// What has to be gained on the way to the goal \[rad or m\] to be progress.
const PROGRESS: f64 = 0.01;

/// Whether the arm is on its plan, and comes nearer to its end.
#[derive(Debug, Clone)]
pub(super) struct Progress {
    /// Since when it has been off its plan \[s\].
    off_since: Option<f64>,
    /// The nearest that it has been to the end \[rad or m\], and when that was \[s\].
    pub nearest: [f64; 2],
    is_stuck: bool,
    pub times_stuck: usize,
}

impl Default for Progress {
    fn default() -> Self {
        let nearest = [f64::INFINITY, f64::NEG_INFINITY];
        Self { off_since: None, nearest, is_stuck: false, times_stuck: 0 }
    }
}

impl Progress {
    /// Hears where the arm is at time `t` \[s\].
    pub fn look(&mut self, t: f64, place: Place, settings: &ReplanSettings) -> Option<Reason> {
        let Place { is_off, from_plan, left } = place;
        // An elbow that makes room while the end effector is where it should be has not lost its way.
        let strayed = if is_off && from_plan > settings.stray {
            t - *self.off_since.get_or_insert(t) >= settings.patience
        } else {
            self.off_since = None;
            false
        };
        let [nearest, since] = self.nearest;
        if !is_off || left < nearest - PROGRESS {
            self.nearest = [left, t];
            self.is_stuck = false;
        } else if t - since >= settings.patience {
            self.nearest[1] = t;
            self.times_stuck += usize::from(!self.is_stuck);
            self.is_stuck = true;
            return Some(Reason::Stuck);
        }
        if strayed {
            self.off_since = Some(t);
            return Some(Reason::Strayed);
        }
        None
    }
}
