//! The axis of a link, and where it is nearest to something.

use crate::math::{Capsule, Vector};
use crate::world::{Feature, TOUCHING};

/// A link, made ready for the questions of many obstacles: itself. Its axis is a segment, or a point of length 0.
pub type Probe = Capsule<3>;

/// The nearest points of an axis and a core. The one on the core is
/// `point − distance · normal`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    pub(super) distance: f64,
    pub(super) normal: Vector<3>,
    pub(super) point: Vector<3>,
    pub(super) feature: Feature<3>,
}

/// `along`, cut off at the ends of a segment. Undefined numbers do not panic; the points made of them are undefined.
#[inline(always)]
pub(super) fn within(along: f64, length: f64) -> f64 {
    along.max(0.0).min(length)
}

/// A unit vector across the unit vector `u`, always the same (Duff et al., 2017).
pub fn perpendicular(u: &Vector<3>) -> Vector<3> {
    let sign = 1f64.copysign(u.z);
    let a = -1.0 / (sign + u.z);
    Vector::<3>::new(1.0 + sign * u.x * u.x * a, sign * u.x * u.y * a, -sign * u.x)
}

/// The link seen from an obstacle at `position`.
#[inline(always)]
pub(super) fn seen_from(link: &Probe, position: &Vector<3>) -> Probe {
    Probe { start: link.start - position, ..*link }
}

/// The insides of an axis along `u` and of an edge: `cross` is u × edge, and `between` leads from the nearest point of the
/// edge to that of the axis. Their distance is measured along `cross`, whose direction is known better than that of
/// points that nearly meet; but not so of axes that are nearly parallel.
#[inline(always)]
pub(super) fn across(cross: &Vector<3>, between: &Vector<3>) -> f64 {
    let (gap, sin) = (between.norm_squared(), cross.norm_squared());
    if is_better(sin, gap) { (cross.dot(between) / sin.sqrt()).abs() } else { gap.sqrt() }
}

/// The direction in which [`across`] measures, from the edge to the axis.
#[inline]
pub(super) fn across_normal(cross: &Vector<3>, between: &Vector<3>) -> Vector<3> {
    let (gap, sin) = (between.norm_squared(), cross.norm_squared());
    if is_better(sin, gap) {
        cross / sin.sqrt().copysign(cross.dot(between))
    } else {
        between / gap.sqrt()
    }
}

#[inline(always)]
fn is_better(sin_squared: f64, gap_squared: f64) -> bool {
    sin_squared >= gap_squared && sin_squared > TOUCHING * TOUCHING
}

/// Axes at a smaller angle than this \[rad\] count as parallel where the way in which they cross matters.
pub(super) const PARALLEL: f64 = 1e-7;
