//! Where the arm was when a picture was taken: its last states, and what lies between them.

use super::PerceptionError;
use crate::math::short_way;
use crate::robot::Model;
use crate::robot::SpatialArm;

/// States that are kept: a quarter of a second at 1 kHz, and more.
const KEPT: usize = 512;
/// A state that is later than the one before by more than this has leapt \[s\].
pub(super) const LEAP: f64 = 1.0;
/// So many states after a leap can be dropped: the next one shows that the clock has leapt.
const TRIAL: usize = 16;
/// What has leapt by more than this is not believed before there are more of them \[s\].
const FAR: f64 = 10.0;

/// The last states, one after the other in time.
#[derive(Debug, Clone)]
pub(super) struct History {
    n: usize,
    /// Joints that turn without an end, whose angles may begin anew after a turn.
    is_endless: Vec<bool>,
    /// Instants \[s\], and n angles and n velocities each, in a ring.
    times: Vec<f64>,
    states: Vec<f64>,
    /// Where the next one comes to stand.
    next: usize,
}

impl History {
    /// Of joints that turn without an end or do not, without a state as yet.
    pub(super) fn new(is_endless: Vec<bool>) -> Self {
        Self { n: is_endless.len(), is_endless, times: vec![], states: vec![], next: 0 }
    }

    /// The same of the joints of an arm.
    pub(super) fn of(arm: &SpatialArm) -> Self {
        Self::new(arm.endless())
    }

    /// Goes on with another arm of as many joints.
    pub(super) fn set_arm(&mut self, arm: &SpatialArm) {
        self.is_endless = arm.endless();
    }

    /// Forgets all.
    pub(super) fn forget(&mut self) {
        self.times.clear();
        self.states.clear();
        self.next = 0;
    }

    /// Place of the oldest state.
    fn first(&self) -> usize {
        if self.times.len() < KEPT { 0 } else { self.next }
    }

    /// Place of the k-th state, from the oldest.
    fn place(&self, k: usize) -> usize {
        (self.first() + k) % self.times.len()
    }

    /// Instant of the k-th state, from the oldest \[s\].
    fn time(&self, k: usize) -> f64 {
        self.times[self.place(k)]
    }

