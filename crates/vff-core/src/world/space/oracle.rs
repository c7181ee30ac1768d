//! For the tests of this directory: an independent oracle, and what they draw at random.
//!
//! The oracle knows how far a point is from a core and how far a core reaches in a direction. The distance of an axis is
//! the least along it, by search (it is a convex function of the position on it).

use super::{Obstacle, Shape, World};
use crate::math::{Body, Capsule, Vector};
use crate::world::oracle::least;
use crate::world::{Contact, Motion};
use nalgebra::{Quaternion, Rotation3, UnitQuaternion};
use proptest::prelude::*;

pub(super) type Vec3 = Vector<3>;

pub(super) fn vec3(x: f64, y: f64, z: f64) -> Vec3 {
    Vec3::new(x, y, z)
}

/// The rotation of an obstacle, by nalgebra's own quaternions.
pub(super) fn rotation(obstacle: &Obstacle) -> Rotation3<f64> {
    let [w, x, y, z] = obstacle.orientation;
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix()
}

pub(super) fn core_radius(shape: &Shape) -> f64 {
    match shape {
        Shape::Sphere { radius } | Shape::Capsule { radius, .. } => *radius,
        Shape::Box { .. } | Shape::Convex { .. } | Shape::HalfSpace { .. } => 0.0,
    }
}

/// Distance from `point` to the core, zero inside.
pub(super) fn distance_to_core(obstacle: &Obstacle, point: &Vec3) -> f64 {
    let p = rotation(obstacle).inverse() * (point - Vec3::from(obstacle.position));
    match &obstacle.shape {
        Shape::Sphere { .. } => p.norm(),
        Shape::Capsule { a, b, .. } => {
            let (a, ab) = (Vec3::from(*a), Vec3::from(*b) - Vec3::from(*a));
            let s = (p - a).dot(&ab) / ab.norm_squared().max(f64::MIN_POSITIVE);
            (p - a - ab * s.clamp(0.0, 1.0)).norm()
        }
        Shape::Box { size } => {
            let half = Vec3::from(*size) * 0.5;
            (p.abs() - half).sup(&Vec3::zeros()).norm()
        }
        Shape::Convex { vertices } => distance_to_hull(vertices, &p),
        Shape::HalfSpace { normal } => p.dot(&Vec3::from(*normal)).max(0.0),
    }
}

/// Distance from `point` to the hull of `points`, zero inside: Wolfe's way to the point of least norm, over sets of at most
/// four points that span it.
fn distance_to_hull(points: &[[f64; 3]], point: &Vec3) -> f64 {
    let points: Vec<Vec3> = points.iter().map(|p| Vec3::from(*p) - point).collect();
    let scale = points.iter().map(|p| p.norm_squared()).fold(0.0, f64::max);
    let nearest = |x: &Vec3| {
        points.iter().copied().min_by(|a, b| a.dot(x).total_cmp(&b.dot(x))).expect("a point")
    };
    let mut set = vec![points[0]];
    let mut weights = vec![1.0];
    let mut x = points[0];
    for _ in 0..500 {
        let next = nearest(&x);
        if x.norm_squared() - x.dot(&next) <= 1e-15 * scale || set.contains(&next) {
            break;
        }
        set.push(next);
        weights.push(0.0);
        loop {
            if set.len() == 1 {
                weights = vec![1.0];
                break;
            }
            // The point of least norm of the plane through the set.
            let first = set[0];
            let along =
                nalgebra::DMatrix::from_fn(3, set.len() - 1, |i, k| set[k + 1][i] - first[i]);
            let Ok(rest) = along.svd(true, true).solve(&-first, 1e-13) else { break };
            let free: Vec<f64> =
                std::iter::once(1.0 - rest.sum()).chain(rest.iter().copied()).collect();
            if free.iter().all(|w| *w > 0.0) {
                weights = free;
                break;
            }
            let steps = weights.iter().zip(&free).filter(|(_, to)| **to <= 0.0);
            let step = steps.map(|(from, to)| from / (from - to)).fold(1.0, f64::min);
            weights =
                weights.iter().zip(&free).map(|(from, to)| from + step * (to - from)).collect();
            let kept: Vec<usize> = (0..set.len()).filter(|&k| weights[k] > 1e-13).collect();
            (set, weights) = kept.iter().map(|&k| (set[k], weights[k])).unzip();
        }
        x = set.iter().zip(&weights).map(|(p, w)| p * *w).sum();
    }
    x.norm()
}

