//! For the tests of this directory: an independent oracle, and what they draw at random.
//!
//! The oracle knows how far a point is from a core and how far a core reaches in a direction. The distance of an axis is
//! the least along it, by search (it is a convex function of the position on it).

use super::{Obstacle, Shape, World};
use crate::geometry::Body;
pub(crate) use crate::geometry::cases::*;
use crate::math::Capsule;
use crate::world::Contact;
use crate::world::oracle::least;
use nalgebra::{Quaternion, Rotation3, UnitQuaternion};
use proptest::prelude::*;

/// The rotation of an obstacle, by nalgebra's own quaternions.
pub(crate) fn rotation(obstacle: &Obstacle) -> Rotation3<f64> {
    let [w, x, y, z] = obstacle.orientation;
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix()
}

pub(crate) fn core_radius(shape: &Shape) -> f64 {
    match shape {
        Shape::Sphere { radius } | Shape::Capsule { radius, .. } | Shape::Points { radius, .. } => {
            *radius
        }
        Shape::Box { .. } | Shape::Convex { .. } | Shape::HalfSpace { .. } => 0.0,
    }
}

/// Distance from `point` to the core, zero inside.
pub(crate) fn distance_to_core(obstacle: &Obstacle, point: &Vec3) -> f64 {
    core_distance(obstacle)(point)
}

/// Distances from points to the core, zero inside.
fn core_distance(obstacle: &Obstacle) -> impl Fn(&Vec3) -> f64 {
    let sides = match &obstacle.shape {
        Shape::Convex { vertices } => supporting_triangles(vertices),
        _ => Vec::new(),
    };
    move |point| {
        let p = rotation(obstacle).inverse() * (point - Vec3::from(obstacle.position));
        match &obstacle.shape {
            Shape::Sphere { .. } => p.norm(),
            Shape::Capsule { a, b, .. } => {
                distance_to_segment([Vec3::from(*a), Vec3::from(*b)], &p)
            }
            Shape::Box { size } => {
                let half = Vec3::from(*size) * 0.5;
                (p.abs() - half).sup(&Vec3::zeros()).norm()
            }
            Shape::Convex { .. } => distance_within(&sides, &p),
            Shape::HalfSpace { normal } => p.dot(&Vec3::from(*normal)).max(0.0),
            Shape::Points { points, .. } => {
                points.iter().map(|q| (p - Vec3::from(*q)).norm()).fold(f64::INFINITY, f64::min)
            }
        }
    }
}

fn distance_to_segment([a, b]: [Vec3; 2], p: &Vec3) -> f64 {
    let ab = b - a;
    let s = (p - a).dot(&ab) / ab.norm_squared().max(f64::MIN_POSITIVE);
    (p - a - ab * s.clamp(0.0, 1.0)).norm()
}

/// Every three of the points that no other point is above, counter-clockwise seen from outside: together they cover the
/// surface of the hull, many times where more than three points lie in a plane.
fn supporting_triangles(points: &[[f64; 3]]) -> Vec<[Vec3; 3]> {
    let mut sides = Vec::new();
    let count = points.len();
    for i in 0..count {
        for j in 0..i {
            for k in 0..j {
                let [a, b, c] = [i, j, k].map(|i| Vec3::from(points[i]));
                for [a, b, c] in [[a, b, c], [a, c, b]] {
                    let out = (b - a).cross(&(c - a));
                    let is_above = |p: &[f64; 3]| out.dot(&(Vec3::from(*p) - a)) > 1e-15;
                    if out.norm() > 1e-9 && !points.iter().any(is_above) {
                        sides.push([a, b, c]);
                    }
                }
            }
        }
    }
    sides
}

