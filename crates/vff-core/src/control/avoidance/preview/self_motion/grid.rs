//! The postures along the self-motion, now and later, and how near the predicted obstacles come to each (T173).
//!
//! Places are numbered along the self-motion, the present posture in the middle. Where the reference moves, the postures of
//! all places are put onto it again at knots, each from that at the knot before by the shortest way; in between they are
//! interpolated.

use super::super::prediction::{Near, Prediction};
use super::cost::Cost;
use super::task_projection::TaskProjection;
use crate::control::metric::TaskMetric;
use crate::control::{SelfMotionSettings, Yielding};
use crate::geometry::Body;
use crate::interrupt;
use crate::math::{Pose, Vector};
use crate::robot::{Limits, Manipulator};

/// Instants from one knot to the next where the reference moves.
const EVERY: usize = 3;
/// A reference that moves less than this stands still \[m\].
const STILL: f64 = 1e-9;
/// How far from their stops postures keep joints, where those are not nearer already \[rad or m\].
const STOP: f64 = 0.03;
/// Obstacles farther from the arm than this \[m\] are left out.
const REACH: f64 = 4.0;

/// A pair of a body and an obstacle, along the instants of one place.
#[derive(Debug, Clone, Copy, Default)]
struct Pair {
    /// By how much it is too far apart to matter, at least \[m\].
    room: f64,
    /// How far the obstacle goes from one instant to the next \[m\].
    drift: f64,
    /// The distance at the instant when it was measured, as one of a pair that keeps the usual margin \[m\], and whether it stays that as long as the body rests.
    distance: f64,
    rests: bool,
}

/// What is around the arm during a search: asked at one instant of the present for those to come.
pub struct Around<'a, const D: usize> {
    /// The obstacles.
    pub surroundings: &'a dyn Prediction<D>,
    /// How long ago the search began \[s\].
    pub ago: f64,
    /// What distances cost.
    pub cost: Cost,
}

