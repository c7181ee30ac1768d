//! The C functions do what the core does, whatever the order in which they are called.

mod limits;

use limits::set_point_limits;
use proptest::prelude::*;
use std::ffi::{CStr, CString};
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use vff_core::math::ScalarOrVec;
use vff_core::runtime::{AnyArm, AnyController, Reading, SetPointLimits, Target, VirtualArm};
use vff_core::scenario::Scenario;
use vffnull::*;

const READY: [f64; 7] = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8];
const FIELD: &str = "field = { kind = 'bounded', gain = 20.0, influence = 0.3 }";
const SPHERE: &str = "shape = { kind = 'sphere', radius = 0.08 }\nposition = [-0.05, -0.25, 0.62]";
const CLOUD: &str = "shape = { kind = 'points', points = [[0.0, 0.0, 0.0]], radius = 0.01 }\nposition = [0.5, 0.25, 0.6]\n\
                     orientation = [0.0, 1.0, 0.0, 0.0]";

fn text(text: &str) -> CString {
    CString::new(text).unwrap()
}

fn message() -> String {
    // SAFETY: it ends with 0 and is not changed before the next fault.
    unsafe { CStr::from_ptr(vff_last_message()) }.to_str().unwrap().to_owned()
}

/// A controller that is freed.
struct Owned(*mut Controller);

impl Owned {
    fn new(arm: &str, settings: &str) -> Self {
        let (mut robot, mut controller) = (null_mut(), null_mut());
        let (arm, settings) = (text(arm), text(settings));
        // SAFETY: texts and places live.
        unsafe {
            assert_eq!(
                vff_robot_from_text(arm.as_ptr(), &raw mut robot),
                Status::Ok,
                "{}",
                message()
            );
            let made = vff_controller_new(robot, settings.as_ptr(), &raw mut controller);
            assert_eq!(made, Status::Ok, "{}", message());
            vff_robot_free(robot);
        }
        Self(controller)
    }

    fn of(scenario: &str) -> Self {
        let (mut controller, scenario) = (null_mut(), text(scenario));
        // SAFETY: text and place live.
        let made = unsafe { vff_controller_from_scenario(scenario.as_ptr(), &raw mut controller) };
        assert_eq!(made, Status::Ok, "{}", message());
        Self(controller)
    }

    fn add(&self, obstacle: &str) -> u32 {
        let (mut id, obstacle) = (u32::MAX, text(obstacle));
        // SAFETY: text and place live.
        let added = unsafe { vff_controller_add_obstacle(self.0, obstacle.as_ptr(), &raw mut id) };
        assert_eq!(added, Status::Ok, "{}", message());
        id
    }

    fn ids(&self) -> Vec<u32> {
        let (mut ids, mut count) = ([0; 40], 0);
        // SAFETY: there is room for 40.
        let told =
            unsafe { vff_controller_obstacles(self.0, ids.as_mut_ptr(), 40, &raw mut count) };
        assert_eq!(told, Status::Ok);
        ids[..count].to_vec()
    }

    fn observe(&self, t: f64, q: &[f64], dq: &[f64]) -> Status {
        // SAFETY: both have that length, or q alone is looked at.
        unsafe { vff_controller_observe(self.0, t, q.as_ptr(), dq.as_ptr(), q.len()) }
    }

    fn refer(&self, x: &[f64], dx: &[f64], ddx: &[f64]) -> Status {
        let start = |values: &[f64]| if values.is_empty() { null() } else { values.as_ptr() };
        // SAFETY: lengths are those of the slices.
        unsafe {
            vff_controller_set_reference(
                self.0,
                start(x),
                x.len(),
                start(dx),
                dx.len(),
                start(ddx),
                ddx.len(),
            )
        }
    }

    fn torque(&self, n: usize) -> Result<Vec<f64>, Status> {
        let mut tau = vec![0.5; n];
        // SAFETY: there is room for n.
        match unsafe { vff_controller_torque(self.0, tau.as_mut_ptr(), n) } {
            Status::Ok => Ok(tau),
            status => {
                assert_eq!(tau, vec![0.5; n], "written in spite of {status:?}");
                Err(status)
            }
        }
    }

    fn terms(&self) -> Result<Terms, Status> {
        let mut terms = MaybeUninit::uninit();
        // SAFETY: it is written if the status is `Ok`.
        unsafe {
            match vff_controller_terms(self.0, terms.as_mut_ptr()) {
                Status::Ok => Ok(terms.assume_init()),
                status => Err(status),
            }
        }
    }

    fn cloud(&self, id: u32, most: usize) -> Result<Sender, Status> {
        let mut cloud = null_mut();
        // SAFETY: the place lives.
        match unsafe { vff_controller_cloud(self.0, id, most, &raw mut cloud) } {
            Status::Ok => Ok(Sender(cloud)),
            status => Err(status),
        }
    }
}

impl Drop for Owned {
    fn drop(&mut self) {
        // SAFETY: it is not used again.
        unsafe { vff_controller_free(self.0) }
    }
}

// SAFETY: the C interface says that threads may share one.
unsafe impl Sync for Owned {}

/// A cloud that is freed.
struct Sender(*mut Cloud);

// SAFETY: the C interface says so.
unsafe impl Send for Sender {}

impl Sender {
    fn send(&self, points: &[[f64; 3]]) -> Status {
        // SAFETY: so many points are there.
        unsafe { vff_cloud_update(self.0, points.as_ptr().cast(), points.len()) }
    }

    fn send_moving(&self, points: &[[f64; 3]], velocities: &[[f64; 3]], t: f64) -> Status {
        let [points, velocities] = [points, velocities].map(|all| (all.as_ptr().cast(), all.len()));
        assert_eq!(points.1, velocities.1);
        // SAFETY: so many points and velocities are there.
        unsafe { vff_cloud_update_moving(self.0, points.0, velocities.0, points.1, t) }
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        // SAFETY: it is not used again.
        unsafe { vff_cloud_free(self.0) }
    }
}

fn core(arm: &str, settings: &str, obstacles: &[&str]) -> AnyController {
    let arm = AnyArm::read(&arm.parse().unwrap()).unwrap();
    let mut controller = AnyController::new(&arm, &settings.parse().unwrap()).unwrap();
    let mut around = arm.no_obstacles();
    obstacles.iter().for_each(|each| around.read(&each.parse().unwrap()).unwrap());
    controller.surround(around).unwrap();
    controller
}

