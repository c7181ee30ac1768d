//! A plan in somebody else's loop: clock, posture and margins are those of a simulation.

use vff_core::control::output::Phase;
use vff_core::math::ScalarOrVec;
use vff_core::runtime::{
    AnyArm, AnyController, CycleError, MissedStart, Reading, SetPointLimits, Target, VirtualArm,
    VirtualArmError,
};
use vff_core::scenario::Scenario;

const H: f64 = 1e-3;

/// Four links turn past a disc that comes into their way, among margins that change along the plan.
const SCENE: &str = "duration = 4.0\n q0 = [0.2, 0.3, 0.3, 0.3]\n\
    arm = { lengths = [1, 1, 1, 1], masses = 1, radius = 0.05, gravity = 9.81 }\n\
    simulation = { dt = 1e-3, control = 'hold', integrator = 'semi_implicit_euler' }\n\
    [controller]\n stiffness = 100\n damping = 20\n null_damping = 10\n posture_stiffness = 60\n\
    avoidance = 'cbf'\n governor = {}\n\
    [reference]\n kind = 'plan'\n times = [0.0, 1.5, 3.0]\n\
    points = [[0.2, 0.3, 0.3, 0.3], [0.9, 0.4, 0.3, 0.2], [1.6, 0.3, 0.3, 0.3]]\n\
    margins = [[0.02, 0.02, 0.02, 0.02], [0.01, 0.01, 0.015, 0.015], [0.02, 0.02, 0.02, 0.02]]\n\
    [[obstacles]]\n shape = { kind = 'circle', radius = 0.2 }\n position = [2.0, 3.3]\n\
    motion = { kind = 'linear', velocity = [-0.05, 0.0] }";

fn scenario() -> Scenario {
    Scenario::from_toml(SCENE).unwrap()
}

fn controller() -> AnyController {
    AnyController::from_scenario(&scenario()).unwrap()
}

/// Every torque of a run, to the last bit, from a controller that is shown the states of it.
#[test]
fn the_torques_are_those_of_a_simulation() {
    let (mut run, mut controller) = (scenario().prepare_recorded(false).unwrap().run, controller());
    let (mut late, mut x) = (0.0_f64, [0.0; 2]);
    loop {
        let seen = run.snapshot();
        controller.observe(seen.q, seen.dq, seen.t);
        assert_eq!(controller.follow(), seen.torque.total.as_slice(), "at {}", seen.t);
        controller.write_reference(&mut x);
        assert_eq!((&x[..], controller.planned()), (seen.x_ref, seen.q_plan), "at {}", seen.t);
        late = late.max(seen.t - seen.path_time.unwrap());
        if !run.step() {
            break;
        }
        let next = controller.path_time().unwrap();
        assert!(next <= run.snapshot().t);
    }
    assert!(late > 0.1, "the governor has waited for {late} s only");
}

/// What is not to be seen is not in the distances of a controller in somebody else's loop, and is answered there as in a
/// simulation when it is felt.
#[test]
fn what_is_not_seen_is_felt_alone() {
    let scene = SCENE
        .replace(
            "governor = {}",
            "governor = {}\n observer = { detection = {} }\n touch = { reaction = {} }",
        )
        .replace("[2.0, 3.3]", "[2.4, 3.0]")
        .replace("[-0.05, 0.0] }", "[-0.4, 0.0] }\n contact = { seen = false }");
    let scenario = Scenario::from_toml(&scene).unwrap();
    let mut run = scenario.prepare_recorded(false).unwrap().run;
    let mut controller = AnyController::from_scenario(&scenario).unwrap();
    let mut touched = 0;
    while run.snapshot().t < 2.5 {
        let seen = run.snapshot();
        controller.observe(seen.q, seen.dq, seen.t);
        let torque = controller.follow();
        let off = torque.iter().zip(&seen.torque.total).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f64::max) < 1e-6, "at {}", seen.t);
        assert!(controller.terms_view().clearance.iter().all(|d| *d == f64::INFINITY));
        assert!(seen.clearance.iter().all(|d| d.is_finite()));
        assert_eq!(controller.touched_link(), seen.touched_link.filter(|link| *link < 4));
        touched += usize::from(controller.touched_link().is_some());
        assert!(run.step());
    }
    assert!(touched > 100, "{touched}");
}

/// In a loop that is watched over, the reference begins when the torque has been blended in, whatever the robot's clock says.
#[test]
fn it_begins_when_the_torque_is_blended_in() {
    for clock in [0.0, 1234.5] {
        let mut controller = controller();
        controller.begin(H, None).unwrap();
        let q = [0.2, 0.3, 0.3, 0.3];
        for k in 0..1000 {
            let t = clock + H * f64::from(k);
            let reading = Some(Reading { t, q: &q, dq: &[0.0; 4] });
            let phase = controller.cycle(reading, None).unwrap();
            let (since, path_time) = (H * f64::from(k) - 0.5, controller.path_time().unwrap());
            if since < -0.5 * H {
                assert_eq!((phase, path_time), (Phase::Starting, 0.0), "{clock} {k}");
                assert_eq!(controller.planned().unwrap(), q);
            } else if since < 0.1 {
                assert!((path_time - since).abs() < 1e-6, "{clock} {k}: {path_time}");
            }
        }
        // An arm that is held where it was is waited for.
        assert!(controller.path_time().unwrap() < 0.48);
    }
}

