//! Links and spheres.

use crate::math::Feature;
use crate::world::space::Shape;
use crate::world::space::oracle::*;

#[test]
fn a_sphere_beside_and_beyond_a_link() {
    let link = capsule([0.0; 3], [2.0, 0.0, 0.0], 0.1);
    let sphere = |position| fixed(Shape::Sphere { radius: 0.5 }, position);

    let beside = contact(&link, &sphere([0.5, 1.2, 1.6]));
    assert!((beside.distance - 1.4).abs() < 1e-15);
    assert_near(beside.normal, vec3(0.0, -0.6, -0.8));
    assert_near(beside.point, vec3(0.5, 0.0, 0.0));
    assert_near(beside.witness, vec3(0.5, 0.9, 1.2));
    assert_eq!(beside.feature, Feature::Side { distance: 2.0 });

    let beyond = contact(&link, &sphere([5.0, 0.0, 4.0]));
    assert!((beyond.distance - 4.4).abs() < 1e-15);
    assert_near(beyond.normal, vec3(-0.6, 0.0, -0.8));
    assert_near(beyond.point, vec3(2.0, 0.0, 0.0));
    assert_near(beyond.witness, vec3(4.7, 0.0, 3.6));
    assert_eq!(beyond.feature, Feature::End { distance: 5.0 });
}

/// Across the axis, on which the radii are counted down: as far as the sphere and the link overlap.
#[test]
fn a_centre_on_the_axis_has_a_normal_across_it() {
    let link = capsule([0.0; 3], [1.0, 2.0, -2.0], 0.1);
    for along in [0.0, 1.2, 3.0] {
        let center = link.start + link.direction * along;
        let found = contact(&link, &fixed(Shape::Sphere { radius: 0.5 }, center.into()));
        assert!((found.distance + 0.6).abs() < 1e-15);
        assert!(found.normal.dot(&link.direction).abs() < 1e-15, "{found:?}");
        assert!((found.normal.norm() - 1.0).abs() < 1e-15);
        assert_near(found.point, center);
        assert_eq!(found.feature, Feature::Face);
    }
}
