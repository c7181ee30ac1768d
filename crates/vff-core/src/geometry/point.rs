//! An axis and a point: the core of a sphere, by far the most frequent query.

use super::axis::{Nearest, Probe, perpendicular, within};
use crate::math::{Feature, TOUCHING, Vector};

/// Where on the axis the nearest point is \[m\], and how it leads there from `centre`.
#[inline(always)]
pub(crate) fn foot(axis: &Probe, centre: &Vector<3>) -> (f64, Vector<3>) {
    let offset = axis.start - centre;
    let along = within(-axis.direction.dot(&offset), axis.length);
    (along, offset + axis.direction * along)
}

/// Distance to the centre of a sphere: never negative, because only by chance do the two meet.
#[inline]
pub(crate) fn to_point(axis: &Probe, centre: &Vector<3>) -> Nearest {
    let (along, offset) = foot(axis, centre);
    let distance = offset.norm();
    let point = centre + offset;
    if distance > TOUCHING {
        let inside = 0.0 < along && along < axis.length;
        let feature = if inside { Feature::Side { distance } } else { Feature::End { distance } };
        return Nearest { distance, normal: offset / distance, point, feature };
    }
    // The centre is on the axis itself, or nowhere (NaN): every way across the axis is as good.
    Nearest { distance, normal: perpendicular(&axis.direction), point, feature: Feature::Face }
}

/// Its square \[m²\].
#[inline(always)]
pub(crate) fn square_to_point(axis: &Probe, centre: &Vector<3>) -> f64 {
    foot(axis, centre).1.norm_squared()
}

/// The distance of [`to_point`], bit for bit.
#[inline(always)]
pub(crate) fn distance_to_point(axis: &Probe, centre: &Vector<3>) -> f64 {
    foot(axis, centre).1.norm()
}
