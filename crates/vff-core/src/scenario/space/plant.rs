//! The `[plant]` table of an arm in space: what the physical arm is where it differs from `[arm]`.

use super::super::error::{Problem, ScenarioError};
use super::super::numbers::{each, length, number};
use super::SpatialArmSpec;
use crate::math::ScalarOrVec;
use crate::robot::SpatialArm;
use crate::robot::description::{ArmDescription, Joint};
use crate::robot::inertia::{self, Body};
use crate::robot::inertia::{six, tensor};
use crate::settings::{FINITE, NOT_NEGATIVE, POSITIVE};
use crate::simulation::Physics;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;
use std::sync::Arc;

/// The physical arm; what is not given is as in `[arm]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpatialPlantSpec {
    /// Link masses \[kg\], > 0; moments of inertia grow with them.
    pub masses: Option<Vec<f64>>,
    /// The acceleration of free fall in the world \[m/s²\].
    pub gravity: Option<[f64; 3]>,
    /// What the tool carries, and the controller does not know.
    pub payload: PayloadSpec,
    /// Viscous friction of the joints \[N·m·s/rad or N·s/m\], each, ≥ 0. Default: that of the arm.
    pub viscous_friction: Option<ScalarOrVec>,
    /// Dry friction of the joints \[N·m or N\], each, ≥ 0. Default: that of the arm.
    pub coulomb_friction: Option<ScalarOrVec>,
    /// Whether the joints stop at `arm.joint_limits`.
    pub joint_stops: bool,
}

impl Default for SpatialPlantSpec {
    fn default() -> Self {
        Self {
            masses: None,
            gravity: None,
            payload: PayloadSpec::default(),
            viscous_friction: None,
            coulomb_friction: None,
            joint_stops: true,
        }
    }
}

/// A body that the tool carries, in the frame of the tool.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PayloadSpec {
    /// Mass \[kg\], ≥ 0.
    pub mass: f64,
    /// Centre of mass \[m\].
    pub com: [f64; 3],
    /// `[xx, yy, zz, xy, xz, yz]` about the centre of mass \[kg·m²\].
    pub inertia: [f64; 6],
}

impl SpatialPlantSpec {
    /// The physical arm, where the controller believes in `model`, made of `spec`.
    ///
    /// # Errors
    /// With the name of the first parameter that is wrong.
    pub fn build(
        &self,
        spec: &SpatialArmSpec,
        model: &Arc<SpatialArm>,
    ) -> Result<Physics<SpatialArm>, ScenarioError> {
        let believed = model.description();
        let (n, mut arm) = (believed.dof(), believed.clone());
        for (path, given) in [
            ("viscous_friction", &self.viscous_friction),
            ("coulomb_friction", &self.coulomb_friction),
        ] {
            given.as_ref().map_or(Ok(()), |given| each(path, given, n, &NOT_NEGATIVE))?;
        }
        match &spec.load {
            // The masses are those of the links, whatever the last one carries.
            Some(load) if self.masses.is_some() => {
                arm = SpatialArmSpec { load: None, ..spec.clone() }.description()?;
                self.weigh(&mut arm)?;
                load.fasten(&mut arm)?;
            }
            _ => self.weigh(&mut arm)?,
        }
        arm.gravity = self.gravity.unwrap_or(arm.gravity);
        self.payload.load(&mut arm).map_err(|error| error.inside("payload"))?;
        let friction = |given: &Option<ScalarOrVec>, own: fn(&Joint) -> f64| {
            let of = |i: usize| given.as_ref().map_or_else(|| own(&arm.joints[i]), |it| it.get(i));
            let all: Vec<f64> = (0..n).map(of).collect();
            if all.iter().any(|x| *x > 0.0) { all } else { vec![] }
        };
        let viscous = friction(&self.viscous_friction, |joint| joint.damping);
        let coulomb = friction(&self.coulomb_friction, |joint| joint.friction);
        let stops = if self.joint_stops { arm.joint_limits.clone() } else { vec![] };
        let arm = if arm == *believed { Arc::clone(model) } else { Arc::new(arm.build()?) };
        Ok(Physics { arm, viscous, coulomb, stops, compensates_gravity: false })
    }

    /// Other masses, with the same distribution.
    fn weigh(&self, arm: &mut ArmDescription) -> Result<(), ScenarioError> {
        let Some(masses) = &self.masses else { return Ok(()) };
        length("masses", masses.len(), arm.dof())?;
        for (i, (joint, mass)) in arm.joints.iter_mut().zip(masses).enumerate() {
            number(&format!("masses[{i}]"), *mass, &POSITIVE)?;
            let share = mass / joint.mass;
            joint.mass = *mass;
            joint.inertia.iter_mut().for_each(|moment| *moment *= share);
        }
        Ok(())
    }
}

impl PayloadSpec {
    /// Makes it part of the last link.
    ///
    /// # Errors
    /// If it is no body; then nothing has changed.
    pub fn load(&self, arm: &mut ArmDescription) -> Result<(), ScenarioError> {
        number("mass", self.mass, &NOT_NEGATIVE)?;
        for (i, x) in self.com.iter().enumerate() {
            number(&format!("com[{i}]"), *x, &FINITE)?;
        }
        inertia::check(&self.inertia, self.mass)
            .map_err(|error| ScenarioError::new("inertia", Problem::Other(error.to_string())))?;
        let inertia = tensor(&self.inertia);
        if self.mass == 0.0 && inertia != Matrix3::zeros() {
            let problem = "a body with moments of inertia needs a mass".into();
            return Err(ScenarioError::new("mass", Problem::Other(problem)));
        }
        let tool = arm.tool.into();
        if let Some(last) = arm.joints.last_mut().filter(|_| self.mass > 0.0) {
            let own = Body {
                mass: last.mass,
                com: Vector3::from(last.com),
                inertia: tensor(&last.inertia),
            };
            let load = Body { mass: self.mass, com: Vector3::from(self.com), inertia };
            let Body { mass, com, inertia } = own.joined(&load.moved(&tool));
            (last.mass, last.com, last.inertia) = (mass, com.into(), six(&inertia));
        }
        Ok(())
    }
}
