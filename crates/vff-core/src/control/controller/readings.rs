//! What people and records want to know of the last command.

use super::ReactiveController;
use crate::control::{
    Energy, ObjectiveScale, Power, Projection, StablePeriod, Tank, operational_space, sampling,
};
use crate::math::dot;
use crate::robot::Manipulator;
use crate::world::CollisionQuery;
use nalgebra::{DMatrix, SMatrix};

impl<R: Manipulator<D, M>, const D: usize, const M: usize> ReactiveController<R, D, M> {
    /// √det(J Jᵀ) at the observed state \[m²\]; 0 in a singularity.
    pub fn manipulability(&self) -> f64 {
        operational_space::manipulability::<R, D, M>(&self.robot)
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

    /// C q̇ + g at the state of the last command, less the external torque that is known \[N·m\].
    pub fn bias(&self) -> &[f64] {
        &self.law.bias
    }

    /// C q̇ + g at the state of the last command \[N·m\].
    pub fn model_bias(&self) -> &[f64] {
        self.observer.as_ref().map_or(&self.law.bias, |observer| observer.model_bias())
    }

    /// ‖J M⁻¹ τ_null‖ of the last command: what leaks into the task \[m/s²\] (T4).
    pub fn null_acceleration(&self) -> f64 {
        self.gains.metric::<D>().norm(&self.space.response(&self.law.torque.null))
    }

    /// Energies of the arm at the last command.
    pub fn energy(&self) -> Energy {
        let (dx, q) = (&self.space.dx, self.robot.configuration());
        Energy {
            kinetic: 0.5 * dx.dot(&(self.space.lambda * dx)) + self.law.null_energy,
            gravitational: self.robot.potential_energy(),
            null_storage: self.law.null_energy
                + self.forces.potential()
                + self.joint_limit_potential
                + self.gains.posture_energy(q),
        }
    }

    /// Powers through the ports of (T17) at the last command, and that of `applied`, the torque of the
    /// motors \[N·m\].
    pub fn power(&self, applied: &[f64]) -> Power {
        let Self { robot, space, forces, law, .. } = self;
        let mut along_task = space.dx.dot(&space.pinv_tr_mul(&self.tau_sec));
        if self.share < 1.0 {
            along_task += (1.0 - self.share) * space.dx.dot(&space.pinv_tr_mul(&self.repulsion));
        }
        Power {
            actuators: dot(robot.velocity(), applied),
            damping: -law.damping_power,
            task: -along_task,
            obstacles: forces.obstacle_power(),
            approach: forces.approach_power(),
            scaling: self.scaling,
        }
    }

    /// The share that was granted of each objective at the last command ([`OBJECTIVES`](crate::control::limits::OBJECTIVES)).
    pub fn objective_scale(&self) -> &ObjectiveScale {
        &self.objective_scale
    }

    /// The energy tank, if there is one.
    pub fn tank(&self) -> Option<&Tank> {
        self.tank.as_ref()
    }

    /// The largest control period at which the null space is stable at the observed state (T34).
    /// Allocates.
    pub fn stable_period(&self, surroundings: &mut impl CollisionQuery<D>) -> StablePeriod {
        sampling::stable_period(&self.robot, &self.space, &self.gains, surroundings)
    }

    /// The same for an obstacle that is still to come, at `speed` \[m/s\]. Allocates.
    pub fn stable_period_against(&self, speed: f64) -> StablePeriod {
        sampling::stable_period_against(&self.robot, &self.space, &self.gains, speed)
    }

    /// The last program of `cbf`.
    #[cfg(test)]
    pub(crate) fn barrier(&self) -> Option<&crate::control::avoidance::barrier::Barrier> {
        self.avoider.as_ref().and_then(|avoider| avoider.barrier())
    }
}
