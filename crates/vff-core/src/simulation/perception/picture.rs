//! Pictures of depth cameras: what their rays meet first, the arm itself included (T188).

use super::{Camera, PerceptionSettings};
use crate::geometry::PlacedHull;
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

/// What a depth camera has measured.
///
/// # Example
/// ```
/// use vff_core::runtime::live::Live;
/// use vff_core::scenario::Scenario;
/// use vff_core::simulation::DepthPicture;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let live = Live::new(&Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
///     arm = { model = "panda" }
///     reference = { kind = "setpoint" }
///     perception.kind = "depth"
///     perception.rate = 30.0
///     perception.cameras = [{ position = [1.8, 0.0, 0.6], orientation = [0.5, -0.5, -0.5, 0.5] }]
///     "#,
/// )?)?;
/// let DepthPicture { columns, depths } = &live.pictures()[0];
/// assert!(depths.len() % columns == 0 && depths.iter().any(|depth| *depth > 0.5));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct DepthPicture {
    /// Pixels side by side.
    pub columns: usize,
    /// Row by row \[m\]; 0 where nothing was measured.
    pub depths: Vec<f32>,
}

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
    bodies: Vec<(Capsule<3>, Option<PlacedHull<'a, 3>>)>,
    world: &'a World,
    range: f64,
}

