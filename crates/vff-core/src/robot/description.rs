//! The explicit description of a spatial arm: the `[arm]` table that needs no other file.
//!
//! Every reader of models (URDF, MJCF, the bundled arms) ends here. Moving joints form one chain from
//! the base to the tip; link `i` is the body that joint `i` moves, and its frame is the frame of that
//! joint. Units are SI, angles radians, quaternions `[w, x, y, z]`.

use super::description_error::{Checked, fault, finite, require, unit};
use super::inertia::{self, tensor};
use super::spatial::SpatialArm;
use crate::math::upright;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

pub use super::description_error::{DescriptionError, DescriptionProblem};
pub use super::frame::Frame;
pub use super::link_shape::{LinkShape, PlacedShape};
pub use crate::math::rotation::UNIT_TOLERANCE;

/// A serial arm in space, in full.
///
/// # Example
/// ```
/// use vff_core::geometry::Shape;
/// use vff_core::robot::description::{ArmDescription, DescriptionProblem, Frame, Joint, JointKind, LinkShape};
///
/// let pendulum = Joint {
///     name: "shoulder".into(),
///     link: "upper".into(),
///     kind: JointKind::Revolute,
///     position: [0.0; 3],
///     orientation: [1.0, 0.0, 0.0, 0.0],
///     axis: [0.0, 1.0, 0.0],
///     mass: 2.0,
///     com: [0.0, 0.0, 0.2],
///     inertia: [0.02, 0.02, 0.001, 0.0, 0.0, 0.0],
///     armature: 0.0,
///     damping: 0.0,
///     friction: 0.0,
/// };
/// let rod = Shape::Capsule { a: [0.0; 3], b: [0.0, 0.0, 0.4], radius: 0.04 };
/// let description = ArmDescription {
///     joints: vec![pendulum],
///     tool: Frame { position: [0.0, 0.0, 0.4], ..Frame::default() },
///     collision: vec![LinkShape::of("upper", rod)],
///     ..ArmDescription::default()
/// };
/// let mut heavy = description.clone();
/// heavy.joints[0].mass = -1.0;
/// let error = heavy.build().unwrap_err();
/// assert_eq!(error.path, "joints[0].mass");
/// assert!(matches!(error.problem, DescriptionProblem::OutOfRange { .. }));
/// assert_eq!(description.build().unwrap().dof(), 1);
/// ```
///
/// # See also
/// [`models::named`](super::models::named) has arms that people have, [`urdf::read`](super::urdf::read) reads others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmDescription {
    /// What people call it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The maker's rated payload \[kg\], for information.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub payload: Option<f64>,
    /// The maker's reach \[m\], for information.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<f64>,
    /// Name of the frame that the first joint is placed in.
    #[serde(default = "base")]
    pub base: String,
    /// Name of the frame at the end.
    #[serde(default = "tip")]
    pub tip: String,
    /// Gravity \[m/s²\], in the world.
    #[serde(default = "gravity")]
    pub gravity: [f64; 3],
    /// `[lower, upper]` per joint \[rad or m\], infinite where there is none; empty for no limits.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joint_limits: Vec<[f64; 2]>,
    /// Largest speed per joint \[rad/s or m/s\], > 0; empty for no limits.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub velocity_limits: Vec<f64>,
    /// Largest torque or force per joint \[N·m or N\], > 0; empty for no limits.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub torque_limits: Vec<f64>,
    /// Pairs of links that are never measured against each other, beside neighbours.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ignore: Vec<[String; 2]>,
    /// Where the base stands in the world.
    #[serde(default)]
    pub mount: Frame,
    /// Where the tip is in the frame of the last link.
    #[serde(default)]
    pub tool: Frame,
    /// From the base to the tip.
    pub joints: Vec<Joint>,
    /// What is measured against obstacles and other links.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub collision: Vec<LinkShape>,
}

fn base() -> String {
    "base".into()
}

fn tip() -> String {
    "tip".into()
}

fn gravity() -> [f64; 3] {
    [0.0, 0.0, -9.81]
}

