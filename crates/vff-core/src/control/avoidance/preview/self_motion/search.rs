//! The search, spread over the control cycles of its period, and the path that is followed (T174, T175).
//!
//! The work comes in units: the present posture, then every place along the self-motion, then every instant of the dynamic
//! programming. As many are done in a control cycle as are due, and none where its time is over.

use super::super::due;
use super::super::prediction::Prediction;
use super::super::rollout::RATE;
use super::cheapest_path::{CheapestPath, Passage};
use super::cost::{Cost, ENDING};
use super::grid::{Around, Grid};
use super::map::SelfMotionMap;
use crate::control::deadline::Budget;
use crate::control::{Gains, SelfMotionSettings};
use crate::interrupt;
use crate::math::short_way;
use crate::robot::Manipulator;
use crate::trajectory::Sample;

/// What a second costs at 1 rad/s along the self-motion, squared.
const GOING: f64 = 0.02;
/// What a second costs 1 rad away from the posture that is wanted, squared.
const AWAY: f64 = 0.01;
/// How fast the arm comes back to the path \[1/s\].
const PULL: f64 = 5.0;

/// How far a search has come.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Stage {
    /// Not begun, or at its end.
    Rest,
    /// The postures along the self-motion: how many are done on this side.
    Postures { is_forward: bool, done: usize },
    /// The dynamic programming: how many instants are done.
    Instants { done: usize },
}

/// Postures to be followed \[rad\], one per instant.
#[derive(Debug, Clone)]
struct Path {
    postures: Vec<f64>,
    /// The least distance within the time in which it must be clear \[m\].
    distance: f64,
    /// The time since its beginning \[s\].
    elapsed: f64,
}

/// The search of the self-motion, with its workspace.
#[derive(Debug, Clone)]
pub struct SelfMotion<R: Manipulator<D, M>, const D: usize, const M: usize> {
    grid: Grid<R, D, M>,
    cheapest: CheapestPath,
    stage: Stage,
    period: f64,
    /// The time since the beginning of the search, and since the last control step \[s\]; infinite before the first.
    elapsed: f64,
    since: f64,
    /// How many units of work are done, of how many.
    done: usize,
    units: usize,
    /// What distances cost, and how many instants must be clear.
    cost: Cost,
    soon: usize,
    /// The posture that is wanted \[rad\], and the cost of each place because of it.
    wanted: Vec<f64>,
    /// Which joints turn without an end.
    endless: Vec<bool>,
    away: Vec<f64>,
    places: Vec<usize>,
    /// What is followed, and whether anything is.
    path: Path,
    follows: bool,
    /// The distances of the last search that came to its end; none of any while nothing comes near \[m\].
    found: Vec<f64>,
    has_found: bool,
    /// The present configuration, as seen last, and the joint velocity at the beginning of the search.
    q: Vec<f64>,
    velocity: Vec<f64>,
    /// That speed along the self-motion, in places per instant.
    speed: f64,
}

