//! Range sensors around the links of an arm in space, and depth cameras beside it.

use super::depth::DepthCameras;
use super::scans::{Ray, Scans};
use super::{DepthPicture, Kind, Perceive, PerceptionSettings};
use crate::geometry::{Body, GOLDEN_ANGLE};
use crate::interrupt;
use crate::math::{UnitQuaternion, Vector};
use crate::perception::PerceptionError;
use crate::robot::{Robot, SpatialState};
use crate::world::space::{
    SpatialGeometry, World, cast_at_body, cast_at_hull, contact_with_point, distance_of_point,
    perpendicular,
};
use crate::world::{CollisionQuery, Contact, Pair, Positions};
use nalgebra::{Matrix3, Rotation3, Unit};

/// The most points that one body keeps off at once: directions that are pairwise farther apart than [`APART`] are no more
/// than these (seven on a sphere leave two that are 77.9° or less apart; Schütte and van der Waerden, 1951).
const MAX_NORMALS: usize = 6;
/// The cosine of 80°.
const APART: f64 = 0.173_648_177_666_930_33;

/// Where a ray begins and how it points: in the frame of the link that carries a body, or in the world.
#[derive(Debug, Clone, Copy)]
struct Mount {
    carrier: Option<Carrier>,
    ray: Ray<3>,
}

/// A body that carries sensors, and the link that it moves with.
#[derive(Debug, Clone, Copy)]
struct Carrier {
    body: usize,
    link: usize,
}

/// Sensors with what they have seen.
#[derive(Debug, Clone)]
pub struct SpatialPerception {
    mounts: Vec<Mount>,
    scans: Scans<3>,
    /// For one body: the points within reach, each with its contact.
    near: Vec<Contact<3>>,
    /// Instead of all that: pictures.
    depth: Option<Box<DepthCameras>>,
}

impl SpatialPerception {
    /// Sensors for plant steps of `dt` \[s\], on the bodies of `robot` if that is their kind; the same seed gives the same
    /// noise.
    ///
    /// # Errors
    /// If the pictures of depth cameras are for no perceiver.
    pub fn new(
        settings: &PerceptionSettings,
        seed: u64,
        robot: &SpatialState,
        dt: f64,
    ) -> Result<Self, PerceptionError> {
        let depth = match settings.kind {
            Kind::Depth => Some(Box::new(DepthCameras::new(settings, seed, robot, dt)?)),
            _ => None,
        };
        let mounts = match settings.kind {
            Kind::Ideal | Kind::Depth => vec![],
            Kind::Range => {
                let bodies = 0..robot.body_count();
                bodies.flat_map(|body| around_body(settings, robot, body)).collect()
            }
            Kind::Camera => settings.cameras.iter().flat_map(super::Camera::mounts).collect(),
        };
        let scans = Scans::new(settings, seed, mounts.len(), dt);
        Ok(Self { near: Vec::with_capacity(mounts.len()), mounts, scans, depth })
    }

    /// What the controller knows of rays \[m\]: one point each, NaN where nothing was met.
    pub fn seen(&self) -> &[Vector<3>] {
        self.scans.seen()
    }
}

/// Rays in cones that point away from a body: so many cones along it, so many around it.
#[expect(clippy::cast_precision_loss, reason = "counts of sensors and rays")]
fn around_body(settings: &PerceptionSettings, robot: &SpatialState, body: usize) -> Vec<Mount> {
    let Body { link, shape: capsule, hull, .. } = robot.body(body);
    let (axes, joint) = (robot.link_axes(link), robot.joint_position(link));
    // From the capsule in to the hull, where one is there.
    let surface = |origin: Vector<3>, outward: &Vector<3>| {
        let [from, inward] = [joint + axes * origin, axes * -outward];
        let way = hull.and_then(|hull| cast_at_hull(&hull, &from, &inward));
        origin - outward * way.unwrap_or(0.0)
    };
    let start = axes.tr_mul(&(capsule.start - joint));
    let along = axes.tr_mul(&capsule.direction);
    let side = perpendicular(&along);
    let sides = settings.sides(3);
    let carrier = Some(Carrier { body, link });
    let mut mounts = Vec::with_capacity(sides * settings.sensors * settings.rays);
    for place in 0..settings.sensors {
        let share = (place as f64 + 0.5) / settings.sensors as f64;
        for k in 0..sides {
            let angle = std::f64::consts::TAU * k as f64 / sides as f64;
            let outward = Rotation3::from_axis_angle(&Unit::new_unchecked(along), angle) * side;
            let origin = start + along * (share * capsule.length) + outward * capsule.radius;
            let origin = surface(origin, &outward);
            let frame = Matrix3::from_columns(&[along, outward.cross(&along), outward]);
            let rays = cone(settings.rays, settings.field_of_view);
            mounts.extend(rays.map(|ray| Mount { carrier, ray: [origin, frame * ray] }));
        }
    }
    mounts
}

