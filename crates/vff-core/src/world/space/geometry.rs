//! What an obstacle in space is to a query: a core swept by a ball.

use super::Obstacle;
use super::contact::{axis_of, contact_of};
use super::hierarchy::Boxes;
use super::shape::{ConvexCore, Core, dispatch};
use crate::geometry::axis::{Probe, seen_from};
use crate::geometry::{Convex, MAX_FEATURES, PlacedHull};
use crate::math::rotation::NotARotation;
use crate::math::{Capsule, UnitQuaternion, Vector};
use crate::world::curve::Curve;
use crate::world::{
    Ahead, Asked, Contact, Description, Interpolation, Motion, MotionState, ObstacleGeometry, Pair,
    Spin, Turn, Turning,
};
use std::collections::BTreeMap;

impl Description<3> for Obstacle {
    fn set_position(&mut self, position: Vector<3>) {
        self.position = position.into();
    }

    #[inline]
    fn position(&self) -> Vector<3> {
        Vector::from(self.position)
    }

    #[inline]
    fn motion(&self) -> &Motion<3> {
        &self.motion
    }

    fn turning(&self) -> Option<Turning<3>> {
        match &self.motion {
            Motion::Waypoints { times, orientations, interpolation, .. }
                if !orientations.is_empty() =>
            {
                let turn = |q: &[f64; 4]| UnitQuaternion::new(*q).unwrap_or_default();
                Some(match interpolation {
                    Interpolation::Smooth => {
                        // Validated: neighbours are not far apart.
                        let turns: Vec<_> = orientations.iter().map(turn).collect();
                        let curves = Curve::orientations(times, &turns).unwrap_or_default();
                        Turning::smooth(times, curves)
                    }
                    Interpolation::Linear => {
                        let way = |pair: &[[f64; 4]]| turn(&pair[1]) * turn(&pair[0]).inverse();
                        let steps = orientations.windows(2).map(|p| Spin::spatial(&way(p).log()));
                        Turning::through(times, steps)
                    }
                })
            }
            _ => Turning::steady(Spin::spatial(&self.angular_velocity.into())),
        }
    }

    fn turned(&self, orientation: &[f64], rate: &[f64]) -> Result<Turn<3>, NotARotation> {
        let [w, x, y, z] = orientation else { panic!("an orientation of {orientation:?}") };
        let described = UnitQuaternion::new(self.orientation).unwrap_or_default();
        let rotation = (UnitQuaternion::new([*w, *x, *y, *z])? * described.inverse()).matrix();
        let spin = Spin::spatial(&Vector::from_column_slice(rate));
        Ok(Turn { rotation, spin, spin_rate: Spin::NONE })
    }

    fn set_motion(&mut self, motion: Motion<3>) {
        self.motion = motion;
    }

    fn ignored(&self) -> &[String] {
        &self.ignore
    }

    fn margin(&self) -> Option<f64> {
        self.margin
    }

    fn margins(&self) -> &BTreeMap<String, f64> {
        &self.margins
    }

    fn likelihood(&self) -> Option<f64> {
        self.likelihood
    }

    fn future(&self) -> Option<&str> {
        self.future.as_deref()
    }
}

/// An obstacle without its radius, and that radius: relative to its position, turned by its orientation.
#[derive(Debug, Clone)]
pub struct SpatialGeometry {
    pub(super) core: Core,
    /// To be subtracted from the distance to the core \[m\].
    pub(super) radius: f64,
}

impl ObstacleGeometry<3> for SpatialGeometry {
    type Obstacle = Obstacle;
    type Probe = Probe;
    type Hierarchy = Boxes;

    fn new(obstacle: &Obstacle) -> Self {
        let turn = UnitQuaternion::new(obstacle.orientation).unwrap_or_default();
        let (core, radius) = obstacle.shape.core(&turn);
        Self { core, radius }
    }

    #[inline]
    fn probe(link: &Capsule<3>) -> Probe {
        *link
    }

    #[inline]
    fn body(probe: &Probe) -> Capsule<3> {
        *probe
    }

    #[inline(always)]
    fn distance(&self, link: &Probe, state: &MotionState<3>) -> f64 {
        self.distance_below(link, state, f64::INFINITY)
    }

