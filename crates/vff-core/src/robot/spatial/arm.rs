//! What a spatial arm is made of, checked once and prepared for the recursions.

use super::algebra::Symmetric;
use super::{ArmError, SpatialState};
use crate::math::rotation::{UNIT_TOLERANCE, UnitQuaternion};
use crate::math::{Capsule, Vector};
use crate::robot::Limits;
use nalgebra::Matrix3;
use std::collections::HashSet;
use std::sync::Arc;

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum JointKind {
    /// Turns about its axis \[rad\].
    #[default]
    Revolute,
    /// Turns about its axis without an end \[rad\].
    Continuous,
    /// Slides along its axis \[m\].
    Prismatic,
}

/// Where a frame is in another one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Position of its origin \[m\].
    pub position: Vector<3>,
    /// Its orientation as a unit quaternion \[w, x, y, z\].
    pub orientation: [f64; 4],
}

impl Default for Placement {
    fn default() -> Self {
        Self { position: Vector::zeros(), orientation: [1.0, 0.0, 0.0, 0.0] }
    }
}

/// A joint and the link that it moves. At zero the link's frame is where the joint is placed.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name of the joint.
    pub name: String,
    /// Name of the link.
    pub link: String,
    /// How it moves.
    pub kind: JointKind,
    /// Where it is in the frame of the link before, for the first one in that of the base.
    pub placement: Placement,
    /// Unit vector of its axis, in its own frame.
    pub axis: Vector<3>,
    /// Mass of the link \[kg\], > 0.
    pub mass: f64,
    /// Centre of mass in the link's frame \[m\].
    pub com: Vector<3>,
    /// Inertia about the centre of mass in the link's axes: xx, yy, zz, xy, xz, yz \[kg·m²\].
    pub inertia: [f64; 6],
    /// Inertia of the drive as the joint feels it, ≥ 0 \[kg·m², of a prismatic joint kg\].
    pub armature: f64,
}

/// A capsule, or a sphere where both ends are one, that a link carries against collisions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// Index of the link.
    pub link: usize,
    /// First end of the axis in the link's frame \[m\].
    pub a: Vector<3>,
    /// Second end \[m\].
    pub b: Vector<3>,
    /// Distance from the axis to the surface \[m\], ≥ 0.
    pub radius: f64,
}

/// Everything an arm is made of.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Description {
    /// The joints from base to tip, each with its link.
    pub joints: Vec<Joint>,
    /// Where the base is in the world.
    pub mount: Placement,
    /// Where the tool is in the frame of the last link.
    pub tool: Placement,
    /// The acceleration of free fall in the world \[m/s²\].
    pub gravity: Vector<3>,
    /// What the joints can do; a joint without an end has infinite limits of position.
    pub limits: Limits,
    /// What is measured against obstacles.
    pub bodies: Vec<Body>,
}

/// The immutable parameters of a spatial arm, shared by every state.
#[derive(Debug, Clone, PartialEq)]
pub struct SpatialArm {
    description: Description,
    pub(super) fixed: Vec<Fixed>,
    pub(super) tool: Frame,
    pub(super) bodies: Vec<FixedBody>,
    /// The pairs of bodies that must not touch: of links that share no joint.
    pub(super) pairs: Vec<[usize; 2]>,
    total_mass: f64,
}

/// Where a frame is in another one, as the recursions use it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Frame {
    pub rotation: Matrix3<f64>,
    pub position: Vector<3>,
}

/// What is constant of a joint and its link, in a frame of the link whose z axis is the joint's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fixed {
    /// Where the joint is in the aligned frame of the link before; of the first one, from the base
    /// in world axes.
    pub placement: Frame,
    pub slides: bool,
    pub armature: f64,
    pub mass: f64,
    pub com: Vector<3>,
    /// Inertia about the centre of mass.
    pub central: Symmetric,
    /// Turns the aligned frame into the link's own: its columns are the aligned axes in the latter.
    pub alignment: Matrix3<f64>,
}

/// A [`Body`] in the aligned frame of its link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FixedBody {
    pub link: usize,
    pub capsule: Capsule<3>,
}

