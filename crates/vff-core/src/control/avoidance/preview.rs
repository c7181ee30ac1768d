//! Look-ahead on top of `cbf` (T71–T74): whether the arm, left to itself, would be hit within the next
//! seconds, and if so, which joint velocity would take it out of the way.

use crate::control::{OperationalSpace, Torque, dot};
use crate::math::{Noise, Vector};
use crate::robot::Robot;
use crate::trajectory::Sample;
use crate::world::{Contact, Surroundings};
use nalgebra::SMatrix;
use serde::Deserialize;

/// The stream of random numbers that candidates are drawn from.
const STREAM: u64 = 4;

/// How the arm looks ahead: the `[controller.yielding.preview]` table of a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PreviewSettings {
    /// Time between two looks [s], > 0.
    pub period: f64,
    /// How far a look goes [s], > 0.
    pub horizon: f64,
    /// Instants at which a look measures distances, ≥ 1.
    pub steps: usize,
    /// Joint velocities that are tried, ≥ 1.
    pub candidates: usize,
    /// Distance that a look wants to keep [m], > 0.
    pub clearance: f64,
    /// gate
    pub gate: f64,
    /// Spread
    pub speed: f64,
    /// rate
    pub rate: f64,
    pub x1: f64,
    pub x2: f64,
    pub x3: f64,
    pub x4: f64,
    pub x5: f64,
    pub x6: f64,
    pub x7: f64,
    pub x8: f64,
    pub x9: f64,
}

impl Default for PreviewSettings {
    fn default() -> Self {
        Self {
            period: 0.02,
            horizon: 3.0,
            steps: 24,
            candidates: 64,
            clearance: 0.1,
            gate: 0.0,
            speed: 1.0,
            rate: 10.0,
            x1: 0.0,
            x2: 0.0,
            x3: 0.0,
            x4: 0.0,
            x5: 0.5,
            x6: 0.02,
            x7: 0.5,
            x8: 0.5,
            x9: 0.03,
        }
    }
}

/// What the arm might do.
#[derive(Debug, Clone, Default)]
struct Course {
    /// Whether the end effector keeps to its task.
    holds: bool,
    /// Joint velocity [rad/s] until `switch`, and from then on; with the end effector held, before projection.
    first: Vec<f64>,
    then: Vec<f64>,
    /// [s] from now.
    switch: f64,
}

impl Course {
    fn new(n: usize) -> Self {
        Self { holds: true, first: vec![0.0; n], then: vec![0.0; n], switch: 0.0 }
    }

    fn copy_from(&mut self, other: &Self) {
        (self.holds, self.switch) = (other.holds, other.switch);
        self.first.copy_from_slice(&other.first);
        self.then.copy_from_slice(&other.then);
    }

    fn at(&self, s: f64) -> &[f64] {
        if s < self.switch { &self.first } else { &self.then }
    }

    fn elapse(&mut self, dt: f64) {
        self.switch -= dt;
        if self.switch <= 0.0 {
            self.first.copy_from_slice(&self.then);
        }
    }
}

/// Look-ahead with its workspace.
#[derive(Debug, Clone)]
pub struct Preview<R, const D: usize, const M: usize> {
    settings: PreviewSettings,
    seed: u64,
    noise: Noise,
    /// Time since the last look [s]; infinite before the first.
    waited: f64,
    /// The course that is being taken; none if the arm may be left to itself.
    course: Option<Course>,
    spare: [Course; 2],
    roll: Roll<R, D, M>,
}

/// What a roll-out needs.
#[derive(Debug, Clone)]
struct Roll<R, const D: usize, const M: usize> {
    scout: R,
    q: Vec<f64>,
    v: Vec<f64>,
    w: Vec<f64>,
    q0: Vec<f64>,
    v0: Vec<f64>,
    speed: Vec<f64>,
    /// Obstacles that may matter, with their velocities [m/s].
    movers: Vec<(usize, Vector<D>)>,
    reference: Vec<Sample<M>>,
    /// 1/M_ii
    ease: Vec<f64>,
    rows: Vec<Contact<D>>,
    p: Vec<f64>,
}

impl<R: Robot<D> + Clone, const D: usize, const M: usize> Preview<R, D, M> {
    /// For `robot`.
    pub fn new(robot: &R, settings: &PreviewSettings, speed: f64, seed: u64) -> Self {
        let n = robot.dof();
        let limits = &robot.limits().velocity;
        let zeros = || vec![0.0; n];
        Self {
            settings: settings.clone(),
            seed,
            noise: Noise::new(seed, STREAM),
            waited: f64::INFINITY,
            course: None,
            spare: [Course::new(n), Course::new(n)],
            roll: Roll {
                scout: robot.clone(),
                q: zeros(),
                v: zeros(),
                w: zeros(),
                q0: zeros(),
                v0: zeros(),
                speed: if limits.is_empty() { vec![speed; n] } else { limits.clone() },
                movers: vec![],
                reference: Vec::with_capacity(settings.steps + 1),
                ease: zeros(),
                rows: vec![],
                p: zeros(),
            },
        }
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.noise = Noise::new(self.seed, STREAM);
        self.waited = f64::INFINITY;
        self.course = None;
    }