/// Postures by place and knot, and distances by place and instant.
#[derive(Debug, Clone)]
pub struct Grid<R: Manipulator<D, M>, const D: usize, const M: usize> {
    scout: R,
    projection: TaskProjection<M>,
    metric: TaskMetric<M>,
    n: usize,
    /// How many places there are on either side of the present posture, and how far apart they are \[rad\].
    half: usize,
    spacing: f64,
    /// How many instants there are, and how far apart they are \[s\].
    instants: usize,
    step: f64,
    /// The largest distance that matters, and what pairs without a margin of their own keep \[m\].
    clearance: f64,
    usual: f64,
    /// Largest joint speeds to plan with \[rad/s\].
    speed: Vec<f64>,
    /// The reference at the knots: one if it stands still.
    poses: Vec<R::Pose>,
    /// Of every knot and place the posture \[rad\], and whether there is one.
    postures: Vec<f64>,
    exists: Vec<bool>,
    /// Of every place and instant the smallest distance, as far as it matters \[m\]; NaN where none was measured.
    distances: Vec<f64>,
    /// What a second costs there by what may come, and how near each of that is at an instant \[m\].
    risks: Vec<f64>,
    possible: Vec<f64>,
    /// The direction in which the self-motion goes on.
    heading: Vec<f64>,
    first_heading: Vec<f64>,
    q: Vec<f64>,
    /// Those that are near, and how many of them, the first ones, are there; the others may come.
    obstacles: Vec<usize>,
    there: usize,
    /// What futures that are left out may come true with.
    chance: f64,
    pairs: Vec<Pair>,
    bodies: Vec<Body<'static, D>>,
    unused: Vec<Near<D>>,
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> Grid<R, D, M> {
    /// For `robot`, with errors of the task measured by `metric`.
    #[expect(clippy::cast_precision_loss, reason = "few places and instants")]
    pub fn new(
        robot: &R,
        (yielding, speeds): (&Yielding, &[f64]),
        settings: &SelfMotionSettings,
        metric: TaskMetric<M>,
    ) -> Self {
        let n = robot.dof();
        let half = half(settings);
        let (places, instants) = (2 * half + 1, settings.steps + 1);
        let knots = settings.steps.div_ceil(EVERY) + 1;
        let speed = speeds.iter().map(|v| settings.speed * v).collect();
        Self {
            scout: robot.clone(),
            projection: TaskProjection::new(n, metric),
            metric,
            n,
            half,
            spacing: settings.spacing,
            instants,
            step: settings.horizon / settings.steps as f64,
            clearance: settings.clearance.max(yielding.margin),
            usual: yielding.margin,
            speed,
            poses: Vec::with_capacity(knots),
            postures: vec![0.0; knots * places * n],
            exists: vec![false; knots * places],
            distances: vec![f64::NAN; places * instants],
            risks: vec![0.0; places * instants],
            possible: vec![],
            heading: vec![0.0; n],
            first_heading: vec![0.0; n],
            q: vec![0.0; n],
            obstacles: vec![],
            there: 0,
            chance: yielding.preview.as_ref().map_or(0.0, |preview| preview.chance),
            pairs: vec![],
            bodies: robot.bodies().map(|body| body.enclosing()).collect(),
            unused: vec![],
        }
    }

    /// Makes room for so many more obstacles.
    pub fn reserve(&mut self, count: usize) {
        self.obstacles.reserve(count);
        self.possible.reserve(count);
        self.pairs.reserve(count * self.bodies.len());
    }

    /// How many places there are.
    pub fn places(&self) -> usize {
        2 * self.half + 1
    }

    /// The place of the present posture.
    pub fn middle(&self) -> usize {
        self.half
    }

    /// The time from one instant to the next \[s\].
    pub fn step(&self) -> f64 {
        self.step
    }

    /// How far apart places are \[rad\].
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// How fast the present posture moves along the self-motion at the joint velocity `dq` \[rad/s\].
    pub fn speed_along(&self, dq: &[f64]) -> f64 {
        self.first_heading.iter().zip(dq).map(|(z, v)| z * v).sum()
    }

    /// Whether an obstacle is near enough to the arm to be looked at.
    pub fn has_obstacles(&self) -> bool {
        !self.obstacles.is_empty()
    }

    /// Takes in the state, what is around and what is wanted: the reference at `pose(s)` in s seconds. Whether the present posture
    /// can be put onto it.
    #[expect(clippy::cast_precision_loss, reason = "few instants")]
    pub fn begin(
        &mut self,
        robot: &R,
        surroundings: &mut dyn Prediction<D>,
        pose: &dyn Fn(f64) -> R::Pose,
    ) -> bool {
        let Self { poses, instants, step, metric, bodies, obstacles, there, chance, .. } = self;
        obstacles.clear();
        obstacles.reserve(surroundings.count());
        bodies.iter_mut().zip(robot.bodies()).for_each(|(kept, body)| *kept = body.enclosing());
        surroundings.obstacles_near(bodies, REACH, *chance, obstacles);
        obstacles.sort_unstable_by_key(|j| (surroundings.may_come(*j), *j));
        *there = obstacles.partition_point(|j| !surroundings.may_come(*j));
        self.pairs.clear();
        self.pairs.reserve(self.obstacles.len() * self.bodies.len());
        poses.clear();
        let knots = (0..=(*instants - 1).div_ceil(EVERY)).map(|r| pose(*step * (EVERY * r) as f64));
        poses.extend(knots);
        let first = poses[0];
        if poses.iter().all(|pose| metric.norm(&pose.error(&first)) < STILL) {
            poses.truncate(1);
        }
        self.exists.fill(false);
        self.distances.fill(f64::NAN);
        self.risks.fill(0.0);
        self.q.copy_from_slice(robot.configuration());
        self.place(self.half)
            && self.projection.direction(&self.scout, &mut self.first_heading)
            && {
                self.follow(self.half);
                true
            }
    }

    /// Puts the posture in `q` onto the reference of the first knot and keeps it as that of `place`.
    fn place(&mut self, place: usize) -> bool {
        let Self { scout, projection, q, poses, postures, exists, n, .. } = self;
        exists[place] = projection.project(scout, q, &poses[0]);
        postures[place * *n..][..*n].copy_from_slice(q);
        exists[place]
    }

    /// Finds the postures of `place` at all later knots, from that of the first.
    fn follow(&mut self, place: usize) {
        let places = self.places();
        let Self { scout, projection, q, poses, postures, exists, n, .. } = self;
        for (knot, pose) in poses.iter().enumerate().skip(1) {
            let here = knot * places + place;
            let (earlier, later) = postures.split_at_mut(here * *n);
            let before = &earlier[(here - places) * *n..][..*n];
            exists[here] =
                projection.project(scout, q, pose) && is_within(scout.limits(), q, before);
            if !exists[here] {
                break;
            }
            later[..*n].copy_from_slice(q);
        }
    }

    /// Finds the postures of the place that is `count` places from the middle, from those of the one before. Whether there are
    /// any: the self-motion ends at stops and singularities.
    pub fn go_on(&mut self, count: usize, is_forward: bool) -> bool {
        let sign = if is_forward { 1.0 } else { -1.0 };
        let at = |count: usize| if is_forward { self.half + count } else { self.half - count };
        let (before, place) = (at(count - 1), at(count));
        let n = self.n;
        if count == 1 {
            self.heading
                .iter_mut()
                .zip(&self.first_heading)
                .for_each(|(z, first)| *z = sign * first);
        }
        let last = &self.postures[before * n..][..n];
        for ((q, last), z) in self.q.iter_mut().zip(last).zip(&self.heading) {
            *q = last + self.spacing * z;
        }
        if !self.place(place)
            || !self.projection.align(&self.scout, &mut self.heading)
            || !is_within(self.scout.limits(), &self.q, &self.postures[before * n..][..n])
        {
            self.exists[place] = false;
            return false;
        }
        self.follow(place);
        true
    }

    /// Which knot comes before instant `k`, and how far it is from there to the next.
    #[expect(clippy::cast_precision_loss, reason = "few instants")]
    fn knot(&self, k: usize) -> (usize, f64) {
        if self.poses.len() == 1 {
            return (0, 0.0);
        }
        let knot = (k / EVERY).min(self.poses.len() - 2);
        (knot, (k - EVERY * knot) as f64 / EVERY as f64)
    }

    /// Whether `place` has a posture at instant `k`.
    pub fn exists(&self, place: usize, k: usize) -> bool {
        let (knot, share) = self.knot(k);
        let here = knot * self.places() + place;
        self.exists[here] && (share <= 0.0 || self.exists[here + self.places()])
    }

    /// Joint `i` of the posture of `place` at instant `k` \[rad\].
    pub fn joint(&self, place: usize, k: usize, i: usize) -> f64 {
        let (knot, share) = self.knot(k);
        let here = (knot * self.places() + place) * self.n + i;
        let q = self.postures[here];
        if share <= 0.0 {
            q
        } else {
            q + share * (self.postures[here + self.places() * self.n] - q)
        }
    }

    /// Whether joints are fast enough to go from the posture of place `from` at instant `k` to that of `to` at the next.
    pub fn is_in_time(&self, from: usize, to: usize, k: usize) -> bool {
        self.speed.iter().enumerate().all(|(i, speed)| {
            (self.joint(to, k + 1, i) - self.joint(from, k, i)).abs() <= speed * self.step
        })
    }

    /// All distances, place by place, for those of an earlier search \[m\].
    pub fn exchange_distances(&mut self, others: &mut Vec<f64>) {
        std::mem::swap(&mut self.distances, others);
    }

    /// All distances, place by place \[m\].
    pub fn distances(&self) -> &[f64] {
        &self.distances
    }

    /// The smallest distance of `place` at instant `k`, as far as it matters \[m\].
    pub fn distance(&self, place: usize, k: usize) -> f64 {
        self.distances[place * self.instants + k]
    }

    /// What a second costs at `place` at instant `k` by what may come.
    pub fn risk(&self, place: usize, k: usize) -> f64 {
        self.risks[place * self.instants + k]
    }

    /// Measures the distances of `place` at the instants from `first` on.
    #[expect(clippy::cast_precision_loss, reason = "few instants")]
    pub fn measure(&mut self, place: usize, first: usize, around: &Around<'_, D>) {
        let moves = self.poses.len() > 1;
        let mut q = std::mem::take(&mut self.q);
        let mut pairs = std::mem::take(&mut self.pairs);
        pairs.clear();
        pairs.resize(self.obstacles.len() * self.bodies.len(), Pair::default());
        for k in first..self.instants {
            if !self.exists(place, k) {
                break;
            }
            if moves || k == first {
                (0..self.n).for_each(|i| q[i] = self.joint(place, k, i));
                self.scout.update_positions(&q);
            }
            interrupt::checkpoint(2 * pairs.len() + 8 * self.n);
            let Self { scout, bodies, obstacles, there, possible, .. } = self;
            let Self { unused, clearance, usual, step, .. } = self;
            let after = *step * k as f64 - around.ago;
            let mut least = f64::INFINITY;
            possible.clear();
            possible.resize(obstacles.len() - *there, f64::INFINITY);
            let mut remaining = pairs.iter_mut();
            for (b, before) in bodies.iter_mut().enumerate() {
                let body = scout.body(b);
                let way = if moves && k > first { way(&body, before) } else { 0.0 };
                *before = body.enclosing();
                for ((number, &j), pair) in obstacles.iter().enumerate().zip(&mut remaining) {
                    pair.room -= way + pair.drift;
                    if pair.room > 0.0 {
                        continue;
                    }
                    if !(pair.rests && way <= 0.0) {
                        let limits = [*clearance, *usual];
                        *pair = measured(&body, b, j, after, limits, *step, around, unused);
                    }
                    let nearest = match number.checked_sub(*there) {
                        None => &mut least,
                        Some(number) => &mut possible[number],
                    };
                    *nearest = nearest.min(pair.distance);
                }
            }
            self.distances[place * self.instants + k] = least;
            let risks =
                self.possible.iter().map(|distance| around.cost.of_what_may_come(*distance));
            self.risks[place * self.instants + k] = risks.sum();
        }
        (self.q, self.pairs) = (q, pairs);
    }

    /// Leaves out obstacles that do not exist any longer.
    pub fn forget(&mut self, count: usize) {
        self.there = self.obstacles[..self.there].iter().filter(|j| **j < count).count();
        self.obstacles.retain(|j| *j < count);
    }
}

/// How many places a search has on either side.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "validated: few")]
fn half(settings: &SelfMotionSettings) -> usize {
    (settings.range / settings.spacing).ceil() as usize
}

/// How far the ends of a capsule have gone at most: no point of it has gone farther \[m\].
fn way<const D: usize>(now: &Body<'_, D>, before: &Body<'_, D>) -> f64 {
    let ends: [Vector<D>; 2] =
        [now.shape.start - before.shape.start, now.shape.end() - before.shape.end()];
    ends[0].norm_squared().max(ends[1].norm_squared()).sqrt()
}

/// A body and an obstacle `after` \[s\] from now.
#[expect(clippy::too_many_arguments, reason = "a question, and what is wanted of the answer")]
fn measured<const D: usize>(
    body: &Body<'_, D>,
    index: usize,
    obstacle: usize,
    after: f64,
    [clearance, usual]: [f64; 2],
    step: f64,
    around: &Around<'_, D>,
    unused: &mut Vec<Near<D>>,
) -> Pair {
    interrupt::checkpoint(64);
    let unreached = f64::NEG_INFINITY;
    let ask = |body: &Body<'_, D>, unused: &mut Vec<Near<D>>| {
        around.surroundings.approach(index, body, obstacle, after, unreached, unused)
    };
    // Of a hull it is the capsule around it that says how long nothing matters.
    let mut nearest = ask(&body.enclosing(), unused);
    let room = nearest.distance(usual) - clearance;
    if body.hull.is_some() && room <= 0.0 {
        nearest = ask(body, unused);
    }
    let speed = nearest.speed();
    // What matters now is asked at the next instant, too, however slow it is.
    let drift = if room > 0.0 { speed * step } else { 0.0 };
    Pair { room: room.max(0.0), drift, distance: nearest.distance(usual), rests: speed <= 0.0 }
}

