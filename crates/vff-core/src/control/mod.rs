//! From state and contacts to joint torque.
//!
//! [`Controller`] strings the parts together: [`operational_space`] (Λ and the null projector),
//! [`virtual_forces`] (the field's push), [`task`] (what acceleration the end effector should
//! have) and [`law`] or [`extended_jacobian`] (which torque does all of it).

pub mod extended_jacobian;
pub mod law;
pub mod operational_space;
pub mod settings;
pub mod task;
pub mod virtual_forces;

use crate::math::Vector;
use crate::robot::Robot;
use crate::trajectory::Sample;
use crate::world::Contact;
use nalgebra::{DMatrix, SMatrix};

pub use law::{Law, Torque};
pub use operational_space::OperationalSpace;
pub use settings::{Avoidance, Formulation, Gains, Projection, Settings, TaskKind};
pub use virtual_forces::VirtualForces;

/// A torque controller for a robot `R` with a task of dimension `M`.
///
/// Call [`observe`](Self::observe) with the state, then [`command`](Self::command) with the
/// reference. Nothing allocates after construction (`formulation = recursive`).
#[derive(Debug, Clone)]
pub struct Controller<R: Robot<D>, const D: usize, const M: usize> {
    robot: R,
    gains: Gains<M>,
    space: OperationalSpace<M>,
    forces: VirtualForces<R::Wrench, D>,
    law: Law,
    tau_sec: Vec<f64>,
}

impl<R: Robot<D>, const D: usize, const M: usize> Controller<R, D, M> {
    /// A controller for `robot`, with gains resolved for its number of joints.
    pub fn new(robot: R, gains: Gains<M>) -> Self {
        let n = robot.dof();
        Self {
            space: OperationalSpace::new(n, gains.singularity / robot.total_mass()),
            forces: VirtualForces::new(n),
            law: Law::new(n),
            tau_sec: vec![0.0; n],
            robot,
            gains,
        }
    }

    /// The robot at the observed state.
    pub fn robot(&self) -> &R {
        &self.robot
    }

    /// The gains in use.
    pub fn gains(&self) -> &Gains<M> {
        &self.gains
    }

    /// Λ, J# and N at the observed state.
    pub fn space(&self) -> &OperationalSpace<M> {
        &self.space
    }

    /// What the field does at the observed state.
    pub fn forces(&self) -> &VirtualForces<R::Wrench, D> {
        &self.forces
    }

    /// The torque of the last command [N·m].
    pub fn torque(&self) -> &Torque {
        &self.law.torque
    }

    /// The secondary torque τ_sec = τ_vff + posture spring, before projection [N·m].
    pub fn secondary_torque(&self) -> &[f64] {
        &self.tau_sec
    }

    /// Moves the controller's robot to (q, q̇), so that its links can be asked for.
    pub fn observe(&mut self, q: &[f64], dq: &[f64]) {
        self.robot.update(q, dq);
    }

    /// Clearances and forces from the contacts of all link–obstacle pairs at the observed state.
    pub fn sense(&mut self, contacts: &[Contact<D>]) {
        self.space.refresh(&self.robot);
        self.forces.refresh(&self.robot, &self.space, &self.gains.field, contacts);
    }

    /// The error x − x_r of the task at the observed state.
    pub fn error(&self, reference: &Sample<M>) -> Vector<M> {
        task::error(self.robot.pose(), reference.x)
    }

    /// The torque at the observed and sensed state for this reference.
    pub fn command(&mut self, reference: &Sample<M>) -> &Torque {
        let e = self.error(reference);
        let de = self.space.dx - reference.dx;
        let ddx_c = task::commanded_acceleration(&self.gains, reference, e, de);
        self.gains.posture_torque(self.robot.configuration(), &mut self.tau_sec);
        for (sec, vff) in self.tau_sec.iter_mut().zip(self.forces.torque()) {
            *sec += vff;
        }
        match self.gains.formulation {
            Formulation::Recursive => {
                self.law.evaluate(&self.robot, &self.space, &self.gains, &ddx_c, &self.tau_sec);
            }
            Formulation::ExtendedJacobian => extended_jacobian::evaluate(
                &self.robot,
                &self.space,
                &self.gains,
                &ddx_c,
                &self.tau_sec,
                &mut self.law,
            ),
        }
        &self.law.torque
    }

    /// The null projector N of the chosen projection as a matrix, (n, n), for people.
    pub fn null_projector(&self) -> DMatrix<f64> {
        let n = self.robot.dof();
        let j = self.robot.matrices::<M>().jacobian;
        let identity = DMatrix::identity(n, n);
        match self.gains.projection {
            Projection::Dynamic => {
                let pinv = DMatrix::from_fn(n, M, |k, i| (self.space.lambda * self.space.y[k])[i]);
                identity - pinv * j
            }
            Projection::Kinematic => {
                let gram: SMatrix<f64, M, M> = &j * j.transpose();
                let inverse = gram.try_inverse().unwrap_or_else(SMatrix::zeros);
                identity - j.transpose() * inverse * j
            }
            Projection::None => identity,
        }
    }

    /// The power that damping takes from the null space, (N q̇)ᵀ D_q N q̇ ≥ 0 [W].
    pub fn damping_power(&self) -> f64 {
        self.law.damping_power
    }

    /// Power of the secondary torque on the null motion, (N q̇)ᵀ τ_sec [W].
    pub fn null_power(&self) -> f64 {
        let along_task: f64 = self.space.dx.dot(&self.space.pinv_tr_mul(&self.tau_sec));
        dot(self.robot.velocity(), &self.tau_sec) - along_task
    }

    /// Kinetic energy of the null motion, ½ νᵀΛ_nν = ½ q̇ᵀMq̇ − ½ ẋᵀΛẋ [J].
    pub fn null_energy(&self, scratch: &mut [f64]) -> f64 {
        let dq = self.robot.velocity();
        self.robot.mass_mul(dq, scratch);
        0.5 * (dot(dq, scratch) - self.space.dx.dot(&(self.space.lambda * self.space.dx)))
    }
}

/// `a · b`.
#[inline]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