impl<'a> Scene<'a> {
    fn new(robot: &'a SpatialState, world: &'a World, range: f64) -> Self {
        let moving = robot.bodies().map(|body| (body.shape, body.hull));
        let still = robot.still_bodies().iter().map(|still| (still.shape, still.placed_hull()));
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

    pub(super) fn columns(&self) -> usize {
        self.columns
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::models;
    use crate::world::Motion;
    use crate::world::space::{Obstacle, Shape};
    use proptest::prelude::*;
    use std::sync::Arc;

    fn panda() -> SpatialState {
        let mut state = Arc::new(models::named("panda").unwrap().build().unwrap()).state();
        state.update(&[0.3, -0.5, 0.2, -1.8, 0.1, 1.6, 0.4], &[0.0; 7]);
        state
    }

    fn obstacle(shape: Shape, position: [f64; 3], velocity: [f64; 3]) -> Obstacle {
        let orientation = [0.8, 0.6, 0.0, 0.0];
        let angular_velocity = [0.0; 3];
        let motion = Motion::Linear { velocity };
        Obstacle { position, orientation, angular_velocity, motion, ..Obstacle::of(shape) }
    }

    fn camera(position: [f64; 3], orientation: [f64; 4]) -> Camera {
        Camera { position, orientation, columns: 24, rows: 18, field_of_view: 1.4 }
    }

    fn three(range: f64) -> impl Strategy<Value = [f64; 3]> {
        [-range..range, -range..range, -range..range]
    }

    fn shape() -> impl Strategy<Value = Shape> {
        prop_oneof![
            (0.02..0.5).prop_map(|radius| Shape::Sphere { radius }),
            (three(0.5), three(0.5), 0.01..0.2).prop_map(|(a, b, radius)| Shape::Capsule {
                a,
                b,
                radius
            }),
            [0.05..1.0, 0.05..1.0, 0.05..1.0].prop_map(|size| Shape::Box { size }),
            Just(Shape::HalfSpace { normal: [0.0, 0.6, 0.8] }),
            prop::collection::vec(three(0.4), 1..5)
                .prop_map(|points| Shape::Points { points, radius: 0.1 }),
        ]
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// Asked only where they may be seen, bodies and obstacles are in every pixel in which they are when all are asked.
        #[test]
        fn nothing_is_missed(
            shapes in prop::collection::vec((shape(), three(1.0), three(0.3)), 0..5),
            from in three(1.5), turn in three(3.0), t in 0.0..2.0,
        ) {
            let all = shapes.into_iter().map(|(shape, at, velocity)| obstacle(shape, at, velocity));
            let mut world = World::new(all.collect());
            world.update(t);
            let robot = panda();
            let eye = Eye::new(&camera(from, UnitQuaternion::exp(&turn.into()).to_array()), &Vector::zeros(), &Vector::zeros());
            let scene = Scene::new(&robot, &world, 3.0);
            let mut hits = vec![];
            eye.look(&scene, &mut hits);
            for (pixel, hit) in hits.iter().enumerate() {
                let (direction, _) = eye.direction(eye.sight(pixel));
                let all = (0..scene.len()).filter_map(|item| scene.cast(item, &eye.origin, &direction));
                let least = all.fold(f64::INFINITY, f64::min);
                prop_assert_eq!(hit.distance.to_bits(), least.to_bits(), "{}", pixel);
            }
        }
    }

    /// Pictures of a wall across the view, 2 m away, whose pixels have known depths.
    fn of_a_wall(settings: &PerceptionSettings, normal: [f64; 3]) -> Vec<f32> {
        let world = World::new(vec![Obstacle {
            orientation: [1.0, 0.0, 0.0, 0.0],
            ..obstacle(Shape::HalfSpace { normal }, [5.0, 5.0, 3.0], [0.0; 3])
        }]);
        let eye = Eye::new(
            &camera([5.0, 5.0, 1.0], [1.0, 0.0, 0.0, 0.0]),
            &Vector::zeros(),
            &Vector::zeros(),
        );
        let (mut errors, mut hits) = (Errors::new(settings, 7), vec![]);
        let mut all = vec![];
        for _ in 0..40 {
            let mut depths = vec![0.0; eye.pixels()];
            eye.take(&panda(), &world, 9.0, &mut errors, &mut hits, &mut depths);
            all.extend(depths);
        }
        all
    }

    const ACROSS: [f64; 3] = [0.0, 0.0, -1.0];

    /// The deviation is that of 1 m times the square of the depth, to five deviations of either; losses have their share; steps
    /// are steps of 1/depth.
    #[test]
    fn errors_are_those_of_depth_cameras() {
        let none = PerceptionSettings::default();
        assert!(of_a_wall(&none, ACROSS).iter().all(|depth| (depth - 2.0).abs() < 1e-6));
        let sigma = 0.003;
        let found = of_a_wall(&PerceptionSettings { noise: sigma, ..none.clone() }, ACROSS);
        let count = found.len() as f64;
        let mean = found.iter().map(|z| f64::from(*z)).sum::<f64>() / count;
        let variance = found.iter().map(|z| (f64::from(*z) - mean).powi(2)).sum::<f64>() / count;
        let expected = 4.0 * sigma;
        assert!((mean - 2.0).abs() < 5.0 * expected / count.sqrt(), "{mean}");
        assert!((variance.sqrt() - expected).abs() < 5.0 * expected / (2.0 * count).sqrt());
        let found = of_a_wall(
            &PerceptionSettings { noise: sigma, resolution: 0.01, ..none.clone() },
            ACROSS,
        );
        for depth in found {
            let steps = 1.0 / (0.01 * f64::from(depth));
            assert!((steps - steps.round()).abs() < 1e-4, "{depth}");
        }
        let share = 0.3;
        let found = of_a_wall(&PerceptionSettings { drop_outs: share, ..none }, ACROSS);
        let lost = found.iter().filter(|depth| **depth == 0.0).count() as f64 / count;
        assert!((lost - share).abs() < 5.0 * (share * (1.0 - share) / count).sqrt(), "{lost}");
    }

    /// A wall that is seen at a flat angle is measured until that is too flat; one across the view always is. Of a ball its rim is lost.
    #[test]
    fn what_is_flat_and_what_ends_is_lost() {
        let grazing = PerceptionSettings { grazing: 0.2, ..PerceptionSettings::default() };
        assert!(of_a_wall(&grazing, ACROSS).iter().all(|depth| *depth > 0.0));
        // The rays that meet a wall at 0.1 rad to the axis do so at an angle of less than 0.8.
        let (sin, cos) = 0.1_f64.sin_cos();
        let found =
            of_a_wall(&PerceptionSettings { grazing: 0.8, ..grazing.clone() }, [-cos, 0.0, -sin]);
        let all = of_a_wall(&PerceptionSettings::default(), [-cos, 0.0, -sin]);
        let count = |depths: &[f32]| depths.iter().filter(|depth| **depth > 0.0).count();
        assert!(
            count(&all) > 1000 && count(&found) < count(&all) * 9 / 10,
            "{} of {}",
            count(&found),
            count(&all)
        );
        let world =
            World::new(vec![obstacle(Shape::Sphere { radius: 0.3 }, [5.0, 5.0, 2.0], [0.0; 3])]);
        let eye = Eye::new(
            &Camera { columns: 400, rows: 300, ..camera([5.0, 5.0, 1.0], [1.0, 0.0, 0.0, 0.0]) },
            &Vector::zeros(),
            &Vector::zeros(),
        );
        let (mut hits, mut depths) = (vec![], vec![0.0; eye.pixels()]);
        eye.take(&panda(), &world, 9.0, &mut Errors::new(&grazing, 7), &mut hits, &mut depths);
        let (mut lost, mut seen) = (vec![], vec![]);
        for pixel in (0..eye.pixels()).filter(|pixel| hits[*pixel].distance.is_finite()) {
            let (direction, _) = eye.direction(eye.sight(pixel));
            let normal = (eye.origin + direction * hits[pixel].distance
                - Vector::<3>::new(5.0, 5.0, 2.0))
                / 0.3;
            let flat = -normal.dot(&direction);
            if depths[pixel] == 0.0 { lost.push(flat) } else { seen.push(flat) }
        }
        assert!(lost.len() > 100 && seen.len() > 10_000, "{} {}", lost.len(), seen.len());
        // sin 0.2, and what the second ray may be wrong by next to the rim.
        assert!(
            lost.iter().all(|flat| *flat < 0.25),
            "{:?}",
            lost.iter().copied().fold(0.0, f64::max)
        );
    }

    /// A camera is off by what is said of it.
    #[test]
    fn cameras_are_off_by_what_is_said() {
        let said = camera([0.3, -0.2, 1.0], [0.5, -0.5, 0.5, -0.5]);
        let exact = Eye::new(&said, &Vector::zeros(), &Vector::zeros());
        let off = Eye::new(
            &said,
            &Vector::<3>::new(0.003, 0.0, -0.004),
            &Vector::<3>::new(0.0, 0.01, 0.0),
        );
        assert!(((off.origin - exact.origin).norm() - 0.005).abs() < 1e-15);
        let turn = off.rotation * exact.rotation.transpose();
        assert!((((turn.trace() - 1.0) / 2.0).acos() - 0.01).abs() < 1e-9);
    }
}