/// Whether joints keep away from their stops, or at least come no nearer than they were.
fn is_within(limits: &Limits, q: &[f64], before: &[f64]) -> bool {
    limits.joint.iter().zip(q).zip(before).all(|(([lower, upper], q), was)| {
        (*q >= lower + STOP || q >= was) && (*q <= upper - STOP || q <= was)
    })
}

#[cfg(all(test, feature = "models"))]
mod tests {
    use super::*;
    use crate::math::Vector;
    use crate::robot::{Robot, SpatialState, models};
    use crate::world::space::{Obstacle, Shape, World};
    use crate::world::{CollisionQuery, Motion};
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
    use std::sync::Arc;

    const PANDA: [f64; 7] = [0.0, -FRAC_PI_4, 0.0, -2.3562, 0.0, FRAC_PI_2, FRAC_PI_4];

    fn arm(name: &str, q: &[f64; 7]) -> SpatialState {
        let mut robot = Arc::new(models::named(name).unwrap().build().unwrap()).state();
        robot.update(q, &[0.0; 7]);
        robot
    }

    fn grid(robot: &SpatialState, settings: &SelfMotionSettings) -> Grid<SpatialState, 3, 6> {
        Grid::new(
            robot,
            (&Yielding::default(), &robot.limits().velocity),
            settings,
            TaskMetric::new::<3>(0.2),
        )
    }

