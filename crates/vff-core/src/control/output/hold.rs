//! How an arm that is damped stays where it comes to rest, whatever it carries.
//!
//! Damping alone lets an arm sink for ever under a load that nobody knows of. As soon as the arm is slow, or has more energy than
//! damping leaves it, it is kept on the way on which damping brings it to rest (T160): a spring to that way, and a sum of the
//! deviations, which takes over the load.

use crate::robot::Robot;

/// The largest pole of the hold \[1/s\].
const FASTEST: f64 = 10.0;
/// A period is at most this part of the time constant of the hold.
const SAMPLED: f64 = 1.0 / 6.0;
/// An arm is slow whose joints are no faster \[rad/s, m/s\].
const SLOW: f64 = 0.1;
/// So much of the energy that damping leaves is due to sampling and noise.
const LEFT: f64 = 1.2;
/// The hold is no stronger than this part of a torque limit.
const STRENGTH: f64 = 0.25;

/// What holds an arm that is damped beside its damping. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub struct Hold {
    period: f64,
    damping: f64,
    /// The pole p \[1/s\].
    pole: f64,
    /// The kinetic energy that damping leaves \[J\]; None before the arm is damped.
    left: Option<f64>,
    /// Whether the arm is held.
    holds: bool,
    /// Where damping has it, and how fast: q_r, q̇_r.
    way: Vec<f64>,
    speed: Vec<f64>,
    /// ∫(q − q_r) dt.
    sum: Vec<f64>,
    deceleration: Vec<f64>,
    torque: Vec<f64>,
}

impl Hold {
    /// The hold of an arm of `n` joints whose velocity decays with `damping` \[1/s\], less than 2 in a `period` \[s\].
    pub fn new(n: usize, damping: f64, period: f64) -> Self {
        let zeros = || vec![0.0; n];
        Self {
            period,
            damping,
            pole: FASTEST.min(damping).min(SAMPLED / period),
            left: None,
            holds: false,
            way: zeros(),
            speed: zeros(),
            sum: zeros(),
            deceleration: zeros(),
            torque: zeros(),
        }
    }

    /// The arm is moved again: nothing of what was learned holds any more.
    pub fn release(&mut self) {
        (self.left, self.holds) = (None, false);
        self.torque.fill(0.0);
    }

    /// No states come any more: what is left is the load that was taken over, and nothing against a motion or a push that may be over.
    pub fn leave_motion<R: Robot<D>, const D: usize>(&mut self, robot: &R) {
        if !self.holds {
            return;
        }
        let integral = self.pole.powi(3);
        self.deceleration.iter_mut().zip(&self.sum).for_each(|(out, sum)| *out = integral * sum);
        self.exert(robot);
    }

    /// The torque beside gravity and damping \[N·m, N\].
    pub fn torque(&self) -> &[f64] {
        &self.torque
    }

    /// A cycle in which the arm, at a state that has come, is damped with `d` \[1/s\].
    pub fn update<R: Robot<D>, const D: usize>(&mut self, robot: &R, d: f64) {
        let [q, dq] = [robot.configuration(), robot.velocity()];
        let decay = (1.0 - d * self.period).max(0.0); // as a torque that is held for a period has it
        if !self.holds {
            robot.mass_mul(dq, &mut self.deceleration);
            let energy: f64 = dq.iter().zip(&self.deceleration).map(|(dq, p)| 0.5 * dq * p).sum();
            let left = self.left.get_or_insert(energy);
            let is_left = energy <= LEFT * *left;
            *left *= decay.powi(2);
            if is_left && !is_slow(dq) || self.damping * self.period > 1.0 {
                return;
            }
            self.holds = true;
            self.sum.fill(0.0);
            self.begin_at(q, dq);
        }
        self.ask(q, dq, d);
        if self.exert(robot) < 1.0 {
            // What pushes harder moves the arm, which is held where it comes to then.
            self.begin_at(q, dq);
        } else {
            let deviations = q.iter().zip(&self.way);
            for (sum, (q, way)) in self.sum.iter_mut().zip(deviations) {
                *sum += self.period * (q - way);
            }
        }
        for (way, speed) in self.way.iter_mut().zip(&mut self.speed) {
            *speed *= decay;
            *way += self.period * *speed;
        }
    }

    /// What was made of the torque of this cycle keeps limits and does not hold: an arm that is not slow is held where it comes to then,
    /// and what was learned of a load fades. Summed up on, that would push the arm for as long afterwards as it was held back.
    pub fn be_overruled<R: Robot<D>, const D: usize>(&mut self, robot: &R) {
        let [q, dq] = [robot.configuration(), robot.velocity()];
        // One that a load pushes to the end of a joint's range goes on to be held there.
        if !self.holds || is_slow(dq) {
            return;
        }
        self.begin_at(q, dq);
        let fading = 1.0 - self.pole * self.period;
        self.sum.iter_mut().for_each(|sum| *sum *= fading);
    }

    fn begin_at(&mut self, q: &[f64], dq: &[f64]) {
        self.way.copy_from_slice(q);
        self.speed.copy_from_slice(dq);
    }

    /// (T160), without the damping that there is anyway.
    fn ask(&mut self, q: &[f64], dq: &[f64], d: f64) {
        let Self { pole: p, way, speed, sum, deceleration, .. } = self;
        let [sharper, spring, integral] = [(3.0 * *p - d).max(0.0), 3.0 * p.powi(2), p.powi(3)];
        let ways = way.iter().zip(speed).zip(sum);
        for ((out, (q, dq)), ((way, speed), sum)) in
            deceleration.iter_mut().zip(q.iter().zip(dq)).zip(ways)
        {
            *out = sharper * (dq - *speed) + spring * (q - way) + integral * *sum;
        }
    }

    /// Makes the torque that decelerates so, as far as it is within the strength of the hold. How much of it that is.
    fn exert<R: Robot<D>, const D: usize>(&mut self, robot: &R) -> f64 {
        robot.mass_mul(&self.deceleration, &mut self.torque);
        self.torque.iter_mut().for_each(|tau| *tau = -*tau);
        let within = self.share_within(robot);
        if within < 1.0 {
            self.torque.iter_mut().for_each(|tau| *tau *= within);
        }
        within
    }

    /// How much of the torque is within the strength of the hold.
    fn share_within<R: Robot<D>, const D: usize>(&self, robot: &R) -> f64 {
        let joints = self.torque.iter().zip(&robot.limits().torque);
        joints.fold(1.0, |most, (tau, limit)| most.min(STRENGTH * limit / tau.abs()))
    }
}

/// Whether no joint is fast, at these velocities \[rad/s, m/s\].
fn is_slow(dq: &[f64]) -> bool {
    dq.iter().all(|dq| dq.abs() <= SLOW)
}
