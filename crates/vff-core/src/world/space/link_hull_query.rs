//! A hull that a link carries, and an obstacle.

use super::contact::contact_of;
use super::geometry::SpatialGeometry;
use super::shape::{ConvexCore, Core, Point, dispatch};
use crate::geometry::{Body, HullContact, KSmallest, MAX_FEATURES, PlacedHull, Probe};
use crate::interrupt;
use crate::math::{TOUCHING, Vector};
use crate::world::{Asked, Contact, MotionState, ObstacleGeometry, Pair};
use nalgebra::Matrix3;

/// The contact in the world of a hull with what it was `found` to come nearest to, relative to the position of that state.
fn placed(pair: Pair, found: &HullContact, radius: f64, state: &MotionState<3>) -> Contact<3> {
    contact_of(pair, &found.nearest, &found.axis, [radius, 0.0], state)
}

/// The contact of a body with a point at rest \[m\].
pub fn contact_with_point(pair: Pair, body: &Body<'_, 3>, point: &Vector<3>) -> Contact<3> {
    if let Some(hull) = &body.hull {
        let at_rest = MotionState::at_rest(Vector::zeros());
        return placed(pair, &hull.meet_point(point), 0.0, &at_rest);
    }
    let geometry = SpatialGeometry { core: Core::Point(Point(Vector::zeros())), radius: 0.0 };
    geometry.contact(pair, &body.shape, &MotionState::at_rest(*point))
}

/// Signed distance of a point from a body \[m\].
pub fn distance_of_point(Body { shape, hull, .. }: &Body<'_, 3>, point: &Vector<3>) -> f64 {
    let of_capsule = (shape.clamp(point) - point).norm() - shape.radius;
    hull.map_or(of_capsule, |hull| hull.meet_point(point).nearest.distance)
}

impl Asked {
    /// What is farther is not told \[m\].
    fn reach(self) -> f64 {
        match self {
            Self::Nearest => f64::INFINITY,
            Self::Contacts(reach) | Self::Barriers(reach) => reach,
        }
    }
}

impl SpatialGeometry {
    /// How far a body is at least, the capsule `around` or the hull that it holds; see [`PlacedHull::gap`].
    pub(super) fn at_least(
        &self,
        hull: Option<&PlacedHull<'_, 3>>,
        around: &Probe,
        state: &MotionState<3>,
        limit: f64,
        plane: &mut Vector<3>,
    ) -> f64 {
        let Some(hull) = hull else {
            let Core::Hull(core) = &self.core else {
                return self.capsule_at_least(around, state, limit, plane);
            };
            let position = state.position;
            let placed = PlacedHull { hull: core, rotation: &Matrix3::identity(), position };
            let around = Probe { radius: around.radius + self.radius, ..*around };
            return placed.gap_from_capsule(&around, limit, plane);
        };
        if plane.norm_squared() == 0.0 {
            let distance = self.at_least(None, around, state, limit, plane);
            if distance >= limit {
                return distance;
            }
        }
        let seen = PlacedHull { position: hull.position - state.position, ..*hull };
        dispatch!(&self.core, shape => return shape.gap(&seen, self.radius, limit, plane), _cloud => ());
        let (mut least, pair) = (f64::NAN, Pair::default());
        let visit = &mut |found: &Contact<3>| least = found.distance;
        self.visit_hull(pair, hull, around, state, Asked::Nearest, visit);
        *plane = Vector::zeros(); // that of the capsule tells nothing of this distance
        least
    }

    /// Calls `visit` with what is `asked` of a hull, which the capsule `around` holds.
    pub(super) fn visit_hull(
        &self,
        pair: Pair,
        hull: &PlacedHull<'_, 3>,
        around: &Probe,
        state: &MotionState<3>,
        asked: Asked,
        visit: &mut dyn FnMut(&Contact<3>),
    ) {
        interrupt::checkpoint(16 * hull.hull.edge_count());
        let seen = PlacedHull { position: hull.position - state.position, ..*hull };
        let place = |found: &HullContact| placed(pair, found, self.radius, state);
        let cloud = dispatch!(
            &self.core,
            shape => return visit_convex(shape, &seen, self.radius, asked, place, visit),
            cloud => cloud
        );
        let touch = |found: &Contact<3>| {
            // Its ball is at the point of the cloud, whatever of the capsule is nearest to it.
            let centre = found.witness - found.normal * self.radius - state.position;
            let of_ball = MotionState { velocity: found.velocity, ..*state };
            placed(pair, &Point(centre).meet(&seen, asked), self.radius, &of_ball)
        };
        if asked == Asked::Nearest {
            // No ball is nearer to the hull than to the capsule.
            let mut best = touch(&cloud.contact(pair, around, self.radius, state));
            let limit = best.distance;
            cloud.for_each_contact(pair, around, self.radius, state, limit, &mut |found| {
                let next = touch(found);
                if next.distance < best.distance {
                    best = next;
                }
            });
            return visit(&best);
        }
        let reach = asked.reach();
        cloud.for_each_contact(pair, around, self.radius, state, reach, &mut |found| {
            let contact = touch(found);
            if contact.distance < reach {
                visit(&contact);
            }
        });
    }
}

