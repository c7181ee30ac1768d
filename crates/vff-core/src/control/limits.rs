//! What is given up where the joints cannot do everything at once.
//!
//! Torque limits scale whole objectives, never the torque of one joint alone: that would bend the
//! directions in which the arm accelerates. Objectives are given up in the order of [`OBJECTIVES`],
//! each as far as that helps before the next is touched (T35). Speed limits slow the reference down
//! before any of that (T36), and damp the null space (T37).

use super::{OperationalSpace, Torque};
use crate::field::Field;
use crate::robot::{Limits, Robot};
use nalgebra::SVector;

/// What is given up, first to last, and the share of the reference's speed that is asked for.
pub const OBJECTIVES: [&str; 6] =
    ["posture", "task", "damping", "avoidance", "compensation", "speed"];

/// The share in \[0, 1\] that each of [`OBJECTIVES`] was granted.
pub type ObjectiveScale = [f64; OBJECTIVES.len()];

/// Everything, as long as no limit is in the way.
pub const ALL: ObjectiveScale = [1.0; OBJECTIVES.len()];

/// Place of the reference's speed among [`OBJECTIVES`].
pub const SPEED: usize = 5;

/// How often they are gone through.
const PASSES: usize = 4;
/// What is little of a torque, as a share of its limit.
const SMALL: f64 = 0.1;

/// The torque of each objective but the last, compensation, which is the rest.
///
/// # Example
/// ```
/// use vff_core::control::limits::{Parts, within};
/// use vff_core::control::{ObjectiveScale, Torque};
///
/// let mut parts = Parts::new(1);
/// (parts.task[0], parts.avoidance[0]) = (1.0, 10.0);
/// let mut torque = Torque::zeros(1);
/// let scale: ObjectiveScale = parts.fit(&[[-5.0, 5.0]], &mut torque);
/// assert!(within(&torque.total, &[[-5.0, 5.0]]) && scale.iter().all(|share| (0.0..=1.0).contains(share)));
/// ```
#[derive(Debug, Clone)]
pub struct Parts {
    /// Nᵀ K_v(q_d − q).
    pub posture: Vec<f64>,
    /// Jᵀ Λ ẍ_c.
    pub task: Vec<f64>,
    /// −Nᵀ D_q N q̇.
    pub damping: Vec<f64>,
    /// Nᵀ of all repulsion.
    pub avoidance: Vec<f64>,
    rest: Vec<f64>,
}

impl Parts {
    /// For `n` joints.
    pub fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self {
            posture: zeros(),
            task: zeros(),
            damping: zeros(),
            avoidance: zeros(),
            rest: zeros(),
        }
    }

    /// Scales the objectives of `torque`, so that every τ_i is between its `ends` \[N·m, N\] (T35).
    pub fn fit(&mut self, ends: &[[f64; 2]], torque: &mut Torque) -> ObjectiveScale {
        let Self { posture, task, damping, avoidance, rest } = self;
        let n = rest.len();
        for i in 0..n {
            rest[i] = torque.total[i] - posture[i] - task[i] - damping[i] - avoidance[i];
        }
        let mut objective_scale = ALL;
        // Again, because what was given up may have held another objective back.
        for _ in 0..PASSES {
            let parts = [&*posture, task, damping, avoidance];
            for (share, part) in objective_scale.iter_mut().zip(parts) {
                give_up(share, part, &mut torque.total, ends);
            }
        }
        let kept = share_within(&torque.total, ends);
        objective_scale[..SPEED].iter_mut().for_each(|share| *share *= kept);
        let [of_posture, of_task, of_damping, of_avoidance, of_rest, _] = objective_scale;
        for i in 0..n {
            let in_null = posture[i] + damping[i] + avoidance[i];
            torque.task[i] = of_rest * (torque.task[i] - task[i]) + of_task * task[i];
            torque.null[i] = of_rest * (torque.null[i] - in_null)
                + of_posture * posture[i]
                + of_damping * damping[i]
                + of_avoidance * avoidance[i];
            torque.total[i] = torque.task[i] + torque.null[i];
        }
        objective_scale
    }
}

/// Lowers the `share` of a part that pushes joints of `total` beyond their `ends`, by as much as brings them back. Where it
/// pushes by little, that does not help, so it is lowered by little: where the part is about to push the other way, which leaves
/// it whole, nothing jumps (T35).
fn give_up(share: &mut f64, part: &[f64], total: &mut [f64], ends: &[[f64; 2]]) {
    let mut given_up = 0.0_f64;
    for ((part, total), [low, high]) in part.iter().zip(&*total).zip(ends) {
        let (beyond, outward) =
            if total > high { (total - high, *part) } else { (low - total, -part) };
        if beyond > 0.0 && outward > 0.0 {
            let helps = *share * outward / (SMALL * 0.5 * (high - low));
            given_up = given_up.max((beyond / outward).min(*share * helps));
        }
    }
    if given_up > 0.0 {
        let left = (*share - given_up).max(0.0);
        total.iter_mut().zip(part).for_each(|(total, part)| *total -= (*share - left) * part);
        *share = left;
    }
}