    #[inline(always)] // most links are too far from most obstacles for anything else
    fn distance_below(&self, link: &Probe, state: &MotionState<3>, limit: f64) -> f64 {
        let MotionState { position, elapsed, .. } = state;
        let limit = limit + (self.radius + link.radius);
        let distance = dispatch!(
            &self.core,
            shape => shape.distance_below(&seen_from(link, position), limit),
            cloud => cloud.distance(link, position, *elapsed, limit)
        );
        distance - self.radius - link.radius
    }

    #[inline(always)] // what nobody asks for is then not computed
    fn contact(&self, pair: Pair, link: &Probe, state: &MotionState<3>) -> Contact<3> {
        let axis = seen_from(link, &state.position);
        let nearest = dispatch!(
            &self.core,
            shape => shape.nearest(&axis),
            cloud => return cloud.contact(pair, link, self.radius, state)
        );
        contact_of(pair, &nearest, &axis_of(link), [self.radius, link.radius], state)
    }

    fn contacts(&self) -> usize {
        if let Core::Cloud(cloud) = &self.core { cloud.len().max(1) } else { 1 }
    }

    #[inline]
    fn for_each_contact(
        &self,
        pair: Pair,
        link: &Probe,
        state: &MotionState<3>,
        reach: f64,
        mut visit: impl FnMut(&Contact<3>),
    ) {
        if let Core::Cloud(cloud) = &self.core {
            return cloud.for_each_contact(pair, link, self.radius, state, reach, &mut visit);
        }
        let contact = self.contact(pair, link, state);
        if contact.distance < reach {
            visit(&contact);
        }
    }

    /// One with each ball; otherwise one of each end of the link, and one with each end, corner and edge of the core.
    fn barriers(&self) -> usize {
        dispatch!(
            &self.core,
            shape => shape.features().map_or(1, |features| 2 + features),
            cloud => cloud.len()
        )
    }

    #[inline]
    fn for_each_barrier(
        &self,
        contact: &Contact<3>,
        link: &Probe,
        state: &MotionState<3>,
        visit: impl FnMut(&Contact<3>),
    ) {
        self.visit_barriers(contact, link, state, visit);
    }

    fn for_each_needed(
        &self,
        pair: Pair,
        link: &Probe,
        state: &MotionState<3>,
        reach: f64,
        ahead: &Ahead<'_, 3>,
        mut visit: impl FnMut(&Contact<3>),
    ) {
        if let Core::Cloud(cloud) = &self.core {
            let visit = &mut visit;
            return cloud.for_each_needed(pair, link, self.radius, state, reach, ahead, visit);
        }
        self.for_each_contact(pair, link, state, reach, visit);
    }

    fn meet_hull(
        &self,
        pair: Pair,
        hull: &PlacedHull<'_, 3>,
        around: &Probe,
        state: &MotionState<3>,
        asked: Asked,
        visit: &mut dyn FnMut(&Contact<3>),
    ) {
        self.visit_hull(pair, hull, around, state, asked, visit);
    }

    fn at_least(
        &self,
        hull: Option<&PlacedHull<'_, 3>>,
        around: &Probe,
        state: &MotionState<3>,
        limit: f64,
        plane: &mut Vector<3>,
    ) -> f64 {
        self.at_least(hull, around, state, limit, plane)
    }

    fn hull_barriers(&self) -> usize {
        dispatch!(
            &self.core,
            shape => shape.features().map_or(1, |_| MAX_FEATURES),
            cloud => cloud.len()
        )
    }

    fn extent(&self) -> [Vector<3>; 2] {
        dispatch!(&self.core, shape => shape.extent(self.radius))
    }

    fn reach(&self) -> f64 {
        dispatch!(&self.core, shape => shape.reach()) + self.radius
    }

    fn speed(&self) -> f64 {
        if let Core::Cloud(cloud) = &self.core { cloud.speed() } else { 0.0 }
    }

