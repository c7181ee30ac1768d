//! What a loop in C has beside its torque: plans, other laws, loads, distances, turning obstacles.

use std::ffi::{CStr, CString};
use std::ptr::{null, null_mut};
use vff_core::runtime::{AnyArm, AnyController, Reading};
use vff_core::scenario::{LoadSpec, Scenario};
use vffnull::*;

const READY: [f64; 7] = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8];
const SETTINGS: &str = "task = 'pose'\nstiffness = 400\ndamping = 40\nnull_damping = 10";
const SHELF: &str = include_str!("../../../python/vffnull/scenarios/panda-shelf.toml");

fn message() -> String {
    // SAFETY: it ends with 0 and is not changed before the next fault.
    unsafe { CStr::from_ptr(vff_last_message()) }.to_str().unwrap().to_owned()
}

fn text(text: &str) -> CString {
    CString::new(text).unwrap()
}

fn panda() -> *mut Robot {
    let mut robot = null_mut();
    // SAFETY: text and place live.
    assert_eq!(unsafe { vff_robot_named(c"panda".as_ptr(), &raw mut robot) }, Status::Ok);
    robot
}

fn controller(robot: *const Robot, settings: &str) -> *mut Controller {
    let (mut controller, settings) = (null_mut(), text(settings));
    // SAFETY: texts and places live.
    let made = unsafe { vff_controller_new(robot, settings.as_ptr(), &raw mut controller) };
    assert_eq!(made, Status::Ok, "{}", message());
    controller
}

fn cycle(controller: *mut Controller, t: f64, q: &[f64], dq: &[f64]) -> (Vec<f64>, vff_phase) {
    let (mut tau, mut phase) = (vec![0.0; q.len()], vff_phase::Lost);
    // SAFETY: all have that length.
    let done = unsafe {
        vff_controller_cycle(
            controller,
            t,
            q.as_ptr(),
            dq.as_ptr(),
            tau.as_mut_ptr(),
            q.len(),
            &raw mut phase,
        )
    };
    assert_eq!(done, Status::Ok, "{}", message());
    (tau, phase)
}

/// The shelf's plan, posture, margins and governor, bit for bit those of the core; the plan begins when the torque is blended in.
#[test]
fn a_plan_is_followed() {
    let (mut whole, toml) = (null_mut(), text(SHELF));
    // SAFETY: text and place live.
    unsafe {
        assert_eq!(vff_controller_from_scenario(toml.as_ptr(), &raw mut whole), Status::Ok);
        assert_eq!(vff_controller_begin(whole, 1e-3, null(), 0), Status::Ok);
    }
    let scenario = Scenario::from_toml(SHELF).unwrap();
    let mut core = AnyController::from_scenario(&scenario).unwrap();
    core.begin(1e-3, None).unwrap();
    let (mut q, dq) = (scenario.q0.clone(), vec![0.0; 7]);
    let (mut planned, mut time) = ([0.0; 7], 0.0);
    for k in 0..900 {
        let t = 1e-3 * f64::from(k);
        let (tau, phase) = cycle(whole, t, &q, &dq);
        core.cycle(Some(Reading { t, q: &q, dq: &dq }), None).unwrap();
        assert_eq!(core.sent().unwrap(), tau, "{k} {phase:?}");
        // SAFETY: there is room for 7.
        let told = unsafe { vff_controller_planned(whole, planned.as_mut_ptr(), 7, &raw mut time) };
        assert_eq!(told, Status::Ok);
        assert_eq!((core.planned().unwrap(), core.path_time().unwrap()), (&planned[..], time));
        if k > 500 {
            q.copy_from_slice(&planned); // an arm that follows
        }
    }
    assert!(time > 0.35 && planned[0] < scenario.q0[0] - 1e-3, "{time} {planned:?}");
    // SAFETY: it is not used again.
    unsafe {
        let plain = controller(panda(), SETTINGS);
        assert_eq!(
            vff_controller_planned(plain, planned.as_mut_ptr(), 7, null_mut()),
            Status::NoReference
        );
        vff_controller_free(plain);
        vff_controller_free(whole);
    }
}