/// Bit for bit, in the plane and in space, for every task, with what moves: as a document says it, and as it is moved.
#[test]
fn torques_are_those_of_the_core() {
    const PLANE: &str = "lengths = [1, 1, 1, 1]\nmasses = 1\ngravity = 9.81";
    const DISC: &str = "shape = { kind = 'circle', radius = 0.3 }\nposition = [2.0, -0.5]";
    let x = [0.4, 0.1, 0.5, 0.0, 1.0, 0.0, 0.0];
    for (arm, task, obstacle, dimension) in [
        (PLANE, "position", DISC, 2),
        (PLANE, "pose", DISC, 2),
        ("model = 'panda'", "position", SPHERE, 3),
        ("model = 'panda'", "pointing", SPHERE, 3),
        ("model = 'panda'", "pose", SPHERE, 3),
    ] {
        for more in [
            "",
            "avoidance = 'cbf'",
            "avoidance = 'cbf'\nyielding = { preview = { trigger = 1.0 } }",
        ] {
            let settings = format!("task = '{task}'\n{FIELD}\n{more}");
            let owned = Owned::new(arm, &settings);
            let id = owned.add(obstacle);
            let velocity = [0.0, 0.4, 0.1];
            let moving = format!(
                "{obstacle}\nmotion = {{ kind = 'linear', velocity = {:?} }}",
                &velocity[..dimension]
            );
            let mut expected = core(arm, &settings, &[&moving]);
            let [nx, ndx, nddx] = expected.widths();
            let (n, rate) = (expected.dof(), [0.1, -0.2, 0.05, 0.3, 0.1, -0.1]);
            let target = Target { x: &x[..nx], dx: &rate[..ndx], ddx: &rate[..nddx] };
            let (mut pose, mut told) = ([0.0; 7], [0.0; 7]);
            let mut pushed = false;
            for k in 0..40 {
                let t = 0.01 * f64::from(k);
                let q: Vec<f64> = (0..n).map(|i| READY[i] + 0.3 * (t + i as f64).sin()).collect();
                let dq: Vec<f64> = (0..n).map(|i| 0.3 * (t + i as f64).cos()).collect();
                // From the place at t = 0 on, so that nothing is rounded otherwise.
                let start: Vec<f64> = match dimension {
                    2 => vec![2.0, -0.5],
                    _ => vec![-0.05, -0.25, 0.62],
                };
                if k == 0 {
                    // SAFETY: both have that length.
                    let moved = unsafe {
                        vff_controller_move_obstacle(
                            owned.0,
                            id,
                            0.0,
                            start.as_ptr(),
                            velocity.as_ptr(),
                            dimension,
                        )
                    };
                    assert_eq!(moved, Status::Ok, "{}", message());
                    assert_eq!(owned.refer(&x[..nx], &rate[..ndx], &rate[..nddx]), Status::Ok);
                }
                assert_eq!(owned.observe(t, &q, &dq), Status::Ok);
                let tau = owned.torque(n).unwrap();
                assert_eq!(tau, expected.torque(&q, &dq, &target, t).unwrap(), "{settings}, {t}");
                let (found, same) = (owned.terms().unwrap(), expected.terms_view());
                // SAFETY: they have n numbers, and nothing was called since.
                let slice = |start| unsafe { std::slice::from_raw_parts(start, n) };
                assert_eq!(
                    [slice(found.tau), slice(found.tau_task), slice(found.tau_null)],
                    [same.tau, same.tau_task, same.tau_null]
                );
                assert_eq!(
                    [slice(found.tau_vff), slice(found.force), slice(found.clearance)],
                    [same.tau_vff, same.force, same.clearance]
                );
                assert_eq!((found.energy, found.power), (same.scalars.energy, same.scalars.power));
                assert_eq!(found.slack.is_nan(), more.is_empty());
                pushed |= same.force.iter().any(|force| *force > 0.0);
                expected.write_pose(&mut pose[..nx]);
                // SAFETY: there is room for so many.
                assert_eq!(
                    unsafe { vff_controller_pose(owned.0, told.as_mut_ptr(), nx) },
                    Status::Ok
                );
                assert_eq!(pose.to_vec(), told.to_vec());
            }
            assert!(pushed, "nothing came near: {settings}");
            let mut projector = vec![0.0; n * n];
            // SAFETY: there is room for so many.
            let told =
                unsafe { vff_controller_null_projector(owned.0, projector.as_mut_ptr(), n * n) };
            assert_eq!(told, Status::Ok);
            assert_eq!(projector, expected.null_projector().transpose().as_slice());
        }
    }
}

/// Bit for bit: what is sent, and set points, with states that are missing; and what cannot begin.
/// What is sent does not depend on what else is asked of a controller between two cycles, and is finite.
#[test]
fn questions_between_cycles() {
    let settings = "command = { gravity = 'robot', torque_rate = 1000.0, blend_time = 0.01 }";
    let owned = [Owned::new("model = 'panda'", settings), Owned::new("model = 'panda'", settings)];
    let (mut sent, mut phases) = ([[0.5; 7]; 2], [vff_phase::Lost; 2]);
    // SAFETY: below, arrays have the lengths that are given.
    unsafe {
        for each in &owned {
            assert_eq!(vff_controller_begin(each.0, 0.001, null(), 0), Status::Ok);
            assert_eq!(each.refer(&[0.4, 0.1, 0.5], &[], &[]), Status::Ok);
        }
        for k in 0..60 {
            let wild = [[1e3; 7], [-1e200; 7]][k % 2];
            let t = 1e-3 * k as f64;
            let asked = vff_controller_observe(owned[0].0, t, wild.as_ptr(), wild.as_ptr(), 7);
            assert_eq!(asked, Status::Ok, "{}", message());
            vff_controller_torque(owned[0].0, [0.0; 7].as_mut_ptr(), 7);
            let still = [0.0; 7];
            let heard = k < 20;
            let given = |x: &[f64; 7]| if heard { x.as_ptr() } else { null() };
            for (i, each) in owned.iter().enumerate() {
                let (tau, phase) = (sent[i].as_mut_ptr(), &raw mut phases[i]);
                let (q, dq) = (given(&READY), given(&still));
                assert_eq!(vff_controller_cycle(each.0, t, q, dq, tau, 7, phase), Status::Ok);
            }
            assert_eq!(sent[0].map(f64::to_bits), sent[1].map(f64::to_bits), "{k}");
            assert_eq!(phases[0], phases[1]);
            assert!(sent[0].iter().all(|tau| tau.is_finite()));
        }
    }
}

/// What a robot measures from outside is what is known of it, and is rejected where that is asked for.
#[test]
fn a_measured_torque_counts() {
    let told = [0.0, 3.0, 0.0, -2.0, 0.0, 0.5, 0.0];
    let torque = |touch: &str| {
        let settings = format!("observer = {{ source = 'measured' }}\ntouch = {{ {touch} }}");
        let owned = Owned::new("model = 'panda'", &settings);
        assert_eq!(owned.refer(&[0.4, 0.1, 0.5], &[], &[]), Status::Ok);
        let mut known = [1.0; 7];
        // SAFETY: below, arrays have the lengths that are given.
        unsafe {
            let external = vff_controller_external_torque(owned.0, known.as_mut_ptr(), 7);
            assert_eq!((external, known), (Status::Ok, [0.0; 7]));
            assert_eq!(vff_controller_sense(owned.0, told.as_ptr(), 7), Status::Ok);
            assert_eq!(vff_controller_sense(owned.0, [f64::NAN; 7].as_ptr(), 7), Status::Ok);
            assert_eq!(vff_controller_sense(owned.0, told.as_ptr(), 6), Status::Length);
            assert_eq!(vff_controller_sense(owned.0, null(), 7), Status::Null);
            assert_eq!(owned.observe(0.0, &READY, &[0.0; 7]), Status::Ok);
            let external = vff_controller_external_torque(owned.0, known.as_mut_ptr(), 7);
            assert_eq!((external, known), (Status::Ok, told));
        }
        owned.torque(7).unwrap()
    };
    let [complying, rejecting] = ["", "task = 'reject', null_space = 'reject'"].map(torque);
    for ((complying, rejecting), told) in complying.iter().zip(rejecting).zip(told) {
        assert!((rejecting - complying + told).abs() < 1e-12);
    }
}

