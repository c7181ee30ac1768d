//! Where an arm is at a configuration, for people and for planning: these allocate.

use super::{SpatialArm, SpatialState};
use crate::math::{UnitQuaternion, Vector};
use crate::robot::Robot;
use crate::robot::dense::TaskMatrix;
use nalgebra::Matrix4;
use std::f64::consts::PI;
use std::sync::Arc;

impl SpatialArm {
    /// The origins of all joints, then the tool, in the world: n + 1 points \[m\].
    pub fn forward_kinematics(self: &Arc<Self>, q: &[f64]) -> Vec<Vector<3>> {
        let state = self.placed(q);
        (0..=self.dof()).map(|i| state.joint_position(i)).collect()
    }

    /// The frame of every link in the world, homogeneous.
    pub fn link_poses(self: &Arc<Self>, q: &[f64]) -> Vec<Matrix4<f64>> {
        let state = self.placed(q);
        (0..self.dof()).map(|i| state.link_pose(i)).collect()
    }

    /// Position \[m\] and orientation of the tool in the world.
    pub fn pose(self: &Arc<Self>, q: &[f64]) -> (Vector<3>, UnitQuaternion) {
        let state = self.placed(q);
        (state.position(), state.orientation())
    }

    /// J, (6, n): linear rows, then angular ones, in world axes at the tool.
    pub fn jacobian(self: &Arc<Self>, q: &[f64]) -> TaskMatrix<6> {
        self.placed(q).jacobian()
    }

    /// J̇ at the joint velocity `dq`, (6, n).
    pub fn jacobian_dot(self: &Arc<Self>, q: &[f64], dq: &[f64]) -> TaskMatrix<6> {
        let mut state = self.state();
        state.update(q, dq);
        let columns: Vec<_> = (0..self.dof()).map(|i| state.jacobian_dot_column::<6>(i)).collect();
        TaskMatrix::<6>::from_columns(&columns)
    }

    /// A distance from the base \[m\] that the tool cannot exceed: all placements in one line, and
    /// prismatic joints at their limits; infinite where such a joint has none.
    pub fn reach_bound(&self) -> f64 {
        self.stretched(|i| self.range(i).map(f64::abs).into_iter().fold(0.0, f64::max))
    }

    /// The same with every prismatic joint as far from 0 as `slid` says \[m\].
    pub(crate) fn stretched(&self, slid: impl Fn(usize) -> f64) -> f64 {
        let description = self.description();
        let links: f64 = (description.joints.iter().zip(&self.fixed).enumerate())
            .map(|(i, (joint, fixed))| {
                let slide = if fixed.slides { slid(i) } else { 0.0 };
                Vector::from(joint.position).norm() + slide
            })
            .sum();
        links + Vector::from(description.tool.position).norm()
    }

    /// The greatest distance of the tool from the base \[m\] among `samples` configurations within
    /// the limits, spread evenly and the same in every call. Never more than
    /// [`reach_bound`](Self::reach_bound). Joints that turn without limits are taken all around,
    /// those that slide without limits are left at 0.
    pub fn reach_sampled(self: &Arc<Self>, samples: usize) -> f64 {
        let (mut state, n) = (self.state(), self.dof());
        let mut q = vec![0.0; n];
        let mut farthest = 0.0_f64;
        for k in 0..samples {
            for (i, q) in q.iter_mut().enumerate() {
                let [lower, upper] = match self.range(i) {
                    range if range.iter().all(|x| x.is_finite()) => range,
                    _ if self.fixed[i].slides => [0.0, 0.0],
                    _ => [-PI, PI],
                };
                *q = lower + (upper - lower) * spread(k, i, n);
            }
            state.update_positions(&q);
            farthest = farthest.max((state.position() - self.base()).norm());
        }
        farthest
    }

    /// The limits of position of joint `i`, infinite where it has none.
    fn range(&self, i: usize) -> [f64; 2] {
        self.limits().joint.get(i).copied().unwrap_or([f64::NEG_INFINITY, f64::INFINITY])
    }

    fn placed(self: &Arc<Self>, q: &[f64]) -> SpatialState {
        let mut state = self.state();
        state.update_positions(q);
        state
    }
}

impl SpatialState {
    /// The frame of link `i` in the world, homogeneous.
    pub fn link_pose(&self, i: usize) -> Matrix4<f64> {
        let mut pose = self.link_axes(i).to_homogeneous();
        pose.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.joint_position(i));
        pose
    }

    /// J at this configuration, (6, n): linear rows, then angular ones, in world axes at the tool.
    pub fn jacobian(&self) -> TaskMatrix<6> {
        let columns: Vec<_> = (0..self.dof()).map(|i| self.jacobian_column::<6>(i)).collect();
        TaskMatrix::<6>::from_columns(&columns)
    }
}