/// What the dynamic programming sees of a search.
struct View<'a, R: Manipulator<D, M>, const D: usize, const M: usize> {
    grid: &'a Grid<R, D, M>,
    cost: Cost,
    away: &'a [f64],
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> Passage for View<'_, R, D, M> {
    fn cost(&self, place: usize, k: usize) -> f64 {
        if !self.grid.exists(place, k) {
            return f64::INFINITY;
        }
        let of_distance = self.cost.of_what_is_there(self.grid.distance(place, k));
        self.grid.step() * (of_distance + self.grid.risk(place, k) + self.away[place])
    }

    fn cost_of_ending(&self) -> f64 {
        ENDING * self.grid.step()
    }

    fn is_open(&self, from: usize, to: usize, k: usize) -> bool {
        self.grid.is_in_time(from, to, k)
    }

    #[expect(clippy::cast_precision_loss, reason = "few places")]
    fn cost_of_going(&self, places: usize) -> f64 {
        let way = self.grid.spacing() * places as f64;
        GOING * way * way / self.grid.step()
    }
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> SelfMotion<R, D, M> {
    /// For the law with these gains on `robot`, with paths that must be clear for the next `trigger` seconds.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "few places and instants"
    )]
    pub fn new(robot: &R, gains: &Gains<M>, settings: &SelfMotionSettings, trigger: f64) -> Self {
        let n = robot.dof();
        let speeds = gains.joint_speeds(robot);
        let grid = Grid::new(robot, (&gains.yielding, &speeds), settings, gains.metric::<D>());
        let fastest = speeds.iter().map(|v| v * v).sum::<f64>().sqrt() * settings.speed;
        let largest = (fastest * grid.step() / grid.spacing()) as usize;
        let change = settings.acceleration * grid.step().powi(2) / grid.spacing();
        let places = grid.places();
        let mut created = Self {
            cheapest: CheapestPath::new(
                places,
                settings.steps,
                largest.max(1),
                change.round().max(1.0) as usize,
            ),
            stage: Stage::Rest,
            period: settings.period,
            elapsed: f64::INFINITY,
            since: f64::INFINITY,
            done: 0,
            // Each side has an end, too.
            units: places + 2 + settings.steps,
            cost: Cost {
                margin: gains.yielding.margin,
                clearance: settings.clearance.max(gains.yielding.margin + 1e-3),
            },
            soon: ((trigger / grid.step()).ceil() as usize).min(settings.steps),
            wanted: vec![],
            endless: (0..n).map(|i| gains.is_endless(i)).collect(),
            away: vec![0.0; places],
            places: vec![0; settings.steps + 1],
            path: Path {
                postures: vec![0.0; (settings.steps + 1) * n],
                distance: f64::NEG_INFINITY,
                elapsed: 0.0,
            },
            follows: false,
            found: grid.distances().to_vec(),
            has_found: false,
            q: vec![0.0; n],
            velocity: vec![0.0; n],
            speed: 0.0,
            grid,
        };
        created.rest_at_posture_of(gains);
        created
    }

    /// Makes room for so many more obstacles.
    pub fn reserve(&mut self, obstacles: usize) {
        self.grid.reserve(obstacles);
    }

    /// Prefers the posture of the law with these gains, if it has one.
    pub fn rest_at_posture_of(&mut self, gains: &Gains<M>) {
        self.wanted.clear();
        self.wanted.extend(gains.posture.iter().map(|(q, _)| q));
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        (self.elapsed, self.since) = (f64::INFINITY, f64::INFINITY);
        self.stage = Stage::Rest;
        self.find_nothing();
    }

    /// There is no path, and nothing to be looked at.
    fn find_nothing(&mut self) {
        (self.follows, self.has_found) = (false, false);
    }

    /// Lets `dt` \[s\] pass.
    pub fn elapse(&mut self, dt: f64) {
        self.elapsed += dt;
        self.since += dt;
        self.path.elapsed += dt;
    }

    /// Whether there is a path to be followed.
    pub fn has_path(&self) -> bool {
        self.follows
    }

    /// Whether that keeps the margin for the time in which it has to.
    pub fn is_clear(&self) -> bool {
        self.follows && self.path.distance >= self.cost.margin
    }

    /// Does what is due of the search as far as there is time for it; `reference(s)` is that in s seconds, and paths begin at the joint
    /// velocity `velocity`. None where the time of
    /// this control cycle is over before that.
    pub fn advance(
        &mut self,
        robot: &R,
        surroundings: &mut dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
        velocity: &[f64],
        budget: &Budget,
    ) -> Option<()> {
        self.q.copy_from_slice(robot.configuration());
        self.velocity.copy_from_slice(velocity);
        let result = self.work(robot, surroundings, reference, budget);
        self.since = 0.0;
        result
    }

    fn work(
        &mut self,
        robot: &R,
        surroundings: &mut dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
        budget: &Budget,
    ) -> Option<()> {
        if self.stage == Stage::Rest {
            if self.elapsed < self.period - 1e-9 {
                return Some(());
            }
            budget.is_left().then_some(())?;
            self.begin(robot, surroundings, reference);
        }
        self.grid.forget(surroundings.count());
        let due = due(self.units, (self.elapsed + self.since) / self.period).min(self.units);
        while self.done < due && self.stage != Stage::Rest {
            budget.is_left().then_some(())?;
            self.go_on(surroundings);
            self.done += 1;
        }
        Some(())
    }

    /// Begins a search: there is something to be done if the arm would come near an obstacle where it is.
    fn begin(
        &mut self,
        robot: &R,
        surroundings: &mut dyn Prediction<D>,
        reference: &dyn Fn(f64) -> Sample<R::Pose, M>,
    ) {
        (self.elapsed, self.done) = (0.0, 1);
        let middle = self.grid.middle();
        let is_placed = self.grid.begin(robot, surroundings, &|s| reference(s).x);
        if !is_placed || !self.grid.has_obstacles() {
            self.find_nothing();
            return;
        }
        self.speed = self.grid.speed_along(&self.velocity) * self.grid.step() / self.grid.spacing();
        self.measure(middle, 0, surroundings);
        let instants = self.places.len();
        // No posture is not near.
        let is_near = |k| {
            self.grid.distance(middle, k) < self.cost.clearance || self.grid.risk(middle, k) > 0.0
        };
        if !(0..instants).any(is_near) {
            self.find_nothing();
            return;
        }
        self.stage = Stage::Postures { is_forward: true, done: 0 };
    }

    fn measure(&mut self, place: usize, first: usize, surroundings: &dyn Prediction<D>) {
        let Self { grid, wanted, endless, away, elapsed, cost, .. } = self;
        grid.measure(place, first, &Around { surroundings, ago: *elapsed, cost: *cost });
        let way = |i: usize, q: f64| short_way(grid.joint(place, 0, i) - q, endless[i]);
        let far = |(i, q): (usize, &f64)| way(i, *q).powi(2);
        away[place] = AWAY * wanted.iter().enumerate().map(far).sum::<f64>();
    }

    /// A unit of work.
    fn go_on(&mut self, surroundings: &dyn Prediction<D>) {
        match self.stage {
            Stage::Rest => {}
            Stage::Postures { is_forward, done } => {
                let (middle, next) = (self.grid.middle(), done + 1);
                let is_there = next <= middle && self.grid.go_on(next, is_forward);
                if is_there {
                    let place = if is_forward { middle + next } else { middle - next };
                    // Nothing comes there earlier.
                    let first = next.div_ceil(self.cheapest.largest());
                    self.measure(place, first, surroundings);
                    self.stage = Stage::Postures { is_forward, done: next };
                } else if is_forward {
                    self.stage = Stage::Postures { is_forward: false, done: 0 };
                } else {
                    self.start();
                }
            }
            Stage::Instants { done } => {
                interrupt::checkpoint(4 * self.grid.places());
                let Self { cheapest, grid, cost, away, .. } = self;
                cheapest.advance(&View { grid, cost: *cost, away });
                self.stage = Stage::Instants { done: done + 1 };
                if done + 2 == self.places.len() {
                    self.finish();
                }
            }
        }
    }

    /// Begins the dynamic programming at the present posture and speed.
    #[expect(clippy::cast_possible_truncation, reason = "few places")]
    fn start(&mut self) {
        self.cheapest.begin(self.grid.middle(), self.speed.round() as isize);
        self.stage = Stage::Instants { done: 0 };
    }

    /// Takes the cheapest path as the one to be followed.
    fn finish(&mut self) {
        self.stage = Stage::Rest;
        let reached = self.cheapest.trace(&mut self.places);
        // Without a first step there is nothing to follow.
        self.follows = reached > 0;
        self.path.elapsed = self.elapsed;
        if self.follows {
            self.take(reached);
        }
        self.grid.exchange_distances(&mut self.found);
        self.has_found = true;
    }

    /// Follows the path that has been traced, which leads on until so many instants are over.
    fn take(&mut self, reached: usize) {
        let Self { grid, places, path, .. } = self;
        let n = self.q.len();
        for (k, (place, posture)) in
            places.iter().zip(path.postures.chunks_exact_mut(n)).enumerate()
        {
            for (i, q) in posture.iter_mut().enumerate() {
                *q = grid.joint(*place, k.min(reached), i);
            }
        }
        let soon = places
            .iter()
            .enumerate()
            .take(self.soon + 1)
            .map(|(k, place)| grid.distance(*place, k));
        let least = soon.fold(f64::INFINITY, f64::min);
        path.distance = if reached < self.soon { f64::NEG_INFINITY } else { least };
    }

    /// What the last search has found; None while nothing comes near. Allocates.
    pub fn map(&self) -> Option<SelfMotionMap> {
        let Self { grid, found, places, path, cost, .. } = self;
        self.has_found.then(|| SelfMotionMap {
            places: grid.places(),
            spacing: grid.spacing(),
            instants: places.len(),
            step: grid.step(),
            elapsed: path.elapsed,
            distances: found.clone(),
            path: if self.follows { places.clone() } else { vec![] },
            margin: cost.margin,
            clearance: cost.clearance,
        })
    }

    /// Writes the joint velocity that follows the path \[rad/s\]: it leads by the lag with which the arm takes it up, and comes back to
    /// the path where the arm is beside it.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "positive, and few instants"
    )]
    pub fn write_velocity(&self, out: &mut [f64]) {
        let Self { path: Path { postures, elapsed, .. }, grid, q, .. } = self;
        let n = q.len();
        let (step, last) = (grid.step(), postures.len() / n - 1);
        let piece = |time: f64| ((time / step) as usize).min(last - 1);
        let now = piece(*elapsed);
        let share = (elapsed / step - now as f64).min(1.0);
        let ahead = elapsed + 1.0 / RATE;
        let next = piece(ahead);
        let is_over = ahead >= step * last as f64;
        for (i, out) in out.iter_mut().enumerate() {
            let at = |k: usize| postures[k * n + i];
            let forward = if is_over { 0.0 } else { (at(next + 1) - at(next)) / step };
            *out = forward + PULL * (at(now) + share * (at(now + 1) - at(now)) - q[i]);
        }
    }
}

