//! A sphere: its centre, swept by a ball.

use super::{ConvexCore, around};
use crate::geometry::axis::{Nearest, Probe};
use crate::geometry::point::{distance_to_point, to_point};
use crate::geometry::{Convex, HullContact, Onward, PlacedHull};
use crate::math::Vector;
use crate::world::{Asked, TOUCHING};

/// A centre \[m\].
#[derive(Debug, Clone)]
pub(in super::super) struct Point(pub(in super::super) Vector<3>);

impl Convex for Point {
    #[inline]
    fn nearest(&self, axis: &Probe) -> Nearest {
        to_point(axis, &self.0)
    }

    fn offset(&self, point: &Vector<3>) -> Vector<3> {
        point - self.0
    }

    fn for_each_corner(&self, mut visit: impl FnMut(&Vector<3>, Onward<'_>)) {
        visit(&self.0, Onward::Along(&[]));
    }

    fn for_each_edge(&self, _: impl FnMut(&Probe, Onward<'_>)) {}

    fn for_each_face(&self, _: impl FnMut(&Vector<3>, f64)) {}
}

impl ConvexCore for Point {
    #[inline(always)]
    fn distance(&self, axis: &Probe) -> f64 {
        distance_to_point(axis, &self.0)
    }

    fn features(&self) -> Option<usize> {
        None
    }

    fn extent(&self, radius: f64) -> [Vector<3>; 2] {
        around(self.0, Vector::zeros(), radius)
    }

    fn reach(&self) -> f64 {
        self.0.norm()
    }

    fn cast(&self, origin: &Vector<3>, direction: &Vector<3>, radius: f64, _: f64) -> Option<f64> {
        cast_at_ball(&(origin - self.0), direction, radius)
    }

    /// For a barrier it is above a face everywhere outside, so that its acceleration does not jump where that goes round an edge
    /// or a corner (T77).
    fn meet(&self, hull: &PlacedHull<'_, 3>, asked: Asked) -> HullContact {
        let contact = hull.meet_point(&self.0);
        let is_row = matches!(asked, Asked::Barriers(_)) && contact.nearest.distance > TOUCHING;
        if is_row { hull.above_face(&self.0) } else { contact }
    }
}

/// Where |offset + s · direction| = radius first, from outside; 0 inside.
pub(super) fn cast_at_ball(offset: &Vector<3>, direction: &Vector<3>, radius: f64) -> Option<f64> {
    let along = offset.dot(direction);
    // The offset across the ray keeps the digits that along² − offset² would lose far away.
    let across = offset - direction * along;
    let gap = offset.norm_squared() - radius * radius;
    if gap <= 0.0 {
        return Some(0.0);
    }
    let reach = radius * radius - across.norm_squared();
    // The product of both roots is the gap: no difference of nearly equal numbers.
    (along < 0.0 && reach >= 0.0).then(|| gap / (reach.sqrt() - along))
}