/// Unit vectors that fill a cone about z evenly, the first along it, the last on its edge (a sunflower's spiral, Vogel, 1979).
#[expect(clippy::cast_precision_loss, reason = "a count of rays")]
fn cone(count: usize, field_of_view: f64) -> impl Iterator<Item = Vector<3>> {
    (0..count).map(move |k| {
        let share = if count > 1 { k as f64 / (count - 1) as f64 } else { 0.0 };
        let (sin, cos) = (0.5 * field_of_view * share.sqrt()).sin_cos();
        let (turn_sin, turn_cos) = (GOLDEN_ANGLE * k as f64).sin_cos();
        Vector::<3>::new(sin * turn_cos, sin * turn_sin, cos)
    })
}

impl super::Camera {
    /// A ray through the middle of every pixel, row by row.
    #[expect(clippy::cast_precision_loss, reason = "a count of pixels")]
    fn mounts(&self) -> impl Iterator<Item = Mount> {
        let frame = UnitQuaternion::new(self.orientation).unwrap_or_default();
        let origin = Vector::from(self.position);
        let (columns, rows) = (self.columns as f64, self.rows as f64);
        let focal = self.focal();
        (0..self.columns * self.rows).map(move |k| {
            let (row, column) = ((k / self.columns) as f64, (k % self.columns) as f64);
            let [x, y] = [column + 0.5 - 0.5 * columns, row + 0.5 - 0.5 * rows];
            let direction = frame.rotate(&Vector::<3>::new(x, y, focal).normalize());
            Mount { carrier: None, ray: [origin, direction] }
        })
    }
}

impl Mount {
    fn ray(&self, robot: &SpatialState) -> Ray<3> {
        let Some(Carrier { link, .. }) = self.carrier else { return self.ray };
        let axes = robot.link_axes(link);
        let [origin, direction] = self.ray;
        [robot.joint_position(link) + axes * origin, axes * direction]
    }

    /// Where the ray is, and how far it goes until it meets an obstacle; not at all if the arm is in its way (T111). A
    /// sensor looks through its own body and through those that it is inside of.
    fn cast(&self, robot: &SpatialState, world: &World, range: f64) -> (Ray<3>, Option<f64>) {
        let [origin, direction] = self.ray(robot);
        let end = world.cast(origin, direction, range).filter(|end| {
            let own = self.carrier.map(|carrier| carrier.body);
            let carried = (0..robot.body_count()).filter(|k| Some(*k) != own).map(|k| {
                let body = robot.body(k);
                (body.shape, body.hull)
            });
            let still = robot.still_bodies().iter().map(|still| (still.shape, still.placed_hull()));
            !carried.chain(still).any(|(shape, hull)| {
                let met = cast_at_body(&shape, hull.as_ref(), &origin, &direction);
                met.is_some_and(|s| 0.0 < s && s < *end)
            })
        });
        ([origin, direction], end)
    }
}

impl Perceive<SpatialState, SpatialGeometry, 3> for SpatialPerception {
    fn start(&mut self, robot: &SpatialState, world: &World) {
        let Self { mounts, scans, depth, .. } = self;
        match depth {
            Some(depth) => depth.start(robot, world),
            None => scans.start(|k, range| mounts[k].cast(robot, world, range)),
        }
    }

