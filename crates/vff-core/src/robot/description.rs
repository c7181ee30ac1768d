//! The explicit description of a spatial arm: the `[arm]` table that needs no other file.
//!
//! Every reader of models (URDF, MJCF, the bundled arms) ends here. Moving joints form one chain from
//! the base to the tip; link `i` is the body that joint `i` moves, and its frame is the frame of that
//! joint. Units are SI, angles radians, quaternions `[w, x, y, z]`.

use super::inertia::{self, tensor};
use super::names;
use super::spatial::SpatialArm;
use crate::geometry::{Hull, HullError};
use crate::math::{Capsule, Vector};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

pub use crate::math::rotation::UNIT_TOLERANCE;

/// A serial arm in space, in full.
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

/// Position \[m\] and orientation of one frame in another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Of the origin \[m\].
    #[serde(default)]
    pub position: [f64; 3],
    /// A unit quaternion `[w, x, y, z]`.
    #[serde(default = "identity")]
    pub orientation: [f64; 4],
}

fn identity() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

impl Default for Frame {
    fn default() -> Self {
        Self { position: [0.0; 3], orientation: identity() }
    }
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

impl From<Isometry3<f64>> for Frame {
    fn from(pose: Isometry3<f64>) -> Self {
        let [x, y, z, w]: [f64; 4] = pose.rotation.coords.into();
        // Of q and −q, the same rotation, the one with w ≥ 0. + 0.0 turns −0 into 0.
        let sign = if w < 0.0 { -1.0 } else { 1.0 };
        Self {
            position: pose.translation.vector.map(|x| x + 0.0).into(),
            orientation: [w, x, y, z].map(|x| sign * x + 0.0),
        }
    }
}

impl From<Frame> for Isometry3<f64> {
    fn from(frame: Frame) -> Self {
        let [w, x, y, z] = frame.orientation;
        Self::from_parts(
            Translation3::from(Vector3::from(frame.position)),
            UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)),
        )
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
    #[serde(default = "identity")]
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

/// A shape on a link; points are in the frame of the named link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkShape {
    /// Name of the link, or of the base.
    pub link: String,
    /// What is there.
    pub shape: Shape,
}

/// What a link looks like to obstacles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// \[m\].
        center: [f64; 3],
        /// \[m\], > 0.
        radius: f64,
    },
    /// A ball swept along a segment.
    Capsule {
        /// One end of the segment \[m\].
        a: [f64; 3],
        /// The other end \[m\].
        b: [f64; 3],
        /// \[m\], > 0.
        radius: f64,
    },
    /// A box.
    Box {
        /// \[m\].
        center: [f64; 3],
        /// Along the three edges \[m\], > 0.
        size: [f64; 3],
        /// Of the edges.
        #[serde(default = "identity")]
        orientation: [f64; 4],
    },
    /// The convex hull of points.
    Convex {
        /// At least 4 \[m\].
        vertices: Vec<[f64; 3]>,
    },
}

/// One fault of a description: where, and what.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{path}: {problem}")]
pub struct DescriptionError {
    /// Dotted path of the value, e.g. `joints[2].axis`.
    pub path: String,
    /// What is wrong there.
    pub problem: DescriptionProblem,
}

/// What is wrong with a value of a description.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DescriptionProblem {
    /// An axis or quaternion of another length than 1.
    #[error("must have length 1 (within {UNIT_TOLERANCE}), has {0}")]
    NotUnit(f64),
    /// Infinite or not a number.
    #[error("must be finite, got {0}")]
    NotFinite(f64),
    /// A number out of its range.
    #[error("must be {requirement}, got {given}")]
    OutOfRange {
        /// What would be right.
        requirement: &'static str,
        /// What was given.
        given: String,
    },
    /// A list of another length.
    #[error("expected {expected} values, one per joint, got {given}")]
    WrongLength {
        /// How many there should be.
        expected: usize,
        /// How many there are.
        given: usize,
    },
    /// Two joints or links of the same name.
    #[error("`{0}` is there twice")]
    Twice(String),
    /// A link that does not exist.
    #[error("there is no link `{given}`{}", names::hint(given, known))]
    UnknownLink {
        /// The name.
        given: String,
        /// The names that exist.
        known: Vec<String>,
    },
    /// A continuous joint with an end.
    #[error("`{0}` is continuous and has no limits: a joint with limits is revolute")]
    ContinuousLimit(String),
    /// Points without a hull that links can carry.
    #[error("must be {0}")]
    Hull(HullError),
    /// An inertia tensor that no mass distribution has.
    #[error("{0}")]
    Inertia(inertia::Impossible),
    /// The last link cannot be accelerated by its joint alone.
    #[error(
        "`{0}`, the last link, has no inertia about its joint: give it a moment of inertia, an \
         armature, or a centre of mass off the axis"
    )]
    NoInertia(String),
}

type Checked = Result<(), DescriptionError>;

