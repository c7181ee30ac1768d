//! The whole way from pictures of depth cameras to a cloud of points that move, as on a robot: cameras that err in place, time and
//! depth (T188, T189) take pictures with the arm in them, and a [`Perceiver`] makes the cloud of these.

use super::PerceptionSettings;
use super::picture::{DepthPicture, Errors, Eye, Hit};
use crate::math::{Noise, Vector, upright};
use crate::perception::{Depth, Perceiver, PerceiverSettings, PerceptionError};
use crate::robot::{Robot, SpatialState};
use crate::world::Positions;
use crate::world::space::{Obstacle, Points, Shape, World};
use std::mem::{replace, swap};

/// States that the perceiver can choose from between a picture and its arrival.
const STATES: usize = 400;

/// What the law knows: a cloud of points where they were at an instant.
#[derive(Debug, Clone)]
struct Seen {
    points: Points,
    /// Each with its velocity \[m, m/s\].
    moving: Vec<[Vector<3>; 2]>,
    /// When they were there \[s\].
    since: f64,
}

impl Seen {
    fn of(perceiver: &Perceiver) -> Self {
        let moving: Vec<_> =
            perceiver.points().map(|(point, velocity)| [point, velocity]).collect();
        let [points, velocities] =
            [0, 1].map(|k| moving.iter().map(|it| it[k].into()).collect::<Vec<[f64; 3]>>());
        let since = perceiver.last();
        let points = Points::moving(points, &velocities, since, upright());
        Self { points, moving, since: since.unwrap_or_default() }
    }
}

/// Depth cameras, and what has been made of their pictures.
#[derive(Debug, Clone)]
pub(super) struct DepthCameras {
    eyes: Vec<Eye>,
    /// By how much the clock of each is ahead \[s\].
    clocks: Vec<f64>,
    errors: Errors,
    range: f64,
    dt: f64,
    /// Plant steps from picture to picture, until one arrives, and from state to state of the arm.
    every: usize,
    late: usize,
    observed: usize,
    /// How far back of its arrival a picture may be put \[s\].
    longest: f64,
    /// The last pictures of all cameras, one row a time, as a ring.
    pictures: Vec<f32>,
    rows: usize,
    hits: Vec<Hit>,
    perceiver: Perceiver,
    /// Plant steps so far.
    step: usize,
    /// The cloud alone, which the law takes for all that is there; how it is; and the one before.
    world: World,
    seen: Seen,
    before: Seen,
    /// Points at most.
    most: usize,
    /// Whether a cloud came with the last step, and whether one that came was taken back.
    is_new: bool,
    is_pending: bool,
}

/// What the perceiver is told: no more points than there are pixels.
fn with_room(settings: &PerceptionSettings) -> PerceiverSettings {
    PerceiverSettings {
        most_voxels: settings.cells_of(settings.rays_of(0, 3)),
        ..settings.perceiver.clone()
    }
}

impl DepthCameras {
    /// Around `robot`, for plant steps of `dt` \[s\]; the same seed gives the same errors.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "validated before")]
    pub(super) fn new(
        settings: &PerceptionSettings,
        seed: u64,
        robot: &SpatialState,
        dt: f64,
    ) -> Result<Self, PerceptionError> {
        let models = settings.cameras.iter().map(super::Camera::model).collect();
        let perceiver = Perceiver::new(robot.arm(), models, with_room(settings), vec![])?;
        let (every, late) =
            (settings.steps_per_scan(dt) as usize, settings.steps_late(dt) as usize);
        let (mut places, mut clocks) = (Noise::new(seed, 5), vec![]);
        let mut eyes = vec![];
        for camera in &settings.cameras {
            let [moved, turned] =
                [settings.position_error, settings.orientation_error].map(|size| {
                    let drawn = Vector::<3>::from_fn(|_, _| places.draw());
                    drawn.normalize() * size
                });
            eyes.push(Eye::new(camera, &moved, &turned));
            let is_ahead = places.share() < 0.5;
            clocks.push(if is_ahead { settings.clock_error } else { -settings.clock_error });
        }
        let pixels: usize = eyes.iter().map(Eye::pixels).sum();
        let rows = late / every + 2;
        let back = settings.clock_error - settings.perceiver.time_offset.min(0.0);
        let longest = dt * (late + every) as f64 + back;
        let most = settings.points_of(0, 3);
        let cloud = Obstacle {
            ..Obstacle::of(Shape::Points { points: vec![], radius: perceiver.radius() })
        };
        let mut world = World::new(vec![cloud]);
        world.make_room(0, most);
        Ok(Self {
            eyes,
            clocks,
            errors: Errors::new(settings, seed),
            range: settings.range,
            dt,
            every,
            late,
            observed: 1 + (longest / (dt * STATES as f64)) as usize,
            longest,
            pictures: vec![0.0; rows * pixels],
            rows,
            hits: vec![],
            seen: Seen::of(&perceiver),
            before: Seen::of(&perceiver),
            perceiver,
            step: 0,
            world,
            most,
            is_new: false,
            is_pending: false,
        })
    }

