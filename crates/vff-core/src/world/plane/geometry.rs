//! What a planar obstacle is to a query: a core swept by a disc.

use super::axis::{Axis, Meets, Nearest, Probe};
use super::face::{Face, faces};
use super::hierarchy::Boxes;
use super::{Obstacle, Shape, Vec2, from_glam, shape, to_glam};
use crate::math::rotation::NotARotation;
use crate::math::{Capsule, Vector, sin_cos};
use crate::world::curve::Curve;
use crate::world::{
    Contact, Description, Feature, Interpolation, Motion, MotionState, ObstacleGeometry, Pair,
    Rotation, Spin, Turn, Turning,
};
use std::collections::BTreeMap;

impl Description<2> for Obstacle {
    #[inline]
    fn position(&self) -> Vector<2> {
        Vector::from(self.position)
    }

    fn set_position(&mut self, position: Vector<2>) {
        self.position = position.into();
    }

    #[inline]
    fn motion(&self) -> &Motion<2> {
        &self.motion
    }

    fn turning(&self) -> Option<Turning<2>> {
        match &self.motion {
            Motion::Waypoints { times, angles, interpolation, .. } if !angles.is_empty() => {
                Some(match interpolation {
                    Interpolation::Smooth => Turning::smooth(times, Curve::angles(times, angles)),
                    Interpolation::Linear => {
                        let steps = angles.windows(2).map(|pair| Spin::planar(pair[1] - pair[0]));
                        Turning::through(times, steps)
                    }
                })
            }
            _ => Turning::steady(Spin::planar(self.angular_velocity)),
        }
    }

    fn turned(&self, orientation: &[f64], rate: &[f64]) -> Result<Turn<2>, NotARotation> {
        let (sin, cos) = sin_cos(orientation[0] - self.angle);
        let rotation = Rotation::<2>::new(cos, -sin, sin, cos);
        Ok(Turn { rotation, spin: Spin::planar(rate[0]), spin_rate: Spin::NONE })
    }

