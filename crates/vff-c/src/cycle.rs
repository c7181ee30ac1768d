//! A loop that is watched over: what is to be sent, cycle by cycle.

use crate::controller::{Controller, Inner, given, with};
use crate::ffi_guard::{any_numbers, place, room};
use crate::status::{Fault, Status};
use vff_core::control::{self, output::Phase};
use vff_core::runtime::{Reading, VirtualArm};

impl Inner {
    fn cycle(&mut self, reading: Option<Reading<'_>>) -> Result<(&[f64], vff_phase), Fault> {
        self.receive();
        let given = given(self.follows, &self.reference, self.widths);
        let phase = self.controller.cycle(reading, given.as_ref())?;
        self.observed = false;
        self.commanded |= matches!(phase, Phase::Starting | Phase::Running);
        Ok((self.controller.sent().ok_or(Fault::NotBegun)?, phase.into()))
    }
}

/// What a cycle of a loop came to.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(non_camel_case_types, reason = "as in C")]
pub enum vff_phase {
    /// The torque is being blended in: at a safe start, and after an interruption.
    Starting = 0,
    /// The torque of the law is sent.
    Running = 1,
    /// The state is missing, for fewer than `command.missed_cycles` cycles: what was sent last is held.
    Holding = 2,
    /// The state is missing for longer, the torque of the law is not finite, or a joint is faster than twice its limit: the arm is
    /// damped and, at a state that comes, held once it is slow.
    Damping = 3,
    /// It has been missing for longer still: nothing is sent but gravity, if it is ours.
    Released = 4,
    /// The loop is over: the state did not come back. Another beginning leads out of this, or `vff_controller_reset`.
    Lost = 5,
    /// The end was asked for: the arm is damped and, once it is slow, held, until it stands.
    Stopping = 6,
    /// The loop is over: the arm stands, and is held as long as there are cycles.
    Finished = 7,
}

impl From<Phase> for vff_phase {
    fn from(phase: Phase) -> Self {
        match phase {
            Phase::Starting => Self::Starting,
            Phase::Running => Self::Running,
            Phase::Holding => Self::Holding,
            Phase::Damping => Self::Damping,
            Phase::Released => Self::Released,
            Phase::Lost => Self::Lost,
            Phase::Stopping => Self::Stopping,
            Phase::Finished => Self::Finished,
        }
    }
}

/// Begins a loop of `period` seconds that is watched over: from now on `vff_controller_cycle` says what is to be sent. The torque is
/// blended in from the `measured` one, n numbers [N·m, N] that contain gravity only if what is sent does, or, if that is NULL with
/// length 0 or cannot be, from what holds the arm still. Until the first state the measured one is sent, or nothing. A loop of set points
/// is over then. Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_begin(
    controller: *mut Controller,
    period: f64,
    measured: *const f64,
    joints: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let measured = match measured.is_null() && joints == 0 {
                true => None,
                false => Some(any_numbers("measured", measured, joints, inner.n)?),
            };
            inner.controller.begin(period, measured)?;
            inner.virtual_arm = None;
            (inner.observed, inner.commanded) = (false, false);
            Ok(())
        })
    }
}

/// For the loop: one cycle with the state that was measured at time `t` [s], n numbers each, or with none, if q and dq are NULL.
/// Writes what is to be sent, n numbers [N·m, N], and what the cycle came to. The state may be anything: one that is missing,
/// no newer than the last, not finite, or not to be reached from the last counts as missing. What is to be sent is finite, within the
/// torque limits and the rate of `command`, and does not depend on other states that are observed in between. Without a reference, the
/// motion of the end effector is damped. A loop that would begin far beyond the stops, or not where the reference of
/// the scenario begins, is refused (`VFF_STATUS_REFERENCE`): nothing is to be sent.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_cycle(
    controller: *mut Controller,
    t: f64,
    q: *const f64,
    dq: *const f64,
    tau: *mut f64,
    joints: usize,
    phase: *mut vff_phase,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let out = room("tau", tau, joints, inner.n)?;
            let to = place("phase", phase)?;
            let reading = match q.is_null() && dq.is_null() {
                true => None,
                false => Some(Reading {
                    t,
                    q: any_numbers("q", q, joints, inner.n)?,
                    dq: any_numbers("dq", dq, joints, inner.n)?,
                }),
            };
            let (tau, phase) = inner.cycle(reading)?;
            out.fill(tau);
            to.write(phase);
            Ok(())
        })
    }
}

/// What a loop has left out since it began: for lack of time before the `deadline`, or because of a bound.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LeftOut {
    /// Cycles that took longer than the deadline.
    pub late: u64,
    /// Cycles in which the look-ahead stopped for lack of time.
    pub cut: u64,
    /// Roll-outs that it did not make because of that.
    pub rollouts: u64,
    /// Points of clouds beyond the 64 that `cbf` keeps of a link, counted once a cycle.
    pub points: u64,
    /// Programs that ended with constraints left.
    pub programs: u64,
}

/// For the loop: what was left out since it began, or the last `vff_controller_reset`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_left_out(
    controller: *const Controller,
    left_out: *mut LeftOut,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let out = place("left_out", left_out)?;
            let control::LeftOut { late, cut, rollouts, points, programs } =
                inner.controller.left_out();
            out.write(LeftOut { late, cut, rollouts, points, programs });
            Ok(())
        })
    }
}

/// For the loop: ends it safely. From the next cycle on the arm, or its set point, is damped until it stands.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_stop(controller: *mut Controller) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            inner.controller.stop();
            inner.virtual_arm.iter_mut().for_each(VirtualArm::stop);
            Ok(())
        })
    }
}
