//! What is around the robot.

use crate::controller::{Controller, with};
use crate::ffi_guard::{numbers, place, text};
use crate::status::{Fault, Status};
use std::ffi::c_char;
use vff_core::scenario::parse_toml;

/// Adds an obstacle from TOML: one of the tables `obstacles` of a scenario. `id` gets its number, which stays its own; it may be
/// NULL. Allocates, so that no later torque does for it; observe the state again before the next torque. What is odd about the obstacle
/// joins the warnings of `vff_controller_warning`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_add_obstacle(
    controller: *mut Controller,
    toml: *const c_char,
    id: *mut u32,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let document = parse_toml(text("toml", toml)?)?;
            let odd = inner.controller.add(&document)?;
            let number = inner.next_id;
            inner.warn(odd.iter().map(|warning| format!("obstacles[{number}].{warning}")));
            inner.ids.push(number);
            inner.next_id += 1;
            inner.observed = false;
            if let Ok(id) = place("id", id) {
                id.write(number);
            }
            Ok(())
        })
    }
}

/// For the loop: obstacle `id` is at `position` [m] at time `t` [s] and goes on at `velocity` [m/s] until it is moved again;
/// NULL is at rest. `dimension` is their length. It turns as before. With `command.obstacle_speed`, one that cannot have come there since
/// it was moved last goes there at that speed. The first time, what a motion of way points took is freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_move_obstacle(
    controller: *mut Controller,
    id: u32,
    t: f64,
    position: *const f64,
    velocity: *const f64,
    dimension: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let (j, expected) = (inner.place_of(id)?, inner.controller.dimension());
            numbers("t", &raw const t, 1, 1)?;
            let position = numbers("position", position, dimension, expected)?;
            let velocity = match velocity.is_null() {
                true => &[0.0; 3][..expected],
                false => numbers("velocity", velocity, dimension, expected)?,
            };
            inner.controller.place(j, t, position, velocity);
            Ok(())
        })
    }
}

/// For the loop: obstacle `id` has this orientation at time `t` [s], and turns on at `rate` until it is turned again; NULL is at rest. In space
/// a unit quaternion (w, x, y, z) and 3 numbers, an angular velocity in world axes [rad/s]; in the plane an angle [rad] and its rate, one
/// number each. `length` is that of the orientation. It moves as before. Of one that has not turned before, it allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_turn_obstacle(
    controller: *mut Controller,
    id: u32,
    t: f64,
    orientation: *const f64,
    length: usize,
    rate: *const f64,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let j = inner.place_of(id)?;
            numbers("t", &raw const t, 1, 1)?;
            let [turns, rates] = if inner.controller.dimension() == 3 { [4, 3] } else { [1, 1] };
            let orientation = numbers("orientation", orientation, length, turns)?;
            let rate = match rate.is_null() {
                true => &[0.0; 3][..rates],
                false => numbers("rate", rate, rates, rates)?,
            };
            let turned = inner.controller.turn(j, t, orientation, rate);
            turned.map_err(|fault| Fault::Turn("orientation", fault))?;
            Ok(())
        })
    }
}

/// Takes obstacle `id` away. Frees memory; observe the state again before the next torque.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_remove_obstacle(
    controller: *mut Controller,
    id: u32,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let j = inner.place_of(id)?;
            inner.controller.remove(j);
            inner.ids.remove(j);
            inner.observed = false;
            inner.clouds.retain(|(of, mailbox)| {
                if *of == id {
                    mailbox.close();
                }
                *of != id
            });
            Ok(())
        })
    }
}

/// The numbers of the obstacles, ascending: writes at most `room` of them to `ids`, which may be NULL if that is 0, and to
/// `count` how many there are.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_obstacles(
    controller: *const Controller,
    ids: *mut u32,
    room: usize,
    count: *mut usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let count = place("count", count)?;
            let written = room.min(inner.ids.len());
            if written > 0 {
                if ids.is_null() {
                    return Err(Fault::Null("ids"));
                }
                ids.copy_from_nonoverlapping(inner.ids.as_ptr(), written);
            }
            count.write(inner.ids.len());
            Ok(())
        })
    }
}
