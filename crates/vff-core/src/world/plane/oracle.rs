//! For the tests of this directory: an independent oracle, and what they draw at random.
//!
//! The oracle is the least distance from the axis to the core by searching along the axis (the distance to
//! a convex body is a convex function of the position on it).

use super::{Obstacle, Shape, World, shape};
use crate::geometry::Body;
use crate::math::{Capsule, Vector, perp};
use crate::world::Contact;
use crate::world::oracle::least;
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

pub(super) fn vec2(x: f64, y: f64) -> Vector<2> {
    Vector::<2>::new(x, y)
}

pub(super) fn rotated(v: Vector<2>, angle: f64) -> Vector<2> {
    v * angle.cos() + perp(v) * angle.sin()
}

/// Corners of the core in the world frame, counter-clockwise.
pub(super) fn corners(obstacle: &Obstacle) -> Vec<Vector<2>> {
    let local = match &obstacle.shape {
        Shape::Circle { .. } => vec![[0.0, 0.0]],
        Shape::Capsule { a, b, .. } => vec![*a, *b],
        Shape::Box { size: [w, h] } => [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
            .map(|[x, y]| [x * w, y * h])
            .to_vec(),
        Shape::Polygon { vertices } => shape::counter_clockwise(vertices),
    };
    local
        .into_iter()
        .map(|v| Vector::from(obstacle.position) + rotated(v.into(), obstacle.angle))
        .collect()
}

pub(super) fn core_radius(shape: &Shape) -> f64 {
    match shape {
        Shape::Circle { radius } | Shape::Capsule { radius, .. } => *radius,
        Shape::Box { .. } | Shape::Polygon { .. } => 0.0,
    }
}

/// Distance from `p` to the convex hull of `corners`, zero inside.
pub(super) fn distance_to_core(corners: &[Vector<2>], p: Vector<2>) -> f64 {
    let n = corners.len();
    let edges = || (0..n).map(|i| (corners[i], corners[(i + 1) % n]));
    if n > 2 && edges().all(|(a, b)| perp(b - a).dot(&(p - a)) >= 0.0) {
        return 0.0;
    }
    edges()
        .map(|(a, b)| {
            let ab = b - a;
            let s = (p - a).dot(&ab) / ab.norm_squared().max(f64::MIN_POSITIVE);
            (p - a - ab * s.clamp(0.0, 1.0)).norm()
        })
        .fold(f64::INFINITY, f64::min)
}

pub(super) fn searched_distance(link: &Capsule<2>, corners: &[Vector<2>]) -> f64 {
    least(|s| distance_to_core(corners, link.start + (link.end() - link.start) * s))
}

pub(super) fn translated(link: &Capsule<2>, by: Vector<2>) -> Capsule<2> {
    Capsule { start: link.start + by, ..*link }
}

pub(super) fn fixed(shape: Shape, position: [f64; 2], angle: f64) -> Obstacle {
    Obstacle { position, angle, ..Obstacle::of(shape) }
}

pub(super) fn contact(link: &Capsule<2>, obstacle: &Obstacle) -> Contact<2> {
    World::new(vec![obstacle.clone()]).contact(0, &Body::new(0, *link), 0)
}

pub(super) fn capsule(start: [f64; 2], end: [f64; 2], radius: f64) -> Capsule<2> {
    Capsule::new(start.into(), end.into(), radius)
}

pub(in crate::world) fn any_link() -> impl Strategy<Value = Capsule<2>> {
    (-2.0..2.0, -2.0..2.0, 0.05..3.0, 0.0..TAU, 0.0..0.3).prop_map(
        |(x, y, length, angle, radius)| {
            let end = vec2(x, y) + rotated(vec2(length, 0.0), angle);
            Capsule::new(vec2(x, y), end, radius)
        },
    )
}

pub(super) fn any_polygon() -> impl Strategy<Value = Shape> {
    (prop::collection::vec(0.0..0.9, 3..9), 0.1..1.5, 0.1..1.5, any::<bool>()).prop_map(
        |(jitter, width, height, clockwise)| {
            let n = jitter.len() as f64;
            let mut vertices: Vec<_> = jitter
                .iter()
                .enumerate()
                .map(|(k, jitter)| f64::sin_cos(TAU * (k as f64 + jitter) / n))
                .map(|(sin, cos)| [0.3 + width * cos, height * sin])
                .collect();
            if clockwise {
                vertices.reverse();
            }
            Shape::Polygon { vertices }
        },
    )
}

pub(in crate::world) fn any_obstacle() -> impl Strategy<Value = Obstacle> {
    let coordinate = || -1.0..1.0;
    let shape = prop_oneof![
        (0.0..0.5).prop_map(|radius| Shape::Circle { radius }),
        ([coordinate(), coordinate()], [coordinate(), coordinate()], 0.0..0.5)
            .prop_map(|(a, b, radius)| Shape::Capsule { a, b, radius }),
        [0.05..2.0, 0.05..2.0].prop_map(|size| Shape::Box { size }),
        any_polygon(),
    ];
    (shape, [coordinate(), coordinate()], -PI..PI)
        .prop_map(|(shape, position, angle)| fixed(shape, position, angle))
}

pub(super) fn assert_near(a: Vector<2>, b: Vector<2>) {
    assert!((a - b).norm() < 1e-14, "{a} is not {b}");
}
