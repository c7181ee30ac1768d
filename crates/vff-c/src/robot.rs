//! Robots: what a controller is made for, and what can be compared with the arm that stands there.

use crate::ffi_guard::{free, guarded, numbers, object, place, room, text};
use crate::status::{Fault, Status};
use std::ffi::c_char;
use std::fs;
use std::mem::MaybeUninit;
use std::path::Path;
use toml::{Table, Value};
use vff_core::runtime::AnyArm;
use vff_core::scenario::{Problem, ScenarioError, parse_toml};

/// A robot arm. It never changes: any number of threads may use one.
#[derive(Debug)]
pub struct Robot {
    pub(crate) arm: AnyArm,
}

/// The text of a file.
pub(crate) fn file(path: &str) -> Result<String, Fault> {
    fs::read_to_string(Path::new(path)).map_err(|error| Fault::File { path: path.into(), error })
}

/// The table under `key`, if there is one, or else the whole document.
pub(crate) fn part(mut document: Table, key: &str) -> Table {
    match document.remove(key) {
        Some(Value::Table(part)) => part,
        Some(other) => {
            document.insert(key.into(), other); // the reader knows what to say
            document
        }
        None => document,
    }
}

/// URDF is read by the package in Python, which fits capsules to meshes.
pub(crate) fn no_urdf(arm: &Table) -> Result<(), Fault> {
    if !arm.contains_key("urdf") {
        return Ok(());
    }
    let sentence = "is read in Python, which fits capsules to its meshes: `vffnull arms check ROBOT.urdf --toml > robot.toml` \
                    writes the robot for this library";
    Err(ScenarioError::new("arm.urdf", Problem::Other(sentence.into())).into())
}

fn read(text: &str) -> Result<Robot, Fault> {
    let table = part(parse_toml(text)?, "arm");
    no_urdf(&table)?;
    Ok(Robot { arm: AnyArm::read(&table).map_err(|error| error.inside("arm"))? })
}

/// Hands out an object.
pub(crate) fn hand_out<T>(
    made: Result<T, Fault>,
    to: &mut MaybeUninit<*mut T>,
) -> Result<(), Fault> {
    to.write(Box::into_raw(Box::new(made?)));
    Ok(())
}

/// A robot from TOML: the table `arm` of a scenario, alone or under that name. `vffnull arms check ROBOT.urdf --toml` writes
/// it for a URDF or MJCF, `vffnull arms show panda --toml` for a bundled arm. Free it with `vff_robot_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_from_text(
    toml: *const c_char,
    robot: *mut *mut Robot,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe { hand_out(read(text("toml", toml)?), place("robot", robot)?) })
}

/// The same from a file.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_from_file(
    path: *const c_char,
    robot: *mut *mut Robot,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let robot = place("robot", robot)?;
        hand_out(read(&file(text("path", path)?)?), robot)
    })
}

/// A bundled robot: "panda", "fr3", "ur5e", "ur10e", "iiwa14", "gen3" or "xarm7".
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_named(name: *const c_char, robot: *mut *mut Robot) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let (name, robot) = (text("name", name)?, place("robot", robot)?);
        let table = Table::from_iter([("model".to_owned(), Value::String(name.into()))]);
        hand_out(AnyArm::read(&table).map(|arm| Robot { arm }).map_err(Fault::from), robot)
    })
}

/// Frees a robot. Its controllers may live on. NULL is nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_free(robot: *mut Robot) {
    // SAFETY: pointers as C has them.
    unsafe { free(robot) }
}

/// The number of joints n; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_joints(robot: *const Robot) -> usize {
    // SAFETY: pointers as C has them.
    unsafe { robot.as_ref() }.map_or(0, |robot| robot.arm.dof())
}

/// The dimension of the space that it moves in, 2 or 3; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_dimension(robot: *const Robot) -> usize {
    // SAFETY: pointers as C has them.
    unsafe { robot.as_ref() }.map_or(0, |robot| robot.arm.dimension())
}

/// The pose of the tip at q: in space position [m] and quaternion (w, x, y, z), 7 numbers; in the plane position [m] and angle
/// [rad], 3 numbers. Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_pose(
    robot: *const Robot,
    q: *const f64,
    joints: usize,
    pose: *mut f64,
    length: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let arm = &object("robot", robot)?.arm;
        let q = numbers("q", q, joints, arm.dof())?;
        let out = room("pose", pose, length, if arm.dimension() == 3 { 7 } else { 3 })?;
        let (position, orientation) = arm.at(q, &vec![0.0; q.len()]).pose();
        out.fill(&[position, orientation].concat());
        Ok(())
    })
}

/// The torque that holds the arm against gravity at q, n numbers [N·m]: to be compared with that of the robot. Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_gravity_torque(
    robot: *const Robot,
    q: *const f64,
    joints: usize,
    tau: *mut f64,
    length: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let arm = &object("robot", robot)?.arm;
        let q = numbers("q", q, joints, arm.dof())?;
        let out = room("tau", tau, length, arm.dof())?;
        out.fill(&arm.at(q, &vec![0.0; q.len()]).gravity_torque());
        Ok(())
    })
}

/// The mass matrix at q, n × n numbers [kg·m²]: to be compared with that of the maker. Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_robot_mass_matrix(
    robot: *const Robot,
    q: *const f64,
    joints: usize,
    mass: *mut f64,
    length: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let arm = &object("robot", robot)?.arm;
        let q = numbers("q", q, joints, arm.dof())?;
        let out = room("mass", mass, length, arm.dof() * arm.dof())?;
        out.fill(arm.at(q, &vec![0.0; q.len()]).mass_matrix().as_slice()); // symmetric
        Ok(())
    })
}
