//! A candidate motion, how candidates are drawn, and what each costs (T73).

use crate::control::PreviewSettings;
use crate::math::Noise;

/// What each metre of missing distance, and releasing the task, cost in metres of mean error.
const MISSING: f64 = 100.0;
const RELEASE: f64 = 4.0;

/// A motion of the next seconds: one joint velocity \[rad/s\] for some time, then another.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// How many parts of its task the end effector lets go, in their order (T193); the joint velocities act within the null space of the
    /// others: at 0 within that of the task.
    pub released: usize,
    /// The first joint velocity.
    pub first: Vec<f64>,
    /// The second.
    pub then: Vec<f64>,
    /// When the second begins \[s from the beginning of the planning cycle\].
    pub switch: f64,
}

impl Candidate {
    /// The task alone: the law as it is, for `n` joints.
    pub fn idle(n: usize) -> Self {
        Self { released: 0, first: vec![0.0; n], then: vec![0.0; n], switch: 0.0 }
    }

    /// Takes over another candidate without allocating.
    pub fn copy_from(&mut self, other: &Self) {
        (self.released, self.switch) = (other.released, other.switch);
        self.first.copy_from_slice(&other.first);
        self.then.copy_from_slice(&other.then);
    }

    /// Becomes [`idle`](Self::idle).
    pub fn make_idle(&mut self) {
        (self.released, self.switch) = (0, 0.0);
        self.first.fill(0.0);
        self.then.fill(0.0);
    }

    /// The joint velocity `s` \[s\] after the beginning of the planning cycle.
    pub fn at(&self, s: f64) -> &[f64] {
        if s < self.switch { &self.first } else { &self.then }
    }

    /// Becomes a new one, drawn at random, of a task of so many parts.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "few parts"
    )]
    pub fn draw(&mut self, noise: &mut Noise, parts: usize, speed: f64) {
        // Every other one holds the whole task.
        let part = (2.0 * noise.share() - 1.0) * parts as f64;
        self.released = if part < 0.0 { 0 } else { (part as usize + 1).min(parts) };
        let constant = noise.share() < 0.3;
        for (first, then) in self.first.iter_mut().zip(&mut self.then) {
            *first = speed * noise.draw();
            *then = if constant { *first } else { speed * noise.draw() };
        }
        self.switch = if constant { 0.0 } else { 1.5 * noise.share() };
    }

    /// Changes a little, at random.
    pub fn vary(&mut self, noise: &mut Noise, speed: f64) {
        for u in self.first.iter_mut().chain(&mut self.then) {
            *u += speed * noise.draw();
        }
        self.switch = (self.switch + 0.2 * noise.draw()).max(0.0);
    }

    /// Stays within these joint speeds \[rad/s\].
    pub fn limit(&mut self, speed: &[f64]) {
        for joints in [&mut self.first, &mut self.then] {
            joints
                .iter_mut()
                .zip(speed)
                .for_each(|(u, most)| *u = u.clamp(-0.9 * most, 0.9 * most));
        }
    }
}

/// What a roll-out predicts.
#[derive(Debug, Clone, Copy)]
pub struct Forecast {
    /// Smallest distance \[m\], as one of a pair that keeps the usual margin.
    pub distance: f64,
    /// Mean error of the task \[m\], angles times the characteristic length.
    pub error: f64,
    /// Largest error of the task \[m\] after the first step.
    pub worst: f64,
}

impl Forecast {
    /// Of no instant.
    pub const NOTHING: Self = Self { distance: f64::INFINITY, error: 0.0, worst: 0.0 };
}

/// What a candidate costs of which this is predicted, and which lets go that share of the parts of its task (T73).
pub fn cost(settings: &PreviewSettings, margin: f64, forecast: Forecast, released: f64) -> f64 {
    let missing = (settings.clearance - forecast.distance).max(0.0);
    let breach = (margin - forecast.distance).max(0.0);
    MISSING * (missing + breach) + forecast.error + RELEASE * released
}
