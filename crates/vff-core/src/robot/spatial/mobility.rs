//! How every link accelerates per wrench on it, all links in one sweep from the base (T90).
//!
//! The extended-force propagator of Lilly and Orin, in the common frame. One contact costs fewer
//! instructions by a half solve ([`Robot::point_mobility`](crate::robot::Robot::point_mobility));
//! this is for many contacts at one state.

use super::algebra::Spatial;
use super::state::SpatialState;
use crate::math::Vector;

/// Ω of one link: symmetric, 6×6; the twist of its acceleration per wrench on it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Mobility {
    /// Row `i` has the columns 0 to `i`: angular components before linear ones.
    rows: [[f64; 6]; 6],
    base: Vector<3>,
}

impl Mobility {
    /// `nᵀ J_c M⁻¹ J_cᵀ n` for the point of this link that is now at `point` of the world, the
    /// acceleration along `n` per unit force along `n` \[1/kg\].
    pub fn along(&self, point: &Vector<3>, n: &Vector<3>) -> f64 {
        let w = Spatial::at(&(point - self.base), *n, Vector::zeros());
        self.mul(&w).dot(&w)
    }

    #[inline(always)]
    fn mul(&self, w: &Spatial) -> Spatial {
        let (w, mut out) = (w.components(), [0.0; 6]);
        for (i, out) in out.iter_mut().enumerate() {
            for (j, w) in w.iter().enumerate() {
                *out += self.rows[i.max(j)][i.min(j)] * w;
            }
        }
        Spatial::from_components(&out)
    }
}

impl SpatialState {
    /// Fills in Ω of every link from the base; `out` may end early.
    pub fn mobilities(&self, out: &mut [Mobility]) {
        let mut omega = Mobility { base: *self.arm.base(), ..Mobility::default() };
        for (joint, out) in self.joints.iter().zip(out) {
            // (1 − s U'ᵀ) Ω (1 − U' sᵀ) + s sᵀ/D with U' = U/D, as one symmetric change of rank two.
            let w = omega.mul(&joint.u);
            let beta = joint.u.dot(&w) + joint.d_inv;
            let (s, g) = (joint.s.components(), (joint.s * (0.5 * beta) - w).components());
            for (i, row) in omega.rows.iter_mut().enumerate() {
                for j in 0..=i {
                    row[j] += s[i] * g[j] + g[i] * s[j];
                }
            }
            *out = omega;
        }
    }
}