/// Other gains, a posture and a load in a loop that runs: nothing in the first cycle, everything half a second later; whatever does not suit
/// the loop is refused.
#[test]
fn another_law_takes_over_without_a_step() {
    let (robot, mut loaded, mut next, mut other) = (panda(), null_mut(), null_mut(), null_mut());
    let settings = format!("{SETTINGS}\nposture = {READY:?}\nposture_stiffness = 20.0");
    let stiff = text(&settings.replace("400", "900").replace("damping = 40", "damping = 60"));
    let wrong = text(&format!("{SETTINGS}\ncommand = {{ blend_time = 0.1 }}"));
    let running = controller(robot, SETTINGS);
    let mut q = READY;
    // SAFETY: texts, places and arrays live.
    unsafe {
        assert_eq!(vff_controller_begin(running, 1e-3, null(), 0), Status::Ok);
        let com = [0.0, 0.0, 0.05];
        assert_eq!(
            vff_robot_with_load(robot, 2.0, com.as_ptr(), null(), &raw mut loaded),
            Status::Ok
        );
        assert_eq!(
            vff_robot_with_load(robot, -2.0, com.as_ptr(), null(), &raw mut loaded),
            Status::Document
        );
        let refused = vff_controller_successor(running, robot, wrong.as_ptr(), &raw mut other);
        assert_eq!((refused, message().contains("command")), (Status::Document, true));
        assert_eq!(
            vff_controller_successor(running, robot, c"task = 'position'".as_ptr(), &raw mut other),
            Status::Document
        );
        let made = vff_controller_successor(running, loaded, stiff.as_ptr(), &raw mut next);
        assert_eq!(made, Status::Ok, "{}", message());
        let made = vff_controller_successor(running, robot, stiff.as_ptr(), &raw mut other);
        assert_eq!(made, Status::Ok, "{}", message());
    }
    let mut pose = [0.0; 7];
    // SAFETY: arrays have the lengths that are given.
    unsafe {
        assert_eq!(vff_robot_pose(robot, q.as_ptr(), 7, pose.as_mut_ptr(), 7), Status::Ok);
        let given = vff_controller_set_reference(running, pose.as_ptr(), 7, null(), 0, null(), 0);
        assert_eq!(given, Status::Ok);
    }
    q[1] += 0.02; // an error, on which other gains act otherwise
    let (mut before, mut largest) = (vec![], 0.0_f64);
    let mut first = 0.0_f64;
    for k in 0..1600 {
        let (tau, _) = cycle(running, 1e-3 * f64::from(k), &q, &[0.0; 7]);
        if k > 700 {
            let step = |(a, b): (&f64, &f64)| (a - b).abs();
            let step = tau.iter().zip(&before).map(step).fold(0.0, f64::max);
            largest = largest.max(step);
            if k == 801 {
                first = step;
            }
        }
        before = tau;
        if k == 800 {
            // SAFETY: both live.
            unsafe {
                assert_eq!(vff_controller_succeed(running, next, 0.5), Status::Ok);
                assert_eq!(vff_controller_succeed(running, running, 0.5), Status::Busy);
                assert_eq!(vff_controller_succeed(running, other, 0.5), Status::Succeeding);
                vff_controller_free(next);
            }
        }
    }
    assert!(first < 0.01 && largest < 1.0, "{first} {largest}");
    // It is the law that was asked for.
    let arm = AnyArm::read(&"model = 'panda'".parse().unwrap()).unwrap();
    let load = LoadSpec { mass: 2.0, com: Some([0.0, 0.0, 0.05]), ..LoadSpec::default() };
    let (arm, _) = arm.with_load(&load, toml::Table::new()).unwrap();
    let table = stiff.to_str().unwrap().parse().unwrap();
    let mut expected = AnyController::new(&arm, &table).unwrap();
    let zeros = [0.0; 7];
    let target = vff_core::runtime::Target { x: &pose, dx: &zeros[..6], ddx: &zeros[..6] };
    let expected = expected.torque(&q, &zeros, &target, 1.6).unwrap();
    for (a, b) in before.iter().zip(expected) {
        assert!((a - b).abs() < 1e-9, "{before:?} {expected:?}");
    }
    // SAFETY: they are not used again.
    unsafe {
        assert_eq!(vff_controller_succeed(running, other, 0.0), Status::Ok);
        [running, other].into_iter().for_each(|one| vff_controller_free(one));
        [robot, loaded].into_iter().for_each(|one| vff_robot_free(one));
    }
}

