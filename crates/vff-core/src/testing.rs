//! Random arms and states for the unit tests.

use crate::math::Vector;
pub use crate::math::close::assert_close;
use crate::robot::{Model, PlanarArm, PlanarState, Robot, planar::Link};
use proptest::prelude::*;
use std::sync::Arc;

/// A random arm at a random state, and two more random joint vectors.
#[derive(Debug, Clone)]
pub struct Case {
    pub arm: Arc<PlanarArm>,
    pub q: Vec<f64>,
    pub dq: Vec<f64>,
    pub u: Vec<f64>,
    pub v: Vec<f64>,
}

impl Case {
    pub fn state(&self) -> PlanarState {
        let mut state = self.arm.state();
        state.update(&self.q, &self.dq);
        state
    }

    /// The state a short time later, moving with constant q̇.
    pub fn later(&self, dt: f64) -> PlanarState {
        let mut state = self.arm.state();
        let q: Vec<_> = self.q.iter().zip(&self.dq).map(|(q, dq)| q + dt * dq).collect();
        state.update(&q, &self.dq);
        state
    }
}

/// Links of unequal length, mass, inertia and with offset centres of mass, under gravity.
pub fn case(joints: impl Strategy<Value = usize>) -> impl Strategy<Value = Case> {
    let link = (0.2..1.5, 0.1..3.0, 0.1..0.9, -0.2..0.2, 0.01..0.3).prop_map(
        |(length, mass, along, across, inertia): (f64, f64, f64, f64, f64)| Link {
            length,
            mass,
            com: Vector::<2>::new(along * length, across * length),
            inertia,
            radius: 0.0,
        },
    );
    let joint = || -3.0..3.0;
    joints
        .prop_flat_map(move |n| {
            (
                prop::collection::vec(link.clone(), n),
                prop::array::uniform2(-10.0..10.0),
                prop::array::uniform4(prop::collection::vec(joint(), n)),
            )
        })
        .prop_map(|(links, gravity, [q, dq, u, v])| Case {
            arm: Arc::new(PlanarArm::new(links, Vector::from(gravity))),
            q,
            dq,
            u,
            v,
        })
}