/// Where somebody pushes is told while it is felt, and only where that is asked for.
#[test]
fn a_touched_link_is_told() {
    for (detection, expected) in [("detection = {}", 3), ("", -1)] {
        let settings = format!("observer = {{ source = 'measured', {detection} }}");
        let owned = Owned::new("model = 'panda'", &settings);
        assert_eq!(owned.refer(&[0.4, 0.1, 0.5], &[], &[]), Status::Ok);
        let mut link = 7;
        for k in 0..=300 {
            let told = [0.0, 0.0, 0.0, if k < 250 { 0.0 } else { 4.0 }, 0.0, 0.0, 0.0];
            // SAFETY: arrays have the lengths that are given.
            unsafe {
                assert_eq!(vff_controller_sense(owned.0, told.as_ptr(), 7), Status::Ok);
                assert_eq!(owned.observe(1e-3 * f64::from(k), &READY, &[0.0; 7]), Status::Ok);
                owned.torque(7).unwrap();
                assert_eq!(vff_controller_touched_link(owned.0, &raw mut link), Status::Ok);
            }
            assert!(k >= 250 || link == -1);
        }
        assert_eq!(link, expected);
        // SAFETY: a null is what is asked about.
        assert_eq!(unsafe { vff_controller_touched_link(owned.0, null_mut()) }, Status::Null);
    }
}

#[test]
fn loops_are_those_of_the_core() {
    let settings = format!(
        "{FIELD}\ncommand = {{ gravity = 'robot', torque_rate = 1000.0, blend_time = 0.01 }}"
    );
    let owned = Owned::new("model = 'panda'", &settings);
    owned.add(SPHERE);
    let mut expected = core("model = 'panda'", &settings, &[SPHERE]);
    let (mut tau, mut phase) = ([0.5; 7], vff_phase::Lost);
    let x = [0.4, 0.1, 0.5];
    let target = Target { x: &x, dx: &[0.0; 3], ddx: &[0.0; 3] };
    let limits = set_point_limits();
    // SAFETY: below, arrays have the lengths that are given.
    unsafe {
        let c = owned.0;
        let one = |tau: &mut [f64; 7], phase: *mut vff_phase| {
            vff_controller_cycle(c, 0.0, null(), null(), tau.as_mut_ptr(), 7, phase)
        };
        assert_eq!(one(&mut tau, &raw mut phase), Status::NotBegun);
        assert!(message().contains("vff_controller_begin"));
        for period in [0.0, f64::NAN] {
            assert_eq!(vff_controller_begin(c, period, null(), 0), Status::NotFinite);
        }
        assert_eq!(vff_controller_begin(c, 0.3, null(), 0), Status::Period);
        assert!(message().contains("stop_damping"), "{}", message());
        assert_eq!(vff_controller_begin(c, 0.001, null(), 7), Status::Null);
        assert_eq!(vff_controller_begin(c, 0.001, null(), 0), Status::Ok);
        assert_eq!(one(&mut tau, null_mut()), Status::Null);
        assert_eq!(owned.refer(&x, &[], &[]), Status::Ok);
        expected.begin(0.001, None).unwrap();
        let mut phases = vec![];
        for k in 0..1200 {
            let t = 0.001 * f64::from(k);
            let q: Vec<f64> = (0..7).map(|i| READY[i] + 0.05 * (t + i as f64).sin()).collect();
            let dq: Vec<f64> = (0..7).map(|i| 0.05 * (t + i as f64).cos()).collect();
            let here = !(20..30).contains(&k) && k < 100;
            if k == 60 {
                assert_eq!(vff_controller_stop(c), Status::Ok);
                expected.stop();
            }
            let reading = here.then_some(Reading { t, q: &q, dq: &dq });
            let same = expected.cycle(reading, Some(&target)).unwrap();
            let given = |x: &[f64]| if here { x.as_ptr() } else { null() };
            let done = vff_controller_cycle(
                c,
                t,
                given(&q),
                given(&dq),
                tau.as_mut_ptr(),
                7,
                &raw mut phase,
            );
            assert_eq!(done, Status::Ok, "{}", message());
            assert_eq!(tau.to_vec(), expected.sent().unwrap().to_vec());
            assert_eq!(format!("{phase:?}"), format!("{same:?}"));
            let mut left_out = LeftOut { late: 9999, cut: 1, rollouts: 1, points: 1, programs: 1 };
            assert_eq!(vff_controller_left_out(c, &raw mut left_out), Status::Ok);
            let LeftOut { late, cut, rollouts, points, programs } = left_out;
            assert!(late <= 1200, "{late}"); // by the clock
            assert_eq!([cut, rollouts, points, programs], [0; 4]);
            if phases.last() != Some(&phase) {
                phases.push(phase);
            }
        }
        use vff_phase::{Damping, Holding, Lost, Released, Running, Starting, Stopping};
        assert_eq!(
            phases,
            [
                Starting, Running, Holding, Damping, Starting, Running, Stopping, Holding, Damping,
                Released, Lost
            ]
        );

        let (mut q, mut dq, mut ddq) = ([0.0; 7], [0.0; 7], [0.0; 7]);
        let mut course = vff_course::Finished;
        let mut step = |measured: *const f64, course: *mut vff_course| {
            let [q, dq, ddq] = [&mut q, &mut dq, &mut ddq].map(|x| x.as_mut_ptr());
            vff_controller_set_point(c, 0.5, measured, measured, q, dq, ddq, 7, course)
        };
        assert_eq!(step(null(), &raw mut course), Status::NotBegun);
        let begin = |limits: *const vff_set_point_limits, q: &[f64], period| {
            vff_controller_begin_set_points(c, period, limits, q.as_ptr(), q.len())
        };
        assert_eq!(begin(null(), &READY, 0.001), Status::Null);
        assert_eq!(begin(&raw const limits, &READY[..6], 0.001), Status::Length);
        assert_eq!(begin(&raw const limits, &READY, -1.0), Status::NotFinite);
        assert_eq!(begin(&raw const limits, &READY, 0.001), Status::Ok, "{}", message());
        let all = SetPointLimits {
            speed: None,
            acceleration: ScalarOrVec::Uniform(7.5),
            jerk: ScalarOrVec::Uniform(4000.0),
            threshold: 0.1,
        };
        let mut arm = VirtualArm::new(&mut expected, &all, 0.001, &READY).unwrap();
        for k in 0..200 {
            assert_eq!(step(null(), &raw mut course), Status::Ok);
            arm.step(&mut expected, 0.5, Some(&target), None).unwrap();
            if k == 100 {
                assert_eq!(vff_controller_stop(c), Status::Ok);
                arm.stop();
            }
        }
        assert_eq!(format!("{course:?}"), format!("{:?}", arm.course()));
        assert_eq!(course, vff_course::Stopping);
        assert_eq!([q, dq, ddq].each_ref().map(|x| &x[..]), arm.set_point());
    }
}