    fn advance(&mut self, robot: &SpatialState, world: &World) {
        let Self { mounts, scans, depth, .. } = self;
        match depth {
            Some(depth) => depth.advance(robot, world),
            None => scans.advance(|k, range| mounts[k].cast(robot, world, range)),
        }
    }

    fn undo(&mut self) {
        match &mut self.depth {
            Some(depth) => depth.undo(),
            None => self.scans.undo(),
        }
    }

    fn pictures(&self) -> Vec<DepthPicture> {
        self.depth.as_ref().map_or_else(Vec::new, |cameras| cameras.pictures())
    }

    fn believed(&mut self) -> Result<&mut World, &mut Self> {
        match self {
            Self { depth: Some(depth), .. } => Ok(depth.world()),
            rays => Err(rays),
        }
    }
}

impl Positions for SpatialPerception {
    fn count(&self) -> usize {
        self.depth.as_ref().map_or_else(|| self.scans.count(), |depth| depth.count())
    }

    fn append_to(&self, out: &mut Vec<f64>) {
        match &self.depth {
            Some(depth) => depth.append_to(out),
            None => self.scans.append_to(out),
        }
    }
}

impl CollisionQuery<3> for SpatialPerception {
    /// One in each direction.
    fn obstacle_count(&self) -> usize {
        MAX_NORMALS
    }

    /// For every body the nearest of all points, then the nearest of those that lie in another direction than the ones
    /// before, each at rest (T112); `obstacle` counts them.
    fn for_each_contact<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, 3>>,
        reach: f64,
        mut distance: impl FnMut(usize, f64),
        mut visit: impl FnMut(&Contact<3>),
    ) {
        let Self { scans, near, .. } = self;
        if scans.met().is_empty() {
            return;
        }
        for (index, body) in bodies.into_iter().enumerate() {
            let mut least = f64::INFINITY;
            near.clear();
            interrupt::checkpoint(16 * scans.met().len());
            for point in scans.met() {
                let gap = distance_of_point(&body, point);
                least = least.min(gap);
                if gap < reach {
                    near.push(touch(index, &body, 0, point));
                }
            }
            distance(body.link, least);
            let mut normals = [Vector::<3>::zeros(); MAX_NORMALS];
            for obstacle in 0..MAX_NORMALS {
                let elsewhere = |contact: &&Contact<3>| {
                    normals[..obstacle].iter().all(|normal| contact.normal.dot(normal) < APART)
                };
                let nearest =
                    near.iter().filter(elsewhere).min_by(|a, b| a.distance.total_cmp(&b.distance));
                let Some(contact) = nearest else { break };
                normals[obstacle] = contact.normal;
                visit(&Contact { obstacle, ..*contact });
            }
        }
    }

    /// The nearest of all points, in whatever direction it comes to lie; they stay where they are.
    fn contact_after(
        &self,
        index: usize,
        body: &Body<'_, 3>,
        obstacle: usize,
        _: f64,
    ) -> Contact<3> {
        let gap = |point: &Vector<3>| distance_of_point(body, point);
        let nearest = self.scans.met().iter().min_by(|a, b| gap(a).total_cmp(&gap(b)));
        let nowhere = Vector::repeat(f64::INFINITY);
        touch(index, body, obstacle, nearest.unwrap_or(&nowhere))
    }
}

