//! How far a ray goes until it meets an obstacle.
//!
//! An outline consists of arcs and straight edges, for which parry's ray casts are closed forms.

use super::Vec2;
use super::face::Face;
use super::geometry::{Core, PlanarGeometry};
use parry2d_f64::query::{Ray, RayCast};
use parry2d_f64::shape::{Ball, Segment};

impl PlanarGeometry {
    /// From `origin`, relative to the obstacle, along the unit vector `direction`.
    pub(super) fn meet_ray(&self, origin: Vec2, direction: Vec2, range: f64) -> Option<f64> {
        let ray = &Ray::new(origin, direction);
        let ball = |centre: Vec2| {
            let seen = Ray::new(ray.origin - centre, ray.dir);
            Ball::new(self.radius).cast_local_ray(&seen, range, true)
        };
        let edge = |a: Vec2, b: Vec2| Segment::new(a, b).cast_local_ray(ray, range, true);
        let first = |a: Option<f64>, b: Option<f64>| [a, b].into_iter().flatten().reduce(f64::min);
        match &self.core {
            Core::Point(point) => ball(*point),
            Core::Segment(face) => {
                let (a, b) = (face.start, face.end());
                let height = face.height(ray.origin).abs();
                if height <= self.radius && face.is_below(ray.origin) && self.radius > 0.0 {
                    return Some(0.0);
                }
                let side = face.normal * self.radius;
                let sides = first(edge(a + side, b + side), edge(a - side, b - side));
                first(sides, first(ball(a), ball(b)))
            }
            Core::Convex(faces) => {
                if faces.iter().all(|face| face.height(ray.origin) <= 0.0) {
                    return Some(0.0);
                }
                let meet = |face: &Face| edge(face.start, face.end());
                faces.iter().filter_map(meet).reduce(f64::min)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::oracle::fixed;
    use super::super::{Obstacle, Shape, World};
    use crate::geometry::Body;
    use crate::math::{Capsule, Vector};
    use crate::world::Motion;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    fn world(shape: Shape, position: [f64; 2], angle: f64) -> World {
        World::new(vec![fixed(shape, position, angle)])
    }

    properties! {
        /// The nearer root of |o + s u − c|² = r².
        #[test]
        fn a_disc_in_closed_form(
            x in -3.0..3.0, y in -3.0..3.0, radius in 0.01..1.5, angle in 0.0..TAU, range in 0.1..6.0,
        ) {
            let direction = Vector::<2>::new(angle.cos(), angle.sin());
            let centre = Vector::<2>::new(x, y);
            let found = world(Shape::Circle { radius }, [x, y], 0.3)
                .cast(Vector::<2>::zeros(), direction, range);
            let along = centre.dot(&direction);
            let across = centre.norm_squared() - along * along;
            let reach = radius * radius - across;
            prop_assume!(reach.abs() > 1e-6 && (centre.norm() - radius).abs() > 1e-6);
            let expected = match reach > 0.0 {
                _ if centre.norm() < radius => Some(0.0),
                true if along > 0.0 => Some(along - reach.sqrt()),
                _ => None,
            };
            match (found, expected.filter(|s| *s <= range)) {
                (Some(found), Some(expected)) => prop_assert!((found - expected).abs() < 1e-9),
                (None, None) => {}
                // Exactly at the end of the range either may be right.
                (found, _) => prop_assert!((expected.unwrap() - range).abs() < 1e-9, "{found:?}"),
            }
        }

        /// Where a ray ends, the signed distance to the obstacle is 0, and before it is positive.
        #[test]
        fn a_ray_ends_on_the_surface(
            kind in 0..3, x in -2.0..2.0, y in -2.0..2.0, turn in 0.0..TAU, angle in 0.0..TAU,
        ) {
            let shape = match kind {
                0 => Shape::Capsule { a: [-0.4, 0.1], b: [0.5, 0.0], radius: 0.2 },
                1 => Shape::Box { size: [0.8, 0.4] },
                _ => Shape::Polygon { vertices: vec![[0.5, 0.0], [-0.2, 0.6], [-0.4, -0.5]] },
            };
            let world = world(shape, [x, y], turn);
            let direction = Vector::<2>::new(angle.cos(), angle.sin());
            let distance = |s: f64| {
                let tiny = Capsule::new(direction * s, direction * (s + 1e-9), 0.0);
                world.contact(0, &Body::new(0, tiny), 0).distance
            };
            match world.cast(Vector::<2>::zeros(), direction, 5.0) {
                Some(0.0) => prop_assert!(distance(0.0) < 1e-8),
                Some(end) => {
                    prop_assert!(distance(end).abs() < 1e-7, "{} at {end}", distance(end));
                    prop_assert!((0..50).all(|k| distance(end * f64::from(k) / 50.0) > 0.0));
                }
                None => prop_assert!((0..200).all(|k| distance(0.025 * f64::from(k)) > -1e-7)),
            }
        }
    }

    /// The nearest of several, where they are now.
    #[test]
    fn the_first_of_moving_obstacles() {
        let disc = |x: f64, speed: f64| Obstacle {
            position: [x, 0.0],
            motion: Motion::Linear { velocity: [speed, 0.0] },
            ..Obstacle::of(Shape::Circle { radius: 0.5 })
        };
        let mut world = World::new(vec![disc(3.0, 1.0), disc(6.0, -1.0)]);
        let east = Vector::<2>::new(1.0, 0.0);
        assert_eq!(world.cast(Vector::<2>::zeros(), east, 9.0), Some(2.5));
        world.update(2.5);
        assert_eq!(world.cast(Vector::<2>::zeros(), east, 9.0), Some(3.0));
        assert_eq!(world.cast(Vector::<2>::zeros(), east, 2.9), None);
        assert_eq!(world.cast(Vector::<2>::zeros(), -east, 9.0), None);
    }
}
