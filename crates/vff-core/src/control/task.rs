//! The task: what acceleration the end effector should have.

use super::Gains;
use crate::math::{Pose, Vector};
use crate::trajectory::Sample;

/// ẍ_c = ẍ_r − D ė − K e (T9; the paper's eq. 16–18 corrected: the printed +K_s e diverges).
#[inline]
pub fn commanded_acceleration<P: Pose<M>, const M: usize>(
    gains: &Gains<M>,
    reference: &Sample<P, M>,
    e: Vector<M>,
    de: Vector<M>,
) -> Vector<M> {
    reference.ddx - gains.damping.component_mul(&de) - gains.stiffness.component_mul(&e)
}
