//! What friction takes is given back: viscous, and dry with a smooth sign (T113).

use crate::control::CommandSettings;

/// Coefficients of one joint.
#[derive(Debug, Clone, Copy)]
struct OfJoint {
    viscous: f64,
    coulomb: f64,
    /// 1/q̇_s, q̇_s being where tanh 1 of the dry friction are given back.
    per_speed: f64,
}

/// Friction compensation of an arm.
#[derive(Debug, Clone)]
pub struct Friction(Vec<OfJoint>);

impl Friction {
    /// That of `n` joints; None if there is nothing to compensate.
    pub fn new(settings: &CommandSettings, n: usize) -> Option<Self> {
        let of = |i: usize| OfJoint {
            viscous: settings.viscous_friction.get(i),
            coulomb: settings.coulomb_friction.get(i),
            per_speed: settings.friction_speed.get(i).recip(),
        };
        settings.compensates_friction().then(|| Self((0..n).map(of).collect()))
    }

    /// `tau += B q̇ + c tanh(q̇/q̇_s)`, no joint beyond its torque limit, unless it has been before.
    pub fn compensate(&self, dq: &[f64], limits: &[f64], tau: &mut [f64]) {
        for (i, (joint, tau)) in self.0.iter().zip(tau).enumerate() {
            let OfJoint { viscous, coulomb, per_speed } = joint;
            let most = limits.get(i).map_or(f64::INFINITY, |limit| limit.max(tau.abs()));
            *tau =
                (*tau + viscous * dq[i] + coulomb * (dq[i] * per_speed).tanh()).clamp(-most, most);
        }
    }
}
