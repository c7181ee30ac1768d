//! The task: what acceleration the end effector should have.

use super::Gains;
use crate::math::Vector;

/// ẍ_c = ẍ_r − D ė − K e (T9; the paper's eq. 16–18 corrected: the printed +K_s e diverges).
#[inline]
pub fn commanded_acceleration<const M: usize>(
    gains: &Gains<M>,
    ddx_r: &Vector<M>,
    e: Vector<M>,
    de: Vector<M>,
) -> Vector<M> {
    ddx_r - gains.damping.component_mul(&de) - gains.stiffness.component_mul(&e)
}

/// Share of the torque rate that coming back from far away takes up (T133).
const RETURN: f64 = 0.25;

/// ẍ_c with no more of it than the drives can follow (T133); `build_up` says how long they take to build up the torque of a
/// task acceleration \[s\].
///
/// A large error pulls as its square root, so that the arm comes back as fast as it can brake again. Of a demand that takes
/// longer to build up than D lets it last, the share is asked for that does not.
pub fn sendable_acceleration<const M: usize>(
    gains: &Gains<M>,
    ddx_r: &Vector<M>,
    e: Vector<M>,
    de: Vector<M>,
    build_up: &mut impl FnMut(&Vector<M>) -> f64,
) -> Vector<M> {
    let pull = gains.stiffness.component_mul(&e);
    let pole = gains.stiffness.component_div(&gains.damping).max();
    let pulled = (RETURN / (pole * build_up(&pull))).sqrt().min(1.0);
    let demand = -gains.damping.component_mul(&de) - pull * pulled;
    let share = (gains.damping.max() * build_up(&demand)).recip().min(1.0);
    if pulled * share < 1.0 {
        ddx_r + demand * share
    } else {
        commanded_acceleration(gains, ddx_r, e, de)
    }
}
