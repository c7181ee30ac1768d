//! The axis of a link, and where it is nearest to something.

use crate::math::{Capsule, Feature, TOUCHING, Vector};

/// A link, made ready for the questions of many obstacles: itself. Its axis is a segment, or a point of length 0.
///
/// # Example
/// ```
/// use vff_core::geometry::{Probe, perpendicular};
/// use vff_core::math::Vector;
///
/// let axis = Probe::new(Vector::<3>::zeros(), Vector::<3>::new(0.0, 0.0, 1.0), 0.05);
/// assert_eq!(perpendicular(&axis.direction).dot(&axis.direction), 0.0);
/// ```
pub type Probe = Capsule<3>;

/// The nearest points of an axis and a core. The one on the core is
/// `point − distance · normal`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nearest {
    pub(crate) distance: f64,
    pub(crate) normal: Vector<3>,
    pub(crate) point: Vector<3>,
    pub(crate) feature: Feature<3>,
}

/// `along`, cut off at the ends of a segment. Undefined numbers do not panic; the points made of them are undefined.
#[inline(always)]
pub(crate) fn within(along: f64, length: f64) -> f64 {
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
pub(crate) fn seen_from(link: &Probe, position: &Vector<3>) -> Probe {
    Probe { start: link.start - position, ..*link }
}

/// The insides of an axis along `u` and of an edge: `cross` is u × edge, and `between` leads from the nearest point of the
/// edge to that of the axis. Their distance is measured along `cross`, whose direction is known better than that of
/// points that nearly meet; but not so of axes that are nearly parallel.
#[inline(always)]
pub(crate) fn across(cross: &Vector<3>, between: &Vector<3>) -> f64 {
    let (gap, sin) = (between.norm_squared(), cross.norm_squared());
    if is_better(sin, gap) { (cross.dot(between) / sin.sqrt()).abs() } else { gap.sqrt() }
}

/// The direction in which [`across`] measures, from the edge to the axis.
#[inline]
pub(crate) fn across_normal(cross: &Vector<3>, between: &Vector<3>) -> Vector<3> {
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
pub(crate) const PARALLEL: f64 = 1e-7;

/// The lines through an axis and an edge, and how far beyond the ends of both they come nearest; none if they are parallel.
pub(crate) fn to_edge(axis: &Probe, edge: &Probe) -> Option<(Nearest, f64)> {
    let offset = axis.start - edge.start;
    let cross = axis.direction.cross(&edge.direction);
    let sin_squared = cross.norm_squared();
    if sin_squared <= PARALLEL * PARALLEL {
        return None;
    }
    let cos = axis.direction.dot(&edge.direction);
    let s = -offset.cross(&edge.direction).dot(&cross) / sin_squared;
    let t = edge.direction.dot(&offset) + s * cos;
    let point = axis.start + axis.direction * s;
    let between = offset + axis.direction * s - edge.direction * t;
    let distance = across(&cross, &between);
    let feature = Feature::Crossing { edge: edge.direction, distance };
    let nearest = Nearest { distance, normal: across_normal(&cross, &between), point, feature };
    Some((nearest, beyond(s, axis.length) + beyond(t, edge.length)))
}

/// How far a place on an axis of this length lies beyond its ends \[m\].
pub(crate) fn beyond(along: f64, length: f64) -> f64 {
    (-along).max(along - length).max(0.0)
}