/// Jacobian and inverse kinematics: the tip goes where the first says, and the second finds its way back.
#[test]
fn the_tip_moves_as_is_said() {
    let robot = panda();
    let (mut jacobian, mut pose, mut there) = ([0.0; 42], [0.0; 7], [0.0; 7]);
    let (mut moved, h) = (READY, 1e-6);
    // SAFETY: arrays have the lengths that are given.
    unsafe {
        assert_eq!(
            vff_robot_jacobian(robot, READY.as_ptr(), 7, jacobian.as_mut_ptr(), 42),
            Status::Ok
        );
        assert_eq!(
            vff_robot_jacobian(robot, READY.as_ptr(), 7, jacobian.as_mut_ptr(), 41),
            Status::Length
        );
        vff_robot_pose(robot, READY.as_ptr(), 7, pose.as_mut_ptr(), 7);
        moved[3] += h;
        vff_robot_pose(robot, moved.as_ptr(), 7, there.as_mut_ptr(), 7);
        for axis in 0..3 {
            let slope = (there[axis] - pose[axis]) / h;
            assert!((slope - jacobian[7 * axis + 3]).abs() < 1e-5);
        }
        for length in [3, 7] {
            let (mut q, mut gap) = (READY.map(|q| q + 0.2), [1.0; 2]);
            let done = vff_robot_inverse_kinematics(
                robot,
                pose.as_ptr(),
                length,
                q.as_mut_ptr(),
                7,
                gap.as_mut_ptr(),
            );
            assert_eq!((done, gap[0] < 1e-6 && gap[1] < 1e-6), (Status::Ok, true), "{gap:?}");
            vff_robot_pose(robot, q.as_ptr(), 7, there.as_mut_ptr(), 7);
            let off = (0..3).map(|i| (there[i] - pose[i]).abs()).fold(0.0, f64::max);
            let turn: f64 = (3..7).map(|i| there[i] * pose[i]).sum(); // of q and −q, too
            assert!(off < 1e-5 && (length == 3 || turn.abs() > 1.0 - 1e-9), "{off} {turn}");
        }
        let (mut q, mut gap) = (READY, [0.0; 2]);
        let far = [5.0, 0.0, 0.0];
        let done = vff_robot_inverse_kinematics(
            robot,
            far.as_ptr(),
            3,
            q.as_mut_ptr(),
            7,
            gap.as_mut_ptr(),
        );
        assert!(done == Status::Ok && gap[0] > 3.0, "{gap:?}");
        vff_robot_free(robot);
    }
}