impl SpatialArm {
    /// Checks a description and prepares it.
    ///
    /// Axes and quaternions are normalised if their norm is within 1e-6 of 1. The triangle
    /// inequality of the principal moments of inertia may fail by rounding, 1e-6 of the largest.
    ///
    /// # Errors
    /// When something in it is no arm: see [`ArmError`].
    pub fn new(mut description: Description) -> Result<Self, ArmError> {
        validate(&mut description)?;
        let mount = orientation(&description.mount, || "the mount".into())?;
        let mut fixed = Vec::with_capacity(description.joints.len());
        // The first joint stands in world axes, the others in the aligned frame of the link before.
        let mut before = mount.matrix().transpose();
        for joint in &description.joints {
            let own = orientation(&joint.placement, || format!("joint `{}`", joint.name))?;
            let alignment = aligned(&joint.axis);
            let inward = before.transpose();
            let link = alignment.transpose();
            fixed.push(Fixed {
                placement: Frame {
                    rotation: inward * own.matrix() * alignment,
                    position: inward * joint.placement.position,
                },
                slides: joint.kind == JointKind::Prismatic,
                armature: joint.armature,
                mass: joint.mass,
                com: link * joint.com,
                central: tensor(&joint.inertia).turned(&link),
                alignment,
            });
            before = alignment;
        }
        let inward = before.transpose();
        let tool = orientation(&description.tool, || "the tool".into())?;
        let bodies: Vec<_> = description
            .bodies
            .iter()
            .map(|body| {
                let inward = fixed[body.link].alignment.transpose();
                let (start, along) = (inward * body.a, inward * (body.b - body.a));
                let length = along.norm();
                // A sphere has no direction: any will do.
                let direction = if length > 0.0 { along / length } else { Vector::<3>::z() };
                let capsule = Capsule { start, direction, length, radius: body.radius };
                FixedBody { link: body.link, capsule }
            })
            .collect();
        Ok(Self {
            tool: Frame {
                rotation: inward * tool.matrix(),
                position: inward * description.tool.position,
            },
            pairs: pairs(&bodies),
            bodies,
            total_mass: description.joints.iter().map(|joint| joint.mass).sum(),
            fixed,
            description,
        })
    }

    /// What it was made of, axes normalised.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// The number of joints.
    pub fn dof(&self) -> usize {
        self.fixed.len()
    }

    /// Names of the joints from base to tip.
    pub fn joint_names(&self) -> impl Iterator<Item = &str> {
        self.description.joints.iter().map(|joint| joint.name.as_str())
    }

    /// Names of the links that move, from base to tip.
    pub fn link_names(&self) -> impl Iterator<Item = &str> {
        self.description.joints.iter().map(|joint| joint.link.as_str())
    }

    /// The mass of all links that move \[kg\].
    pub fn total_mass(&self) -> f64 {
        self.total_mass
    }

    /// The acceleration of free fall \[m/s²\].
    pub fn gravity(&self) -> Vector<3> {
        self.description.gravity
    }

    /// What the joints can do.
    pub fn limits(&self) -> &Limits {
        &self.description.limits
    }

    /// The position of the base in the world \[m\].
    #[inline]
    pub fn base(&self) -> &Vector<3> {
        &self.description.mount.position
    }

    /// Advances a configuration along the joint velocity `v` for the time `dt`.
    pub fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64) {
        q.iter_mut().zip(v).for_each(|(q, v)| *q += v * dt);
    }

    /// A state of this arm at q = 0, at rest.
    pub fn state(self: &Arc<Self>) -> SpatialState {
        SpatialState::new(Arc::clone(self))
    }
}

/// The pairs of bodies on links that share no joint, the lower index first.
fn pairs(bodies: &[FixedBody]) -> Vec<[usize; 2]> {
    let apart = |[i, j]: &[usize; 2]| bodies[*i].link.abs_diff(bodies[*j].link) > 1;
    let all = (0..bodies.len()).flat_map(|j| (0..j).map(move |i| [i, j]));
    all.filter(apart).collect()
}