/// A controller from a scenario follows its reference among its obstacles, as its simulation does.
#[test]
fn a_scenario_is_followed() {
    let scenario = format!(
        "duration = 1.0\nq0 = {READY:?}\narm = {{ model = 'panda' }}\n\
         reference = {{ kind = 'line', relative = true, end = [0.0, 0.1, 0.1], duration = 0.5 }}\n\
         controller = {{ task = 'pose', {FIELD} }}\n\
         obstacles = [{{ {}, motion = {{ kind = 'linear', velocity = [0.0, 0.2, 0.0] }} }}]\n\
         simulation = {{ control = 'hold', integrator = 'semi_implicit_euler' }}",
        SPHERE.replace('\n', ", ")
    );
    let owned = Owned::of(&scenario);
    let mut run = Scenario::from_toml(&scenario).unwrap().prepare().unwrap().run;
    assert_eq!(owned.ids(), [0]);
    for k in 0..60 {
        let t = 0.01 * f64::from(k);
        let (q, dq) = (READY.map(|q| q + 0.1 * t), [0.1; 7]);
        assert_eq!(owned.observe(t, &q, &dq), Status::Ok);
        assert_eq!(owned.torque(7).unwrap(), run.torque_at(t, &q, &dq), "{t}");
    }
    // Another reference, and back.
    let other = [0.4, 0.1, 0.5, 0.0, 1.0, 0.0, 0.0];
    assert_eq!(owned.refer(&other, &[], &[]), Status::Ok);
    let torque = || {
        assert_eq!(owned.observe(0.7, &READY, &[0.0; 7]), Status::Ok);
        owned.torque(7).unwrap()
    };
    let elsewhere = torque();
    // SAFETY: it lives.
    assert_eq!(unsafe { vff_controller_follow_scenario(owned.0) }, Status::Ok);
    assert_ne!(elsewhere, torque());
    // Set points begin where it does, or where others know the way, and not beyond the stops.
    let limits = set_point_limits();
    let begin = |q: &[f64; 7]| {
        // SAFETY: arrays have the lengths that are given.
        unsafe { vff_controller_begin_set_points(owned.0, 0.001, &raw const limits, q.as_ptr(), 7) }
    };
    let away: [f64; 7] = std::array::from_fn(|i| READY[i] + if i == 0 { 1.0 } else { 0.0 });
    assert_eq!(begin(&READY), Status::Ok);
    assert_eq!(begin(&away), Status::Reference);
    assert!(message().starts_with("the reference begins elsewhere"), "{}", message());
    assert_eq!(owned.refer(&other, &[], &[]), Status::Ok);
    assert_eq!(begin(&away), Status::Ok);
    assert_eq!(begin(&READY.map(f64::to_degrees)), Status::Reference);
}

/// The robot's own numbers are those of the core.
#[test]
fn robots_can_be_compared() {
    let (mut robot, arm) = (null_mut(), text("[arm]\nmodel = 'panda'"));
    let expected = AnyArm::read(&"model = 'panda'".parse().unwrap()).unwrap().at(&READY, &[0.0; 7]);
    let (mut pose, mut tau, mut mass) = ([0.0; 7], [0.0; 7], [0.0; 49]);
    // SAFETY: arrays have the lengths that are given.
    unsafe {
        assert_eq!(vff_robot_from_text(arm.as_ptr(), &raw mut robot), Status::Ok);
        assert_eq!((vff_robot_joints(robot), vff_robot_dimension(robot)), (7, 3));
        assert_eq!((vff_robot_joints(null()), vff_robot_dimension(null())), (0, 0));
        assert_eq!(vff_robot_pose(robot, READY.as_ptr(), 7, pose.as_mut_ptr(), 7), Status::Ok);
        assert_eq!(
            vff_robot_gravity_torque(robot, READY.as_ptr(), 7, tau.as_mut_ptr(), 7),
            Status::Ok
        );
        assert_eq!(
            vff_robot_mass_matrix(robot, READY.as_ptr(), 7, mass.as_mut_ptr(), 49),
            Status::Ok
        );
        assert_eq!(
            vff_robot_mass_matrix(robot, READY.as_ptr(), 7, mass.as_mut_ptr(), 48),
            Status::Length
        );
        assert_eq!(vff_robot_pose(robot, READY.as_ptr(), 6, pose.as_mut_ptr(), 7), Status::Length);
        vff_robot_free(robot);
        vff_robot_free(null_mut());
    }
    assert_eq!([&pose[..3], &pose[3..]], [&expected.pose().0[..], &expected.pose().1[..]]);
    assert_eq!(tau.to_vec(), expected.gravity_torque());
    assert_eq!(&mass[..], expected.mass_matrix().as_slice());
}