    /// Lets `dt` [s] pass.
    pub fn elapse(&mut self, dt: f64) {
        self.waited += dt;
        if let Some(course) = &mut self.course {
            course.elapse(dt);
        }
    }

    /// Looks ahead, if it is time.
    pub fn look(
        &mut self,
        robot: &R,
        surroundings: &mut impl Surroundings<D>,
        reference: impl Fn(f64) -> Sample<M>,
    ) {
        if self.waited < self.settings.period - 1e-9 {
            return;
        }
        self.waited = 0.0;
        let Self { settings, noise, course, spare: [best, trial], roll, .. } = self;
        let n = robot.dof();
        roll.gather(settings, robot, surroundings, reference);
        if roll.movers.is_empty() {
            *course = None;
            return;
        }
        // Left to itself.
        best.holds = true;
        best.first.fill(0.0);
        best.then.fill(0.0);
        best.switch = 0.0;
        let gate = if course.is_some() { settings.clearance * settings.x5 } else { settings.gate };
        let [depth, away] = roll.cost(settings, best, surroundings, f64::INFINITY);
        if depth <= settings.clearance - gate {
            *course = None;
            return;
        }
        let total = |[depth, away]: [f64; 2]| 100.0 * depth + away;
        let mut least = total([depth, away]) + settings.x1;
        if let Some(course) = course {
            trial.copy_from(course);
            let cost = total(roll.cost(settings, trial, surroundings, least));
            if cost < least {
                least = cost;
                best.copy_from(trial);
            }
        }
        least += settings.x2;
        for k in 0..settings.candidates {
            let refine = 2 * k >= settings.candidates || (course.is_some() && k % 2 == 0);
            if refine {
                trial.copy_from(best);
                let spread = settings.speed * if k % 4 < 2 { 0.3 } else { 0.1 };
                for i in 0..n {
                    trial.first[i] += spread * noise.draw();
                    trial.then[i] += spread * noise.draw();
                }
                trial.switch = (trial.switch + 0.2 * noise.draw()).max(0.0);
                if k % 8 == 7 {
                    trial.holds = !trial.holds;
                }
            } else {
                trial.holds = noise.share() < 0.5;
                let spread = settings.speed * if k % 3 == 0 { 0.4 } else { 1.0 };
                let same = noise.share() < settings.x3;
                for i in 0..n {
                    trial.first[i] = spread * noise.draw();
                    trial.then[i] = if same { trial.first[i] } else { spread * noise.draw() };
                }
                trial.switch = if same { 0.0 } else { 1.5 * noise.share() };
            }
            for i in 0..n {
                let most = 0.9 * roll.speed[i];
                trial.first[i] = trial.first[i].clamp(-most, most);
                trial.then[i] = trial.then[i].clamp(-most, most);
            }
            let cost = total(roll.cost(settings, trial, surroundings, least));
            if cost < least {
                least = cost;
                std::mem::swap(best, trial);
            }
        }
        course.get_or_insert_with(|| Course::new(n)).copy_from(best);
    }

    /// Whether a course is being taken.
    pub fn acts(&self) -> bool {
        self.course.is_some()
    }

    /// Changes the torque of the null-space law into one that takes the course.
    pub fn act(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        bias: &[f64],
        torque: &mut Torque,
    ) {
        let Self { settings, course, roll, .. } = self;
        let Some(course) = course else { return };
        let (change, scratch) = (&mut roll.w, &mut roll.v);
        robot.accelerate(&torque.total, bias, scratch, change);
        let wanted = course.at(0.0);
        for (i, change) in change.iter_mut().enumerate() {
            *change = settings.rate * (wanted[i] - robot.velocity()[i]) - *change;
        }
        if course.holds {
            let task = robot.jacobian_mul::<M>(change);
            space.pinv_mul(&task, scratch);
            change.iter_mut().zip(scratch.iter()).for_each(|(c, s)| *c -= s);
        }
        robot.mass_mul(change, scratch);
        torque.add_to_task(|i| scratch[i]);
    }
}

