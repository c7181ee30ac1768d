//! How fast a joint may be, and become: near its largest speed, and towards its stops.

use crate::control::CommandSettings;
use crate::math::ScalarOrVec;

/// From which share of its largest speed on a joint is braked gently by ways that are no program.
const GUARDED: f64 = 0.5;

/// Slower than that, a joint does not come to its largest speed within 1/this \[1/s\]: a few periods of a loop.
const AT_ONCE: f64 = 250.0;

/// How a joint comes to its stops where a robot wants it slower the nearer it is.
#[derive(Debug, Clone, Copy)]
pub struct Braking {
    /// b \[rad/s²\].
    deceleration: f64,
    /// o \[rad/s\].
    offset: f64,
}

impl Braking {
    /// Of `n` joints, if anything is said of it.
    pub fn of(command: &CommandSettings, n: usize) -> Vec<Self> {
        let of = |given: &ScalarOrVec, i| Self {
            deceleration: given.get(i),
            offset: command.stop_offset.get(i),
        };
        command
            .stop_deceleration
            .as_ref()
            .map_or(vec![], |given| (0..n).map(|i| of(given, i)).collect())
    }

    /// √(o² + 2 b h) − o, the largest speed towards a stop that is h away, and how fast it changes at the speed `dq` (T152).
    pub fn towards(self, height: f64, dq: f64) -> [f64; 2] {
        let Self { deceleration: b, offset: o } = self;
        let root = (o * o + 2.0 * b * height.max(0.0)).sqrt();
        let most = root - o;
        [most, if most > 0.0 { -b * dq.clamp(0.0, most) / root } else { 0.0 }]
    }
}

/// What of the joints is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Joints {
    /// Angles and speeds.
    All,
    /// Of an arm without velocity limits.
    Angles,
    /// Speeds alone, where a joint would be too fast (T153).
    Speeds,
}

/// The largest acceleration of a joint towards its largest speed `most` at the speed `dq`, which has that sign (T153).
pub fn guarded_acceleration(k: f64, most: f64, dq: f64) -> f64 {
    let left = most - dq;
    let beyond = dq - GUARDED * most;
    if left <= 0.0 {
        k * left
    } else if beyond <= 0.0 {
        AT_ONCE * left
    } else {
        left * AT_ONCE.min(k * (1.0 - GUARDED) * most / beyond)
    }
}
