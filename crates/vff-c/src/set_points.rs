//! Set points of the law, for robots that take positions or velocities.

use crate::controller::{Controller, Follows, Inner, given, with};
use crate::ffi_guard::{any_numbers, numbers, object, place, room};
use crate::status::{Fault, Status};
use vff_core::math::ScalarOrVec;
use vff_core::runtime::{Course, SetPointLimits, VirtualArm};

impl Inner {
    fn set_point(
        &mut self,
        t: f64,
        measured: Option<[&[f64]; 2]>,
    ) -> Result<([&[f64]; 3], vff_course), Fault> {
        self.receive();
        let given = given(self.follows, &self.reference, self.widths);
        let arm = self.virtual_arm.as_mut().ok_or(Fault::NoSetPoints)?;
        let course = arm.step(&mut self.controller, t, given.as_ref(), measured)?;
        (self.observed, self.commanded) = (false, true);
        Ok((arm.set_point(), course.into()))
    }
}

/// What the joints of a robot that takes positions or velocities may do.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
#[allow(non_camel_case_types, reason = "as in C")]
pub struct vff_set_point_limits {
    /// Largest speeds, n numbers [rad/s, m/s]; NULL for those of the arm.
    pub speed: *const f64,
    /// Largest accelerations, n numbers [rad/s², m/s²].
    pub acceleration: *const f64,
    /// Largest jerks, n numbers [rad/s³, m/s³].
    pub jerk: *const f64,
    /// How far a joint of the robot may be from its set point [rad, m].
    pub threshold: f64,
}

/// What a set point comes from.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(non_camel_case_types, reason = "as in C")]
pub enum vff_course {
    /// From the law.
    Following = 0,
    /// A joint and its set point were farther apart than the threshold: the set point comes to the robot.
    Rejoining = 1,
    /// The robot has not been heard of for 20 cycles, or the torque of the law is not finite: the set point stops.
    Waiting = 2,
    /// The end was asked for: the set point stops.
    Stopping = 3,
    /// It stands.
    Finished = 4,
}

impl From<Course> for vff_course {
    fn from(course: Course) -> Self {
        match course {
            Course::Following => Self::Following,
            Course::Rejoining => Self::Rejoining,
            Course::Waiting => Self::Waiting,
            Course::Stopping => Self::Stopping,
            Course::Finished => Self::Finished,
        }
    }
}

/// Begins a loop of `period` seconds with a robot that takes positions or velocities and is at rest at q, n numbers: the closed loop
/// runs on the model, whose state is the set point. The past is forgotten, and the reference of a scenario begins `command.blend_time`
/// after the first set point, at whatever time that is. A robot that is far beyond its stops, or not where that reference begins, is
/// refused (`VFF_STATUS_REFERENCE`). A loop of torques that was watched over is over then, and torques that are asked for are those
/// from which set points are made, and change none, until `vff_controller_begin`, or `vff_controller_reset` after they have finished.
/// Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_begin_set_points(
    controller: *mut Controller,
    period: f64,
    limits: *const vff_set_point_limits,
    q: *const f64,
    joints: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let (given, n) = (object("limits", limits)?, inner.n);
            let q = numbers("q", q, joints, n)?;
            let each = |name, values| numbers(name, values, n, n).map(<[f64]>::to_vec);
            let speed = match given.speed.is_null() {
                true => None,
                false => Some(ScalarOrVec::Each(each("speed", given.speed)?)),
            };
            let limits = SetPointLimits {
                speed,
                acceleration: ScalarOrVec::Each(each("acceleration", given.acceleration)?),
                jerk: ScalarOrVec::Each(each("jerk", given.jerk)?),
                threshold: given.threshold,
            };
            let missed = inner.controller.missed_start(q);
            if let Some(missed) = missed.filter(|_| inner.follows == Follows::Scenario) {
                return Err(Fault::Elsewhere(missed));
            }
            inner.virtual_arm = Some(VirtualArm::new(&mut inner.controller, &limits, period, q)?);
            (inner.observed, inner.commanded) = (false, false);
            Ok(())
        })
    }
}

/// For the loop: one cycle, from the set point for the time `t` [s] to the next. Writes its angles, velocities and accelerations, n
/// numbers each, and what it comes from. `measured_q` and `measured_dq` are the state of the robot; NULL, both, or numbers that are none
/// mean that it has not been heard of. Without a reference, the motion of the end effector is damped.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_set_point(
    controller: *mut Controller,
    t: f64,
    measured_q: *const f64,
    measured_dq: *const f64,
    q: *mut f64,
    dq: *mut f64,
    ddq: *mut f64,
    joints: usize,
    course: *mut vff_course,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let n = inner.n;
            let out = [("q", q), ("dq", dq), ("ddq", ddq)];
            let [q, dq, ddq] = out.map(|(name, data)| room(name, data, joints, n));
            let (out, to) = ([q?, dq?, ddq?], place("course", course)?);
            numbers("t", &raw const t, 1, 1)?;
            let measured = match measured_q.is_null() && measured_dq.is_null() {
                true => None,
                false => Some([
                    any_numbers("measured_q", measured_q, joints, n)?,
                    any_numbers("measured_dq", measured_dq, joints, n)?,
                ]),
            };
            let (values, course) = inner.set_point(t, measured)?;
            out.into_iter().zip(values).for_each(|(out, values)| out.fill(values));
            to.write(course);
            Ok(())
        })
    }
}
