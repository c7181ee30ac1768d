//! Which of the states that a robot reports are believed.
//!
//! A state that is slow, and no farther from the last than a fast joint comes, is believed. One that is fast has to be where its
//! velocities have brought it: from the last that was believed, or from those before it that were not. So an arm that is thrown is known
//! after a few cycles, and a single wild reading is no arm.

use super::Clock;
use crate::math::whole_turns;
use std::f64::consts::TAU;

/// A joint that may have any speed is taken for one of this limit \[rad/s, m/s\].
const NO_LIMIT: f64 = 25.0;
/// A speed beyond so many times its limit is fast.
const FAST: f64 = 2.0;
/// Share of its speed limit by which a joint's velocity may change in a cycle, and its mean velocity differ from that of its
/// positions, where it is fast.
const SLACK: f64 = 1.0;
/// So many fast states in a row have to follow from each other.
const CONFIRMED: usize = 3;

/// More turns than this are none of a joint, but a wild reading.
const MOST_TURNS: f64 = 1e6;

/// Counts whole turns of `q` so that joints which turn without an end are next to where they were `before`.
pub fn unwrap(q: &mut [f64], before: &[f64], is_endless: &[bool]) {
    for (i, (q, before)) in q.iter_mut().zip(before).enumerate() {
        let turns = whole_turns(before - *q);
        if turns != 0.0 && turns.abs() < TAU * MOST_TURNS && is_endless[i] {
            *q += turns;
        }
    }
}

/// A state, and the cycle in which it came, counted from the last that was believed.
#[derive(Debug, Clone)]
struct State {
    q: Vec<f64>,
    dq: Vec<f64>,
    cycle: usize,
}

/// What is believed of an arm. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub struct Admission {
    clock: Clock,
    period: f64,
    /// Speed limits \[rad/s, m/s\], (n).
    limit: Vec<f64>,
    /// Which joints turn without an end: whole turns are nothing to them, and a reading may leave them out.
    endless: Vec<bool>,
    unwrapped: Vec<f64>,
    /// None has come before the first.
    is_empty: bool,
    believed: State,
    /// The last that was not, and how many there have been in a row that follow from each other.
    doubted: State,
    confirmed: usize,
}

impl Admission {
    /// For a loop of `period` \[s\] with an arm of these velocity limits, which may be none, and `n` joints.
    pub fn new(period: f64, n: usize, velocity_limits: &[f64]) -> Self {
        let state = State { q: vec![0.0; n], dq: vec![0.0; n], cycle: 0 };
        let mut created = Self {
            clock: Clock::new(period),
            period,
            limit: vec![NO_LIMIT; n],
            endless: vec![false; n],
            unwrapped: vec![0.0; n],
            is_empty: true,
            believed: state.clone(),
            doubted: state,
            confirmed: 0,
        };
        created.be_limited(velocity_limits);
        created
    }

    /// From now on joints have these velocity limits, which may be none; one that is faster is limited to what it has.
    pub fn be_limited(&mut self, velocity_limits: &[f64]) {
        for (i, (limit, dq)) in self.limit.iter_mut().zip(&self.believed.dq).enumerate() {
            *limit = velocity_limits.get(i).copied().unwrap_or(NO_LIMIT).max(dq.abs());
        }
    }

    /// From now on the turns of these joints are counted.
    ///
    /// # Panics
    /// If there are not as many as joints.
    pub fn count_turns(&mut self, endless: Vec<bool>) {
        assert_eq!(endless.len(), self.endless.len());
        self.endless = endless;
    }

    /// Whether none has been believed yet.
    pub fn is_empty(&self) -> bool {
        self.is_empty
    }

    /// q and q̇ of the last that was believed.
    pub fn state(&self) -> [&[f64]; 2] {
        [&self.believed.q, &self.believed.dq]
    }

    /// The clock of the states.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Whether a joint of that state is faster than so many times its limit.
    pub fn exceeds(&self, times: f64) -> bool {
        self.believed.dq.iter().zip(&self.limit).any(|(dq, limit)| dq.abs() > times * limit)
    }

