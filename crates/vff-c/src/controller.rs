//! The torque law.

use crate::ffi_guard::{any_numbers, free, guarded, numbers, object, place, room, text};
use crate::mailbox::Mailbox;
use crate::robot::{Robot, file, hand_out, no_urdf, part};
use crate::status::{Fault, Status};
use std::cell::UnsafeCell;
use std::ffi::{CString, c_char};
use std::ptr::null;
use std::sync::Arc;
use std::sync::atomic::{
    AtomicBool,
    Ordering::{Acquire, Relaxed, Release},
};
use toml::{Table, Value};
use vff_core::runtime::{AnyController, Target, VirtualArm};
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
pub(crate) enum Follows {
    Nothing,
    Scenario,
    Given,
}

#[derive(Debug)]
pub(crate) struct Inner {
    pub(crate) controller: AnyController,
    pub(crate) n: usize,
    /// How many numbers a pose, its velocity and its acceleration have.
    pub(crate) widths: [usize; 3],
    pub(crate) follows: Follows,
    /// The reference that was given: as many of these numbers as it has.
    pub(crate) reference: [[f64; 7]; 3],
    /// The model of a robot that takes set points.
    pub(crate) virtual_arm: Option<VirtualArm>,
    /// Whether a state was observed that no torque was computed for.
    pub(crate) observed: bool,
    /// Whether there is a torque.
    pub(crate) commanded: bool,
    /// The number of each obstacle, ascending.
    pub(crate) ids: Vec<u32>,
    pub(crate) next_id: u32,
    /// Where new points come from, with the number of their cloud.
    pub(crate) clouds: Vec<(u32, Arc<Mailbox<Points>>)>,
    /// What is odd about its scenario and obstacles: texts that stay where they are.
    warnings: Vec<CString>,
    /// Whether a panic has left it in no known state.
    broken: bool,
}

impl Inner {
    fn new(controller: AnyController) -> Result<Self, Fault> {
        let ids: Vec<u32> = (0u32..).take(controller.obstacle_count()).collect();
        let own = controller.has_reference();
        let mut this = Self {
            n: controller.dof(),
            widths: controller.widths(),
            follows: if own { Follows::Scenario } else { Follows::Nothing },
            reference: [[0.0; 7]; 3],
            virtual_arm: None,
            observed: false,
            commanded: false,
            next_id: ids.last().map_or(0, |last| last + 1),
            ids,
            clouds: vec![],
            warnings: vec![],
            broken: false,
            controller,
        };
        this.warn(this.controller.warnings().to_vec());
        Ok(this)
    }

    /// Keeps sentences for `vff_controller_warning`.
    pub(crate) fn warn(&mut self, sentences: impl IntoIterator<Item = String>) {
        // A 0 within would end one.
        let texts = sentences.into_iter().map(|text| text.replace('\0', ""));
        self.warnings.extend(texts.filter_map(|text| CString::new(text).ok()));
    }

    /// The place of an obstacle.
    pub(crate) fn place_of(&self, id: u32) -> Result<usize, Fault> {
        self.ids.binary_search(&id).map_err(|_| Fault::NoObstacle(id))
    }

    /// Takes in the clouds that were sent meanwhile.
    pub(crate) fn receive(&mut self) {
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
    }

