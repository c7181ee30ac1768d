//! Where the tip of a robot is and how it gets somewhere, and what it carries.

use crate::ffi_guard::{guarded, numbers, object, place, room};
use crate::robot::{Robot, hand_out};
use crate::status::{Fault, Status};
use toml::Table;
use vff_core::scenario::LoadSpec;

/// The Jacobian of the tip at q, row by row: in space 6 × n numbers, linear then angular in world axes; in the plane 2 × n, of its
/// position. Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_jacobian(
    robot: *const Robot,
    q: *const f64,
    joints: usize,
    jacobian: *mut f64,
    length: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let arm = &object("robot", robot)?.arm;
        let q = numbers("q", q, joints, arm.dof())?;
        let rows = if arm.dimension() == 3 { 6 } else { 2 };
        let out = room("jacobian", jacobian, length, rows * arm.dof())?;
        let found = arm.at(q, &vec![0.0; q.len()]).jacobian();
        out.fill(found.transpose().as_slice()); // it is kept column by column
        Ok(())
    })
}

/// A posture in which the tip has this pose: a position [m], or position and orientation, as `vff_robot_pose` writes it. Moves `q`,
/// where the search begins, to the nearest posture within the joint limits that it finds, from there and from elsewhere, and writes to
/// `gap`, two numbers, how far the tip stays away [m, rad]: below 1e-6 both, it is there. Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_inverse_kinematics(
    robot: *const Robot,
    pose: *const f64,
    length: usize,
    q: *mut f64,
    joints: usize,
    gap: *mut f64,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let arm = &object("robot", robot)?.arm;
        let sizes = if arm.dimension() == 3 { [3, 7] } else { [2, 3] };
        let expected = if length == sizes[0] { sizes[0] } else { sizes[1] };
        let pose = numbers("pose", pose, length, expected)?;
        let mut found = numbers("q", q, joints, arm.dof())?.to_vec();
        let (out, to) = (room("q", q, joints, arm.dof())?, room("gap", gap, 2, 2)?);
        let left = arm.inverse_kinematics(pose, &mut found);
        let left = left.map_err(|fault| Fault::Turn("pose", fault))?;
        out.fill(&found);
        to.fill(&[left.position, left.angle]);
        Ok(())
    })
}

/// The same robot with a body at its tip, as part of its last link: a mass [kg], its centre of mass in the frame of the tool [m], and its
/// moments of inertia xx, yy, zz, xy, xz, yz about that [kg·m²]; NULL is 0, and in the plane a load is a point. Free it with
/// `vff_robot_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_with_load(
    robot: *const Robot,
    mass: f64,
    com: *const f64,
    inertia: *const f64,
    loaded: *mut *mut Robot,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let (arm, to) = (&object("robot", robot)?.arm, place("loaded", loaded)?);
        numbers("mass", &raw const mass, 1, 1)?;
        let mut load = LoadSpec { mass, ..LoadSpec::default() };
        if !com.is_null() {
            load.com.insert([0.0; 3]).copy_from_slice(numbers("com", com, 3, 3)?);
        }
        if !inertia.is_null() {
            load.inertia.insert([0.0; 6]).copy_from_slice(numbers("inertia", inertia, 6, 6)?);
        }
        let made = arm.with_load(&load, Table::new());
        hand_out(made.map(|(arm, _)| Robot { arm }).map_err(Fault::from), to)
    })
}