impl<R: Robot<D> + Clone, const D: usize, const M: usize> Roll<R, D, M> {
    fn gather(
        &mut self,
        settings: &PreviewSettings,
        robot: &R,
        surroundings: &mut impl Surroundings<D>,
        reference: impl Fn(f64) -> Sample<M>,
    ) {
        self.movers.clear();
        self.movers.reserve(surroundings.obstacle_count());
        self.rows.clear();
        self.rows.reserve(surroundings.obstacle_count() * robot.dof());
        for i in 0..robot.dof() {
            self.w.fill(0.0);
            self.w[i] = 1.0;
            robot.mass_mul(&self.w, &mut self.v);
            self.ease[i] = 1.0 / self.v[i];
        }
        let links = (0..robot.dof()).map(|i| robot.link(i));
        let movers = &mut self.movers;
        let take = |pair: &Contact<D>| {
            if movers.iter().all(|(j, _)| *j != pair.obstacle) {
                movers.push((pair.obstacle, pair.velocity));
            }
        };
        surroundings.for_each_contact(links, 4.0, |_, _| {}, take);
        self.q0.copy_from_slice(robot.configuration());
        self.v0.copy_from_slice(robot.velocity());
        self.reference.clear();
        let ds = settings.horizon / settings.steps as f64;
        self.reference.extend((0..=settings.steps).map(|k| reference(ds * k as f64)));
    }

    /// What a course costs; more than `most` if it costs more than that.
    fn cost(
        &mut self,
        settings: &PreviewSettings,
        course: &Course,
        surroundings: &impl Surroundings<D>,
        most: f64,
    ) -> [f64; 2] {
        let Self { scout, q, v, w, q0, v0, speed, movers, reference, ease, rows, p } = self;
        let steps = settings.steps;
        let ds = settings.horizon / steps as f64;
        let follow = 1.0 - (-settings.rate * ds).exp();
        let keep = settings.x7 / ds;
        let n = q.len();
        q.copy_from_slice(q0);
        v.copy_from_slice(v0);
        scout.place(q);
        let (mut depth, mut away) = (0.0_f64, 0.0);
        for k in 0..=steps {
            let s = ds * k as f64;
            let sample = &reference[k];
            let e = crate::control::task::error(scout.pose::<M>(), sample.x);
            away += e.norm() / steps as f64;
            let u = course.at(s);
            let mut gram = SMatrix::<f64, M, M>::identity() * settings.x6;
            let mut along = sample.dx - e * 3.0;
            for i in 0..n {
                let column = scout.jacobian_column::<M>(i);
                gram += column * column.transpose() * ease[i];
                along -= column * u[i];
            }
            let inverse = gram.try_inverse().unwrap_or_else(SMatrix::zeros);
            w.copy_from_slice(u);
            if course.holds {
                let f = inverse * along;
                for i in 0..n {
                    w[i] += ease[i] * scout.jacobian_column::<M>(i).dot(&f);
                }
            }
            let mut d = f64::INFINITY;
            rows.clear();
            for i in 0..n {
                let link = scout.link(i);
                for (j, _) in movers.iter() {
                    let pair = surroundings.contact_after(i, &link, *j, s);
                    d = d.min(pair.distance);
                    if pair.distance < settings.x8 {
                        rows.push(pair);
                    }
                }
            }
            let late = 1.0 - settings.x4 * s / settings.horizon;
            depth = depth.max((settings.clearance - d) * late);
            if 100.0 * depth + away > most {
                return [f64::INFINITY; 2];
            }
            for _ in 0..2 {
                for pair in rows.iter() {
                    scout.point_jacobian_tr_mul(pair.link, &pair.point, &pair.normal, p);
                    let rate = dot(p, w) - pair.normal.dot(&pair.velocity);
                    let lack = -keep * (pair.distance - settings.x9) - rate;
                    if lack > 0.0 {
                        let mut task = nalgebra::SVector::<f64, M>::zeros();
                        for i in 0..n {
                            task += scout.jacobian_column::<M>(i) * (ease[i] * p[i]);
                        }
                        let f = if course.holds { inverse * task } else { task * 0.0 };
                        let mut along = 0.0;
                        for i in 0..n {
                            let row = p[i];
                            p[i] = ease[i] * (row - scout.jacobian_column::<M>(i).dot(&f));
                            along += row * p[i];
                        }
                        let by = lack / along.max(1e-9);
                        for i in 0..n {
                            w[i] += by * p[i];
                        }
                    }
                }
            }
            let ranges = &scout.limits().joint;
            for i in 0..n {
                let before = v[i];
                v[i] = (v[i] + follow * (w[i] - v[i])).clamp(-speed[i], speed[i]);
                q[i] += 0.5 * ds * (before + v[i]);
                if let Some([low, high]) = ranges.get(i) {
                    if q[i] < *low || q[i] > *high {
                        q[i] = q[i].clamp(*low, *high);
                        v[i] = 0.0;
                    }
                }
            }
            scout.place(q);
        }
        [depth, away]
    }
}
