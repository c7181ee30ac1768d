//! A spatial arm at (q, q̇): positions, velocities and the factorisation of M.

use super::SpatialArm;
use super::algebra::{ArticulatedInertia, Inertia, Spatial};
use super::arm::{Fixed, FixedBody, Frame};
use super::joint::{Joint, Tool};
use super::task::{TaskForces, force, rows};
use crate::geometry::{Body, PlacedHull};
use crate::math::{Capsule, UnitQuaternion, Vector, sin_cos, unit_vectors};
use crate::robot::Robot;
use nalgebra::{Matrix3, SMatrix, SVector};
use std::sync::Arc;

/// A [`SpatialArm`] at (q, q̇). Allocated once, refreshed by [`Robot::update`].
#[derive(Debug, Clone)]
pub struct SpatialState {
    pub(super) arm: Arc<SpatialArm>,
    pub(super) q: Vec<f64>,
    pub(super) dq: Vec<f64>,
    pub(super) joints: Vec<Joint>,
    pub(super) tool: Tool,
}

impl SpatialState {
    pub(super) fn new(arm: Arc<SpatialArm>) -> Self {
        let n = arm.dof();
        let tool = Tool {
            rotation: Matrix3::identity(),
            position: Vector::zeros(),
            velocity: Vector::zeros(),
        };
        let joints = vec![Joint::ZERO; n];
        let mut state = Self { arm, q: vec![0.0; n], dq: vec![0.0; n], joints, tool };
        state.update(&vec![0.0; n], &vec![0.0; n]);
        state
    }

    /// The parameters of this arm.
    pub fn arm(&self) -> &Arc<SpatialArm> {
        &self.arm
    }

    /// The position of the tool in the world \[m\].
    pub fn position(&self) -> Vector<3> {
        self.arm.base() + self.tool.position
    }

    /// The orientation of the tool in the world.
    pub fn orientation(&self) -> UnitQuaternion {
        UnitQuaternion::from_matrix(&self.tool.rotation)
    }

    /// The axes of the tool in the world, one per column.
    pub fn tool_axes(&self) -> &Matrix3<f64> {
        &self.tool.rotation
    }

    /// The position of the origin of joint `i` in the world \[m\]; `i = n` is the tool.
    pub fn joint_position(&self, i: usize) -> Vector<3> {
        self.arm.base() + self.joints.get(i).map_or(self.tool.position, |joint| joint.position)
    }

    /// The unit vector along joint `i`, whichever it is in the frame of its link.
    pub fn joint_axis(&self, i: usize) -> Vector<3> {
        self.joints[i].rotation.column(2).into()
    }

    /// Whether joint `i` slides.
    pub fn slides(&self, i: usize) -> bool {
        self.arm.fixed[i].slides
    }

    /// The axes of the frame of link `i` in the world, one per column.
    pub fn link_axes(&self, i: usize) -> Matrix3<f64> {
        self.joints[i].rotation * self.arm.fixed[i].alignment.transpose()
    }

    /// Body `k` in the world.
    #[inline]
    pub fn body(&self, k: usize) -> Body<'_, 3> {
        let FixedBody { link, capsule, hull, carried: is_load } = &self.arm.bodies[k];
        let Joint { rotation, position, .. } = &self.joints[*link];
        let Capsule { start, direction, length, radius } = *capsule;
        let origin = self.arm.base() + position;
        let (start, direction) = (origin + rotation * start, rotation * direction);
        let carried = |hull| PlacedHull { hull, rotation, position: origin };
        Body {
            link: *link,
            shape: Capsule { start, direction, length, radius },
            hull: hull.as_deref().map(carried),
            is_load: *is_load,
        }
    }

    /// The joints and two joint vectors, all of one length: spares the loops their bounds checks.
    #[inline(always)]
    pub(super) fn with<'a>(
        &'a self,
        v: &'a [f64],
        out: &'a mut [f64],
    ) -> (&'a [Joint], &'a [f64], &'a mut [f64]) {
        let n = self.joints.len();
        (&self.joints, &v[..n], &mut out[..n])
    }

    /// Base to tip: positions, twists and their rates (T84), and the inertias in world axes.
    pub(super) fn move_to(&mut self, q: &[f64], dq: &[f64]) {
        self.q.copy_from_slice(q);
        self.dq.copy_from_slice(dq);
        self.turn(q);
        let (mut frame, mut velocity, mut acceleration) =
            (Frame::WORLD, Spatial::ZERO, Spatial::ZERO);
        let n = self.joints.len();
        let fixed = &self.arm.fixed[..n];
        for (((joint, fixed), q), dq) in self.joints.iter_mut().zip(fixed).zip(q).zip(dq) {
            joint.place(fixed, &mut frame, *q);
            joint.s_rate = velocity.cross(&joint.s);
            velocity += joint.s * *dq;
            acceleration += joint.s_rate * *dq;
            (joint.velocity, joint.acceleration) = (velocity, acceleration);
            let com = joint.position + joint.rotation * fixed.com;
            joint.inertia = Inertia::new(fixed.mass, &com, fixed.central.turned(&joint.rotation));
        }
        self.place_tool(&frame);
        self.tool.velocity = velocity.velocity_at(&self.tool.position);
    }

    /// Positions alone.
    pub(super) fn move_positions(&mut self, q: &[f64]) {
        self.q.copy_from_slice(q);
        self.turn(q);
        let mut frame = Frame::WORLD;
        for ((joint, fixed), q) in self.joints.iter_mut().zip(&self.arm.fixed).zip(q) {
            joint.place(fixed, &mut frame, *q);
        }
        self.place_tool(&frame);
    }

    /// All the sines, which wait for nothing.
    fn turn(&mut self, q: &[f64]) {
        let (pairs, rest) = self.joints.as_chunks_mut::<2>();
        let (q, last) = q.as_chunks::<2>();
        for (joints, q) in pairs.iter_mut().zip(q) {
            [joints[0].turn, joints[1].turn] = unit_vectors(q[0], q[1]);
        }
        for (joint, q) in rest.iter_mut().zip(last) {
            let (sin, cos) = sin_cos(*q);
            joint.turn = [cos, sin];
        }
    }

    fn place_tool(&mut self, last: &Frame) {
        let Frame { rotation, position } = self.arm.tool;
        self.tool.rotation = last.rotation * rotation;
        self.tool.position = last.position + last.rotation * position;
    }

    /// Tip to base: the factorisation of M alone.
    pub(super) fn factorise(&mut self) {
        let mut outer = ArticulatedInertia::default();
        for (joint, fixed) in self.joints.iter_mut().zip(&self.arm.fixed).rev() {
            joint.factorise(&mut outer, fixed.armature);
        }
    }

    /// Factorisation and half solves in one sweep: the first waits for its divisions, the second
    /// fills the time.
    pub(super) fn factorise_with_response<const M: usize>(
        &mut self,
        y: &mut [SVector<f64, M>],
    ) -> SMatrix<f64, M, M> {
        let mut forces = TaskForces::new(&self.tool);
        let mut outer = ArticulatedInertia::default();
        let links = self.joints.iter_mut().zip(&self.arm.fixed);
        for ((joint, fixed), y) in links.zip(y.iter_mut()).rev() {
            joint.factorise(&mut outer, fixed.armature);
            forces.take_in(joint, y);
        }
        TaskForces::yield_forward(&self.joints, y);
        forces.lambda_inv
    }
}