/// The contact of a body with a point at rest.
fn touch(index: usize, body: &Body<'_, 3>, obstacle: usize, point: &Vector<3>) -> Contact<3> {
    let pair = Pair { body: index, link: body.link, obstacle, ..Pair::default() };
    contact_with_point(pair, body, point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::description::{LinkShape, PlacedShape};
    use crate::robot::models;
    use crate::simulation::Camera;
    use crate::world::space::oracle::fixed;
    use crate::world::space::{Obstacle, Shape};
    use proptest::prelude::*;
    use std::sync::Arc;

    const Q: [f64; 7] = [0.3, -0.5, 0.2, -1.8, 0.1, 1.6, 0.4];

    fn panda() -> SpatialState {
        let mut state = Arc::new(models::named("panda").unwrap().build().unwrap()).state();
        state.update(&Q, &[0.0; 7]);
        state
    }

    fn ball(radius: f64, position: [f64; 3]) -> Obstacle {
        fixed(Shape::Sphere { radius }, position)
    }

    fn around(obstacles: Vec<Obstacle>, settings: &PerceptionSettings) -> SpatialPerception {
        let robot = panda();
        let mut perception = SpatialPerception::new(settings, 7, &robot, 1e-3).unwrap();
        perception.start(&robot, &World::new(obstacles));
        perception
    }

    fn on_links() -> PerceptionSettings {
        PerceptionSettings { kind: Kind::Range, rays: 9, ..PerceptionSettings::default() }
    }

    /// At the height of 1 m, far to the side of the arm, looking along x.
    fn camera(position: [f64; 3]) -> PerceptionSettings {
        let camera = Camera {
            position,
            orientation: [0.5, -0.5, 0.5, -0.5],
            columns: 8,
            rows: 6,
            field_of_view: 1.2,
        };
        let cameras = vec![camera];
        PerceptionSettings {
            kind: Kind::Camera,
            range: 5.0,
            cameras,
            ..PerceptionSettings::default()
        }
    }

    fn met(perception: &SpatialPerception) -> Vec<Vector<3>> {
        perception.seen().iter().copied().filter(|point| !point.x.is_nan()).collect()
    }

    /// The first along the axis, the last on the edge, none beyond; and none of the cone is far from all of them.
    #[test]
    fn a_cone_is_filled_evenly() {
        let (count, angle) = (200, 1.0);
        let rays: Vec<_> = cone(count, angle).collect();
        assert_eq!(rays[0], Vector::<3>::z());
        let tilt = |ray: &Vector<3>| ray.z.min(1.0).acos();
        assert!((tilt(&rays[count - 1]) - 0.5 * angle).abs() < 1e-12);
        assert!(rays.iter().all(|ray| tilt(ray) < 0.5 * angle + 1e-12));
        assert!(rays.iter().all(|ray| (ray.norm() - 1.0).abs() < 1e-15));
        let radius = 0.5 * angle / (count as f64).sqrt(); // of a disc that has one ray's share of the cone
        for place in cone(5000, angle) {
            let nearest = rays.iter().map(|ray| ray.angle(&place)).fold(f64::INFINITY, f64::min);
            assert!(nearest < 2.0 * radius, "{place} is {nearest} away");
        }
        assert_eq!(cone(1, 2.0).collect::<Vec<_>>(), [Vector::<3>::z()]);
    }

    /// Sensors sit on the surfaces of the bodies, evenly around them, and turn with the links.
    #[test]
    fn sensors_sit_around_the_bodies() {
        let settings = PerceptionSettings { rays: 1, sensors: 2, around: Some(3), ..on_links() };
        let mut robot = panda();
        let perception = SpatialPerception::new(&settings, 7, &robot, 1e-3).unwrap();
        assert_eq!(perception.mounts.len(), robot.body_count() * 6);
        robot.update(&[1.0, 0.3, -0.8, -1.2, 2.0, 0.4, -2.0], &[0.0; 7]);
        let ray = |k: usize| perception.mounts[k].ray(&robot);
        for body in 0..robot.body_count() {
            let capsule = robot.body(body).shape;
            for place in 0..2 {
                let first = 6 * body + 3 * place;
                let along = capsule.direction * ((place as f64 + 0.5) / 2.0 * capsule.length);
                let sum: Vector<3> = (first..first + 3).map(|k| ray(k)[1]).sum();
                assert!(sum.norm() < 1e-14);
                for [origin, direction] in (first..first + 3).map(ray) {
                    assert!(
                        (origin - capsule.start - along - direction * capsule.radius).norm()
                            < 1e-14
                    );
                    assert!(direction.dot(&capsule.direction).abs() < 1e-14);
                }
            }
        }
    }

    /// Of a wall across the view, every pixel has a point at its own place, the first at the upper left.
    #[test]
    fn a_picture_of_a_wall() {
        let wall = fixed(Shape::HalfSpace { normal: [-1.0, 0.0, 0.0] }, [4.0, 0.0, 0.0]);
        let perception = around(vec![wall], &camera([2.0, 3.0, 1.0]));
        let half = 2.0 * 0.6_f64.tan(); // of the picture on the wall, 2 m away
        for (k, point) in perception.seen().iter().enumerate() {
            let (row, column) = ((k / 8) as f64, (k % 8) as f64);
            let expected = Vector::<3>::new(
                4.0,
                3.0 + half * (1.0 - (column + 0.5) / 4.0),
                1.0 + half * 6.0 / 8.0 * (1.0 - (row + 0.5) / 3.0),
            );
            assert!((point - expected).norm() < 1e-12, "{k}: {point} is not {expected}");
        }
    }

    /// A ball that the arm is in front of is not seen, nor the arm; beside it, it is. A link's own sensors see past the
    /// link.
    #[test]
    fn what_is_behind_the_arm_is_hidden() {
        let robot = panda();
        let upper = robot.body(1).shape;
        let middle = upper.start + upper.direction * (0.5 * upper.length);
        let mut view = camera([middle.x - 2.0, middle.y, middle.z]);
        view.cameras[0].columns = 1;
        view.cameras[0].rows = 1;
        let at = |x: f64, y: f64| vec![ball(0.02, [middle.x + x, middle.y + y, middle.z])];
        assert!(met(&around(at(0.5, 0.0), &view)).is_empty());
        let before = met(&around(at(-0.5, 0.0), &view));
        assert!((before[0] - middle + Vector::<3>::x() * 0.52).norm() < 1e-12);
        view.cameras[0].position[1] += 0.5;
        assert_eq!(met(&around(at(0.5, 0.5), &view)).len(), 1);
        let large = vec![ball(0.1, [middle.x + 0.35, middle.y, middle.z])];
        assert!(met(&around(large, &on_links())).len() > 1);
    }

    /// A Panda with a long thin board on its third link, 0.4 m by 0.02 m by 0.4 m, whose capsule is as thick as it is wide.
    fn with_a_board() -> SpatialState {
        let mut description = models::named("panda").unwrap();
        let orientation = [1.0, 0.0, 0.0, 0.0];
        let plate = Shape::Box { size: [0.4, 0.02, 0.4] };
        let shape = PlacedShape { orientation: Some(orientation), ..plate.into() };
        description.collision = vec![LinkShape::of("panda_link3", shape)];
        let mut state = Arc::new(description.build().unwrap()).state();
        state.update(&Q, &[0.0; 7]);
        state
    }

    /// Beside a board, and within the capsule around it, a ball is seen that is behind the board from elsewhere; the board's
    /// sensors sit on it, and points near it are as far from it as they are from a box.
    #[test]
    fn a_board_is_no_capsule() {
        let robot = with_a_board();
        let Body { shape: capsule, hull, .. } = robot.body(0);
        let hull = hull.unwrap();
        assert!(capsule.radius > 0.19);
        let middle = robot.joint_position(2);
        let across: Vector<3> = robot.link_axes(2).column(1).into();
        let along: Vector<3> = robot.link_axes(2).column(0).into();
        let ball = |gap: f64| ball(0.02, (middle + across * gap).into());
        let seen = |settings: &PerceptionSettings, gap: f64| {
            let mut perception = SpatialPerception::new(settings, 7, &robot, 1e-3).unwrap();
            perception.start(&robot, &World::new(vec![ball(gap)]));
            met(&perception)
        };
        // Past the board at 10 cm, along it; and through it.
        let view = |from: Vector<3>, to: Vector<3>| {
            let z = (to - from).normalize();
            let x = perpendicular(&z);
            let turn = Matrix3::from_columns(&[x, z.cross(&x), z]);
            let orientation = UnitQuaternion::from_matrix(&turn).to_array();
            let camera = Camera {
                position: from.into(),
                orientation,
                columns: 1,
                rows: 1,
                field_of_view: 0.1,
            };
            PerceptionSettings { cameras: vec![camera], ..self::camera([0.0; 3]) }
        };
        let beside = middle + across * 0.1;
        assert_eq!(seen(&view(beside - along, beside), 0.1).len(), 1);
        assert_eq!(seen(&view(middle - across, middle), 0.1).len(), 0);
        // Sensors.
        let settings = PerceptionSettings { rays: 1, sensors: 3, around: Some(4), ..on_links() };
        let perception = SpatialPerception::new(&settings, 7, &robot, 1e-3).unwrap();
        for mount in &perception.mounts {
            let [origin, _] = mount.ray(&robot);
            let body = Body { hull: Some(hull), ..Body::new(2, capsule) };
            assert!(distance_of_point(&body, &origin).abs() < 1e-12, "{origin}");
        }
        let point = middle + across * 0.06;
        let body = robot.body(0);
        assert!((distance_of_point(&body, &point) - 0.05).abs() < 1e-12);
        let found = touch(0, &body, 0, &point);
        assert!((found.distance - 0.05).abs() < 1e-12 && (found.normal + across).norm() < 1e-12);
    }

    /// The contacts of the first body.
    fn contacts(perception: &mut SpatialPerception, reach: f64) -> Vec<Contact<3>> {
        let mut found = vec![];
        perception.for_each_contact(
            [Robot::body(&panda(), 2)],
            reach,
            |_, _| {},
            |c| found.push(*c),
        );
        found
    }

    /// A wall counts once, a corner of three walls three times, nearest first, with the walls' normals as far as rays go.
    #[test]
    fn a_wall_counts_once() {
        let robot = panda();
        let capsule = robot.body(2).shape;
        let middle = capsule.start + capsule.direction * (0.5 * capsule.length);
        let wall = |axis: usize, gap: f64| {
            let mut normal = [0.0; 3];
            normal[axis] = 1.0;
            let mut position = <[f64; 3]>::from(middle);
            position[axis] -= capsule.radius + 0.5 * capsule.length + gap;
            fixed(Shape::HalfSpace { normal }, position)
        };
        let many = PerceptionSettings { sensors: 8, around: Some(16), rays: 25, ..on_links() };
        let one = contacts(&mut around(vec![wall(0, 0.10)], &many), 0.8);
        assert_eq!(one.len(), 1);
        assert!(one[0].normal.x > 0.98 && one[0].velocity == Vector::<3>::zeros());
        let corner = vec![wall(0, 0.10), wall(1, 0.15), wall(2, 0.20)];
        let three = contacts(&mut around(corner, &many), 0.8);
        assert_eq!(three.len(), 3, "{three:?}");
        let order: Vec<usize> = three.iter().map(|c| c.obstacle).collect();
        assert_eq!(order, [0, 1, 2]);
        assert!(three.windows(2).all(|pair| pair[0].distance <= pair[1].distance));
        assert!(three.iter().all(|c| c.normal.max() > 0.9), "{three:?}");
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        /// However many points there are around a body: no more directions than are told of, no two within 80° of each
        /// other, the nearest point first, and every point near lies within 80° of one that is as near or nearer.
        #[test]
        fn directions_are_apart(
            points in prop::collection::vec([-1.0..1.0, -1.0..1.0, -1.0..1.0], 1..400), reach in 0.05..0.9,
        ) {
            let capsule = panda().body(2).shape;
            let mut perception = around(vec![], &PerceptionSettings { rays: 40, ..on_links() });
            let points: Vec<Vector<3>> = points.iter().map(|p| capsule.start + Vector::from(*p)).collect();
            perception.scans.pretend(&points);
            let found = contacts(&mut perception, reach);
            prop_assert!(found.len() <= perception.obstacle_count());
            for (k, contact) in found.iter().enumerate() {
                prop_assert_eq!(contact.obstacle, k);
                for other in &found[..k] {
                    prop_assert!(other.normal.dot(&contact.normal) < 80f64.to_radians().cos() + 1e-15);
                    prop_assert!(other.distance <= contact.distance);
                }
            }
            for point in &points {
                let foot = capsule.clamp(point);
                let distance = (foot - point).norm() - capsule.radius;
                let normal = (foot - point).normalize();
                let is_told = |c: &Contact<3>| {
                    c.distance <= distance + 1e-14 && c.normal.dot(&normal) > 80f64.to_radians().cos() - 1e-9
                };
                prop_assert!(distance >= reach - 1e-14 || found.iter().any(is_told), "{point} at {distance}");
            }
        }
    }
}