/// What is refused says why, and changes nothing.
#[test]
fn faults_have_a_sentence() {
    let refused = |arm: &str, settings: &str| {
        let (mut robot, mut controller) = (null_mut(), null_mut());
        let (arm, settings) = (text(arm), text(settings));
        // SAFETY: texts and places live.
        unsafe {
            let status = match vff_robot_from_text(arm.as_ptr(), &raw mut robot) {
                Status::Ok => vff_controller_new(robot, settings.as_ptr(), &raw mut controller),
                status => status,
            };
            vff_robot_free(robot);
            assert!(controller.is_null());
            (status, message())
        }
    };
    let expect = |(status, sentence): (Status, String), expected: Status, part: &str| {
        assert!(status == expected && sentence.contains(part), "{status:?}: {sentence}");
    };
    expect(
        refused("model = 'pandas'", ""),
        Status::Document,
        "arm.model: there is no bundled arm `pandas`",
    );
    expect(refused("model = ", ""), Status::Document, "not valid TOML");
    expect(refused("arm = 3", ""), Status::Document, "arm");
    expect(
        refused("urdf = 'robot.urdf'", ""),
        Status::Document,
        "vffnull arms check ROBOT.urdf --toml",
    );
    expect(
        refused("model = 'panda'", "stifness = 3"),
        Status::Document,
        "did you mean `stiffness`",
    );
    expect(
        refused("model = 'panda'", "[controller]\nstiffness = nan"),
        Status::Document,
        "controller.stiffness",
    );
    let mut robot = null_mut();
    // SAFETY: texts and places live; the bytes are no UTF-8.
    unsafe {
        let status = vff_robot_named(c"\xff".as_ptr(), &raw mut robot);
        expect((status, message()), Status::Document, "name is not UTF-8");
        let status = vff_robot_from_file(c"/no/such/file.toml".as_ptr(), &raw mut robot);
        expect((status, message()), Status::File, "/no/such/file.toml: ");
        expect(
            (vff_robot_from_text(null(), &raw mut robot), message()),
            Status::Null,
            "toml is NULL",
        );
        expect(
            (vff_robot_named(c"panda".as_ptr(), null_mut()), message()),
            Status::Null,
            "robot is NULL",
        );
        assert!(robot.is_null());
        let mut controller = null_mut();
        let scenario = c"arm = { urdf = 'a.urdf' }".as_ptr();
        expect(
            (vff_controller_from_scenario(scenario, &raw mut controller), message()),
            Status::Document,
            "arm.urdf",
        );
        expect(
            (vff_controller_new(null(), null(), &raw mut controller), message()),
            Status::Null,
            "robot is NULL",
        );
        assert!(controller.is_null());
    }

    let owned = Owned::new("model = 'panda'", "task = 'pose'");
    let x = [0.4, 0.1, 0.5, 0.0, 1.0, 0.0, 0.0];
    let told = |status| (status, message());
    expect(
        told(owned.observe(f64::NAN, &READY, &READY)),
        Status::NotFinite,
        "t[0] must be finite, got NaN",
    );
    expect(
        told(owned.observe(0.0, &READY[..6], &READY)),
        Status::Length,
        "q: expected 7 numbers, got 6",
    );
    expect(told(owned.torque(7).unwrap_err()), Status::NotObserved, "vff_controller_observe first");
    assert_eq!(owned.observe(0.0, &READY, &[0.0; 7]), Status::Ok);
    expect(
        told(owned.torque(7).unwrap_err()),
        Status::NoReference,
        "vff_controller_set_reference first",
    );
    expect(
        told(owned.refer(&[0.4, 0.1, 0.5, 0.0, 2.0, 0.0, 0.0], &[], &[])),
        Status::Reference,
        "norm 2",
    );
    expect(told(owned.refer(&x, &x, &[])), Status::Length, "dx_ref: expected 6 numbers, got 7");
    assert_eq!(owned.refer(&x, &[], &[]), Status::Ok);
    expect(told(owned.terms().unwrap_err()), Status::NotObserved, "vff_controller_torque first");
    assert!(owned.torque(7).is_ok());
    // Beyond what numbers can hold; then it begins anew.
    assert_eq!(owned.observe(0.0, &READY, &[1e200; 7]), Status::Ok);
    expect(told(owned.torque(7).unwrap_err()), Status::Torque, "not finite");
    assert_eq!(owned.observe(0.0, &READY, &[0.0; 7]), Status::Ok);
    assert!(owned.torque(7).is_ok());
    // SAFETY: it lives.
    unsafe {
        assert_eq!(vff_controller_check_period(owned.0, 0.001), Status::Ok);
        expect(
            told(vff_controller_check_period(owned.0, 0.0)),
            Status::NotFinite,
            "period must be finite",
        );
        expect(told(vff_controller_check_period(owned.0, 1.0)), Status::Period, "");
    }
    let name = |status| {
        // SAFETY: it ends with 0 and lives for ever.
        unsafe { CStr::from_ptr(vff_status_name(status)) }.to_str().unwrap()
    };
    assert_eq!(
        (name(Status::Ok as i32), name(Status::Panic as i32)),
        ("VFF_STATUS_OK", "VFF_STATUS_PANIC")
    );
    assert_eq!((name(-1), name(99)), ("?", "?"));
    assert_eq!(vff_abi_version(), VFF_ABI_VERSION);
}

/// Degrees are refused with the radians that they are; a quaternion of two digits is as good as the exact one.
#[test]
fn what_is_nearly_right_is_taken_and_degrees_are_not() {
    let scenario = |q0: &str, turn: &str| {
        format!(
            "duration = 1.0\nq0 = {q0}\narm = {{ model = 'panda' }}\nreference = {{ kind = 'setpoint' }}\n\
             controller = {{ field = {{ kind = 'bounded', gain = 80.0, influence = 2.0 }} }}\n[[obstacles]]\n\
             shape = {{ kind = 'box', size = [0.3, 0.1, 0.2] }}\nposition = [0.6, 0.3, 0.4]\norientation = {turn}"
        )
    };
    let made = |scenario: &str| {
        let (mut controller, scenario) = (null_mut(), text(scenario));
        // SAFETY: text and place live.
        let status =
            unsafe { vff_controller_from_scenario(scenario.as_ptr(), &raw mut controller) };
        (status, message(), Owned(controller))
    };
    let identity = "[1.0, 0.0, 0.0, 0.0]";
    let (status, told, _) = made(&scenario("[0.0, -45.0, 0.0, -135.0, 0.0, 90.0, 45.0]", identity));
    assert_ne!(status, Status::Ok);
    assert!(told.contains("q0[1]: -45 rad") && told.contains("are these degrees?"), "{told}");
    let ready = format!("{READY:?}");
    let (status, told, _) = made(&scenario(&ready, "[0.73, 0.0, 0.0, 0.73]"));
    assert_ne!(status, Status::Ok);
    assert!(told.contains("of norm 1.03") && told.contains("within 0.01"), "{told}");
    let root = 0.5f64.sqrt();
    let torques =
        [format!("[{root}, 0.0, 0.0, {root}]"), "[0.71, 0.0, 0.0, 0.71]".to_owned()].map(|turn| {
            let owned = Owned::of(&scenario(&ready, &turn));
            assert_eq!(owned.observe(0.0, &READY, &[0.0; 7]), Status::Ok);
            owned.torque(7).unwrap()
        });
    let [exact, rounded] = &torques;
    assert!(exact.iter().zip(rounded).all(|(a, b)| (a - b).abs() < 1e-12), "{torques:?}");
}

#[test]
fn what_was_probably_not_meant_is_told() {
    let warnings = |owned: &Owned| -> Vec<String> {
        // SAFETY: what is not NULL ends with 0 and lives as long as the controller.
        let told = |i| unsafe {
            vff_controller_warning(owned.0, i).as_ref().map(|text| CStr::from_ptr(text))
        };
        (0..).map_while(told).map(|text| text.to_str().unwrap().to_owned()).collect()
    };
    let millimetres = "shape = { kind = 'sphere', radius = 0.05 }\nposition = [400.0, 0.0, 300.0]";
    let turned = format!("{SPHERE}\norientation = [0.0, 0.0, 0.0, 1.0]");
    let scenario = |obstacle: &str, mount: &str| {
        format!(
            "duration = 1.0\nq0 = {READY:?}\narm = {{ model = 'panda'{mount} }}\n\
             reference = {{ kind = 'setpoint' }}\n[[obstacles]]\n{obstacle}"
        )
    };
    assert_eq!(warnings(&Owned::of(&scenario(SPHERE, ""))), [""; 0]);
    let mount = ", mount = { orientation = [0, 0, 0, 1] }";
    let owned = Owned::of(&scenario(millimetres, mount));
    let told = warnings(&owned);
    assert!(told[0].starts_with("obstacles[0].position: 500.0000 m away"), "{told:?}");
    assert!(told[1].starts_with("arm.mount.orientation: [0, 0, 0, 1] is half a turn"), "{told:?}");
    let added = owned.add(&turned);
    let told = warnings(&owned);
    assert!(added == 1 && told.len() == 3, "{told:?}");
    assert!(told[2].starts_with("obstacles[1].orientation: [0, 0, 0, 1]"), "{told:?}");
    // SAFETY: NULL is no controller, which is said.
    assert!(unsafe { vff_controller_warning(null(), 0) }.is_null());
    assert_eq!(message(), "controller is NULL");
}

