//! The torque law.

use crate::border::{border, free, numbers, object, place, room, text};
use crate::mailbox::Mailbox;
use crate::robot::{Robot, file, hand_out, no_urdf, part};
use crate::status::{Fault, Status};
use std::cell::UnsafeCell;
use std::ffi::c_char;
use std::sync::Arc;
use std::sync::atomic::{
    AtomicBool,
    Ordering::{Acquire, Relaxed, Release},
};
use toml::{Table, Value};
use vff_core::runtime::{AnyController, Target};
use vff_core::scenario::{Scenario, parse_toml};
use vff_core::world::space::Points;

/// The torque law of one robot. One thread at a time may use it; a call that finds another one in progress comes to
/// `VFF_STATUS_BUSY`.
///
/// Once per cycle: `vff_controller_observe`, then `vff_controller_torque`. What is said to be "for the loop" allocates nothing,
/// takes no lock, makes no system call and does not wait (with `formulation = "recursive"`, the default).
#[derive(Debug)]
pub struct Controller {
    busy: AtomicBool,
    inner: UnsafeCell<Inner>,
}

// SAFETY: `inner` is touched between `busy` becoming true and false alone, by the thread that has made it true.
unsafe impl Sync for Controller {}

/// What the torque is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Follows {
    Nothing,
    Scenario,
    Given,
}

#[derive(Debug)]
pub(crate) struct Inner {
    pub(crate) controller: AnyController,
    n: usize,
    /// How many numbers a pose, its velocity and its acceleration have.
    widths: [usize; 3],
    follows: Follows,
    /// The reference that was given: as many of these numbers as it has.
    reference: [[f64; 7]; 3],
    /// Whether a state was observed that no torque was computed for.
    pub(crate) observed: bool,
    /// Whether there is a torque.
    commanded: bool,
    /// The number of each obstacle, ascending.
    pub(crate) ids: Vec<u32>,
    pub(crate) next_id: u32,
    /// Where new points come from, with the number of their cloud.
    pub(crate) clouds: Vec<(u32, Arc<Mailbox<Points>>)>,
    /// Whether a panic has left it in no known state.
    broken: bool,
}

impl Inner {
    fn new(controller: AnyController) -> Result<Self, Fault> {
        let ids: Vec<u32> = (0u32..).take(controller.obstacle_count()).collect();
        let own = controller.has_reference();
        Ok(Self {
            n: controller.dof(),
            widths: controller.widths(),
            follows: if own { Follows::Scenario } else { Follows::Nothing },
            reference: [[0.0; 7]; 3],
            observed: false,
            commanded: false,
            next_id: ids.last().map_or(0, |last| last + 1),
            ids,
            clouds: vec![],
            broken: false,
            controller,
        })
    }

    /// The place of an obstacle.
    pub(crate) fn place_of(&self, id: u32) -> Result<usize, Fault> {
        self.ids.binary_search(&id).map_err(|_| Fault::NoObstacle(id))
    }

    fn observe(&mut self, t: f64, q: &[f64], dq: &[f64]) {
        let Self { clouds, ids, controller, .. } = self;
        for (id, mailbox) in clouds {
            mailbox.receive(|points| {
                // It was made for this cloud, and there is room for it: see `vff_cloud_update`.
                if let Ok(j) = ids.binary_search(id) {
                    let swapped = controller.swap_points(j, points);
                    debug_assert!(swapped.is_ok(), "{swapped:?}");
                }
            });
        }
        controller.observe(q, dq, t);
        self.observed = true;
    }

    fn torque(&mut self) -> Result<&[f64], Fault> {
        if !self.observed {
            return Err(Fault::NotObserved);
        }
        let [x, dx, ddx] = &self.reference;
        let [nx, ndx, nddx] = self.widths;
        let tau = match self.follows {
            Follows::Nothing => return Err(Fault::NoReference),
            Follows::Scenario => self.controller.follow(),
            Follows::Given => {
                let target = Target { x: &x[..nx], dx: &dx[..ndx], ddx: &ddx[..nddx] };
                self.controller.command(&target)?
            }
        };
        (self.observed, self.commanded) = (false, true);
        match tau.iter().all(|tau| tau.is_finite()) {
            true => Ok(tau),
            false => Err(Fault::Torque),
        }
    }
}

