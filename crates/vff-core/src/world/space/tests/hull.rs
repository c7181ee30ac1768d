//! Links and hulls.

use crate::geometry::{Body, Hull, Probe};
use crate::math::{Capsule, Feature};
use crate::world::space::oracle::*;
use crate::world::space::{Obstacle, Shape, World};
use crate::world::{CollisionQuery, Contact};
use proptest::prelude::*;

fn convex(vertices: &[[f64; 3]]) -> Shape {
    Shape::Convex { vertices: vertices.to_vec() }
}

fn rows(link: &Capsule<3>, obstacle: &Obstacle) -> Vec<Contact<3>> {
    let mut found = vec![];
    let mut world = World::new(vec![obstacle.clone()]);
    world.for_each_barrier([Body::new(0, *link)], f64::INFINITY, |row| found.push(*row));
    found.sort_by(|a, b| a.distance.total_cmp(&b.distance));
    found
}

properties! {
    #![proptest_config(ProptestConfig { max_global_rejects: 20_000, ..ProptestConfig::with_cases(3000) })]

    /// The hull of the corners of a box, and of points in its sides and inside, is the box: apart, in touch and
    /// overlapping.
    #[test]
    fn a_box_is_the_hull_of_its_corners(
        link in any_link(), size in [0.05..2.0, 0.05..2.0, 0.05..2.0], orientation in any_orientation(),
        within in prop::collection::vec(([-0.5..=0.5, -0.5..=0.5, -0.5..=0.5], 0usize..4), 0..6),
        depth in prop_oneof![Just(None), (-0.3..0.7).prop_map(Some)], seed in 0usize..8,
    ) {
        let mut vertices = corners_of(size);
        vertices.rotate_left(seed);
        for (mut point, side) in within {
            if side < 3 {
                point[side] = 0.5;
            }
            vertices.push([0, 1, 2].map(|k: usize| point[k] * size[k]));
        }
        let [cuboid, hull] = [Shape::Box { size }, convex(&vertices)]
            .map(|shape| Obstacle { orientation, ..fixed(shape, [0.3, -0.2, 0.1]) });
        let before = contact(&link, &cuboid);
        let way: f64 = depth.map_or(0.0, |depth| before.distance + link.radius + depth);
        let link = translated(&link, &(before.normal * -way));
        let (expected, found) = (contact(&link, &cuboid), contact(&link, &hull));
        prop_assert!((found.distance - expected.distance).abs() < 1e-12, "{found:?} {expected:?}");
        let axis_distance = expected.distance + link.radius;
        // Parallel things have several nearest pairs, and so have ways out that are as short.
        let ties = {
            let by = |way: Vec3| contact(&translated(&link, &(way * 1e-7)), &cuboid).distance;
            [Vec3::x(), Vec3::y(), Vec3::z()]
                .iter()
                .any(|way| (by(*way) + by(-way) - 2.0 * expected.distance).abs() > 1e-10)
        };
        if axis_distance.abs() > 1e-3 && !ties {
            prop_assert!((found.normal - expected.normal).norm() < 1e-12 / axis_distance.abs().min(1.0),
                "{found:?} {expected:?}");
            prop_assert_eq!(
                std::mem::discriminant(&found.feature), std::mem::discriminant(&expected.feature),
                "{:?} {:?}", found, expected
            );
        }
        prop_assume!(axis_distance > 1e-9);
        let (expected, found) = (rows(&link, &cuboid), rows(&link, &hull));
        prop_assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(&expected) {
            // Relief is 10 m per metre that a foot lies off, and feet are as oblique as the axes are.
            let far = expected.distance.max(1.0) * 1e-9;
            let close = if expected.distance < axis_distance + 0.1 { 1e-12 } else { far };
            let oblique = match expected.feature {
                Feature::Crossing { edge, .. } => link.direction.cross(&edge).norm_squared().min(1.0),
                _ => 1.0,
            };
            prop_assert!((found.distance - expected.distance).abs() < close / oblique, "{found:?} {expected:?}");
        }
        prop_assert!((found[0].distance - expected[0].distance).abs() < 1e-12);
    }

    /// Wherever the points are on their hull, those that are no corners do not count.
    #[test]
    fn points_within_do_not_count(
        shape in any_hull(), link in any_link(), weights in prop::collection::vec(prop::collection::vec(0.0..1.0, 20), 0..8),
    ) {
        let Shape::Convex { vertices } = &shape else { unreachable!() };
        let mean = |weights: &Vec<f64>| {
            let total: f64 = weights.iter().zip(vertices).map(|(w, _)| w).sum();
            let sum: Vec3 = weights.iter().zip(vertices).map(|(w, v)| Vec3::from(*v) * *w).sum();
            (sum / total).into()
        };
        let more: Vec<_> = vertices.iter().copied().chain(weights.iter().map(mean)).rev().collect();
        let [few, many] = [shape.clone(), convex(&more)].map(|shape| fixed(shape, [0.1, 0.2, 0.3]));
        let (few, many) = (contact(&link, &few), contact(&link, &many));
        prop_assert!((few.distance - many.distance).abs() < 1e-12, "{few:?} {many:?}");
    }

    /// Almost along an edge or a side, close by.
    #[test]
    fn nearly_parallel_axes_are_exact(
        shape in any_hull(), edge in 0usize..1000, tilt in three(1.0), exponent in -18.0..0.0, gap in -12.0..0.0,
        length in 0.1..3.0, along in -1.0..1.0,
    ) {
        let Shape::Convex { vertices } = &shape else { unreachable!() };
        let hull = Hull::new(vertices).unwrap();
        let edge = &hull.edges[edge % hull.edges.len()];
        let out = -(edge.into[0] + edge.into[1]).normalize();
        prop_assume!(out.norm().is_finite());
        let direction = (edge.line.direction + tilt * f64::powf(10.0, exponent)).normalize();
        let start = edge.line.start + out * f64::powf(10.0, gap) + edge.line.direction * along;
        let link = Probe { start, direction, length, radius: 0.0 };
        let obstacle = fixed(shape, [0.0; 3]);
        let found = contact(&link, &obstacle);
        let expected = searched_distance(&link, &obstacle);
        prop_assert!((found.distance.max(0.0) - expected).abs() < 1e-12, "{found:?} is not {expected}");
        prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14);
    }
}

