//! Look-ahead on top of `cbf` (T71–T73): whether the arm, left to itself, is about to be hit, and if so,
//! which motion of the next seconds takes it out of the way. That motion becomes the nominal one of the
//! programme, which stays in charge of every distance and limit.
//!
//! A look is spread over the control steps of its period, so that none takes much longer than the others: the
//! first finds out whether there may be cause for alarm. Then the law itself is rehearsed, and once that has been
//! hit, too, every step tries its share of the courses.

use super::rehearsal::Rehearsal;
use super::{Yielding, due};
use crate::control::{Gains, OperationalSpace, Torque};
use crate::math::{Body, Noise, Pose, dot};
use crate::robot::Manipulator;
use crate::trajectory::Sample;
use crate::world::{CollisionQuery, Contact};
use nalgebra::{SMatrix, SVector};
use serde::Deserialize;

/// The stream of random numbers that courses are drawn from.
const STREAM: u64 = 4;

/// Obstacles farther away than this [m] are left out of a look.
const REACH: f64 = 4.0;

/// Pairs nearer than this [m] are filtered in a roll-out.
const NEAR: f64 = 0.5;

/// How fast the arm takes up the joint velocity of a course [1/s].
const RATE: f64 = 10.0;

/// How fast the nominal motion goes over to another course [1/s].
const BLEND: f64 = 60.0;

/// How fast a roll-out comes back to the reference [1/s].
const PULL: f64 = 3.0;

/// What a metre of distance that is lacking, and letting go of the task, cost in metres of mean error.
const LACKING: f64 = 100.0;
const LETTING_GO: f64 = 4.0;

/// Roll-outs that a look begins with: left to itself, and along the course being taken.
const FIRST: usize = 2;

/// Looks that a rehearsal takes.
const REHEARSED: f64 = 2.0;

/// How the arm looks ahead: the `[controller.yielding.preview]` table of a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PreviewSettings {
    /// Time between two looks [s], > 0, rounded up to whole steps.
    pub period: f64,
    /// How far a look goes [s], > 0.
    pub horizon: f64,
    /// A contact within this time [s], > 0 and at most `horizon`, makes the arm look for a way out.
    pub alarm: f64,
    /// Steps of a roll-out, ≥ 1.
    pub steps: usize,
    /// Courses that are tried, ≥ 1.
    pub candidates: usize,
    /// Distance [m], > 0, beyond which more of it counts for nothing.
    pub clearance: f64,
    /// Standard deviation of the joint velocities that are tried [rad/s], > 0.
    pub speed: f64,
}

impl Default for PreviewSettings {
    fn default() -> Self {
        Self {
            period: 0.02,
            horizon: 1.2,
            alarm: 1.2,
            steps: 16,
            candidates: 64,
            clearance: 0.1,
            speed: 1.0,
        }
    }
}

/// A motion: one joint velocity [rad/s] for some time, then another.
#[derive(Debug, Clone)]
struct Course {
    /// Whether the end effector keeps to its task; the joint velocities are then meant within the null space.
    holds: bool,
    first: Vec<f64>,
    then: Vec<f64>,
    /// When the second begins [s from the beginning of the look].
    switch: f64,
}

impl Course {
    /// Nothing but the task.
    fn idle(n: usize) -> Self {
        Self { holds: true, first: vec![0.0; n], then: vec![0.0; n], switch: 0.0 }
    }

    fn copy_from(&mut self, other: &Self) {
        (self.holds, self.switch) = (other.holds, other.switch);
        self.first.copy_from_slice(&other.first);
        self.then.copy_from_slice(&other.then);
    }

    fn make_idle(&mut self) {
        (self.holds, self.switch) = (true, 0.0);
        self.first.fill(0.0);
        self.then.fill(0.0);
    }

    /// The joint velocity `s` [s] after the beginning of the look.
    fn at(&self, s: f64) -> &[f64] {
        if s < self.switch { &self.first } else { &self.then }
    }

    /// Something new.
    fn draw(&mut self, noise: &mut Noise, speed: f64) {
        self.holds = noise.share() < 0.5;
        let constant = noise.share() < 0.3;
        for (first, then) in self.first.iter_mut().zip(&mut self.then) {
            *first = speed * noise.draw();
            *then = if constant { *first } else { speed * noise.draw() };
        }
        self.switch = if constant { 0.0 } else { 1.5 * noise.share() };
    }