    fn cast(
        &self,
        origin: &Vector<3>,
        direction: &Vector<3>,
        range: f64,
        elapsed: f64,
    ) -> Option<f64> {
        let radius = self.radius;
        dispatch!(
            &self.core,
            shape => shape.cast(origin, direction, radius, range),
            cloud => cloud.cast(origin, direction, radius, range, elapsed)
        )
        .filter(|end| *end <= range)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Shape;
    use super::super::oracle::*;
    use super::*;
    use crate::world::Feature;
    use proptest::prelude::*;

    properties! {
        #![proptest_config(ProptestConfig { max_global_rejects: 20_000, ..ProptestConfig::with_cases(1500) })]

        #[test]
        fn distance_agrees_with_a_search(link in any_link(), obstacle in any_obstacle()) {
            let found = contact(&link, &obstacle);
            let radius = core_radius(&obstacle.shape);
            let axis_distance = found.distance + link.radius + radius;
            let expected = searched_distance(&link, &obstacle);
            prop_assert!((axis_distance.max(0.0) - expected).abs() < 1e-12,
                "{axis_distance} is not {expected}: {found:?}");
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14);

            // The two points lie on the axis and on the core's surface, joined by the normal.
            let on_core = found.witness - found.normal * radius;
            let joint = found.witness + found.normal * (found.distance + link.radius);
            prop_assert!((found.point - joint).norm() < 1e-14);
            prop_assert!((link.clamp(&found.point) - found.point).norm() < 1e-14);
            prop_assert!(distance_to_core(&obstacle, &on_core) < 1e-13, "{found:?}");
            // (Behind an edge of a hull that is sharper than a right angle is its other side.)
            let sharp = matches!(obstacle.shape, Shape::Convex { .. }) && found.feature != Feature::Face;
            let inside = on_core - found.normal * 1e-9;
            prop_assert!(
                radius > 0.0 || sharp || distance_to_core(&obstacle, &inside) < 1e-13, "{found:?}"
            );
        }

        /// Asked alone, the distance is that of the contact, to the last bit.
        #[test]
        fn distance_is_that_of_the_contact(link in any_link(), obstacle in any_obstacle(), depth in 0.0..0.5) {
            let geometry = SpatialGeometry::new(&obstacle);
            let before = contact(&link, &obstacle);
            let way: f64 = before.distance + depth;
            for link in [link, translated(&link, &(before.normal * -way))] {
                let state = obstacle.motion().at(0.0, obstacle.position());
                let distance = geometry.distance(&link, &state);
                prop_assert_eq!(distance.to_bits(), contact(&link, &obstacle).distance.to_bits());
            }
        }

        #[test]
        fn penetration_is_the_shortest_way_out(
            link in any_link(), obstacle in any_obstacle(), depth in 0.0..0.5,
        ) {
            // Wherever the link was, push it into the core.
            let before = contact(&link, &obstacle);
            let radii = link.radius + core_radius(&obstacle.shape);
            let way: f64 = before.distance + radii + depth;
            let link = translated(&link, &(before.normal * -way));
            let found = contact(&link, &obstacle);
            let axis_distance = found.distance + radii;
            prop_assume!(axis_distance < 0.0);

            // Out along the normal, and exactly as far as promised.
            let out = |by: f64| translated(&link, &(found.normal * (by - axis_distance)));
            prop_assert!(searched_distance(&out(0.0), &obstacle) < 1e-12);
            prop_assert!((searched_distance(&out(0.1), &obstacle) - 0.1).abs() < 1e-12);

            // No other direction is shorter.
            for direction in directions(2000) {
                let rear = link.start.dot(&direction).min(link.end().dot(&direction));
                prop_assert!(rear - support(&obstacle, &direction) <= axis_distance + 1e-13);
            }
        }

        #[test]
        fn normal_is_the_gradient(link in any_link(), obstacle in any_obstacle(), depth in -0.5..0.3) {
            let before = contact(&link, &obstacle);
            let way: f64 = before.distance + depth;
            let link = translated(&link, &(before.normal * -way));
            let h = 1e-6;
            let found = contact(&link, &obstacle);
            for axis in [Vec3::x(), Vec3::y(), Vec3::z()] {
                let [before, after] = [-h, h]
                    .map(|step| contact(&translated(&link, &(axis * step)), &obstacle).distance);
                // Not across a change of the nearest features, where the gradient jumps.
                prop_assume!((before + after - 2.0 * found.distance).abs() < 1e-4 * h);
                let slope = (after - before) / (2.0 * h);
                prop_assert!((slope - found.normal.dot(&axis)).abs() < 1e-4,
                    "{slope} along {axis} is not the normal of {found:?}");
            }
        }

        #[test]
        fn distance_is_continuous_through_the_obstacle(
            link in any_link(), obstacle in any_obstacle(), along in direction(),
        ) {
            // A translation by δ cannot change it by more than δ, whatever happens on the way.
            let (length, steps) = (4.0, 200);
            let step = length / f64::from(steps);
            let distances = (0..=steps).map(|k| {
                let by = along * (f64::from(k) * step - 0.5 * length);
                contact(&translated(&link, &by), &obstacle).distance
            });
            let distances: Vec<f64> = distances.collect();
            for pair in distances.windows(2) {
                prop_assert!((pair[1] - pair[0]).abs() <= step + 1e-12);
            }
        }

        #[test]
        fn lattice_positions_are_exact(
            start in [0i8..7, 0i8..7, 0i8..7], way in [-3i8..4, -3i8..4, -3i8..4], kind in 0usize..5,
        ) {
            // Parallel, collinear, touching, sharing a corner: all that chance avoids.
            let start = start.map(|x| f64::from(x) - 3.0);
            let end = [0, 1, 2].map(|k| start[k] + f64::from(way[k]));
            let mut link = capsule(start, end, 0.0);
            if way == [0; 3] {
                link = Capsule { direction: Vec3::x(), ..link };
            }
            let shape = [
                Shape::Sphere { radius: 0.0 },
                Shape::Capsule { a: [-1.0, 0.0, 0.0], b: [1.0, 0.0, 0.0], radius: 0.0 },
                Shape::Box { size: [2.0, 2.0, 4.0] },
                Shape::HalfSpace { normal: [0.0, 0.0, 1.0] },
                Shape::Convex { vertices: tetrahedron().to_vec() },
            ][kind].clone();
            let obstacle = fixed(shape, [0.0; 3]);
            let expected = searched_distance(&link, &obstacle);
            let found = contact(&link, &obstacle);
            prop_assert!((found.distance.max(0.0) - expected).abs() < 1e-12, "{found:?}");
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14, "{found:?}");
            let out = translated(&link, &(found.normal * (0.1 - found.distance)));
            prop_assert!((searched_distance(&out, &obstacle) - 0.1).abs() < 1e-12, "{found:?}");
        }