/// No joint yet, at the origin of the world.
impl Default for ArmDescription {
    fn default() -> Self {
        Self {
            name: None,
            payload: None,
            reach: None,
            base: base(),
            tip: tip(),
            gravity: gravity(),
            joint_limits: vec![],
            velocity_limits: vec![],
            torque_limits: vec![],
            ignore: vec![],
            mount: Frame::default(),
            tool: Frame::default(),
            joints: vec![],
            collision: vec![],
        }
    }
}

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JointKind {
    /// Turns about its axis.
    Revolute,
    /// Turns about its axis without end.
    Continuous,
    /// Slides along its axis.
    Prismatic,
}

/// A joint and the link that it moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// Of the joint.
    pub name: String,
    /// Name of the link that it moves; the joint's own by default.
    #[serde(default)]
    pub link: String,
    /// How it moves.
    pub kind: JointKind,
    /// Origin at q = 0 in the frame of the link before \[m\].
    #[serde(default)]
    pub position: [f64; 3],
    /// Orientation at q = 0 in the frame of the link before.
    #[serde(default = "upright")]
    pub orientation: [f64; 4],
    /// Unit vector in the joint's frame.
    #[serde(default = "z")]
    pub axis: [f64; 3],
    /// Of the link \[kg\], > 0.
    pub mass: f64,
    /// Centre of mass in the link's frame \[m\].
    #[serde(default)]
    pub com: [f64; 3],
    /// `[xx, yy, zz, xy, xz, yz]` about the centre of mass, in the link's axes \[kg·m²\].
    pub inertia: [f64; 6],
    /// Inertia of the rotor, as seen by the joint \[kg·m² or kg\].
    #[serde(default)]
    pub armature: f64,
    /// Viscous friction \[N·m·s/rad or N·s/m\].
    #[serde(default)]
    pub damping: f64,
    /// Dry friction \[N·m or N\].
    #[serde(default)]
    pub friction: f64,
}

fn z() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

impl Joint {
    /// Pose of the joint's frame at q = 0 in the frame of the link before.
    pub fn origin(&self) -> Frame {
        Frame { position: self.position, orientation: self.orientation }
    }

    fn check(&mut self, path: &str) -> Checked {
        let at = |key: &str| format!("{path}.{key}");
        finite(&at("position"), &self.position)?;
        unit(&mut self.orientation).map_err(|problem| fault(at("orientation"), problem))?;
        unit(&mut self.axis).map_err(|problem| fault(at("axis"), problem))?;
        let mass = self.mass;
        require(&at("mass"), mass, "finite and > 0", mass > 0.0 && mass.is_finite())?;
        finite(&at("com"), &self.com)?;
        finite(&at("inertia"), &self.inertia)?;
        inertia::check(&self.inertia, mass)
            .map_err(|problem| fault(at("inertia"), DescriptionProblem::Inertia(problem)))?;
        for (key, x) in
            [("armature", self.armature), ("damping", self.damping), ("friction", self.friction)]
        {
            require(&at(key), x, "finite and ≥ 0", x >= 0.0 && x.is_finite())?;
        }
        Ok(())
    }

    /// Inertia of the link about (or mass along) the axis of its own joint, with the armature.
    fn effective_inertia(&self) -> f64 {
        let axis = Vector3::from(self.axis);
        let about = match self.kind {
            JointKind::Prismatic => self.mass,
            JointKind::Revolute | JointKind::Continuous => {
                let arm = axis.cross(&Vector3::from(self.com));
                axis.dot(&(tensor(&self.inertia) * axis)) + self.mass * arm.norm_squared()
            }
        };
        about + self.armature
    }
}

impl ArmDescription {
    /// Number of moving joints.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Names of the base and of the moving links, in order.
    pub fn link_names(&self) -> Vec<String> {
        let links = self.joints.iter().map(|joint| joint.link.clone());
        std::iter::once(self.base.clone()).chain(links).collect()
    }

    /// The arm ready for computations.
    ///
    /// # Errors
    /// With the path of the first value that is wrong; see [`SpatialArm::new`].
    pub fn build(self) -> Result<SpatialArm, DescriptionError> {
        SpatialArm::new(self)
    }

