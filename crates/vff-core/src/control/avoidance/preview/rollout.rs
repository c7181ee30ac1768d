//! What a candidate leads to, predicted by kinematics alone (T71).

use super::candidate::{Candidate, Forecast};
use super::prediction::{Near, Prediction};
use crate::control::avoidance::order::Order;
use crate::control::deadline::Budget;
use crate::control::metric::TaskMetric;
use crate::control::{PreviewSettings, Yielding};
use crate::geometry::Body;
use crate::interrupt;
use crate::math::{Pose, dot};
use crate::robot::Manipulator;
use crate::trajectory::Sample;
use crate::world::PairMargin;
use nalgebra::{SMatrix, SVector};

/// Obstacles farther away than this \[m\] are left out of a planning cycle.
const REACH: f64 = 4.0;

/// Pairs nearer than this \[m\] limit the velocity in a roll-out, with a margin of their own as much farther as that is larger.
pub const NEAR: f64 = 0.5;

/// How fast the arm takes up the joint velocity of a candidate \[1/s\].
pub const RATE: f64 = 10.0;

/// How fast a roll-out returns to the reference \[1/s\].
const PULL: f64 = 3.0;

/// What rounding cannot make of a rate \[m/s\].
const SURELY: f64 = 1e-6;

/// Damping of the task's inverse inertia \[1/kg\]: where only the end effector can give way, it does.
const DAMPING: f64 = 0.02;

/// The arm as a chain without mass that follows a candidate, pushed aside like the real one by the constraints of
/// the QP.
#[derive(Debug, Clone)]
pub struct Rollout<R: Manipulator<D, M>, const D: usize, const M: usize> {
    /// The robot on the way.
    scout: R,
    /// Configuration and joint velocity at the beginning, and on the way.
    start: [Vec<f64>; 2],
    pub(super) q: Vec<f64>,
    v: Vec<f64>,
    /// How many instants have been looked at, and what they have come to.
    done: usize,
    so_far: Forecast,
    /// The joint velocity that is wanted, and J_cᵀn̂ of a pair.
    w: Vec<f64>,
    row: Vec<f64>,
    /// The columns of the Jacobian of the task, where the end effector holds.
    columns: Vec<SVector<f64, M>>,
    /// 1/M_ii at the beginning: how easily a joint gives way.
    inverse_inertia: Vec<f64>,
    /// Largest joint speeds \[rad/s\].
    pub(super) speed: Vec<f64>,
    /// The obstacles that are near at the beginning.
    pub(super) obstacles: Vec<usize>,
    pairs: Vec<Near<D>>,
    /// The bodies one step before, and of every body and obstacle, how much nearer they can come before they matter.
    bodies: Vec<Body<'static, D>>,
    apart: Vec<Apart>,
    /// Pairs farther apart than this \[m\] do not matter.
    pub(super) reach: f64,
    /// Pairs nearer than this \[m\] limit the velocity.
    near: f64,
    reference: Vec<Sample<R::Pose, M>>,
    /// How many instants that has.
    instants: usize,
    /// Duration of a step \[s\], and the share of the velocity error that it removes.
    pub(super) step: f64,
    follow: f64,
    margin: f64,
    metric: TaskMetric<M>,
    pub(super) order: Order,
}

