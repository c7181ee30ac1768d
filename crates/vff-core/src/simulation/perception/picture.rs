//! Pictures of depth cameras: what their rays meet first, the arm itself included (T188).

use super::{Camera, PerceptionSettings};
use crate::geometry::Carried;
use crate::interrupt;
use crate::math::{Capsule, Noise, UnitQuaternion, Vector};
use crate::perception::DepthCamera;
use crate::robot::{Robot, SpatialState};
use crate::simulation::measurement::rounded;
use crate::world::space::{World, cast_at_body};
use nalgebra::Matrix3;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::ops::Range;

/// How far a second ray is from the first where a surface is asked for its slope and its end: the width of a pixel of real cameras,
/// whose focal lengths are about 600 pixels, however coarse the simulated picture is.
const BESIDE: f64 = 1.0 / 600.0;

/// A camera as it really stands.
#[derive(Debug, Clone)]
pub(super) struct Eye {
    origin: Vector<3>,
    rotation: Matrix3<f64>,
    focal: f64,
    columns: usize,
    rows: usize,
}

/// What a ray meets first.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hit {
    /// How far it goes \[m\]; infinite where it meets nothing.
    distance: f64,
    /// Which of all bodies and obstacles.
    item: usize,
}

/// What can be met.
struct Scene<'a> {
    bodies: Vec<(Capsule<3>, Option<Carried<'a, 3>>)>,
    world: &'a World,
    range: f64,
}

impl<'a> Scene<'a> {
    fn new(robot: &'a SpatialState, world: &'a World, range: f64) -> Self {
        let moving = robot.bodies().map(|body| (body.shape, body.hull));
        let still = robot.still_bodies().iter().map(|still| (still.shape, still.carried()));
        Self { bodies: moving.chain(still).collect(), world, range }
    }

    fn len(&self) -> usize {
        self.bodies.len() + self.world.len()
    }

    /// A ball around an item: its middle and its radius \[m\].
    fn ball(&self, item: usize) -> (Vector<3>, f64) {
        match self.bodies.get(item) {
            Some((shape, _)) => {
                let half = 0.5 * shape.length;
                (shape.start + shape.direction * half, half + shape.radius)
            }
            None => self.world.ball(item - self.bodies.len()),
        }
    }

    /// How far a ray goes until it meets an item \[m\].
    fn cast(&self, item: usize, origin: &Vector<3>, direction: &Vector<3>) -> Option<f64> {
        match self.bodies.get(item) {
            Some((shape, hull)) => cast_at_body(shape, hull.as_ref(), origin, direction),
            None => {
                let obstacle = item - self.bodies.len();
                self.world.cast_at(obstacle, origin, direction, self.range)
            }
        }
    }
}

impl Camera {
    /// The same for the perceiver, which takes it for where it is said to be.
    #[expect(clippy::cast_precision_loss, reason = "counts of pixels")]
    pub fn model(&self) -> DepthCamera {
        let Self { position, orientation, columns, rows, .. } = *self;
        let focal = self.focal();
        DepthCamera {
            columns,
            rows,
            focal: [focal; 2],
            centre: [columns, rows].map(|count| 0.5 * count as f64 - 0.5),
            distortion: [0.0; 5],
            position,
            orientation,
        }
    }

    /// The focal length \[pixels\].
    #[expect(clippy::cast_precision_loss, reason = "a count of pixels")]
    pub(super) fn focal(&self) -> f64 {
        0.5 * self.columns as f64 / (0.5 * self.field_of_view).tan()
    }
}

impl Eye {
    /// The camera, moved by so much \[m\] and turned by a rotation vector \[rad\] in the axes of the world from where it is said to be.
    pub(super) fn new(camera: &Camera, moved: &Vector<3>, turned: &Vector<3>) -> Self {
        let said = UnitQuaternion::new(camera.orientation).unwrap_or_default().matrix();
        Self {
            origin: Vector::from(camera.position) + moved,
            rotation: UnitQuaternion::exp(turned).matrix() * said,
            focal: camera.focal(),
            columns: camera.columns,
            rows: camera.rows,
        }
    }

    pub(super) fn pixels(&self) -> usize {
        self.columns * self.rows
    }

    /// (x, y) of the ray of a pixel where z is 1.
    #[expect(clippy::cast_precision_loss, reason = "counts of pixels")]
    fn sight(&self, pixel: usize) -> [f64; 2] {
        let [column, row] = [pixel % self.columns, pixel / self.columns].map(|k| k as f64 + 0.5);
        let [columns, rows] = [self.columns, self.rows].map(|count| 0.5 * count as f64);
        [(column - columns) / self.focal, (row - rows) / self.focal]
    }

    /// The unit vector along (x, y, 1) in the world, and how long that was.
    fn direction(&self, [x, y]: [f64; 2]) -> (Vector<3>, f64) {
        let along = Vector::<3>::new(x, y, 1.0);
        let length = along.norm();
        (self.rotation * along / length, length)
    }

    /// The pixels in which a ball may be seen: columns and rows.
    fn window(&self, centre: &Vector<3>, radius: f64) -> [Range<usize>; 2] {
        let seen = self.rotation.tr_mul(&(centre - self.origin));
        [(seen.x, self.columns), (seen.y, self.rows)].map(|(aside, count)| {
            let distance = aside.hypot(seen.z);
            // False for what has no end.
            let is_outside = radius < distance;
            if !is_outside {
                return 0..count;
            }
            let [middle, half] = [aside.atan2(seen.z), (radius / distance).asin()];
            self.pixels_between(middle - half, middle + half, count)
        })
    }

