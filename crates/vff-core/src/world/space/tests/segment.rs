//! Links and capsules.

use crate::geometry::segment::to_segment;
use crate::math::{Capsule, Feature, nearest};
use crate::world::space::Shape;
use crate::world::space::oracle::*;
use parry3d_f64::{math::Pose, math::Vector as Vec3d, query, shape::Segment};
use proptest::prelude::*;

fn bar(a: Vec3, b: Vec3) -> Shape {
    Shape::Capsule { a: a.into(), b: b.into(), radius: 0.0 }
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    /// The closed form, parry's (not nearly parallel, where that errs), and that for two links of an arm.
    #[test]
    fn agrees_with_parry_and_with_two_links(link in any_link(), a in three(2.0), b in three(2.0)) {
        prop_assume!(link.length > 0.0 && (a - b).norm() > 0.05);
        let core = Capsule::new(a, b, 0.0);
        prop_assume!(link.direction.cross(&core.direction).norm() > 1e-3);
        let found = to_segment(&link, &core);
        let glam = |v: Vec3| Vec3d::new(v.x, v.y, v.z);
        let segment = |c: &Capsule<3>| Segment::new(glam(c.start), glam(c.end()));
        let parry = query::distance(&Pose::IDENTITY, &segment(&link), &Pose::IDENTITY, &segment(&core));
        prop_assert!((found.distance - parry.unwrap().distance).abs() < 1e-12);
        let links = nearest(&Capsule { radius: 0.0, ..link }, &core);
        prop_assert!((found.distance - links.distance).abs() < 1e-13);
        prop_assert!((found.point - links.points[0]).norm() < 1e-11);
        prop_assert!((found.normal - links.normal).norm() * found.distance < 1e-11);
    }

    /// At any angle down to none, near or far.
    #[test]
    fn nearly_parallel_segments_are_exact(
        exponent in -18.0..0.0, gap_exponent in -12.0..0.0, offset in -2.0..2.0, length in 0.01..2.0,
        height in -1.0..1.0,
    ) {
        let [angle, gap] = [exponent, gap_exponent].map(|e| f64::powf(10.0, e));
        let link = capsule([0.0; 3], [1.0, 0.0, 0.0], 0.0);
        let a = vec3(offset, height * gap, gap);
        let b = a + vec3(angle.cos(), angle.sin(), 0.0) * length;
        let obstacle = fixed(bar(a, b), [0.0; 3]);
        let found = contact(&link, &obstacle);
        let expected = searched_distance(&link, &obstacle);
        prop_assert!((found.distance - expected).abs() < 1e-14, "{found:?} is not {expected}");
        prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14);
    }

    /// Where axes nearly meet, the normal is still across both, and the distance keeps its digits.
    #[test]
    fn axes_that_nearly_meet(u in three(1.0), v in three(1.0), exponent in -18.0..-1.0) {
        prop_assume!(u.cross(&v).norm() > 0.1);
        let gap = f64::powf(10.0, exponent);
        let offset = u.cross(&v).normalize() * gap;
        let found = contact(&Capsule::new(offset - u, offset + u, 0.1), &fixed(bar(-v, v), [0.0; 3]));
        prop_assert!((found.distance - (gap - 0.1)).abs() < 1e-15);
        prop_assert!(found.normal.dot(&u).abs() < 1e-13 && found.normal.dot(&v).abs() < 1e-13);
        let crosses = matches!(found.feature, Feature::Crossing { .. });
        prop_assert!(crosses, "{found:?}");
    }
}

/// The end of a link 1 m from the crossing of two lines at 1e-8 rad: cut off there, its place is found again as 1e-16 m,
/// which is no place inside.
#[test]
fn an_end_is_no_crossing() {
    let angle = f64::powf(10.0, -7.960038290771744);
    let gap = f64::powf(10.0, -8.219651127087783);
    let a = vec3(-0.9807745080062812, -0.8545410255085492 * gap, gap);
    let b = a + vec3(angle.cos(), angle.sin(), 0.0) * 1.836620685241895;
    let link = capsule([0.0; 3], [1.0, 0.0, 0.0], 0.0);
    let found = contact(&link, &fixed(bar(a, b), [0.0; 3]));
    assert!((found.distance - 8.229438023569e-9).abs() < 1e-14, "{found:?}");
}

#[test]
fn what_meets_what() {
    let core = bar(vec3(-1.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0));
    let meets = |start, end| contact(&capsule(start, end, 0.0), &fixed(core.clone(), [0.0; 3]));
    let edge = vec3(1.0, 0.0, 0.0);
    let crossing = meets([0.5, -1.0, 2.0], [0.5, 1.0, 2.0]);
    assert_eq!(crossing.feature, Feature::Crossing { edge, distance: 2.0 });
    let end = meets([0.5, 0.0, 2.0], [0.7, 0.0, 3.0]);
    assert_eq!(end.feature, Feature::Edge { edge, distance: 2.0 });
    let side = meets([2.0, -1.0, 0.0], [2.0, 1.0, 0.0]);
    assert_eq!(side.feature, Feature::Side { distance: 1.0 });
    let beyond = meets([3.0, 0.0, 0.0], [4.0, 1.0, 0.0]);
    assert_eq!(beyond.feature, Feature::End { distance: 2.0 });
}