    /// All postures, with how many there are backward and forward.
    fn traced(
        grid: &mut Grid<SpatialState, 3, 6>,
        robot: &SpatialState,
        pose: &dyn Fn(f64) -> <SpatialState as Manipulator<3, 6>>::Pose,
    ) -> [usize; 2] {
        assert!(grid.begin(robot, &mut World::new(vec![]), pose));
        [false, true].map(|is_forward| {
            let ends = (1..=grid.half).find(|count| !grid.go_on(*count, is_forward));
            ends.map_or(grid.half, |count| count - 1)
        })
    }

    fn posture(grid: &Grid<SpatialState, 3, 6>, place: usize, k: usize) -> Vec<f64> {
        (0..7).map(|i| grid.joint(place, k, i)).collect()
    }

    /// Every posture holds the pose, neighbours are as far apart as is asked for, and the curve goes on to a stop on both sides.
    #[test]
    fn postures_hold_the_pose_up_to_the_stops() {
        let settings = SelfMotionSettings { range: 12.0, ..SelfMotionSettings::default() };
        let starts = [
            ("panda", PANDA),
            ("iiwa14", [0.3, 0.6, 0.1, -1.6, 0.2, 0.9, 0.0]),
            ("xarm7", [0.2, 0.5, 0.3, 1.2, 0.1, 1.1, 0.0]),
        ];
        for (name, q) in starts {
            let mut robot = arm(name, &q);
            let pose = Manipulator::<3, 6>::pose(&robot);
            let mut grid = grid(&robot, &settings);
            let counts = traced(&mut grid, &robot, &|_| pose);
            let limits = robot.limits().clone();
            let mut before: Option<Vec<f64>> = None;
            for place in grid.half - counts[0]..=grid.half + counts[1] {
                let q = posture(&grid, place, 0);
                robot.update_positions(&q);
                let error = Manipulator::<3, 6>::pose(&robot).error(&pose);
                assert!(error.norm() < 1e-9, "{name}: {error}");
                if let Some(before) = before {
                    let way =
                        q.iter().zip(&before).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                    assert!((way - settings.spacing).abs() < 2e-3, "{name}: {way}");
                }
                before = Some(q);
            }
            for (count, place) in
                counts.into_iter().zip([grid.half - counts[0], grid.half + counts[1]])
            {
                assert!(count > 8, "{name}: {counts:?}");
                let q = posture(&grid, place, 0);
                let room = q.iter().zip(&limits.joint).map(|(q, [l, u])| (q - l).min(u - q));
                let least = room.fold(f64::INFINITY, f64::min);
                assert!(STOP - 1e-9 < least && least < STOP + 0.05, "{name}: {counts:?} {least}");
            }
        }
    }

