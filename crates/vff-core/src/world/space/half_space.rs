//! An axis and a half-space through the obstacle's position.

use super::axis::{Nearest, Probe};
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
