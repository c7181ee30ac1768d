//! The operators of [`Robot`] on a spatial arm (docs/theory-spatial.md, T84–T89).
//!
//! Backward sweeps give the links' twists up again joint by joint, instead of storing them.

use super::algebra::{ArticulatedInertia, Spatial};
use super::joint::Joint;
use super::state::SpatialState;
use super::task::TaskForces;
use super::{dense, task};
use crate::geometry::{Body, ContactFeature, StillBody, contact_features};
use crate::math::{Pointing, SpatialPose, Vector};
use crate::robot::{Limits, Manipulator, Matrices, Model, Robot, SpatialArm, form_of};
use nalgebra::{SMatrix, SVector};
use std::sync::Arc;

impl SpatialState {
    /// `Σ s v` and `Σ ṡ v` of the last link.
    #[inline(always)]
    fn twist_and_rate(joints: &[Joint], v: &[f64]) -> (Spatial, Spatial) {
        joints.iter().zip(v).fold((Spatial::ZERO, Spatial::ZERO), |(twist, rate), (joint, v)| {
            (twist + joint.s * *v, rate + joint.s_rate * *v)
        })
    }

    #[inline(always)]
    fn twist(joints: &[Joint], v: &[f64]) -> Spatial {
        joints.iter().zip(v).fold(Spatial::ZERO, |twist, (joint, v)| twist + joint.s * *v)
    }

    /// Base to tip, the second half of a solve: what the joints yield to each other.
    #[inline(always)]
    fn yield_forward(joints: &[Joint], out: &mut [f64]) {
        let mut acceleration = Spatial::ZERO;
        for (joint, out) in joints.iter().zip(out) {
            *out -= joint.u.dot(&acceleration);
            acceleration += joint.s * *out;
        }
    }

    /// The force of link `k` while q̈ = 0: I(A − γ) + V ×* I V.
    #[inline(always)]
    fn bias_force(&self, joint: &Joint) -> Spatial {
        let Joint { velocity, acceleration, inertia, .. } = joint;
        // Gravity is an acceleration of the base against it.
        let lifted = Spatial::new(acceleration.angular, acceleration.linear - self.arm.gravity());
        inertia.mul(&lifted) + velocity.cross_wrench(&inertia.mul(velocity))
    }

    /// A point of the world, from the base.
    #[inline(always)]
    fn relative(&self, point: &Vector<3>) -> Vector<3> {
        point - self.arm.base()
    }
}

impl Model<3> for SpatialArm {
    type State = SpatialState;

    fn dof(&self) -> usize {
        self.dof()
    }

    fn limits(&self) -> &Limits {
        self.limits()
    }

    fn slides(&self, joint: usize) -> bool {
        self.fixed[joint].slides
    }

    fn joint_name(&self, joint: usize) -> String {
        self.description().joints[joint].name.clone()
    }

    fn link_name(&self, link: usize) -> String {
        self.description().joints[link].link.clone()
    }

    fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64) {
        self.integrate(q, v, dt);
    }

    fn reach(&self) -> f64 {
        self.reach_bound()
    }

    /// A sixth of the stretched arm: about the size of a hand of it. How far joints slide has nothing to do with that.
    fn characteristic_length(&self) -> f64 {
        match self.stretched(|_| 0.0) {
            length if length > 0.0 => length / 6.0,
            _ => 1.0,
        }
    }

    /// At q = 0, every joint accelerates at 4 rad/s² (or m/s²) against all of gravity; one that slides without end is not slid out.
    fn typical_torque(self: &Arc<Self>) -> Vec<f64> {
        const ACCELERATION: f64 = 4.0;
        let n = self.dof();
        let mut state = self.state();
        state.update(&vec![0.0; n], &vec![0.0; n]);
        let mass = state.matrices::<3>().mass;
        let slid = |i: usize| {
            let ends = self.limits().joint.get(i).into_iter().flatten();
            ends.map(|end| end.abs()).filter(|end| end.is_finite()).fold(0.0, f64::max)
        };
        let weight = self.gravity().norm() * self.total_mass() * self.stretched(slid);
        (0..n).map(|i| ACCELERATION * mass[(i, i)] + weight).collect()
    }

    fn state(self: &Arc<Self>) -> SpatialState {
        SpatialArm::state(self)
    }
}