    /// The pictures that arrived last.
    pub(super) fn pictures(&self) -> Vec<DepthPicture> {
        let mut begin = self.row(self.step.saturating_sub(self.late));
        let pictures = self.eyes.iter().map(|eye| {
            let depths = self.pictures[begin..begin + eye.pixels()].to_vec();
            begin += eye.pixels();
            DepthPicture { columns: eye.columns(), depths }
        });
        pictures.collect()
    }

    /// What the law is to take for the world.
    pub(super) fn world(&mut self) -> &mut World {
        &mut self.world
    }

    /// Begins with a picture, as if arm and world had been as they are all the time before.
    pub(super) fn start(&mut self, robot: &SpatialState, world: &World) {
        (self.step, self.is_new, self.is_pending) = (0, false, false);
        self.perceiver.forget();
        let longest = self.longest + 1.0;
        let rest = vec![0.0; robot.dof()];
        // None is refused, as nothing was told before. So many that one is near the time of every picture.
        let long_before = (1..=STATES).rev().map(|k| -longest * k as f64 / STATES as f64);
        for before in long_before.filter(|t| *t < -self.dt).chain([-self.dt]) {
            _ = self.perceiver.observe(before, robot.configuration(), &rest);
        }
        self.observe(robot);
        self.take(robot, world);
        self.arrive(0, -self.time(self.late));
    }

    /// One plant step later.
    pub(super) fn advance(&mut self, robot: &SpatialState, world: &World) {
        self.step += 1;
        if self.step.is_multiple_of(self.observed) {
            self.observe(robot);
        }
        if self.step.is_multiple_of(self.every) {
            self.take(robot, world);
        }
        let taken =
            self.step.checked_sub(self.late).filter(|taken| taken.is_multiple_of(self.every));
        self.is_new = taken.is_some();
        match taken {
            Some(_) if replace(&mut self.is_pending, false) => self.exchange(),
            Some(taken) => self.arrive(taken, self.time(taken)),
            None => {}
        }
    }

    /// Takes the last step back: another one from there finds the cloud that had come with it.
    pub(super) fn undo(&mut self) {
        self.step -= 1;
        if replace(&mut self.is_new, false) {
            self.exchange();
            self.is_pending = true;
        }
    }

    #[expect(clippy::cast_precision_loss, reason = "a count of steps")]
    fn time(&self, step: usize) -> f64 {
        step as f64 * self.dt
    }

    /// A state that was told before a step was taken back stands as it is.
    fn observe(&mut self, robot: &SpatialState) {
        let t = self.time(self.step);
        _ = self.perceiver.observe(t, robot.configuration(), robot.velocity());
    }

    /// Where the pictures of a step are kept.
    fn row(&self, step: usize) -> usize {
        step / self.every % self.rows * (self.pictures.len() / self.rows)
    }

    fn take(&mut self, robot: &SpatialState, world: &World) {
        let mut begin = self.row(self.step);
        let Self { eyes, errors, range, pictures, hits, .. } = self;
        for eye in eyes {
            let depths = &mut pictures[begin..begin + eye.pixels()];
            eye.take(robot, world, *range, errors, hits, depths);
            begin += eye.pixels();
        }
    }

    /// The pictures of a step arrive, which was at time `t` \[s\]. One that is refused is lost, as on a robot.
    fn arrive(&mut self, step: usize, t: f64) {
        let mut begin = self.row(step);
        for (camera, (eye, ahead)) in self.eyes.iter().zip(&self.clocks).enumerate() {
            let depths = &self.pictures[begin..begin + eye.pixels()];
            _ = self.perceiver.see(camera, t + ahead, Depth::Metres(depths));
            begin += eye.pixels();
        }
        self.before = Seen::of(&self.perceiver);
        self.exchange();
    }

    /// Puts the other cloud in place of this one.
    fn exchange(&mut self) {
        self.world.swap_points(0, &mut self.before.points);
        swap(&mut self.seen.moving, &mut self.before.moving);
        swap(&mut self.seen.since, &mut self.before.since);
    }
}

impl Positions for DepthCameras {
    fn count(&self) -> usize {
        self.most
    }

    /// Where the points are by now, NaN for those that are fewer than there is room for.
    fn append_to(&self, out: &mut Vec<f64>) {
        let elapsed = self.time(self.step) - self.seen.since;
        let now = |[point, velocity]: &[Vector<3>; 2]| point + velocity * elapsed;
        self.seen.moving.iter().for_each(|point| out.extend_from_slice(now(point).as_slice()));
        out.extend((3 * self.seen.moving.len()..3 * self.most).map(|_| f64::NAN));
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Camera, Kind};
    use super::*;
    use crate::robot::models;
    use crate::settings::Table;
    use crate::world::Motion;
    use std::sync::Arc;

    const H: f64 = 1e-3;

