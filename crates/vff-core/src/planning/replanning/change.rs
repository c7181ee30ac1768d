//! The motion of a plan as it takes the place of what is followed: from when on, what its links keep, and where the posture comes from.

use super::super::feasibility::MAX_SPEED;
use super::super::motion::Plan;
use super::braking::Braking;
use crate::trajectory::JointSpline;

/// Of a joint, a plan that takes over at full speed may be so far off \[rad or m\].
const NEXT_TO: f64 = 0.02;
/// What a quintic from one place to another within a time has of velocity and acceleration at most, for ways and times of 1.
const QUINTIC: [f64; 2] = [1.875, 5.774];

/// Where a plan has the joints at a time of its clock \[rad or m\].
pub fn place_at(plan: &JointSpline, time: f64) -> Vec<f64> {
    let mut state = [0; 3].map(|_| vec![0.0; plan.dof()]);
    plan.at(time, state.each_mut().map(Vec::as_mut_slice));
    let [q, ..] = state;
    q
}

/// When one takes the place of the other by the clock of the reference, and within what time \[s\].
#[derive(Debug, Clone, Copy)]
pub struct Change {
    pub time: f64,
    pub blend: f64,
}

impl Change {
    /// Whether a joint is too far from where an `old` plan has it now to where another one begins, for this share of its largest speed, as
    /// far as that is known, and of an acceleration.
    pub fn is_far(
        self,
        old: &JointSpline,
        new: &[f64],
        (speeds, acceleration): (&[f64], f64),
        share: f64,
    ) -> bool {
        let Self { time, blend } = self;
        let most = |i: usize| {
            let fastest = speeds.get(i).copied().unwrap_or(MAX_SPEED);
            let ways = [fastest * blend, acceleration * blend * blend];
            let way = (ways[0] / QUINTIC[0]).min(ways[1] / QUINTIC[1]);
            (share * way).max(NEXT_TO)
        };
        let there = place_at(old, time);
        there.iter().zip(new).enumerate().any(|(i, (old, new))| (old - new).abs() > most(i))
    }

    /// The motion of a `plan` for `n` joints from now on, or after they have stopped along the `old` one; every link keeps on what it keeps
    /// along that, or `usual` \[m\]. None if its numbers are of no use.
    pub fn motion(
        self,
        plan: &Plan,
        n: usize,
        braking: Option<&Braking>,
        old: Option<&JointSpline>,
        usual: f64,
    ) -> Option<JointSpline> {
        let rows =
            |numbers: &[f64]| -> Vec<Vec<f64>> { numbers.chunks(n).map(<[f64]>::to_vec).collect() };
        let (times, points, more) = match braking {
            Some(braking) => braking.then(&plan.times, &rows(&plan.q)),
            None => {
                let times = plan.times.iter().map(|t| self.time + t);
                (times.collect(), rows(&plan.q), 0)
            }
        };
        // On the way to where the plan begins they keep what they do there.
        let rows = |numbers: &[f64]| -> Vec<Vec<f64>> {
            let all = rows(numbers);
            let first = all.first().cloned();
            first.into_iter().flat_map(|first| vec![first; more]).chain(all).collect()
        };
        let shares = Some(rows(&plan.shares)).filter(|shares| !shares.is_empty());
        let joints = JointSpline::new(&times, &points).ok()?;
        let joints = joints.keeping(&rows(&plan.margins), shares.as_deref()).ok()?;
        Some(joints.keeping_on(old, usual, self.time, self.blend))
    }

    /// The same motion, to which the posture comes from where it is: along an `old` plan as it moves there, else at rest at `posture`, which
    /// has no numbers if it is nowhere.
    pub fn draw(
        self,
        joints: JointSpline,
        old: Option<&JointSpline>,
        posture: &[(f64, f64)],
    ) -> JointSpline {
        let Self { time, blend } = self;
        let Some(old) = old else {
            let rest = posture.iter().map(|(q, _)| [*q, 0.0, 0.0]);
            return joints.drawing_from(rest, time, blend);
        };
        let mut state = [0; 3].map(|_| vec![0.0; old.dof()]);
        old.at(time, state.each_mut().map(Vec::as_mut_slice));
        old.draw(time, state.each_mut().map(Vec::as_mut_slice));
        let each = (0..old.dof()).map(|i| [0, 1, 2].map(|k| state[k][i]));
        joints.drawing_from(each, time, blend)
    }
}