    /// Of so many pixels in a row those that look between two angles from the optical axis \[rad\].
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "within the picture"
    )]
    fn pixels_between(&self, low: f64, high: f64, count: usize) -> Range<usize> {
        if low >= FRAC_PI_2 || high <= -FRAC_PI_2 {
            return 0..0;
        }
        let place = |angle: f64| {
            let at = self.focal * angle.tan() + 0.5 * count as f64;
            at.clamp(0.0, count as f64)
        };
        let first = if low <= -FRAC_PI_2 { 0 } else { place(low).floor() as usize };
        let end = if high >= FRAC_PI_2 { count } else { place(high).ceil() as usize };
        first..end.max(first)
    }

    /// What the rays of all pixels meet first within `range` \[m\], row by row.
    fn look(&self, scene: &Scene<'_>, hits: &mut Vec<Hit>) {
        hits.clear();
        hits.resize(self.pixels(), Hit { distance: f64::INFINITY, item: 0 });
        for item in 0..scene.len() {
            let (centre, radius) = scene.ball(item);
            let [columns, rows] = self.window(&centre, radius);
            interrupt::checkpoint(32 * columns.len() * rows.len());
            for row in rows {
                for column in columns.clone() {
                    let pixel = row * self.columns + column;
                    let (direction, _) = self.direction(self.sight(pixel));
                    let met = scene.cast(item, &self.origin, &direction);
                    if let Some(distance) = met.filter(|met| *met < hits[pixel].distance) {
                        hits[pixel] = Hit { distance, item };
                    }
                }
            }
        }
    }

    /// Takes a picture of all that is within `range` \[m\]: depths \[m\] row by row, 0 where nothing is measured.
    pub(super) fn take(
        &self,
        robot: &SpatialState,
        world: &World,
        range: f64,
        errors: &mut Errors,
        hits: &mut Vec<Hit>,
        depths: &mut [f32],
    ) {
        let scene = Scene::new(robot, world, range);
        self.look(&scene, hits);
        for (pixel, (hit, depth)) in hits.iter().zip(depths).enumerate() {
            // Drawn for every pixel, so that none depends on what the others have met.
            let drawn = errors.draw();
            let sight = self.sight(pixel);
            let along = hit.distance / self.direction(sight).1;
            let is_lost =
                drawn.is_lost || self.is_edge(&scene, hit, sight, drawn.aside, errors.grazing);
            let measured = if is_lost { None } else { errors.measured(along, range, drawn.normal) };
            #[expect(clippy::cast_possible_truncation, reason = "a depth")]
            let measured = measured.map_or(0.0, |measured| measured as f32);
            *depth = measured;
        }
    }

    /// Whether the surface at a hit is seen at a flatter angle than `grazing` \[rad\], or ends beside it: by a second ray, which is
    /// `aside` \[rad\] from the right of the first in the picture.
    fn is_edge(
        &self,
        scene: &Scene<'_>,
        hit: &Hit,
        [x, y]: [f64; 2],
        aside: f64,
        grazing: f64,
    ) -> bool {
        if grazing == 0.0 || hit.distance.is_infinite() {
            return false;
        }
        let (sin, cos) = aside.sin_cos();
        let (direction, _) = self.direction([x + BESIDE * cos, y + BESIDE * sin]);
        scene.cast(hit.item, &self.origin, &direction).is_none_or(|beside| {
            (beside - hit.distance).abs() * grazing.tan() > BESIDE * hit.distance
        })
    }
}

/// What is wrong with the depths of pictures.
#[derive(Debug, Clone)]
pub(super) struct Errors {
    /// Of a depth at 1 m: the standard deviation and the step \[m\]. Both grow with the square of the depth.
    deviation: f64,
    resolution: f64,
    /// The share of the pixels that are lost.
    drop_outs: f64,
    /// Surfaces at a flatter angle to the ray are not measured \[rad\].
    grazing: f64,
    noise: Noise,
    losses: Noise,
    sides: Noise,
}

/// The random numbers of a pixel.
struct Drawn {
    normal: f64,
    is_lost: bool,
    aside: f64,
}

impl Errors {
    /// The same seed gives the same noise.
    pub(super) fn new(settings: &PerceptionSettings, seed: u64) -> Self {
        Self {
            deviation: settings.noise,
            resolution: settings.resolution,
            drop_outs: settings.drop_outs,
            grazing: settings.grazing,
            noise: Noise::new(seed, 2),
            losses: Noise::new(seed, 3),
            sides: Noise::new(seed, 4),
        }
    }

    fn draw(&mut self) -> Drawn {
        Drawn {
            normal: if self.deviation > 0.0 { self.noise.draw() } else { 0.0 },
            is_lost: self.drop_outs > 0.0 && self.losses.share() < self.drop_outs,
            aside: if self.grazing > 0.0 { TAU * self.sides.share() } else { 0.0 },
        }
    }

    /// What is measured of a depth \[m\], if it is between 0 and `range`: a step of a stereo camera's disparity or of a phase is one of 1/depth.
    fn measured(&self, depth: f64, range: f64, normal: f64) -> Option<f64> {
        let with_noise = depth + self.deviation * depth * depth * normal;
        let measured = if self.resolution > 0.0 {
            1.0 / rounded(1.0 / with_noise, self.resolution)
        } else {
            with_noise
        };
        (0.0 < measured && measured <= range).then_some(measured)
    }
}