#[test]
fn what_meets_what() {
    let obstacle = fixed(convex(&corners_of([2.0; 3])), [0.0; 3]);
    let meets = |start, end| contact(&capsule(start, end, 0.0), &obstacle).feature;
    let is_along_z = |edge: Vec3| (edge.z.abs() - 1.0).abs() < 1e-15;
    let root = 2f64.sqrt();
    assert_eq!(meets([2.0, 0.0, 0.3], [3.0, 0.1, 0.5]), Feature::Face);
    let found = meets([2.0, 2.0, 0.3], [3.0, 4.0, 0.5]);
    assert!(
        matches!(found, Feature::Edge { edge, distance } if is_along_z(edge) && (distance - root).abs() < 1e-15)
    );
    let found = meets([1.0, 3.0, 0.3], [3.0, 1.0, 0.5]);
    assert!(
        matches!(found, Feature::Crossing { edge, distance } if is_along_z(edge) && (distance - root).abs() < 1e-15)
    );
    assert_eq!(meets([2.0, 2.0, 2.0], [3.0, 4.0, 5.0]), Feature::End { distance: 3f64.sqrt() });
    assert!(matches!(meets([0.0, 2.5, 2.0], [4.0, 1.5, 2.0]), Feature::Side { .. }));
    // Through the box close to an edge: out across it.
    let found = meets([0.3, 1.5, 0.3], [1.5, 0.3, 0.4]);
    assert!(
        matches!(found, Feature::Crossing { distance, .. } if (distance + 0.1 * root).abs() < 1e-14)
    );
}
