//! The convex hull of points.

use super::{ConvexCore, Core, Point};
use crate::geometry::Hull;
use crate::geometry::axis::Probe;
use crate::math::{UnitQuaternion, Vector};

/// The hull of the points, turned; of unusable ones a point.
pub(super) fn around(vertices: &[[f64; 3]], turn: &UnitQuaternion) -> Core {
    match Hull::new_turned(vertices, turn) {
        Ok(hull) => Core::Hull(Box::new(hull)),
        Err(_) => Core::Point(Point(Vector::zeros())),
    }
}

impl ConvexCore for Hull {
    #[inline(always)]
    fn distance(&self, axis: &Probe) -> f64 {
        Self::distance(self, axis)
    }

    #[inline(always)]
    fn distance_below(&self, axis: &Probe, limit: f64) -> f64 {
        let is_far = limit < f64::INFINITY && self.is_farther(axis, limit);
        if is_far { f64::INFINITY } else { self.distance(axis) }
    }

    fn features(&self) -> Option<usize> {
        Some(self.corners.len() + self.edges.len())
    }

    fn extent(&self, _: f64) -> [Vector<3>; 2] {
        self.bounds()
    }

    fn reach(&self) -> f64 {
        Self::reach(self)
    }

    fn cast(&self, origin: &Vector<3>, direction: &Vector<3>, _: f64, _: f64) -> Option<f64> {
        self.meet_ray(origin, direction)
    }
}