    /// Whether it is that fast that it has to be braked.
    pub fn is_fast(&self) -> bool {
        self.exceeds(FAST)
    }

    /// The time of (q, q̇), which came at `t` \[s\] of the robot's clock and so many `cycles` after the last state, if it is new
    /// and can be; it is taken in then.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn admit(&mut self, cycles: usize, t: f64, q: &[f64], dq: &[f64]) -> Option<f64> {
        assert!(q.len() == self.limit.len() && dq.len() == q.len(), "a number per joint");
        if !(t.is_finite() && q.iter().chain(dq).all(|x| x.is_finite())) {
            return None;
        }
        let mut unwrapped = std::mem::take(&mut self.unwrapped);
        unwrapped.copy_from_slice(q);
        if !self.is_empty {
            unwrap(&mut unwrapped, &self.believed.q, &self.endless);
        }
        let admitted = self.take(cycles, t, &unwrapped, dq);
        self.unwrapped = unwrapped;
        admitted
    }

    /// The same for joints whose turns are counted.
    fn take(&mut self, cycles: usize, t: f64, q: &[f64], dq: &[f64]) -> Option<f64> {
        let time = self.clock.read(t, cycles)?;
        let passed = self.passed(cycles).max(time - self.clock.now());
        let can_be = self.is_slow(q, dq, passed)
            || !self.is_empty && self.follows(&self.believed, q, dq, passed)
            || self.is_confirmed(cycles, q, dq, passed);
        if !can_be {
            return None;
        }
        self.clock.take(t, time);
        self.believed.q.copy_from_slice(q);
        self.believed.dq.copy_from_slice(dq);
        (self.is_empty, self.confirmed) = (false, 0);
        Some(time)
    }

    #[expect(clippy::cast_precision_loss, reason = "far fewer than 2⁵³ cycles")]
    fn passed(&self, cycles: usize) -> f64 {
        self.period * cycles as f64
    }

    /// Whether no joint is fast, nor farther from the last state than a fast one comes.
    fn is_slow(&self, q: &[f64], dq: &[f64], passed: f64) -> bool {
        let slow = dq.iter().zip(&self.limit).all(|(dq, limit)| dq.abs() <= FAST * limit);
        slow && (self.is_empty || self.is_near(q, passed, |limit, _| FAST * limit))
    }

    /// Whether no joint is farther from the last state than such a speed brings it, of its limit and its number.
    fn is_near(&self, q: &[f64], passed: f64, speed: impl Fn(f64, usize) -> f64) -> bool {
        let joints = q.iter().zip(&self.believed.q).zip(&self.limit).enumerate();
        joints.fold(true, |all, (i, ((q, before), limit))| {
            all & ((q - before).abs() <= speed(*limit, i) * passed)
        })
    }

    /// Whether every joint has gone from there to `q` as its velocities say, and these have not changed faster than joints do.
    fn follows(&self, from: &State, q: &[f64], dq: &[f64], passed: f64) -> bool {
        (0..q.len()).all(|i| {
            let slack = SLACK * self.limit[i];
            let went = q[i] - from.q[i];
            (went - 0.5 * (from.dq[i] + dq[i]) * passed).abs() <= slack * passed
                && (dq[i] - from.dq[i]).abs() <= slack * passed / self.period
        })
    }

    /// Whether states that were not believed have been following from each other.
    fn is_confirmed(&mut self, cycles: usize, q: &[f64], dq: &[f64], passed: f64) -> bool {
        let since = self.passed(cycles.saturating_sub(self.doubted.cycle));
        let continues = self.confirmed > 0 && self.follows(&self.doubted, q, dq, since);
        let from = &self.believed.dq;
        let begins = self.is_empty
            || self
                .is_near(q, passed, |limit, i| (FAST * limit).max(dq[i].abs()).max(from[i].abs()));
        self.confirmed = if continues { self.confirmed + 1 } else { usize::from(begins) };
        self.doubted.q.copy_from_slice(q);
        self.doubted.dq.copy_from_slice(dq);
        self.doubted.cycle = cycles;
        self.confirmed >= CONFIRMED
    }
}