/// A bar that is turned comes nearer, as its distances say; and how long a torque may be held.
#[test]
fn obstacles_turn() {
    let robot = panda();
    let bar = controller(robot, SETTINGS);
    let document = c"shape = { kind = 'capsule', a = [-0.3, 0, 0], b = [0.3, 0, 0], radius = 0.03 }\nposition = [0.0, 0.6, 0.6]";
    let (mut id, mut period) = (0, 0.0);
    // SAFETY: text and place live.
    unsafe {
        assert_eq!(vff_controller_add_obstacle(bar, document.as_ptr(), &raw mut id), Status::Ok);
    }
    let distances = || {
        let (mut distance, mut gradient) = ([0.0; 7], [0.0; 49]);
        // SAFETY: arrays have the lengths that are given.
        unsafe {
            let observed = vff_controller_observe(bar, 0.0, READY.as_ptr(), [0.0; 7].as_ptr(), 7);
            assert_eq!(observed, Status::Ok);
            let found =
                vff_controller_distances(bar, id, distance.as_mut_ptr(), 7, gradient.as_mut_ptr());
            assert_eq!(found, Status::Ok, "{}", message());
        }
        (distance, gradient)
    };
    // SAFETY: places and arrays live.
    unsafe {
        let (before, gradient) = distances();
        let least = |distance: [f64; 7]| distance.into_iter().fold(f64::INFINITY, f64::min);
        assert!(least(before) > 0.4 && gradient.iter().any(|x| x.abs() > 0.1));
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let turn = |orientation: [f64; 4], rate: *const f64| {
            vff_controller_turn_obstacle(bar, id, 0.0, orientation.as_ptr(), 4, rate)
        };
        assert_eq!(turn([half, 0.0, 0.0, half], null()), Status::Ok);
        assert!((least(before) - least(distances().0) - 0.27).abs() < 0.05, "it points at the arm");
        // It has turned by a quarter half a second ago, backwards since.
        let rate = [0.0, 0.0, -std::f64::consts::PI];
        assert_eq!(
            vff_controller_turn_obstacle(
                bar,
                id,
                -0.5,
                [half, 0.0, 0.0, half].as_ptr(),
                4,
                rate.as_ptr()
            ),
            Status::Ok
        );
        assert!((least(before) - least(distances().0)).abs() < 1e-9);
        assert_eq!(turn([1.0, 1.0, 0.0, 0.0], null()), Status::Reference);
        assert_eq!(turn([f64::NAN, 1.0, 0.0, 0.0], null()), Status::NotFinite);
        assert_eq!(
            vff_controller_stable_period(bar, 0.0, READY.as_ptr(), 7, &raw mut period),
            Status::Ok
        );
        assert!(period > 1e-3 && period.is_finite(), "{period}");
        vff_controller_free(bar);
        vff_robot_free(robot);
    }
}

const FIELD: &str = "stiffness = 400\ndamping = 40\nnull_damping = 12\nfield = { kind = 'bounded', gain = 80, influence = 0.25 }";
const BALL: &CStr = c"shape = { kind = 'sphere', radius = 0.08 }\nposition = [0, -1, 0.6]";

/// A controller that holds the hand where it is, with a ball around.
fn beside_a_ball(robot: *const Robot, more: &str) -> (*mut Controller, u32) {
    let (made, mut id, mut pose) = (controller(robot, &format!("{FIELD}{more}")), 0, [0.0; 7]);
    // SAFETY: text, places and arrays live.
    unsafe {
        assert_eq!(vff_controller_add_obstacle(made, BALL.as_ptr(), &raw mut id), Status::Ok);
        vff_robot_pose(robot, READY.as_ptr(), 7, pose.as_mut_ptr(), 7);
        let given = vff_controller_set_reference(made, pose.as_ptr(), 3, null(), 0, null(), 0);
        assert_eq!(given, Status::Ok);
    }
    (made, id)
}

/// What a call for set points is given.
fn begin_set_points(controller: *mut Controller, q: &[f64; 7]) -> Status {
    let (acceleration, jerk) = ([5.0; 7], [500.0; 7]);
    let limits = vff_set_point_limits {
        speed: null(),
        acceleration: acceleration.as_ptr(),
        jerk: jerk.as_ptr(),
        threshold: 0.1,
    };
    // SAFETY: arrays and limits live.
    unsafe { vff_controller_begin_set_points(controller, 1e-3, &raw const limits, q.as_ptr(), 7) }
}

