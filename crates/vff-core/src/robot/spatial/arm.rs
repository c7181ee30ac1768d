//! What a spatial arm is made of, checked once and prepared for the recursions.

use super::SpatialState;
use super::algebra::Symmetric;
use crate::geometry::{Hull, StillBody};
use crate::math::rotation::UnitQuaternion;
use crate::math::{Capsule, Vector};
use crate::robot::Limits;
use crate::robot::description::{
    ArmDescription, DescriptionError, DescriptionProblem, JointKind, LinkShape,
};
use nalgebra::Matrix3;
use std::sync::Arc;

/// The immutable parameters of a spatial arm, shared by every state.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::robot::spatial::Mobility;
/// use vff_core::robot::{Robot, SpatialArm, SpatialState, models};
///
/// let arm = Arc::new(SpatialArm::new(models::named("panda").unwrap()).unwrap());
/// let (position, _) = arm.pose(&[0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]);
/// assert!(position.norm() < arm.reach_bound());
/// let mut state: SpatialState = arm.state();
/// state.update(&[0.0; 7], &[0.1; 7]);
/// assert_eq!(state.jacobian().ncols(), 7);
/// assert!(state.body_count() > 7);
/// let mut mobilities = vec![Mobility::default(); 7];
/// state.mobilities(&mut mobilities);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SpatialArm {
    description: ArmDescription,
    limits: Limits,
    base: Vector<3>,
    gravity: Vector<3>,
    pub(super) fixed: Vec<Fixed>,
    pub(super) tool: Frame,
    pub(super) bodies: Vec<FixedBody>,
    /// Bodies of the base, in the world.
    pub(super) still: Vec<StillBody<3>>,
    /// The pairs of bodies that must not touch, the still ones behind the others: of links that share no joint and are not
    /// to be ignored.
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

/// A capsule, a sphere where both ends are one, or a hull with a capsule around it, in the aligned frame of its link.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FixedBody {
    pub link: usize,
    pub capsule: Capsule<3>,
    pub hull: Option<Box<Hull>>,
    /// Whether it is of something that the link carries.
    pub carried: bool,
}

impl SpatialArm {
    /// Checks a description and prepares it.
    ///
    /// Axes and quaternions are normalised if their norm is within 1 % of 1. The shapes of links become what is measured; those
    /// of the base, which does not move, are measured against links alone.
    ///
    /// # Errors
    /// With the path of the first value that is wrong.
    pub fn new(description: ArmDescription) -> Result<Self, DescriptionError> {
        let description = description.checked()?;
        let mount = orientation(description.mount.orientation)?;
        let mut fixed = Vec::with_capacity(description.joints.len());
        // The first joint stands in world axes, the others in the aligned frame of the link before.
        let mut before = mount.matrix().transpose();
        for joint in &description.joints {
            let alignment = aligned(&joint.axis.into());
            let inward = before.transpose();
            let link = alignment.transpose();
            fixed.push(Fixed {
                placement: Frame {
                    rotation: inward * orientation(joint.orientation)?.matrix() * alignment,
                    position: inward * Vector::from(joint.position),
                },
                slides: joint.kind == JointKind::Prismatic,
                armature: joint.armature,
                mass: joint.mass,
                com: link * Vector::from(joint.com),
                central: tensor(&joint.inertia).turned(&link),
                alignment,
            });
            before = alignment;
        }
        let inward = before.transpose();
        let links = description.link_names();
        let (mut bodies, mut still) = (vec![], vec![]);
        for (i, LinkShape { link, shape, carried }) in description.collision.iter().enumerate() {
            let path = format!("collision[{i}].shape");
            // The base comes first.
            if let Some(link) = links[1..].iter().position(|name| name == link) {
                let inward = fixed[link].alignment.transpose();
                let (capsule, hull) = shape.solid(&path, |point| inward * point)?;
                bodies.push(FixedBody {
                    link,
                    capsule,
                    hull: hull.map(Box::new),
                    carried: *carried,
                });
            } else {
                let position = Vector::from(description.mount.position);
                let (shape, hull) = shape.solid(&path, |point| mount.rotate(&point) + position)?;
                let placed = |hull| (hull, Matrix3::identity(), Vector::zeros());
                still.push(StillBody { shape, hull: hull.map(placed) });
            }
        }
        Ok(Self {
            tool: Frame {
                rotation: inward * orientation(description.tool.orientation)?.matrix(),
                position: inward * Vector::from(description.tool.position),
            },
            pairs: pairs(&bodies, still.len(), &links, &description.ignore),
            bodies,
            still,
            total_mass: description.joints.iter().map(|joint| joint.mass).sum(),
            limits: Limits {
                joint: description.joint_limits.clone(),
                velocity: description.velocity_limits.clone(),
                torque: description.torque_limits.clone(),
            },
            base: description.mount.position.into(),
            gravity: description.gravity.into(),
            fixed,
            description,
        })
    }

