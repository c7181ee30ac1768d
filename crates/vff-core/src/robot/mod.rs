//! What the arm is: kinematics and dynamics as operators.
//!
//! The control law never sees a matrix of the robot. It sees the operators of [`Robot`], each of
//! which costs O(n) and allocates nothing, so that another kind of arm can move in behind the same
//! trait. A [`Model`] is what is immutable of an arm, a [`Manipulator`] what a robot is for one kind of
//! task. [`planar`] implements them for `n` revolute links in the plane; [`dense`] holds the same
//! quantities as matrices, from textbook formulas that share no code with the recursions.

pub mod dense;
pub mod description;
mod description_error;
mod frame;
pub mod inertia;
mod limits;
mod link_shape;
#[cfg(feature = "models")]
pub mod models;
mod names;
pub mod planar;
mod solid;
pub mod spatial;
#[cfg(feature = "models")]
pub mod urdf;

use crate::geometry::{Body, ContactFeature, Form, StillBody};
use crate::math::{Pose, Vector};
use nalgebra::{SMatrix, SVector};
use std::fmt::Debug;
use std::sync::Arc;

pub use dense::Matrices;
pub use limits::Limits;
pub use planar::{PlanarArm, PlanarState};
pub use spatial::{SpatialArm, SpatialState};

/// What is immutable of an arm in `D`-dimensional space. Its states refer to it.
pub trait Model<const D: usize>: Debug + Clone + Send + Sync + 'static {
    /// The arm at one instant.
    type State: Robot<D> + Clone + Debug;

    /// The number of joints n.
    fn dof(&self) -> usize;
    /// What the joints can do.
    fn limits(&self) -> &Limits;
    /// Whether a joint slides; it turns otherwise.
    fn slides(&self, _joint: usize) -> bool {
        false
    }
    /// Whether each joint turns without an end.
    fn endless(&self) -> Vec<bool> {
        let has_end = |i: usize| {
            self.limits().joint.get(i).is_some_and(|ends| ends.iter().any(|end| end.is_finite()))
        };
        (0..self.dof()).map(|i| !self.slides(i) && !has_end(i)).collect()
    }
    /// What a joint is called.
    fn joint_name(&self, joint: usize) -> String {
        format!("joint_{}", joint + 1)
    }
    /// What the link is called that a joint moves.
    fn link_name(&self, link: usize) -> String {
        format!("link_{}", link + 1)
    }
    /// What all of them are called, from the base on.
    fn link_names(&self) -> Vec<String> {
        (0..self.dof()).map(|i| self.link_name(i)).collect()
    }
    /// Advances a configuration along the joint velocity `v` for the time `dt`.
    fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64);
    /// A distance from the base that the end effector cannot exceed \[m\].
    fn reach(&self) -> f64;
    /// The radius at which an angle of the task counts as much as its arc, where nothing else is said \[m\].
    fn characteristic_length(&self) -> f64;
    /// Torques that carry the arm where it is heaviest and accelerate it there \[N·m\], (n).
    fn typical_torque(self: &Arc<Self>) -> Vec<f64>;
    /// A state of this arm at q = 0, at rest.
    fn state(self: &Arc<Self>) -> Self::State;
}

/// A robot whose end effector has a task of dimension `M`.
pub trait Manipulator<const D: usize, const M: usize>: Robot<D> {
    /// What the task means by a pose.
    type Pose: Pose<M>;

    /// The pose of the end effector.
    fn pose(&self) -> Self::Pose;
    /// ẋ_r and ẍ_r of a reference at the pose `reference` in the rows of J, with what keeps the error's own motion
    /// apart from that of the reference (T104). As they are, where rows and error are those of coordinates.
    #[inline]
    fn resolve(
        &self,
        _reference: &Self::Pose,
        dx: &SVector<f64, M>,
        ddx: &SVector<f64, M>,
    ) -> [SVector<f64, M>; 2] {
        [*dx, *ddx]
    }

    /// ẋ_r and ẍ_r of the reference that this robot is to others, while its joints accelerate by `ddq`.
    fn motion(&self, ddq: &[f64]) -> [SVector<f64, M>; 2] {
        [self.task_velocity(), self.jacobian_mul(ddq) + self.task_bias_acceleration()]
    }
}