#[cfg(all(test, feature = "models"))]
mod tests {
    use super::*;
    use crate::control::Settings;
    use crate::robot::{Robot, SpatialState, models};
    use crate::world::Motion;
    use crate::world::space::{Obstacle, Shape, World};
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
    use std::sync::Arc;

    fn panda() -> SpatialState {
        let mut robot = Arc::new(models::named("panda").unwrap().build().unwrap()).state();
        robot.update(&[0.0, -FRAC_PI_4, 0.0, -2.3562, 0.0, FRAC_PI_2, FRAC_PI_4], &[0.0; 7]);
        robot
    }

    fn ball(position: [f64; 3], velocity: [f64; 3]) -> Obstacle {
        Obstacle {
            position,
            motion: Motion::Linear { velocity },
            ..Obstacle::of(Shape::Sphere { radius: 0.08 })
        }
    }

    /// After one search, which the first control step does as a whole.
    fn searched(robot: &SpatialState, balls: Vec<Obstacle>) -> SelfMotion<SpatialState, 3, 6> {
        let settings = SelfMotionSettings::default();
        let mut search = SelfMotion::new(robot, &Gains::new(&Settings::default()), &settings, 1.2);
        let reference = Sample::at_rest(Manipulator::<3, 6>::pose(robot));
        let unlimited = Budget::of_simulation(None);
        let mut world = World::new(balls);
        search.advance(robot, &mut world, &|_| reference, &[0.0; 7], &unlimited).unwrap();
        search
    }