/// The most that the core reaches along the unit vector `direction`.
pub(super) fn support(obstacle: &Obstacle, direction: &Vec3) -> f64 {
    let n = rotation(obstacle).inverse() * direction;
    let own = match &obstacle.shape {
        Shape::Sphere { .. } => 0.0,
        Shape::Capsule { a, b, .. } => n.dot(&Vec3::from(*a)).max(n.dot(&Vec3::from(*b))),
        Shape::Box { size } => 0.5 * n.abs().dot(&Vec3::from(*size)),
        Shape::Convex { vertices } => {
            vertices.iter().map(|v| n.dot(&Vec3::from(*v))).fold(f64::NEG_INFINITY, f64::max)
        }
        Shape::HalfSpace { normal } if (n - Vec3::from(*normal)).norm() < 1e-9 => 0.0,
        Shape::HalfSpace { .. } => f64::INFINITY,
    };
    own + direction.dot(&Vec3::from(obstacle.position))
}

/// The distance between axis and core, 0 where they overlap.
pub(super) fn searched_distance(link: &Capsule<3>, obstacle: &Obstacle) -> f64 {
    least(|s| distance_to_core(obstacle, &(link.start + (link.end() - link.start) * s)))
}

/// Directions that are spread evenly over the sphere (a Fibonacci lattice).
pub(super) fn directions(count: u32) -> impl Iterator<Item = Vec3> {
    (0..count).map(move |k| {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(count);
        let (sin, cos) = (f64::from(k) * 2.399_963_229_728_653).sin_cos();
        let r = (1.0 - z * z).sqrt();
        vec3(r * cos, r * sin, z)
    })
}

pub(super) fn translated(link: &Capsule<3>, by: &Vec3) -> Capsule<3> {
    Capsule { start: link.start + by, ..*link }
}

pub(super) fn fixed(shape: Shape, position: [f64; 3]) -> Obstacle {
    let orientation = [1.0, 0.0, 0.0, 0.0];
    let angular_velocity = [0.0; 3];
    Obstacle { shape, position, orientation, angular_velocity, motion: Motion::default() }
}

pub(super) fn contact(link: &Capsule<3>, obstacle: &Obstacle) -> Contact<3> {
    World::new(vec![obstacle.clone()]).contact(0, &Body::new(0, *link), 0)
}

pub(super) fn capsule(start: [f64; 3], end: [f64; 3], radius: f64) -> Capsule<3> {
    Capsule::new(start.into(), end.into(), radius)
}

pub(super) fn three(range: f64) -> impl Strategy<Value = Vec3> {
    [-range..range, -range..range, -range..range].prop_map(Vec3::from)
}

pub(super) fn direction() -> impl Strategy<Value = Vec3> {
    three(1.0).prop_filter_map("no direction", |v| v.try_normalize(0.1))
}

/// Capsules, and sometimes a ball.
pub(in crate::world) fn any_link() -> impl Strategy<Value = Capsule<3>> {
    let length = prop_oneof![5 => 0.05..3.0, 1 => Just(0.0)];
    (three(2.0), direction(), length, 0.0..0.3)
        .prop_map(|(start, direction, length, radius)| Capsule { start, direction, length, radius })
}

pub(super) fn any_orientation() -> impl Strategy<Value = [f64; 4]> {
    let turned = [-1.0..1.0, -1.0..1.0, -1.0..1.0, -1.0..1.0].prop_filter_map("none", |q| {
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        (norm > 0.1).then(|| q.map(|x| x / norm))
    });
    prop_oneof![4 => turned, 1 => Just([1.0, 0.0, 0.0, 0.0])]
}

/// Of every kind, numbered.
pub(super) fn any_shape() -> impl Strategy<Value = (usize, Shape)> {
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

/// Of points of which some lie within, in the same plane as others or on the same line.
pub(super) fn any_hull() -> impl Strategy<Value = Shape> {
    let anywhere = prop::collection::vec(three(0.7), 4..20);
    let lattice = prop::collection::vec([-1i8..2, -1i8..2, -1i8..2], 6..20).prop_map(|points| {
        points.into_iter().map(|p| Vec3::from(p.map(f64::from)) * 0.5).collect()
    });
    let prism = (3u32..9, 0.1..0.7, 0.05..0.7).prop_map(|(n, radius, half)| {
        let corner = |k: u32, z| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(n)).sin_cos();
            vec3(radius * cos, radius * sin, z)
        };
        (0..n).flat_map(|k| [corner(k, half), corner(k, -half)]).collect()
    });
    prop_oneof![2 => anywhere, 1 => lattice, 1 => prism].prop_filter_map(
        "flat",
        |points: Vec<Vec3>| {
            let vertices: Vec<_> = points.into_iter().map(Into::into).collect();
            super::check_hull(&vertices).is_ok().then_some(Shape::Convex { vertices })
        },
    )
}

pub(in crate::world) fn any_obstacle() -> impl Strategy<Value = Obstacle> {
    (any_shape(), three(1.0), any_orientation()).prop_map(|((_, shape), position, orientation)| {
        Obstacle { orientation, ..fixed(shape, position.into()) }
    })
}

#[track_caller]
pub(super) fn assert_near(a: Vec3, b: Vec3) {
    assert!((a - b).norm() < 1e-14, "{a} is not {b}");
}