/// Numbers of obstacles stay their own; what is removed pushes no more.
#[test]
fn obstacles_come_and_go() {
    let owned = Owned::new("model = 'panda'", FIELD);
    assert_eq!(owned.refer(&[0.4, 0.1, 0.5], &[], &[]), Status::Ok);
    let torque = || {
        assert_eq!(owned.observe(0.0, &READY, &[0.0; 7]), Status::Ok);
        owned.torque(7).unwrap()
    };
    let free = torque();
    // Many: from 20 on the core keeps them in a hierarchy, which moving dissolves.
    let far = SPHERE.replace("-0.25", "-25.0");
    let ids: Vec<u32> = (0..25).map(|_| owned.add(&far)).collect();
    assert_eq!(torque(), free);
    let near = owned.add(SPHERE);
    let pushed = torque();
    assert_ne!(pushed, free);
    let remove = |id| {
        // SAFETY: it lives.
        unsafe { vff_controller_remove_obstacle(owned.0, id) }
    };
    for id in &ids {
        assert_eq!(remove(*id), Status::Ok);
        assert_eq!(remove(*id), Status::NoObstacle);
        assert_eq!(owned.torque(7), Err(Status::NotObserved));
    }
    assert_eq!(owned.ids(), [near]);
    assert_eq!(torque(), pushed);
    let place = [-0.05, -25.0, 0.62];
    // SAFETY: it lives, and so do the numbers.
    let moved =
        unsafe { vff_controller_move_obstacle(owned.0, near, 0.0, place.as_ptr(), null(), 3) };
    assert_eq!((moved, torque()), (Status::Ok, free.clone()));
    assert_eq!(remove(near), Status::Ok);
    assert_eq!(owned.add(SPHERE), 26);
    assert_eq!(torque(), pushed);
}

/// A cloud from another thread is, in the next torque, what a new controller with these points has.
#[test]
fn clouds_arrive() {
    for more in ["", "avoidance = 'cbf'"] {
        let settings = format!("{FIELD}\n{more}");
        let owned = Owned::new("model = 'panda'", &settings);
        owned.add(SPHERE);
        let id = owned.add(CLOUD);
        assert_eq!(owned.cloud(0, 10).err(), Some(Status::NotACloud));
        assert_eq!(owned.cloud(7, 10).err(), Some(Status::NoObstacle));
        assert_eq!(owned.cloud(id, 50_001).err(), Some(Status::TooMany));
        let (first, second) = (owned.cloud(id, 500).unwrap(), owned.cloud(id, 20).unwrap());
        assert_eq!(second.send(&[[0.0; 3]; 21]), Status::TooMany);
        assert_eq!(second.send(&[[0.0, f64::INFINITY, 0.0]]), Status::NotFinite);
        assert_eq!(owned.refer(&[0.4, 0.1, 0.5], &[], &[]), Status::Ok);
        for count in [500, 0, 3, 20] {
            let points: Vec<[f64; 3]> = (0..count)
                .map(|i| [0.01 * f64::from(i % 20), 0.02 * f64::from(i / 20), -0.1])
                .collect();
            let sender = if count > 20 { &first } else { &second };
            thread::scope(|scope| {
                let sender = Sender(sender.0);
                let points = &points;
                scope.spawn(move || {
                    assert_eq!(sender.send(points), Status::Ok);
                    std::mem::forget(sender);
                });
            });
            assert_eq!(owned.observe(0.0, &READY, &[0.0; 7]), Status::Ok);
            let tau = owned.torque(7).unwrap();
            let cloud = CLOUD.replace("[[0.0, 0.0, 0.0]]", &format!("{points:?}"));
            let mut fresh = core("model = 'panda'", &settings, &[SPHERE, &cloud]);
            let target = Target { x: &[0.4, 0.1, 0.5], dx: &[0.0; 3], ddx: &[0.0; 3] };
            assert_eq!(tau, fresh.torque(&READY, &[0.0; 7], &target, 0.0).unwrap());
        }
        // SAFETY: it lives.
        assert_eq!(unsafe { vff_controller_remove_obstacle(owned.0, id) }, Status::Ok);
        assert_eq!(first.send(&[]), Status::NotACloud);
        let last = owned.cloud(owned.add(CLOUD), 5).unwrap();
        drop(owned);
        assert_eq!(last.send(&[]), Status::NotACloud);
    }
}

/// Points that were seen a while ago are, at the time of a state, where they have gone to since.
#[test]
fn moving_points_go_on() {
    let settings = format!("{FIELD}\navoidance = 'cbf'");
    let owned = Owned::new("model = 'panda'", &settings);
    let cloud = owned.cloud(owned.add(CLOUD), 9).unwrap();
    let points = [[0.0, 0.02, -0.1], [0.02, 0.0, -0.1], [0.0; 3]];
    let velocity = [0.1, -0.3, 0.2];
    assert_eq!(cloud.send_moving(&points, &[[f64::NAN; 3]; 3], 0.0), Status::NotFinite);
    assert_eq!(cloud.send_moving(&points, &[velocity; 3], f64::NAN), Status::NotFinite);
    // SAFETY: so many points are there.
    let without = unsafe {
        vff_cloud_update_moving(cloud.0, points.as_ptr().cast(), null(), points.len(), 0.0)
    };
    assert_eq!(without, Status::Null);
    assert_eq!(owned.refer(&[0.4, 0.1, 0.5], &[], &[]), Status::Ok);
    let mut found = vec![];
    for (since, shift) in [(1.75, 0.0), (2.0, 0.25)] {
        let there = points.map(|p| [0, 1, 2].map(|k| p[k] + velocity[k] * shift));
        assert_eq!(cloud.send_moving(&there, &[velocity; 3], since), Status::Ok);
        assert_eq!(owned.observe(2.0, &READY, &[0.0; 7]), Status::Ok);
        found.push(owned.torque(7).unwrap());
    }
    assert_eq!(cloud.send(&points), Status::Ok);
    assert_eq!(owned.observe(2.0, &READY, &[0.0; 7]), Status::Ok);
    let resting = owned.torque(7).unwrap();
    let apart =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart(&found[0], &found[1]) < 1e-9, "{found:?}");
    assert!(apart(&found[0], &resting) > 1e-3, "{found:?} {resting:?}");
}

