//! The operators of [`Robot`] on a spatial arm (docs/theory-spatial.md, T84–T89).
//!
//! Backward sweeps give the links' twists up again joint by joint, instead of storing them.

use super::algebra::{ArticulatedInertia, Spatial};
use super::state::{Joint, SpatialState};
use super::task::TaskForces;
use super::{dense, task};
use crate::geometry::{Body, Encounter, StillBody, encounter};
use crate::math::{Pointing, SpatialPose, Vector};
use crate::robot::{Limits, Manipulator, Matrices, Model, Robot, SpatialArm};
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

    fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64) {
        self.integrate(q, v, dt);
    }

    fn reach(&self) -> f64 {
        self.reach_bound()
    }

    /// A sixth of the reach: about the size of a hand of that arm.
    fn characteristic_length(&self) -> f64 {
        self.reach_bound() / 6.0
    }

    /// At q = 0, every joint accelerates at 4 rad/s² (or m/s²) against all of gravity.
    fn typical_torque(self: &Arc<Self>) -> Vec<f64> {
        const ACCELERATION: f64 = 4.0;
        let n = self.dof();
        let mut state = self.state();
        state.update(&vec![0.0; n], &vec![0.0; n]);
        let mass = state.matrices::<3>().mass;
        let weight = self.gravity().norm() * self.total_mass() * self.reach_bound();
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
        visit: &mut dyn FnMut(&Encounter<3>),
    ) {
        let forms = pair.map(|i| match self.arm.still.get(i.wrapping_sub(self.body_count())) {
            None => {
                let body = SpatialState::body(self, i);
                (body.shape, body.hull)
            }
            Some(still) => (still.shape, still.carried()),
        });
        encounter(forms.each_ref(), features, visit);
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
mod tests {
    use super::*;
    use crate::robot::description::Frame;
    use crate::robot::spatial::cases::{Case, case, planar_twin};
    use crate::robot::spatial::{Mobility, SpatialArm};
    use crate::testing::assert_close;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;
    use std::sync::Arc;

    fn apply(n: usize, operator: impl FnOnce(&mut [f64])) -> Vec<f64> {
        let mut out = vec![f64::NAN; n];
        operator(&mut out);
        out
    }

    /// What the recursions give is the matrix product, relative to the size of its terms. Products
    /// that are 0 in exact arithmetic are measured against the size of a small link's, 1e-3.
    #[track_caller]
    fn check(a: &[f64], matrix: &DMatrix<f64>, vector: &DVector<f64>) {
        let scale = (matrix.abs() * vector.abs()).max().max(1e-3);
        let b = matrix * vector;
        for (i, (a, b)) in a.iter().zip(&b).enumerate() {
            assert!((a - b).abs() <= 1e-11 * scale, "[{i}]: {a} against {b} (scale {scale})");
        }
    }

    fn dynamic<const M: usize>(m: &crate::robot::dense::TaskMatrix<M>) -> DMatrix<f64> {
        DMatrix::from_fn(M, m.ncols(), |i, j| m[(i, j)])
    }

    /// The operators of a task of dimension M against the matrices.
    fn check_task<const M: usize>(c: &Case) {
        let (n, state) = (c.q.len(), c.state());
        let dense = state.matrices::<M>();
        let (j, j_dot) = (dynamic(&dense.jacobian), dynamic(&dense.jacobian_dot));
        let (u, v) = (DVector::from_column_slice(&c.u), DVector::from_column_slice(&c.v));
        let f = SVector::<f64, M>::from_fn(|i, _| f64::sin(1.0 + 2.1 * i as f64));
        let force = DVector::from_column_slice(f.as_slice());
        check(state.jacobian_mul::<M>(&c.v).as_slice(), &j, &v);
        check(&apply(n, |out| state.jacobian_tr_mul(&f, out)), &j.transpose(), &force);
        check(state.jacobian_dot_mul::<M>(&c.v).as_slice(), &j_dot, &v);
        check(&apply(n, |out| state.jacobian_dot_tr_mul(&f, out)), &j_dot.transpose(), &force);
        check(state.task_velocity::<M>().as_slice(), &j, &dense.velocity);
        check(state.task_bias_acceleration::<M>().as_slice(), &j_dot, &dense.velocity);
        for i in 0..n {
            let unit = DVector::from_fn(n, |k, _| if k == i { 1.0 } else { 0.0 });
            check(state.jacobian_column::<M>(i).as_slice(), &j, &unit);
            check(state.jacobian_dot_column::<M>(i).as_slice(), &j_dot, &unit);
        }
        // [M, −Jᵀ] [q̇; f] and [J̇ᵀ, −Cᵀ] [f; u], as products of one matrix each.
        let beside = |a: &DMatrix<f64>, b: &DMatrix<f64>| {
            DMatrix::from_fn(n, a.ncols() + b.ncols(), |i, k| {
                if k < a.ncols() { a[(i, k)] } else { -b[(i, k - a.ncols())] }
            })
        };
        let stack = |a: &DVector<f64>, b: &DVector<f64>| {
            DVector::from_iterator(a.len() + b.len(), a.iter().chain(b).copied())
        };
        let (mut momentum, mut coriolis) = (vec![f64::NAN; n], vec![f64::NAN; n]);
        state.momentum_and_coriolis(&f, &mut momentum, &mut coriolis);
        check(&momentum, &beside(&dense.mass, &j.transpose()), &stack(&dense.velocity, &force));
        check(&coriolis, &dense.coriolis, &dense.velocity);
        let coupling = apply(n, |out| state.coupling_torque(&f, &c.u, out));
        let transposed = beside(&j_dot.transpose(), &dense.coriolis.transpose());
        check(&coupling, &transposed, &stack(&force, &u));
    }

    /// M Y = Jᵀ and Λ⁻¹ = J Y, relative to the terms, by either way.
    fn check_response<const M: usize>(c: &Case) {
        let (n, mut state) = (c.q.len(), c.state());
        let dense = state.matrices::<M>();
        let mut y = vec![SVector::<f64, M>::zeros(); n];
        let lambda_inv = state.task_response(&mut y);
        let matrix = DMatrix::from_fn(n, M, |i, k| y[i][k]);
        let jacobian = dynamic(&dense.jacobian);
        let scale = (dense.mass.abs() * matrix.abs()).max();
        let gap = (&dense.mass * &matrix - jacobian.transpose()).abs().max();
        assert!(gap <= 1e-11 * scale, "{gap} of {scale}");
        let product = &jacobian * &matrix;
        let scale = (jacobian.abs() * matrix.abs()).max();
        for (a, b) in lambda_inv.iter().zip(&product) {
            assert!((a - b).abs() <= 1e-11 * scale, "{a} against {b} (scale {scale})");
        }
        let mut fused = vec![SVector::<f64, M>::zeros(); n];
        let (q, dq) = (c.q.clone(), c.dq.clone());
        assert_eq!(state.update_with_response(&q, &dq, &mut fused), lambda_inv);
        assert_eq!(fused, y);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Every operator against the dense textbook matrices, which share no code with it.
        #[test]
        fn operators_agree_with_matrices(c in case(1usize..21)) {
            let (n, state) = (c.q.len(), c.state());
            let dense = state.matrices::<3>();
            let (u, v) = (DVector::from_column_slice(&c.u), DVector::from_column_slice(&c.v));
            check(&apply(n, |out| state.mass_mul(&c.v, out)), &dense.mass, &v);
            check(&apply(n, |out| state.coriolis_mul(&c.v, out)), &dense.coriolis, &v);
            check(&apply(n, |out| state.coriolis_tr_mul(&c.u, out)), &dense.coriolis.transpose(), &u);
            let gravity = apply(n, |out| state.gravity_torque(out));
            assert_close(&gravity, dense.gravity.as_slice(), 1e-12);
            let bias = apply(n, |out| state.bias_torque(out));
            let mut rest = bias.clone();
            rest.iter_mut().zip(&gravity).for_each(|(rest, gravity)| *rest -= gravity);
            let scale = (dense.coriolis.abs() * dense.velocity.abs()).max() + dense.gravity.abs().max();
            for (rest, expected) in rest.iter().zip(&(&dense.coriolis * &dense.velocity)) {
                prop_assert!((rest - expected).abs() <= 1e-11 * scale);
            }
            check_task::<3>(&c);
            check_task::<5>(&c);
            check_task::<6>(&c);
        }

        /// M⁻¹ undoes M, and so do the half solves of every task and the articulated-body algorithm.
        #[test]
        fn inverse_and_task_response(c in case(1usize..21)) {
            let (n, state) = (c.q.len(), c.state());
            let dense = state.matrices::<3>();
            let solved = apply(n, |out| state.mass_solve(&c.v, out));
            let x = DVector::from_column_slice(&solved);
            let scale = (dense.mass.abs() * x.abs()).max();
            let back = &dense.mass * &x;
            for (a, b) in back.iter().zip(&c.v) {
                prop_assert!((a - b).abs() <= 1e-11 * scale, "{a} against {b}");
            }
            check_response::<3>(&c);
            check_response::<5>(&c);
            check_response::<6>(&c);
            let bias = apply(n, |out| state.bias_torque(out));
            let rest: Vec<_> = c.u.iter().zip(&bias).map(|(tau, bias)| tau - bias).collect();
            let expected = apply(n, |out| state.mass_solve(&rest, out));
            let mut moved = c.arm.state();
            let mut scratch = vec![0.0; n];
            let ddq = apply(n, |out| moved.update_with_dynamics(&c.q, &c.dq, &c.u, &mut scratch, out));
            let size = DVector::from_column_slice(&bias).abs().max() + 3.0;
            let inverse = dense.mass.clone().try_inverse().unwrap().abs().max() * n as f64;
            for (a, b) in ddq.iter().zip(&expected) {
                prop_assert!((a - b).abs() <= 1e-11 * size * inverse, "{a} against {b}");
            }
        }

        /// C is Christoffel's: Ṁ = C + Cᵀ, v ᵀ(Ṁ − 2C) v = 0, C v = ¼\[h(q̇ + v) − h(q̇ − v)\] and
        /// Cᵀv = Ṁ v − C v, where h = C q̇ comes from the bias, which knows nothing of C.
        #[test]
        fn coriolis_is_christoffel(c in case(1usize..13)) {
            let n = c.q.len();
            let bias_at = |sign: f64| {
                let dq: Vec<_> = c.dq.iter().zip(&c.v).map(|(dq, v)| dq + sign * v).collect();
                apply(n, |out| c.at(&c.q, &dq).bias_torque(out))
            };
            let (plus, minus, state) = (bias_at(1.0), bias_at(-1.0), c.state());
            let product = apply(n, |out| state.coriolis_mul(&c.v, out));
            let polar: Vec<_> = plus.iter().zip(&minus).map(|(a, b)| 0.25 * (a - b)).collect();
            let size = plus.iter().chain(&minus).fold(1.0_f64, |m, x| m.max(x.abs()));
            for (a, b) in product.iter().zip(&polar) {
                prop_assert!((a - b).abs() <= 1e-12 * size, "{a} against {b} (scale {size})");
            }
            // Ṁ v by differences in time, fourth order.
            let mass_at = |t: f64| DVector::from_vec(apply(n, |out| c.later(t).mass_mul(&c.v, out)));
            let h = 1e-3;
            let rate = (mass_at(-2.0 * h) - mass_at(2.0 * h) + (mass_at(h) - mass_at(-h)) * 8.0) / (12.0 * h);
            let transposed = apply(n, |out| state.coriolis_tr_mul(&c.v, out));
            let sum: Vec<_> = product.iter().zip(&transposed).map(|(a, b)| a + b).collect();
            assert_close(&sum, rate.as_slice(), 1e-6);
            let quadratic: f64 = c.v.iter().zip(&sum).map(|(v, s)| v * s).sum();
            let twice: f64 = c.v.iter().zip(&product).map(|(v, s)| 2.0 * v * s).sum();
            let terms: f64 = c.v.iter().zip(&product).map(|(v, s)| (v * s).abs()).sum();
            prop_assert!((quadratic - twice).abs() <= 1e-11 * (1.0 + terms));
        }

        /// J = ∂x/∂q, J̇ = dJ/dt and g = ∂V/∂q by central differences; the power of the bias is the
        /// rate of the energy.
        #[test]
        fn derivatives_by_finite_differences(c in case(1usize..9)) {
            let (n, h, state) = (c.q.len(), 1e-5, c.state());
            let j = state.jacobian();
            let gravity = apply(n, |out| state.gravity_torque(out));
            for k in 0..n {
                let at = |step: f64| {
                    let mut q = c.q.clone();
                    q[k] += step;
                    c.at(&q, &c.dq)
                };
                let (before, after) = (at(-h), at(h));
                let linear = (after.position() - before.position()) / (2.0 * h);
                let turn = (after.orientation() * before.orientation().inverse()).log() / (2.0 * h);
                let column: Vec<_> = linear.iter().chain(&turn).copied().collect();
                assert_close(j.column(k).as_slice(), &column, 1e-7);
                let slope = (after.potential_energy() - before.potential_energy()) / (2.0 * h);
                assert_close(&[gravity[k]], &[slope], 1e-6);
            }
            for_task::<3>(&c, h);
            for_task::<5>(&c, h);
            for_task::<6>(&c, h);
            // d/dt (½ q̇ᵀM q̇ + V) at constant q̇ is q̇ᵀ(½ Ṁ q̇ + g) = q̇ᵀ(C q̇ + g).
            let energy = |t: f64| {
                let state = c.later(t);
                let momentum = apply(n, |out| state.mass_mul(&c.dq, out));
                0.5 * dot(&momentum, &c.dq) + state.potential_energy()
            };
            let rate = (energy(h) - energy(-h)) / (2.0 * h);
            let power = dot(&apply(n, |out| state.bias_torque(out)), &c.dq);
            assert_close(&[power], &[rate], 1e-6);
        }

        /// Velocity, force, bias acceleration and mobility of a point on a link are consistent with
        /// each other, with differences and with M⁻¹.
        #[test]
        fn point_operators(c in case(1usize..9), own in prop::array::uniform3(-0.5..0.5), n in prop::array::uniform3(-1.0..1.0)) {
            let (count, state) = (c.q.len(), c.state());
            let (i, normal) = (count / 2, Vector::from(n));
            let on = |state: &SpatialState| state.joint_position(i) + state.link_axes(i) * Vector::from(own);
            let point = on(&state);
            let column = apply(count, |out| state.point_jacobian_tr_mul(i, &point, &normal, out));
            let velocity = state.point_velocity(i, &point);
            assert_close(&[normal.dot(&velocity)], &[dot(&column, &c.dq)], 1e-12);
            let (mut scout, v) = (state.clone(), c.dq.iter().map(|v| 0.5 - v).collect::<Vec<_>>());
            scout.update_positions(&c.q);
            scout.update_velocities(&v);
            assert_close(&[normal.dot(&scout.point_velocity(i, &point))], &[dot(&column, &v)], 1e-12);
            let h = 1e-4;
            let (before, after) = (on(&c.later(-h)), on(&c.later(h)));
            assert_close(((after - before) / (2.0 * h)).as_slice(), velocity.as_slice(), 1e-5);
            let curve = (after - 2.0 * point + before) / (h * h);
            assert_close(state.point_bias_acceleration(i, &point).as_slice(), curve.as_slice(), 1e-4);
            let solved = apply(count, |out| state.mass_solve(&column, out));
            let mobility = state.point_mobility(i, &point, &normal);
            assert_close(&[mobility], &[dot(&column, &solved)], 1e-10);
            let mut all = vec![Mobility::default(); count];
            state.mobilities(&mut all);
            assert_close(&[all[i].along(&point, &normal)], &[mobility], 1e-10);
            let mut wrenches = vec![Spatial::default(); count];
            state.add_force(&mut wrenches, i, &point, &normal);
            assert_close(&apply(count, |out| state.wrenches_tr_mul(&wrenches, out)), &column, 1e-12);
        }

        /// Turning mount and gravity together, and moving the mount, changes no joint torque.
        #[test]
        fn the_world_may_turn(c in case(1usize..9), turn in prop::array::uniform3(-3.0..3.0), far in prop::array::uniform3(-1e3..1e3)) {
            let turn = crate::math::UnitQuaternion::exp(&Vector::from(turn));
            let mut description = c.arm.description().clone();
            let mount = crate::math::UnitQuaternion::new(description.mount.orientation).unwrap();
            description.mount = Frame { position: far, orientation: (turn * mount).to_array() };
            description.gravity = turn.rotate(&description.gravity.into()).into();
            let turned = Case { arm: Arc::new(SpatialArm::new(description).unwrap()), ..c.clone() };
            let (a, b, n) = (c.state(), turned.state(), c.q.len());
            for operator in [SpatialState::mass_mul, SpatialState::coriolis_mul, SpatialState::coriolis_tr_mul] {
                let expected = apply(n, |out| operator(&a, &c.v, out));
                assert_close(&apply(n, |out| operator(&b, &c.v, out)), &expected, 1e-12);
            }
            let expected = apply(n, |out| a.bias_torque(out));
            assert_close(&apply(n, |out| b.bias_torque(out)), &expected, 1e-12);
            // And the tool goes along.
            let relative = |state: &SpatialState| state.position() - state.arm.base();
            assert_close(relative(&b).as_slice(), turn.rotate(&relative(&a)).as_slice(), 1e-12);
            let axes = turn.matrix() * a.tool_axes();
            assert_close(b.tool_axes().as_slice(), axes.as_slice(), 1e-13);
        }

        /// `update_positions` gives positions and columns of J bit for bit as `update`.
        #[test]
        fn placed_is_where_updated_is(c in case(1usize..9)) {
            let mut placed = c.arm.state();
            placed.update_positions(&c.q);
            let state = c.state();
            prop_assert_eq!(placed.position(), state.position());
            prop_assert_eq!(placed.jacobian(), state.jacobian());
            prop_assert_eq!(placed.orientation(), state.orientation());
        }
    }

    fn dot(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    fn for_task<const M: usize>(c: &Case, h: f64) {
        let (before, after) = (c.later(-h).matrices::<M>(), c.later(h).matrices::<M>());
        let rate = (after.jacobian - before.jacobian) / (2.0 * h);
        let state = c.state();
        for i in 0..c.q.len() {
            let column = state.jacobian_dot_column::<M>(i);
            assert_close(column.as_slice(), rate.column(i).as_slice(), 1e-6);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// A planar arm written as a spatial one has the operators of the planar code.
        #[test]
        fn planar_arms_are_spatial_ones(c in crate::testing::case(1usize..13)) {
            let (n, planar) = (c.q.len(), c.state());
            let mut spatial = planar_twin(&c.arm, false).state();
            spatial.update(&c.q, &c.dq);
            let both = |a: &dyn Fn(&mut [f64]), b: &dyn Fn(&mut [f64])| {
                assert_close(&apply(n, b), &apply(n, a), 1e-12);
            };
            both(&|out| planar.mass_mul(&c.v, out), &|out| spatial.mass_mul(&c.v, out));
            both(&|out| planar.coriolis_mul(&c.v, out), &|out| spatial.coriolis_mul(&c.v, out));
            both(&|out| planar.coriolis_tr_mul(&c.u, out), &|out| spatial.coriolis_tr_mul(&c.u, out));
            both(&|out| planar.gravity_torque(out), &|out| spatial.gravity_torque(out));
            both(&|out| planar.bias_torque(out), &|out| spatial.bias_torque(out));
            for i in 0..n {
                for (a, b) in [
                    (planar.jacobian_column::<3>(i), spatial.jacobian_column::<6>(i)),
                    (planar.jacobian_dot_column::<3>(i), spatial.jacobian_dot_column::<6>(i)),
                ] {
                    assert_close(b.as_slice(), &[a[0], a[1], 0.0, 0.0, 0.0, a[2]], 1e-12);
                }
            }
        }
    }
}