    /// Where nothing comes there is nothing to follow. From a ball through the elbow a path swivels away in time, keeps the margin as
    /// long as it has to and a quarter of it afterwards, and asks for no joint speed beyond the limits. Through the second link,
    /// which the self-motion hardly moves, none is clear.
    #[test]
    fn a_path_leads_out_of_the_way_where_there_is_one() {
        let robot = panda();
        let away = searched(&robot, vec![ball([-0.05, -0.6, 0.62], [0.0, -0.3, 0.0])]);
        assert!(!away.has_path() && away.map().is_none());
        let through = searched(&robot, vec![ball([-0.05, -0.6, 0.62], [0.0, 0.4, 0.0])]);
        assert!(through.has_path() && through.is_clear());
        let map = through.map().unwrap();
        assert_eq!(map.path[0], through.grid.middle());
        let at = |place: usize, k: usize| map.distances[place * map.instants + k];
        let kept: Vec<f64> = map.path.iter().enumerate().map(|(k, place)| at(*place, k)).collect();
        let least = |kept: &[f64]| kept.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(least(&kept[..=through.soon]) >= through.cost.margin, "{kept:?}");
        assert!(least(&kept) >= through.cost.passed(), "{kept:?}");
        let stays = (0..map.instants).map(|k| at(through.grid.middle(), k));
        assert!(stays.fold(f64::INFINITY, f64::min) < 0.0);
        let mut search = through;
        let mut velocity = [0.0; 7];
        let mut moved = 0.0_f64;
        for _ in 0..100 {
            // As if the arm were where the path is.
            search.elapse(0.03);
            search.write_velocity(&mut velocity);
            for ((q, v), limit) in search.q.iter_mut().zip(velocity).zip(&robot.limits().velocity) {
                *q += 0.03 * v;
                moved = moved.max(v.abs());
                assert!(v.abs() <= 1.2 * limit, "{v} {limit}");
            }
        }
        assert!(moved > 0.2, "{moved}");
        let base = searched(&robot, vec![ball([0.0, -0.5, 0.33], [0.0, 0.5, 0.0])]);
        assert!(!base.is_clear());
    }
}