/// Other references are taken in between, and the plan goes on after them; a loop begins it anew.
#[test]
fn other_references_come_in_between() {
    let mut controller = controller();
    let (q, dq) = ([0.2, 0.3, 0.3, 0.3], [0.0; 4]);
    let mut x = [0.0; 2];
    controller.observe(&q, &dq, 1.0);
    controller.follow();
    controller.write_reference(&mut x);
    controller.observe(&q, &dq, 1.0 + H);
    let target = Target { x: &[3.0, 1.0], dx: &[0.0; 2], ddx: &[0.0; 2] };
    controller.command(&target).unwrap();
    let mut other = [0.0; 2];
    controller.write_reference(&mut other);
    assert_eq!(other.map(f64::to_bits), [3.0, 1.0].map(f64::to_bits));
    controller.observe(&q, &dq, 1.0 + 2.0 * H);
    controller.follow();
    controller.write_reference(&mut other);
    assert!(
        (0..2).all(|i| (other[i] - x[i]).abs() < 5e-3)
            && other.map(f64::to_bits) != x.map(f64::to_bits)
    );
}

/// A robot that is elsewhere is not thrown to where the reference begins: the loop sends nothing new, and says why.
#[test]
fn a_loop_begins_where_its_reference_does() {
    let line =
        "[reference]\n kind = 'line'\n start = [3.0, 2.28]\n end = [1.0, 3.0]\n duration = 3.0\n";
    let [before, plan] = SCENE.split("[reference]").collect::<Vec<_>>()[..] else { panic!() };
    let obstacles = plan.split_at(plan.find("[[obstacles]]").unwrap()).1;
    let before = before.replace("posture_stiffness = 60\n", "");
    let line = format!("{before}{line}{obstacles}");
    let [near, away] = [[0.2, 0.3, 0.35, 0.3], [0.2, 0.3, 0.45, 0.3]];
    let elsewhere = [
        "the plan begins elsewhere: joint 2 is at 0.450, the plan has it at 0.300",
        "the reference begins elsewhere: the end effector is 0.293 m and 0.00 rad from there, and 0.010 m and 0.00 rad at \
         the scenario's q0",
    ];
    for (scene, why) in [SCENE, &line].into_iter().zip(elsewhere) {
        let begun = || {
            let scenario = Scenario::from_toml(scene).unwrap();
            let mut controller = AnyController::from_scenario(&scenario).unwrap();
            controller.begin(H, None).unwrap();
            controller
        };
        let at = |t, q| Some(Reading { t, q, dq: &[0.0; 4] });
        let mut controller = begun();
        for t in [H, 2.0 * H, 3.0 * H] {
            let refused = controller.cycle(at(t, &away), None).unwrap_err();
            assert!(matches!(refused, CycleError::Elsewhere(_)));
            assert_eq!(refused.to_string(), why);
            assert!(controller.sent().unwrap().iter().all(|tau| *tau == 0.0)); // nothing yet
        }
        let given = Target { x: &[2.0, 2.6], dx: &[0.0; 2], ddx: &[0.0; 2] };
        assert_eq!(controller.cycle(at(4.0 * H, &away), Some(&given)), Ok(Phase::Starting)); // whose place others know
        // A loop that runs goes on, and waits until it is there.
        assert_eq!(controller.cycle(at(5.0 * H, &away), None), Ok(Phase::Starting));
        assert!(controller.missed_start(&away).is_some());
        assert_eq!(controller.cycle(at(1.0, &near), None), Ok(Phase::Starting));
        assert_eq!(controller.missed_start(&near), None);
        let mut controller = begun();
        controller.stop(); // which goes nowhere
        assert_eq!(controller.cycle(at(H, &away), None), Ok(Phase::Stopping));
        let mut controller = begun();
        assert_eq!(controller.cycle(at(H, &near), None), Ok(Phase::Starting));
        assert_eq!(controller.cycle(at(1.0, &away), None), Ok(Phase::Starting)); // it has begun
    }
}