/// Two threads with one controller: calls that meet come to `Busy`, nothing else, and torques stay what they are.
#[test]
fn threads_that_meet_are_told() {
    let owned = Owned::new("model = 'panda'", FIELD);
    assert_eq!(owned.refer(&[0.4, 0.1, 0.5], &[], &[]), Status::Ok);
    assert_eq!(owned.observe(0.0, &READY, &[0.0; 7]), Status::Ok);
    let expected = owned.torque(7).unwrap();
    let met = AtomicUsize::new(0);
    let work = || {
        let mut k = 0;
        while k < 2000 || met.load(Ordering::Relaxed) == 0 {
            k += 1;
            let observed = owned.observe(0.0, &READY, &[0.0; 7]);
            match (observed, owned.torque(7)) {
                (_, Ok(tau)) => assert_eq!(tau, expected),
                // The other thread may have taken the observation.
                (Status::Ok, Err(Status::NotObserved)) => {}
                (observed, Err(status)) => {
                    assert!(
                        observed == Status::Busy || status == Status::Busy,
                        "{observed:?}, {status:?}"
                    );
                    met.fetch_add(1, Ordering::Relaxed);
                }
            }
        }
    };
    thread::scope(|scope| {
        scope.spawn(work);
        scope.spawn(work);
    });
}

/// One call of the fuzzer.
#[derive(Debug, Clone)]
enum Call {
    Observe(Given),
    Refer(Given),
    Torque(Given),
    Terms(Given),
    Pose(Given),
    Projector(Given),
    AddSphere,
    AddCloud,
    AddNothing(Given),
    Move(usize, Given),
    Remove(usize),
    MakeCloud(usize, usize),
    Send(usize, usize, Given),
    DropCloud(usize),
    Follow,
    Reset,
    Begin(Given),
    Cycle(Given),
    Stop,
}

/// What is given in place of the right thing.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Given {
    Right,
    Null,
    Short,
    Long,
    Nan,
    NoController,
}

fn given() -> impl Strategy<Value = Given> {
    prop_oneof![
        6 => Just(Given::Right),
        1 => prop::sample::select(vec![Given::Null, Given::Short, Given::Long, Given::Nan, Given::NoController]),
    ]
}

fn call() -> impl Strategy<Value = Call> {
    prop_oneof![
        6 => given().prop_map(Call::Observe),
        6 => given().prop_map(Call::Torque),
        2 => given().prop_map(Call::Refer),
        2 => given().prop_map(Call::Terms),
        1 => given().prop_map(Call::Pose),
        1 => given().prop_map(Call::Projector),
        1 => Just(Call::AddSphere),
        2 => Just(Call::AddCloud),
        1 => given().prop_map(Call::AddNothing),
        2 => (0usize..8, given()).prop_map(|(i, given)| Call::Move(i, given)),
        1 => (0usize..8).prop_map(Call::Remove),
        2 => (0usize..8, prop::sample::select(vec![0usize, 5, 50_001])).prop_map(|(i, most)| Call::MakeCloud(i, most)),
        3 => (0usize..4, 0usize..8, given()).prop_map(|(i, count, given)| Call::Send(i, count, given)),
        1 => (0usize..4).prop_map(Call::DropCloud),
        1 => Just(Call::Follow),
        1 => Just(Call::Reset),
        1 => given().prop_map(Call::Begin),
        6 => given().prop_map(Call::Cycle),
        1 => Just(Call::Stop),
    ]
}

/// What must be known to predict every status.
#[derive(Default)]
struct Model {
    /// Obstacles: their number, and whether they are clouds.
    obstacles: Vec<(u32, bool)>,
    next: u32,
    /// Handles of clouds: of which obstacle, room.
    clouds: Vec<(u32, usize, Sender)>,
    observed: bool,
    refers: bool,
    commanded: bool,
    begun: bool,
    /// Whether the loop is over, which a reset leaves.
    over: bool,
    t: f64,
}

/// The status for what was given in place of the right thing.
fn of(given: Given) -> Option<Status> {
    match given {
        Given::Right => None,
        Given::Null | Given::NoController => Some(Status::Null),
        Given::Short | Given::Long => Some(Status::Length),
        Given::Nan => Some(Status::NotFinite),
    }
}

/// Numbers as they are given, and their length. They are as long as is said.
fn array(right: &[f64], given: Given) -> Vec<f64> {
    let mut values = right.to_vec();
    match given {
        Given::Short => _ = values.pop(),
        Given::Long => values.push(0.0),
        Given::Nan => values[right.len() - 1] = f64::NAN,
        Given::Right | Given::Null | Given::NoController => {}
    }
    values
}

impl Model {
    fn id(&self, i: usize) -> u32 {
        self.obstacles.get(i).map_or(1000, |(id, _)| *id)
    }

    fn add(&mut self, cloud: bool) {
        self.obstacles.push((self.next, cloud));
        self.next += 1;
        self.observed = false;
    }

