//! Whether what a robot says of itself fits together.

use super::ending::Fault;
use crate::math::short_way;
use std::time::Instant;

/// A clock that goes on by so many periods from one to the next, so often in a row, does not count in seconds.
const LEAP: f64 = 100.0;
const LEAPS: u32 = 5;
/// For so long positions are compared with velocities \[s\]; a state that comes later than the longest gap begins anew.
const WINDOW: f64 = 0.05;
const GAP: f64 = 0.01;
/// What velocities say may differ from the way that was gone by so much of it, and at least of this \[rad, m\]: filters lag, and
/// noise sums up. A single wild reading, or a blow behind a filter, makes one time differ, not two in a row.
const SHARE: f64 = 1.5;
const LEAST: f64 = 0.02;
/// Velocities are those of the way backwards, but for such a share of it.
const MIRRORED: f64 = 0.3;
/// Velocities that sweep less than such a share of the way, in so many windows more than others, are in another unit, or none. Where
/// a joint speeds up from rest, a filter of 20 ms leaves 0.4 in one window alone.
const SMALL: f64 = 0.3;
const SMALL_WINDOWS: u32 = 3;

/// What is remembered of the last states. Nothing allocates after construction.
#[derive(Debug)]
pub(super) struct Judge {
    period: f64,
    endless: Vec<bool>,
    /// The robot's time at the last state \[s\], when that came, and for how many periods in a row it has leapt.
    last: f64,
    came: Option<Instant>,
    leaps: u32,
    /// For how long positions have been compared \[s\], since where, the last velocities, and how far these say that joints have gone.
    elapsed: f64,
    from: Vec<f64>,
    before: Vec<f64>,
    told: Vec<f64>,
    /// The same without signs, so that a joint that swings behind a filter is no slow one.
    swept: Vec<f64>,
    /// In how many windows that has been far less than the way; one in which it is enough takes all of them back, rest takes one.
    small: Vec<u32>,
    /// The joint that did not fit last time.
    suspect: Option<usize>,
}

impl Judge {
    /// Of a robot in periods of so long \[s\], and of its first joints, with whether each turns without an end: that may begin anew.
    pub(super) fn new(endless: Vec<bool>, period: f64) -> Self {
        let n = endless.len();
        let zeros = || vec![0.0; n];
        let [from, before, told, swept] = [zeros(), zeros(), zeros(), zeros()];
        let (last, elapsed, came, small, suspect) =
            (f64::NAN, f64::INFINITY, None, vec![0; n], None);
        Self {
            period,
            endless,
            last,
            came,
            leaps: 0,
            elapsed,
            from,
            before,
            told,
            swept,
            small,
            suspect,
        }
    }

    /// What is wrong with the state at `t` \[s\] of the robot's clock, in the light of those before.
    pub(super) fn look(&mut self, t: f64, q: &[f64], dq: &[f64]) -> Option<Fault> {
        let step = t - self.last;
        self.last = t;
        let waited = self.came.replace(Instant::now()).map_or(0.0, |at| at.elapsed().as_secs_f64());
        let period = self.period.max(waited);
        self.leaps = if step > LEAP * period { self.leaps + 1 } else { 0 };
        if self.leaps >= LEAPS {
            return Some(Fault::Clock { step, period: self.period });
        }
        let n = self.from.len();
        let found = self.compare(step, &q[..n], &dq[..n]);
        self.before.copy_from_slice(&dq[..n]);
        found
    }

