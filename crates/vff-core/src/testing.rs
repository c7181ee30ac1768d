//! Random arms and states for the unit tests.

pub use crate::math::close::assert_close;
use crate::math::{Vector, dot};
use crate::robot::{Model, PlanarArm, PlanarState, Robot, planar::Link};
use proptest::prelude::*;
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4};
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

/// ∂L/∂q of the kinetic energy less that of gravity, which in an angle is a trigonometric polynomial of the second degree and
/// in a length a polynomial of the second degree: these two differences are exact for either (T186).
pub fn lagrangian_gradient<R: Robot<D>, const D: usize>(
    robot: &mut R,
    slides: impl Fn(usize) -> bool,
) -> Vec<f64> {
    let (mut q, dq) = (robot.configuration().to_vec(), robot.velocity().to_vec());
    let mut momentum = vec![0.0; q.len()];
    let mut difference = |i: usize, h: f64| {
        let at = q[i];
        let [after, before] = [h, -h].map(|h| {
            q[i] = at + h;
            robot.update(&q, &dq);
            robot.mass_mul(&dq, &mut momentum);
            0.5 * dot(&momentum, &dq) - robot.potential_energy()
        });
        q[i] = at;
        after - before
    };
    let slope = |i| {
        if slides(i) {
            return 0.5 * difference(i, 1.0);
        }
        difference(i, FRAC_PI_4) + difference(i, FRAC_PI_2) * (0.5 - FRAC_1_SQRT_2)
    };
    (0..dq.len()).map(slope).collect()
}