/// The same of a convex core and this radius \[m\], at the origin; `place` says where a contact is in the world.
fn visit_convex(
    core: &impl ConvexCore,
    hull: &PlacedHull<'_, 3>,
    radius: f64,
    asked: Asked,
    place: impl Fn(&HullContact) -> Contact<3>,
    visit: &mut dyn FnMut(&Contact<3>),
) {
    let found = core.meet(hull, asked);
    let contact = place(&found);
    let reach = asked.reach();
    if asked != Asked::Nearest && contact.distance >= reach {
        return;
    }
    let is_apart = contact.distance + radius > TOUCHING;
    if !matches!(asked, Asked::Barriers(_)) || !is_apart || core.features().is_none() {
        return visit(&contact);
    }
    let mut rows = KSmallest::<_, MAX_FEATURES>::new(contact);
    core.for_each_row(hull, &found.nearest, reach + radius, |found, of_cores| {
        let distance = of_cores - radius;
        rows.add(distance, Contact { distance, ..place(found) });
    });
    rows.for_each(visit);
}

#[cfg(test)]
mod tests {
    use super::super::oracle::*;
    use super::super::{Obstacle, Shape, World};
    use super::*;
    use crate::geometry::Hull;
    use crate::math::{Feature, UnitQuaternion};
    use crate::world::within::tests::is_what_asking_all_says;
    use crate::world::{CollisionQuery, Motion};
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    /// A hull somewhere, with the points that it was made of where they are.
    #[derive(Debug, Clone)]
    struct Link {
        hull: Hull,
        rotation: Matrix3<f64>,
        position: Vector<3>,
        points: Vec<[f64; 3]>,
    }

    impl Link {
        fn placed_hull(&self) -> PlacedHull<'_, 3> {
            PlacedHull { hull: &self.hull, rotation: &self.rotation, position: self.position }
        }

