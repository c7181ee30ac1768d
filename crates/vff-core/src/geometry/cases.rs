//! For tests: links, directions and corners of hulls, at random.

use crate::math::{Capsule, Vector};
use proptest::prelude::*;

pub(crate) use super::directions;

pub(crate) type Vec3 = Vector<3>;

pub(crate) fn vec3(x: f64, y: f64, z: f64) -> Vec3 {
    Vec3::new(x, y, z)
}

pub(crate) fn capsule(start: [f64; 3], end: [f64; 3], radius: f64) -> Capsule<3> {
    Capsule::new(start.into(), end.into(), radius)
}

pub(crate) fn three(range: f64) -> impl Strategy<Value = Vec3> {
    [-range..range, -range..range, -range..range].prop_map(Vec3::from)
}

pub(crate) fn direction() -> impl Strategy<Value = Vec3> {
    three(1.0).prop_filter_map("no direction", |v| v.try_normalize(0.1))
}

/// Capsules, and sometimes a ball.
pub(crate) fn any_link() -> impl Strategy<Value = Capsule<3>> {
    let length = prop_oneof![5 => 0.05..3.0, 1 => Just(0.0)];
    (three(2.0), direction(), length, 0.0..0.3)
        .prop_map(|(start, direction, length, radius)| Capsule { start, direction, length, radius })
}

/// Of points of which some lie within, in the same plane as others or on the same line.
pub(crate) fn any_vertices() -> impl Strategy<Value = Vec<[f64; 3]>> {
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
            super::check_hull(&vertices).is_ok().then_some(vertices)
        },
    )
}

/// The corners of a box of this size around the origin.
pub(crate) fn corners_of([x, y, z]: [f64; 3]) -> Vec<[f64; 3]> {
    let signs = [-0.5, 0.5];
    let along = |x: f64| signs.map(|sign| sign * x);
    let mut corners = vec![];
    for x in along(x) {
        for y in along(y) {
            corners.extend(along(z).map(|z| [x, y, z]));
        }
    }
    corners
}