/// The share in \[0, 1\] of a whole torque that is between its ends.
fn share_within(total: &[f64], ends: &[[f64; 2]]) -> f64 {
    total.iter().zip(ends).fold(1.0, |share: f64, (total, [low, high])| {
        let fits = (*low..=*high).contains(total);
        if fits { share } else { share.min((total.max(*low).min(*high) / total).max(0.0)) }
    })
}

/// The largest s ∈ \[0, 1\] with rest + s part in its range at every joint, if there is one.
pub(crate) fn largest_share(
    rest: &[f64],
    part: &[f64],
    ranges: impl Iterator<Item = [f64; 2]>,
) -> Option<f64> {
    let (mut low, mut high) = (0.0_f64, 1.0_f64);
    for ((rest, part), [least, most]) in rest.iter().zip(part).zip(ranges) {
        if *part == 0.0 {
            if *rest < least || *rest > most {
                return None;
            }
            continue;
        }
        let (a, b) = ((least - rest) / part, (most - rest) / part);
        low = low.max(a.min(b));
        high = high.min(a.max(b));
    }
    (low <= high).then_some(high)
}

/// Whether every torque is between its `ends` \[N·m, N\].
pub fn within(tau: &[f64], ends: &[[f64; 2]]) -> bool {
    tau.iter().zip(ends).all(|(tau, [least, most])| (*least..=*most).contains(tau))
}

/// The share of the wanted task velocity `dx_d` that keeps every joint within its speed limit, given
/// what the null motion takes of it already, or gives back where it goes the other way; a tenth of the limit is always
/// left to the task (T36).
pub fn speed_share<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    space: &OperationalSpace<M>,
    dx_d: &SVector<f64, M>,
    limits: &[f64],
) -> f64 {
    const LEAST: f64 = 0.1;
    let (wanted, present) = (space.lambda * dx_d, space.lambda * space.dx);
    let joints = space.y.iter().zip(robot.velocity()).zip(limits);
    joints.fold(1.0, |share: f64, ((y, dq), limit)| {
        let along_task = y.dot(&wanted);
        let in_null = (dq - y.dot(&present)) * along_task.signum();
        let left = (limit - in_null).max(LEAST * limit);
        share.min(left / along_task.abs().max(f64::MIN_POSITIVE))
    })
}

/// Damping of the null space \[1/s\] near the speed limits: from nothing at 80 % of the fastest joint's
/// limit, smoothly, to its full strength at the limit (T37).
pub fn brake(dq: &[f64], limit: &[f64]) -> f64 {
    const STRENGTH: f64 = 50.0;
    let ratio = dq.iter().zip(limit).fold(0.0, |r: f64, (dq, limit)| r.max(dq.abs() / limit));
    let s = ((ratio - 0.8) / 0.2).clamp(0.0, 1.0);
    STRENGTH * s * s * (3.0 - 2.0 * s)
}