    /// What it was made of, axes normalised.
    pub fn description(&self) -> &ArmDescription {
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
        self.gravity
    }

    /// What the joints can do.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The position of the base in the world \[m\].
    #[inline]
    pub fn base(&self) -> &Vector<3> {
        &self.base
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

/// The pairs of bodies on links that share no joint, the lower index first, without those to `ignore`, which are said of the links
/// themselves and not of what they carry. `links` begins with the base, whose bodies have the indices behind those of the others.
fn pairs(
    bodies: &[FixedBody],
    still: usize,
    links: &[String],
    ignore: &[[String; 2]],
) -> Vec<[usize; 2]> {
    let ignored = |i: usize, j: usize| {
        let named = |name: &String, link: usize| *name == links[link];
        let both =
            |[a, b]: &[String; 2]| (named(a, i) && named(b, j)) || (named(a, j) && named(b, i));
        ignore.iter().any(both)
    };
    // Counted from the base.
    let link = |i: usize| bodies.get(i).map_or(0, |body| body.link + 1);
    let carried = |i: usize| bodies.get(i).is_some_and(|body| body.carried);
    let apart = |[i, j]: &[usize; 2]| {
        let is_carried = carried(*i) || carried(*j);
        let (i, j) = (link(*i), link(*j));
        i.abs_diff(j) > 1 && (is_carried || !ignored(i, j))
    };
    let all = (0..bodies.len() + still).flat_map(|j| (0..j).map(move |i| [i, j]));
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

/// Of a quaternion that was checked before.
fn orientation(quaternion: [f64; 4]) -> Result<UnitQuaternion, DescriptionError> {
    UnitQuaternion::new(quaternion).map_err(|error| DescriptionError {
        path: "orientation".into(),
        problem: DescriptionProblem::NotUnit(error.norm),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use crate::robot::spatial::cases::link;
    use proptest::prelude::*;

    fn arm(change: impl Fn(&mut ArmDescription)) -> Result<SpatialArm, DescriptionError> {
        let joints = vec![link("upper", 1.0), link("fore", 0.8)];
        let mut description = ArmDescription { joints, ..ArmDescription::default() };
        change(&mut description);
        description.build()
    }

    fn refused(change: impl Fn(&mut ArmDescription)) -> String {
        arm(change).expect_err("this is no arm").to_string()
    }

    fn carried(link: &str, shape: Shape) -> LinkShape {
        LinkShape::of(link, shape)
    }

    fn sphere(link: &str, radius: f64) -> LinkShape {
        carried(link, Shape::Sphere { radius })
    }

    /// Every refusal names what is wrong and by how much.
    #[test]
    fn what_is_no_arm_is_refused() {
        assert!(arm(|_| ()).is_ok());
        assert_eq!(refused(|d| d.joints.clear()), "joints: must be at least one joint, got none");
        assert_eq!(
            refused(|d| d.joints[1].mass = f64::NAN),
            "joints[1].mass: must be finite and > 0, got nan"
        );
        assert_eq!(
            refused(|d| d.joints[1].mass = 0.0),
            "joints[1].mass: must be finite and > 0, got 0.0"
        );
        let fault = refused(|d| d.joints[0].inertia = [1.0, 1.5, 3.0, 0.0, 0.0, 0.0]);
        assert!(fault.starts_with("joints[0].inertia: no distribution of mass"), "{fault}");
        assert!(fault.ends_with("by 5.000e-1 kg·m²"), "{fault}");
        assert!(
            refused(|d| d.joints[0].inertia = [-1.0, 1.5, 3.0, 0.0, 0.0, 0.0])
                .starts_with("joints[0].inertia")
        );
        assert_eq!(
            refused(|d| d.joints[1].axis = [0.0, 2.0, 0.0]),
            "joints[1].axis: must have length 1 (within 0.01), has 2"
        );
        assert_eq!(
            refused(|d| d.joints[1].orientation = [0.0; 4]),
            "joints[1].orientation: must have length 1 (within 0.01), has 0"
        );
        assert!(refused(|d| d.tool.orientation[1] = 0.2).starts_with("tool.orientation"));
        assert!(refused(|d| d.mount.orientation[2] = 0.2).starts_with("mount.orientation"));
        assert!(
            refused(|d| d.mount.position[0] = f64::INFINITY)
                .starts_with("mount.position: must be finite")
        );
        assert!(refused(|d| d.gravity[2] = f64::NAN).starts_with("gravity"));
        assert!(refused(|d| d.joints[1].link = "upper".into()).contains("`upper` is there twice"));
        assert!(refused(|d| d.joints[1].armature = -0.1).starts_with("joints[1].armature"));
        assert!(
            refused(|d| {
                d.joints[1].inertia = [0.0; 6];
                d.joints[1].com = d.joints[1].axis.map(|x| 0.3 * x);
            })
            .contains("has no inertia about its joint")
        );
        assert_eq!(
            refused(|d| d.torque_limits = vec![1.0]),
            "torque_limits: expected 2 values, one per joint, got 1"
        );
        assert!(refused(|d| d.velocity_limits = vec![1.0, 0.0]).starts_with("velocity_limits[1]"));
        assert!(
            refused(|d| d.joint_limits = vec![[0.0, 1.0], [1.0, 1.0]]).contains("lower < upper")
        );
        assert!(
            refused(|d| {
                d.joints[0].kind = JointKind::Continuous;
                d.joint_limits = vec![[-1.0, 1.0], [-1.0, 1.0]];
            })
            .contains("continuous")
        );
        assert!(refused(|d| d.collision = vec![sphere("hand", 0.1)]).contains("no link `hand`"));
        assert!(
            refused(|d| d.collision = vec![sphere("fore", -0.1)])
                .contains("collision[0].shape.radius")
        );
    }

    /// Links and the base carry what is round, and hulls with a capsule around them; what has no hull is refused.
    #[test]
    fn links_carry_what_is_round_and_hulls() {
        let cube = Shape::Box { size: [0.1; 3] };
        let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
        let fault = refused(|d| {
            d.collision = vec![
                sphere("upper", 0.1),
                carried("fore", Shape::Convex { vertices: vertices.clone() }),
            ];
        });
        assert!(fault.starts_with("collision[1].shape.vertices: must be points that do not lie"));
        let arm = arm(|d| {
            d.collision = vec![
                carried("base", cube.clone()),
                sphere("base", 0.2),
                sphere("fore", 0.1),
                carried("fore", cube.clone()),
            ];
        })
        .unwrap();
        let bodies: Vec<_> =
            arm.bodies.iter().map(|body| (body.link, body.hull.is_some())).collect();
        assert_eq!(bodies, [(1, false), (1, true)]);
        let still: Vec<_> = arm.still.iter().map(|body| body.hull.is_some()).collect();
        assert_eq!(still, [true, false]);
        // The first link is the neighbour of the base.
        assert_eq!(arm.pairs, [[0, 2], [1, 2], [0, 3], [1, 3]]);
        assert_eq!(arm.description().collision.len(), 4);
    }

    /// Neighbours are never measured against each other, and neither are pairs to be ignored, in either order.
    #[test]
    fn pairs_that_are_ignored() {
        let names = ["a", "b", "c", "d"];
        let build = |ignore: &[[&str; 2]]| {
            let description = ArmDescription {
                joints: names.map(|name| link(name, 1.0)).to_vec(),
                collision: ["b", "a", "d", "c", "a"].map(|name| sphere(name, 0.1)).to_vec(),
                ignore: ignore.iter().map(|pair| pair.map(String::from)).collect(),
                ..ArmDescription::default()
            };
            description.build().unwrap().pairs
        };
        assert_eq!(build(&[]), [[0, 2], [1, 2], [1, 3], [2, 4], [3, 4]]);
        assert_eq!(build(&[["d", "a"], ["base", "b"]]), [[0, 2], [1, 3], [3, 4]]);
    }

    /// Rounded digits are no fault: norms within 1 % are made 1.
    #[test]
    fn nearly_unit_is_normalised() {
        let arm = arm(|d| {
            d.joints[0].axis = [0.0, 0.0, 1.0 + 5e-7];
            d.tool.orientation = [0.6 + 5e-7, 0.0, -0.8, 0.0];
        })
        .unwrap();
        let ArmDescription { joints, tool, .. } = arm.description();
        let norm = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((norm(&joints[0].axis) - 1.0).abs() < 1e-15);
        assert!((norm(&tool.orientation) - 1.0).abs() < 1e-15);
    }

    properties! {
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
