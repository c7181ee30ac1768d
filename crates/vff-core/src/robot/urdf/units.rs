//! Numbers that are likely to be in other units than radians, metres and kilograms: they are read as they stand, and told of.

use super::super::description::{ArmDescription, Joint, JointKind};
use super::super::inertia::tensor;
use super::super::names::list;
use nalgebra::{SymmetricEigen, Vector3};
use std::f64::consts::PI;

/// No joint with stops turns farther than twice around either way \[rad\].
const FARTHEST: f64 = 4.0 * PI;

/// No arm is longer \[m\].
const LONGEST: f64 = 20.0;

/// What is odd about the numbers of an arm.
pub(super) fn doubts(arm: &ArmDescription) -> Vec<String> {
    let mut found = vec![];
    let turns = |(i, limits): (usize, &[f64; 2])| {
        let is_far = limits.iter().any(|limit| limit.is_finite() && limit.abs() > FARTHEST);
        (arm.joints[i].kind == JointKind::Revolute && is_far).then(|| &arm.joints[i].name)
    };
    let joints: Vec<_> = arm.joint_limits.iter().enumerate().filter_map(turns).collect();
    if !joints.is_empty() {
        let names = list(&joints);
        found.push(format!(
            "limits of {names} are beyond two turns: they are read as radians; are they degrees?"
        ));
    }
    let places = arm.joints.iter().map(|joint| joint.position).chain([arm.tool.position]);
    let reach: f64 = places.map(|place| Vector3::from(place).norm()).sum();
    if reach > LONGEST {
        found.push(format!(
            "the arm is {reach:.0} m long: lengths are read as metres; are they millimetres?"
        ));
    }
    // Ten times as far from its middle as the arm is long there is nothing of a link.
    let light = |joint: &&Joint| {
        let largest = SymmetricEigen::new(tensor(&joint.inertia)).eigenvalues.max();
        largest > joint.mass * (10.0 * reach.max(1.0)).powi(2)
    };
    let links: Vec<_> = arm.joints.iter().filter(light).map(|joint| &joint.link).collect();
    if !links.is_empty() {
        let names = list(&links);
        found.push(format!(
            "moments of inertia of {names} are too large for their masses: they are read as kg·m²; are they g·mm² or kg·mm²?"
        ));
    }
    found
}
