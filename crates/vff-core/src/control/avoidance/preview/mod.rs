//! Look-ahead on top of `cbf` (T71–T73, T83): whether the arm, if the controller carries on as it is, will be hit
//! soon, and if so, which motion of the next seconds avoids it. That motion becomes the nominal one of the QP, which
//! still guards every distance and limit.
//!
//! - `candidate`: a motion that is tried, and what it costs.
//! - `rollout`: what a candidate leads to, for the arm as a chain without mass.
//! - `closed_loop_rollout`: what the law itself leads to, with all dynamics.
//! - `prediction`: the obstacles at later instants.
//! - `self_motion`: the best way along the self-motion, where that is a curve.
//! - `planning_cycle`: when which of these is computed, and what becomes of the result.

mod candidate;
mod closed_loop_rollout;
#[cfg(test)]
mod fixtures;
mod planning_cycle;
mod prediction;
mod rollout;
mod self_motion;

#[cfg(feature = "scenario")] // which validates by it
pub(crate) use closed_loop_rollout::fastest_rate;
pub use planning_cycle::Preview;
pub use self_motion::SelfMotionMap;

/// Where roll-outs begin.
#[derive(Debug)]
pub struct Present<'a, R> {
    /// The arm at the observed state.
    pub robot: &'a R,
    /// Behind a limit of the torque rate the torque of the law that acts \[N·m, N\].
    pub sent: Option<&'a [f64]>,
    /// What acts beside it and the model does not know, as estimated \[N·m, N\]; empty if nobody does.
    pub unknown: &'a [f64],
}

/// How many of `count` equal parts of a piece of work must be done after this share of its time: all of them if the
/// share is infinite.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "few parts, and the cast of infinity is the largest number"
)]
fn due(count: usize, share: f64) -> usize {
    (count as f64 * share - 1e-9).ceil() as usize
}