pub(super) fn tensor(inertia: &[f64; 6]) -> Symmetric {
    let [xx, yy, zz, xy, xz, yz] = *inertia;
    Symmetric { diagonal: Vector::<3>::new(xx, yy, zz), off: Vector::<3>::new(xy, xz, yz) }
}

/// The smallest rotation that takes the z axis to `axis`; of the opposite one, that about x. Its
/// entries are exact for every axis along a coordinate.
fn aligned(axis: &Vector<3>) -> Matrix3<f64> {
    let (x, y, z) = (axis.x, axis.y, axis.z);
    if x == 0.0 && y == 0.0 {
        return Matrix3::from_diagonal(&Vector::<3>::new(1.0, z.signum(), z.signum()));
    }
    // On the lower half through the opposite axis, so that 1 + |z| stays away from zero.
    let sign = if z < 0.0 { -1.0 } else { 1.0 };
    let (x, y, z) = (x * sign, y * sign, z * sign);
    let k = 1.0 / (1.0 + z);
    let upper = Matrix3::new(
        1.0 - x * x * k,
        -x * y * k,
        x, //
        -x * y * k,
        1.0 - y * y * k,
        y, //
        -x,
        -y,
        z,
    );
    upper * Matrix3::from_diagonal(&Vector::<3>::new(1.0, sign, sign))
}

fn orientation(
    placement: &Placement,
    what: impl Fn() -> String,
) -> Result<UnitQuaternion, ArmError> {
    UnitQuaternion::new(placement.orientation)
        .map_err(|error| ArmError::Orientation { what: what(), norm: error.norm })
}

/// Refuses what is no arm, and normalises the axes and the quaternions.
fn validate(description: &mut Description) -> Result<(), ArmError> {
    let Description { joints, mount, tool, gravity, limits, bodies } = description;
    if joints.is_empty() {
        return Err(ArmError::Empty);
    }
    finite(gravity.as_slice(), || "the acceleration of free fall".into())?;
    place(mount, || "the mount".into())?;
    place(tool, || "the tool".into())?;
    let (mut names, mut links) = (HashSet::new(), HashSet::new());
    for joint in joints.iter_mut() {
        for (what, name, seen) in
            [("joint", &joint.name, &mut names), ("link", &joint.link, &mut links)]
        {
            if !seen.insert(name.clone()) {
                return Err(ArmError::DuplicateName { what, name: name.clone() });
            }
        }
        validate_joint(joint)?;
    }
    validate_limits(limits, joints)?;
    for (index, body) in bodies.iter().enumerate() {
        let what = || format!("every coordinate of collision body {index}");
        finite(body.a.as_slice(), what)?;
        finite(body.b.as_slice(), what)?;
        finite(&[body.radius], || format!("the radius of collision body {index}"))?;
        if body.link >= joints.len() {
            let (link, links) = (body.link, joints.len());
            return Err(ArmError::BodyLink { body: index, link, links });
        }
        if body.radius < 0.0 {
            return Err(ArmError::BodyRadius { body: index, radius: body.radius });
        }
    }
    Ok(())
}

fn finite(numbers: &[f64], what: impl Fn() -> String) -> Result<(), ArmError> {
    if numbers.iter().all(|x| x.is_finite()) {
        Ok(())
    } else {
        Err(ArmError::NotFinite { what: what() })
    }
}

fn place(placement: &mut Placement, what: impl Fn() -> String) -> Result<(), ArmError> {
    finite(placement.position.as_slice(), || format!("every coordinate of {}", what()))?;
    finite(&placement.orientation, || format!("every component of the orientation of {}", what()))?;
    placement.orientation = orientation(placement, what)?.to_array();
    Ok(())
}

