//! Whether the law as it is will be hit: a roll-out of the closed loop itself, in coarse steps, among the obstacles
//! predicted from their velocities (T83).
//!
//! A roll-out without mass predicts contacts that the law would have avoided. The arm leaves the law, and with it the
//! task, only after a closed-loop rollout has been hit, too.

use super::prediction::{Later, Prediction};
use super::{Present, due};
use crate::control::avoidance::barrier;
use crate::control::deadline::Budget;
use crate::control::{CommandSettings, Gains, Output, ReactiveController};
use crate::robot::Manipulator;
use crate::trajectory::Sample;

/// Longest step \[s\], and the largest product of a step and a rate of the law.
const STEP: f64 = 0.01;
const STEP_TIMES_RATE: f64 = 0.4;

/// A distance below this share of the margin counts as a contact: the QP keeps the margin unless it cannot.
const CONTACT: f64 = 0.5;

/// The most steps: what a control step may have to do at once is bounded, whatever the settings.
const MAX_STEPS: f64 = 4096.0;

/// The fastest rate \[1/s\] that a closed-loop rollout over `duration` \[s\] has steps enough for; none if it is too long
/// for any.
#[cfg(feature = "scenario")]
pub fn fastest_rate(duration: f64) -> Option<f64> {
    (duration <= MAX_STEPS * STEP).then(|| STEP_TIMES_RATE * MAX_STEPS / duration)
}

/// What a closed-loop rollout has come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Foreseen {
    /// Nothing so far that the arm should avoid.
    #[default]
    Nothing,
    /// The end effector has to give way, but nothing is hit.
    Error,
    /// A contact.
    Contact,
}