/// A joint that is far beyond its stop is given in another order, sign, zero or unit; one that is a little beyond is brought back.
#[test]
fn no_loop_begins_far_beyond_the_stops() {
    let arm = AnyArm::read(&toml::toml! { model = "panda" }).unwrap();
    let mut controller = AnyController::new(&arm, &toml::Table::new()).unwrap();
    controller.begin(H, None).unwrap();
    let q = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785];
    let reversed: [f64; 7] = std::array::from_fn(|i| q[6 - i]);
    let other = "give joints in the order, with the signs and the zeros of the arm";
    for (k, (said, joint, why)) in [
        (q.map(f64::to_degrees), 3, "all joints would fit in degrees, give radians"),
        (q.map(|q| -q), 3, other),
        (reversed, 5, other),
    ]
    .into_iter()
    .enumerate()
    {
        let t = H * k as f64;
        controller.begin(H, None).unwrap();
        let refused = controller.cycle(Some(Reading { t, q: &said, dq: &[0.0; 7] }), None);
        let Err(CycleError::Elsewhere(missed)) = refused else { panic!("{refused:?}") };
        assert!(matches!(missed, MissedStart::Stop { joint: j, .. } if j == joint), "{missed}");
        assert!(missed.to_string().ends_with(why), "{missed}");
        let made = VirtualArm::new(&mut controller, &limits(), H, &said);
        assert_eq!(made.err(), Some(VirtualArmError::Elsewhere(missed)));
    }
    let near = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 2.8973 + 0.15];
    controller.begin(H, None).unwrap();
    let mut set_points = VirtualArm::new(&mut controller, &limits(), H, &near).unwrap();
    for k in 0..2000 {
        set_points.step(&mut controller, H * f64::from(k), None, None).unwrap();
    }
    assert!(set_points.set_point()[0][6] < 2.8973 + 1e-6);
    controller.begin(H, None).unwrap();
    let reading = Reading { t: 0.0, q: &near, dq: &[0.0; 7] };
    assert_eq!(controller.cycle(Some(reading), None), Ok(Phase::Starting));
}

fn limits() -> SetPointLimits {
    let [acceleration, jerk] = [10.0, 1000.0].map(ScalarOrVec::Uniform);
    SetPointLimits { speed: Some(ScalarOrVec::Uniform(2.0)), acceleration, jerk, threshold: 0.1 }
}

/// A plan that set points cannot follow is refused, and the law goes on as if it had not been asked.
#[test]
fn set_points_refuse_a_plan_that_they_cannot_follow() {
    let mut controller = controller();
    let q = [0.2, 0.3, 0.3, 0.3];
    let torque = |controller: &mut AnyController| {
        controller.observe(&q, &[0.5; 4], 0.0);
        controller.follow().to_vec()
    };
    let free = torque(&mut controller);
    let slow = |acceleration: f64, jerk: f64| SetPointLimits {
        acceleration: ScalarOrVec::Uniform(acceleration),
        jerk: ScalarOrVec::Uniform(jerk),
        ..limits()
    };
    for (limits, says) in [(slow(0.1, 1e4), "acceleration: "), (slow(50.0, 0.5), "jerk: ")] {
        let refused = VirtualArm::new(&mut controller, &limits, H, &q).unwrap_err();
        assert!(matches!(refused, VirtualArmError::TooFast { .. }));
        assert!(refused.to_string().starts_with(says), "{refused}");
        assert_eq!(torque(&mut controller), free);
    }
    assert!(VirtualArm::new(&mut controller, &limits(), H, &q).is_ok());
}

/// Set points follow the reference from the first on, whatever the clock says and however often they begin, and go nowhere from
/// elsewhere.
#[test]
fn set_points_begin_with_the_reference() {
    let mut controller = controller();
    let q = [0.2, 0.3, 0.3, 0.3];
    let run = |controller: &mut AnyController, q: &[f64], clock: f64| {
        let mut arm = VirtualArm::new(controller, &limits(), H, q).unwrap();
        let missed = controller.missed_start(q);
        let mut off: f64 = 0.0;
        for k in 0..1500 {
            arm.step(controller, clock + H * f64::from(k), None, None).unwrap();
            let begins = controller.path_time().unwrap();
            assert!(begins <= f64::max(0.0, H * f64::from(k) - 0.5) + 1e-9, "{clock} {k} {begins}");
            // One that waits is told of no plan.
            let planned = controller.planned().unwrap_or_default();
            let ways = arm.set_point()[0].iter().zip(planned).map(|(q, plan)| (q - plan).abs());
            off = ways.fold(off, f64::max);
        }
        (missed.is_some(), off, arm.set_point()[0].to_vec())
    };
    let (missed, off, first) = run(&mut controller, &q, 0.0);
    assert!(!missed && off < 0.15 && first[0] > 0.4, "{off} {first:?}");
    for clock in [0.0, 1234.5] {
        let (missed, again, _) = run(&mut controller, &q, clock);
        assert!(!missed && again < 0.15, "{again}");
    }
    let away = [0.2, 0.9, 0.3, 0.3];
    let (missed, _, last) = run(&mut controller, &away, 0.0);
    assert!(missed && last.iter().zip(away).all(|(a, b)| (a - b).abs() < 0.05), "{last:?}");
}

/// Set points that are told to forget begin with the reference once more, whatever the clock says.
#[test]
fn a_reference_of_set_points_begins_again() {
    let mut controller = controller();
    let mut arm = VirtualArm::new(&mut controller, &limits(), H, &[0.2, 0.3, 0.3, 0.3]).unwrap();
    let mut go = |controller: &mut AnyController, from: i32, to: i32| {
        for k in from..to {
            arm.step(controller, 101.0 + H * f64::from(k), None, None).unwrap();
        }
        controller.path_time().unwrap()
    };
    assert!(go(&mut controller, 0, 10) <= 0.0);
    assert!(go(&mut controller, 10, 1500) > 0.5);
    controller.forget();
    assert!(go(&mut controller, 1500, 1510) <= 0.0);
}
