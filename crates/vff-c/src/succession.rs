//! Other gains, another posture, load or tool in a loop that runs; the plan that is followed; how long a torque may be held.

use crate::controller::{Controller, make, with};
use crate::ffi_guard::{numbers, object, place, room, text};
use crate::robot::{Robot, hand_out, part};
use crate::status::{Fault, Status};
use std::ffi::c_char;
use toml::Table;
use vff_core::runtime::AnyController;
use vff_core::scenario::parse_toml;

/// A law that can take the place of that of `controller` while its loop runs: for a robot, with other loads or another tool, and with
/// settings as in `vff_controller_new`, whose `task` and `command` are those of `controller`. It has room for the obstacles of that; make it
/// anew when they have changed. Free it with `vff_controller_free`. Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_successor(
    controller: *const Controller,
    robot: *const Robot,
    settings: *const c_char,
    successor: *mut *mut Controller,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let (robot, to) = (object("robot", robot)?, place("successor", successor)?);
            let settings = match settings.is_null() {
                true => Table::new(),
                false => part(parse_toml(text("settings", settings)?)?, "controller"),
            };
            let like = AnyController::new(&robot.arm, &settings);
            let like = like.map_err(|error| error.inside("controller"))?;
            hand_out(make(inner.controller.successor(&like)?), to)
        })
    }
}

/// For the loop: `successor` takes the place of the law of `controller` within `duration` [s], in which the torque goes over from the one to
/// the other without a step. `successor` then has what is left, and can be freed and nothing else. Obstacles, reference and loop of
/// `controller` stay. With another tool a reference means another tip from then on; where a plan is followed, that allocates. While the
/// last succession is under way, or the torque is blended in, it comes to `VFF_STATUS_SUCCEEDING`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_succeed(
    controller: *mut Controller,
    successor: *mut Controller,
    duration: f64,
) -> Status {
    // SAFETY: pointers as C has them; of one that is given twice the second turn is refused.
    unsafe {
        with(controller, |inner| {
            let duration = numbers("duration", &raw const duration, 1, 1)?[0].max(0.0);
            let mut done = Ok(());
            let status = with(successor, |next| {
                done = inner.controller.succeed(&mut next.controller, duration).map(drop);
                Ok(())
            });
            match status {
                Status::Ok => Ok(done?),
                Status::Null => Err(Fault::Null("successor")),
                _ => Err(Fault::Busy("successor")),
            }
        })
    }
}

/// For the loop: where the plan that is followed has the joints, n numbers [rad, m], and where its clock is [s], which waits with
/// `governor`; that may be NULL. `VFF_STATUS_NO_REFERENCE` if the reference of the scenario is no plan.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_planned(
    controller: *const Controller,
    q: *mut f64,
    joints: usize,
    path_time: *mut f64,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let out = room("q", q, joints, inner.n)?;
            let controller = &inner.controller;
            let (planned, time) =
                controller.planned().zip(controller.path_time()).ok_or(Fault::NoScenario)?;
            out.fill(planned);
            if let Ok(to) = place("path_time", path_time) {
                to.write(time);
            }
            Ok(())
        })
    }
}

/// For the loop: the distance of every link from obstacle `id` at the observed state, n numbers [m], infinite of one without a shape, and
/// in `gradient`, n × n numbers, how it changes with the joints [m/rad, m/m]; that may be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_distances(
    controller: *const Controller,
    id: u32,
    distance: *mut f64,
    joints: usize,
    gradient: *mut f64,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let j = inner.place_of(id)?;
            let out = room("distance", distance, joints, inner.n)?;
            let rows = match gradient.is_null() {
                true => None,
                false => Some(room("gradient", gradient, inner.n * inner.n, inner.n * inner.n)?),
            };
            if !(inner.observed || inner.commanded) {
                return Err(Fault::NotObserved);
            }
            let rows = rows.map(|rows| rows.zeroed());
            inner.controller.write_distances(j, out.zeroed(), rows);
            Ok(())
        })
    }
}

/// How long a torque may be held at q and time `t` [s], at rest, before the null space oscillates (T34) [s]; infinite where nothing makes it.
/// Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_stable_period(
    controller: *mut Controller,
    t: f64,
    q: *const f64,
    joints: usize,
    period: *mut f64,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let q = numbers("q", q, joints, inner.n)?;
            numbers("t", &raw const t, 1, 1)?;
            let to = place("period", period)?;
            to.write(inner.controller.stable_period(q, t).period);
            Ok(())
        })
    }
}
