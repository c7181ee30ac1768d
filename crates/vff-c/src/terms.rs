//! What a torque consists of, and the null space that it acts in.

use crate::controller::{Controller, with};
use crate::ffi_guard::{place, room};
use crate::status::{Fault, Status};

/// The parts of the last torque. Arrays have n numbers and are valid until the next call with the controller but
/// `vff_controller_terms`.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Terms {
    /// The number of joints n.
    pub joints: usize,
    /// Joint torque of the law, whatever `command` makes of it [N·m].
    pub tau: *const f64,
    /// What serves the task, and what makes it give way [N·m].
    pub tau_task: *const f64,
    /// What acts in the null space [N·m].
    pub tau_null: *const f64,
    /// Repulsion before its projection [N·m].
    pub tau_vff: *const f64,
    /// Magnitude of the repulsion on each link [N].
    pub force: *const f64,
    /// Signed distance of each link's surface to the nearest obstacle's [m]; infinite without one.
    pub clearance: *const f64,
    /// Energies: kinetic, gravitational, of the null space [J].
    pub energy: [f64; 3],
    /// Powers of actuators, damping, task, obstacles, approach, scaling [W].
    pub power: [f64; 6],
    /// What the limits let through of posture, task, damping, avoidance, compensation, speed; 0 to 1.
    pub objective_scale: [f64; 6],
    /// By how much barriers are violated at most [m/s²]; NaN without `avoidance = "cbf"`.
    pub slack: f64,
    /// Energy in the tank [J]; NaN without one.
    pub tank: f64,
    /// Signed distance of the nearest two links that share no joint [m]; infinite if not measured.
    pub self_clearance: f64,
    /// √det(J Jᵀ), 0 in a singularity.
    pub manipulability: f64,
    /// ‖J M⁻¹ τ_null‖ [m/s²]: what leaks into the task.
    pub null_acceleration: f64,
    /// Whether the task force is damped because of a singularity.
    pub singular: bool,
}

/// For the loop: the parts of the last torque.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_terms(
    controller: *const Controller,
    terms: *mut Terms,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let out = place("terms", terms)?;
            if !inner.commanded {
                return Err(Fault::NoTorque);
            }
            let found = inner.controller.terms_view();
            let scalars = &found.scalars;
            out.write(Terms {
                joints: inner.n,
                tau: found.tau.as_ptr(),
                tau_task: found.tau_task.as_ptr(),
                tau_null: found.tau_null.as_ptr(),
                tau_vff: found.tau_vff.as_ptr(),
                force: found.force.as_ptr(),
                clearance: found.clearance.as_ptr(),
                energy: scalars.energy,
                power: scalars.power,
                objective_scale: scalars.objective_scale,
                slack: scalars.slack.unwrap_or(f64::NAN),
                tank: scalars.tank.unwrap_or(f64::NAN),
                self_clearance: scalars.self_clearance,
                manipulability: scalars.manipulability,
                null_acceleration: scalars.null_acceleration,
                singular: scalars.singular,
            });
            Ok(())
        })
    }
}

/// The null-space projector at the observed state, n × n numbers, row by row. Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_null_projector(
    controller: *const Controller,
    projector: *mut f64,
    length: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let out = room("projector", projector, length, inner.n * inner.n)?;
            if !inner.commanded {
                return Err(Fault::NoTorque);
            }
            out.fill(inner.controller.null_projector().transpose().as_slice());
            Ok(())
        })
    }
}
