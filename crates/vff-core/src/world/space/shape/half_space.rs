//! Everything on one side of a plane through the obstacle's position.

use super::ConvexCore;
use crate::geometry::axis::{Nearest, Probe};
use crate::geometry::{Convex, HullContact, Onward, PlacedHull};
use crate::math::{UnitQuaternion, Vector};
use crate::world::{Asked, Feature};

/// With the outward unit normal.
#[derive(Debug, Clone)]
pub(in super::super) struct HalfSpace(Vector<3>);

impl HalfSpace {
    /// Of a normal of norm 1 within the tolerance, turned.
    pub(super) fn new(normal: &[f64; 3], turn: &UnitQuaternion) -> Self {
        Self(turn.rotate(&Vector::from(*normal).normalize()))
    }

    fn at(&self, distance: f64, point: Vector<3>) -> Nearest {
        Nearest { distance, normal: self.0, point, feature: Feature::Face }
    }
}

impl Convex for HalfSpace {
    /// Signed distance: that of the lower end.
    #[inline]
    fn nearest(&self, axis: &Probe) -> Nearest {
        let (start, end) = (axis.start, axis.end());
        let (at_start, at_end) = (self.0.dot(&start), self.0.dot(&end));
        // Where the end is undefined it is taken.
        if at_start <= at_end { self.at(at_start, start) } else { self.at(at_end, end) }
    }

    fn offset(&self, point: &Vector<3>) -> Vector<3> {
        self.0 * self.0.dot(point)
    }

    fn for_each_corner(&self, _: impl FnMut(&Vector<3>, Onward<'_>)) {}

    fn for_each_edge(&self, _: impl FnMut(&Probe, Onward<'_>)) {}

    fn for_each_face(&self, mut visit: impl FnMut(&Vector<3>, f64)) {
        visit(&self.0, 0.0);
    }
}

impl ConvexCore for HalfSpace {
    #[inline(always)]
    fn distance(&self, axis: &Probe) -> f64 {
        self.nearest(axis).distance
    }

    fn features(&self) -> Option<usize> {
        Some(0)
    }

    fn extent(&self, _: f64) -> [Vector<3>; 2] {
        [f64::NEG_INFINITY, f64::INFINITY].map(Vector::repeat)
    }

    fn reach(&self) -> f64 {
        f64::INFINITY
    }

    fn cast(&self, origin: &Vector<3>, direction: &Vector<3>, _: f64, _: f64) -> Option<f64> {
        let (height, fall) = (self.0.dot(origin), -self.0.dot(direction));
        match height > 0.0 {
            false => Some(0.0),
            true => (fall > 0.0).then(|| height / fall),
        }
    }

    fn end(&self, end: Vector<3>) -> Nearest {
        self.at(self.0.dot(&end), end)
    }

    /// At the lowest corner.
    fn meet(&self, hull: &PlacedHull<'_, 3>, _: Asked) -> HullContact {
        let heights = hull.corners().map(|corner| (self.0.dot(&corner), corner));
        let lowest = heights.reduce(|a, b| if b.0 < a.0 || b.0.is_nan() { b } else { a });
        let (distance, point) = lowest.unwrap_or((f64::NAN, Vector::zeros()));
        HullContact { nearest: self.at(distance, point), axis: Vector::zeros() }
    }

    /// It has no corners to be seen from.
    fn gap(&self, hull: &PlacedHull<'_, 3>, radius: f64, _: f64, _: &mut Vector<3>) -> f64 {
        self.meet(hull, Asked::Nearest).nearest.distance - radius
    }

    /// Each corner.
    fn for_each_row(
        &self,
        hull: &PlacedHull<'_, 3>,
        _: &Nearest,
        reach: f64,
        mut visit: impl FnMut(&HullContact, f64),
    ) {
        hull.corners().for_each(|corner| {
            let nearest = self.end(corner);
            if nearest.distance < reach {
                visit(&HullContact { nearest, axis: Vector::zeros() }, nearest.distance);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::world::space::oracle::*;
    use crate::world::space::{Obstacle, Shape};

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
