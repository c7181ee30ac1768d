//! What is immutable of a planar arm, for whoever does not know that it is one.

use super::{Joint, PlanarArm, PlanarState};
use crate::math::Vector;
use crate::robot::{Limits, Model, Robot};
use std::sync::Arc;

impl Model<2> for PlanarArm {
    type State = PlanarState;

    fn dof(&self) -> usize {
        self.links.len()
    }

    fn limits(&self) -> &Limits {
        &self.limits
    }

    fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64) {
        q.iter_mut().zip(v).for_each(|(q, v)| *q += v * dt);
    }

    fn reach(&self) -> f64 {
        self.annulus(self.dof()).outer
    }

    /// 1 m: planar arms are drawn at that scale.
    fn characteristic_length(&self) -> f64 {
        1.0
    }

    /// Stretched out, every joint accelerates at 4 rad/s².
    fn typical_torque(self: &Arc<Self>) -> Vec<f64> {
        const ACCELERATION: f64 = 4.0;
        let stretched = vec![0.0; self.dof()];
        let mut state = self.state();
        state.update(&stretched, &stretched);
        let mass_matrix = state.matrices::<2>().mass;
        let pull = self.gravity().norm();
        let reach = |i: usize| self.links()[i..].iter().map(|link| link.length).sum::<f64>();
        let mass = |i: usize| self.links()[i..].iter().map(|link| link.mass).sum::<f64>();
        let one = |i: usize| ACCELERATION * mass_matrix[(i, i)] + pull * mass(i) * reach(i);
        (0..self.dof()).map(one).collect()
    }

    fn state(self: &Arc<Self>) -> PlanarState {
        let n = self.dof();
        let mut state = PlanarState {
            arm: Arc::clone(self),
            q: vec![0.0; n],
            dq: vec![0.0; n],
            joints: self
                .composite
                .iter()
                .map(|link| Joint { diagonal: link.diagonal, ..Joint::default() })
                .collect(),
            tip: Vector::<2>::zeros(),
            tip_velocity: Vector::<2>::zeros(),
            tip_bias: Vector::<2>::zeros(),
        };
        state.update(&vec![0.0; n], &vec![0.0; n]);
        state
    }
}