    /// Makes the call and says what must have come of it.
    fn make(&mut self, owned: &Owned, call: &Call) -> (Status, Status) {
        use Status::{
            Document, Length, NoObstacle, NoReference, NotACloud, NotObserved, Null, Ok as Fine,
            TooMany,
        };
        let c = |given| if given == Given::NoController { null_mut() } else { owned.0 };
        let start =
            |values: &[f64], given| if given == Given::Null { null() } else { values.as_ptr() };
        let room = |values: &mut [f64], given| {
            if given == Given::Null { null_mut() } else { values.as_mut_ptr() }
        };
        // What is written to is as long as is said, and numbers in it do not matter.
        let out = |n: usize, given| array(&vec![0.25; n], given);
        // SAFETY: below, pointers are NULL or to as many numbers as are given.
        unsafe {
            match call.clone() {
                Call::Observe(given) => {
                    let q = array(&READY, given);
                    let done = vff_controller_observe(
                        c(given),
                        0.0,
                        start(&q, given),
                        q.as_ptr(),
                        q.len(),
                    );
                    self.observed |= done == Fine;
                    (done, of(given).unwrap_or(Fine))
                }
                Call::Refer(given) => {
                    let x = array(&[0.4, 0.1, 0.5, 0.0, 1.0, 0.0, 0.0], given);
                    let done = vff_controller_set_reference(
                        c(given),
                        start(&x, given),
                        x.len(),
                        null(),
                        0,
                        x.as_ptr(),
                        6,
                    );
                    self.refers |= done == Fine;
                    (done, of(given).unwrap_or(Fine))
                }
                Call::Torque(given) => {
                    let mut tau = out(7, given);
                    let done = vff_controller_torque(c(given), room(&mut tau, given), tau.len());
                    let expected = match of(given).filter(|status| *status != Status::NotFinite) {
                        Some(status) => status,
                        None if !self.observed => NotObserved,
                        None if !self.refers => NoReference,
                        None => {
                            (self.observed, self.commanded) = (false, true);
                            assert!(tau.iter().all(|tau| tau.is_finite()));
                            Fine
                        }
                    };
                    (done, expected)
                }
                Call::Terms(given) => {
                    let mut terms = MaybeUninit::<Terms>::uninit();
                    let null = matches!(given, Given::Null);
                    let to = if null { null_mut() } else { terms.as_mut_ptr() };
                    let done = vff_controller_terms(c(given), to);
                    if done == Fine {
                        let terms = terms.assume_init();
                        let clearance = std::slice::from_raw_parts(terms.clearance, terms.joints);
                        assert!(clearance.iter().all(|d| !d.is_nan()));
                    }
                    let expected = match given {
                        Given::Null | Given::NoController => Null,
                        _ if self.commanded => Fine,
                        _ => NotObserved,
                    };
                    (done, expected)
                }
                Call::Pose(given) => {
                    let mut x = out(7, given);
                    let done = vff_controller_pose(c(given), room(&mut x, given), x.len());
                    let known = self.observed || self.commanded;
                    let right = if known { Fine } else { NotObserved };
                    (done, of(given).filter(|status| *status != Status::NotFinite).unwrap_or(right))
                }
                Call::Projector(given) => {
                    let mut x = out(49, given);
                    let done =
                        vff_controller_null_projector(c(given), room(&mut x, given), x.len());
                    let right = if self.commanded { Fine } else { NotObserved };
                    (done, of(given).filter(|status| *status != Status::NotFinite).unwrap_or(right))
                }
                Call::AddSphere => {
                    assert_eq!(owned.add(SPHERE), self.next);
                    self.add(false);
                    (Fine, Fine)
                }
                Call::AddCloud => {
                    assert_eq!(owned.add(CLOUD), self.next);
                    self.add(true);
                    (Fine, Fine)
                }
                Call::AddNothing(given) => {
                    let document = text("shape = { kind = 'circle', radius = 1.0 }");
                    let toml = if given == Given::Null { null() } else { document.as_ptr() };
                    let done = vff_controller_add_obstacle(c(given), toml, null_mut());
                    let null = matches!(given, Given::Null | Given::NoController);
                    (done, if null { Null } else { Document })
                }
                Call::Move(i, given) => {
                    let place = array(&[0.3, 0.3, 0.3], given);
                    let done = vff_controller_move_obstacle(
                        c(given),
                        self.id(i),
                        0.5,
                        start(&place, given),
                        null(),
                        place.len(),
                    );
                    let expected = match (given, i < self.obstacles.len()) {
                        (Given::NoController, _) => Null,
                        (_, false) => NoObstacle,
                        _ => of(given).unwrap_or(Fine),
                    };
                    (done, expected)
                }
                Call::Remove(i) => {
                    let done = vff_controller_remove_obstacle(owned.0, self.id(i));
                    if i >= self.obstacles.len() {
                        return (done, NoObstacle);
                    }
                    self.obstacles.remove(i);
                    self.observed = false;
                    (done, Fine)
                }
                Call::MakeCloud(i, most) => {
                    let made = owned.cloud(self.id(i), most);
                    let done = made.as_ref().map_or_else(|status| *status, |_| Fine);
                    let expected = match self.obstacles.get(i) {
                        None => NoObstacle,
                        Some((_, false)) => NotACloud,
                        Some(_) if most > 50_000 => TooMany,
                        Some((id, true)) => {
                            self.clouds.push((
                                *id,
                                most,
                                made.unwrap_or_else(|status| panic!("{status:?}")),
                            ));
                            self.observed = false;
                            Fine
                        }
                    };
                    (done, expected)
                }
                Call::Send(i, count, given) => {
                    let Some((of, most, sender)) = self.clouds.get(i) else {
                        return (vff_cloud_update(null(), null(), 0), Null);
                    };
                    let mut points = vec![0.05; 3 * count];
                    if let (Given::Nan, Some(last)) = (given, points.last_mut()) {
                        *last = f64::NAN;
                    }
                    let done = vff_cloud_update(sender.0, start(&points, given), count);
                    let lives = self.obstacles.iter().any(|(id, _)| id == of);
                    let expected = match given {
                        _ if !lives => NotACloud,
                        _ if count > *most => TooMany,
                        Given::Null if count > 0 => Null,
                        Given::Nan if count > 0 => Status::NotFinite,
                        _ => Fine,
                    };
                    (done, expected)
                }
                Call::DropCloud(i) => {
                    if i < self.clouds.len() {
                        self.clouds.remove(i);
                    }
                    (Fine, Fine)
                }
                Call::Follow => (vff_controller_follow_scenario(owned.0), NoReference),
                Call::Reset => {
                    (self.observed, self.commanded) = (false, false);
                    self.begun &= !self.over;
                    let done = vff_controller_reset(owned.0);
                    assert_ne!(done, Length);
                    (done, Fine)
                }
                Call::Begin(given) => {
                    let measured = array(&[0.1; 7], given);
                    let done = vff_controller_begin(
                        c(given),
                        0.001,
                        start(&measured, given),
                        measured.len(),
                    );
                    // A measured torque may be anything.
                    let expected = of(given).filter(|status| *status != Status::NotFinite);
                    if done == Fine {
                        (self.begun, self.over) = (true, false);
                        (self.observed, self.commanded) = (false, false);
                    }
                    (done, expected.unwrap_or(Fine))
                }
                Call::Cycle(given) => {
                    let (q, dq) = (array(&READY, given), array(&[0.0; 7], given));
                    let mut tau = vec![0.25; q.len()];
                    let mut phase = vff_phase::Lost;
                    self.t += 0.001;
                    let done = vff_controller_cycle(
                        c(given),
                        self.t,
                        start(&q, given),
                        start(&dq, given),
                        tau.as_mut_ptr(),
                        q.len(),
                        &raw mut phase,
                    );
                    let expected = match given {
                        Given::NoController => Null,
                        Given::Short | Given::Long => Length,
                        _ if !self.begun => Status::NotBegun,
                        _ => Fine,
                    };
                    if done == Fine {
                        assert!(tau.iter().all(|tau| tau.is_finite()));
                        self.observed = false;
                        self.over = matches!(phase, vff_phase::Lost | vff_phase::Finished);
                        self.commanded |= matches!(phase, vff_phase::Starting | vff_phase::Running);
                    } else {
                        assert_eq!(tau, vec![0.25; q.len()]);
                    }
                    (done, expected)
                }
                Call::Stop => (vff_controller_stop(owned.0), Fine),
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Whatever the order of calls: each comes to the status that the documentation says.
    #[test]
    fn no_order_of_calls_surprises(
        avoidance in prop::sample::select(vec!["null_space", "relaxed", "cbf"]),
        calls in prop::collection::vec(call(), 1..80),
    ) {
        let settings = format!("task = 'pose'\navoidance = '{avoidance}'\n{FIELD}");
        let owned = Owned::new("model = 'panda'", &settings);
        let mut model = Model::default();
        for call in &calls {
            let (done, expected) = model.make(&owned, call);
            prop_assert_eq!(done, expected, "{:?}: {}", call, message());
            let known: Vec<u32> = model.obstacles.iter().map(|(id, _)| *id).collect();
            prop_assert_eq!(owned.ids(), known);
        }
        // Handles may outlive their controller.
        drop(owned);
        for (_, _, sender) in &model.clouds {
            prop_assert_eq!(sender.send(&[]), Status::NotACloud);
        }
    }
}