/// A turn, until it is dropped.
struct Turn<'a>(&'a AtomicBool);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.store(false, Release);
    }
}

/// Does something with a controller, while no other thread does.
///
/// # Safety
/// The pointer is NULL or that of a controller that lives as long as the call.
pub(crate) unsafe fn with(
    controller: *const Controller,
    work: impl FnOnce(&mut Inner) -> Result<(), Fault>,
) -> Status {
    border(|| {
        // SAFETY: as the caller promises.
        let controller = unsafe { object("controller", controller) }?;
        if controller.busy.compare_exchange(false, true, Acquire, Relaxed).is_err() {
            return Err(Fault::Busy("controller"));
        }
        let _turn = Turn(&controller.busy);
        // SAFETY: it is this thread's turn.
        let inner = unsafe { &mut *controller.inner.get() };
        if inner.broken {
            return Err(Fault::Broken);
        }
        inner.broken = true;
        let done = work(inner);
        inner.broken = false;
        done
    })
}

fn make(controller: AnyController) -> Result<Controller, Fault> {
    let inner = UnsafeCell::new(Inner::new(controller)?);
    Ok(Controller { busy: AtomicBool::new(false), inner })
}

fn of_scenario(text: &str) -> Result<Controller, Fault> {
    let document = parse_toml(text)?;
    if let Some(Value::Table(arm)) = document.get("arm") {
        no_urdf(arm)?;
    }
    make(AnyController::from_scenario(&Scenario::from_document(&document)?)?)
}

/// A controller for a robot, among no obstacles. `settings` is TOML: the table `controller` of a scenario, alone or under that
/// name; NULL for the defaults. Free it with `vff_controller_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_new(
    robot: *const Robot,
    settings: *const c_char,
    controller: *mut *mut Controller,
) -> Status {
    // SAFETY: pointers as C has them.
    border(|| unsafe {
        let (robot, to) = (object("robot", robot)?, place("controller", controller)?);
        let settings = match settings.is_null() {
            true => Table::new(),
            false => part(parse_toml(text("settings", settings)?)?, "controller"),
        };
        let made = AnyController::new(&robot.arm, &settings);
        hand_out(make(made.map_err(|error| error.inside("controller"))?), to)
    })
}

/// A controller from the TOML of a whole scenario: its arm, settings, obstacles (numbered from 0) and reference, which is that of
/// its time t. Plant, sensors and drives of a scenario are for simulations.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_from_scenario(
    toml: *const c_char,
    controller: *mut *mut Controller,
) -> Status {
    // SAFETY: pointers as C has them.
    border(|| unsafe {
        hand_out(of_scenario(text("toml", toml)?), place("controller", controller)?)
    })
}

/// The same from a file.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_from_scenario_file(
    path: *const c_char,
    controller: *mut *mut Controller,
) -> Status {
    // SAFETY: pointers as C has them.
    border(|| unsafe {
        let to = place("controller", controller)?;
        hand_out(of_scenario(&file(text("path", path)?)?), to)
    })
}

/// Frees a controller. No thread may be in a call with it; handles of its clouds live on and come to `VFF_STATUS_NOT_A_CLOUD`.
/// NULL is nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_free(controller: *mut Controller) {
    // SAFETY: pointers as C has them.
    unsafe {
        if let Some(controller) = controller.as_mut() {
            let clouds = &controller.inner.get_mut().clouds;
            clouds.iter().for_each(|(_, mailbox)| mailbox.close());
        }
        free(controller);
    }
}

/// Sizes of a controller.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(non_camel_case_types, reason = "as in C")]
pub struct vff_sizes {
    /// The number of joints n.
    pub joints: usize,
    /// The dimension of the space, 2 or 3.
    pub dimension: usize,
    /// How many numbers a pose has. In the plane 2, or with the task "pose" 3: (x, y, angle). In space 3, or with "pose" or "pointing"
    /// 7: position and quaternion (w, x, y, z).
    pub pose: usize,
    /// How many its velocity has, and its acceleration: linear, then angular in world axes. 2 or 3; 3 or 6.
    pub rate: usize,
}

