//! An axis and a segment: the core of a capsule.

use super::axis::{Nearest, PARALLEL, Probe, across, across_normal, perpendicular, within};
use crate::math::{Feature, TOUCHING, Vector};

/// The nearest points of two segments.
pub(crate) struct Feet {
    /// Where they are along each \[m\].
    along: [f64; 2],
    /// From that of the second to that of the first.
    between: Vector<3>,
    /// Cross product of the two directions.
    cross: Vector<3>,
    /// Whether they are the feet of the common perpendicular: neither was cut off at an end.
    crossing: bool,
    pub(crate) distance: f64,
}

/// The nearest points of the lines, the first cut off at the ends of its segment, the second below its foot and then the
/// first below that (Ericson, Real-Time Collision Detection, 5.1.9). Where the two are nearly parallel the place is
/// ill-conditioned, but the distance is not.
#[inline(always)]
pub(crate) fn feet(a: &Probe, b: &Probe) -> Feet {
    let (u, v, offset) = (&a.direction, &b.direction, a.start - b.start);
    let cross = u.cross(v);
    let (sin_squared, cos) = (cross.norm_squared(), u.dot(v));
    let (along_a, along_b) = (u.dot(&offset), v.dot(&offset));
    let free = -offset.cross(v).dot(&cross) / sin_squared;
    let s = if sin_squared > 0.0 { within(free, a.length) } else { 0.0 };
    let below = along_b + s * cos;
    let t = within(below, b.length);
    // Where the first was cut off this gives the end again, but for rounding: that is no place inside.
    let crossing = is_inside(free, a.length) && is_inside(below, b.length);
    let s = within(t * cos - along_a, a.length);
    let between = offset + u * s - v * t;
    let distance = if crossing { across(&cross, &between) } else { between.norm() };
    Feet { along: [s, t], between, cross, crossing, distance }
}

#[inline(always)]
fn is_inside(along: f64, length: f64) -> bool {
    0.0 < along && along < length
}

/// Distance to a segment: never negative, because only by chance do the two meet.
#[inline]
pub(crate) fn to_segment(axis: &Probe, core: &Probe) -> Nearest {
    between(axis, core, &feet(axis, core))
}

/// The nearest points of an axis and an edge, which have these feet.
#[inline]
pub(crate) fn between(axis: &Probe, core: &Probe, feet: &Feet) -> Nearest {
    let Feet { along: [s, t], between, cross, crossing, distance } = *feet;
    let point = axis.start + axis.direction * s;
    let edge = core.direction;
    let sin = cross.norm();
    let inside = [is_inside(s, axis.length), is_inside(t, core.length)];
    if crossing && sin > PARALLEL {
        let normal = across_normal(&cross, &between);
        return Nearest { distance, normal, point, feature: Feature::Crossing { edge, distance } };
    }
    if distance > TOUCHING {
        let feature = match inside {
            [_, true] => Feature::Edge { edge, distance },
            [true, false] => Feature::Side { distance },
            [false, false] => Feature::End { distance },
        };
        return Nearest { distance, normal: between / between.norm(), point, feature };
    }
    // They touch at an end, or are nowhere (NaN): every way across both is as good.
    let normal = if sin > PARALLEL { cross / sin } else { perpendicular(&axis.direction) };
    Nearest { distance, normal, point, feature: Feature::Face }
}

/// The distance of [`to_segment`], bit for bit.
#[inline]
pub(crate) fn distance_to_segment(axis: &Probe, core: &Probe) -> f64 {
    feet(axis, core).distance
}