fn validate_joint(joint: &mut Joint) -> Result<(), ArmError> {
    let Joint { name, link, kind, placement, axis, mass, com, inertia, armature } = joint;
    place(placement, || format!("joint `{name}`"))?;
    finite(axis.as_slice(), || format!("every component of the axis of joint `{name}`"))?;
    finite(&[*mass], || format!("the mass of link `{link}`"))?;
    finite(com.as_slice(), || format!("every coordinate of the centre of mass of link `{link}`"))?;
    finite(inertia, || format!("every component of the inertia of link `{link}`"))?;
    finite(&[*armature], || format!("the armature of joint `{name}`"))?;
    let norm = axis.norm();
    if (norm - 1.0).abs() > UNIT_TOLERANCE {
        return Err(ArmError::Axis { joint: name.clone(), norm });
    }
    *axis /= norm;
    if *mass <= 0.0 {
        return Err(ArmError::Mass { link: link.clone(), mass: *mass });
    }
    if *armature < 0.0 {
        return Err(ArmError::Armature { joint: name.clone(), armature: *armature });
    }
    let central = tensor(inertia);
    let mut moments: [f64; 3] = central.matrix().symmetric_eigenvalues().into();
    moments.sort_by(f64::total_cmp);
    let rounding = UNIT_TOLERANCE * moments[2].abs();
    if moments[0] < -rounding {
        return Err(ArmError::NegativeInertia { link: link.clone(), moment: moments[0] });
    }
    if moments[2] - moments[0] - moments[1] > rounding {
        return Err(ArmError::TriangleInequality { link: link.clone(), moments });
    }
    let about_axis = axis.dot(&central.mul(axis)) + *mass * axis.cross(com).norm_squared();
    if *kind != JointKind::Prismatic && about_axis + *armature <= 0.0 {
        return Err(ArmError::NoInertia { joint: name.clone(), link: link.clone() });
    }
    Ok(())
}