fn fault(path: impl Into<String>, problem: DescriptionProblem) -> DescriptionError {
    DescriptionError { path: path.into(), problem }
}

fn finite(path: &str, values: &[f64]) -> Checked {
    match values.iter().find(|x| !x.is_finite()) {
        Some(&x) => Err(fault(path, DescriptionProblem::NotFinite(x))),
        None => Ok(()),
    }
}

fn require(path: &str, value: f64, requirement: &'static str, holds: bool) -> Checked {
    if holds {
        return Ok(());
    }
    let given = format!("{value:?}").replace("NaN", "nan");
    Err(fault(path, DescriptionProblem::OutOfRange { requirement, given }))
}

/// Normalises what is nearly of length 1.
pub(super) fn unit<const N: usize>(values: &mut [f64; N]) -> Result<(), DescriptionProblem> {
    if let Some(&x) = values.iter().find(|x| !x.is_finite()) {
        return Err(DescriptionProblem::NotFinite(x));
    }
    let norm = values.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > UNIT_TOLERANCE {
        return Err(DescriptionProblem::NotUnit(norm));
    }
    if (norm - 1.0).abs() > 4.0 * f64::EPSILON {
        values.iter_mut().for_each(|x| *x /= norm);
    }
    Ok(())
}

impl Frame {
    fn check(&mut self, path: &str) -> Checked {
        finite(&format!("{path}.position"), &self.position)?;
        let orientation = format!("{path}.orientation");
        unit(&mut self.orientation).map_err(|problem| fault(orientation, problem))
    }
}

impl Shape {
    /// The capsule that it is, or the hull and a capsule that holds it, in a frame in which its points are `placed`.
    ///
    /// # Errors
    /// If its points have no hull, with `path`.
    pub(super) fn solid(
        &self,
        path: &str,
        placed: impl Fn(Vector<3>) -> Vector<3>,
    ) -> Result<(Capsule<3>, Option<Hull>), DescriptionError> {
        let round = |a: &[f64; 3], b: &[f64; 3], radius: f64| {
            (swept(placed((*a).into()), placed((*b).into()), radius), None)
        };
        let hull = |key: &str, points: &[[f64; 3]]| {
            let points: Vec<[f64; 3]> =
                points.iter().map(|point| placed((*point).into()).into()).collect();
            let hull = Hull::new(&points)
                .map_err(|error| fault(format!("{path}.{key}"), DescriptionProblem::Hull(error)))?;
            Ok((hull.enclosing(), Some(hull)))
        };
        match self {
            Self::Sphere { center, radius } => Ok(round(center, center, *radius)),
            Self::Capsule { a, b, radius } => Ok(round(a, b, *radius)),
            Self::Box { center, size, orientation } => {
                let frame = Isometry3::from(Frame { position: *center, orientation: *orientation });
                let corner = |bits: u8| {
                    let sign = |k: u8| if bits >> k & 1 == 0 { -0.5 } else { 0.5 };
                    let [x, y, z] = *size;
                    let corner = nalgebra::Point3::new(sign(0) * x, sign(1) * y, sign(2) * z);
                    frame.transform_point(&corner).coords.into()
                };
                hull("size", &(0..8u8).map(corner).collect::<Vec<_>>())
            }
            Self::Convex { vertices } => hull("vertices", vertices),
        }
    }

    fn check(&mut self, path: &str) -> Checked {
        let at = |key: &str| format!("{path}.{key}");
        let round = |radius: f64| {
            require(&at("radius"), radius, "finite and > 0", radius > 0.0 && radius.is_finite())
        };
        match self {
            Self::Sphere { center, radius } => {
                finite(&at("center"), center)?;
                round(*radius)
            }
            Self::Capsule { a, b, radius } => {
                finite(&at("a"), a)?;
                finite(&at("b"), b)?;
                round(*radius)
            }
            Self::Box { center, size, orientation } => {
                finite(&at("center"), center)?;
                for &mut x in size {
                    require(&at("size"), x, "finite and > 0", x > 0.0 && x.is_finite())?;
                }
                unit(orientation).map_err(|problem| fault(at("orientation"), problem))
            }
            Self::Convex { vertices } => {
                if vertices.len() < 4 {
                    let given = format!("{}", vertices.len());
                    let requirement = "at least 4 points";
                    let problem = DescriptionProblem::OutOfRange { requirement, given };
                    return Err(fault(at("vertices"), problem));
                }
                finite(&at("vertices"), vertices.as_flattened())
            }
        }
    }
}

/// The capsule between two points, which may be the same: a sphere has no direction, any will do.
fn swept(start: Vector<3>, end: Vector<3>, radius: f64) -> Capsule<3> {
    let along = end - start;
    let length = along.norm();
    let direction = if length > 0.0 { along / length } else { Vector::<3>::z() };
    Capsule { start, direction, length, radius }
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
        for (i, LinkShape { link, shape }) in self.collision.iter_mut().enumerate() {
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
