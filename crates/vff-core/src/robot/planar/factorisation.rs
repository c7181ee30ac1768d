//! The articulated-body recursion in the plane: M factorised, and unit task forces on their way through it.

use super::arm::Composite;
use super::{Joint, twist};
use crate::math::{Vector, perp};
use nalgebra::{SMatrix, SVector};

/// The inertia of the outer part of the arm as its first joint shows it, all joints yielding: a
/// symmetric 2×2 block K (T22).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ArticulatedInertia {
    xx: f64,
    xy: f64,
    yy: f64,
}

impl ArticulatedInertia {
    /// Goes on by one link towards the base, and leaves the factorisation in its joint.
    ///
    /// With K at the far joint, a link whose joint accelerates by `a` and which turns with `α` needs
    /// the moment `D α + h·a`, and leaves `K − h hᵀ/D + m I` to its parent. One link waits for the
    /// other here, so the terms are ordered for the shortest way through the division.
    #[inline(always)]
    pub(super) fn take_in(&mut self, joint: &mut Joint, link: &Composite) {
        let Self { xx, xy, yy } = *self;
        let lp = perp(joint.l);
        let turning = link.about_joint + yy * (lp.y * lp.y);
        let d = (turning + xy * (2.0 * lp.x * lp.y)) + xx * (lp.x * lp.x);
        let d_inv = 1.0 / d;
        // m c in the world frame: the composite moment without the carried masses.
        let mc = joint.b - joint.l * link.carried;
        let kl = Vector::<2>::new(xx * lp.x + xy * lp.y, xy * lp.x + yy * lp.y);
        let h = perp(mc) + kl;
        self.xx = (xx + link.mass) - (h.x * h.x) * d_inv;
        self.xy = xy - (h.x * h.y) * d_inv;
        self.yy = (yy + link.mass) - (h.y * h.y) * d_inv;
        (joint.d_inv, joint.h) = (d_inv, h * d_inv);
    }
}

/// What unit task forces, one per column, leave at the joints on their way from tip to base (T24).
pub(super) struct TaskForces<const M: usize> {
    x: SVector<f64, M>,
    y: SVector<f64, M>,
    pub(super) lambda_inv: SMatrix<f64, M, M>,
}

impl<const M: usize> TaskForces<M> {
    /// At the tip, where they enter as reactions.
    pub(super) fn new() -> Self {
        Self {
            x: twist(Vector::<2>::new(-1.0, 0.0), 0.0),
            y: twist(Vector::<2>::new(0.0, -1.0), 0.0),
            lambda_inv: SMatrix::zeros(),
        }
    }

    /// Goes on by one link towards the base; a unit moment acts on the `last` one.
    #[inline(always)]
    pub(super) fn take_in(&mut self, joint: &Joint, last: bool, y: &mut SVector<f64, M>) {
        let mut e = self.x * joint.l.y - self.y * joint.l.x;
        if M > 2 && last {
            e[2] += 1.0;
        }
        *y = e * joint.d_inv;
        self.lambda_inv += e * y.transpose();
        self.x += e * joint.h.x;
        self.y += e * joint.h.y;
    }

    /// Base to tip, the second half: as [`PlanarState::yield_forward`].
    #[inline(always)]
    pub(super) fn yield_forward(joints: &[Joint], y: &mut [SVector<f64, M>]) {
        let mut previous = SVector::zeros();
        let (mut ax, mut ay) = (SVector::zeros(), SVector::zeros());
        for (joint, y) in joints.iter().zip(y) {
            let alpha: SVector<f64, M> = *y - (ax * joint.h.x + ay * joint.h.y);
            ax -= alpha * joint.l.y;
            ay += alpha * joint.l.x;
            *y = alpha - previous;
            previous = alpha;
        }
    }
}