impl Frame {
    pub(super) const WORLD: Self = Self {
        rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        position: Vector::<3>::new(0.0, 0.0, 0.0),
    };
}

impl Joint {
    /// Goes on from the frame of the link before to that of this one.
    #[inline(always)]
    fn place(&mut self, fixed: &Fixed, frame: &mut Frame, q: f64) {
        let placed = frame.rotation * fixed.placement.rotation;
        let axis: Vector<3> = placed.column(2).into();
        let mut position = frame.position + frame.rotation * fixed.placement.position;
        if fixed.slides {
            position += axis * q;
            self.rotation = placed;
            self.s = Spatial::new(Vector::zeros(), axis);
        } else {
            let [cos, sin] = self.turn;
            let (x, y) = (placed.column(0), placed.column(1));
            self.rotation = Matrix3::from_columns(&[x * cos + y * sin, y * cos - x * sin, axis]);
            self.s = Spatial::new(axis, position.cross(&axis));
        }
        self.position = position;
        *frame = Frame { rotation: self.rotation, position };
    }

    /// Takes its link into the articulated inertia, and lets itself yield (T88).
    #[inline(always)]
    pub(super) fn factorise(&mut self, outer: &mut ArticulatedInertia, armature: f64) {
        outer.add(&self.inertia);
        let u = outer.mul(&self.s);
        let d_inv = 1.0 / (self.s.dot(&u) + armature);
        outer.release(&u, d_inv);
        (self.u, self.d_inv) = (u * d_inv, d_inv);
    }
}

impl SpatialState {
    /// J v of a twist V of the last link.
    #[inline(always)]
    pub(super) fn task_of<const M: usize>(&self, twist: &Spatial) -> SVector<f64, M> {
        rows(&self.tool, &twist.velocity_at(&self.tool.position), &twist.angular)
    }

    /// J̇ v of the twist Σ s v of the last link and of Σ ṡ v.
    #[inline(always)]
    pub(super) fn task_rate_of<const M: usize>(
        &self,
        twist: &Spatial,
        rate: &Spatial,
    ) -> SVector<f64, M> {
        let Tool { rotation, position, velocity } = &self.tool;
        let linear = rate.velocity_at(position) + twist.angular.cross(velocity);
        let mut out: SVector<f64, M> = rows(&self.tool, &linear, &rate.angular);
        if M == 5 {
            // The axes of these rows turn with the tool.
            let carried = twist.angular.cross(&self.tool_rate());
            for k in 0..2 {
                out[3 + k] += carried.dot(&rotation.column(k));
            }
        }
        out
    }

    /// Angular velocity of the tool.
    #[inline(always)]
    pub(crate) fn tool_rate(&self) -> Vector<3> {
        self.joints.last().map_or(Vector::zeros(), |joint| joint.velocity.angular)
    }

    /// The wrench about the base of a task force.
    #[inline(always)]
    pub(super) fn task_wrench<const M: usize>(&self, f: &SVector<f64, M>) -> Spatial {
        let (force, moment) = force(&self.tool, f);
        Spatial::at(&self.tool.position, force, moment)
    }

    /// What the motion of the tool adds to J̇ᵀ f beside ṡ·F: a moment.
    #[inline(always)]
    pub(super) fn task_wrench_rate<const M: usize>(&self, f: &SVector<f64, M>) -> Vector<3> {
        let (force, moment) = force(&self.tool, f);
        let carried = self.tool.velocity.cross(&force);
        if M == 5 { carried + self.tool_rate().cross(&moment) } else { carried }
    }
}