        #[test]
        fn extents_hold_the_solid(obstacle in any_obstacle(), seed in 0u32..1000) {
            let [low, high] = SpatialGeometry::new(&obstacle).extent();
            let at_origin = Obstacle { position: [0.0; 3], ..obstacle.clone() };
            for direction in directions(50 + seed % 7) {
                let reach = support(&at_origin, &direction) + core_radius(&obstacle.shape);
                let most = direction.zip_zip_map(&low, &high, |d, low, high| (d * low).max(d * high)).sum();
                prop_assert!(reach <= most + 1e-12 || most.is_nan());
            }
            for k in 0..3 {
                let reach = |sign: f64| {
                    let mut direction = Vec3::zeros();
                    direction[k] = sign;
                    support(&at_origin, &direction) + core_radius(&obstacle.shape)
                };
                if high[k].is_finite() {
                    prop_assert!((reach(1.0) - high[k]).abs() < 1e-12);
                    prop_assert!((reach(-1.0) + low[k]).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn radii_are_subtracted() {
        let link = capsule([2.0, 0.0, 0.3], [3.0, 1.0, 0.5], 0.1);
        let bare = Capsule { radius: 0.0, ..link };
        let ends = |radius| Shape::Capsule { a: [0.0, 1.0, 0.2], b: [0.3, -1.0, 0.1], radius };
        let sphere = |radius| Shape::Sphere { radius };
        for (thin, thick) in [(ends(0.0), ends(0.2)), (sphere(0.0), sphere(0.2))] {
            let thin = contact(&bare, &fixed(thin, [0.1, 0.2, 0.3]));
            let thick = contact(&link, &fixed(thick, [0.1, 0.2, 0.3]));
            assert!((thick.distance - (thin.distance - 0.3)).abs() < 1e-15);
            assert_eq!(thick.normal, thin.normal);
            assert_eq!(thick.point, thin.point);
            assert_near(thick.witness, thin.witness + thin.normal * 0.2);
        }
    }

    /// On the lattice.
    fn tetrahedron() -> [[f64; 3]; 4] {
        [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]]
    }

    #[test]
    fn unusable_values_do_not_panic() {
        let shapes = [
            Shape::Sphere { radius: f64::NAN },
            Shape::Capsule { a: [0.0; 3], b: [0.0; 3], radius: 0.1 },
            Shape::Capsule { a: [f64::NAN; 3], b: [0.0; 3], radius: 0.1 },
            Shape::Box { size: [0.0, 1.0, 1.0] },
            Shape::Box { size: [f64::NAN, 1.0, -1.0] },
            Shape::Convex { vertices: vec![] },
            Shape::Convex { vertices: vec![[f64::NAN; 3]; 5] },
            Shape::Convex { vertices: tetrahedron().to_vec() },
            Shape::HalfSpace { normal: [0.0; 3] },
        ];
        for shape in shapes {
            for value in [0.0, 1e-200, 1e200, f64::INFINITY, f64::NAN] {
                let link = capsule([value, 0.0, 0.0], [1.0, value, 0.0], 0.1);
                contact(&link, &fixed(shape.clone(), [0.0; 3]));
                let orientation = [value; 4];
                let obstacle = Obstacle { orientation, ..fixed(shape.clone(), [value; 3]) };
                contact(&capsule([0.0; 3], [1.0; 3], 0.1), &obstacle);
            }
        }
    }

    #[test]
    fn undefined_links_have_undefined_distances() {
        let whole = Vec3::new(0.2, 0.3, 0.4);
        let parts = [
            capsule([f64::NAN, 0.0, 0.0], [1.0, f64::NAN, 0.0], 0.1),
            Capsule { start: whole, direction: Vec3::repeat(f64::NAN), length: 1.0, radius: 0.1 },
        ];
        for link in parts {
            for shape in [
                Shape::Sphere { radius: 0.1 },
                Shape::Capsule { a: [0.0; 3], b: [1.0; 3], radius: 0.1 },
                Shape::Box { size: [1.0; 3] },
                Shape::Convex { vertices: tetrahedron().to_vec() },
                Shape::HalfSpace { normal: [0.0, 0.0, 1.0] },
            ] {
                let found = contact(&link, &fixed(shape.clone(), [0.0; 3]));
                assert!(found.distance.is_nan(), "{shape:?} {link:?}");
            }
        }
    }

    /// Nothing made of finite numbers is undefined, wherever things coincide.
    #[test]
    fn coincident_things_are_defined() {
        let link = capsule([0.0; 3], [1.0, 0.0, 0.0], 0.1);
        let ball = Capsule { length: 0.0, ..link };
        for shape in [
            Shape::Sphere { radius: 0.1 },
            Shape::Capsule { a: [0.0; 3], b: [1.0, 0.0, 0.0], radius: 0.1 },
            Shape::Capsule { a: [0.0, -1.0, 0.0], b: [0.0, 1.0, 0.0], radius: 0.1 },
            Shape::Capsule { a: [0.5, -1.0, 0.0], b: [0.5, 1.0, 0.0], radius: 0.1 },
            Shape::Capsule { a: [0.0; 3], b: [0.0; 3], radius: 0.1 },
            Shape::Box { size: [2.0, 2.0, 2.0] },
            Shape::Box { size: [1.0, 1.0, 1e-12] },
            Shape::Convex { vertices: tetrahedron().to_vec() },
            Shape::HalfSpace { normal: [0.0, 1.0, 0.0] },
        ] {
            for link in [link, ball] {
                let obstacle = fixed(shape.clone(), [0.0; 3]);
                let found = contact(&link, &obstacle);
                assert!((found.normal.norm() - 1.0).abs() < 1e-14, "{found:?}");
                assert!(!format!("{found:?}").contains("NaN"), "{found:?}");
                let radii = link.radius + core_radius(&shape);
                let out = translated(&link, &(found.normal * -(found.distance + radii)));
                assert!(searched_distance(&out, &obstacle) < 1e-15, "{found:?}");
            }
        }
    }
}