/// The closed loop in the look-ahead, with its workspace.
#[derive(Debug, Clone)]
pub struct ClosedLoopRollout<R: Manipulator<D, M>, const D: usize, const M: usize> {
    controller: ReactiveController<R, D, M>,
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    scratch: Vec<f64>,
    /// What stands before the drives, and what they were sent last; whether their torque cannot change at once.
    output: Output,
    sent: Vec<f64>,
    is_slow: bool,
    /// Duration of a step \[s\].
    step: f64,
    /// How many steps have been done, and how many make a whole roll-out.
    done: usize,
    count: usize,
    /// The smallest distance that is no contact \[m\].
    least: f64,
    /// The largest error of the task that is accepted \[m\], and whether there was a larger one.
    most: f64,
    strays: bool,
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> ClosedLoopRollout<R, D, M> {
    /// Of the law with these gains on `robot`, over `duration` \[s\], with errors of the task up to `error` \[m\] accepted.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive, and not too many"
    )]
    pub fn new(robot: &R, gains: &Gains<M>, duration: f64, error: Option<f64>) -> Self {
        let n = robot.dof();
        let zeros = || vec![0.0; n];
        let rates = (0..n).map(|i| gains.null_damping.get(i)).chain(gains.damping.iter().copied());
        let fastest = rates.fold(barrier::rate(&gains.yielding), f64::max);
        let step = STEP.min(STEP_TIMES_RATE / fastest);
        let count = (duration / step).ceil().min(MAX_STEPS) as usize;
        Self {
            least: CONTACT * gains.yielding.margin,
            controller: ReactiveController::new(robot.clone(), gains.clone()),
            q: zeros(),
            dq: zeros(),
            ddq: zeros(),
            scratch: zeros(),
            output: Output::new(&without_friction(&gains.command), n),
            sent: zeros(),
            is_slow: false,
            step,
            done: count,
            count,
            most: error.unwrap_or(f64::INFINITY),
            strays: false,
        }
    }

    /// Makes room for so many contacts of each body, so that no step allocates.
    pub fn reserve(&mut self, contacts: usize) {
        self.controller.reserve(contacts);
    }

    /// Takes over the posture of the law with these gains, at rest.
    pub fn rest_at_posture_of(&mut self, gains: &Gains<M>) {
        self.controller.rest_at_posture_of(gains);
    }

    /// Begins a new one. Its model is the whole arm: what else acts is part of what is sent.
    pub fn begin(&mut self, present: &Present<'_, R>) {
        let Present { robot, sent, unknown } = *present;
        self.is_slow = sent.is_some();
        if let Some(sent) = sent {
            self.scratch.copy_from_slice(sent);
            self.scratch.iter_mut().zip(unknown).for_each(|(sent, unknown)| *sent += unknown);
            self.sent.copy_from_slice(self.output.convert(robot, &self.scratch));
        }
        self.q.copy_from_slice(robot.configuration());
        self.dq.copy_from_slice(robot.velocity());
        self.done = 0;
        self.strays = false;
    }

    /// Ends it early.
    pub fn stop(&mut self) {
        self.done = self.count;
    }

    /// Whether steps are still to be done.
    pub fn is_running(&self) -> bool {
        self.done < self.count
    }

    /// How many steps have been done.
    #[cfg(test)]
    pub fn done(&self) -> usize {
        self.done
    }

    /// Goes on up to this share of the whole and returns what there was: a contact at once, a large error of the task at
    /// the end. It began `ago` \[s\] before the present, for which `surroundings` and `reference`, in so many seconds,
    /// speak. None where the time of this control cycle is over before that.
    #[expect(clippy::cast_precision_loss, reason = "few steps")]
    pub fn go_on(
        &mut self,
        share: f64,
        ago: f64,
        surroundings: &dyn Prediction<D>,
        obstacles: &[usize],
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
        budget: &Budget,
    ) -> Option<Foreseen> {
        let due = due(self.count, share).min(self.count);
        while self.done < due {
            if !budget.is_left() {
                return None;
            }
            let after = self.step * self.done as f64 - ago;
            let (usual, least) = (self.controller.gains().yielding.margin, f64::INFINITY);
            let mut later = Later { surroundings, obstacles, after, usual, least };
            self.controller.observe(&self.q, &self.dq, &mut later);
            if later.least < self.least {
                self.stop();
                return Some(Foreseen::Contact);
            }
            self.command(&reference(after));
            let error = self.controller.gains().metric::<D>().norm(self.controller.error());
            self.strays |= error > self.most;
            self.advance();
            self.done += 1;
        }
        let strays = self.strays && !self.is_running();
        Some(if strays { Foreseen::Error } else { Foreseen::Nothing })
    }

    /// The torque of the law, as far as the drives can change it in a step (T171).
    fn command(&mut self, reference: &Sample<R::Pose, M>) {
        let Self { controller, output, sent, step, is_slow, .. } = self;
        if *is_slow {
            controller.expect(output, sent, *step);
        }
        controller.command(reference);
        if *is_slow {
            sent.copy_from_slice(output.convert(controller.robot(), &controller.torque().total));
        }
    }

    /// One step of semi-implicit Euler.
    fn advance(&mut self) {
        let Self { controller, q, dq, ddq, scratch, step, .. } = self;
        controller.robot().accelerate(&controller.torque().total, controller.bias(), scratch, ddq);
        for ((q, dq), ddq) in q.iter_mut().zip(dq).zip(ddq) {
            *dq += *step * *ddq;
            *q += *step * *dq;
        }
    }
}