/// Coordinate `i` of point `k` of a sequence that fills the unit cube of `n` dimensions evenly
/// (Kronecker's, with powers of the root of xⁿ⁺¹ = x + 1).
fn spread(k: usize, i: usize, n: usize) -> f64 {
    let mut root = 1.0_f64;
    for _ in 0..40 {
        root = (1.0 + root).powf(1.0 / (n as f64 + 1.0));
    }
    (0.5 + k as f64 * root.powi(-(i as i32 + 1))).fract()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use crate::robot::Model;
    use crate::robot::description::{ArmDescription, Frame, JointKind, LinkShape, PlacedShape};
    use crate::robot::spatial::cases::{case, link};
    use crate::robot::spatial::dense;
    use crate::testing::assert_close;
    use proptest::prelude::*;

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Frames and points are those of chained homogeneous transforms, from the description.
        #[test]
        fn poses_are_chained_transforms(c in case(1usize..13)) {
            let chain = dense::chain(&c.arm, &c.q);
            let points = c.arm.forward_kinematics(&c.q);
            for ((placed, pose), point) in chain.iter().zip(c.arm.link_poses(&c.q)).zip(&points) {
                assert_close(pose.as_slice(), placed.link.to_homogeneous().as_slice(), 1e-13);
                assert_close(point.as_slice(), placed.link.translation.vector.as_slice(), 1e-13);
            }
            let (position, orientation) = c.arm.pose(&c.q);
            prop_assert_eq!(points[c.q.len()], position);
            let tool = &c.arm.description().tool;
            let last = chain[c.q.len() - 1].link;
            let expected = last * nalgebra::Point3::from(Vector::from(tool.position));
            assert_close(position.as_slice(), expected.coords.as_slice(), 1e-13);
            let own = UnitQuaternion::new(tool.orientation).unwrap().matrix();
            let axes = last.rotation.to_rotation_matrix().into_inner() * own;
            assert_close(orientation.matrix().as_slice(), axes.as_slice(), 1e-13);
            let dense = dense::matrices::<6>(&c.arm, &c.q, &c.dq);
            assert_close(c.arm.jacobian(&c.q).as_slice(), dense.jacobian.as_slice(), 1e-12);
            let rate = c.arm.jacobian_dot(&c.q, &c.dq);
            assert_close(rate.as_slice(), dense.jacobian_dot.as_slice(), 1e-12);
        }

        /// No tool is farther out than the bound.
        #[test]
        fn reach_is_bounded(c in case(1usize..9)) {
            let bound = c.arm.reach_bound();
            prop_assert!(c.arm.reach_sampled(50) <= bound * (1.0 + 1e-14));
        }
    }

    /// A stretched arm with limits: the bound is met where all is in line, prismatic joints out.
    #[test]
    fn reach_of_a_line() {
        let mut joints = vec![link("upper", 1.0), link("fore", 0.8), link("slide", 0.1)];
        joints[1].position[0] = 1.0;
        joints[2].position[0] = 0.8;
        joints[2].kind = JointKind::Prismatic;
        joints[2].axis = [1.0, 0.0, 0.0];
        let tool = Frame { position: [0.2, 0.0, 0.0], ..Frame::default() };
        let mut description = ArmDescription { joints, tool, ..ArmDescription::default() };
        let unlimited = Arc::new(SpatialArm::new(description.clone()).unwrap());
        assert!(unlimited.reach_bound().is_infinite());
        assert!((unlimited.stretched(|_| 0.1) - 2.1).abs() < 1e-15);
        assert!(unlimited.typical_torque().iter().all(|torque| torque.is_finite()));
        let length = unlimited.characteristic_length();
        description.joint_limits = vec![[-1.0, 1.0], [-0.5, 0.5], [0.0, 0.4]];
        let arm = Arc::new(SpatialArm::new(description).unwrap());
        assert!((arm.reach_bound() - 2.4).abs() < 1e-15);
        // A sixth of links and tool, however far the joint slides.
        for length in [length, arm.characteristic_length()] {
            assert!((length - 2.0 / 6.0).abs() < 1e-15);
        }
        let sampled = arm.reach_sampled(2000);
        assert!((2.35..=2.4).contains(&sampled), "{sampled}");
    }

    /// Bodies go along with their links; a sphere has no length.
    #[test]
    fn bodies_are_carried() {
        let mut joints = vec![link("upper", 1.0), link("fore", 0.8)];
        joints[1].position[0] = 1.0;
        joints[1].axis = [1.0, 0.0, 0.0];
        let (a, b) = ([0.1, 0.0, 0.0], [0.1, 0.0, 0.5]);
        let carried = |link: &str, shape: PlacedShape| LinkShape::of(link, shape);
        let ball = Shape::Sphere { radius: 0.1 };
        let collision = vec![
            carried("fore", Shape::Capsule { a, b, radius: 0.05 }.into()),
            carried("upper", PlacedShape { center: Some(a), ..ball.into() }),
        ];
        let mount = Frame { position: [0.0, 0.0, 2.0], ..Frame::default() };
        let description = ArmDescription { joints, mount, collision, ..ArmDescription::default() };
        let mut state = Arc::new(SpatialArm::new(description).unwrap()).state();
        state.update_positions(&[0.5 * PI, 0.5 * PI]);
        let carried: Vec<_> = state.bodies().collect();
        // The first joint turns x into y; the second turns z about it, into x.
        let crate::geometry::Body { link, shape: capsule, .. } = carried[0];
        assert_eq!((link, capsule.radius), (1, 0.05));
        assert_close(capsule.start.as_slice(), &[0.0, 1.1, 2.0], 1e-15);
        assert_close(capsule.end().as_slice(), &[0.5, 1.1, 2.0], 1e-15);
        let crate::geometry::Body { link, shape: sphere, .. } = carried[1];
        assert_eq!((link, sphere.length), (0, 0.0));
        assert_close(sphere.start.as_slice(), &[0.0, 0.1, 2.0], 1e-15);
        assert_close(sphere.end().as_slice(), &[0.0, 0.1, 2.0], 1e-15);
    }
}
