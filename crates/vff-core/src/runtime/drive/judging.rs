//! Whether what a robot says of itself fits together.

use super::ending::Fault;

/// A clock that goes on by so many periods from one to the next, so often in a row, does not count in seconds.
const LEAP: f64 = 100.0;
const LEAPS: u32 = 5;
/// For so long positions are compared with velocities \[s\]; a state that comes later than the longest gap begins anew.
const WINDOW: f64 = 0.05;
const GAP: f64 = 0.01;
/// What velocities say may differ from the way that was gone by so much of it, and at least of this \[rad, m\]: filters lag, and
/// noise sums up.
const SHARE: f64 = 1.5;
const LEAST: f64 = 0.02;

/// What is remembered of the last states. Nothing allocates after construction.
#[derive(Debug)]
pub(super) struct Judge {
    period: f64,
    /// The robot's time at the last state \[s\], and for how many periods in a row it has leapt.
    last: f64,
    leaps: u32,
    /// For how long positions have been compared \[s\], since when, and how far velocities say the joints have gone.
    elapsed: f64,
    from: Vec<f64>,
    told: Vec<f64>,
}

impl Judge {
    /// Of a robot with `n` joints in periods of so long \[s\].
    pub(super) fn new(n: usize, period: f64) -> Self {
        let zeros = || vec![0.0; n];
        let (from, told) = (zeros(), zeros());
        Self { period, last: f64::NAN, leaps: 0, elapsed: f64::INFINITY, from, told }
    }

    /// What is wrong with the state at `t` \[s\] of the robot's clock, in the light of those before.
    pub(super) fn look(&mut self, t: f64, q: &[f64], dq: &[f64]) -> Option<Fault> {
        let Self { period, last, leaps, elapsed, from, told } = self;
        let step = t - *last;
        *last = t;
        *leaps = if step > LEAP * *period { *leaps + 1 } else { 0 };
        if *leaps >= LEAPS {
            return Some(Fault::Clock { step, period: *period });
        }
        if step == 0.0 {
            return None; // no news
        }
        if !(0.0..=GAP.max(2.5 * *period)).contains(&step) || *elapsed >= WINDOW {
            *elapsed = 0.0;
            from.copy_from_slice(q);
            told.fill(0.0);
            return None;
        }
        *elapsed += step;
        told.iter_mut().zip(dq).for_each(|(told, dq)| *told += dq * step);
        if *elapsed < WINDOW {
            return None;
        }
        let gone = |i: usize| q[i] - from[i];
        let differs = |i: &usize| (told[*i] - gone(*i)).abs() > SHARE * gone(*i).abs().max(LEAST);
        let joint = (0..q.len()).find(differs)?;
        Some(Fault::Velocity { joint, gone: gone(joint), told: told[joint], within: *elapsed })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A swing of 0.5 rad at 1 Hz, whose velocity is said `scaled` and `lag` \[s\] late, by a clock that is `fast`.
    fn swung(scale: f64, lag: f64, fast: f64, rate: f64) -> Option<Fault> {
        let w = std::f64::consts::TAU;
        let mut judge = Judge::new(2, 1.0 / rate);
        (0..1000).find_map(|k| {
            let t = f64::from(k) / rate;
            let q = [0.5 * (w * t).sin(), 1.0];
            judge.look(fast * t, &q, &[0.5 * w * scale * (w * (t - lag)).cos(), 0.0])
        })
    }

    #[test]
    fn what_fits_is_let_be_and_what_does_not_is_named() {
        for rate in [20.0, 100.0, 1000.0] {
            for lag in [0.0, 0.02] {
                assert_eq!(swung(1.0, lag, 1.0, rate), None, "{rate} {lag}");
            }
            for scale in [-1.0, 180.0 / std::f64::consts::PI] {
                let fault = swung(scale, 0.0, 1.0, rate);
                assert!(
                    matches!(fault, Some(Fault::Velocity { joint: 0, .. })),
                    "{rate} {fault:?}"
                );
            }
            assert!(matches!(swung(1.0, 0.0, 1000.0, rate), Some(Fault::Clock { .. })));
        }
    }
}