/// The sizes of the arrays of a controller.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_sizes(
    controller: *const Controller,
    sizes: *mut vff_sizes,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let [pose, rate, _] = inner.widths;
            let dimension = inner.controller.dimension();
            place("sizes", sizes)?.write(vff_sizes { joints: inner.n, dimension, pose, rate });
            Ok(())
        })
    }
}

/// Whether its gains are stable where a torque is held for `period` seconds; if not, `VFF_STATUS_PERIOD`, and the message says
/// which. Allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_check_period(
    controller: *const Controller,
    period: f64,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            if !(period.is_finite() && period > 0.0) {
                return Err(Fault::NoPeriod(period));
            }
            match inner.controller.sampling_bounds(period) {
                found if found.is_empty() => Ok(()),
                found => Err(Fault::Period(found.join("; "))),
            }
        })
    }
}

/// For the loop: takes in the state at time `t` [s], q [rad, m] and dq [rad/s, m/s], n numbers each. Obstacles are moved to `t`,
/// and clouds that were updated meanwhile take effect.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_observe(
    controller: *mut Controller,
    t: f64,
    q: *const f64,
    dq: *const f64,
    joints: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let q = numbers("q", q, joints, inner.n)?;
            let dq = numbers("dq", dq, joints, inner.n)?;
            numbers("t", &raw const t, 1, 1)?;
            inner.observe(t, q, dq);
            Ok(())
        })
    }
}

/// For the loop: the pose of the end effector at the observed state, as many numbers as `sizes.pose`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_pose(
    controller: *const Controller,
    pose: *mut f64,
    length: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let width = inner.widths[0];
            let out = room("pose", pose, length, width)?;
            if !(inner.observed || inner.commanded) {
                return Err(Fault::NotObserved);
            }
            let mut pose = [0.0; 7];
            inner.controller.write_pose(&mut pose[..width]);
            out.fill(&pose[..width]);
            Ok(())
        })
    }
}

/// For the loop: the reference of the end effector from now on, until another is set: pose, velocity and acceleration.
/// The last two may be NULL with length 0, which means 0. Lengths are `sizes.pose`, `sizes.rate` and `sizes.rate`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_set_reference(
    controller: *mut Controller,
    x: *const f64,
    x_length: usize,
    dx: *const f64,
    dx_length: usize,
    ddx: *const f64,
    ddx_length: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let mut reference = [[0.0; 7]; 3];
            let [nx, ndx, nddx] = inner.widths;
            reference[0][..nx].copy_from_slice(numbers("x_ref", x, x_length, nx)?);
            if !(dx.is_null() && dx_length == 0) {
                reference[1][..ndx].copy_from_slice(numbers("dx_ref", dx, dx_length, ndx)?);
            }
            if !(ddx.is_null() && ddx_length == 0) {
                reference[2][..nddx].copy_from_slice(numbers("ddx_ref", ddx, ddx_length, nddx)?);
            }
            let [x, dx, ddx] = &reference;
            let target = Target { x: &x[..nx], dx: &dx[..ndx], ddx: &ddx[..nddx] };
            inner.controller.check(&target)?;
            (inner.reference, inner.follows) = (reference, Follows::Given);
            Ok(())
        })
    }
}

/// For the loop: the reference is that of the scenario again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_follow_scenario(controller: *mut Controller) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            if !inner.controller.has_reference() {
                return Err(Fault::NoScenario);
            }
            inner.follows = Follows::Scenario;
            Ok(())
        })
    }
}

/// For the loop: the joint torque at the observed state, n numbers [N·m, N]. Each needs an observation of its own.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_torque(
    controller: *mut Controller,
    tau: *mut f64,
    joints: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let out = room("tau", tau, joints, inner.n)?;
            out.fill(inner.torque()?);
            Ok(())
        })
    }
}

/// The parts of the last torque. Arrays have n numbers and are valid until the next call with the controller but
/// `vff_controller_terms`.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Terms {
    /// The number of joints n.
    pub joints: usize,
    /// Joint torque [N·m].
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

/// For the loop: forgets the past: an energy tank is as full as at the start, a look-ahead follows no candidate, and the
/// next state may be at any time. Obstacles and reference stay.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_reset(controller: *mut Controller) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            inner.controller.forget();
            (inner.observed, inner.commanded) = (false, false);
            Ok(())
        })
    }
}