    fn observe(&mut self, t: f64, q: &[f64], dq: &[f64]) {
        self.receive();
        self.controller.observe(q, dq, t);
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

/// The reference that was given, if that is what is followed.
pub(crate) fn given(
    follows: Follows,
    reference: &[[f64; 7]; 3],
    widths: [usize; 3],
) -> Option<Target<'_>> {
    let ([x, dx, ddx], [nx, ndx, nddx]) = (reference, widths);
    let target = Target { x: &x[..nx], dx: &dx[..ndx], ddx: &ddx[..nddx] };
    (follows == Follows::Given).then_some(target)
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
    guarded(|| {
        // SAFETY: as the caller promises.
        let controller = unsafe { object("controller", controller) }?;
        if controller.busy.compare_exchange(false, true, Acquire, Relaxed).is_err() {
            return Err(Fault::Busy("controller"));
        }
        let _turn = Turn(&controller.busy);
        // SAFETY: it is this thread's turn.
        let inner = unsafe { &mut *controller.inner.get() };
        if inner.broken {
            return Err(Fault::Broken("controller"));
        }
        inner.broken = true;
        let done = work(inner);
        inner.broken = false;
        done
    })
}

pub(crate) fn make(controller: AnyController) -> Result<Controller, Fault> {
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
    guarded(|| unsafe {
        let (robot, to) = (object("robot", robot)?, place("controller", controller)?);
        let settings = match settings.is_null() {
            true => Table::new(),
            false => part(parse_toml(text("settings", settings)?)?, "controller"),
        };
        let made = AnyController::new(&robot.arm, &settings);
        hand_out(make(made.map_err(|error| error.inside("controller"))?), to)
    })
}

/// A controller from the TOML of a whole scenario: its arm, settings, obstacles (numbered from 0) and reference, a plan with its posture
/// and margins, which waits with `governor`. It is that of the time t, or, in a loop that is watched over, begins when the torque has
/// been blended in. Plant, sensors, drives and `replan` of a scenario are for simulations.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_from_scenario(
    toml: *const c_char,
    controller: *mut *mut Controller,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
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
    guarded(|| unsafe {
        let to = place("controller", controller)?;
        hand_out(of_scenario(&file(text("path", path)?)?), to)
    })
}

/// The sentence about the `index`th thing, from 0, that is allowed but probably not meant in the scenario of the controller or in an obstacle
/// that was added: an obstacle in millimetres, a quaternion with w in the last place, a reference out of reach that is followed
/// nevertheless. NULL where there are no more. It is valid until the controller is freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_warning(
    controller: *const Controller,
    index: usize,
) -> *const c_char {
    let mut sentence = null();
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            sentence = inner.warnings.get(index).map_or(null(), |text| text.as_ptr());
            Ok(())
        });
    }
    sentence
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

/// For the loop: takes in what the robot measures of the torque that its surroundings exert on the joints, n numbers [N·m, N], for
/// the states that come, with `observer.source = "measured"`. A Franka's `tau_ext_hat_filtered` counts what the robot exerts: its
/// negative belongs here. One that is not finite changes nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_sense(
    controller: *mut Controller,
    tau_ext: *const f64,
    joints: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            inner.controller.sense(any_numbers("tau_ext", tau_ext, joints, inner.n)?);
            Ok(())
        })
    }
}

/// For the loop: the torque from outside as estimated at the observed state, n numbers [N·m, N]; zeros without an observer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_external_torque(
    controller: *mut Controller,
    tau_ext: *mut f64,
    joints: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let out = room("tau_ext", tau_ext, joints, inner.n)?;
            match inner.controller.external_torque() {
                Some(tau_ext) => out.fill(tau_ext),
                None => out.fill_with(0.0),
            }
            Ok(())
        })
    }
}

/// For the loop: the link on which a contact is felt at the observed state, or one beyond it, counted from 0; −1 while none is felt,
/// and without `observer.detection`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_touched_link(
    controller: *const Controller,
    link: *mut i32,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let touched = inner.controller.touched_link();
            let touched = touched.and_then(|link| i32::try_from(link).ok());
            place("link", link)?.write(touched.unwrap_or(-1));
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

/// For the loop: the joint torque at the observed state, n numbers [N·m, N], as the settings' `command` wants it, but for its rate,
/// which `vff_controller_cycle` limits. Each needs an observation of its own.
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

/// For the loop: forgets the past: an energy tank is as full as at the start, a look-ahead follows no candidate, and the
/// next state may be at any time. Obstacles and reference stay. A loop that is over, of torques or of set points, is left by it, which
/// allocates and frees: what is asked from then on is asked of the law of torques, by a clock that may be another one.
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