    fn set_motion(&mut self, motion: Motion<2>) {
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

/// An obstacle without its radius, and that radius: relative to its position, turned by its angle.
#[derive(Debug, Clone)]
pub struct PlanarGeometry {
    pub(super) core: Core,
    /// To be subtracted from the distance to the core \[m\].
    pub(super) radius: f64,
    barriers: usize,
}

#[derive(Debug, Clone)]
pub(super) enum Core {
    Point(Vec2),
    /// With the normal to its right.
    Segment(Face),
    /// The edges of a convex polygon, counter-clockwise. Never empty.
    Convex(Vec<Face>),
}

impl ObstacleGeometry<2> for PlanarGeometry {
    type Obstacle = Obstacle;
    type Probe = Probe;
    type Hierarchy = Boxes;

    fn new(obstacle: &Obstacle) -> Self {
        let turn = Vec2::from_angle(obstacle.angle);
        let barriers = obstacle.shape.barriers();
        let convex = |vertices: &[[f64; 2]], radius| {
            let vertices: Vec<Vec2> =
                vertices.iter().map(|&vertex| turn.rotate(vertex.into())).collect();
            let faces = faces(&vertices);
            let core = match (&faces[..], &vertices[..]) {
                ([], _) => {
                    Core::Point(vertices.into_iter().find(|v| v.is_finite()).unwrap_or_default())
                }
                ([there, _back], [_, _]) => Core::Segment(*there),
                _ => Core::Convex(faces),
            };
            Self { core, radius, barriers }
        };
        match &obstacle.shape {
            Shape::Circle { radius } => {
                Self { core: Core::Point(Vec2::ZERO), radius: *radius, barriers }
            }
            Shape::Capsule { a, b, radius } => convex(&[*a, *b], *radius),
            Shape::Box { size: [w, h] } => {
                let (x, y) = (0.5 * w, 0.5 * h);
                convex(&[[-x, -y], [x, -y], [x, y], [-x, y]], 0.0)
            }
            Shape::Polygon { vertices } => convex(&shape::counter_clockwise(vertices), 0.0),
        }
    }

    #[inline]
    fn probe(link: &Capsule<2>) -> Probe {
        Probe { axis: Axis::new(link), radius: link.radius }
    }

    #[inline]
    fn body(Probe { axis, radius }: &Probe) -> Capsule<2> {
        Capsule {
            start: from_glam(axis.start),
            direction: from_glam(axis.forward),
            length: axis.length,
            radius: *radius,
        }
    }

    #[inline(always)] // most links are too far from most obstacles for anything else
    fn distance(&self, link: &Probe, state: &MotionState<2>) -> f64 {
        let axis = link.axis.seen_from(to_glam(state.position));
        let distance = match &self.core {
            Core::Point(point) => axis.distance_to_disc(*point),
            _ => self.nearest(axis).distance,
        };
        distance - self.radius - link.radius
    }

    #[inline]
    fn contact(&self, pair: Pair, link: &Probe, state: &MotionState<2>) -> Contact<2> {
        let nearest = self.nearest(link.axis.seen_from(to_glam(state.position)));
        self.contact_of(pair, &nearest, link, state)
    }

    fn barriers(&self) -> usize {
        self.barriers
    }

    /// One for a circle; for every other obstacle those of (T77).
    #[inline]
    fn for_each_barrier(
        &self,
        contact: &Contact<2>,
        link: &Probe,
        state: &MotionState<2>,
        visit: impl FnMut(&Contact<2>),
    ) {
        self.visit_barriers(contact, link, state, visit);
    }

    fn extent(&self) -> [Vector<2>; 2] {
        let [low, high] = match &self.core {
            Core::Point(point) => [*point; 2],
            Core::Segment(face) => {
                let (a, b) = (face.start, face.end());
                [a.min(b), a.max(b)]
            }
            Core::Convex(faces) => {
                faces.iter().fold([Vec2::INFINITY, Vec2::NEG_INFINITY], |[low, high], face| {
                    [low.min(face.start), high.max(face.start)]
                })
            }
        };
        [low - Vec2::splat(self.radius), high + Vec2::splat(self.radius)].map(from_glam)
    }

    fn reach(&self) -> f64 {
        let farthest = match &self.core {
            Core::Point(point) => point.length(),
            Core::Segment(face) => face.start.length().max(face.end().length()),
            Core::Convex(faces) => faces.iter().map(|face| face.start.length()).fold(0.0, f64::max),
        };
        farthest + self.radius
    }

    fn cast(
        &self,
        origin: &Vector<2>,
        direction: &Vector<2>,
        range: f64,
        _elapsed: f64,
    ) -> Option<f64> {
        self.meet_ray(to_glam(*origin), to_glam(*direction), range)
    }
}

impl PlanarGeometry {
    /// The nearest points of core and axis, both relative to the obstacle's position.
    #[inline]
    fn nearest(&self, axis: Axis) -> Nearest {
        match &self.core {
            Core::Point(point) => axis.to_disc(*point),
            Core::Segment(face) => axis.to_segment(face),
            Core::Convex(faces) => axis.to_convex(faces),
        }
    }

    /// The contact of a link at these points of its axis and the core.
    #[inline]
    pub(super) fn contact_of(
        &self,
        Pair { body, link, obstacle, margin }: Pair,
        nearest: &Nearest,
        Probe { axis, radius }: &Probe,
        state: &MotionState<2>,
    ) -> Contact<2> {
        let Nearest { distance, normal, point, meets } = *nearest;
        let point = to_glam(state.position) + point;
        Contact {
            body,
            link,
            obstacle,
            margin,
            distance: distance - self.radius - radius,
            normal: from_glam(normal),
            point: from_glam(point),
            axis: from_glam(axis.forward),
            witness: from_glam(point - normal * (distance - self.radius)),
            velocity: state.velocity,
            acceleration: state.acceleration,
            spin: Spin::NONE,
            feature: match meets {
                Meets::Side => Feature::Side { distance },
                Meets::End => Feature::End { distance },
                Meets::Face => Feature::Face,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Shape;
    use super::super::oracle::*;
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    properties! {
        #![proptest_config(ProptestConfig { max_global_rejects: 10_000, ..ProptestConfig::with_cases(1000) })]

        #[test]
        fn distance_agrees_with_a_search(link in any_link(), obstacle in any_obstacle()) {
            let corners = corners(&obstacle);
            let found = contact(&link, &obstacle);
            let radii = link.radius + core_radius(&obstacle.shape);
            let expected = searched_distance(&link, &corners);
            let axis_distance = found.distance + radii;
            prop_assert!((axis_distance.max(0.0) - expected).abs() < 1e-12,
                "{axis_distance} is not {expected}");
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14);

            // The two points lie on the axis and on the core's surface, joined by the normal.
            let on_core = found.witness - found.normal * core_radius(&obstacle.shape);
            let joint = found.witness + found.normal * (found.distance + link.radius);
            prop_assert!((found.point - joint).norm() < 1e-14);
            let axis = [link.start, link.end()];
            prop_assert!(distance_to_core(&axis, found.point) < 1e-13);
            prop_assert!(distance_to_core(&corners, on_core) < 1e-13);
        }

        #[test]
        fn penetration_is_the_shortest_way_out(
            link in any_link(), obstacle in any_obstacle(), depth in 0.0..0.5,
        ) {
            // Wherever the link was, push it into the core.
            let before = contact(&link, &obstacle);
            let corners = corners(&obstacle);
            let radii = link.radius + core_radius(&obstacle.shape);
            let way: f64 = before.distance + radii + depth;
            let link = translated(&link, before.normal * -way);
            let found = contact(&link, &obstacle);
            let axis_distance = found.distance + radii;
            prop_assume!(axis_distance < 0.0);

            // Out along the normal, and exactly as far as promised.
            let out = |by: f64| translated(&link, found.normal * (by - axis_distance));
            prop_assert!(searched_distance(&out(0.0), &corners) < 1e-12);
            prop_assert!((searched_distance(&out(0.1), &corners) - 0.1).abs() < 1e-12);

            // No other direction is shorter.
            for k in 0..360 {
                let direction = rotated(vec2(1.0, 0.0), TAU * f64::from(k) / 360.0);
                let rear = link.start.dot(&direction).min(link.end().dot(&direction));
                let front = corners.iter().map(|c| c.dot(&direction)).fold(f64::MIN, f64::max);
                prop_assert!(rear - front <= axis_distance + 1e-13);
            }
        }

        #[test]
        fn normal_is_the_gradient(link in any_link(), obstacle in any_obstacle()) {
            let h = 1e-6;
            let found = contact(&link, &obstacle);
            for axis in [vec2(1.0, 0.0), vec2(0.0, 1.0)] {
                let [before, after] = [-h, h]
                    .map(|step| contact(&translated(&link, axis * step), &obstacle).distance);
                // Not across a change of the nearest features, where the gradient jumps.
                prop_assume!((before + after - 2.0 * found.distance).abs() < 1e-4 * h);
                let slope = (after - before) / (2.0 * h);
                prop_assert!((slope - found.normal.dot(&axis)).abs() < 1e-4,
                    "{slope} along {axis} is not the normal of {found:?}");
            }
        }

        #[test]
        fn distance_is_continuous_through_the_obstacle(
            link in any_link(), obstacle in any_obstacle(), angle in 0.0..TAU,
        ) {
            // A translation by δ cannot change it by more than δ, whatever happens on the way.
            let (length, steps) = (4.0, 200);
            let step = length / f64::from(steps);
            let direction = rotated(vec2(1.0, 0.0), angle);
            let distances = (0..=steps).map(|k| {
                let by = direction * (f64::from(k) * step - 0.5 * length);
                contact(&translated(&link, by), &obstacle).distance
            });
            let distances: Vec<f64> = distances.collect();
            for pair in distances.windows(2) {
                prop_assert!((pair[1] - pair[0]).abs() <= step + 1e-12);
            }
        }

        #[test]
        fn radii_are_subtracted(link in any_link(), a in -1.0..1.0, radius in 0.0..0.5) {
            let ends = |radius| Shape::Capsule { a: [a, 0.0], b: [0.3, 0.5], radius };
            let disc = |radius| Shape::Circle { radius };
            let bare = Capsule { radius: 0.0, ..link };
            for (thin, thick) in [(ends(0.0), ends(radius)), (disc(0.0), disc(radius))] {
                let thin = contact(&bare, &fixed(thin, [0.2, 0.1], 0.4));
                let thick = contact(&link, &fixed(thick, [0.2, 0.1], 0.4));
                let expected = thin.distance - radius - link.radius;
                prop_assert!((thick.distance - expected).abs() < 1e-15);
                prop_assert_eq!(thick.normal, thin.normal);
                prop_assert_eq!(thick.point, thin.point);
                prop_assert!((thick.witness - thin.witness - thin.normal * radius).norm() < 1e-14);
            }
        }

        #[test]
        fn lattice_positions_are_exact(
            x in 0i8..7, y in 0i8..7, dx in -3i8..4, dy in -3i8..4, kind in 0usize..4,
        ) {
            // Parallel, collinear, touching, sharing a corner: all that chance avoids.
            prop_assume!((dx, dy) != (0, 0));
            let start = [f64::from(x) - 3.0, f64::from(y) - 3.0];
            let end = [start[0] + f64::from(dx), start[1] + f64::from(dy)];
            let link = capsule(start, end, 0.0);
            let shape = [
                Shape::Circle { radius: 0.0 },
                Shape::Capsule { a: [-1.0, 0.0], b: [1.0, 0.0], radius: 0.0 },
                Shape::Box { size: [2.0, 2.0] },
                Shape::Polygon { vertices: vec![[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]] },
            ][kind].clone();
            let obstacle = fixed(shape, [0.0, 0.0], 0.0);
            let expected = searched_distance(&link, &corners(&obstacle));
            let found = contact(&link, &obstacle);
            prop_assert!((found.distance.max(0.0) - expected).abs() < 1e-12, "{found:?}");
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14, "{found:?}");
        }
    }

    #[test]
    fn unusable_values_do_not_panic() {
        let shapes = [
            Shape::Circle { radius: f64::NAN },
            Shape::Capsule { a: [0.0; 2], b: [0.0; 2], radius: 0.1 },
            Shape::Box { size: [0.0, 1.0] },
            Shape::Box { size: [f64::NAN, 1.0] },
            Shape::Polygon { vertices: vec![] },
            Shape::Polygon { vertices: vec![[1.0, 1.0]; 3] },
        ];
        for shape in shapes {
            for value in [0.0, 1e-200, 1e200, f64::INFINITY, f64::NAN] {
                contact(
                    &capsule([value, 0.0], [1.0, value], 0.1),
                    &fixed(shape.clone(), [0.0; 2], 0.0),
                );
                contact(
                    &capsule([0.0, 0.0], [1.0, 1.0], 0.1),
                    &fixed(shape.clone(), [value; 2], value),
                );
            }
        }
    }

    #[test]
    fn undefined_links_have_undefined_distances() {
        let link = capsule([f64::NAN, 0.0], [1.0, f64::NAN], 0.1);
        for shape in [
            Shape::Circle { radius: 0.1 },
            Shape::Capsule { a: [0.0; 2], b: [1.0; 2], radius: 0.1 },
            Shape::Box { size: [1.0; 2] },
        ] {
            assert!(contact(&link, &fixed(shape, [0.0; 2], 0.0)).distance.is_nan());
        }
    }
}
