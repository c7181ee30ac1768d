//! `n` revolute links in the plane, every operator in O(n).
//!
//! Everything is written in absolute link angles θ = L q (L: lower-triangular ones), where the mass
//! matrix is semiseparable: with `l_i` the vector from joint i to joint i+1 and `b_j` the first
//! moment about joint j of link j plus everything it carries as a point mass at its far end,
//!
//! ```text
//! A_ij = l_i · b_j (i < j),   A_ii = I_i + m_i|c_i|² + |l_i|² Σ_{k>i} m_k,   M = Lᵀ A L
//! ```
//!
//! so that products are prefix and suffix sums (T18–T20). The inverse is the articulated-body
//! recursion: eliminating a revolute joint in the plane leaves a symmetric 2×2 block.

mod arm;
mod factorisation;
mod model;
mod reach;

pub use arm::{Link, PlanarArm};
pub use reach::{Annulus, Reach};

use super::{Limits, Manipulator, Matrices, Model, Robot, dense};
use crate::geometry::Body;
use crate::math::{Capsule, PlanarPose, Vector, cross, perp, sin_cos, unit_vectors};
use arm::capsule;
use factorisation::{ArticulatedInertia, TaskForces};
use nalgebra::{SMatrix, SVector};
use std::mem;
use std::sync::Arc;

/// What depends on (q, q̇) at one joint and its link.
#[derive(Debug, Clone, Copy, Default)]
struct Joint {
    /// Absolute angle \[rad\] and rate \[rad/s\] of the link.
    angle: f64,
    rate: f64,
    /// Position \[m\] and velocity \[m/s\] of the joint, and its acceleration while q̈ = 0: −Σ w² l.
    position: Vector<2>,
    velocity: Vector<2>,
    acceleration: Vector<2>,
    /// Unit vector along the link.
    x: Vector<2>,
    /// Vector to the next joint, and composite first moment, in the world frame.
    l: Vector<2>,
    b: Vector<2>,
    /// A_ii \[kg·m²\].
    diagonal: f64,
    /// Articulated-body factorisation: coupling h/D \[1/m\] and 1/D \[1/(kg·m²)\].
    h: Vector<2>,
    d_inv: f64,
}

/// A [`PlanarArm`] at (q, q̇). Allocated once, refreshed by [`Robot::update`].
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::math::Vector;
/// use vff_core::robot::{Manipulator, Model, PlanarArm, Robot, planar::Link};
///
/// let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 2], Vector::<2>::zeros()));
/// let mut state = arm.state();
/// state.update(&[0.0, 0.0], &[0.0, 1.0]);
/// assert_eq!(state.joint_position(2), Vector::<2>::new(2.0, 0.0));
/// let tip: Vector<2> = Manipulator::<2, 2>::pose(&state);
/// assert_eq!(tip, Vector::<2>::new(2.0, 0.0));
/// assert!((state.task_velocity::<2>() - Vector::<2>::new(0.0, 1.0)).norm() < 1e-15);
/// let mut accelerated = [0.0; 2];
/// state.mass_mul(&[1.0, 0.0], &mut accelerated); // M e₁ without M
/// assert!(accelerated[0] > accelerated[1]);
/// ```
#[derive(Debug, Clone)]
pub struct PlanarState {
    arm: Arc<PlanarArm>,
    q: Vec<f64>,
    dq: Vec<f64>,
    joints: Vec<Joint>,
    tip: Vector<2>,
    tip_velocity: Vector<2>,
    /// The tip's acceleration while q̈ = 0.
    tip_bias: Vector<2>,
}

impl PlanarState {
    /// The parameters of this arm.
    pub fn arm(&self) -> &Arc<PlanarArm> {
        &self.arm
    }

    /// The position of joint `i` \[m\]; `i = n` is the tip.
    pub fn joint_position(&self, i: usize) -> Vector<2> {
        self.joints.get(i).map_or(self.tip, |joint| joint.position)
    }

