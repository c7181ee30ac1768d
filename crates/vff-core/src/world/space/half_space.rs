//! An axis and a half-space through the obstacle's position.

use crate::geometry::axis::{Nearest, Probe};
use crate::math::Vector;
use crate::world::Feature;

/// Signed distance to the half-space with this outward unit `normal`: that of the lower end.
#[inline]
pub(super) fn to_half_space(axis: &Probe, normal: &Vector<3>) -> Nearest {
    let (start, end) = (axis.start, axis.end());
    let (at_start, at_end) = (normal.dot(&start), normal.dot(&end));
    // Where the end is undefined it is taken.
    let (distance, point) = if at_start <= at_end { (at_start, start) } else { (at_end, end) };
    Nearest { distance, normal: *normal, point, feature: Feature::Face }
}

#[cfg(test)]
mod tests {
    use super::super::oracle::*;
    use super::super::{Obstacle, Shape};

    #[test]
    fn a_link_above_through_and_below_a_tilted_wall() {
        let wall = Obstacle {
            // A quarter turn about x: the z axis becomes −y.
            orientation: [0.5f64.sqrt(), 0.5f64.sqrt(), 0.0, 0.0],
            ..fixed(Shape::HalfSpace { normal: [0.0, 0.0, 1.0] }, [5.0, 1.0, -7.0])
        };
        for (start, end, distance) in [(-2.0, -4.0, 2.9), (2.0, -1.0, -1.1), (3.0, 2.0, -2.1)] {
            let link = capsule([0.0, start, 0.0], [0.3, end, 0.0], 0.1);
            let found = contact(&link, &wall);
            assert!((found.distance - distance).abs() < 1e-14, "{found:?}");
            assert_near(found.normal, vec3(0.0, -1.0, 0.0));
            assert_near(found.point, link.start);
            assert_near(found.witness, vec3(0.0, 1.0, 0.0));
        }
    }

    /// A normal with digits left out is made a unit vector.
    #[test]
    fn a_normal_is_normalised() {
        let wall = fixed(Shape::HalfSpace { normal: [0.0, 0.0, 1.000_000_5] }, [0.0; 3]);
        let found = contact(&capsule([0.0, 0.0, 3.0], [0.0, 0.0, 4.0], 0.0), &wall);
        assert!((found.distance - 3.0).abs() < 1e-15 && (found.normal.norm() - 1.0).abs() < 1e-15);
    }
}
