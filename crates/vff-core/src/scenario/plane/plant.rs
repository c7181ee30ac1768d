//! The `[plant]` table: what the physical arm is where it differs from `[arm]`, the controller's model.

use super::super::error::ScenarioError;
use super::super::numbers::{each, number};
use super::{ArmSpec, Nested};
use crate::math::ScalarOrVec;
use crate::robot::{Model, PlanarArm};
use crate::settings::NOT_NEGATIVE;
use crate::simulation::Physics;
use serde::Deserialize;
use std::sync::Arc;

/// The physical arm; what is not given is as in `[arm]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlantSpec {
    /// Link masses \[kg\], > 0.
    pub masses: Option<ScalarOrVec>,
    /// Centres of mass \[m\].
    pub com: Option<Nested>,
    /// Moments of inertia about the centres of mass \[kg·m²\], ≥ 0.
    pub inertias: Option<ScalarOrVec>,
    /// Gravity \[m/s²\].
    pub gravity: Option<Nested>,
    /// Point mass at the tip \[kg\], ≥ 0.
    pub payload: f64,
    /// Viscous friction of the joints \[N·m·s/rad\], each, ≥ 0.
    pub viscous_friction: ScalarOrVec,
    /// Dry friction of the joints \[N·m\], each, ≥ 0.
    pub coulomb_friction: ScalarOrVec,
    /// Whether the joints stop at `arm.joint_limits`.
    pub joint_stops: bool,
}

impl Default for PlantSpec {
    fn default() -> Self {
        Self {
            masses: None,
            com: None,
            inertias: None,
            gravity: None,
            payload: 0.0,
            viscous_friction: ScalarOrVec::Uniform(0.0),
            coulomb_friction: ScalarOrVec::Uniform(0.0),
            joint_stops: true,
        }
    }
}

impl PlantSpec {
    /// The physical arm, where the controller believes in `model`, made of `spec`.
    ///
    /// # Errors
    /// With the name of the first parameter that is wrong.
    pub fn build(
        &self,
        spec: &ArmSpec,
        model: &Arc<PlanarArm>,
    ) -> Result<Physics<PlanarArm>, ScenarioError> {
        let n = model.dof();
        number("payload", self.payload, &NOT_NEGATIVE)?;
        each("viscous_friction", &self.viscous_friction, n, &NOT_NEGATIVE)?;
        each("coulomb_friction", &self.coulomb_friction, n, &NOT_NEGATIVE)?;
        let arm = self.arm(spec)?;
        let limits = arm.limits().clone();
        let mut links = arm.links().to_vec();
        if self.payload > 0.0 {
            links[n - 1] = links[n - 1].with_payload(self.payload);
        }
        let arm = PlanarArm::new(links, arm.gravity()).with_limits(limits);
        let stops = if self.joint_stops { arm.limits().joint.clone() } else { vec![] };
        Ok(Physics {
            arm: if arm == **model { Arc::clone(model) } else { Arc::new(arm) },
            viscous: friction(&self.viscous_friction, n),
            coulomb: friction(&self.coulomb_friction, n),
            stops,
            compensates_gravity: false,
        })
    }

    /// The links without the payload.
    fn arm(&self, spec: &ArmSpec) -> Result<PlanarArm, ScenarioError> {
        let mut spec = spec.clone();
        if let Some(masses) = &self.masses {
            spec.masses = masses.clone();
        }
        spec.com = self.com.clone().or(spec.com);
        spec.inertias = self.inertias.clone().or(spec.inertias);
        spec.gravity = self.gravity.clone().or(spec.gravity);
        spec.build()
    }
}

/// One coefficient per joint; none if all are zero.
fn friction(given: &ScalarOrVec, n: usize) -> Vec<f64> {
    let some = given.values().iter().any(|value| *value > 0.0);
    if some { (0..n).map(|i| given.get(i)).collect() } else { vec![] }
}