    /// Compares the ways that joints go with their velocities, a `step` \[s\] after the last state.
    fn compare(&mut self, step: f64, q: &[f64], dq: &[f64]) -> Option<Fault> {
        let Self { period, endless, elapsed, from, before, told, swept, small, suspect, .. } = self;
        if step == 0.0 {
            return None; // no news
        }
        let follows = (0.0..=GAP.max(2.5 * *period)).contains(&step);
        if !follows || *elapsed >= WINDOW {
            *elapsed = 0.0;
            from.copy_from_slice(q);
            told.fill(0.0);
            swept.fill(0.0);
            *suspect = suspect.filter(|_| follows);
            if !follows {
                small.fill(0);
            }
            return None;
        }
        *elapsed += step;
        for (i, (dq, before)) in dq.iter().zip(&*before).enumerate() {
            told[i] += 0.5 * (dq + before) * step;
            swept[i] += 0.5 * (dq.abs() + before.abs()) * step;
        }
        if *elapsed < WINDOW {
            return None;
        }
        let gone = |i: usize| short_way(q[i] - from[i], endless[i]);
        let differs = |i: &usize| (told[*i] - gone(*i)).abs() > SHARE * gone(*i).abs().max(LEAST);
        // The same way backwards is a sign, and throws an arm soon.
        let is_mirrored = |i: &usize| {
            let gone = gone(*i);
            gone.abs() > LEAST && (told[*i] + gone).abs() < MIRRORED * gone.abs()
        };
        let mirrored = (0..q.len()).find(is_mirrored);
        let joint = suspect.filter(differs).or_else(|| (0..q.len()).find(differs));
        let again = joint.filter(|_| *suspect == joint);
        *suspect = joint;
        for (i, small) in small.iter_mut().enumerate() {
            let gone = gone(i).abs();
            *small = match gone > LEAST {
                true if swept[i] < SMALL * gone => *small + 1,
                true => 0,
                false => small.saturating_sub(1),
            };
        }
        let small = small.iter().position(|windows| *windows >= SMALL_WINDOWS);
        let joint = mirrored.or(again).or(small)?;
        Some(Fault::Velocity { joint, gone: gone(joint), told: told[joint], within: *elapsed })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    /// A swing of 0.5 rad at 1 Hz from somewhere on, whose velocity is said `scaled` and `lag` \[s\] late, by a clock that is `fast`.
    fn swung(scale: f64, lag: f64, fast: f64, [rate, phase]: [f64; 2]) -> Option<Fault> {
        let w = TAU;
        let mut judge = Judge::new(vec![false; 2], 1.0 / rate);
        (0..1000).find_map(|k| {
            let t = f64::from(k) / rate;
            let angle = w * t + phase;
            let q = [0.5 * angle.sin(), 1.0];
            judge.look(fast * t, &q, &[0.5 * w * scale * (angle - w * lag).cos(), 0.0])
        })
    }

    #[test]
    fn what_fits_is_let_be_and_what_does_not_is_named() {
        for rate in [10.0, 20.0, 100.0, 1000.0] {
            for phase in (0..20).map(|k| 0.3 * f64::from(k)) {
                let of = [rate, phase];
                let lags: &[f64] = if rate < 100.0 { &[0.0] } else { &[0.0, 0.02] };
                for &lag in lags {
                    assert_eq!(swung(1.0, lag, 1.0, of), None, "{of:?} {lag}");
                }
                // Another sign, degrees, a driver that fills in none, rad in 10 ms, and turns in a second.
                for scale in [-1.0, 180.0 / PI, 0.0, 0.01, 0.16] {
                    let fault = swung(scale, 0.0, 1.0, of);
                    assert!(
                        matches!(fault, Some(Fault::Velocity { joint: 0, .. })),
                        "{of:?} {fault:?}"
                    );
                }
                assert!(matches!(swung(1.0, 0.0, 1000.0, of), Some(Fault::Clock { .. })));
            }
        }
    }

    /// A reading that begins anew after a turn, as that of a joint that shakes about there, is no joint that has turned.
    #[test]
    fn a_turn_that_is_not_counted_is_none() {
        for endless in [true, false] {
            let mut judge = Judge::new(vec![endless], 1e-3);
            let mut noise = crate::math::Noise::new(3, 0);
            let found = (0..2000).find_map(|k| {
                let angle = PI + 1e-4 * noise.draw();
                judge.look(1e-3 * f64::from(k), &[short_way(angle, true)], &[0.0])
            });
            assert_eq!(found.is_none(), endless, "{found:?}");
        }
    }

    /// What a robot that is driven says is let be: it shakes, sets off and stands behind filters, its encoders are noisy, and it creeps
    /// below what its velocities resolve.
    #[test]
    fn what_robots_say_is_let_be() {
        let mut noise = crate::math::Noise::new(7, 0);
        for (amplitude, hertz) in
            [(0.3, 1.0), (0.05, 3.0), (0.03, 4.0), (0.01, 6.0), (0.005, 9.8), (0.02, 0.5)]
        {
            for lag in [0.0, 0.01, 0.02] {
                let w = TAU * hertz;
                let (mut judge, mut said) = (Judge::new(vec![false; 2], 1e-3), 0.0);
                let mut moved = 0.0;
                for k in 0..20_000 {
                    let t = 1e-3 * f64::from(k);
                    // Every second half of a second it sets off at once, and stands still in the other.
                    let moves = k / 500 % 2 == 0;
                    moved += if moves { 1e-3 } else { 0.0 };
                    let (q, dq) =
                        (amplitude * (w * moved).sin(), amplitude * w * (w * moved).cos());
                    let dq = if moves { dq } else { 0.0 };
                    said += (dq - said) * 1e-3 / (lag + 1e-3);
                    let [a, b, c, d] = std::array::from_fn(|_| noise.draw());
                    let q = [q + 1e-3 * a, 0.05 * t + 3e-3 * b];
                    let found = judge.look(t, &q, &[said + 0.05 * c, 0.05 * d]);
                    assert_eq!(found, None, "{amplitude} {hertz} {lag} {k}");
                }
            }
        }
    }

    /// One that is wild, or a joint that a blow stops behind a filter, is no other language.
    #[test]
    fn one_reading_is_no_language() {
        for at in 60..160 {
            let mut judge = Judge::new(vec![false], 1e-3);
            let mut said = 2.6;
            for k in 0..400 {
                let t = 1e-3 * f64::from(k);
                let stopped = 1e-3 * f64::from(at);
                let (q, dq) = if k < at { (2.6 * t, 2.6) } else { (2.6 * stopped, 0.0) };
                said += (dq - said) * 1e-3 / 0.02;
                let told = if k == at + 220 { 500.0 } else { said };
                assert_eq!(judge.look(t, &[q], &[told]), None, "{at} {k}");
            }
        }
    }
}
