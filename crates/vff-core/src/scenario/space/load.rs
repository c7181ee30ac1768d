//! What the tool of an arm in space carries, as far as the controller knows of it: a weight, and what can touch something.

use super::super::error::ScenarioError;
use super::PayloadSpec;
use crate::robot::description::{ArmDescription, LinkShape, PlacedShape};
use crate::robot::inertia::{Body, six};
use nalgebra::Isometry3;
use serde::Deserialize;

/// The `[arm.load]` table: a body that is part of the last link from now on, in the frame of the tool. The law weighs it, and
/// every distance counts its shapes: those of barriers, plans, look-ahead and what cameras see of the arm.
///
/// # Example
/// ```
/// use vff_core::geometry::Shape;
/// use vff_core::scenario::{LoadSpec, SpatialArmSpec};
///
/// let tray = Shape::Box { size: [0.3, 0.2, 0.02] };
/// let load = LoadSpec { mass: 0.6, shapes: vec![tray.into()], ..LoadSpec::default() };
/// let bare = SpatialArmSpec { model: Some("panda".into()), ..SpatialArmSpec::default() };
/// let carries = SpatialArmSpec { load: Some(load), ..bare.clone() };
/// let [bare, carries] = [bare, carries].map(|spec| spec.build().unwrap());
/// assert!((carries.total_mass() - bare.total_mass() - 0.6).abs() < 1e-12);
/// assert_eq!(carries.description().collision.len(), bare.description().collision.len() + 1);
/// ```
///
/// # See also
/// [`PayloadSpec`] is what the controller does not know of.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoadSpec {
    /// Mass \[kg\], ≥ 0.
    pub mass: f64,
    /// Centre of mass \[m\]. Default: that of the shapes, as of one material; without any, the tip.
    pub com: Option<[f64; 3]>,
    /// `[xx, yy, zz, xy, xz, yz]` about the centre of mass \[kg·m²\]. Default: that of the shapes, as of one material; without
    /// any, a point's.
    pub inertia: Option<[f64; 6]>,
    /// What is measured against obstacles and links, in the frame of the tool.
    pub shapes: Vec<PlacedShape>,
}

impl LoadSpec {
    /// Makes it part of the last link.
    ///
    /// # Errors
    /// If it is no body; then nothing has changed.
    pub fn fasten(&self, arm: &mut ArmDescription) -> Result<(), ScenarioError> {
        let mut shapes = self.shapes.clone();
        let mut solid = Body::default();
        for (k, shape) in shapes.iter_mut().enumerate() {
            solid = solid.joined(&shape.checked_solid(&format!("shapes[{k}]"))?);
        }
        let share = if solid.mass > 0.0 { self.mass / solid.mass } else { 0.0 };
        let com = self.com.unwrap_or_else(|| solid.com.into());
        let inertia = self.inertia.unwrap_or_else(|| six(&(solid.inertia * share)));
        PayloadSpec { mass: self.mass, com, inertia }.load(arm)?;
        let tool = Isometry3::from(arm.tool);
        if let Some(link) = arm.joints.last().map(|joint| joint.link.clone()) {
            let there = shapes.iter().map(|shape| shape.moved(&tool));
            arm.collision.extend(there.map(|shape| LinkShape {
                link: link.clone(),
                shape,
                carried: true,
            }));
        }
        Ok(())
    }
}
