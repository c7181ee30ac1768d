//! Tasks of three dimensions (position), six (pose) and five (pointing) at the tool.
//!
//! A pose has linear rows, then angular ones, in world axes. Pointing leaves the turn about the
//! tool's z axis free: its angular rows are those along the tool's own x and y axes.

use super::algebra::Spatial;
use super::joint::{Joint, Tool};
use crate::math::Vector;
use nalgebra::{SMatrix, SVector};

/// The rows of a task from a velocity of the tool's origin and an angular velocity.
#[inline(always)]
pub(super) fn rows<const M: usize>(
    tool: &Tool,
    linear: &Vector<3>,
    angular: &Vector<3>,
) -> SVector<f64, M> {
    const { assert!(M == 3 || M == 5 || M == 6, "a task in space has dimension 3, 5 or 6") };
    let mut rows = SVector::zeros();
    for k in 0..3 {
        rows[k] = linear[k];
    }
    if M == 5 {
        for k in 0..2 {
            rows[3 + k] = angular.dot(&tool.rotation.column(k));
        }
    } else if M == 6 {
        for k in 0..3 {
            rows[3 + k] = angular[k];
        }
    }
    rows
}

/// Force and moment at the tool of a task force: the transpose of [`rows`].
#[inline(always)]
pub(super) fn force<const M: usize>(tool: &Tool, f: &SVector<f64, M>) -> (Vector<3>, Vector<3>) {
    let mut moment = Vector::<3>::zeros();
    if M == 5 {
        moment = tool.rotation.column(0) * f[3] + tool.rotation.column(1) * f[4];
    } else if M == 6 {
        moment = Vector::<3>::new(f[3], f[4], f[5]);
    }
    (Vector::<3>::new(f[0], f[1], f[2]), moment)
}

/// What unit task forces, one per column, leave at the joints on their way from tip to base (T89).
pub(super) struct TaskForces<const M: usize> {
    /// Six components, moments about the base before forces.
    wrench: [SVector<f64, M>; 6],
    pub lambda_inv: SMatrix<f64, M, M>,
}

impl<const M: usize> TaskForces<M> {
    /// At the tip.
    #[inline(always)]
    pub fn new(tool: &Tool) -> Self {
        let mut wrench = [SVector::zeros(); 6];
        for k in 0..M {
            let mut unit = SVector::<f64, M>::zeros();
            unit[k] = 1.0;
            let (force, moment) = force(tool, &unit);
            let Spatial { angular, linear } = Spatial::at(&tool.position, force, moment);
            for c in 0..3 {
                (wrench[c][k], wrench[3 + c][k]) = (angular[c], linear[c]);
            }
        }
        Self { wrench, lambda_inv: SMatrix::zeros() }
    }

    /// Goes on by one link towards the base.
    #[inline(always)]
    pub fn take_in(&mut self, joint: &Joint, y: &mut SVector<f64, M>) {
        let (s, u) = (joint.s.components(), joint.u.components());
        let e = combine(&self.wrench, &s);
        *y = e * joint.d_inv;
        self.lambda_inv += e * y.transpose();
        for (wrench, u) in self.wrench.iter_mut().zip(u) {
            *wrench -= e * u;
        }
    }

    /// Base to tip, the second half: what the joints yield to each other.
    #[inline(always)]
    pub fn yield_forward(joints: &[Joint], y: &mut [SVector<f64, M>]) {
        let mut acceleration = [SVector::zeros(); 6];
        for (joint, y) in joints.iter().zip(y) {
            *y -= combine(&acceleration, &joint.u.components());
            for (acceleration, s) in acceleration.iter_mut().zip(joint.s.components()) {
                *acceleration += *y * s;
            }
        }
    }
}

/// `Σ columns_c s_c`, as two sums side by side.
#[inline(always)]
fn combine<const M: usize>(columns: &[SVector<f64, M>; 6], s: &[f64; 6]) -> SVector<f64, M> {
    (columns[0] * s[0] + columns[1] * s[1] + columns[2] * s[2])
        + (columns[3] * s[3] + columns[4] * s[4] + columns[5] * s[5])
}