    /// From before the arm and from above it, as exact as can be.
    fn settings() -> PerceptionSettings {
        let camera = |position, orientation| Camera {
            position,
            orientation,
            columns: 96,
            rows: 72,
            field_of_view: 1.2,
        };
        let mut perceiver = PerceiverSettings::default();
        for (key, number) in
            [("stride", 1.0), ("voxel", 0.04), ("least_points", 1.0), ("time_error", 0.0)]
        {
            assert!(perceiver.set(key, number));
        }
        PerceptionSettings {
            kind: Kind::Depth,
            cameras: vec![
                camera([1.8, 0.0, 0.6], [0.5, -0.5, -0.5, 0.5]),
                camera([0.2, 0.0, 2.0], [0.0, 1.0, 0.0, 0.0]),
            ],
            range: 5.0,
            rate: Some(30.0),
            perceiver,
            ..PerceptionSettings::default()
        }
    }

    fn panda() -> SpatialState {
        Arc::new(models::named("panda").unwrap().build().unwrap()).state()
    }

    /// The arm as it swings, at a step.
    fn swing(robot: &mut SpatialState, step: usize) {
        let t = H * step as f64;
        let wave = |k: usize| 1.5 + 0.3 * k as f64;
        let about = [0.0, -0.5, 0.2, -1.8, 0.1, 1.6, 0.4];
        let q: Vec<f64> = (0..7).map(|k| about[k] + 0.4 * (wave(k) * t).sin()).collect();
        let dq: Vec<f64> = (0..7).map(|k| 0.4 * wave(k) * (wave(k) * t).cos()).collect();
        robot.update(&q, &dq);
    }

    /// A ball before walls that are outside of the room: where nothing is measured, nothing is seen to be free.
    fn ball(x: f64, speed: f64) -> World {
        let there = |shape, position, velocity| Obstacle {
            position,
            orientation: upright(),
            motion: Motion::Linear { velocity },
            ..Obstacle::of(shape)
        };
        let wall = |normal, position| there(Shape::HalfSpace { normal }, position, [0.0; 3]);
        World::new(vec![
            there(Shape::Sphere { radius: 0.1 }, [x, 0.3, 0.7], [0.0, speed, 0.0]),
            wall([1.0, 0.0, 0.0], [-1.5, 0.0, 0.0]),
            wall([0.0, 0.0, 1.0], [0.0, 0.0, -0.6]),
        ])
    }

    fn started(settings: &PerceptionSettings, world: &World) -> (DepthCameras, SpatialState) {
        let mut robot = panda();
        swing(&mut robot, 0);
        let mut cameras = DepthCameras::new(settings, 7, &robot, H).unwrap();
        cameras.start(&robot, world);
        (cameras, robot)
    }

    /// The arm fills a part of every picture, and with exact states none of its points is left, however late pictures are.
    #[test]
    fn no_point_of_the_arm_is_left() {
        for latency in [0.0, 0.05] {
            let nobody = World::new(vec![]);
            let (mut cameras, mut robot) =
                started(&PerceptionSettings { latency, ..settings() }, &nobody);
            for step in 1..1500 {
                swing(&mut robot, step);
                cameras.advance(&robot, &nobody);
                assert_eq!(cameras.seen.moving.len(), 0, "{latency} s late, step {step}");
                let seen = cameras.pictures.iter().filter(|depth| **depth > 0.0).count();
                assert!(seen > 300, "{seen}");
            }
        }
    }

    /// A ball on its way is where it is now, however late its pictures are, and has its velocity.
    #[test]
    fn what_moves_is_where_it_is_now() {
        for (latency, off) in [(0.0, 0.03), (0.08, 0.03)] {
            let mut world = ball(0.6, -0.4);
            let (mut cameras, mut robot) =
                started(&PerceptionSettings { latency, ..settings() }, &world);
            for step in 1..700 {
                world.update(H * step as f64);
                swing(&mut robot, step);
                cameras.advance(&robot, &world);
            }
            let mut found = vec![];
            cameras.append_to(&mut found);
            assert_eq!(found.len(), 3 * cameras.count());
            let points: Vec<_> = found.chunks(3).filter(|p| !p[0].is_nan()).collect();
            assert!(points.len() > 10);
            let middle = world.position(0);
            for point in points {
                let away = (Vector::<3>::from_column_slice(point) - middle).norm();
                assert!((away - 0.1).abs() < off, "{latency} s late: {away} m from the middle");
            }
            let speeds: Vec<_> = cameras.seen.moving.iter().map(|[_, v]| v.y).collect();
            let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
            assert!((mean + 0.4).abs() < 0.1, "{mean}");
        }
    }

    /// A step that is taken back shows what was seen before it, and what comes with it comes again.
    #[test]
    fn a_step_can_be_taken_back() {
        let mut world = ball(0.6, -0.4);
        let late = PerceptionSettings { latency: 5e-3, ..settings() };
        let (mut cameras, mut robot) = started(&late, &world);
        let shown = |cameras: &DepthCameras| {
            let mut out = vec![];
            cameras.append_to(&mut out);
            out.into_iter().map(f64::to_bits).collect::<Vec<_>>()
        };
        for step in 1..150 {
            let before = shown(&cameras);
            world.update(H * step as f64);
            swing(&mut robot, step);
            cameras.advance(&robot, &world);
            let after = shown(&cameras);
            cameras.undo();
            assert!(shown(&cameras) == before, "{step}");
            cameras.advance(&robot, &world);
            assert!(shown(&cameras) == after, "{step}");
        }
    }
}