    /// The shape of link `i`.
    pub fn link(&self, i: usize) -> Capsule<2> {
        capsule(&self.joints[i], &self.arm.links[i])
    }

    /// The joints and two joint vectors, all of one length: spares the loops their bounds checks.
    #[inline(always)]
    fn with<'a>(
        &'a self,
        v: &'a [f64],
        out: &'a mut [f64],
    ) -> (&'a [Joint], &'a [f64], &'a mut [f64]) {
        let n = self.joints.len();
        (&self.joints, &v[..n], &mut out[..n])
    }

    fn move_to(&mut self, q: &[f64], dq: &[f64]) {
        self.q.copy_from_slice(q);
        self.dq.copy_from_slice(dq);
        self.kinematics(q, dq);
    }

    /// Base to tip: angles, rates, positions, velocities and the world-frame vectors l, b.
    fn kinematics(&mut self, q: &[f64], dq: &[f64]) {
        // First all the sines, which wait for nothing but each other's angle, and then the sums.
        let mut angle = 0.0;
        let (pairs, rest) = self.joints.as_chunks_mut::<2>();
        let (q, last) = q.as_chunks::<2>();
        for (joint, q) in pairs.iter_mut().zip(q) {
            let first = angle + q[0];
            angle = first + q[1];
            let [x, y] = unit_vectors(first, angle);
            (joint[0].angle, joint[0].x) = (first, x.into());
            (joint[1].angle, joint[1].x) = (angle, y.into());
        }
        for (joint, q) in rest.iter_mut().zip(last) {
            let (sin, cos) = sin_cos(angle + q);
            (joint.angle, joint.x) = (angle + q, Vector::<2>::new(cos, sin));
        }
        let mut rate = 0.0;
        let mut position = Vector::<2>::zeros();
        let mut velocity = Vector::<2>::zeros();
        let mut acceleration = Vector::<2>::zeros();
        for ((joint, link), dq) in self.joints.iter_mut().zip(&self.arm.composite).zip(dq) {
            let x = joint.x;
            rate += dq;
            joint.rate = rate;
            joint.position = position;
            joint.velocity = velocity;
            joint.acceleration = acceleration;
            joint.l = x * link.length;
            joint.b = x * link.moment.x + perp(x) * link.moment.y;
            position += joint.l;
            velocity += perp(joint.l) * rate;
            acceleration -= joint.l * (rate * rate);
        }
        self.tip_bias = acceleration;
        self.tip = position;
        self.tip_velocity = velocity;
    }

    /// Tip to base: the factorisation of M alone.
    fn factorise(&mut self) {
        let mut outer = ArticulatedInertia::default();
        for (joint, link) in self.joints.iter_mut().zip(&self.arm.composite).rev() {
            outer.take_in(joint, link);
        }
    }

    /// Base to tip, the second half of a solve: what the joints yield to each other, and back from
    /// absolute to joint coordinates.
    #[inline(always)]
    fn yield_forward(joints: &[Joint], out: &mut [f64]) {
        let (mut previous, mut a) = (0.0, Vector::<2>::zeros());
        for (joint, out) in joints.iter().zip(out) {
            let Joint { l, h, .. } = *joint;
            let alpha = *out - h.dot(&a);
            // a + perp(l) α, in the order that makes the next link wait least.
            a = Vector::<2>::new(
                a.x * (1.0 + l.y * h.x) + (a.y * (l.y * h.y) - l.y * *out),
                a.y * (1.0 - l.x * h.y) + (l.x * *out - a.x * (l.x * h.x)),
            );
            *out = alpha - previous;
            previous = alpha;
        }
    }
}