/// An arm in `D`-dimensional space at one instant: the operators M, C, g, J, J̇ at a state (q, q̇).
///
/// Joint vectors are slices of length [`dof`](Robot::dof); a slice of another length is a
/// programming error and panics. `M` is the dimension of the task: the first `M` components of the
/// end effector's twist, positions before orientation.
pub trait Robot<const D: usize> {
    /// Force and moment acting on one link.
    type Wrench: Copy + Default + Debug;

    /// The number of joints n.
    fn dof(&self) -> usize;
    /// Moves to the state (q \[rad\], q̇ \[rad/s\]) and refreshes everything the operators need.
    fn update(&mut self, q: &[f64], dq: &[f64]);
    /// Moves to q \[rad\] as far as [`pose`](Manipulator::pose), [`body`](Self::body) and the columns of J
    /// need it; nothing else means anything until the next [`update`](Self::update).
    fn update_positions(&mut self, q: &[f64]);
    /// Takes in the joint velocity `v` \[rad/s\] as far as [`point_velocity`](Self::point_velocity) needs it, after
    /// [`update_positions`](Self::update_positions).
    fn update_velocities(&mut self, v: &[f64]);
    /// The configuration q \[rad\].
    fn configuration(&self) -> &[f64];
    /// The joint velocity q̇ \[rad/s\].
    fn velocity(&self) -> &[f64];
    /// Advances a configuration along the joint velocity `v` for the time `dt`.
    fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64);
    /// The mass of all links \[kg\]: the scale of Λ.
    fn total_mass(&self) -> f64;
    /// What the joints can do.
    fn limits(&self) -> &Limits;

    /// `out = M v`.
    fn mass_mul(&self, v: &[f64], out: &mut [f64]);
    /// `out = M⁻¹ b`.
    fn mass_solve(&self, b: &[f64], out: &mut [f64]);
    /// `out = C v`, C the Christoffel matrix at (q, q̇).
    fn coriolis_mul(&self, v: &[f64], out: &mut [f64]);
    /// `out = Cᵀ u`.
    fn coriolis_tr_mul(&self, u: &[f64], out: &mut [f64]);
    /// `out = g(q)`, the torque that holds the arm against gravity \[N·m\].
    fn gravity_torque(&self, out: &mut [f64]);
    /// `momentum = M q̇ − Jᵀp` and `coriolis = C q̇` at the robot's velocity. With p = Λẋ the first is
    /// the momentum M N q̇ of the null motion, without a product more, because M J# = JᵀΛ.
    fn momentum_and_coriolis<const M: usize>(
        &self,
        p: &SVector<f64, M>,
        momentum: &mut [f64],
        coriolis: &mut [f64],
    ) {
        self.mass_mul(self.velocity(), momentum);
        self.coriolis_mul(self.velocity(), coriolis);
        for (i, momentum) in momentum.iter_mut().enumerate() {
            *momentum -= p.dot(&self.jacobian_column(i));
        }
    }
    /// `momentum = M q̇` and `drift = ∂L/∂q = Cᵀq̇ − g`, by which it changes beside the torque: d(M q̇)/dt = τ + ∂L/∂q
    /// (T186).
    fn momentum_and_drift(&self, momentum: &mut [f64], drift: &mut [f64]) {
        self.gravity_torque(momentum);
        self.coriolis_tr_mul(self.velocity(), drift);
        drift.iter_mut().zip(&*momentum).for_each(|(drift, gravity)| *drift -= gravity);
        self.mass_mul(self.velocity(), momentum);
    }
    /// `out = J̇ᵀ p − Cᵀ u`. With u = J#ẋ and p = Λẋ it is what couples the null space to the task.
    fn coupling_torque<const M: usize>(&self, p: &SVector<f64, M>, u: &[f64], out: &mut [f64]) {
        self.coriolis_tr_mul(u, out);
        for (i, out) in out.iter_mut().enumerate() {
            *out = p.dot(&self.jacobian_dot_column(i)) - *out;
        }
    }
    /// `out = C q̇ + g` at the robot's velocity \[N·m\].
    fn bias_torque(&self, out: &mut [f64]);
    /// `out = M q̈ + C q̇ + g` at the robot's velocity \[N·m\] (T2).
    fn inverse_dynamics(&self, ddq: &[f64], scratch: &mut [f64], out: &mut [f64]) {
        self.mass_mul(ddq, out);
        self.bias_torque(scratch);
        out.iter_mut().zip(scratch.iter()).for_each(|(out, bias)| *out += bias);
    }
    /// `out = M⁻¹(τ − C q̇ − g)` at the robot's velocity \[rad/s²\] (T2).
    fn forward_dynamics(&self, tau: &[f64], scratch: &mut [f64], out: &mut [f64]) {
        self.bias_torque(scratch);
        scratch.iter_mut().zip(tau).for_each(|(rest, tau)| *rest = tau - *rest);
        self.mass_solve(scratch, out);
    }
    /// `out = M⁻¹(τ − bias)` where the bias C q̇ + g is known already \[rad/s²\].
    fn accelerate(&self, tau: &[f64], bias: &[f64], scratch: &mut [f64], out: &mut [f64]) {
        for ((rest, bias), tau) in scratch.iter_mut().zip(bias).zip(tau) {
            *rest = tau - bias;
        }
        self.mass_solve(scratch, out);
    }
    /// The potential energy of gravity \[J\]; its gradient is g.
    fn potential_energy(&self) -> f64;

    /// How the end effector turns \[rad/s\], and how that changes while q̈ = 0 \[rad/s²\], about three axes; in the plane about the
    /// last.
    fn turning(&self) -> [Vector<3>; 2];
    /// How joint `i` turns the end effector, about the same axes.
    fn turning_column(&self, i: usize) -> Vector<3>;
    /// ẋ = J q̇, the velocity of the end effector.
    fn task_velocity<const M: usize>(&self) -> SVector<f64, M>;
    /// J̇ q̇, the acceleration of the end effector while q̈ = 0.
    fn task_bias_acceleration<const M: usize>(&self) -> SVector<f64, M>;
    /// Column `i` of J: what joint `i` does to the end effector.
    fn jacobian_column<const M: usize>(&self, i: usize) -> SVector<f64, M>;
    /// Column `i` of J̇.
    fn jacobian_dot_column<const M: usize>(&self, i: usize) -> SVector<f64, M>;
    /// `J v`.
    fn jacobian_mul<const M: usize>(&self, v: &[f64]) -> SVector<f64, M> {
        v.iter()
            .enumerate()
            .fold(SVector::zeros(), |sum, (i, v)| sum + self.jacobian_column(i) * *v)
    }
    /// `out = Jᵀ f`.
    fn jacobian_tr_mul<const M: usize>(&self, f: &SVector<f64, M>, out: &mut [f64]) {
        out.iter_mut().enumerate().for_each(|(i, out)| *out = f.dot(&self.jacobian_column(i)));
    }
    /// `J̇ v`.
    fn jacobian_dot_mul<const M: usize>(&self, v: &[f64]) -> SVector<f64, M> {
        let column = |i| self.jacobian_dot_column(i);
        v.iter().enumerate().fold(SVector::zeros(), |sum, (i, v)| sum + column(i) * *v)
    }
    /// `out = J̇ᵀ f`.
    fn jacobian_dot_tr_mul<const M: usize>(&self, f: &SVector<f64, M>, out: &mut [f64]) {
        out.iter_mut().enumerate().for_each(|(i, out)| *out = f.dot(&self.jacobian_dot_column(i)));
    }
    /// The response of the arm to unit task forces: fills `y = M⁻¹Jᵀ` (row i belongs to joint i)
    /// and returns `Λ⁻¹ = J M⁻¹ Jᵀ` (T24: one factorisation, `M` half solves).
    fn task_response<const M: usize>(&self, y: &mut [SVector<f64, M>]) -> SMatrix<f64, M, M>;

    /// [`update`](Self::update) and [`task_response`](Self::task_response) in one.
    fn update_with_response<const M: usize>(
        &mut self,
        q: &[f64],
        dq: &[f64],
        y: &mut [SVector<f64, M>],
    ) -> SMatrix<f64, M, M> {
        self.update(q, dq);
        self.task_response(y)
    }
    /// [`update`](Self::update) and [`forward_dynamics`](Self::forward_dynamics) in one.
    fn update_with_dynamics(
        &mut self,
        q: &[f64],
        dq: &[f64],
        tau: &[f64],
        scratch: &mut [f64],
        out: &mut [f64],
    ) {
        self.update(q, dq);
        self.forward_dynamics(tau, scratch, out);
    }

    /// The number of bodies: what is measured against obstacles and against each other.
    fn body_count(&self) -> usize;
    /// Body `i` in the world.
    fn body(&self, i: usize) -> Body<'_, D>;
    /// All of them, from the base.
    fn bodies(&self) -> impl Iterator<Item = Body<'_, D>> {
        (0..self.body_count()).map(|i| self.body(i))
    }
    /// Bodies that the base carries, in the world: they do not move. An arm may touch its own base.
    fn still_bodies(&self) -> &[StillBody<D>] {
        &[]
    }
    /// The pairs of bodies that must not touch each other, the lower index first; the still ones are counted behind the
    /// others.
    fn body_pairs(&self) -> impl Iterator<Item = [usize; 2]>;
    /// Calls `visit` with the nearest parts of a pair of these bodies, of which one is a hull, or with all its `features` nearer
    /// than this \[m\] that may be the nearest when these change hands. Nothing where both are capsules.
    fn for_each_encounter(
        &self,
        _pair: [usize; 2],
        _features: Option<f64>,
        _visit: &mut dyn FnMut(&ContactFeature<D>),
    ) {
    }
    /// The velocity `J_c q̇` of the material point of link `i` that is now at `point` \[m/s\].
    fn point_velocity(&self, i: usize, point: &Vector<D>) -> Vector<D>;
    /// `out = J_cᵀ f` for a force at `point` of link `i`.
    fn point_jacobian_tr_mul(&self, i: usize, point: &Vector<D>, f: &Vector<D>, out: &mut [f64]);
    /// `J̇_c q̇`, the acceleration of a point of link `i` while q̈ = 0 \[m/s²\].
    fn point_bias_acceleration(&self, i: usize, point: &Vector<D>) -> Vector<D>;
    /// `nᵀ J_c M⁻¹ J_cᵀ n`, the acceleration along `n` per unit force along `n` \[1/kg\].
    fn point_mobility(&self, i: usize, point: &Vector<D>, n: &Vector<D>) -> f64;
    /// Adds a force acting at `point` of link `i` to the wrench of that link.
    fn add_force(&self, wrenches: &mut [Self::Wrench], i: usize, point: &Vector<D>, f: &Vector<D>);
    /// Adds a torque \[N·m\] to the wrench of link `i`: about the axes of the world, of which the plane has the third.
    fn add_torque(&self, wrenches: &mut [Self::Wrench], i: usize, torque: &Vector<3>);
    /// The origin \[m\] and the axes, one per column, of the frame of link `i` in the world; `i = n` is that of the end
    /// effector.
    fn link_frame(&self, i: usize) -> (Vector<D>, SMatrix<f64, D, D>);
    /// `out = Σ J_iᵀ F_i`, all links' wrenches in one backward sweep \[N·m\]. Both may end at the last
    /// link with a wrench.
    fn wrenches_tr_mul(&self, wrenches: &[Self::Wrench], out: &mut [f64]);

    /// The same robot at the same state as matrices, for the explicit extended-Jacobian form.
    fn matrices<const M: usize>(&self) -> Matrices<M>;
}

/// Body `i` of a robot as it is measured, the still ones counted behind the others.
#[inline]
pub(crate) fn form_of<R: Robot<D>, const D: usize>(robot: &R, i: usize) -> Form<'_, D> {
    match robot.still_bodies().get(i.wrapping_sub(robot.body_count())) {
        Some(still) => (still.shape, still.placed_hull()),
        None => robot.body(i).form(),
    }
}