/// A task of position.
impl Manipulator<3, 3> for SpatialState {
    type Pose = Vector<3>;

    #[inline]
    fn pose(&self) -> Vector<3> {
        self.position()
    }
}

/// A task of position and of the direction of the tool's z axis.
impl Manipulator<3, 5> for SpatialState {
    type Pose = Pointing;

    fn pose(&self) -> Pointing {
        Pointing(SpatialPose::new(self.position(), self.orientation()))
    }

    fn resolve(
        &self,
        reference: &Pointing,
        dx: &SVector<f64, 5>,
        ddx: &SVector<f64, 5>,
    ) -> [SVector<f64, 5>; 2] {
        let tool = Manipulator::<3, 5>::pose(self);
        reference.resolve(&tool, &self.tool_rate(), dx, ddx)
    }

    fn motion(&self, ddq: &[f64]) -> [SVector<f64, 5>; 2] {
        let [dx, ddx] = Manipulator::<3, 6>::motion(self, ddq);
        Manipulator::<3, 5>::pose(self).seen_in_world_axes(&dx, &ddx)
    }
}

/// A task of position and orientation.
impl Manipulator<3, 6> for SpatialState {
    type Pose = SpatialPose;

    fn pose(&self) -> SpatialPose {
        SpatialPose::new(self.position(), self.orientation())
    }

    fn resolve(
        &self,
        _reference: &SpatialPose,
        dx: &SVector<f64, 6>,
        ddx: &SVector<f64, 6>,
    ) -> [SVector<f64, 6>; 2] {
        SpatialPose::resolve(&self.tool_rate(), dx, ddx)
    }
}

impl Robot<3> for SpatialState {
    type Wrench = Spatial;

    #[inline]
    fn dof(&self) -> usize {
        self.joints.len()
    }

    fn update(&mut self, q: &[f64], dq: &[f64]) {
        self.move_to(q, dq);
        self.factorise();
    }

    fn update_positions(&mut self, q: &[f64]) {
        self.move_positions(q);
    }

    fn update_velocities(&mut self, v: &[f64]) {
        let mut velocity = Spatial::ZERO;
        for (joint, v) in self.joints.iter_mut().zip(v) {
            velocity += joint.s * *v;
            joint.velocity = velocity;
        }
    }

    fn configuration(&self) -> &[f64] {
        &self.q
    }

    fn velocity(&self) -> &[f64] {
        &self.dq
    }

    fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64) {
        self.arm.integrate(q, v, dt);
    }

    fn total_mass(&self) -> f64 {
        self.arm.total_mass()
    }

    fn limits(&self) -> &Limits {
        self.arm.limits()
    }

    fn mass_mul(&self, v: &[f64], out: &mut [f64]) {
        let (joints, v, out) = self.with(v, out);
        let mut twist = Self::twist(joints, v);
        let mut momentum = Spatial::ZERO;
        for (i, (joint, fixed)) in joints.iter().zip(&self.arm.fixed).enumerate().rev() {
            momentum += joint.inertia.mul(&twist);
            out[i] = joint.s.dot(&momentum) + fixed.armature * v[i];
            twist -= joint.s * v[i];
        }
    }

    fn mass_solve(&self, b: &[f64], out: &mut [f64]) {
        let (joints, b, out) = self.with(b, out);
        let mut wrench = Spatial::ZERO;
        for i in (0..joints.len()).rev() {
            let Joint { s, u, d_inv, .. } = &joints[i];
            let e = b[i] - s.dot(&wrench);
            wrench += *u * e;
            out[i] = e * d_inv;
        }
        Self::yield_forward(joints, out);
    }

    fn coriolis_mul(&self, v: &[f64], out: &mut [f64]) {
        let (joints, v, out) = self.with(v, out);
        let (mut twist, mut rate) = Self::twist_and_rate(joints, v);
        let mut force = Spatial::ZERO;
        for (i, joint) in joints.iter().enumerate().rev() {
            let Joint { s, s_rate, velocity, inertia, .. } = joint;
            let momentum = inertia.momentum(velocity);
            force += inertia.mul(&rate) + inertia.coriolis_mul(velocity, &momentum, &twist);
            out[i] = s.dot(&force);
            twist -= *s * v[i];
            rate -= *s_rate * v[i];
        }
    }

    fn coriolis_tr_mul(&self, u: &[f64], out: &mut [f64]) {
        self.transposed_coriolis(Spatial::ZERO, Vector::zeros(), u, out);
        out.iter_mut().for_each(|out| *out = -*out);
    }

    /// Both in one sweep from the tip: the sums from the base are in the joints already. The sweep
    /// begins at the tip with what acts there, −p.
    fn momentum_and_coriolis<const M: usize>(
        &self,
        p: &SVector<f64, M>,
        momentum: &mut [f64],
        coriolis: &mut [f64],
    ) {
        let (joints, dq, coriolis) = self.with(&self.dq, coriolis);
        let (mut carried, mut force) = (Spatial::ZERO - self.task_wrench(p), Spatial::ZERO);
        let rows = joints.iter().zip(&self.arm.fixed).zip(dq);
        for (((joint, fixed), dq), (momentum, coriolis)) in
            rows.zip(momentum.iter_mut().zip(coriolis)).rev()
        {
            let Joint { s, velocity, acceleration, inertia, .. } = joint;
            let own = inertia.mul(velocity);
            carried += own;
            force += inertia.mul(acceleration) + velocity.cross_wrench(&own);
            *momentum = s.dot(&carried) + fixed.armature * dq;
            *coriolis = s.dot(&force);
        }
    }

    /// In one sweep: Cᵀq̇ needs nothing but the momentum of what is beyond a joint (T187).
    fn momentum_and_drift(&self, momentum: &mut [f64], drift: &mut [f64]) {
        let (joints, dq, drift) = self.with(&self.dq, drift);
        let gravity = self.arm.gravity();
        let (mut carried, mut mass, mut moment) = (Spatial::ZERO, 0.0, Vector::<3>::zeros());
        let rows = joints.iter().zip(&self.arm.fixed).zip(dq);
        for (((joint, fixed), dq), (momentum, drift)) in
            rows.zip(momentum.iter_mut().zip(drift)).rev()
        {
            let Joint { s, s_rate, velocity, inertia, .. } = joint;
            carried += inertia.mul(velocity);
            mass += inertia.mass;
            moment += inertia.moment;
            let weight = Spatial::new(moment.cross(&gravity), gravity * mass);
            *momentum = s.dot(&carried) + fixed.armature * dq;
            *drift = s_rate.dot(&carried) + s.dot(&weight);
        }
    }

    /// As [`coriolis_tr_mul`](Self::coriolis_tr_mul): J̇ᵀp is what a force at the tip adds to the
    /// sums from there.
    fn coupling_torque<const M: usize>(&self, p: &SVector<f64, M>, u: &[f64], out: &mut [f64]) {
        self.transposed_coriolis(self.task_wrench(p), self.task_wrench_rate(p), u, out);
    }

    fn bias_torque(&self, out: &mut [f64]) {
        let (joints, _, out) = self.with(&self.dq, out);
        let mut force = Spatial::ZERO;
        for (joint, out) in joints.iter().zip(out).rev() {
            force += self.bias_force(joint);
            *out = joint.s.dot(&force);
        }
    }

    fn gravity_torque(&self, out: &mut [f64]) {
        let (joints, _, out) = self.with(&self.dq, out);
        let gravity = self.arm.gravity();
        if gravity == Vector::<3>::zeros() {
            out.fill(0.0);
            return;
        }
        let (mut mass, mut moment) = (0.0, Vector::<3>::zeros());
        for (joint, out) in joints.iter().zip(out).rev() {
            mass += joint.inertia.mass;
            moment += joint.inertia.moment;
            let weight = Spatial::new(gravity.cross(&moment), gravity * -mass);
            *out = joint.s.dot(&weight);
        }
    }

    fn potential_energy(&self) -> f64 {
        let moment: Vector<3> = self.joints.iter().map(|joint| joint.inertia.moment).sum();
        -self.arm.gravity().dot(&(moment + self.arm.base() * self.arm.total_mass()))
    }

    fn turning(&self) -> [Vector<3>; 2] {
        let twists = [self.task_velocity::<6>(), self.task_bias_acceleration()];
        twists.map(|twist| twist.fixed_rows::<3>(3).into_owned())
    }

    #[inline]
    fn turning_column(&self, i: usize) -> Vector<3> {
        self.jacobian_column::<6>(i).fixed_rows::<3>(3).into_owned()
    }

    #[inline]
    fn task_velocity<const M: usize>(&self) -> SVector<f64, M> {
        task::rows(&self.tool, &self.tool.velocity, &self.tool_rate())
    }

    #[inline]
    fn task_bias_acceleration<const M: usize>(&self) -> SVector<f64, M> {
        let last = self.joints.last();
        let (twist, rate) = last
            .map_or((Spatial::ZERO, Spatial::ZERO), |joint| (joint.velocity, joint.acceleration));
        self.task_rate_of(&twist, &rate)
    }

    #[inline]
    fn jacobian_column<const M: usize>(&self, i: usize) -> SVector<f64, M> {
        self.task_of(&self.joints[i].s)
    }

    #[inline]
    fn jacobian_dot_column<const M: usize>(&self, i: usize) -> SVector<f64, M> {
        let Joint { s, s_rate, .. } = &self.joints[i];
        self.task_rate_of(s, s_rate)
    }

    fn jacobian_mul<const M: usize>(&self, v: &[f64]) -> SVector<f64, M> {
        self.task_of(&Self::twist(&self.joints, &v[..self.joints.len()]))
    }

    fn jacobian_tr_mul<const M: usize>(&self, f: &SVector<f64, M>, out: &mut [f64]) {
        let (joints, _, out) = self.with(&self.dq, out);
        let wrench = self.task_wrench(f);
        for (joint, out) in joints.iter().zip(out) {
            *out = joint.s.dot(&wrench);
        }
    }

    fn jacobian_dot_mul<const M: usize>(&self, v: &[f64]) -> SVector<f64, M> {
        let (twist, rate) = Self::twist_and_rate(&self.joints, &v[..self.joints.len()]);
        self.task_rate_of(&twist, &rate)
    }

    fn jacobian_dot_tr_mul<const M: usize>(&self, f: &SVector<f64, M>, out: &mut [f64]) {
        let (joints, _, out) = self.with(&self.dq, out);
        let (wrench, moment) = (self.task_wrench(f), self.task_wrench_rate(f));
        for (joint, out) in joints.iter().zip(out) {
            *out = joint.s_rate.dot(&wrench) + joint.s.angular.dot(&moment);
        }
    }

    fn task_response<const M: usize>(&self, y: &mut [SVector<f64, M>]) -> SMatrix<f64, M, M> {
        let mut forces = TaskForces::new(&self.tool);
        for (joint, y) in self.joints.iter().zip(y.iter_mut()).rev() {
            forces.take_in(joint, y);
        }
        TaskForces::yield_forward(&self.joints, y);
        forces.lambda_inv
    }

    fn update_with_response<const M: usize>(
        &mut self,
        q: &[f64],
        dq: &[f64],
        y: &mut [SVector<f64, M>],
    ) -> SMatrix<f64, M, M> {
        self.move_to(q, dq);
        self.factorise_with_response(y)
    }

    /// The articulated-body algorithm: factorisation, bias and half solve in one sweep.
    fn update_with_dynamics(
        &mut self,
        q: &[f64],
        dq: &[f64],
        tau: &[f64],
        _scratch: &mut [f64],
        out: &mut [f64],
    ) {
        self.move_to(q, dq);
        let n = self.joints.len();
        let mut outer = ArticulatedInertia::default();
        let mut wrench = Spatial::ZERO;
        for i in (0..n).rev() {
            self.joints[i].factorise(&mut outer, self.arm.fixed[i].armature);
            let joint = &self.joints[i];
            wrench += self.bias_force(joint);
            let e = tau[i] - joint.s.dot(&wrench);
            wrench += joint.u * e;
            out[i] = e * joint.d_inv;
        }
        Self::yield_forward(&self.joints, &mut out[..n]);
    }

    fn body_count(&self) -> usize {
        self.arm.bodies.len()
    }

    #[inline]
    fn body(&self, i: usize) -> Body<'_, 3> {
        SpatialState::body(self, i)
    }

    fn still_bodies(&self) -> &[StillBody<3>] {
        &self.arm.still
    }

    fn body_pairs(&self) -> impl Iterator<Item = [usize; 2]> {
        self.arm.pairs.iter().copied()
    }

    fn for_each_encounter(
        &self,
        pair: [usize; 2],
        features: Option<f64>,
        visit: &mut dyn FnMut(&ContactFeature<3>),
    ) {
        contact_features(pair.map(|i| form_of(self, i)).each_ref(), features, visit);
    }

    fn point_velocity(&self, i: usize, point: &Vector<3>) -> Vector<3> {
        self.joints[i].velocity.velocity_at(&self.relative(point))
    }

    fn point_jacobian_tr_mul(&self, i: usize, point: &Vector<3>, f: &Vector<3>, out: &mut [f64]) {
        let wrench = Spatial::at(&self.relative(point), *f, Vector::zeros());
        let (inner, outer) = out.split_at_mut(i + 1);
        for (joint, out) in self.joints.iter().zip(inner) {
            *out = joint.s.dot(&wrench);
        }
        outer.fill(0.0);
    }

    fn point_bias_acceleration(&self, i: usize, point: &Vector<3>) -> Vector<3> {
        let (point, Joint { velocity, acceleration, .. }) = (self.relative(point), &self.joints[i]);
        acceleration.velocity_at(&point) + velocity.angular.cross(&velocity.velocity_at(&point))
    }

    /// By one half solve from link `i` inward; for many contacts at once see
    /// [`mobilities`](SpatialState::mobilities).
    fn point_mobility(&self, i: usize, point: &Vector<3>, n: &Vector<3>) -> f64 {
        let mut wrench = Spatial::at(&self.relative(point), *n, Vector::zeros());
        let mut sum = 0.0;
        for joint in self.joints[..=i].iter().rev() {
            let e = joint.s.dot(&wrench);
            sum += e * e * joint.d_inv;
            wrench -= joint.u * e;
        }
        sum
    }

    fn add_force(&self, wrenches: &mut [Spatial], i: usize, point: &Vector<3>, f: &Vector<3>) {
        wrenches[i] += Spatial::at(&self.relative(point), *f, Vector::zeros());
    }

    fn add_torque(&self, wrenches: &mut [Spatial], i: usize, torque: &Vector<3>) {
        wrenches[i].angular += torque;
    }

    fn link_frame(&self, i: usize) -> (Vector<3>, SMatrix<f64, 3, 3>) {
        let axes = if i < self.joints.len() { self.link_axes(i) } else { *self.tool_axes() };
        (self.joint_position(i), axes)
    }

    fn wrenches_tr_mul(&self, wrenches: &[Spatial], out: &mut [f64]) {
        let mut carried = Spatial::ZERO;
        for ((joint, wrench), out) in self.joints.iter().zip(wrenches).zip(out.iter_mut()).rev() {
            carried += *wrench;
            *out = joint.s.dot(&carried);
        }
    }

    fn matrices<const M: usize>(&self) -> Matrices<M> {
        dense::matrices(&self.arm, &self.q, &self.dq)
    }
}

impl SpatialState {
    /// `out = J̇ᵀ p − Cᵀ u` for the wrench and the carried moment of p at the tip (T87).
    #[inline(always)]
    fn transposed_coriolis(
        &self,
        mut wrench: Spatial,
        mut moment: Vector<3>,
        u: &[f64],
        out: &mut [f64],
    ) {
        let (joints, u, out) = self.with(u, out);
        let mut twist = Self::twist(joints, u);
        for (i, joint) in joints.iter().enumerate().rev() {
            let Joint { s, s_rate, velocity, inertia, .. } = joint;
            wrench -= inertia.mul(&twist);
            moment -= inertia.coriolis_tr_mul(velocity, &inertia.momentum(velocity), &twist);
            out[i] = s_rate.dot(&wrench) + s.angular.dot(&moment);
            twist -= *s * u[i];
        }
    }
}

#[cfg(test)]
mod tests;