impl PlanarState {
    /// `out = J̇ᵀ f − Cᵀ u` for a force f at the tip:
    /// (Cᵀ u)_abs,i = −w_i Σ_j A_ij sin(θ_i − θ_j) (L u)_j and (J̇ᵀ f)_abs,i = −w_i l_i·f.
    #[inline(always)]
    fn transposed_coriolis(&self, f: Vector<2>, u: &[f64], out: &mut [f64]) {
        let (joints, u, out) = self.with(u, out);
        let (mut s, mut inner) = (0.0, Vector::<2>::zeros());
        for i in 0..out.len() {
            s += u[i];
            out[i] = cross(inner, joints[i].b);
            inner += joints[i].l * s;
        }
        let (mut sum, mut outer) = (0.0, perp(f));
        for i in (0..out.len()).rev() {
            sum += joints[i].rate * (out[i] - cross(joints[i].l, outer));
            out[i] = sum;
            outer += joints[i].b * s;
            s -= u[i];
        }
    }
}

/// A task of position.
impl Manipulator<2, 2> for PlanarState {
    type Pose = Vector<2>;

    #[inline]
    fn pose(&self) -> Vector<2> {
        self.tip
    }
}

/// A task of position and orientation.
impl Manipulator<2, 3> for PlanarState {
    type Pose = PlanarPose;

    #[inline]
    fn pose(&self) -> PlanarPose {
        PlanarPose(twist(self.tip, self.joints.last().map_or(0.0, |joint| joint.angle)))
    }
}

impl Robot<2> for PlanarState {
    type Wrench = PlanarWrench;

    #[inline]
    fn dof(&self) -> usize {
        self.joints.len()
    }

    fn update(&mut self, q: &[f64], dq: &[f64]) {
        self.move_to(q, dq);
        self.factorise();
    }

    fn update_positions(&mut self, q: &[f64]) {
        self.q.copy_from_slice(q);
        let dq = mem::take(&mut self.dq);
        self.kinematics(q, &dq);
        self.dq = dq;
    }

