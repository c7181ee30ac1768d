//! The closed loop does not allocate: a counting allocator watches every step.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64};
use vff_core::control::Avoidance;
use vff_core::control::PreviewSettings;
use vff_core::control::detection::DetectionSettings;
use vff_core::control::observer::ObserverSettings;
use vff_core::control::output::Phase;
use vff_core::control::reaction::ReactionSettings;
use vff_core::math::Vector;
use vff_core::robot::Robot;
use vff_core::robot::description::{ArmDescription, Joint, JointKind};
use vff_core::robot::spatial::{Mobility, Spatial};
use vff_core::runtime::drive::{Loop, Options, SimulatedRobot};
use vff_core::runtime::live::{Live, State};
use vff_core::runtime::real_time::RealTime;
use vff_core::runtime::{AnyArm, AnyController, Reading, Target};
use vff_core::scenario::Scenario;
use vff_core::simulation::Status;
use vff_core::trajectory::GovernorSettings;
use vff_core::world::Motion;
use vff_core::world::plane::{Obstacle, Shape};
use vff_core::world::space;

struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(of: impl FnOnce()) -> usize {
    let before = COUNT.with(Cell::get);
    of();
    COUNT.with(Cell::get) - before
}

/// Of an obstacle that is known.
const MARGINS: &str = "margin = 0.06\n margins = { link_6 = 0.01 }";

/// An arm among every kind of obstacle, some of them moving through it, axis and all.
fn text(task: &str, reference: &str, simulation: &str, projection: &str) -> String {
    format!(
        r#"
        duration = 2.0
        q0 = [0.6, -0.4, 0.5, 0.3, -0.7, 0.4]
        arm = {{ lengths = [1, 1, 1, 1, 1, 1], masses = 1, radius = 0.05, gravity = 9.81 }}
        reference = {reference}
        simulation = {{ {simulation} }}

        [controller]
        task = "{task}"
        projection = "{projection}"
        posture = [0, 0, 0, 0, 0, 0]
        posture_stiffness = 1.0
        field = {{ kind = "bounded", gain = 5, influence = 0.8, approach_damping = 0.3, sliding = 20 }}

        [[obstacles]]
        shape = {{ kind = "circle", radius = 0.2 }}
        position = [1.5, 2.0]
        motion = {{ kind = "sinusoid", amplitude = [0, -0.8], angular_frequency = 2 }}

        [[obstacles]]
        shape = {{ kind = "box", size = [0.4, 0.2] }}
        position = [3.0, 2.2]
        angle = 0.4
        motion = {{ kind = "linear", velocity = [0, -0.7] }}
        {MARGINS}

        [[obstacles]]
        shape = {{ kind = "polygon", vertices = [[0, 0], [0.3, 0], [0.1, 0.3]] }}
        position = [4.0, -1.0]
        motion = {{ kind = "waypoints", times = [0, 1, 2], points = [[4, -1], [3.5, 1.5], [2, 2]] }}

        [[obstacles]]
        shape = {{ kind = "capsule", a = [0, 0], b = [0.5, 0.5], radius = 0.1 }}
        position = [0.5, 1.5]
        "#
    )
}

/// Joints that are led from one configuration to another.
const PLAN: &str = r#"{ kind = "plan", times = [0, 1, 2], points = [
    [0.6, -0.4, 0.5, 0.3, -0.7, 0.4], [0.5, -0.3, 0.4, 0.4, -0.6, 0.3], [0.6, -0.3, 0.3, 0.4, -0.5, 0.3]
] }"#;

fn scenario(task: &str, reference: &str, simulation: &str, projection: &str) -> Scenario {
    Scenario::from_toml(&text(task, reference, simulation, projection)).unwrap()
}

