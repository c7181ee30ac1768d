//! The planning cycle: when to look ahead, how far the work has come, and what becomes of its result (T72, T73).
//!
//! The work of a cycle is spread over the control steps of its period, so that no step takes much longer than the
//! others. The first finds out by a roll-out whether a contact is predicted. If so, the closed loop itself is rolled
//! out, and only if that is hit, too, every step tries its share of the candidates.

use super::candidate::{Candidate, Forecast, cost};
use super::closed_loop_rollout::{ClosedLoopRollout, Foreseen};
use super::due;
use super::prediction::Prediction;
use super::rollout::{RATE, Rollout};
use crate::control::PreviewSettings;
use crate::control::{Gains, OperationalSpace, Torque};
use crate::math::Noise;
use crate::robot::Manipulator;
use crate::trajectory::Sample;

/// The stream of random numbers that candidates are drawn from.
const STREAM: u64 = 4;

/// How fast the nominal motion changes over to another candidate \[1/s\].
const BLEND: f64 = 60.0;

/// Roll-outs at the beginning of a cycle: of the law as it is, and of the candidate that is being followed.
const FIRST: usize = 2;

/// The share of an error of the task that triggers the search down to which a candidate is kept.
const KEPT_UP: f64 = 0.5;

/// Planning cycles that a closed-loop rollout takes.
const CYCLES: f64 = 2.0;