/// A pair that is too far apart to matter.
#[derive(Debug, Clone, Copy, Default)]
struct Apart {
    /// By how much it is, at least \[m\].
    room: f64,
    /// How far the obstacle goes in one step \[m\].
    drift: f64,
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> Rollout<R, D, M> {
    #[expect(clippy::cast_precision_loss, reason = "few steps")]
    /// For `robot`, with task errors measured by `metric`.
    pub fn new(
        robot: &R,
        (yielding, speed): (&Yielding, Vec<f64>),
        settings: &PreviewSettings,
        metric: TaskMetric<M>,
    ) -> Self {
        let n = robot.dof();
        let zeros = || vec![0.0; n];
        let step = settings.horizon / settings.steps as f64;
        Self {
            scout: robot.clone(),
            start: [zeros(), zeros()],
            q: zeros(),
            v: zeros(),
            done: 0,
            so_far: Forecast::NOTHING,
            w: zeros(),
            row: zeros(),
            columns: vec![SVector::zeros(); n],
            inverse_inertia: zeros(),
            speed,
            obstacles: vec![],
            pairs: vec![],
            bodies: robot.bodies().map(|body| body.enclosing()).collect(),
            apart: vec![],
            reach: NEAR.max(settings.clearance).max(yielding.margin),
            near: NEAR,
            reference: vec![],
            instants: settings.steps + 1,
            step,
            follow: 1.0 - (-RATE * step).exp(),
            margin: yielding.margin,
            metric,
            order: Order::of::<D, M>(yielding),
        }
    }

    /// Makes room for so many more obstacles, and contacts of each body.
    pub fn reserve(&mut self, count: usize, contacts: usize) {
        let Self { obstacles, pairs, apart, bodies, reference, instants, .. } = self;
        reference.reserve(instants.saturating_sub(reference.len()));
        obstacles.reserve(count);
        pairs.reserve(contacts * bodies.len());
        apart.reserve(count * bodies.len());
    }

    /// Takes in the state, what is around and what is wanted.
    #[expect(clippy::cast_precision_loss, reason = "few steps")]
    pub fn prepare(
        &mut self,
        settings: &PreviewSettings,
        robot: &R,
        surroundings: &mut dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
    ) {
        let Self { obstacles, pairs, apart, .. } = self;
        obstacles.clear();
        pairs.clear();
        apart.clear();
        self.reserve(surroundings.count(), surroundings.most_contacts());
        let Self { obstacles, bodies, near, margin, w, v, inverse_inertia, .. } = self;
        bodies.iter_mut().zip(robot.bodies()).for_each(|(kept, body)| *kept = body.enclosing());
        *near = NEAR + PairMargin::farther(surroundings.largest_margin(), *margin);
        surroundings.obstacles_near(bodies, REACH, settings.chance, obstacles);
        w.fill(0.0);
        for i in 0..robot.dof() {
            interrupt::checkpoint(16 * robot.dof());
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

    /// Leaves out obstacles that do not exist any longer. New ones are known to the next planning cycle only. Whether there
    /// were any: what is under way is to begin anew.
    pub fn forget(&mut self, count: usize) -> bool {
        let before = self.obstacles.len();
        self.obstacles.retain(|j| *j < count);
        self.obstacles.len() < before
    }

    /// Begins to find out what a candidate leads to.
    pub fn begin(&mut self) {
        self.q.copy_from_slice(&self.start[0]);
        self.v.copy_from_slice(&self.start[1]);
        self.apart.clear();
        self.apart.resize(self.bodies.len() * self.obstacles.len(), Apart::default());
        (self.done, self.so_far) = (0, Forecast::NOTHING);
    }

    /// What a candidate leads to that began `ago` \[s\] before the present: up to the horizon, or until
    /// `enough(forecast, s)` holds after s seconds. None where the time of this control cycle is over before that: then it is
    /// to go on in the next.
    #[expect(clippy::cast_precision_loss, reason = "few steps")]
    pub fn go_on(
        &mut self,
        candidate: &Candidate,
        surroundings: &dyn Prediction<D>,
        ago: f64,
        enough: &dyn Fn(Forecast, f64) -> bool,
        budget: &Budget,
    ) -> Option<Forecast> {
        while self.done < self.reference.len() {
            if !budget.is_left() {
                return None;
            }
            let k = self.done;
            let s = self.step * k as f64;
            interrupt::checkpoint(8 * self.apart.len());
            self.scout.update_positions(&self.q);
            let sample = self.reference[k];
            let e = self.scout.pose().error(&sample.x);
            let error = self.order.size(&self.scout, &self.metric, &e);
            let distance = self.measure(surroundings, s - ago);
            let forecast = &mut self.so_far;
            forecast.error += error / self.reference.len() as f64;
            if k > 0 {
                forecast.worst = forecast.worst.max(error);
            }
            forecast.distance = forecast.distance.min(distance);
            self.done += 1;
            if enough(self.so_far, s) {
                break;
            }
            let released = candidate.released;
            let wanted = (released < self.order.count()).then(|| {
                let [dx, _] = self.scout.resolve(&sample.x, &sample.dx, &sample.ddx);
                let held = (released > 0).then(|| self.order.held(&self.scout, released));
                (dx - e * PULL, held)
            });
            self.want(candidate.at(s), wanted);
            self.advance();
        }
        Some(self.so_far)
    }

    /// All of it at once.
    #[cfg(test)]
    pub fn forecast(
        &mut self,
        candidate: &Candidate,
        surroundings: &dyn Prediction<D>,
        ago: f64,
        enough: &dyn Fn(Forecast, f64) -> bool,
    ) -> Forecast {
        self.begin();
        let unlimited = Budget::of_simulation(None);
        self.go_on(candidate, surroundings, ago, enough, &unlimited).expect("unlimited")
    }

    /// The smallest distance to the obstacles predicted for `after` \[s\] from now, as one of a pair that keeps the usual margin, as far
    /// as it is within reach;
    /// gathers the pairs that are near.
    fn measure(&mut self, surroundings: &dyn Prediction<D>, after: f64) -> f64 {
        let Self { scout, obstacles, pairs, bodies, apart, reach, near, margin, step, .. } = self;
        let mut least = f64::INFINITY;
        pairs.clear();
        let mut apart = apart.iter_mut();
        for (i, before) in bodies.iter_mut().enumerate() {
            let body = scout.body(i);
            let (now, then) = (&body.shape, &before.shape);
            // No point of the body has gone farther than one of its ends.
            let ends = [now.start - then.start, now.end() - then.end()];
            let way = ends[0].norm_squared().max(ends[1].norm_squared()).sqrt();
            *before = body.enclosing();
            for (&j, apart) in obstacles.iter().zip(&mut apart) {
                apart.room -= way + apart.drift;
                if apart.room > 0.0 {
                    continue;
                }
                // Of a hull it is the capsule around it that says how long nothing matters.
                let nearest = if body.hull.is_some() {
                    let unreached = f64::NEG_INFINITY;
                    surroundings.approach(i, before, j, after, unreached, pairs)
                } else {
                    surroundings.approach(i, &body, j, after, *near, pairs)
                };
                let mut distance = nearest.distance(*margin);
                let room = distance - *reach;
                // What matters now is asked in the next step, however fast it comes.
                let drift = if room > 0.0 { nearest.speed() * *step } else { 0.0 };
                *apart = Apart { room, drift };
                if body.hull.is_some() && room <= 0.0 {
                    let of_hull = surroundings.approach(i, &body, j, after, *near, pairs);
                    distance = of_hull.distance(*margin);
                }
                least = least.min(distance);
            }
        }
        least
    }

    /// The joint velocity `u`, with a task velocity where the end effector holds its task, or those directions of it alone, and then,
    /// pair by pair, the nearest one at which the distance decreases no faster than is allowed (T71).
    fn want(&mut self, u: &[f64], held: Option<(SVector<f64, M>, Option<SMatrix<f64, M, M>>)>) {
        let Self { scout, w, row, columns, inverse_inertia, pairs, step, margin, metric, .. } =
            self;
        w.copy_from_slice(u);
        let inverse = held.map(|(mut along, held)| {
            let mut gram = metric.inverse_weight() * DAMPING;
            for (i, ((column, inverse_inertia), u)) in
                columns.iter_mut().zip(&*inverse_inertia).zip(u).enumerate()
            {
                *column = scout.jacobian_column(i);
                gram += *column * column.transpose() * *inverse_inertia;
                along -= *column * *u;
            }
            let inverse = gram.try_inverse().unwrap_or_else(SMatrix::zeros);
            // What is let go goes as the joints do.
            let inverse = held.map_or(inverse, |held| inverse * held);
            let f = inverse * along;
            for ((w, column), inverse_inertia) in w.iter_mut().zip(&*columns).zip(&*inverse_inertia)
            {
                *w += inverse_inertia * column.dot(&f);
            }
            inverse
        });
        scout.update_velocities(w);
        for Near { link, point, normal, distance, margin: own, comes } in pairs.iter() {
            interrupt::checkpoint(8 * row.len());
            let least = -0.5 / *step * (distance - own.or(*margin));
            // Most pairs keep apart by far, which takes no row of the Jacobian to see.
            if normal.dot(&scout.point_velocity(*link, point)) - comes > least + SURELY {
                continue;
            }
            scout.point_jacobian_tr_mul(*link, point, normal, row);
            let rate = dot(row, w) - comes;
            let missing = least - rate;
            if missing > 0.0 {
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
                let by = missing / along.max(1e-9);
                w.iter_mut().zip(row.iter()).for_each(|(w, way)| *w += by * way);
                scout.update_velocities(w);
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
    use super::super::fixtures::{Asked, START, closing, disc, holding, robot};
    use super::*;
    use crate::math::Noise;
    use crate::robot::description::PlacedShape;
    use crate::robot::{Manipulator, PlanarState, Robot, SpatialState, models};
    use crate::world::plane::World;
    use crate::world::{Motion, space};
    use std::cell::Cell;
    use std::sync::Arc;

    fn rollout(robot: &PlanarState, settings: &PreviewSettings) -> Rollout<PlanarState, 2, 2> {
        let yielding = Yielding::default();
        let speed = vec![yielding.speed; robot.dof()];
        Rollout::new(robot, (&yielding, speed), settings, TaskMetric::new::<2>(1.0))
    }

    /// A free candidate from rest: q̇ follows u as 1 − e^(−kt), so that q − q₀ is u(t − (1 − e^(−kt))/k), up to
    /// the error of the trapezoidal rule, u k²Δ²/12 of the whole.
    #[test]
    fn a_free_candidate_is_followed_with_a_lag() {
        let robot = robot();
        let settings = PreviewSettings { horizon: 1.0, steps: 100, ..PreviewSettings::default() };
        let mut rollout = rollout(&robot, &settings);
        let mut world = World::new(vec![disc([3.0, -3.0], [0.0; 2])]);
        let reference = holding(&robot);
        rollout.prepare(&settings, &robot, &mut world, &|_| reference);
        let u = [0.3, -0.2, 0.1, 0.5];
        let candidate = Candidate { released: 1, first: u.into(), then: u.into(), switch: 0.0 };
        rollout.forecast(&candidate, &world, 0.0, &|_, _| false);
        let t = 1.0 + rollout.step; // the state after the last step that was measured
        for (i, u) in u.iter().enumerate() {
            let expected = START[i] + u * (t - (1.0 - (-RATE * t).exp()) / RATE);
            assert!((rollout.q[i] - expected).abs() < 1e-4, "{i}");
        }
    }

    /// The end effector is held while the null space moves: the error stays that of the steps alone.
    #[test]
    fn a_candidate_that_holds_keeps_the_end_effector() {
        let robot = robot();
        let settings = PreviewSettings { horizon: 1.0, steps: 100, ..PreviewSettings::default() };
        let mut rollout = rollout(&robot, &settings);
        let mut world = World::new(vec![disc([3.0, -3.0], [0.0; 2])]);
        let reference = holding(&robot);
        rollout.prepare(&settings, &robot, &mut world, &|_| reference);
        let u = vec![0.3, -0.4, 0.3, 0.1];
        let mut candidate = Candidate { released: 0, first: u.clone(), then: u, switch: 0.0 };
        let held = rollout.forecast(&candidate, &world, 0.0, &|_, _| false);
        candidate.released = 1;
        let free = rollout.forecast(&candidate, &world, 0.0, &|_, _| false);
        assert!(held.error < 0.05 * free.error, "{held:?} {free:?}");
    }

    /// Roll-outs of one planning cycle mean the same instants, in whichever control step they are made; and obstacles
    /// may be removed meanwhile.
    #[test]
    fn later_steps_predict_the_same_instants() {
        let robot = robot();
        let settings = PreviewSettings::default();
        let mut rollout = rollout(&robot, &settings);
        let (mut world, reference) = (closing(), holding(&robot));
        rollout.prepare(&settings, &robot, &mut world, &|_| reference);
        let idle = Candidate::idle(4);
        let now = rollout.forecast(&idle, &world, 0.0, &|_, _| false);
        world.update(0.015);
        let later = rollout.forecast(&idle, &world, 0.015, &|_, _| false);
        assert!((now.distance - later.distance).abs() < 1e-12, "{now:?} {later:?}");
        assert!((now.error - later.error).abs() < 1e-12);
        world.remove(1);
        rollout.forget(world.len());
        let alone = rollout.forecast(&idle, &world, 0.015, &|_, _| false);
        assert!(alone.distance >= later.distance);
    }

    /// Pairs that are too far apart to matter are not asked for, and that changes nothing: the same bits as where
    /// all are.
    #[test]
    fn what_is_left_out_does_not_matter() {
        let robot = robot();
        let settings = PreviewSettings::default();
        let mut rollout = rollout(&robot, &settings);
        let mut discs = vec![disc([1.4, 2.4], [0.0, -0.8]), disc([-1.0, -2.0], [1.5, 1.0])];
        discs.extend((0..6).map(|k| disc([2.0 + 0.3 * f64::from(k), 2.5], [-0.5, 0.1])));
        let mut world = Asked { world: World::new(discs), times: Cell::new(0) };
        let reference = holding(&robot);
        rollout.prepare(&settings, &robot, &mut world, &|_| reference);
        let mut noise = Noise::new(3, 4);
        let mut candidate = Candidate::idle(4);
        let mut asked = [0, 0];
        for _ in 0..50 {
            let [few, all] = [NEAR, f64::INFINITY].map(|reach| {
                rollout.reach = reach;
                world.times.set(0);
                let forecast = rollout.forecast(&candidate, &world, 0.0, &|_, _| false);
                asked[usize::from(reach > NEAR)] += world.times.get();
                (forecast.distance.min(NEAR), forecast.error, rollout.q.clone())
            });
            assert_eq!(few, all);
            candidate.draw(&mut noise, 1, 1.0);
        }
        assert!(asked[0] < asked[1] / 2, "{asked:?}");
    }

    /// Nor does it of boxes on an arm in space, where the capsules around them say what is far.
    #[test]
    fn what_is_left_out_of_boxes_does_not_matter() {
        let mut description = models::named("panda").unwrap();
        let cube = space::Shape::Box { size: [0.25, 0.03, 0.2] };
        let cube = PlacedShape { center: Some([0.0, 0.0, -0.05]), ..cube.into() };
        for part in &mut description.collision {
            part.shape = cube.clone();
        }
        let mut robot = Arc::new(description.build().unwrap()).state();
        robot.update(&[0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], &[0.0; 7]);
        let ball = |position: [f64; 3], velocity: [f64; 3]| space::Obstacle {
            position,
            motion: Motion::Linear { velocity },
            ..space::Obstacle::of(space::Shape::Sphere { radius: 0.05 })
        };
        let mut world = space::World::new(vec![
            ball([-0.05, -0.5, 0.6], [0.0, 0.6, 0.0]),
            ball([0.6, 0.5, 0.4], [-0.2, -0.4, 0.1]),
            ball([0.2, 0.0, 1.4], [0.0, 0.0, -0.5]),
        ]);
        let settings = PreviewSettings::default();
        let metric = TaskMetric::new::<3>(0.3);
        let mut rollout = Rollout::<SpatialState, 3, 6>::new(
            &robot,
            (&Yielding::default(), vec![Yielding::default().speed; robot.dof()]),
            &settings,
            metric,
        );
        let reference = Sample::at_rest(Manipulator::<3, 6>::pose(&robot));
        rollout.prepare(&settings, &robot, &mut world, &|_| reference);
        let mut noise = Noise::new(3, 4);
        let mut candidate = Candidate::idle(7);
        let mut nearest = f64::INFINITY;
        for _ in 0..30 {
            let [few, all] = [NEAR, f64::INFINITY].map(|reach| {
                rollout.reach = reach;
                let forecast = rollout.forecast(&candidate, &world, 0.0, &|_, _| false);
                (forecast.distance.min(NEAR), forecast.error, rollout.q.clone())
            });
            assert_eq!(few, all);
            nearest = nearest.min(few.0);
            candidate.draw(&mut noise, 1, 1.0);
        }
        // Some of it was near.
        assert!(nearest < 0.5 * NEAR, "{nearest}");
    }
}