/// Distance from a point to what these triangles enclose, zero inside.
fn distance_within(sides: &[[Vec3; 3]], p: &Vec3) -> f64 {
    let normal = |[a, b, c]: &[Vec3; 3]| (b - a).cross(&(c - a)).normalize();
    if sides.iter().all(|side| normal(side).dot(&(p - side[0])) <= 0.0) {
        return 0.0;
    }
    let distance = |side: &[Vec3; 3]| {
        let (out, [a, b, c]) = (normal(side), *side);
        let borders = [[a, b], [b, c], [c, a]];
        if borders.iter().all(|[a, b]| (b - a).cross(&(p - a)).dot(&out) >= 0.0) {
            return out.dot(&(p - a)).abs();
        }
        borders.iter().map(|border| distance_to_segment(*border, p)).fold(f64::INFINITY, f64::min)
    };
    sides.iter().map(distance).fold(f64::INFINITY, f64::min)
}

/// The most that the core reaches along the unit vector `direction`.
pub(crate) fn support(obstacle: &Obstacle, direction: &Vec3) -> f64 {
    let n = rotation(obstacle).inverse() * direction;
    let own = match &obstacle.shape {
        Shape::Sphere { .. } => 0.0,
        Shape::Capsule { a, b, .. } => n.dot(&Vec3::from(*a)).max(n.dot(&Vec3::from(*b))),
        Shape::Box { size } => 0.5 * n.abs().dot(&Vec3::from(*size)),
        Shape::Convex { vertices } | Shape::Points { points: vertices, .. } => {
            vertices.iter().map(|v| n.dot(&Vec3::from(*v))).fold(f64::NEG_INFINITY, f64::max)
        }
        Shape::HalfSpace { normal } if (n - Vec3::from(*normal)).norm() < 1e-9 => 0.0,
        Shape::HalfSpace { .. } => f64::INFINITY,
    };
    own + direction.dot(&Vec3::from(obstacle.position))
}

/// The distance between axis and core, 0 where they overlap.
pub(crate) fn searched_distance(link: &Capsule<3>, obstacle: &Obstacle) -> f64 {
    let distance = core_distance(obstacle);
    least(|s| distance(&(link.start + (link.end() - link.start) * s)))
}

pub(crate) fn translated(link: &Capsule<3>, by: &Vec3) -> Capsule<3> {
    Capsule { start: link.start + by, ..*link }
}

pub(crate) fn fixed(shape: Shape, position: [f64; 3]) -> Obstacle {
    Obstacle { position, ..Obstacle::of(shape) }
}

pub(crate) fn contact(link: &Capsule<3>, obstacle: &Obstacle) -> Contact<3> {
    World::new(vec![obstacle.clone()]).contact(0, &Body::new(0, *link), 0)
}

pub(crate) fn any_orientation() -> impl Strategy<Value = [f64; 4]> {
    let turned = [-1.0..1.0, -1.0..1.0, -1.0..1.0, -1.0..1.0].prop_filter_map("none", |q| {
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        (norm > 0.1).then(|| q.map(|x| x / norm))
    });
    prop_oneof![4 => turned, 1 => Just([1.0, 0.0, 0.0, 0.0])]
}

/// Of every kind, numbered.
pub(crate) fn any_shape() -> impl Strategy<Value = (usize, Shape)> {
    prop_oneof![
        (0.01..0.5).prop_map(|radius| (0, Shape::Sphere { radius })),
        (three(1.0), three(1.0), 0.0..0.4).prop_map(|(a, b, radius)| {
            (1, Shape::Capsule { a: a.into(), b: b.into(), radius })
        }),
        [0.05..2.0, 0.05..2.0, 0.05..2.0].prop_map(|size| (2, Shape::Box { size })),
        direction().prop_map(|n| (3, Shape::HalfSpace { normal: n.into() })),
        any_hull().prop_map(|shape| (4, shape)),
    ]
}

pub(crate) fn any_hull() -> impl Strategy<Value = Shape> {
    any_vertices().prop_map(|vertices| Shape::Convex { vertices })
}

pub(crate) fn any_obstacle() -> impl Strategy<Value = Obstacle> {
    (any_shape(), three(1.0), any_orientation()).prop_map(|((_, shape), position, orientation)| {
        Obstacle { orientation, ..fixed(shape, position.into()) }
    })
}

#[track_caller]
pub(crate) fn assert_near(a: Vec3, b: Vec3) {
    assert!((a - b).norm() < 1e-14, "{a} is not {b}");
}
