//! Where the arm was when a picture was taken: its last states, and what lies between them.

use super::PerceptionError;

/// States that are kept: a quarter of a second at 1 kHz, and more.
const KEPT: usize = 512;

/// The last states, one after the other in time.
#[derive(Debug, Clone)]
pub(super) struct History {
    n: usize,
    /// Instants \[s\], and n angles and n velocities each, in a ring.
    times: Vec<f64>,
    states: Vec<f64>,
    /// Where the next one comes to stand.
    next: usize,
}

impl History {
    /// Of n joints, without a state as yet.
    pub(super) fn new(n: usize) -> Self {
        Self { n, times: vec![], states: vec![], next: 0 }
    }

    /// Forgets all.
    pub(super) fn forget(&mut self) {
        self.times.clear();
        self.states.clear();
        self.next = 0;
    }

    /// Places of the states, from the oldest.
    fn places(&self) -> impl DoubleEndedIterator<Item = usize> + '_ {
        let count = self.times.len();
        let first = if count < KEPT { 0 } else { self.next };
        (0..count).map(move |k| (first + k) % count)
    }

    /// Takes in the state at time `t` \[s\], which is later than the last.
    pub(super) fn add(&mut self, t: f64, q: &[f64], dq: &[f64]) -> Result<(), PerceptionError> {
        let last = self.places().next_back().map(|place| self.times[place]);
        if !t.is_finite() || last.is_some_and(|last| t <= last) {
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
        Ok(())
    }

    fn state(&self, place: usize) -> (&[f64], &[f64]) {
        self.states[2 * self.n * place..2 * self.n * (place + 1)].split_at(self.n)
    }

    /// Angles and velocities at time `t` \[s\] (T182): between two states the cubic that has both at both. Returns for how long
    /// there was none \[s\], which is 0 there: before the first and after the last it goes on at constant velocity. None if no
    /// state is known at all.
    pub(super) fn at(&self, t: f64, q: &mut [f64], dq: &mut [f64]) -> Option<f64> {
        let after = self.places().find(|place| self.times[*place] >= t);
        let before = self.places().rev().find(|place| self.times[*place] <= t);
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
            let (way, a, b) = (q1[i] - q0[i], dq0[i] * h, dq1[i] * h);
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

    /// A cubic in time is met exactly between states, older ones are forgotten, and outside it goes on.
    #[test]
    fn between_states_is_a_cubic() {
        let q = |t: f64| 0.3 + t * (0.5 + t * (-0.7 + 0.2 * t));
        let dq = |t: f64| 0.5 + t * (-1.4 + 0.6 * t);
        let mut history = History::new(1);
        assert!(history.at(0.0, &mut [0.0], &mut [0.0]).is_none());
        let last = 0.01 * (KEPT + 99) as f64;
        for k in 0..KEPT + 100 {
            let t = 0.01 * k as f64;
            history.add(t, &[q(t)], &[dq(t)]).unwrap();
        }
        let (mut angle, mut velocity) = ([0.0], [0.0]);
        for t in [last - 0.003, last - 1.2345, last - 4.0, last] {
            assert_eq!(history.at(t, &mut angle, &mut velocity), Some(0.0));
            assert!((angle[0] - q(t)).abs() < 1e-9 && (velocity[0] - dq(t)).abs() < 1e-7, "{t}");
        }
        let missing = history.at(last + 0.2, &mut angle, &mut velocity).unwrap();
        assert!((missing - 0.2).abs() < 1e-12);
        assert!((angle[0] - q(last) - 0.2 * dq(last)).abs() < 1e-9);
        let missing = history.at(0.5, &mut angle, &mut velocity).unwrap();
        assert!((missing - 0.5).abs() < 1e-9, "the first 100 are forgotten: {missing}");
        assert!(history.add(last, &[0.0], &[0.0]).is_err());
    }
}