    /// The same with axes and quaternions of length 1 and a name for every link.
    ///
    /// # Errors
    /// With the path of the first value that is wrong.
    pub fn checked(mut self) -> Result<Self, DescriptionError> {
        let n = self.dof();
        if n == 0 {
            let requirement = "at least one joint";
            let problem = DescriptionProblem::OutOfRange { requirement, given: "none".into() };
            return Err(fault("joints", problem));
        }
        for (i, joint) in self.joints.iter_mut().enumerate() {
            if joint.link.is_empty() {
                joint.link.clone_from(&joint.name);
            }
            joint.check(&format!("joints[{i}]"))?;
        }
        twice("joints", self.joints.iter().map(|joint| &joint.name))?;
        let links = self.link_names();
        twice("joints", links.iter())?;
        let last = &self.joints[n - 1];
        // 1e-12 kg·m²: a ball of a milligram and a millimetre has 4e-13.
        if last.effective_inertia() <= 1e-12 {
            let problem = DescriptionProblem::NoInertia(last.link.clone());
            return Err(fault(format!("joints[{}]", n - 1), problem));
        }
        finite("gravity", &self.gravity)?;
        self.mount.check("mount")?;
        self.tool.check("tool")?;
        for (key, value) in [("payload", self.payload), ("reach", self.reach)] {
            let value = value.unwrap_or(1.0);
            require(key, value, "finite and ≥ 0", value >= 0.0 && value.is_finite())?;
        }
        self.check_limits(n)?;
        let known = |name: &str, path: String| match links.iter().any(|link| link == name) {
            true => Ok(()),
            false => {
                let (given, known) = (name.into(), links.clone());
                Err(fault(path, DescriptionProblem::UnknownLink { given, known }))
            }
        };
        for (i, LinkShape { link, shape, .. }) in self.collision.iter_mut().enumerate() {
            known(link, format!("collision[{i}].link"))?;
            shape.check(&format!("collision[{i}].shape"))?;
        }
        for (i, name) in self
            .ignore
            .iter()
            .enumerate()
            .flat_map(|(i, pair)| pair.iter().map(move |name| (i, name)))
        {
            known(name, format!("ignore[{i}]"))?;
        }
        Ok(self)
    }

    fn check_limits(&self, n: usize) -> Checked {
        let length = |path: &str, given: usize| match given == 0 || given == n {
            true => Ok(()),
            false => Err(fault(path, DescriptionProblem::WrongLength { expected: n, given })),
        };
        length("joint_limits", self.joint_limits.len())?;
        for (i, ([lower, upper], joint)) in self.joint_limits.iter().zip(&self.joints).enumerate() {
            if joint.kind == JointKind::Continuous && (lower.is_finite() || upper.is_finite()) {
                let problem = DescriptionProblem::ContinuousLimit(joint.name.clone());
                return Err(fault(format!("joint_limits[{i}]"), problem));
            }
            if lower.partial_cmp(upper) != Some(std::cmp::Ordering::Less) {
                let given = format!("[{lower:?}, {upper:?}]").replace("NaN", "nan");
                let problem =
                    DescriptionProblem::OutOfRange { requirement: "lower < upper", given };
                return Err(fault(format!("joint_limits[{i}]"), problem));
            }
        }
        let limits =
            [("velocity_limits", &self.velocity_limits), ("torque_limits", &self.torque_limits)];
        for (path, values) in limits {
            length(path, values.len())?;
            for (i, &x) in values.iter().enumerate() {
                require(&format!("{path}[{i}]"), x, "> 0", x > 0.0)?;
            }
        }
        Ok(())
    }
}

fn twice<'a>(path: &str, names: impl Iterator<Item = &'a String>) -> Checked {
    let mut seen = std::collections::BTreeSet::new();
    for name in names {
        if !seen.insert(name) {
            return Err(fault(path, DescriptionProblem::Twice(name.clone())));
        }
    }
    Ok(())
}