fn set_point(controller: *mut Controller, t: f64) -> (Status, [f64; 7], vff_course) {
    let ([mut q, mut dq, mut ddq], mut course) = ([[0.0; 7]; 3], vff_course::Waiting);
    let out = [&mut q, &mut dq, &mut ddq].map(|out| out.as_mut_ptr());
    // SAFETY: arrays and place live.
    let done = unsafe {
        let (still, to) = ([0.0; 7], &raw mut course);
        let [q, dq, ddq] = out;
        vff_controller_set_point(controller, t, READY.as_ptr(), still.as_ptr(), q, dq, ddq, 7, to)
    };
    (done, ddq, course)
}

fn own_torque(controller: *mut Controller, t: f64) -> [f64; 7] {
    let mut tau = [0.0; 7];
    // SAFETY: arrays have the lengths that are given.
    unsafe {
        let observed = vff_controller_observe(controller, t, READY.as_ptr(), [0.0; 7].as_ptr(), 7);
        assert_eq!(observed, Status::Ok);
        assert_eq!(vff_controller_torque(controller, tau.as_mut_ptr(), 7), Status::Ok);
    }
    tau
}

/// A ball is where it was seen, on the clock of the loop that there is, whatever kind of loop has been before.
#[test]
fn the_clock_is_that_of_the_loop() {
    let robot = panda();
    let ended = |set_points: bool| {
        let (it, id) = beside_a_ball(robot, "");
        // SAFETY: it lives.
        unsafe {
            match set_points {
                true => assert_eq!(begin_set_points(it, &READY), Status::Ok),
                false => assert_eq!(vff_controller_begin(it, 1e-3, null(), 0), Status::Ok),
            }
            for k in 0..1300 {
                if k == 1000 {
                    assert_eq!(vff_controller_stop(it), Status::Ok);
                }
                match set_points {
                    true => assert_eq!(set_point(it, 1e-3 * f64::from(k)).0, Status::Ok),
                    false => drop(cycle(it, 1e-3 * f64::from(k), &READY, &[0.0; 7])),
                }
            }
            assert_eq!(vff_controller_reset(it), Status::Ok);
        }
        (it, id)
    };
    let seen_at_10 = |(it, id): (*mut Controller, u32)| {
        let (place, velocity) = ([-0.05, -0.3, 0.62], [0.0, 0.2, 0.0]);
        // SAFETY: it and arrays live.
        let told = unsafe {
            vff_controller_move_obstacle(it, id, 10.0, place.as_ptr(), velocity.as_ptr(), 3)
        };
        assert_eq!(told, Status::Ok);
        it
    };
    let all = [beside_a_ball(robot, ""), ended(false), ended(true)].map(seen_at_10);
    let bits = |numbers: [f64; 7]| numbers.map(f64::to_bits);
    let torques = all.map(|it| own_torque(it, 10.5));
    assert!(torques.iter().all(|tau| bits(*tau) == bits(torques[0])), "{torques:?}");
    assert!(torques[0][0].abs() > 1.0, "it pushes: {torques:?}");
    let again = [beside_a_ball(robot, ""), ended(false), ended(true)];
    let points = again.map(|(it, id)| {
        assert_eq!(begin_set_points(it, &READY), Status::Ok);
        set_point(seen_at_10((it, id)), 10.0).1
    });
    assert!(points.iter().all(|point| bits(*point) == bits(points[0])), "{points:?}");
    // SAFETY: they are not used again.
    unsafe {
        all.iter().chain(&again.map(|(it, _)| it)).for_each(|it| vff_controller_free(*it));
        vff_robot_free(robot);
    }
}