    /// Without stops the curve closes: it comes back to where it began.
    #[test]
    fn without_stops_the_curve_closes() {
        let mut description = models::named("iiwa14").unwrap();
        description.joint_limits.clear();
        let mut robot = Arc::new(description.build().unwrap()).state();
        let start = [0.3, 0.6, 0.1, -1.6, 0.2, 0.9, 0.0];
        robot.update(&start, &[0.0; 7]);
        let pose = Manipulator::<3, 6>::pose(&robot);
        let settings = SelfMotionSettings { range: 25.0, ..SelfMotionSettings::default() };
        let mut grid = grid(&robot, &settings);
        assert_eq!(traced(&mut grid, &robot, &|_| pose), [grid.half; 2]);
        let away = |place: usize| {
            let turns = posture(&grid, place, 0).into_iter().zip(start).map(|(q, start)| {
                let turn = (q - start).rem_euclid(std::f64::consts::TAU);
                turn.min(std::f64::consts::TAU - turn).powi(2)
            });
            turns.sum::<f64>().sqrt()
        };
        let nearest = (grid.half + 20..grid.places()).map(away).fold(f64::INFINITY, f64::min);
        assert!(nearest < 0.03, "{nearest}");
    }

    /// Where the reference moves, places keep to it at the knots, each by the shortest way, and distances are those of the bodies
    /// there: measured by the world itself.
    #[test]
    fn places_move_with_the_reference() {
        let robot = arm("panda", &PANDA);
        let start = Manipulator::<3, 6>::pose(&robot);
        let mut along = Vector::<6>::zeros();
        along[1] = 0.1;
        let pose = |s: f64| start.moved(&(along * s));
        let settings = SelfMotionSettings::default();
        let mut grid = grid(&robot, &settings);
        let counts = traced(&mut grid, &robot, &pose);
        assert!(counts[0] > 5 && counts[1] > 5, "{counts:?}");
        let mut scout = robot.clone();
        let ball = |motion| Obstacle {
            position: [0.1, -0.6, 0.6],
            motion,
            ..Obstacle::of(Shape::Sphere { radius: 0.1 })
        };
        let moving = ball(Motion::Linear { velocity: [0.0, 0.3, 0.0] });
        let mut world = World::new(vec![moving, ball(Motion::default())]);
        let mut other = world.clone();
        assert!(grid.begin(&robot, &mut world, &pose));
        (1..=counts[1]).for_each(|count| assert!(grid.go_on(count, true)));
        let mut near = 0;
        for place in [grid.half, grid.half + 3, grid.half + counts[1]] {
            let cost = Cost { margin: 0.01, clearance: 0.1 };
            grid.measure(place, 0, &Around { surroundings: &world, ago: 0.0, cost });
            for k in (0..=30).filter(|k| grid.exists(place, *k)) {
                scout.update_positions(&posture(&grid, place, k));
                let error =
                    Manipulator::<3, 6>::pose(&scout).error(&pose(0.1 * f64::from(k as u32)));
                let most = if k % EVERY == 0 { 1e-9 } else { 1e-3 };
                assert!(error.norm() < most, "{k}: {error}");
                other.update(0.1 * f64::from(k as u32));
                let mut least = f64::INFINITY;
                other.for_each_contact(scout.bodies(), 0.0, |_, d| least = least.min(d), |_| {});
                let found = grid.distance(place, k);
                if least < settings.clearance {
                    near += 1;
                    assert!((found - least).abs() < 1e-9, "{place} {k}: {found} {least}");
                } else {
                    assert!(found >= settings.clearance);
                }
            }
        }
        assert!(near > 10, "{near}");
    }
}