/// `out +=` the repulsion of the joint limits, each a field over the angle that is left; returns its
/// potential \[J\] (T38).
pub fn add_joint_limit_torque(field: &Field, limits: &Limits, q: &[f64], out: &mut [f64]) -> f64 {
    let mut potential = 0.0;
    for ((out, q), [lower, upper]) in out.iter_mut().zip(q).zip(&limits.joint) {
        let (from_below, from_above) = (field.at(q - lower), field.at(upper - q));
        *out += from_below.force - from_above.force;
        potential += from_below.potential + from_above.potential;
    }
    potential
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "exact by construction")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(n: usize) -> impl Strategy<Value = Vec<f64>> {
        prop::collection::vec(-10.0..10.0, n)
    }

    /// Posture, task, damping, avoidance, and what compensates in task and null space: as parts and as one torque.
    fn made(parts: &[Vec<f64>]) -> (Parts, Torque) {
        let [posture, task, damping, avoidance, own, null] = parts else { unreachable!() };
        let sum =
            |of: &[&Vec<f64>]| (0..4).map(|i| of.iter().map(|p| p[i]).sum()).collect::<Vec<f64>>();
        let mut split = Parts::new(4);
        (split.posture, split.task, split.damping, split.avoidance) =
            (posture.clone(), task.clone(), damping.clone(), avoidance.clone());
        let torque = Torque {
            total: sum(&[posture, task, damping, avoidance, own, null]),
            task: sum(&[task, own]),
            null: sum(&[posture, damping, avoidance, null]),
        };
        (split, torque)
    }

    fn ends(limit: &[f64]) -> Vec<[f64; 2]> {
        limit.iter().map(|limit| [-*limit, *limit]).collect()
    }

    properties! {
        /// Every joint is within its limit, a torque that fits is left alone, one that does not is used up to a limit, and
        /// the first objective is given up only where it pushes beyond one.
        #[test]
        fn as_far_as_that_helps(parts in prop::collection::vec(vector(4), 6), limit in prop::collection::vec(0.5..30.0, 4)) {
            let (mut split, mut torque) = made(&parts);
            let full = torque.clone();
            let shares = split.fit(&ends(&limit), &mut torque);
            for (tau, limit) in torque.total.iter().zip(&limit) {
                prop_assert!(tau.abs() <= limit * (1.0 + 1e-12) + 1e-12);
            }
            prop_assert!(shares.iter().all(|share| (0.0..=1.0).contains(share)));
            prop_assert!(shares[..4].iter().all(|share| *share <= shares[4]));
            if within(&full.total, &ends(&limit)) {
                prop_assert_eq!(shares, ALL);
                return Ok(());
            }
            let used = (0..4).map(|i| torque.total[i].abs() / limit[i]).fold(0.0, f64::max);
            prop_assert!(used > 1.0 - 1e-9 || shares.contains(&0.0));
            // Alone, the one that comes first.
            let mut first = full.total.clone();
            let mut share = 1.0;
            give_up(&mut share, &parts[0], &mut first, &ends(&limit));
            let helps = |i: usize| full.total[i].abs() > limit[i] && parts[0][i] * full.total[i] > 0.0;
            prop_assert_eq!(share < 1.0, (0..4).any(helps));
            for i in (0..4).filter(|i| helps(*i)) {
                let (beyond, outward) = (full.total[i].abs() - limit[i], parts[0][i].abs());
                let most = beyond.min(outward).min(outward * outward / (SMALL * limit[i]));
                let back = (full.total[i] - first[i]) * full.total[i].signum();
                prop_assert!(back >= most - 1e-12, "{} of {}", back, most);
            }
        }

        /// Where the objectives change by little, what is left of them does as well, also where one of them begins to
        /// push a joint outward that is beyond its limit.
        #[test]
        fn nothing_jumps(
            parts in prop::collection::vec(vector(4), 6), limit in prop::collection::vec(0.5..30.0, 4),
            way in prop::collection::vec(vector(4), 6), turned in (0..6_usize, 0..4_usize),
        ) {
            let moved = |step: f64| {
                let mut parts = parts.clone();
                parts[turned.0][turned.1] = 0.0;
                for (part, way) in parts.iter_mut().zip(&way) {
                    part.iter_mut().zip(way).for_each(|(x, d)| *x += step * d);
                }
                let (mut split, mut torque) = made(&parts);
                split.fit(&ends(&limit), &mut torque);
                torque.total
            };
            let (before, after) = (moved(-1e-11), moved(1e-11));
            let jump = before.iter().zip(&after).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            prop_assert!(jump < 1e-4, "{}", jump);
        }
    }

    /// Where all push the same way, each goes down to nothing before the next is touched.
    #[test]
    fn one_after_the_other() {
        let fitted = |limit: f64| {
            let mut parts = Parts::new(1);
            (parts.posture[0], parts.task[0], parts.damping[0], parts.avoidance[0]) =
                (2.0, 2.0, 3.0, 4.0);
            let mut torque = Torque::zeros(1);
            (torque.total[0], torque.task[0], torque.null[0]) = (15.0, 4.0, 11.0);
            let shares = parts.fit(&[[-limit, limit]], &mut torque);
            let task = 2.0 * shares[4] + 2.0 * shares[1];
            assert_eq!((torque.total[0], torque.task[0]), (limit, task));
            shares
        };
        assert_eq!(fitted(15.0), ALL);
        assert_eq!(fitted(14.0), [0.5, 1.0, 1.0, 1.0, 1.0, 1.0]);
        assert_eq!(fitted(12.0), [0.0, 0.5, 1.0, 1.0, 1.0, 1.0]);
        assert_eq!(fitted(9.5), [0.0, 0.0, 0.5, 1.0, 1.0, 1.0]);
        assert_eq!(fitted(5.0), [0.0, 0.0, 0.0, 0.25, 1.0, 1.0]);
        assert_eq!(fitted(2.0), [0.0, 0.0, 0.0, 0.0, 0.5, 1.0]);
    }

    /// Nothing below 80 % of the limit, everything from the limit on.
    #[test]
    fn brake_sets_in_before_the_limit() {
        assert_eq!(brake(&[0.4, -0.79], &[1.0, 1.0]), 0.0);
        assert!(brake(&[0.0, -0.9], &[1.0, 1.0]) > 1.0);
        assert_eq!(brake(&[1.0, 3.0], &[1.0, 1.0]), 50.0);
    }
}