    /// Something like it.
    fn vary(&mut self, noise: &mut Noise, speed: f64) {
        for u in self.first.iter_mut().chain(&mut self.then) {
            *u += speed * noise.draw();
        }
        self.switch = (self.switch + 0.2 * noise.draw()).max(0.0);
    }

    fn limit(&mut self, speed: &[f64]) {
        for joints in [&mut self.first, &mut self.then] {
            joints
                .iter_mut()
                .zip(speed)
                .for_each(|(u, most)| *u = u.clamp(-0.9 * most, 0.9 * most));
        }
    }
}

/// What a roll-out comes to.
#[derive(Debug, Clone, Copy)]
struct Forecast {
    /// Smallest distance [m].
    distance: f64,
    /// Mean error of the task [m].
    error: f64,
}

/// What a course costs that comes to this (T73).
fn price(settings: &PreviewSettings, margin: f64, forecast: Forecast, holds: bool) -> f64 {
    let lacking = (settings.clearance - forecast.distance).max(0.0);
    let breach = (margin - forecast.distance).max(0.0);
    LACKING * (lacking + breach) + forecast.error + if holds { 0.0 } else { LETTING_GO }
}

/// Look-ahead with its workspace.
#[derive(Debug, Clone)]
pub struct Preview<R: Manipulator<D, M>, const D: usize, const M: usize> {
    settings: PreviewSettings,
    margin: f64,
    seed: u64,
    noise: Noise,
    /// Time since the beginning of the look, and since the last control step [s]; infinite before the first.
    waited: f64,
    since: f64,
    /// What the law would come to, since when that is rehearsed [s ago], and whether the last one was hit.
    rehearsal: Rehearsal<R, D, M>,
    rehearsed: f64,
    hit: bool,
    /// Whether `course` is being taken, the cheapest of those that have been tried, and what it costs.
    active: bool,
    course: Course,
    cost: f64,
    /// How many courses this look has tried, and how many it is to try.
    tried: usize,
    count: usize,
    /// The nominal motion, which follows the course with a lag, so that no torque jumps: the joint
    /// velocity that is aimed at [rad/s], and how far, from 0 to 1, the end effector holds and the
    /// course counts.
    aim: Vec<f64>,
    hold: f64,
    weight: f64,
    trial: Course,
    rollout: Rollout<R, D, M>,
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> Preview<R, D, M> {
    /// For the law with these gains on `robot`.
    pub fn new(robot: &R, gains: &Gains<M>, settings: &PreviewSettings) -> Self {
        let n = robot.dof();
        let Gains { yielding, seed, .. } = gains;
        Self {
            settings: settings.clone(),
            margin: yielding.margin,
            seed: *seed,
            noise: Noise::new(*seed, STREAM),
            waited: f64::INFINITY,
            since: f64::INFINITY,
            rehearsal: Rehearsal::new(robot, gains, settings.alarm),
            rehearsed: 0.0,
            hit: false,
            active: false,
            course: Course::idle(n),
            cost: 0.0,
            tried: 0,
            count: 0,
            aim: vec![0.0; n],
            hold: 1.0,
            weight: 0.0,
            trial: Course::idle(n),
            rollout: Rollout::new(robot, yielding, settings),
        }
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.noise = Noise::new(self.seed, STREAM);
        (self.waited, self.since) = (f64::INFINITY, f64::INFINITY);
        (self.tried, self.count) = (0, 0);
        self.rehearsal.stop();
        self.hit = false;
        self.active = false;
        self.weight = 0.0;
        self.course.make_idle();
    }

    /// Lets `dt` [s] pass.
    pub fn elapse(&mut self, dt: f64) {
        self.waited += dt;
        self.since += dt;
        self.rehearsed += dt;
        if !self.is_felt() {
            return;
        }
        let share = 1.0 - (-BLEND * dt).exp();
        let go = |from: &mut f64, to: f64| *from += share * (to - *from);
        self.aim.iter_mut().zip(self.course.at(self.waited)).for_each(|(aim, u)| go(aim, *u));
        go(&mut self.hold, f64::from(self.course.holds));
        go(&mut self.weight, f64::from(self.active));
        if !self.active && self.weight < 1e-6 {
            self.weight = 0.0;
        }
    }

    /// Looks ahead: begins a look from the state of `robot` if it is time, and does its share of it;
    /// `reference(s)` is that in s seconds.
    pub fn look(
        &mut self,
        robot: &R,
        surroundings: &mut impl CollisionQuery<D>,
        reference: impl Fn(f64) -> Sample<R::Pose, M>,
    ) {
        if self.waited >= self.settings.period - 1e-9 {
            self.begin(robot, surroundings, &reference);
        }
        if self.rehearsal.goes_on() || self.tried < self.count {
            self.rollout.forget(surroundings.obstacle_count());
            self.rehearse(surroundings, &reference);
            self.search(surroundings);
        }
        self.since = 0.0;
    }

    /// How many courses have to be tried by now, for the look to be done in the last control step of its period:
    /// all of them in the very first step, which does not know how long one is.
    fn due(&self) -> usize {
        let share = (self.waited + self.since) / self.settings.period;
        due(FIRST + self.settings.candidates, share).saturating_sub(FIRST).min(self.count)
    }

    /// Begins a look: finds out whether the arm, left to itself, has to get out of the way, and whether the course
    /// being taken still does better than that.
    fn begin(
        &mut self,
        robot: &R,
        surroundings: &mut impl CollisionQuery<D>,
        reference: &impl Fn(f64) -> Sample<R::Pose, M>,
    ) {
        let Self { settings, rollout, course, trial, active, margin, rehearsal, .. } = self;
        let (horizon, margin) = (settings.horizon, *margin);
        course.switch -= self.waited;
        self.waited = 0.0;
        (self.tried, self.count) = (0, 0);
        if rehearsal.goes_on() {
            return;
        }
        rollout.prepare(settings, robot, surroundings, reference);
        rehearsal.reserve(surroundings.obstacle_count());
        trial.make_idle();
        // Left to itself; a way out is given up only once the margin is kept over the whole horizon.
        *active |= std::mem::take(&mut self.hit);
        let (until, enough) = if *active { (horizon, margin) } else { (settings.alarm, 0.0) };
        let step = rollout.step;
        let fine = |so_far: Forecast, s| s + step > until + 1e-9 && so_far.distance >= enough;
        let idle = rollout.forecast(trial, surroundings, 0.0, fine);
        let ahead = !rollout.obstacles.is_empty() && idle.distance < enough;
        if !*active && ahead {
            rehearsal.begin(robot);
            self.rehearsed = 0.0;
        }
        *active &= ahead;
        if !*active {
            course.make_idle();
            return;
        }
        if self.weight == 0.0 {
            self.aim.copy_from_slice(robot.velocity());
        }
        let present = rollout.forecast(course, surroundings, 0.0, |_, _| false);
        self.cost = price(settings, margin, present, course.holds);
        let cost = price(settings, margin, idle, true);
        if cost <= self.cost {
            self.cost = cost;
            course.make_idle();
        }
        // A course that keeps its distance needs little more than to be kept up to date.
        let settled = present.distance >= settings.clearance;
        self.count = if settled { settings.candidates / 8 } else { settings.candidates };
    }

    /// Does its share of the rehearsal, if there is one, so that it is done in so many looks.
    fn rehearse(
        &mut self,
        surroundings: &impl CollisionQuery<D>,
        reference: &impl Fn(f64) -> Sample<R::Pose, M>,
    ) {
        let Self { settings, rehearsal, rollout, since, rehearsed, .. } = self;
        if rehearsal.goes_on() {
            let share = (*rehearsed + *since) / (REHEARSED * settings.period);
            let obstacles = &rollout.obstacles;
            self.hit = rehearsal.go_on(share, *rehearsed, surroundings, obstacles, reference);
        }
    }

    /// Tries the courses that are due, new ones and ones like the best so far, and takes the cheapest (T73).
    fn search(&mut self, surroundings: &impl CollisionQuery<D>) {
        let due = self.due();
        let Self { settings, margin, noise, course, cost, trial, rollout, .. } = self;
        for k in self.tried..due {
            if 2 * k >= self.count || k % 2 == 0 {
                trial.copy_from(course);
                trial.vary(noise, settings.speed * if k % 4 < 2 { 0.3 } else { 0.1 });
                trial.holds ^= k % 8 == 7;
            } else {
                trial.draw(noise, settings.speed * if k % 3 == 0 { 0.4 } else { 1.0 });
            }
            trial.limit(&rollout.speed);
            let price = |forecast| price(settings, *margin, forecast, trial.holds);
            let hopeless = |so_far, _| price(so_far) > *cost;
            let found = price(rollout.forecast(trial, surroundings, self.waited, hopeless));
            if found < *cost {
                *cost = found;
                std::mem::swap(course, trial);
            }
        }
        self.tried = self.tried.max(due);
    }

    /// Whether a way out is being taken.
    pub fn is_active(&self) -> bool {
        self.active
    }

    /// Whether the nominal motion is, or is still a little, that of a course.
    fn is_felt(&self) -> bool {
        self.active || self.weight > 0.0
    }

    /// Makes the course the nominal motion (T72): changes the torque of the null-space law into one that gives
    /// q̈ = RATE (u − q̇), in the null space alone if the end effector holds.
    pub fn act(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        bias: &[f64],
        torque: &mut Torque,
    ) {
        if !self.is_felt() {
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

/// The arm as a chain without mass that follows a course, pushed aside like the real one by what the
/// programme keeps (T71).
#[derive(Debug, Clone)]
struct Rollout<R: Manipulator<D, M>, const D: usize, const M: usize> {
    scout: R,
    /// Configuration and joint velocity at the beginning, and on the way.
    start: [Vec<f64>; 2],
    q: Vec<f64>,
    v: Vec<f64>,
    /// The joint velocity that is wanted, and J_cᵀn̂ of a pair.
    w: Vec<f64>,
    row: Vec<f64>,
    /// The columns of the Jacobian of the task, where the end effector holds.
    columns: Vec<SVector<f64, M>>,
    /// 1/M_ii at the beginning: how easily a joint gives way.
    inverse_inertia: Vec<f64>,
    /// Largest joint speeds [rad/s].
    speed: Vec<f64>,
    obstacles: Vec<usize>,
    pairs: Vec<Contact<D>>,
    /// The bodies one step before, and of every body and obstacle, how much nearer they can come before they matter.
    bodies: Vec<Body<D>>,
    apart: Vec<Apart>,
    /// Pairs farther apart than this [m] do not matter.
    reach: f64,
    reference: Vec<Sample<R::Pose, M>>,
    /// Duration of a step [s], and the share of the way to the wanted velocity that it makes up for.
    step: f64,
    follow: f64,
    margin: f64,
}

/// A pair that is too far apart to matter.
#[derive(Debug, Clone, Copy, Default)]
struct Apart {
    /// By how much it is, at least [m].
    room: f64,
    /// How far the obstacle goes in one step [m].
    drift: f64,
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> Rollout<R, D, M> {
    #[expect(clippy::cast_precision_loss, reason = "few steps")]
    fn new(robot: &R, yielding: &Yielding, settings: &PreviewSettings) -> Self {
        let n = robot.dof();
        let zeros = || vec![0.0; n];
        let step = settings.horizon / settings.steps as f64;
        Self {
            scout: robot.clone(),
            start: [zeros(), zeros()],
            q: zeros(),
            v: zeros(),
            w: zeros(),
            row: zeros(),
            columns: vec![SVector::zeros(); n],
            inverse_inertia: zeros(),
            speed: yielding.joint_speeds(robot),
            obstacles: vec![],
            pairs: vec![],
            bodies: robot.bodies().collect(),
            apart: vec![],
            reach: NEAR.max(settings.clearance).max(yielding.margin),
            reference: Vec::with_capacity(settings.steps + 1),
            step,
            follow: 1.0 - (-RATE * step).exp(),
            margin: yielding.margin,
        }
    }

    /// Takes in the state, what is around and what is wanted.
    #[expect(clippy::cast_precision_loss, reason = "few steps")]
    fn prepare(
        &mut self,
        settings: &PreviewSettings,
        robot: &R,
        surroundings: &mut impl CollisionQuery<D>,
        reference: impl Fn(f64) -> Sample<R::Pose, M>,
    ) {
        let Self { obstacles, pairs, apart, w, v, inverse_inertia, .. } = self;
        let count = surroundings.obstacle_count();
        obstacles.clear();
        obstacles.reserve(count);
        pairs.clear();
        pairs.reserve(count * robot.body_count());
        apart.clear();
        apart.reserve(count * robot.body_count());
        surroundings.for_each_contact(
            robot.bodies(),
            REACH,
            |_, _| {},
            |pair| {
                if !obstacles.contains(&pair.obstacle) {
                    obstacles.push(pair.obstacle);
                }
            },
        );
        w.fill(0.0);
        for i in 0..robot.dof() {
            w[i] = 1.0;
            robot.mass_mul(w, v);
            w[i] = 0.0;
            inverse_inertia[i] = 1.0 / v[i];
        }
        self.start[0].copy_from_slice(robot.configuration());
        self.start[1].copy_from_slice(robot.velocity());
        self.reference.clear();
        self.reference.extend((0..=settings.steps).map(|k| reference(self.step * k as f64)));
    }

    /// Leaves out obstacles that are there no longer; of those that come, only the next look knows.
    fn forget(&mut self, count: usize) {
        self.obstacles.retain(|j| *j < count);
    }

    /// What becomes of a course that begins `ago` [s] before the present, up to the horizon, or until `enough` is
    /// known after so many seconds.
    #[expect(clippy::cast_precision_loss, reason = "few steps")]
    fn forecast(
        &mut self,
        course: &Course,
        surroundings: &impl CollisionQuery<D>,
        ago: f64,
        enough: impl Fn(Forecast, f64) -> bool,
    ) -> Forecast {
        self.q.copy_from_slice(&self.start[0]);
        self.v.copy_from_slice(&self.start[1]);
        self.apart.clear();
        self.apart.resize(self.bodies.len() * self.obstacles.len(), Apart::default());
        let mut forecast = Forecast { distance: f64::INFINITY, error: 0.0 };
        for k in 0..self.reference.len() {
            let s = self.step * k as f64;
            self.scout.update_positions(&self.q);
            let sample = self.reference[k];
            let e = self.scout.pose().error(&sample.x);
            forecast.error += e.norm() / self.reference.len() as f64;
            forecast.distance = forecast.distance.min(self.measure(surroundings, s - ago));
            if enough(forecast, s) {
                break;
            }
            let wanted = course.holds.then(|| sample.dx - e * PULL);
            self.want(course.at(s), wanted);
            self.advance();
        }
        forecast
    }

    /// The smallest distance when the obstacles have gone on for `after` [s], as far as it is within reach; gathers
    /// the pairs that are near.
    fn measure(&mut self, surroundings: &impl CollisionQuery<D>, after: f64) -> f64 {
        let Self { scout, obstacles, pairs, bodies, apart, reach, step, .. } = self;
        let mut least = f64::INFINITY;
        pairs.clear();
        let mut apart = apart.iter_mut();
        for (i, before) in bodies.iter_mut().enumerate() {
            let body = scout.body(i);
            // No point of the body has gone farther than one of its ends.
            let (now, then) = (&body.shape, &before.shape);
            let ends = [now.start - then.start, now.end() - then.end()];
            let way = ends[0].norm_squared().max(ends[1].norm_squared()).sqrt();
            *before = body;
            for (&j, apart) in obstacles.iter().zip(&mut apart) {
                apart.room -= way + apart.drift;
                if apart.room > 0.0 {
                    continue;
                }
                let pair = surroundings.contact_after(i, &body, j, after);
                *apart =
                    Apart { room: pair.distance - *reach, drift: pair.velocity.norm() * *step };
                least = least.min(pair.distance);
                if pair.distance < NEAR {
                    pairs.push(pair);
                }
            }
        }
        least
    }

    /// The joint velocity `u`, with the task velocity `dx` where the end effector holds, and then, pair by
    /// pair, the nearest one that lets the distance run down no faster than is allowed (T71).
    fn want(&mut self, u: &[f64], dx: Option<SVector<f64, M>>) {
        let Self { scout, w, row, columns, inverse_inertia, pairs, step, margin, .. } = self;
        w.copy_from_slice(u);
        let inverse = dx.map(|mut along| {
            // Damped: where only the end effector can give way, it does.
            let mut gram = SMatrix::<f64, M, M>::identity() * 0.02;
            for (i, ((column, inverse_inertia), u)) in
                columns.iter_mut().zip(&*inverse_inertia).zip(u).enumerate()
            {
                *column = scout.jacobian_column(i);
                gram += *column * column.transpose() * *inverse_inertia;
                along -= *column * *u;
            }
            let inverse = gram.try_inverse().unwrap_or_else(SMatrix::zeros);
            let f = inverse * along;
            for ((w, column), inverse_inertia) in w.iter_mut().zip(&*columns).zip(&*inverse_inertia)
            {
                *w += inverse_inertia * column.dot(&f);
            }
            inverse
        });
        for pair in pairs.iter() {
            scout.point_jacobian_tr_mul(pair.link, &pair.point, &pair.normal, row);
            let rate = dot(row, w) - pair.normal.dot(&pair.velocity);
            let lack = -0.5 / *step * (pair.distance - *margin) - rate;
            if lack > 0.0 {
                let f = inverse.map_or_else(SVector::zeros, |inverse| {
                    let parts = columns.iter().zip(&*inverse_inertia).zip(&*row);
                    inverse
                        * parts.fold(
                            SVector::<f64, M>::zeros(),
                            |sum, ((column, inverse_inertia), row)| {
                                sum + column * (inverse_inertia * row)
                            },
                        )
                });
                let mut along = 0.0;
                for ((row, column), inverse_inertia) in
                    row.iter_mut().zip(&*columns).zip(&*inverse_inertia)
                {
                    let way = inverse_inertia * (*row - column.dot(&f));
                    along += *row * way;
                    *row = way;
                }
                let by = lack / along.max(1e-9);
                w.iter_mut().zip(row.iter()).for_each(|(w, way)| *w += by * way);
            }
        }
    }

    /// One step on, the velocity following `w` as the real one does, within the limits of the joints.
    fn advance(&mut self) {
        let Self { scout, q, v, w, speed, step, follow, .. } = self;
        let ranges = &scout.limits().joint;
        for i in 0..q.len() {
            let before = v[i];
            v[i] = (v[i] + *follow * (w[i] - v[i])).clamp(-speed[i], speed[i]);
            q[i] += 0.5 * *step * (before + v[i]);
            if let Some([low, high]) = ranges.get(i)
                && !(*low..=*high).contains(&q[i])
            {
                (q[i], v[i]) = (q[i].clamp(*low, *high), 0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Avoidance, Settings};
    use crate::math::Vector;
    use crate::robot::{Model, PlanarArm, PlanarState, Robot, planar::Link};
    use crate::world::Motion;
    use crate::world::plane::{Obstacle, Shape, World};
    use std::cell::Cell;
    use std::sync::Arc;

    const START: [f64; 4] = [0.4, 0.5, -0.6, 0.3];

    fn robot() -> PlanarState {
        let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 4], Vector::<2>::zeros()));
        let mut state = arm.state();
        state.update(&START, &[0.0; 4]);
        state
    }

    fn disc(position: [f64; 2], velocity: [f64; 2]) -> Obstacle {
        let shape = Shape::Circle { radius: 0.2 };
        Obstacle { shape, position, angle: 0.0, motion: Motion::Linear { velocity } }
    }

    fn preview(robot: &PlanarState, settings: &PreviewSettings) -> Preview<PlanarState, 2, 2> {
        let law = Settings { avoidance: Avoidance::Cbf, ..Settings::default() };
        Preview::new(robot, &Gains::new(&law).with_seed(7), settings)
    }

    fn holding(robot: &PlanarState) -> Sample<Vector<2>, 2> {
        Sample { x: Manipulator::<2, 2>::pose(robot), dx: Vector::zeros(), ddx: Vector::zeros() }
    }

    /// A free course from rest: q̇ follows u as 1 − e^(−kt), so that q − q₀ is u(t − (1 − e^(−kt))/k), up to
    /// the error of the trapezoidal rule, u k²Δ²/12 of the whole.
    #[test]
    fn a_free_course_is_followed_with_a_lag() {
        let robot = robot();
        let settings = PreviewSettings { horizon: 1.0, steps: 100, ..PreviewSettings::default() };
        let mut preview = preview(&robot, &settings);
        let mut world = World::new(vec![disc([3.0, -3.0], [0.0; 2])]);
        let reference = holding(&robot);
        preview.rollout.prepare(&settings, &robot, &mut world, |_| reference);
        let u = [0.3, -0.2, 0.1, 0.5];
        let course = Course { holds: false, first: u.into(), then: u.into(), switch: 0.0 };
        preview.rollout.forecast(&course, &world, 0.0, |_, _| false);
        let t = 1.0 + preview.rollout.step; // the state after the last step that was measured
        for (i, u) in u.iter().enumerate() {
            let expected = START[i] + u * (t - (1.0 - (-RATE * t).exp()) / RATE);
            assert!((preview.rollout.q[i] - expected).abs() < 1e-4, "{i}");
        }
    }

    /// The end effector is held while the null space moves: the error stays that of the steps alone.
    #[test]
    fn a_course_that_holds_keeps_the_end_effector() {
        let robot = robot();
        let settings = PreviewSettings { horizon: 1.0, steps: 100, ..PreviewSettings::default() };
        let mut preview = preview(&robot, &settings);
        let mut world = World::new(vec![disc([3.0, -3.0], [0.0; 2])]);
        let reference = holding(&robot);
        preview.rollout.prepare(&settings, &robot, &mut world, |_| reference);
        let u = vec![0.3, -0.4, 0.3, 0.1];
        let mut course = Course { holds: true, first: u.clone(), then: u, switch: 0.0 };
        let held = preview.rollout.forecast(&course, &world, 0.0, |_, _| false);
        course.holds = false;
        let free = preview.rollout.forecast(&course, &world, 0.0, |_, _| false);
        assert!(held.error < 0.05 * free.error, "{held:?} {free:?}");
    }

    /// Discs that close on the second link alarm; one that passes does not, nor does one from which the law gets
    /// away, though a roll-out touches it; and without an obstacle there is nothing to look at. What is chosen costs
    /// no more than doing nothing, and keeps the speed limits.
    #[test]
    fn only_what_is_ahead_alarms() {
        let robot = robot();
        let settings = PreviewSettings { horizon: 2.0, alarm: 2.0, ..PreviewSettings::default() };
        let reference = holding(&robot);
        for (obstacles, touched, expected) in [
            (vec![], false, false),
            (vec![disc([1.4, 2.4], [0.0, 0.8])], false, false),
            (vec![disc([1.4, 2.6], [0.0, -0.8])], true, false),
            (vec![disc([1.4, 2.4], [0.0, -0.8]), disc([1.4, -0.6], [0.0, 0.8])], true, true),
        ] {
            let mut world = World::new(obstacles);
            let mut preview = preview(&robot, &settings);
            // The very first step does all of the rehearsal, but the next look is due after a period, not before.
            for half in 0..6 {
                preview.look(&robot, &mut world, |_| reference);
                assert_eq!(preview.is_active(), expected && half >= 2, "{half}: {world:?}");
                preview.elapse(0.5 * settings.period);
            }
            let Preview { course, rollout, .. } = &mut preview;
            let idle = rollout.forecast(&Course::idle(4), &world, 0.0, |_, _| false);
            assert_eq!(idle.distance < 0.0, touched, "{idle:?}");
            if expected {
                let chosen = rollout.forecast(course, &world, 0.0, |_, _| false);
                assert!(chosen.distance > 0.0, "{chosen:?}");
                let fastest = course.first.iter().chain(&course.then).map(|u| u.abs());
                assert!(fastest.fold(0.0, f64::max) <= Yielding::default().speed);
            }
        }
    }

    /// A world that counts how often it is asked for a contact to come.
    struct Asked {
        world: World,
        times: Cell<usize>,
    }

    impl CollisionQuery<2> for Asked {
        fn obstacle_count(&self) -> usize {
            self.world.obstacle_count()
        }

        fn for_each_contact(
            &mut self,
            bodies: impl IntoIterator<Item = Body<2>>,
            reach: f64,
            distance: impl FnMut(usize, f64),
            visit: impl FnMut(&Contact<2>),
        ) {
            self.world.for_each_contact(bodies, reach, distance, visit);
        }

        fn contact_after(&self, i: usize, body: &Body<2>, j: usize, after: f64) -> Contact<2> {
            self.times.set(self.times.get() + 1);
            self.world.contact_after(i, body, j, after)
        }
    }

    fn closing() -> World {
        World::new(vec![disc([1.4, 2.4], [0.0, -0.8]), disc([1.4, -0.6], [0.0, 0.8])])
    }

    /// However long the control period is: every look tries all courses, and no step does more than its share of the
    /// roll-outs. Only the first step of all, which does not know the period, does all of the rehearsal.
    #[test]
    fn a_look_is_spread_over_its_period() {
        let robot = robot();
        let reference = holding(&robot);
        // Nothing is ever far enough away: courses are tried as long as there is time.
        let settings = PreviewSettings {
            horizon: 2.0,
            alarm: 2.0,
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
            preview.look(&robot, &mut world, |_| reference);
            assert!(preview.hit);
            for step in 1..4 * steps {
                let begins = step % steps == 0;
                let before = if begins { 0 } else { preview.tried };
                world.times.set(0);
                preview.elapse(dt);
                preview.look(&robot, &mut world, |_| reference);
                assert_eq!(preview.waited == 0.0, begins, "{dt}: {step}");
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
            preview.look(&robot, &mut world, |_| reference);
            assert_eq!(world.times.get(), 0);
        }
    }

    /// A rehearsal takes two looks, and no step does more than its share; a new one begins at once, as long as a
    /// roll-out is hit.
    #[test]
    fn a_rehearsal_is_spread_over_two_looks() {
        let robot = robot();
        let settings = PreviewSettings { horizon: 2.0, alarm: 2.0, ..PreviewSettings::default() };
        let reference = holding(&robot);
        for (dt, steps, share) in [(1e-3, 20, 5), (0.015, 2, 75), (0.05, 1, 200)] {
            // A roll-out touches this disc, the law does not.
            let mut world = World::new(vec![disc([1.4, 2.6], [0.0, -0.8])]);
            let mut preview = preview(&robot, &settings);
            preview.look(&robot, &mut world, |_| reference);
            assert!(!preview.hit && !preview.rehearsal.goes_on());
            for step in 1..=6 * steps {
                let before = preview.rehearsal.done();
                preview.elapse(dt);
                preview.look(&robot, &mut world, |_| reference);
                let done = preview.rehearsal.done();
                let done = if done < before { done } else { done - before };
                assert!(done <= share, "{dt}: {done}");
                if steps == 20 {
                    let over = (step + 1) % (2 * steps) == steps;
                    assert_eq!(preview.rehearsal.goes_on(), step >= steps && !over, "{step}");
                }
            }
            assert!(!preview.hit && preview.rehearsal.done() > 0);
        }
    }

    /// Roll-outs of one look mean the same instants, whenever in its period they are made; and obstacles may go away
    /// meanwhile.
    #[test]
    fn a_later_share_looks_at_the_same_instants() {
        let robot = robot();
        let settings = PreviewSettings::default();
        let mut preview = preview(&robot, &settings);
        let (mut world, reference) = (closing(), holding(&robot));
        preview.rollout.prepare(&settings, &robot, &mut world, |_| reference);
        let idle = Course::idle(4);
        let now = preview.rollout.forecast(&idle, &world, 0.0, |_, _| false);
        world.update(0.015);
        let later = preview.rollout.forecast(&idle, &world, 0.015, |_, _| false);
        assert!((now.distance - later.distance).abs() < 1e-12, "{now:?} {later:?}");
        assert!((now.error - later.error).abs() < 1e-12);
        world.remove(1);
        preview.rollout.forget(world.len());
        let alone = preview.rollout.forecast(&idle, &world, 0.015, |_, _| false);
        assert!(alone.distance >= later.distance);
    }

    /// Pairs that are too far apart to matter are not asked for, and that changes nothing: the same bits as where
    /// all are.
    #[test]
    fn what_is_left_out_does_not_matter() {
        let robot = robot();
        let settings = PreviewSettings::default();
        let mut preview = preview(&robot, &settings);
        let mut discs = vec![disc([1.4, 2.4], [0.0, -0.8]), disc([-1.0, -2.0], [1.5, 1.0])];
        discs.extend((0..6).map(|k| disc([2.0 + 0.3 * f64::from(k), 2.5], [-0.5, 0.1])));
        let mut world = Asked { world: World::new(discs), times: Cell::new(0) };
        let reference = holding(&robot);
        preview.rollout.prepare(&settings, &robot, &mut world, |_| reference);
        let mut noise = Noise::new(3, STREAM);
        let mut course = Course::idle(4);
        let mut asked = [0, 0];
        for _ in 0..50 {
            let [few, all] = [NEAR, f64::INFINITY].map(|reach| {
                preview.rollout.reach = reach;
                world.times.set(0);
                let forecast = preview.rollout.forecast(&course, &world, 0.0, |_, _| false);
                asked[usize::from(reach > NEAR)] += world.times.get();
                (forecast.distance.min(NEAR), forecast.error, preview.rollout.q.clone())
            });
            assert_eq!(few, all);
            course.draw(&mut noise, 1.0);
        }
        assert!(asked[0] < asked[1] / 2, "{asked:?}");
    }
}