    fn update_velocities(&mut self, v: &[f64]) {
        let (mut rate, mut velocity) = (0.0, Vector::<2>::zeros());
        for (joint, v) in self.joints.iter_mut().zip(v) {
            rate += v;
            (joint.rate, joint.velocity) = (rate, velocity);
            velocity += perp(joint.l) * rate;
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
        self.arm.total_mass
    }

    fn limits(&self) -> &Limits {
        &self.arm.limits
    }

    fn mass_mul(&self, v: &[f64], out: &mut [f64]) {
        let (joints, v, out) = self.with(v, out);
        // Base to tip: Σ_{j<i} l_j w_j; tip to base: Σ_{j>i} b_j w_j; then Lᵀ.
        let (mut w, mut inner) = (0.0, Vector::<2>::zeros());
        for i in 0..out.len() {
            w += v[i];
            out[i] = joints[i].diagonal * w + joints[i].b.dot(&inner);
            inner += joints[i].l * w;
        }
        let (mut sum, mut outer) = (0.0, Vector::<2>::zeros());
        for i in (0..out.len()).rev() {
            sum += out[i] + joints[i].l.dot(&outer);
            out[i] = sum;
            outer += joints[i].b * w;
            w -= v[i];
        }
    }

    fn mass_solve(&self, b: &[f64], out: &mut [f64]) {
        let (joints, b, out) = self.with(b, out);
        // Backward (T23): the moment left over at each link once the outer joints have yielded.
        let (mut next, mut force) = (0.0, Vector::<2>::zeros());
        for i in (0..out.len()).rev() {
            let Joint { l, h, d_inv, .. } = joints[i];
            let left = b[i] - next;
            out[i] = (left - cross(l, force)) * d_inv;
            // force + h (left − l × force), in the order that makes the next link wait least.
            force = Vector::<2>::new(
                force.x * (1.0 + h.x * l.y) + (h.x * left - force.y * (h.x * l.x)),
                force.y * (1.0 - h.y * l.x) + (h.y * left + force.x * (h.y * l.y)),
            );
            next = b[i];
        }
        Self::yield_forward(joints, out);
    }

    fn coriolis_mul(&self, v: &[f64], out: &mut [f64]) {
        let (joints, v, out) = self.with(v, out);
        // (C v)_abs,i = Σ_j A_ij sin(θ_i − θ_j) w_j u_j with u = L v (T19, T20).
        let (mut u, mut inner) = (0.0, Vector::<2>::zeros());
        for i in 0..out.len() {
            u += v[i];
            out[i] = cross(inner, joints[i].b);
            inner += joints[i].l * (joints[i].rate * u);
        }
        let (mut sum, mut outer) = (0.0, Vector::<2>::zeros());
        for i in (0..out.len()).rev() {
            sum += out[i] - cross(joints[i].l, outer);
            out[i] = sum;
            outer += joints[i].b * (joints[i].rate * u);
            u -= v[i];
        }
    }

    fn coriolis_tr_mul(&self, u: &[f64], out: &mut [f64]) {
        self.transposed_coriolis(Vector::<2>::zeros(), u, out);
        out.iter_mut().for_each(|out| *out = -*out);
    }

    /// Both in one sweep from the tip: the sums from the base are in the joints already, the first
    /// turned by 90° in their velocities, the second with another sign in their accelerations. The
    /// sweep begins at the tip with what acts there, −p.
    fn momentum_and_coriolis<const M: usize>(
        &self,
        p: &SVector<f64, M>,
        momentum: &mut [f64],
        coriolis: &mut [f64],
    ) {
        let (joints, _, coriolis) = self.with(&self.dq, coriolis);
        let momentum = &mut momentum[..joints.len()];
        let (force, moment) = parts(p);
        let (mut sum, mut c) = (-moment, 0.0);
        let (mut outer, mut outer_squared) = (perp(force), Vector::<2>::zeros());
        for i in (0..joints.len()).rev() {
            let Joint { rate, velocity, acceleration, l, b, diagonal, .. } = joints[i];
            sum += diagonal * rate + cross(b, velocity) + l.dot(&outer);
            c += cross(b, acceleration) - cross(l, outer_squared);
            momentum[i] = sum;
            coriolis[i] = c;
            let bw = b * rate;
            outer += bw;
            outer_squared += bw * rate;
        }
    }

    /// In one sweep, which has the same sums.
    fn momentum_and_drift(&self, momentum: &mut [f64], drift: &mut [f64]) {
        let (joints, _, drift) = self.with(&self.dq, drift);
        let momentum = &mut momentum[..joints.len()];
        let (mut sum, mut change, mut outer) = (0.0, 0.0, Vector::<2>::zeros());
        for i in (0..joints.len()).rev() {
            let Joint { rate, velocity, l, b, diagonal, .. } = joints[i];
            sum += diagonal * rate + cross(b, velocity) + l.dot(&outer);
            change += cross(b, self.arm.gravity) - rate * (b.dot(&velocity) - cross(l, outer));
            (momentum[i], drift[i]) = (sum, change);
            outer += b * rate;
        }
    }

    /// As [`coriolis_tr_mul`](Self::coriolis_tr_mul): J̇ᵀp is what a force at the tip adds to the sum
    /// from there.
    fn coupling_torque<const M: usize>(&self, p: &SVector<f64, M>, u: &[f64], out: &mut [f64]) {
        self.transposed_coriolis(parts(p).0, u, out);
    }

    /// Gravity enters as an acceleration of the base against it.
    fn bias_torque(&self, out: &mut [f64]) {
        let (joints, _, out) = self.with(&self.dq, out);
        let (mut sum, mut outer) = (0.0, Vector::<2>::zeros());
        for i in (0..joints.len()).rev() {
            let Joint { rate, acceleration, l, b, .. } = joints[i];
            sum += cross(b, acceleration - self.arm.gravity) - cross(l, outer);
            out[i] = sum;
            outer += b * (rate * rate);
        }
    }

    fn gravity_torque(&self, out: &mut [f64]) {
        if self.arm.gravity == Vector::<2>::zeros() {
            out.fill(0.0);
            return;
        }
        let mut sum = 0.0;
        for i in (0..self.joints.len()).rev() {
            sum += cross(self.joints[i].b, -self.arm.gravity);
            out[i] = sum;
        }
    }

    fn potential_energy(&self) -> f64 {
        let first_moment: Vector<2> = self.joints.iter().map(|joint| joint.b).sum();
        -self.arm.gravity.dot(&first_moment)
    }

    fn turning(&self) -> [Vector<3>; 2] {
        [self.task_velocity::<3>(), self.task_bias_acceleration()]
            .map(|twist| Vector::z() * twist.z)
    }

    fn turning_column(&self, _i: usize) -> Vector<3> {
        Vector::<3>::z()
    }

    #[inline]
    fn task_velocity<const M: usize>(&self) -> SVector<f64, M> {
        twist(self.tip_velocity, self.joints.last().map_or(0.0, |joint| joint.rate))
    }

    #[inline]
    fn task_bias_acceleration<const M: usize>(&self) -> SVector<f64, M> {
        twist(self.tip_bias, 0.0)
    }

    #[inline]
    fn jacobian_column<const M: usize>(&self, i: usize) -> SVector<f64, M> {
        twist(perp(self.tip - self.joints[i].position), 1.0)
    }

    #[inline]
    fn jacobian_dot_column<const M: usize>(&self, i: usize) -> SVector<f64, M> {
        twist(perp(self.tip_velocity - self.joints[i].velocity), 0.0)
    }

    fn task_response<const M: usize>(&self, y: &mut [SVector<f64, M>]) -> SMatrix<f64, M, M> {
        let mut forces = TaskForces::new();
        let last = self.joints.len() - 1;
        for (i, (joint, y)) in self.joints.iter().zip(y.iter_mut()).enumerate().rev() {
            forces.take_in(joint, i == last, y);
        }
        TaskForces::yield_forward(&self.joints, y);
        forces.lambda_inv
    }

    /// Factorisation and half solves in one sweep: the first waits for its divisions, the second fills
    /// the time.
    fn update_with_response<const M: usize>(
        &mut self,
        q: &[f64],
        dq: &[f64],
        y: &mut [SVector<f64, M>],
    ) -> SMatrix<f64, M, M> {
        self.move_to(q, dq);
        let mut outer = ArticulatedInertia::default();
        let mut forces = TaskForces::new();
        let last = self.joints.len() - 1;
        let links = self.joints.iter_mut().zip(&self.arm.composite);
        for (i, ((joint, link), y)) in links.zip(y.iter_mut()).enumerate().rev() {
            outer.take_in(joint, link);
            forces.take_in(joint, i == last, y);
        }
        TaskForces::yield_forward(&self.joints, y);
        forces.lambda_inv
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
        let gravity = self.arm.gravity;
        let mut outer = ArticulatedInertia::default();
        // The torque of the joint farther out, and the force that its link receives.
        let (mut next, mut force) = (0.0, Vector::<2>::zeros());
        let links = self.joints.iter_mut().zip(&self.arm.composite);
        for ((joint, link), (tau, out)) in links.zip(tau.iter().zip(out.iter_mut())).rev() {
            outer.take_in(joint, link);
            let Joint { rate, acceleration, l, b, h, d_inv, .. } = *joint;
            let e = tau - next - cross(b, acceleration - gravity) - cross(l, force);
            force += h * e - b * (rate * rate);
            *out = e * d_inv;
            next = *tau;
        }
        Self::yield_forward(&self.joints, out);
    }

    /// One for each link.
    fn body_count(&self) -> usize {
        self.joints.len()
    }

    fn body(&self, i: usize) -> Body<'_, 2> {
        Body::new(i, self.link(i))
    }