fn validate_limits(limits: &Limits, joints: &[Joint]) -> Result<(), ArmError> {
    let count = |what, given: usize| {
        if given == 0 || given == joints.len() {
            Ok(())
        } else {
            Err(ArmError::LimitCount { what, given, joints: joints.len() })
        }
    };
    count("position", limits.joint.len())?;
    count("velocity", limits.velocity.len())?;
    count("torque", limits.torque.len())?;
    for (joint, [lower, upper]) in joints.iter().zip(&limits.joint) {
        let ends = lower.is_finite() || upper.is_finite();
        if joint.kind == JointKind::Continuous && ends {
            return Err(ArmError::ContinuousLimit { joint: joint.name.clone() });
        }
        if lower.partial_cmp(upper) != Some(std::cmp::Ordering::Less) {
            let (lower, upper) = (*lower, *upper);
            return Err(ArmError::LimitOrder { joint: joint.name.clone(), lower, upper });
        }
    }
    for (what, values) in [("velocity", &limits.velocity), ("torque", &limits.torque)] {
        for (joint, limit) in joints.iter().zip(values) {
            if limit.is_nan() || *limit <= 0.0 {
                return Err(ArmError::LimitSign { what, joint: joint.name.clone(), limit: *limit });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::spatial::cases::link;
    use proptest::prelude::*;

    fn arm(change: impl Fn(&mut Description)) -> Result<SpatialArm, ArmError> {
        let joints = vec![link("upper", 1.0), link("fore", 0.8)];
        let mut description = Description { joints, ..Description::default() };
        change(&mut description);
        SpatialArm::new(description)
    }

    fn refused(change: impl Fn(&mut Description)) -> String {
        arm(change).expect_err("this is no arm").to_string()
    }

    /// Every refusal names what is wrong and by how much.
    #[test]
    fn what_is_no_arm_is_refused() {
        assert!(arm(|_| ()).is_ok());
        assert_eq!(refused(|d| d.joints.clear()), "an arm needs at least one joint");
        assert_eq!(
            refused(|d| d.joints[1].mass = f64::NAN),
            "the mass of link `fore` must be a finite number"
        );
        assert_eq!(
            refused(|d| d.joints[1].mass = 0.0),
            "link `fore` has a mass of 0 kg; a link that moves needs a mass above 0"
        );
        assert_eq!(
            refused(|d| d.joints[0].inertia = [1.0, 1.5, 3.0, 0.0, 0.0, 0.0]),
            "the inertia of link `upper` belongs to no distribution of mass: its largest principal \
             moment 3 kg·m² exceeds the sum of the other two, 1 + 1.5, by 0.5"
        );
        assert_eq!(
            refused(|d| d.joints[0].inertia = [-1.0, 1.5, 3.0, 0.0, 0.0, 0.0]),
            "the inertia of link `upper` has the principal moment -1 kg·m², which must not be negative"
        );
        assert_eq!(
            refused(|d| d.joints[1].axis = Vector::<3>::new(0.0, 2.0, 0.0)),
            "the axis of joint `fore_joint` has length 2, which must be 1 within 0.000001"
        );
        assert_eq!(
            refused(|d| d.joints[1].placement.orientation = [0.0; 4]),
            "the orientation of joint `fore_joint` has norm 0, which must be 1 within 0.000001"
        );
        assert!(
            refused(|d| d.tool.orientation[1] = 0.1).starts_with("the orientation of the tool")
        );
        assert!(
            refused(|d| d.mount.orientation[2] = 0.1).starts_with("the orientation of the mount")
        );
        assert!(
            refused(|d| d.mount.position.x = f64::INFINITY)
                .starts_with("every coordinate of the mount")
        );
        assert!(refused(|d| d.gravity.z = f64::NAN).contains("free fall"));
        assert_eq!(refused(|d| d.joints[1].link = "upper".into()), "two links are called `upper`");
        assert_eq!(
            refused(|d| d.joints[1].armature = -0.1),
            "the armature of joint `fore_joint` is -0.1, which must not be negative"
        );
        assert!(
            refused(|d| {
                d.joints[1].inertia = [0.0; 6];
                d.joints[1].com = d.joints[1].axis * 0.3;
            })
            .contains("without inertia")
        );
        assert_eq!(
            refused(|d| d.limits.torque = vec![1.0]),
            "there are 1 torque limits for 2 joints"
        );
        assert!(refused(|d| d.limits.velocity = vec![1.0, 0.0]).contains("velocity limit"));
        assert!(refused(|d| d.limits.joint = vec![[0.0, 1.0], [1.0, 1.0]]).contains("below"));
        assert!(
            refused(|d| {
                d.joints[0].kind = JointKind::Continuous;
                d.limits.joint = vec![[-1.0, 1.0], [-1.0, 1.0]];
            })
            .contains("continuous")
        );
        let body = Body { link: 2, a: Vector::zeros(), b: Vector::zeros(), radius: 0.1 };
        assert_eq!(
            refused(|d| d.bodies = vec![body]),
            "collision body 0 is on link 2, but the arm has 2 links"
        );
        assert!(
            refused(|d| d.bodies = vec![Body { link: 0, radius: -0.1, ..body }]).contains("radius")
        );
    }

    /// Rounded digits are no fault: norms within 1e-6 are made 1.
    #[test]
    fn nearly_unit_is_normalised() {
        let arm = arm(|d| {
            d.joints[0].axis *= 1.0 + 5e-7;
            d.tool.orientation = [0.6 + 5e-7, 0.0, -0.8, 0.0];
        })
        .unwrap();
        let Description { joints, tool, .. } = arm.description();
        assert!((joints[0].axis.norm() - 1.0).abs() < 1e-15);
        assert!((tool.orientation.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-15);
    }

    proptest! {
        /// The aligned frame is a rotation whose z axis is the joint's, also close to both poles.
        #[test]
        fn alignment(x in -1.0..1.0_f64, y in -1.0..1.0, z in -1.0..1.0, power in 0..17_i32) {
            let flat = 10.0_f64.powi(-power);
            let axis = Vector::<3>::new(x * flat, y * flat, z).try_normalize(1e-12);
            let Some(axis) = axis else { return Err(TestCaseError::reject("no axis")) };
            let q = aligned(&axis);
            prop_assert!((q * Vector::<3>::z() - axis).norm() < 1e-15);
            prop_assert!((q.transpose() * q - Matrix3::identity()).norm() < 2e-15);
            prop_assert!((q.determinant() - 1.0).abs() < 2e-15);
        }
    }
}