/// What the drives of an arm without friction are sent: a roll-out has none, and what compensates it moves nothing.
fn without_friction(command: &CommandSettings) -> CommandSettings {
    let nothing = CommandSettings::default();
    CommandSettings {
        viscous_friction: nothing.viscous_friction,
        coulomb_friction: nothing.coulomb_friction,
        ..command.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Avoidance, Controller, Settings};
    use crate::math::{Noise, ScalarOrVec, Vector};
    use crate::robot::{Model, PlanarArm, PlanarState, Robot, planar::Link};
    use crate::world::Motion;
    use crate::world::plane::{Obstacle, Shape, World};
    use std::sync::Arc;

    const DURATION: f64 = 1.0;

    /// The smallest distance of the same loop in steps of 1 ms, and whether its closed-loop rollout was hit: where torque
    /// can change at once, or at so many N·m/s; and whether one was in which it changes at once.
    fn both(q: &[f64; 4], discs: Vec<Obstacle>, rate: Option<f64>) -> (f64, bool, bool) {
        let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 4], Vector::<2>::zeros()));
        let mut state = arm.state();
        state.update(q, &[0.0; 4]);
        let reference = Sample::at_rest(Manipulator::<2, 2>::pose(&state));
        let torque_rate = rate.map(ScalarOrVec::Uniform);
        let command = CommandSettings { torque_rate, ..CommandSettings::default() };
        let settings = Settings { avoidance: Avoidance::Cbf, command, ..Settings::default() };
        let gains = Gains::<2>::new(&settings);
        let mut output = Output::new(&settings.command, 4);
        let world = World::new(discs);
        let obstacles: Vec<usize> = (0..world.len()).collect();
        let mut rollout =
            ClosedLoopRollout::<PlanarState, 2, 2>::new(&state, &gains, DURATION, None);
        let mut is_hit = |sent| {
            rollout.begin(&Present { robot: &state, sent, unknown: &[] });
            let unlimited = Budget::of_simulation(None);
            let foreseen = rollout.go_on(1.0, 0.0, &world, &obstacles, &|_| reference, &unlimited);
            foreseen == Some(Foreseen::Contact)
        };
        let hit = is_hit(rate.map(|_| &[0.0; 4][..]));
        let hit_at_once = is_hit(None);

        let mut controller = Controller::new(state, gains);
        let mut world = world;
        let (mut q, mut dq) = (*q, [0.0; 4]);
        let (mut ddq, mut scratch, mut torque) = ([0.0; 4], [0.0; 4], vec![0.0; 4]);
        let mut least = f64::INFINITY;
        for k in 0..1000 {
            world.update(1e-3 * f64::from(k));
            controller.observe(&q, &dq, &mut world);
            least = controller.forces().clearance().iter().copied().fold(least, f64::min);
            if rate.is_some() {
                controller.expect(&mut output, &torque, 1e-3);
            }
            torque.copy_from_slice(&controller.command(&reference).total);
            controller.robot().accelerate(&torque, controller.bias(), &mut scratch, &mut ddq);
            for i in 0..4 {
                dq[i] += 1e-3 * ddq[i];
                q[i] += 1e-3 * dq[i];
            }
        }
        (least, hit, hit_at_once)
    }

    /// For two discs that close in on an arm, a roll-out predicts what the loop in ten times finer steps finds,
    /// wherever that is clear: a pinch is a contact, a distance of half the margin and 5 mm more is none.
    #[test]
    fn it_predicts_what_happens() {
        predicts(None);
    }

    /// The same behind a torque rate (T171).
    #[test]
    fn it_predicts_what_happens_behind_a_torque_rate() {
        predicts(Some(100.0));
        predicts(Some(300.0));
    }

    fn predicts(rate: Option<f64>) {
        let mut noise = Noise::new(1, 0);
        let (mut hits, mut free, mut missed) = (0, 0, 0);
        for _ in 0..60 {
            let q = [0.4, 0.8, -1.0, 0.7].map(|q| q + 0.2 * noise.draw());
            let mut disc = |side: f64| Obstacle {
                position: [1.3 + 0.1 * noise.draw(), 0.7 + side * (0.6 + 0.1 * noise.draw())],
                motion: Motion::Linear { velocity: [0.0, -0.5 * side * noise.share()] },
                ..Obstacle::of(Shape::Circle { radius: 0.2 })
            };
            let (least, hit, hit_at_once) = both(&q, vec![disc(1.0), disc(-1.0)], rate);
            if least < 0.0 {
                hits += 1;
                missed += usize::from(!hit_at_once);
                assert!(hit, "{rate:?}: {q:?}: {least}");
            } else if least > 0.015 {
                free += 1;
                assert!(!hit, "{rate:?}: {q:?}: {least}");
            }
        }
        assert!(hits >= 5 && free >= 20, "{hits} {free}");
        assert_eq!(missed > 0, rate.is_some(), "{rate:?}: {missed}");
    }
}