/// Look-ahead with its workspace.
#[derive(Debug, Clone)]
pub struct Preview<R: Manipulator<D, M>, const D: usize, const M: usize> {
    settings: PreviewSettings,
    margin: f64,
    seed: u64,
    noise: Noise,
    /// Time since the beginning of the cycle, and since the last control step \[s\]; infinite before the first.
    elapsed: f64,
    since: f64,
    /// What the law as it is leads to, how long ago that began \[s\], and what the last one has come to.
    closed_loop: ClosedLoopRollout<R, D, M>,
    begun: f64,
    foreseen: Foreseen,
    /// Whether the best candidate so far is being followed, whether it must hold the task, that candidate, and its cost.
    active: bool,
    holds: bool,
    best: Candidate,
    cost: f64,
    /// How many candidates this cycle has tried, and how many it is to try.
    tried: usize,
    count: usize,
    /// The nominal motion, which follows the candidate with a lag, so that no torque jumps: the joint
    /// velocity that is aimed at \[rad/s\], and how far, from 0 to 1, the end effector holds its task and the
    /// candidate counts.
    aim: Vec<f64>,
    hold: f64,
    weight: f64,
    trial: Candidate,
    rollout: Rollout<R, D, M>,
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> Preview<R, D, M> {
    /// For the law with these gains on `robot`.
    pub fn new(robot: &R, gains: &Gains<M>, settings: &PreviewSettings) -> Self {
        let n = robot.dof();
        Self {
            settings: settings.clone(),
            margin: gains.yielding.margin,
            seed: gains.seed,
            noise: Noise::new(gains.seed, STREAM),
            elapsed: f64::INFINITY,
            since: f64::INFINITY,
            closed_loop: ClosedLoopRollout::new(robot, gains, settings.trigger, settings.error),
            begun: 0.0,
            foreseen: Foreseen::Nothing,
            active: false,
            holds: false,
            best: Candidate::idle(n),
            cost: 0.0,
            tried: 0,
            count: 0,
            aim: vec![0.0; n],
            hold: 1.0,
            weight: 0.0,
            trial: Candidate::idle(n),
            rollout: Rollout::new(robot, &gains.yielding, settings, gains.metric::<D>()),
        }
    }

    /// Makes room for so many more obstacles, and contacts of each body.
    pub fn reserve(&mut self, obstacles: usize, contacts: usize) {
        self.rollout.reserve(obstacles, contacts);
        self.closed_loop.reserve(contacts);
    }

    /// Takes over the posture of the law with these gains, at rest.
    pub fn rest_at_posture_of(&mut self, gains: &Gains<M>) {
        self.closed_loop.rest_at_posture_of(gains);
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.noise = Noise::new(self.seed, STREAM);
        (self.elapsed, self.since) = (f64::INFINITY, f64::INFINITY);
        (self.tried, self.count) = (0, 0);
        self.closed_loop.stop();
        self.foreseen = Foreseen::Nothing;
        self.active = false;
        self.holds = false;
        self.weight = 0.0;
        self.best.make_idle();
    }

    /// Lets `dt` \[s\] pass.
    pub fn elapse(&mut self, dt: f64) {
        self.elapsed += dt;
        self.since += dt;
        self.begun += dt;
        if !self.counts() {
            return;
        }
        let share = 1.0 - (-BLEND * dt).exp();
        let go = |from: &mut f64, to: f64| *from += share * (to - *from);
        self.aim.iter_mut().zip(self.best.at(self.elapsed)).for_each(|(aim, u)| go(aim, *u));
        go(&mut self.hold, f64::from(self.best.holds));
        go(&mut self.weight, f64::from(self.active));
        if !self.active && self.weight < 1e-6 {
            self.weight = 0.0;
        }
    }

    /// Begins a cycle at the state of `robot` if it is time, and does the work that is due; `reference(s)` is that in
    /// s seconds.
    pub fn advance(
        &mut self,
        robot: &R,
        surroundings: &mut dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
    ) {
        if self.elapsed >= self.settings.period - 1e-9 {
            self.begin(robot, surroundings, reference);
        }
        if self.closed_loop.is_running() || self.tried < self.count {
            self.rollout.forget(surroundings.count());
            self.roll_out_closed_loop(surroundings, reference);
            self.search(surroundings);
        }
        self.since = 0.0;
    }

    /// How many candidates must have been tried by now, for the cycle to end in the last control step of its period:
    /// all of them in the very first step, which does not know how long a step is.
    fn due(&self) -> usize {
        let share = (self.elapsed + self.since) / self.settings.period;
        due(FIRST + self.settings.candidates, share).saturating_sub(FIRST).min(self.count)
    }

    /// Begins a cycle: finds out whether a contact is predicted for the law as it is, and whether the candidate that
    /// is being followed still does better than that.
    fn begin(
        &mut self,
        robot: &R,
        surroundings: &mut dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
    ) {
        let Self { settings, rollout, best, trial, active, holds, margin, closed_loop, .. } = self;
        let (horizon, margin) = (settings.horizon, *margin);
        best.switch -= self.elapsed;
        self.elapsed = 0.0;
        (self.tried, self.count) = (0, 0);
        if closed_loop.is_running() {
            return;
        }
        rollout.prepare(settings, robot, surroundings, reference);
        closed_loop.reserve(surroundings.most_contacts());
        trial.make_idle();
        // A candidate is given up only once the law as it is keeps the margin over the whole horizon.
        match std::mem::take(&mut self.foreseen) {
            Foreseen::Contact => (*active, *holds) = (true, false),
            Foreseen::Error if !*active => (*active, *holds) = (true, true),
            _ => {}
        }
        let (until, enough) = if *active { (horizon, margin) } else { (settings.trigger, 0.0) };
        let most = settings.error.map_or(f64::INFINITY, |e| if *active { KEPT_UP * e } else { e });
        let step = rollout.step;
        let free = |so_far: Forecast, s: f64| s + step > until + 1e-9 && so_far.distance >= enough;
        let idle = rollout.forecast(trial, surroundings, 0.0, &free);
        let contact = idle.distance < enough;
        let ahead = !rollout.obstacles.is_empty() && (contact || idle.worst > most);
        if !*active && ahead {
            closed_loop.begin(robot);
            self.begun = 0.0;
        }
        *active &= ahead;
        if !*active {
            best.make_idle();
            return;
        }
        if self.weight == 0.0 {
            self.aim.copy_from_slice(robot.velocity());
        }
        let present = rollout.forecast(best, surroundings, 0.0, &|_, _| false);
        // The null space alone was not enough.
        *holds &= present.distance >= margin;
        self.cost = cost(settings, margin, present, best.holds);
        let of_idle = cost(settings, margin, idle, true);
        if of_idle <= self.cost {
            self.cost = of_idle;
            best.make_idle();
        }
        // A candidate that keeps its distance needs little more than to be kept up to date.
        let settled = present.distance >= settings.clearance;
        self.count = if settled { settings.candidates / 8 } else { settings.candidates };
    }

    /// Does its share of the closed-loop rollout, if one is running, so that it takes so many cycles.
    fn roll_out_closed_loop(
        &mut self,
        surroundings: &dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
    ) {
        let Self { settings, closed_loop, rollout, since, begun, .. } = self;
        if closed_loop.is_running() {
            let share = (*begun + *since) / (CYCLES * settings.period);
            let obstacles = &rollout.obstacles;
            self.foreseen = closed_loop.go_on(share, *begun, surroundings, obstacles, reference);
        }
    }

    /// Tries the candidates that are due, new ones and variations of the best so far, and keeps the best (T73).
    fn search(&mut self, surroundings: &dyn Prediction<D>) {
        let due = self.due();
        let Self { settings, margin, noise, best, cost: least, holds, trial, rollout, .. } = self;
        for k in self.tried..due {
            if 2 * k >= self.count || k % 2 == 0 {
                trial.copy_from(best);
                trial.vary(noise, settings.speed * if k % 4 < 2 { 0.3 } else { 0.1 });
                trial.holds ^= k % 8 == 7;
            } else {
                trial.draw(noise, settings.speed * if k % 3 == 0 { 0.4 } else { 1.0 });
            }
            trial.holds |= *holds;
            trial.limit(&rollout.speed);
            let price = |forecast| cost(settings, *margin, forecast, trial.holds);
            let worse = |so_far, _| price(so_far) > *least;
            let found = price(rollout.forecast(trial, surroundings, self.elapsed, &worse));
            if found < *least {
                *least = found;
                std::mem::swap(best, trial);
            }
        }
        self.tried = self.tried.max(due);
    }

    /// Whether a candidate is being followed.
    pub fn is_active(&self) -> bool {
        self.active
    }

    /// Whether the nominal motion is, if only a little, that of a candidate.
    fn counts(&self) -> bool {
        self.active || self.weight > 0.0
    }

    /// Makes the candidate the nominal motion (T72): changes the torque of the null-space law into one that gives
    /// q̈ = RATE (u − q̇), in the null space alone if the end effector holds its task.
    pub fn act(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        bias: &[f64],
        torque: &mut Torque,
    ) {
        if !self.counts() {
            return;
        }
        let (change, scratch) = (&mut self.rollout.w, &mut self.rollout.v);
        robot.accelerate(&torque.total, bias, scratch, change);
        for ((change, u), dq) in change.iter_mut().zip(&self.aim).zip(robot.velocity()) {
            *change = RATE * (u - dq) - *change;
        }
        space.pinv_mul(&robot.jacobian_mul::<M>(change), scratch);
        for (change, task) in change.iter_mut().zip(scratch.iter()) {
            *change = self.weight * (*change - self.hold * task);
        }
        robot.mass_mul(change, scratch);
        torque.add_to_task(|i| scratch[i]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{Asked, closing, disc, holding, robot};
    use super::*;
    use crate::control::{Avoidance, Settings, Yielding};
    use crate::robot::PlanarState;
    use crate::robot::Robot;
    use crate::world::plane::World;
    use std::cell::Cell;

    fn preview(robot: &PlanarState, settings: &PreviewSettings) -> Preview<PlanarState, 2, 2> {
        let law = Settings { avoidance: Avoidance::Cbf, ..Settings::default() };
        Preview::new(robot, &Gains::new(&law).with_seed(7), settings)
    }

    /// Discs that close in on the second link trigger the search; one that passes does not, nor does one that the law
    /// avoids, though a roll-out touches it, nor an empty world. The chosen candidate is free of contact and keeps
    /// the speed limits.
    #[test]
    fn only_contacts_ahead_trigger() {
        let robot = robot();
        let settings = PreviewSettings { horizon: 2.0, trigger: 2.0, ..PreviewSettings::default() };
        let reference = holding(&robot);
        for (obstacles, touched, expected) in [
            (vec![], false, false),
            (vec![disc([1.4, 2.4], [0.0, 0.8])], false, false),
            (vec![disc([1.4, 2.6], [0.0, -0.8])], true, false),
            (vec![disc([1.4, 2.4], [0.0, -0.8]), disc([1.4, -0.6], [0.0, 0.8])], true, true),
        ] {
            let mut world = World::new(obstacles);
            let mut preview = preview(&robot, &settings);
            // The first step does the whole closed-loop rollout, but the next cycle begins after a period, not before.
            for half in 0..6 {
                preview.advance(&robot, &mut world, &|_| reference);
                assert_eq!(preview.is_active(), expected && half >= 2, "{half}: {world:?}");
                preview.elapse(0.5 * settings.period);
            }
            let Preview { best, rollout, .. } = &mut preview;
            let idle = rollout.forecast(&Candidate::idle(4), &world, 0.0, &|_, _| false);
            assert_eq!(idle.distance < 0.0, touched, "{idle:?}");
            if expected {
                let chosen = rollout.forecast(best, &world, 0.0, &|_, _| false);
                assert!(chosen.distance > 0.0, "{chosen:?}");
                let fastest = best.first.iter().chain(&best.then).map(|u| u.abs());
                assert!(fastest.fold(0.0, f64::max) <= Yielding::default().speed);
            }
        }
    }

    /// However long the control period is: every cycle tries all candidates, and no step does more than its share of
    /// the roll-outs. Only the first step, which does not know the period, does the whole closed-loop rollout.
    #[test]
    fn a_cycle_is_spread_over_its_period() {
        let robot = robot();
        let reference = holding(&robot);
        // No distance is large enough: candidates are tried as long as there is time.
        let settings = PreviewSettings {
            horizon: 2.0,
            trigger: 2.0,
            clearance: 9.0,
            ..PreviewSettings::default()
        };
        let most = (settings.steps + 1) * robot.dof() * 2; // questions of a roll-out
        // 66 roll-outs, two of them at once.
        for (dt, steps, share) in [
            (2.5e-4, 80, 2),
            (1e-3, 20, 4),
            (3e-3, 7, 10),
            (0.015, 2, 50),
            (0.02, 1, 66),
            (0.05, 1, 66),
        ] {
            let mut world = Asked { world: closing(), times: Cell::new(0) };
            let mut preview = preview(&robot, &settings);
            preview.advance(&robot, &mut world, &|_| reference);
            assert_eq!(preview.foreseen, Foreseen::Contact);
            for step in 1..4 * steps {
                let begins = step % steps == 0;
                let before = if begins { 0 } else { preview.tried };
                world.times.set(0);
                preview.elapse(dt);
                preview.advance(&robot, &mut world, &|_| reference);
                assert_eq!(preview.elapsed == 0.0, begins, "{dt}: {step}");
                assert_eq!(preview.is_active(), step >= steps, "{dt}: {step}");
                if step < steps {
                    continue;
                }
                let (tried, asked) = (preview.tried - before, world.times.get());
                assert!(tried <= share && asked <= share * most, "{dt}: {tried}, {asked}");
                if (step + 1) % steps == 0 {
                    assert_eq!(preview.tried, settings.candidates, "{dt}");
                }
            }
            // Where no time passes, there is nothing to do.
            world.times.set(0);
            preview.advance(&robot, &mut world, &|_| reference);
            assert_eq!(world.times.get(), 0);
        }
    }

    /// A closed-loop rollout takes two cycles, and no step does more than its share; a new one begins at once, as long
    /// as a roll-out is hit.
    #[test]
    fn a_closed_loop_rollout_is_spread_over_two_cycles() {
        let robot = robot();
        let settings = PreviewSettings { horizon: 2.0, trigger: 2.0, ..PreviewSettings::default() };
        let reference = holding(&robot);
        for (dt, steps, share) in [(1e-3, 20, 5), (0.015, 2, 75), (0.05, 1, 200)] {
            // A roll-out touches this disc, the law does not.
            let mut world = World::new(vec![disc([1.4, 2.6], [0.0, -0.8])]);
            let mut preview = preview(&robot, &settings);
            preview.advance(&robot, &mut world, &|_| reference);
            assert_eq!(preview.foreseen, Foreseen::Nothing);
            assert!(!preview.closed_loop.is_running());
            for step in 1..=6 * steps {
                let before = preview.closed_loop.done();
                preview.elapse(dt);
                preview.advance(&robot, &mut world, &|_| reference);
                let done = preview.closed_loop.done();
                let done = if done < before { done } else { done - before };
                assert!(done <= share, "{dt}: {done}");
                if steps == 20 {
                    let over = (step + 1) % (2 * steps) == steps;
                    assert_eq!(preview.closed_loop.is_running(), step >= steps && !over, "{step}");
                }
            }
            assert_eq!(preview.foreseen, Foreseen::Nothing);
            assert!(preview.closed_loop.done() > 0);
        }
    }
}
