//! How set points leave a plan that is blocked: what moves the joints may be too slow to go over to another motion on the way, as a torque
//! does. Then the arm stops along the plan that it is on first, and the other motion begins there.

use super::super::motion::STEP;
use super::change::place_at;
use crate::control::MotionLimits;
use crate::interrupt;
use crate::math::coming_to_rest;
use crate::trajectory::JointSpline;

/// So much of the plan as it was stands before, so that the motion has its velocity where it begins \[s\].
const BEFORE: usize = 10;
/// Stops take from so long to so long \[s\], each by that factor longer than the last one that is tried.
const DURATIONS: [f64; 2] = [0.1, 6.0];
const LONGER: f64 = 1.2;
/// Instants at which one is looked at, of which nothing is known between.
const INSTANTS: u32 = 64;
const CERTAIN: f64 = 0.97;
/// By this factor more jerk than there is is followed nearly as well.
const SHARPER: f64 = 1.2;
/// What a quintic from a velocity to rest has of acceleration and jerk at most, for a velocity and a time of 1.
const QUINTIC: [f64; 2] = [3.94, 36.0];

/// A stop along a plan.
#[derive(Debug, Clone)]
pub struct Braking {
    /// When it begins, by the clock of the plan, and how long it lasts \[s\].
    start: f64,
    duration: f64,
    /// Where the joints are at its knots, the first [`BEFORE`] of them before its start \[rad or m\].
    points: Vec<Vec<f64>>,
}

impl Braking {
    /// Along `plan` from its time `start` \[s\] on, where another motion could not take over within `blend` \[s\] with this share of what
    /// the joints are `able` to. None if it could, or they are not able to stop either.
    pub fn along(
        plan: &JointSpline,
        start: f64,
        able: &MotionLimits,
        [blend, share]: [f64; 2],
    ) -> Option<Self> {
        let n = able.speed.len();
        let mut state = [0; 3].map(|_| vec![0.0; n]);
        plan.at(start, state.each_mut().map(Vec::as_mut_slice));
        let is_strained = state[1].iter().zip(able.acceleration.iter().zip(&able.jerk)).any(
            |(speed, (acceleration, jerk))| {
                let [first, second] = QUINTIC.map(|peak| peak * speed.abs());
                first > share * acceleration * blend || second > share * jerk * blend * blend
            },
        );
        if !is_strained {
            return None;
        }
        let [shortest, longest] = DURATIONS;
        let mut this = Self { start, duration: shortest, points: vec![] };
        while !this.is_kept(plan, able) {
            this.duration *= LONGER;
            if this.duration > longest {
                return None;
            }
        }
        let places = this.times().into_iter().map(|t| place_at(plan, this.clock(t).0));
        this.points = places.collect();
        Some(this)
    }

    /// The path time σ \[s\], its rate and that of the rate, so long after the start \[s\].
    fn clock(&self, t: f64) -> (f64, f64, f64) {
        let [passed, rate, change] = coming_to_rest(t, self.duration);
        (self.start + passed, rate, change)
    }

    /// Whether the joints are able to.
    fn is_kept(&self, plan: &JointSpline, able: &MotionLimits) -> bool {
        let n = able.speed.len();
        let (mut state, mut before) = ([0; 3].map(|_| vec![0.0; n]), vec![0.0; n]);
        let h = self.duration / f64::from(INSTANTS);
        (0..=INSTANTS).all(|k| {
            interrupt::checkpoint(32 * n);
            let (sigma, rate, change) = self.clock(h * f64::from(k));
            plan.at(sigma, state.each_mut().map(Vec::as_mut_slice));
            let [_, dq, ddq] = &state;
            (0..n).all(|i| {
                let acceleration = ddq[i] * rate * rate + dq[i] * change;
                let jerk = if k == 0 { 0.0 } else { (acceleration - before[i]) / h };
                before[i] = acceleration;
                // Of the plan itself what it asks for is taken as it is.
                let most = (CERTAIN * able.acceleration[i]).max(ddq[i].abs());
                acceleration.abs() <= most && jerk.abs() <= SHARPER * able.jerk[i]
            })
        })
    }

    /// The instants of its knots after the start \[s\].
    #[expect(clippy::cast_precision_loss, reason = "a few hundred")]
    fn times(&self) -> Vec<f64> {
        let before = (1..=BEFORE).rev().map(|k| -STEP * k as f64);
        let count = (self.duration / STEP).ceil();
        let after = (0..).map(|k| k as f64).take_while(|k| *k <= count);
        before.chain(after.map(|k| self.duration * k / count)).collect()
    }