/// Torques and set points exclude each other, and a beginning that is refused leaves the loop as it was, bit for bit.
#[test]
fn one_kind_of_loop_at_a_time() {
    let robot = panda();
    let twin = || beside_a_ball(robot, "\navoidance = 'cbf'").0;
    let [asked, left] = [twin(), twin()];
    let mut beyond = READY;
    beyond[1] = -45.0;
    // SAFETY: they live, as do arrays.
    unsafe {
        // Torques, and refused set points.
        for it in [asked, left] {
            assert_eq!(vff_controller_begin(it, 1e-3, null(), 0), Status::Ok);
        }
        let mut q = READY;
        q[3] += 0.05;
        for k in 0..900 {
            if k == 800 {
                assert_eq!(begin_set_points(asked, &beyond), Status::Reference);
                assert_eq!(vff_controller_begin(asked, f64::NAN, null(), 0), Status::NotFinite);
            }
            let [a, b] = [asked, left].map(|it| cycle(it, 1e-3 * f64::from(k), &q, &[0.01; 7]));
            assert_eq!(a, b, "{k}");
        }
        // Set points, and refused torques.
        for it in [asked, left] {
            assert_eq!(begin_set_points(it, &READY), Status::Ok);
        }
        let (mut tau, mut phase) = ([7.0; 7], vff_phase::Lost);
        let cycled = vff_controller_cycle(
            asked,
            1.0,
            READY.as_ptr(),
            READY.as_ptr(),
            tau.as_mut_ptr(),
            7,
            &raw mut phase,
        );
        assert_eq!((cycled, tau[0].to_bits()), (Status::NotBegun, 7f64.to_bits()));
        assert_eq!(
            vff_controller_torque(asked, tau.as_mut_ptr(), 7),
            Status::NotObserved,
            "what was observed for torques is no set point"
        );
        for k in 0..300 {
            if k == 100 {
                for period in [f64::NAN, 0.5] {
                    assert_ne!(vff_controller_begin(asked, period, null(), 0), Status::Ok);
                }
            }
            let [a, b] = [asked, left].map(|it| set_point(it, 1.0 + 1e-3 * f64::from(k)));
            assert_eq!(a, b, "{k}");
        }
        assert_eq!(vff_controller_begin(asked, 1e-3, null(), 0), Status::Ok);
        assert_eq!(set_point(asked, 2.0).0, Status::NotBegun);
        [asked, left].into_iter().for_each(|it| vff_controller_free(it));
        vff_robot_free(robot);
    }
}

/// What is asked between two cycles does not hide what the loop has left out, and what is refused writes nothing; a law takes the
/// place of another one once.
#[test]
fn what_is_refused_writes_nothing() {
    let robot = panda();
    let (it, id) = beside_a_ball(robot, "\ndeadline = 0.001");
    let (mut distance, mut counts) =
        ([123.0; 7], LeftOut { late: 0, cut: 0, rollouts: 0, points: 0, programs: 0 });
    // SAFETY: they live, as do places and arrays.
    unsafe {
        let asked = vff_controller_distances(it, id, distance.as_mut_ptr(), 7, null_mut());
        assert_eq!((asked, distance), (Status::NotObserved, [123.0; 7]));
        assert_eq!(vff_controller_begin(it, 1e-3, null(), 0), Status::Ok);
        for k in 0..600 {
            cycle(it, 1e-3 * f64::from(k), &READY, &[0.0; 7]);
        }
        own_torque(it, 0.6);
        assert_eq!(vff_controller_left_out(it, &raw mut counts), Status::Ok);
        assert!(counts.late > 500, "{counts:?}");
        let (mut next, settings) = (null_mut(), text(FIELD));
        let made = vff_controller_successor(it, robot, settings.as_ptr(), &raw mut next);
        assert_eq!(made, Status::Ok, "{}", message());
        assert_eq!(vff_controller_succeed(it, next, 0.0), Status::Ok);
        cycle(it, 0.601, &READY, &[0.0; 7]);
        assert_eq!(vff_controller_succeed(it, next, 0.0), Status::Document);
        assert!(message().contains("once"), "{}", message());
        let wrong = [0.0, 0.0, 0.0, 2.0];
        let turned = vff_controller_turn_obstacle(it, id, 0.6, wrong.as_ptr(), 4, null());
        assert_eq!((turned, message().contains("orientation")), (Status::Reference, true));
        [it, next].into_iter().for_each(|it| vff_controller_free(it));
        vff_robot_free(robot);
    }
}
