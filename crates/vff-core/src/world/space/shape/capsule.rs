//! A capsule: a segment, swept by a ball.

use super::sphere::cast_at_ball;
use super::{ConvexCore, Core, Point, around};
use crate::geometry::axis::Probe;
use crate::geometry::segment::distance_to_segment;
use crate::math::{Capsule, Vector};

/// The core between two ends.
pub(super) fn between([a, b]: [Vector<3>; 2]) -> Core {
    let segment = Capsule::new(a, b, 0.0);
    let is_point = !segment.length.is_normal();
    if is_point { Core::Point(Point(segment.start)) } else { Core::Segment(segment) }
}

impl ConvexCore for Probe {
    #[inline(always)]
    fn distance(&self, axis: &Probe) -> f64 {
        distance_to_segment(axis, self)
    }

    fn features(&self) -> Option<usize> {
        Some(2 + 1)
    }

    fn extent(&self, radius: f64) -> [Vector<3>; 2] {
        let half = self.direction * (0.5 * self.length);
        around(self.start + half, half.abs(), radius)
    }

    fn reach(&self) -> f64 {
        self.start.norm().max(self.end().norm())
    }

    fn cast(&self, origin: &Vector<3>, direction: &Vector<3>, radius: f64, _: f64) -> Option<f64> {
        cast_at_capsule(self, radius, origin, direction)
    }
}

/// The first of the cylinder's side and the balls at the ends.
pub(in super::super) fn cast_at_capsule(
    core: &Capsule<3>,
    radius: f64,
    origin: &Vector<3>,
    direction: &Vector<3>,
) -> Option<f64> {
    let reject = |v: &Vector<3>| v - core.direction * core.direction.dot(v);
    let offset = origin - core.start;
    let (beside, across) = (reject(&offset), reject(direction));
    let (speed, along) = (across.norm(), core.direction.dot(&offset));
    let is_inside = |along: f64| (0.0..=core.length).contains(&along);
    if beside.norm() <= radius && is_inside(along) {
        return Some(0.0);
    }
    let side = (speed > 0.0).then(|| cast_at_ball(&beside, &(across / speed), radius)).flatten();
    let side = side
        .map(|s| s / speed)
        .filter(|s| *s > 0.0 && is_inside(along + s * core.direction.dot(direction)));
    let ends = [core.start, core.end()].map(|end| cast_at_ball(&(origin - end), direction, radius));
    [side, ends[0], ends[1]].into_iter().flatten().reduce(f64::min)
}
