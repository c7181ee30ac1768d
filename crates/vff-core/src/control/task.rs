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