    /// Places of the oldest `count` states, from the oldest.
    fn places(&self, count: usize) -> impl DoubleEndedIterator<Item = usize> + '_ {
        (0..count).map(|k| self.place(k))
    }

    /// When the newest state was \[s\]; none before the first.
    pub(super) fn newest(&self) -> Option<f64> {
        self.times.len().checked_sub(1).map(|last| self.time(last))
    }

    /// Takes in the state at time `t` \[s\], which is later than the last, or than the last before a leap that it shows to be none:
    /// one wrong time in the future would otherwise refuse all states from then on. Whether it has taken states back.
    pub(super) fn add(&mut self, t: f64, q: &[f64], dq: &[f64]) -> Result<bool, PerceptionError> {
        let last = self.times.len().checked_sub(1).map(|k| self.time(k));
        let is_back = last.is_some_and(|last| t <= last);
        if !t.is_finite() || (is_back && !self.take_back(t)) {
            return Err(PerceptionError::NotLater { given: t, last });
        }
        if self.times.len() < KEPT {
            self.times.push(t);
            self.states.extend(q.iter().chain(dq));
        } else {
            let begin = 2 * self.n * self.next;
            self.times[self.next] = t;
            self.states[begin..begin + self.n].copy_from_slice(q);
            self.states[begin + self.n..begin + 2 * self.n].copy_from_slice(dq);
        }
        self.next = (self.next + 1) % KEPT;
        Ok(is_back)
    }

    /// Drops the states after a leap that is not believed as yet, if one at time `t` \[s\] goes on where they leapt from; and the first
    /// one of all, if it is the only one and the next is as much earlier. Returns whether it did.
    fn take_back(&mut self, t: f64) -> bool {
        let count = self.times.len();
        let time = |k: usize| self.time(k);
        let has_leapt = |k: &usize| match k.checked_sub(1).map(time) {
            Some(before) => before < t && t - before <= LEAP && time(*k) - before > LEAP,
            None => count == 1 && time(0) - t > LEAP,
        };
        let Some(kept) = (count.saturating_sub(TRIAL)..count).rev().find(has_leapt) else {
            return false;
        };
        let first = self.first();
        self.times.rotate_left(first);
        self.times.truncate(kept);
        self.states.rotate_left(2 * self.n * first);
        self.states.truncate(2 * self.n * kept);
        self.next = kept;
        true
    }

    fn state(&self, place: usize) -> (&[f64], &[f64]) {
        self.states[2 * self.n * place..2 * self.n * (place + 1)].split_at(self.n)
    }

    /// How many of the states are believed, the oldest: not those after a large leap that may yet be taken back, as long as they are
    /// fewer than those before.
    fn believed(&self) -> usize {
        let count = self.times.len();
        let leaps = |k: &usize| count - *k < *k && self.time(*k) - self.time(*k - 1) > FAR;
        (count.saturating_sub(TRIAL)..count).find(leaps).unwrap_or(count)
    }

    /// Angles and velocities at time `t` \[s\] (T182): between two states the cubic that has both at both. Returns for how long
    /// there was none \[s\], which is 0 there: before the first and after the last it goes on at constant velocity. None if no
    /// state that is believed is known `within` that time \[s\]: what the arm did in a gap nobody knows.
    pub(super) fn at(&self, t: f64, within: f64, q: &mut [f64], dq: &mut [f64]) -> Option<f64> {
        let believed = self.believed();
        let places = || self.places(believed).rev();
        let after = places().take_while(|place| self.times[*place] >= t).last();
        let before = places().find(|place| self.times[*place] <= t);
        let off = |place: &usize| (t - self.times[*place]).abs();
        let nearest = before.iter().chain(&after).map(off).fold(f64::INFINITY, f64::min);
        // Not more exactly than times can be written.
        if nearest > within + 1e-9 {
            return None;
        }
        let (from, to) = match (before, after) {
            (None, None) => return None,
            (Some(from), Some(to)) if from != to => (from, to),
            (Some(place), _) | (None, Some(place)) => {
                let (angles, velocities) = self.state(place);
                let missing = t - self.times[place];
                dq.copy_from_slice(velocities);
                for (q, (angle, velocity)) in q.iter_mut().zip(angles.iter().zip(velocities)) {
                    *q = angle + velocity * missing;
                }
                return Some(missing.abs());
            }
        };
        let ((q0, dq0), (q1, dq1)) = (self.state(from), self.state(to));
        let h = self.times[to] - self.times[from];
        let s = (t - self.times[from]) / h;
        for i in 0..self.n {
            let way = short_way(q1[i] - q0[i], self.is_endless[i]);
            let [a, b] = [dq0[i] * h, dq1[i] * h];
            let [second, third] = [3.0 * way - 2.0 * a - b, a + b - 2.0 * way];
            q[i] = q0[i] + s * (a + s * (second + s * third));
            dq[i] = (a + s * (2.0 * second + 3.0 * s * third)) / h;
        }
        Some(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// A cubic in time is met exactly between states, older ones are forgotten, and outside it goes on.
    #[test]
    fn between_states_is_a_cubic() {
        let q = |t: f64| 0.3 + t * (0.5 + t * (-0.7 + 0.2 * t));
        let dq = |t: f64| 0.5 + t * (-1.4 + 0.6 * t);
        let mut history = History::new(vec![false]);
        assert!(history.at(0.0, 1.0, &mut [0.0], &mut [0.0]).is_none());
        let last = 0.01 * (KEPT + 99) as f64;
        for k in 0..KEPT + 100 {
            let t = 0.01 * k as f64;
            history.add(t, &[q(t)], &[dq(t)]).unwrap();
        }
        let (mut angle, mut velocity) = ([0.0], [0.0]);
        for t in [last - 0.003, last - 1.2345, last - 4.0, last] {
            assert_eq!(history.at(t, 5e-3, &mut angle, &mut velocity), Some(0.0));
            assert!((angle[0] - q(t)).abs() < 1e-9 && (velocity[0] - dq(t)).abs() < 1e-7, "{t}");
        }
        let missing = history.at(last + 0.2, 1.0, &mut angle, &mut velocity).unwrap();
        assert!((missing - 0.2).abs() < 1e-12);
        assert!((angle[0] - q(last) - 0.2 * dq(last)).abs() < 1e-9);
        let missing = history.at(0.5, 1.0, &mut angle, &mut velocity).unwrap();
        assert!((missing - 0.5).abs() < 1e-9, "the first 100 are forgotten: {missing}");
        assert!(history.add(last, &[0.0], &[0.0]).is_err());
    }

    /// What the arm did where states are missing is not made up, and beyond the last it is known as long as is said.
    #[test]
    fn a_gap_is_not_bridged() {
        let mut history = History::new(vec![false]);
        history.add(0.0, &[0.0], &[0.0]).unwrap();
        history.add(2.0, &[1.0], &[0.0]).unwrap();
        let at = |history: &History, t: f64| history.at(t, 0.05, &mut [0.0], &mut [0.0]);
        assert_eq!([0.0, 0.04, 1.96, 2.0].map(|t| at(&history, t)), [Some(0.0); 4]);
        assert_eq!([0.06, 1.0, 1.9, 2.06].map(|t| at(&history, t)), [None; 4]);
        // So far it may have leapt by mistake; two after it are as many as before.
        history.add(50.0, &[1.0], &[0.0]).unwrap();
        assert_eq!([2.0, 50.0].map(|t| at(&history, t)), [Some(0.0), None]);
        history.add(50.01, &[1.0], &[0.0]).unwrap();
        assert_eq!([2.0, 50.0].map(|t| at(&history, t)), [Some(0.0); 2]);
    }

    /// Wrong times in the future are dropped by the next state that goes on where they leapt from, also where the ring is full; a clock
    /// that truly leaps is kept, and once it is believed nothing of the old one is taken in.
    #[test]
    fn a_wrong_time_is_taken_back() {
        for before in [1, 40, KEPT, KEPT + 100] {
            let mut history = History::new(vec![false]);
            let mut t = 0.0;
            let add = |history: &mut History, t: f64| history.add(t, &[t], &[1.0]);
            for _ in 0..before {
                t += 0.01;
                add(&mut history, t).unwrap();
            }
            for wrong in [1e6, 1e6 + 0.01, 3e6] {
                add(&mut history, wrong).unwrap();
            }
            assert!(add(&mut history, t).is_err(), "no later than the last");
            for _ in 0..30 {
                t += 0.01;
                add(&mut history, t).unwrap();
            }
            assert_eq!(history.times.len(), (before + 30).min(KEPT));
            for back in [0.005, 0.245] {
                let mut q = [0.0];
                assert_eq!(history.at(t - back, 0.02, &mut q, &mut [0.0]), Some(0.0));
                assert!((q[0] - (t - back)).abs() < 1e-9, "{before}: {q:?}");
            }
            for k in 0..=TRIAL {
                add(&mut history, 1e3 + 0.01 * k as f64).unwrap();
            }
            assert!(add(&mut history, t + 0.01).is_err());
            assert_eq!(history.at(1e3 + 0.1, 0.02, &mut [0.0], &mut [0.0]), Some(0.0));
        }
        let mut history = History::new(vec![false]);
        for t in [1e6, 0.0, 0.01] {
            history.add(t, &[0.0], &[0.0]).unwrap();
        }
        assert!(history.add(-0.5, &[0.0], &[0.0]).is_err());
    }

    /// An angle that begins anew at half a turn has gone the short way; one that has an end has not.
    #[test]
    fn an_endless_joint_goes_the_short_way() {
        let mut history = History::new(vec![true, false]);
        let (before, after) = (PI - 0.005, 0.005 - PI);
        history.add(0.0, &[before; 2], &[1.0; 2]).unwrap();
        history.add(0.01, &[after; 2], &[1.0; 2]).unwrap();
        let (mut q, mut dq) = ([0.0; 2], [0.0; 2]);
        assert_eq!(history.at(5e-3, 0.05, &mut q, &mut dq), Some(0.0));
        assert!((q[0] - PI).abs() < 1e-9 && (dq[0] - 1.0).abs() < 1e-9, "{q:?} {dq:?}");
        assert!(q[1].abs() < 1e-9 && dq[1].abs() > 100.0, "{q:?} {dq:?}");
    }
}