        fn body(&self) -> Body<'_, 3> {
            let around = self.hull.enclosing();
            let start = self.position + self.rotation * around.start;
            let direction = self.rotation * around.direction;
            let shape = Probe { start, direction, ..around };
            Body { hull: Some(self.placed_hull()), ..Body::new(0, shape) }
        }

        fn moved(&self, by: Vector<3>) -> Self {
            Self { position: self.position + by, ..self.clone() }
        }

        /// How far it comes against this direction.
        fn rear(&self, direction: &Vector<3>) -> f64 {
            let placed = |p: &[f64; 3]| self.position + self.rotation * Vector::from(*p);
            let along = self.points.iter().map(|p| direction.dot(&placed(p)));
            along.fold(f64::INFINITY, f64::min)
        }
    }

    fn any_carried() -> impl Strategy<Value = Link> {
        (any_hull(), any_orientation(), three(1.5)).prop_map(|(shape, orientation, position)| {
            let Shape::Convex { vertices: points } = shape else { unreachable!("a hull") };
            let turn = UnitQuaternion::new(orientation).unwrap_or_default();
            let hull = Hull::new(&points).unwrap();
            Link { hull, rotation: turn.matrix(), position, points }
        })
    }

    fn touch(link: &Link, obstacle: &Obstacle) -> Contact<3> {
        World::new(vec![obstacle.clone()]).contact(0, &link.body(), 0)
    }

    fn rows(link: &Link, world: &mut World, reach: f64) -> Vec<Contact<3>> {
        let mut found = vec![];
        world.for_each_barrier([link.body()], reach, |row| found.push(*row));
        found
    }

    /// Its faces, edges or corners may lie along something.
    fn any_solid() -> impl Strategy<Value = Obstacle> {
        any_obstacle()
    }

    properties! {
        #![proptest_config(ProptestConfig { max_global_rejects: 20_000, ..ProptestConfig::with_cases(2000) })]

        #[test]
        fn hulls_are_measured_within_a_limit(
            link in any_carried(), obstacles in prop::collection::vec(any_obstacle(), 0..6), limit in -0.5..2.0,
        ) {
            is_what_asking_all_says(&obstacles, &link.body(), limit);
        }

        /// Apart, two points prove that the distance is no larger, and two planes that it is no smaller: what lies on the bodies
        /// and how far they reach along the normal is known from the points that they are made of alone.
        #[test]
        fn distance_proves_itself(link in any_carried(), obstacle in any_solid(), depth in prop_oneof![Just(None), (0.0..0.6).prop_map(Some)]) {
            let radius = core_radius(&obstacle.shape);
            let before = touch(&link, &obstacle);
            // However it was, also pushed into the other.
            let way = depth.map_or(0.0, |depth| before.distance + radius + depth);
            let link = link.moved(before.normal * -way);
            let found = touch(&link, &obstacle);
            let cores = found.distance + radius;
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14);
            let gap = link.rear(&found.normal) - support(&obstacle, &found.normal);
            if !matches!(obstacle.shape, Shape::Points { .. }) {
                // What the normal is known to is how far points are known over how far they are apart.
                let size = link.hull.reach() + link.position.norm() + SpatialGeometry::new(&obstacle).reach();
                let turned = if cores > 0.0 { f64::EPSILON * size * size / cores } else { 0.0 };
                prop_assert!((gap - cores).abs() < 1e-12 + turned, "{gap} is not {cores}: {found:?}");
            }
            if cores > 0.0 {
                let on_core = found.witness - found.normal * radius;
                prop_assert!(distance_to_core(&obstacle, &on_core) < 1e-12, "{found:?}");
                let seen = link.placed_hull().seen(&found.point);
                let highest = link.hull.faces.iter().map(|face| face.normal.dot(&seen) - face.offset);
                prop_assert!(highest.fold(f64::NEG_INFINITY, f64::max) < 1e-12, "{found:?}");
                prop_assert!((found.point - on_core - found.normal * cores).norm() < 1e-12);
            } else if !matches!(obstacle.shape, Shape::Points { .. }) {
                // The shortest way out: along no other direction is it shorter.
                for direction in directions(2000) {
                    let gap = link.rear(&direction) - support(&obstacle, &direction);
                    prop_assert!(gap <= cores + 1e-12, "{direction} {gap} {found:?}");
                }
            }
        }

        /// However large, small, long or thin the one is beside the other: points and planes prove the distance, to the digits
        /// that points so far apart have, and a capsule beside a hull is measured as well as the other way round.
        #[test]
        fn distances_hold_at_every_scale(
            link in any_carried(), obstacle in any_solid(), sizes in [-3.0..5.0, -3.0..5.0],
            thin in [three(1.5), three(1.5)], gap in -4.0..2.0, inward in prop::bool::weighted(0.2), swapped in prop::bool::ANY,
        ) {
            prop_assume!(!matches!(obstacle.shape, Shape::HalfSpace { .. }));
            let [own, other] = sizes.map(|size| f64::powf(10.0, size));
            let stretched = |scale: f64, thin: &Vec3| thin.map(|x| scale * f64::powf(10.0, x.min(0.0)));
            let (by, far) = (stretched(own, &thin[0]), stretched(other, &thin[1]));
            let points: Vec<[f64; 3]> =
                link.points.iter().map(|p| Vector::from(*p).component_mul(&by).into()).collect();
            let Ok(hull) = Hull::new(&points) else { return Ok(()) };
            let link = Link { hull, points, position: link.position * own, ..link };
            let along = |v: &[f64; 3]| -> [f64; 3] { Vector::from(*v).component_mul(&far).into() };
            let shape = match &obstacle.shape {
                Shape::Sphere { .. } => Shape::Sphere { radius: 0.0 },
                Shape::Capsule { a, b, .. } => Shape::Capsule { a: along(a), b: along(b), radius: 0.0 },
                Shape::Box { size } => Shape::Box { size: along(size) },
                Shape::Convex { vertices } => Shape::Convex { vertices: vertices.iter().map(along).collect() },
                shape => shape.clone(),
            };
            if let Shape::Convex { vertices } = &shape {
                prop_assume!(Hull::new(vertices).is_ok());
            }
            let obstacle = Obstacle { shape, ..obstacle };
            let extent = SpatialGeometry::new(&obstacle).reach();
            let before = touch(&link, &obstacle);
            let target = f64::powf(10.0, gap) * own.min(other) * if inward { -0.1 } else { 1.0 };
            let link = link.moved(before.normal * (target - before.distance));
            let found = touch(&link, &obstacle);
            let cores = found.distance;
            // What normals are known to is how far points are known over how far they are apart.
            let size = extent + link.hull.reach() + link.position.norm() + cores.abs();
            let rounding = 1e-14 * size;
            let close = rounding * (1.0 + size / cores.abs());
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14);
            let rear = link.rear(&found.normal) - support(&obstacle, &found.normal);
            prop_assert!((rear - cores).abs() < close, "{rear} is not {cores}: {found:?}");
            if cores <= 0.0 {
                for direction in directions(1000) {
                    let gap = link.rear(&direction) - support(&obstacle, &direction);
                    prop_assert!(gap <= cores + close, "{direction} {gap} {found:?}");
                }
                return Ok(());
            }
            let seen = link.placed_hull().seen(&found.point);
            let heights = link.hull.faces.iter().map(|face| face.normal.dot(&seen) - face.offset);
            let highest = heights.fold(f64::NEG_INFINITY, f64::max);
            prop_assert!(highest < rounding + link.hull.slack, "{highest} of {size}: {found:?}");
            prop_assert!((found.point - found.witness - found.normal * cores).norm() < rounding);
            let mut known = rounding;
            let beyond = match &obstacle.shape {
                Shape::Convex { vertices } => {
                    let local = rotation(&obstacle).inverse() * (found.witness - Vector::from(obstacle.position));
                    let hull = Hull::new(vertices).unwrap();
                    known += hull.slack;
                    hull.faces.iter().map(|face| face.normal.dot(&local) - face.offset).fold(0.0, f64::max)
                }
                _ => distance_to_core(&obstacle, &found.witness),
            };
            prop_assert!(beyond < known, "{beyond} {found:?}");
            if let (Shape::Capsule { a, b, .. }, true) = (&obstacle.shape, swapped) {
                let at = |end: &[f64; 3]| rotation(&obstacle) * Vector::from(*end) + Vector::from(obstacle.position);
                let vertices = (link.points.iter())
                    .map(|p| (link.position + link.rotation * Vector::from(*p)).into())
                    .collect::<Vec<_>>();
                let bar = Probe::new(at(a), at(b), 0.0);
                prop_assume!(Hull::new(&vertices).is_ok() && bar.length > 0.0);
                let other = contact(&bar, &fixed(Shape::Convex { vertices }, [0.0; 3]));
                prop_assert!((other.distance - cores).abs() < 10.0 * close, "{cores} {other:?}");
            }
        }

        /// A ball in a hull, which no edge comes near to, overlaps it.
        #[test]
        fn what_is_inside_overlaps(link in any_carried(), radius in 0.0..0.1) {
            let middle = link.points.iter().map(|p| Vector::from(*p)).sum::<Vector<3>>() / link.points.len() as f64;
            let centre = link.position + link.rotation * middle;
            for shape in [Shape::Sphere { radius }, Shape::Box { size: [0.01; 3] }] {
                let found = touch(&link, &fixed(shape, centre.into()));
                prop_assert!(found.distance < 0.0, "{found:?}");
            }
        }

        /// A capsule that is a link beside a hull that is an obstacle, and the other way round: the same distance, opposite
        /// normals.
        #[test]
        fn it_is_the_same_from_the_other_side(link in any_carried(), a in three(1.5), b in three(1.5), radius in 0.0..0.2) {
            prop_assume!((a - b).norm() > 0.05);
            let bar = fixed(Shape::Capsule { a: a.into(), b: b.into(), radius }, [0.0; 3]);
            let vertices = (link.points.iter())
                .map(|p| (link.position + link.rotation * Vector::from(*p)).into())
                .collect();
            let found = touch(&link, &bar);
            let other = contact(&Probe::new(a, b, radius), &fixed(Shape::Convex { vertices }, [0.0; 3]));
            prop_assert!((found.distance - other.distance).abs() < 1e-12, "{found:?} {other:?}");
            prop_assume!(found.distance + radius > 1e-3);
            let sin = match found.feature {
                Feature::Crossing { edge, .. } => found.axis.cross(&edge).norm(),
                _ => 1.0,
            };
            // Parallel things have several nearest pairs.
            prop_assume!(sin > 1e-3);
            prop_assert!((found.normal + other.normal).norm() < 1e-9, "{found:?} {other:?}");
        }

        /// The least of the rows is the distance; there are no more than announced, however many features there are.
        #[test]
        fn the_least_row_is_the_distance(link in any_carried(), obstacle in any_solid()) {
            let mut world = World::new(vec![obstacle.clone()]);
            let contact = world.contact(0, &link.body(), 0);
            let rows = rows(&link, &mut world, f64::INFINITY);
            prop_assert!(rows.len() <= world.hull_barrier_count());
            let least = rows.iter().map(|row| row.distance).fold(f64::INFINITY, f64::min);
            prop_assert!((least - contact.distance).abs() < 1e-11, "{least} {contact:?}");
            if let (Shape::Sphere { radius }, [row]) = (&obstacle.shape, &rows[..]) {
                // Its acceleration is that above a face, wherever it is.
                let is_apart = contact.distance + radius > 1e-9;
                prop_assert!(!is_apart || matches!(row.feature, Feature::LinkFace { .. }), "{row:?}");
            }
        }

        /// While it moves a little, every row that was near stays, with its distance and its normal.
        #[test]
        fn rows_do_not_jump(link in any_carried(), obstacle in any_solid(), along in direction()) {
            let mut world = World::new(vec![obstacle]);
            let step = 1e-5;
            let [before, after] = [0.0, step].map(|by| {
                let link = link.moved(along * by);
                (world.contact(0, &link.body(), 0), rows(&link, &mut world, f64::INFINITY))
            });
            prop_assume!(before.0.distance > 0.02 && after.0.distance > 0.02);
            for row in before.1.iter().filter(|row| row.distance < before.0.distance + 0.005) {
                let oblique = match row.feature {
                    Feature::Crossing { edge, .. } => row.axis.cross(&edge).norm_squared(),
                    _ => 1.0,
                };
                let same = |next: &&Contact<3>| {
                    (next.normal - row.normal).norm() < 1e-2
                        && (next.distance - row.distance).abs() < 100.0 * step / oblique
                };
                // Of many at the same distance some may be left out.
                prop_assert!(before.1.len() == MAX_FEATURES || after.1.iter().any(|next| same(&next)), "{row:?}");
            }
        }
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(150))]

        /// In a crowd, and asked for what is near alone, everything is what it is without one, to the last bit.
        #[test]
        fn a_crowd_changes_nothing(
            link in any_carried(), spread in prop::collection::vec((three(4.0), three(1.0), 0usize..3), 40..80), reach in 0.05..1.5,
        ) {
            let shapes = [
                Shape::Sphere { radius: 0.1 },
                Shape::Box { size: [0.1, 0.3, 0.2] },
                Shape::Capsule { a: [-0.1, 0.0, 0.1], b: [0.1, 0.0, 0.0], radius: 0.05 },
            ];
            let obstacle = |(position, velocity, kind): &(Vec3, Vec3, usize)| Obstacle {
                motion: Motion::Linear { velocity: (*velocity).into() },
                angular_velocity: if *kind == 1 { [0.3, -0.5, 1.0] } else { [0.0; 3] },
                ..fixed(shapes[*kind].clone(), (*position).into())
            };
            let all: Vec<Obstacle> = spread.iter().map(obstacle).collect();
            let mut world = World::new(all.clone());
            for t in [0.0, 0.3] {
                world.update(t);
                let mut expected = vec![];
                let mut least = f64::INFINITY;
                for (j, obstacle) in all.iter().enumerate() {
                    let mut alone = World::new(vec![obstacle.clone()]);
                    alone.update(t);
                    let contact = alone.contact(0, &link.body(), 0);
                    least = least.min(contact.distance);
                    if contact.distance < reach {
                        expected.push(Contact { obstacle: j, ..contact });
                    }
                }
                let (mut found, mut nearest) = (vec![], vec![]);
                let body = link.body();
                world.for_each_contact([body], reach, |_, d| nearest.push(d), |c| found.push(*c));
                prop_assert_eq!(&found, &expected);
                prop_assert_eq!(nearest[0].to_bits(), least.to_bits());
                // Later, and back.
                for contact in &expected {
                    let j = contact.obstacle;
                    let after = world.contact_after(0, &body, j, 0.0);
                    prop_assert!((after.distance - contact.distance).abs() < 1e-12);
                }
            }
        }
    }
}
