//! Where an axis comes nearest to a core, as a contact of their surfaces.

use crate::geometry::axis::{Nearest, Probe};
use crate::math::Vector;
use crate::world::{Contact, MotionState, Pair, Spin};

/// The direction of a link's axis; a ball has none.
#[inline(always)]
pub(super) fn axis_of(link: &Probe) -> Vector<3> {
    if link.length > 0.0 { link.direction } else { Vector::zeros() }
}

/// The contact at these points of the axis of a link, which has this direction, and of a core in this state, which have these
/// radii \[m\], that of the core first.
#[inline]
pub(super) fn contact_of(
    Pair { body, link, obstacle, margin }: Pair,
    nearest: &Nearest,
    axis: &Vector<3>,
    [around_core, around_axis]: [f64; 2],
    state: &MotionState<3>,
) -> Contact<3> {
    let Nearest { distance, normal, point, feature } = *nearest;
    let point = state.position + point;
    Contact {
        body,
        link,
        obstacle,
        margin,
        distance: distance - around_core - around_axis,
        normal,
        point,
        axis: *axis,
        witness: point - normal * (distance - around_core),
        velocity: state.velocity,
        acceleration: state.acceleration,
        spin: Spin::NONE,
        feature,
    }
}