    /// How long it lasts \[s\].
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Where it ends \[rad or m\].
    pub fn end(&self) -> &[f64] {
        self.points.last().map_or(&[], Vec::as_slice)
    }

    /// Whether it is too late for it at this time of the plan's clock \[s\]: the arm has gone on.
    pub fn is_over(&self, time: f64) -> bool {
        time > self.start + self.duration / 4.0
    }

    /// Instants, by the clock of the plan that is left \[s\], and places of it and a motion from its end on, which has these after its
    /// beginning; and how many of the knots are its own.
    pub fn then(&self, times: &[f64], points: &[Vec<f64>]) -> (Vec<f64>, Vec<Vec<f64>>, usize) {
        let own = self.times().into_iter().map(|t| self.start + t);
        let others = times.iter().skip(1).map(|t| self.start + self.duration + t);
        let all = self.points.iter().chain(points.iter().skip(1)).cloned();
        (own.chain(others).collect(), all.collect(), self.points.len() - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Along random plans: it goes on as the plan moved, asks for no more than there is, or than the plan does, stays on the plan, and ends
    /// at rest where another motion goes on.
    #[test]
    fn it_is_a_stop_on_the_plan() {
        let mut found = 0;
        for seed in 0..40 {
            let mut noise = crate::math::Noise::new(seed, 3);
            let times: Vec<f64> = (0..6).map(|k| 0.6 * f64::from(k)).collect();
            let points: Vec<Vec<f64>> =
                (0..6).map(|k| vec![0.5 * f64::from(k), 0.2 * noise.draw()]).collect();
            let plan = JointSpline::new(&times, &points).unwrap();
            let peaks = plan.peaks();
            let more = |x: &[f64], by: f64| x.iter().map(|x| by * x).collect();
            let able = MotionLimits {
                speed: more(&peaks.speeds, 1.1),
                acceleration: more(&peaks.accelerations, 1.1),
                jerk: more(&peaks.jerks, 1.1),
            };
            let start = 1.0 + 0.3 * noise.share();
            let Some(braking) = Braking::along(&plan, start, &able, [0.5, 0.1]) else { continue };
            found += 1;
            let beyond: Vec<Vec<f64>> = (0..4)
                .map(|k| braking.end().iter().map(|q| q + 0.02 * f64::from(k * k)).collect())
                .collect();
            let (times, points, more) = braking.then(&[0.0, 0.3, 0.6, 0.9], &beyond);
            assert_eq!((times.len(), points.len()), (more + 4, more + 4));
            assert_eq!(points[more], braking.end());
            let both = JointSpline::new(&times, &points).unwrap();
            let at = |plan: &JointSpline, t: f64| {
                let mut state = [0; 3].map(|_| vec![0.0; 2]);
                plan.at(t, state.each_mut().map(Vec::as_mut_slice));
                state
            };
            let [there, here] = [at(&plan, start), at(&both, start)];
            for (k, most) in [1e-3, 1e-2, 0.2].into_iter().enumerate() {
                let off = (0..2).map(|i| (there[k][i] - here[k][i]).abs()).fold(0.0, f64::max);
                assert!(off < most * (1.0 + there[k][0].abs()), "{seed}: {k} off by {off}");
            }
            let stop = at(&both, start + braking.duration());
            assert!(stop[1].iter().all(|dq| dq.abs() < 0.05), "{seed}: {stop:?}");
            for k in 0..=200 {
                let t = braking.duration() * f64::from(k) / 200.0;
                let (sigma, ..) = braking.clock(t);
                let [on_plan, now] = [at(&plan, sigma), at(&both, start + t)];
                for i in 0..2 {
                    assert!((on_plan[0][i] - now[0][i]).abs() < 2e-3, "{seed}: {t}");
                    assert!(now[2][i].abs() < 1.25 * able.acceleration[i], "{seed}: {now:?}");
                }
            }
            assert!(!braking.is_over(start) && braking.is_over(start + braking.duration()));
        }
        assert!(found > 10, "{found}");
    }

    /// What is slow enough goes over to another motion on the way.
    #[test]
    fn slow_motions_need_none() {
        let plan = JointSpline::new(&[0.0, 5.0], &[vec![0.0], vec![0.5]]).unwrap();
        let able = MotionLimits { speed: vec![1.0], acceleration: vec![5.0], jerk: vec![100.0] };
        assert!(Braking::along(&plan, 2.5, &able, [0.5, 0.5]).is_none());
        assert!(Braking::along(&plan, 2.5, &able, [0.5, 0.01]).is_some());
    }
}