/// What a robot asks of what it is sent, in simulation: limited, compensated, slow.
#[test]
fn no_sent_torque_allocates() {
    let line = r#"{ kind = "line", end = [3.5, 1.5], duration = 1.5 }"#;
    for (simulation, more) in [
        (r#"control = "hold""#, "torque_rate = 1000, "),
        (r#"control = "predictor", control_every = 2"#, "torque_rate = 1000, "),
        (r#"control = "continuous""#, ""),
    ] {
        let text = text("position", line, simulation, "dynamic").replace(
            "posture = ",
            &format!("command = {{ {more}gravity = \"robot\", coulomb_friction = 0.1, tip_speed = 0.4 }}\nposture = "),
        );
        let mut run = Scenario::from_toml(&text).unwrap().prepare().unwrap().run;
        let count = allocations(|| while run.step() {});
        assert_eq!(count, 0, "{simulation}");
        assert_ne!(run.outcome().status, Status::Diverged);
    }
}

/// Neither does a cycle that is watched over, whatever happens to it.
#[test]
fn no_cycle_allocates() {
    let table = |text: &str| text.parse::<toml::Table>().unwrap();
    let arm = AnyArm::read(&table("model = 'panda'")).unwrap();
    let command =
        "gravity = 'robot', torque_rate = 1000.0, obstacle_speed = 2.0, blend_time = 0.01";
    let settings = format!("avoidance = 'cbf'\ncommand = {{ {command} }}");
    let mut controller = AnyController::new(&arm, &table(&settings)).unwrap();
    let ball = "shape = { kind = 'sphere', radius = 0.1 }\nposition = [0.1, -0.6, 0.62]";
    controller.add(&table(ball)).unwrap();
    let q = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785];
    controller.place(0, 0.0, &[0.1, -0.6, 0.62], &[0.0; 3]); // frees what it was
    controller.begin(1e-3, None).unwrap();
    let count = allocations(|| {
        for k in 0..600 {
            let t = 1e-3 * f64::from(k) - if k < 200 { 0.0 } else { 7.0 };
            let dq = if (100..110).contains(&k) { [9.0; 7] } else { [0.0; 7] };
            controller.place(0, t, &[0.1, -0.6 + 0.5 * f64::from(k % 2), 0.62], &[0.0; 3]);
            let heard = k > 3 && !(300..320).contains(&k);
            let reading = heard.then_some(Reading { t, q: &q, dq: &dq });
            controller.cycle(reading, None).unwrap();
            if k == 350 {
                controller.stop();
            }
        }
    });
    assert_eq!((count, controller.phase()), (0, Some(Phase::Finished)));
}

#[test]
fn no_step_allocates() {
    let position = ("position", r#"{ kind = "line", end = [3.5, 1.5], duration = 1.5 }"#);
    let pose = (
        "pose",
        r#"{ kind = "waypoints", times = [0, 1, 2], points = [[4.5, 1, 0.7], [4, 1.5, 0.5], [4, 1, 1]] }"#,
    );
    let table = (
        "position",
        r#"{ kind = "table", times = [0, 1, 2], points = [[4.5, 1], [4, 1.5], [4, 1]] }"#,
    );
    let plan = ("position", PLAN);
    let planned_pose = ("pose", PLAN);
    let loops = [
        r#"control = "hold", control_every = 3, record_every = 2"#,
        r#"control = "predictor""#,
        r#"control = "continuous""#,
        r#"control = "hold", integrator = "semi_implicit_euler""#,
    ];
    for (task, reference) in [position, pose, table, plan, planned_pose] {
        for simulation in loops {
            for projection in ["dynamic", "kinematic", "none"] {
                let ready = scenario(task, reference, simulation, projection).prepare().unwrap();
                let mut run = ready.run;
                let count = allocations(|| while run.step() {});
                assert_eq!(count, 0, "{task}, {simulation}, {projection}");
                let outcome = run.outcome();
                assert_ne!(outcome.status, Status::Diverged, "{}", outcome.message);
            }
        }
    }
}

/// Nor does a period against the wall clock: 30 and 300 of them, which begin again and again,
/// allocate the same few times before the first.
#[test]
fn no_period_allocates() {
    let simulation = r#"control = "predictor""#;
    let mut short =
        scenario("position", r#"{ kind = "setpoint", point = [4, 1] }"#, simulation, "dynamic");
    short.duration = 0.01;
    let count = |periods| {
        let real_time = RealTime::new(&short, 2000.0).unwrap();
        let (stop, done) = (AtomicBool::new(false), AtomicU64::new(0));
        let mut restarts = 0;
        let count = allocations(|| restarts = real_time.run(periods, &stop, &done).restarts);
        assert_eq!((done.into_inner(), restarts), (periods, (periods - 1) / 20));
        count
    };
    assert_eq!(count(30), count(300));
}

/// Nor does a period of a drive, among obstacles, with a reference that is carried on and rows for a file.
#[test]
fn no_period_of_a_drive_allocates() {
    let reference = r#"{ kind = "setpoint", point = [4, 1] }"#;
    let scenario = scenario("position", reference, r#"control = "hold""#, "dynamic");
    let count = |seconds| {
        let robot = SimulatedRobot::new(&scenario, 1000.0, None).unwrap();
        let controller = AnyController::from_scenario(&scenario).unwrap();
        let options = Options { seconds: Some(seconds), record_every: 1, ..Options::default() };
        let (drive, exchange) = Loop::new(robot, controller, options).unwrap();
        let target = Target { x: &[4.0, 1.0], dx: &[0.1, 0.0], ddx: &[0.0, 0.0] };
        exchange.set_target(&target).unwrap();
        let mut periods = 0;
        let count = allocations(|| periods = drive.run().periods);
        assert!(periods > (1000.0 * seconds) as u64, "{periods}");
        count
    };
    assert_eq!(count(0.03), count(0.3));
}

/// Nor does one that follows a plan, which waits.
#[test]
fn no_period_along_a_plan_allocates() {
    let plan = r#"{ kind = "plan", times = [0, 1], points = [
        [0.6, -0.4, 0.5, 0.3, -0.7, 0.4], [0.9, -0.4, 0.5, 0.3, -0.7, 0.4]] }"#;
    let mut scenario = scenario("position", plan, r#"control = "hold""#, "dynamic");
    scenario.controller.governor = Some(GovernorSettings::default());
    scenario.controller.command.blend_time = 0.01;
    let count = |seconds| {
        let robot = SimulatedRobot::new(&scenario, 1000.0, None).unwrap();
        let controller = AnyController::from_scenario(&scenario).unwrap();
        let options = Options { seconds: Some(seconds), record_every: 1, ..Options::default() };
        let (drive, _) = Loop::new(robot, controller, options).unwrap();
        let mut report = None;
        let count = allocations(|| report = Some(drive.run()));
        let report = report.unwrap();
        assert!(report.periods > (1000.0 * seconds) as u64, "{report:?}");
        // What is told when it is over: a list, and a sentence each.
        count - report.notes.len() - usize::from(!report.notes.is_empty())
    };
    assert_eq!(count(0.03), count(0.3));
}

/// A crowd that is sorted anew many times while it drifts, half of it standing still, some of it turning.
#[test]
fn no_step_allocates_in_a_crowd() {
    for simulation in [
        r#"control = "hold", integrator = "semi_implicit_euler""#,
        r#"control = "predictor""#,
        r#"control = "continuous", dt = 5e-3"#,
    ] {
        let reference = r#"{ kind = "line", end = [3.5, 1.5], duration = 1.5 }"#;
        let mut scenario = scenario("position", reference, simulation, "dynamic");
        for j in 0..1000 {
            let (x, y) = (f64::from(j % 40), f64::from(j / 40));
            let velocity = [0.4 * (y - 12.0), 0.3 * (20.0 - x)];
            scenario.scene.plane_mut().unwrap().obstacles.push(Obstacle {
                position: [0.5 * (x - 20.0), 0.5 * (y - 12.0)],
                angular_velocity: if j % 5 == 0 { 2.0 } else { 0.0 },
                motion: if j % 2 == 0 { Motion::Linear { velocity } } else { Motion::default() },
                ..Obstacle::of(if j % 3 == 0 {
                    Shape::Box { size: [0.03, 0.02] }
                } else {
                    Shape::Circle { radius: 0.02 }
                })
            });
        }
        let mut run = scenario.prepare().unwrap().run;
        let count = allocations(|| while run.step() {});
        assert_eq!(count, 0, "{simulation}");
        let outcome = run.outcome();
        assert_ne!(outcome.status, Status::Diverged, "{}", outcome.message);
    }
}

/// Neither do friction, stops, sensors and drives, in whatever combination of sticking and sliding.
#[test]
fn no_step_of_a_real_plant_allocates() {
    let reality = r#"
        plant = { masses = 1.2, payload = 0.5, viscous_friction = 0.1, coulomb_friction = 4.0 }
        measurement = { position_noise = 1e-3, velocity_resolution = 1e-3, delay = 3e-3 }
        perception = { kind = "range", noise = 1e-3, rate = 200, latency = 12e-3, drop_outs = 0.1 }
        actuator = { time_constant = 5e-3 }
        "#;
    let plant = r#"plant = { payload = 0.5, coulomb_friction = 0.5 }"#;
    let setpoint = r#"{ kind = "line", end = [3.5, 1.5], duration = 1.5 }"#;
    for (simulation, tables) in [
        (r#"control = "hold", control_every = 3"#, reality),
        (r#"control = "predictor", integrator = "semi_implicit_euler""#, reality),
        (r#"control = "continuous""#, plant),
    ] {
        let text = text("position", setpoint, simulation, "dynamic")
            .replace("gravity = 9.81", "gravity = 9.81, joint_limits = [-0.8, 0.9]")
            .replace(MARGINS, "");
        let scenario = Scenario::from_toml(&format!("{tables}\n{text}")).unwrap();
        let mut run = scenario.prepare().unwrap().run;
        let count = allocations(|| while run.step() {});
        assert_eq!(count, 0, "{simulation}");
        let outcome = run.outcome();
        assert_ne!(outcome.status, Status::Diverged, "{}", outcome.message);
        let stands = outcome.record.dq.iter().filter(|v| **v == 0.0).count();
        assert!(stands > 0 && stands < outcome.record.dq.len(), "{stands}");
    }
}

/// Nor does what pushes from outside, felt or measured, of whatever profile.
#[test]
fn no_step_allocates_that_is_pushed() {
    let pressing = "task = \"reject\", force = { direction = [1, 0] }";
    for (source, touch) in [
        ("momentum", "task = \"reject\""),
        ("measured", "task = \"reject\""),
        ("momentum", pressing),
    ] {
        let tables = r#"
            wrenches = [
                { link = "tip", force = [3, 4], profile = { kind = "ramp", rise = 0.5 } },
                { link = "link_3", point = [0.5, 0], force = [0, 9], frame = "link", start = 0.5, duration = 1 },
                { link = "link_2", torque = 2, profile = { kind = "sinusoid", angular_frequency = 9 } },
                { link = "tip", torque = 1, profile = { kind = "table", times = [0, 1], factors = [0, 1] } },
            ]
            "#;
        let setpoint = r#"{ kind = "line", end = [3.5, 1.5], duration = 1.5 }"#;
        let observed =
            format!("observer = {{ source = \"{source}\" }}\ntouch = {{ {touch} }}\nprojection =");
        let text = text("position", setpoint, r#"control = "hold""#, "dynamic")
            .replace("projection =", &observed);
        let scenario = Scenario::from_toml(&format!("{tables}\n{text}")).unwrap();
        let mut run = scenario.prepare().unwrap().run;
        let count = allocations(|| while run.step() {});
        assert_eq!(count, 0, "{source}");
        let outcome = run.outcome();
        assert!(outcome.record.tau_ext.iter().any(|tau| *tau > 1.0), "{}", outcome.message);
    }
}

/// Nor does one of an arm that is held by a hand and lies on what stands in its way.
#[test]
fn no_step_allocates_that_is_touched() {
    let setpoint = r#"{ kind = "line", end = [3.5, 1.5], duration = 1.5 }"#;
    let text = text("position", setpoint, r#"control = "hold""#, "dynamic")
        .replace("shape = { kind", "contact = { damping = 20 }\nshape = { kind");
    let mut run = Scenario::from_toml(&text).unwrap().prepare().unwrap().run;
    let pull = toml::from_str("link = 'link_3'\nanchor = [2.5, 0.5]\nstiffness = 1e5").unwrap();
    run.pull(Some(&pull)).unwrap();
    let mut is_pressed = false;
    let count = allocations(|| {
        while run.snapshot().t < 1.0 && run.advance(None) {
            is_pressed |= run.snapshot().contact_force.unwrap().iter().any(|force| *force != 0.0);
        }
    });
    assert_eq!(count, 0);
    assert!(is_pressed);
}

/// Nor does one in which something is felt that is not seen, and yielded to.
#[test]
fn no_step_allocates_that_yields_to_a_push() {
    let reference = r#"{ kind = "line", end = [3.5, 1.5], duration = 1.5 }"#;
    let text = text("position", reference, r#"control = "hold""#, "dynamic")
        .replace("shape = { kind", "contact = { damping = 20, seen = false }\nshape = { kind");
    let mut scenario = Scenario::from_toml(&text).unwrap();
    let detection = Some(DetectionSettings::default());
    scenario.controller.observer = Some(ObserverSettings { detection, ..Default::default() });
    scenario.controller.touch.reaction = Some(ReactionSettings::default());
    let mut run = scenario.prepare().unwrap().run;
    let pull = toml::from_str("link = 'link_3'\nanchor = [2.5, 0.5]\nstiffness = 1e3").unwrap();
    let mut is_felt = false;
    while run.snapshot().t < 0.5 && run.advance(None) {}
    run.pull(Some(&pull)).unwrap();
    let count = allocations(|| {
        while run.snapshot().t < 1.0 && run.advance(None) {
            is_felt |= run.snapshot().touched_link.is_some_and(|link| link < 6);
        }
    });
    assert_eq!(count, 0);
    assert!(is_felt);
}

/// Nor does one in which the end effector gives way, QP included.
#[test]
fn no_step_allocates_that_gives_way() {
    let reference = r#"{ kind = "line", end = [3.5, 1.5], duration = 1.5 }"#;
    for avoidance in [Avoidance::Relaxed, Avoidance::Priority, Avoidance::Cbf] {
        for simulation in [r#"control = "hold""#, r#"control = "predictor""#] {
            let mut scenario = scenario("position", reference, simulation, "dynamic");
            scenario.controller.avoidance = avoidance;
            let mut run = scenario.prepare().unwrap().run;
            let count = allocations(|| while run.step() {});
            assert_eq!(count, 0, "{avoidance:?}, {simulation}");
            let outcome = run.outcome();
            assert_ne!(outcome.status, Status::Diverged, "{}", outcome.message);
        }
    }
}

/// Nor does one that looks ahead and searches from beginning to end.
#[test]
fn no_step_allocates_that_looks_ahead() {
    let reference = r#"{ kind = "line", end = [3.5, 1.5], duration = 1.5 }"#;
    for (reference, simulation) in [
        (reference, r#"control = "hold""#),
        (reference, r#"control = "predictor""#),
        (PLAN, r#"control = "hold""#),
    ] {
        let mut scenario = scenario("position", reference, simulation, "dynamic");
        scenario.controller.avoidance = Avoidance::Cbf;
        let mut plain = scenario.prepare().unwrap().run;
        scenario.controller.yielding.preview =
            Some(PreviewSettings { trigger: 2.0, ..PreviewSettings::default() });
        let mut run = scenario.prepare().unwrap().run;
        let count = allocations(|| while run.step() {});
        assert_eq!(count, 0, "{simulation}");
        while plain.step() {}
        let outcome = run.outcome();
        assert_ne!(outcome.status, Status::Diverged, "{}", outcome.message);
        assert_ne!(outcome.record.q, plain.outcome().record.q, "it found nothing to do");
    }
}

/// Nor does one whose reference waits.
#[test]
fn no_step_allocates_that_waits() {
    let reference = r#"{ kind = "line", end = [3.5, 1.5], duration = 1.5 }"#;
    for simulation in [r#"control = "hold", control_every = 3"#, r#"control = "predictor""#] {
        let mut scenario = scenario("position", reference, simulation, "dynamic");
        scenario.controller.avoidance = Avoidance::Cbf;
        scenario.controller.governor = Some(GovernorSettings::default());
        let mut run = scenario.prepare().unwrap().run;
        let count = allocations(|| while run.step() {});
        assert_eq!(count, 0, "{simulation}");
        let outcome = run.outcome();
        assert_ne!(outcome.status, Status::Diverged, "{}", outcome.message);
        let late = outcome.record.t.last().unwrap() - outcome.record.path_time.last().unwrap();
        assert!(late > 0.01, "it had nothing to wait for: {late}");
    }
}

/// Nor does one of a loop whose obstacle and target somebody drags about, once the first drag has begun.
#[test]
fn no_beat_of_a_live_loop_allocates() {
    for simulation in [r#"control = "hold""#, r#"control = "predictor""#] {
        let reference = r#"{ kind = "setpoint", point = [3.5, 1.5] }"#;
        let mut live = Live::new(&scenario("position", reference, simulation, "dynamic")).unwrap();
        live.record(true).unwrap();
        live.carry(0, &[2.0, 2.0]).unwrap();
        live.tick();
        let count = allocations(|| {
            for k in 0..100 {
                let way = 0.01 * f64::from(k);
                live.carry(0, &[2.0 + way, 2.0 - way]).unwrap();
                live.aim(&[3.5 - way, 1.5]);
                (0..20).for_each(|_| live.tick());
            }
        });
        assert_eq!(count, 0, "{simulation}");
        assert_eq!(live.state(), &State::Running);
        assert!(live.take().unwrap().0.unwrap().rows > 100);
    }
}

/// Nor does a step in space, whatever the task, the reference, the shapes around the arm and its way of giving way.
#[test]
fn no_step_in_space_allocates() {
    const LINE: &str = "'line', relative = true, end = [0.0, 0.1, 0.1], duration = 0.3";
    const CIRCLE: &str = "'circle', relative = true, center = [0.0, 0.05, 0.0], radius = 0.05, angular_velocity = 2.0";
    // More of them near than are found at once.
    let points: Vec<_> =
        (0..400).map(|k| [0.01 * f64::from(k % 20), 0.0, 0.01 * f64::from(k / 20)]).collect();
    // Boxes and hulls on its links, too, which must not touch each other.
    const HULLS: &str = ", collision = [
        { link = 'panda_link1', shape = { kind = 'box', center = [0.0, 0.0, -0.1], size = [0.1, 0.1, 0.2] } },
        { link = 'panda_link3', shape = { kind = 'box', center = [0.0, 0.0, -0.1], size = [0.1, 0.1, 0.2] } },
        { link = 'panda_link5', shape = { kind = 'convex', vertices = [
            [0.0, 0.0, 0.0], [0.1, 0.0, -0.3], [0.0, 0.1, -0.3], [-0.1, -0.1, -0.3]] } },
        { link = 'panda_link7', shape = { kind = 'box', center = [0.0, 0.0, 0.1], size = [0.2, 0.1, 0.1] } } ]";
    for (task, reference, shapes, own) in [
        ("position", LINE, "", "ignore"),
        ("pointing", CIRCLE, "", "ignore"),
        ("pose", LINE, "", "ignore"),
        ("pose", LINE, HULLS, "avoid"),
    ] {
        let searching = ", preview = { self_motion = {} }";
        let ways = [("null_space", ""), ("cbf", ""), ("cbf", ", preview = {}"), ("cbf", searching)];
        // Only a pose leaves a curve to search.
        let ways = ways.into_iter().filter(|(_, preview)| task == "pose" || *preview != searching);
        for (avoidance, preview) in ways {
            let text = format!(
                "
                duration = 0.5
                q0 = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]
                arm = {{ model = 'panda'{shapes} }}
                reference = {{ kind = {reference} }}
                plant = {{ payload = {{ mass = 0.5 }} }}
                obstacles = [
                    {{ shape = {{ kind = 'sphere', radius = 0.08 }}, position = [-0.05, -0.3, 0.62],
                       motion = {{ kind = 'linear', velocity = [0.0, 0.2, 0.0] }}, margin = 0.08 }},
                    {{ shape = {{ kind = 'capsule', a = [0.0, 0.0, 0.0], b = [0.3, 0.0, 0.0], radius = 0.05 }},
                       position = [0.2, 0.35, 0.6] }},
                    {{ shape = {{ kind = 'box', size = [0.2, 0.2, 0.2] }}, position = [0.6, 0.3, 0.3] }},
                    {{ shape = {{ kind = 'convex', vertices = [[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.2]] }},
                       position = [0.5, -0.3, 0.4], angular_velocity = [0.0, 1.0, 2.0] }},
                    {{ shape = {{ kind = 'points', points = {points:?}, radius = 0.01 }}, position = [0.55, 0.25, 0.7],
                       margins = {{ panda_link7 = 0.03 }}, angular_velocity = [0.0, 0.0, 1.0] }},
                    {{ shape = {{ kind = 'half_space', normal = [0.0, 0.0, 1.0] }}, position = [0.0, 0.0, 0.0] }} ]
                controller = {{ task = '{task}', avoidance = '{avoidance}', self_collision = '{own}',
                    field = {{ kind = 'bounded', gain = 20.0, influence = 0.25 }},
                    yielding = {{ margin = 0.02{preview} }} }}
                simulation = {{ control = 'hold', integrator = 'semi_implicit_euler' }}"
            );
            let mut run = Scenario::from_toml(&text).unwrap().prepare().unwrap().run;
            let count = allocations(|| while run.step() {});
            assert_eq!(count, 0, "{task}, {avoidance}{preview}");
            let outcome = run.outcome();
            assert_ne!(outcome.status, Status::Diverged, "{}", outcome.message);
            assert!(outcome.record.force.iter().any(|force| *force > 0.0), "nothing pushed");
        }
    }
}

/// Nor does any operator of an arm in space, whatever the task.
#[test]
fn no_operator_of_a_spatial_arm_allocates() {
    let joints = (0..7)
        .map(|i| Joint {
            name: format!("joint {i}"),
            link: format!("link {i}"),
            kind: if i == 3 { JointKind::Prismatic } else { JointKind::Revolute },
            position: [0.1, 0.0, 0.3],
            orientation: [0.8, 0.6, 0.0, 0.0],
            axis: [0.0, 0.0, 1.0],
            mass: 2.0,
            com: [0.0, 0.05, 0.1],
            inertia: [0.02, 0.02, 0.01, 0.0, 0.001, 0.0],
            armature: 0.1,
            damping: 0.0,
            friction: 0.0,
        })
        .collect();
    let description = ArmDescription { joints, ..ArmDescription::default() };
    let mut state = Arc::new(description.build().unwrap()).state();
    fn on_the_task<const M: usize, R: Robot<3>>(state: &mut R, q: &[f64], v: &[f64]) -> usize {
        let mut y = vec![Vector::<M>::zeros(); q.len()];
        let (mut out, mut scratch) = (vec![0.0; q.len()], vec![0.0; q.len()]);
        allocations(|| {
            let lambda_inv = state.update_with_response::<M>(q, v, &mut y);
            assert!((state.task_response(&mut y) - lambda_inv).norm() < 1e-9 * lambda_inv.norm());
            let f = state.task_velocity::<M>() + state.task_bias_acceleration::<M>();
            let f = f + state.jacobian_mul::<M>(v) + state.jacobian_dot_mul::<M>(v);
            state.jacobian_tr_mul(&f, &mut out);
            state.jacobian_dot_tr_mul(&f, &mut out);
            state.momentum_and_coriolis(&f, &mut out, &mut scratch);
            state.coupling_torque(&f, v, &mut out);
        })
    }
    let (q, v) = ([0.3, -0.7, 0.2, 0.4, -0.5, 0.9, 0.1], [1.0, -0.2, 0.6, 0.3, -0.8, 0.5, -0.4]);
    assert_eq!(on_the_task::<3, _>(&mut state, &q, &v), 0);
    assert_eq!(on_the_task::<5, _>(&mut state, &q, &v), 0);
    assert_eq!(on_the_task::<6, _>(&mut state, &q, &v), 0);
    let (mut out, mut scratch) = ([0.0; 7], [0.0; 7]);
    let mut mobilities = [Mobility::default(); 7];
    let mut wrenches = [Spatial::default(); 7];
    let count = allocations(|| {
        state.update_positions(&q);
        state.update(&q, &v);
        state.update_with_dynamics(&q, &v, &v, &mut scratch, &mut out);
        state.mass_mul(&v, &mut out);
        state.mass_solve(&v, &mut out);
        state.coriolis_mul(&v, &mut out);
        state.coriolis_tr_mul(&v, &mut out);
        state.momentum_and_drift(&mut out, &mut scratch);
        state.gravity_torque(&mut out);
        state.bias_torque(&mut out);
        state.mobilities(&mut mobilities);
        let (point, force) = (state.position(), Vector::<3>::new(0.1, 0.2, 0.3));
        assert!(state.point_mobility(6, &point, &force) > 0.0);
        assert!(state.point_velocity(6, &point) != state.point_bias_acceleration(6, &point));
        state.add_force(&mut wrenches, 6, &point, &force);
        state.wrenches_tr_mul(&wrenches, &mut out);
        assert!(state.potential_energy() > 0.0);
    });
    assert_eq!(count, 0);
}

/// Points that take the place of others, be they one, several or none, and rest or move.
#[test]
fn no_exchange_of_points_allocates() {
    let upright = [1.0, 0.0, 0.0, 0.0];
    let points = |count| (0..count).map(|i| [f64::from(i), 0.0, 0.0]).collect::<Vec<_>>();
    for first in [0, 1, 2] {
        let cloud = space::Shape::Points { points: points(first), radius: 0.01 };
        let sphere = space::Shape::Sphere { radius: 0.1 };
        let mut world =
            space::World::new(vec![space::Obstacle::of(cloud), space::Obstacle::of(sphere)]);
        let sent = [(1, 0.5), (3, 0.0), (1, 0.0), (4, 0.5), (0, 0.0), (1, 0.5), (5, 0.5)];
        let mut made = sent.map(|(count, speed)| {
            let given = points(count);
            let velocities = vec![[0.0, speed, 0.0]; given.len()];
            space::Points::moving(given, &velocities, None, upright)
        });
        let count = allocations(|| {
            for (k, points) in made.iter_mut().enumerate() {
                world.place(1, world.time(), Vector::repeat(0.1), Vector::zeros());
                assert!(world.swap_points(0, points));
                world.update(0.1 * k as f64);
            }
        });
        assert_eq!(count, 0, "{first} points at first");
    }
}

/// The test can fail: the explicit form of the law, which is dense, does allocate.
#[test]
fn the_explicit_form_allocates() {
    let mut scenario =
        scenario("position", r#"{ kind = "setpoint", point = [4, 1] }"#, "dt = 1e-3", "dynamic");
    scenario.controller.formulation = vff_core::control::Formulation::ExtendedJacobian;
    let mut run = scenario.prepare().unwrap().run;
    assert!(allocations(|| _ = run.step()) > 0);
}