    fn bodies(&self) -> impl Iterator<Item = Body<'_, 2>> {
        let pairs = self.joints.iter().zip(&self.arm.links).enumerate();
        pairs.map(|(i, (joint, link))| Body::new(i, capsule(joint, link)))
    }

    /// Links that share no joint.
    fn body_pairs(&self) -> impl Iterator<Item = [usize; 2]> {
        (2..self.joints.len()).flat_map(|j| (0..j - 1).map(move |i| [i, j]))
    }

    fn point_velocity(&self, i: usize, point: &Vector<2>) -> Vector<2> {
        let joint = &self.joints[i];
        joint.velocity + perp(point - joint.position) * joint.rate
    }

    fn point_jacobian_tr_mul(&self, i: usize, point: &Vector<2>, f: &Vector<2>, out: &mut [f64]) {
        let (inner, outer) = out.split_at_mut(i + 1);
        for (joint, out) in self.joints.iter().zip(inner) {
            *out = cross(point - joint.position, *f);
        }
        outer.fill(0.0);
    }

    fn point_bias_acceleration(&self, i: usize, point: &Vector<2>) -> Vector<2> {
        let joint = &self.joints[i];
        joint.acceleration - (point - joint.position) * (joint.rate * joint.rate)
    }

    fn point_mobility(&self, i: usize, point: &Vector<2>, n: &Vector<2>) -> f64 {
        let mut force = -n;
        let mut arm = point - self.joints[i].position;
        let mut sum = 0.0;
        for inner in (0..=i).rev() {
            let joint = &self.joints[inner];
            let e = -perp(arm).dot(&force);
            sum += e * e * joint.d_inv;
            force += joint.h * e;
            if inner > 0 {
                arm = self.joints[inner - 1].l;
            }
        }
        sum
    }

    fn add_force(&self, wrenches: &mut [PlanarWrench], i: usize, point: &Vector<2>, f: &Vector<2>) {
        wrenches[i].force += f;
        wrenches[i].moment += cross(point - self.joints[i].position, *f);
    }

    fn add_torque(&self, wrenches: &mut [PlanarWrench], i: usize, torque: &Vector<3>) {
        wrenches[i].moment += torque.z;
    }

    /// Its x axis is along the link; at the end effector, along the last one.
    fn link_frame(&self, i: usize) -> (Vector<2>, SMatrix<f64, 2, 2>) {
        let along = self.joints[i.min(self.joints.len() - 1)].x;
        (self.joint_position(i), SMatrix::from_columns(&[along, perp(along)]))
    }

    fn wrenches_tr_mul(&self, wrenches: &[PlanarWrench], out: &mut [f64]) {
        let mut carried = PlanarWrench::default();
        for ((joint, wrench), out) in self.joints.iter().zip(wrenches).zip(out.iter_mut()).rev() {
            carried.moment += cross(joint.l, carried.force) + wrench.moment;
            carried.force += wrench.force;
            *out = carried.moment;
        }
    }

    fn matrices<const M: usize>(&self) -> Matrices<M> {
        dense::planar(&self.arm, &self.q, &self.dq)
    }
}

/// A planar force \[N\] and its moment about the joint of the link it acts on \[N·m\].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PlanarWrench {
    /// Force \[N\].
    pub force: Vector<2>,
    /// Moment about the link's joint \[N·m\].
    pub moment: f64,
}

/// The first `M` components of a planar twist: two linear, one angular.
#[inline(always)]
fn twist<const M: usize>(linear: Vector<2>, angular: f64) -> SVector<f64, M> {
    const { assert!(M == 2 || M == 3, "a planar task has dimension 2 or 3") };
    SVector::from_fn(|row, _| if row < 2 { linear[row] } else { angular })
}

/// A task force as force and moment at the tip: the transpose of [`twist`].
#[inline(always)]
fn parts<const M: usize>(f: &SVector<f64, M>) -> (Vector<2>, f64) {
    (Vector::<2>::new(f[0], f[1]), if M > 2 { f[2] } else { 0.0 })
}

#[cfg(test)]
mod tests;
