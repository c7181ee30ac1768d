//! The `[arm]` table of an arm in space: a bundled arm, or all joints one by one, and what is changed of it.

use super::super::error::{Problem, ScenarioError};
use super::super::numbers::each;
use super::LoadSpec;
use crate::math::ScalarOrVec;
use crate::robot::SpatialArm;
use crate::robot::description::{ArmDescription, Frame, Joint, LinkShape};
use crate::robot::models;
use crate::settings::NOT_NEGATIVE;
use serde::Deserialize;

/// An arm in space as the user describes it.
///
/// # Example
/// ```
/// use vff_core::scenario::{PayloadSpec, SpatialArmSpec, SpatialPlantSpec};
///
/// let spec = SpatialArmSpec { model: Some("ur5e".into()), ..SpatialArmSpec::default() };
/// let arm = std::sync::Arc::new(spec.build().unwrap());
/// assert_eq!(arm.dof(), 6);
/// let payload = PayloadSpec { mass: 2.0, ..PayloadSpec::default() };
/// let plant = SpatialPlantSpec { payload, ..SpatialPlantSpec::default() };
/// assert!(plant.build(&spec, &arm).unwrap().arm.total_mass() > arm.total_mass() + 1.9);
/// ```
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpatialArmSpec {
    /// Name of a bundled arm; otherwise `joints` are given.
    pub model: Option<String>,
    /// Name of a URDF file; the Python package reads it and puts `joints` in its place.
    pub urdf: Option<String>,
    /// Name of an MJCF file, likewise.
    pub mjcf: Option<String>,
    /// From the base to the tip, each with its link.
    pub joints: Option<Vec<Joint>>,
    /// What people call it.
    pub name: Option<String>,
    /// The maker's rated payload \[kg\], for information.
    pub payload: Option<f64>,
    /// The maker's reach \[m\], for information.
    pub reach: Option<f64>,
    /// Name of the frame that the first joint is placed in.
    pub base: Option<String>,
    /// Name of the frame at the end.
    pub tip: Option<String>,
    /// The acceleration of free fall in the world \[m/s²\].
    pub gravity: Option<[f64; 3]>,
    /// Where the base stands in the world.
    pub mount: Option<Frame>,
    /// Where the tip is in the frame of the last link.
    pub tool: Option<Frame>,
    /// What the tool carries, and the controller knows of.
    pub load: Option<LoadSpec>,
    /// Inertias of the rotors as the joints feel them \[kg·m² or kg\], one for all or one per joint, ≥ 0.
    pub armature: Option<ScalarOrVec>,
    /// `[lower, upper]` per joint \[rad or m\], infinite where there is none.
    pub joint_limits: Option<Vec<[f64; 2]>>,
    /// Largest speed per joint \[rad/s or m/s\], > 0.
    pub velocity_limits: Option<Vec<f64>>,
    /// Largest torque or force per joint \[N·m or N\], > 0.
    pub torque_limits: Option<Vec<f64>>,
    /// What is measured against obstacles and other links.
    pub collision: Option<Vec<LinkShape>>,
    /// Pairs of links that are never measured against each other, beside neighbours.
    pub ignore: Option<Vec<[String; 2]>>,
}

impl SpatialArmSpec {
    /// The whole description.
    ///
    /// # Errors
    /// If neither a bundled arm nor joints are given, or with the dotted path of the first fault.
    pub fn description(&self) -> Result<ArmDescription, ScenarioError> {
        let other = |problem: String| Problem::Other(problem);
        if self.mjcf.is_some() {
            let problem = "has to be read before the scenario is: vffnull.Scenario does so, and elsewhere \
                           `vffnull arms check robot.xml --toml` prints the `joints` that stand here";
            return Err(ScenarioError::new("mjcf", other(problem.into())));
        }
        if self.urdf.is_some() {
            let problem = "has to be read before the scenario is: vffnull.Scenario does so, and in Rust \
                           `robot::urdf::read` makes the description whose `joints` stand here";
            return Err(ScenarioError::new("urdf", other(problem.into())));
        }
        let mut arm = match (&self.model, &self.joints) {
            (Some(name), None) => models::named(name)
                .map_err(|error| ScenarioError::new("model", other(error.to_string())))?,
            (None, Some(joints)) => {
                ArmDescription { joints: joints.clone(), ..ArmDescription::default() }
            }
            (Some(_), Some(_)) => {
                let problem = "a bundled arm has joints of its own: give `model` or `joints`";
                return Err(ScenarioError::new("joints", other(problem.into())));
            }
            (None, None) => {
                return Err(ScenarioError::new("", Problem::MissingKey("joints".into())));
            }
        };
        let given = self.clone();
        arm.name = given.name.or(arm.name);
        arm.payload = given.payload.or(arm.payload);
        arm.reach = given.reach.or(arm.reach);
        arm.base = given.base.unwrap_or(arm.base);
        arm.tip = given.tip.unwrap_or(arm.tip);
        arm.gravity = given.gravity.unwrap_or(arm.gravity);
        arm.mount = given.mount.unwrap_or(arm.mount);
        arm.tool = given.tool.unwrap_or(arm.tool);
        if let Some(armature) = &given.armature {
            each("armature", armature, arm.joints.len(), &NOT_NEGATIVE)?;
            let joints = arm.joints.iter_mut().enumerate();
            joints.for_each(|(i, joint)| joint.armature = armature.get(i));
        }
        arm.joint_limits = given.joint_limits.unwrap_or(arm.joint_limits);
        arm.velocity_limits = given.velocity_limits.unwrap_or(arm.velocity_limits);
        arm.torque_limits = given.torque_limits.unwrap_or(arm.torque_limits);
        arm.collision = given.collision.unwrap_or(arm.collision);
        arm.ignore.extend(given.ignore.unwrap_or_default());
        let mut arm = arm.checked()?;
        let Some(load) = &self.load else { return Ok(arm) };
        load.fasten(&mut arm).map_err(|error| error.inside("load"))?;
        Ok(arm.checked()?)
    }

    /// The arm.
    ///
    /// # Errors
    /// As [`description`](Self::description).
    pub fn build(&self) -> Result<SpatialArm, ScenarioError> {
        Ok(self.description()?.build()?)
    }
}
