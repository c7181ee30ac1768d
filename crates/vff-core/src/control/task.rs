//! The task: what the end effector should do, and how far it is from doing it.

use super::Gains;
use crate::math::Vector;
use crate::trajectory::Sample;
use std::f64::consts::{PI, TAU};

/// The error e = x − x_r of a planar pose (eq. 16): a difference in position, the angle from
/// reference to pose in (−π, π] in orientation, so that a full turn is no error.
#[inline]
pub fn error<const M: usize>(x: Vector<M>, reference: Vector<M>) -> Vector<M> {
    let mut e = x - reference;
    if M > 2 && e[2].abs() > PI {
        e[2] -= TAU * (e[2] / TAU).round();
    }
    e
}

/// ẍ_c = ẍ_r − D ė − K e (T9; the paper's eq. 16–18 corrected: the printed +K_s e diverges).
#[inline]
pub fn commanded_acceleration<const M: usize>(
    gains: &Gains<M>,
    reference: &Sample<M>,
    e: Vector<M>,
    de: Vector<M>,
) -> Vector<M> {
    reference.ddx - gains.damping.component_mul(&de) - gains.stiffness.component_mul(&e)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Orientation is not a vector: poses one turn apart are the same pose.
    #[test]
    fn orientation_error_takes_the_short_way() {
        let at = |phi| Vector::<3>::new(1.0, 2.0, phi);
        assert!((error(at(3.0), at(-3.0))[2] - (6.0 - TAU)).abs() < 1e-15);
        assert!(error(at(0.5 + 3.0 * TAU), at(0.5)).norm() < 1e-14);
        assert!((error(at(0.4), at(0.1))[2] - 0.3).abs() < 1e-15);
    }
}
