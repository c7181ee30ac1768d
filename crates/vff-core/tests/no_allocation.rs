//! The closed loop does not allocate: a counting allocator watches every step.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use vff_core::control::Avoidance;
use vff_core::scenario::Scenario;
use vff_core::simulation::Status;

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

/// An arm among every kind of obstacle, some of them moving through it, axis and all.
fn scenario(task: &str, reference: &str, simulation: &str, projection: &str) -> Scenario {
    let text = format!(
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
        field = {{ kind = "bounded", gain = 5, influence = 0.8, approach_damping = 0.3 }}

        [[obstacles]]
        shape = {{ kind = "circle", radius = 0.2 }}
        position = [1.5, 2.0]
        motion = {{ kind = "sinusoid", amplitude = [0, -0.8], angular_frequency = 2 }}

        [[obstacles]]
        shape = {{ kind = "box", size = [0.4, 0.2] }}
        position = [3.0, 2.2]
        angle = 0.4
        motion = {{ kind = "linear", velocity = [0, -0.7] }}

        [[obstacles]]
        shape = {{ kind = "polygon", vertices = [[0, 0], [0.3, 0], [0.1, 0.3]] }}
        position = [4.0, -1.0]
        motion = {{ kind = "waypoints", times = [0, 1, 2], points = [[4, -1], [3.5, 1.5], [2, 2]] }}

        [[obstacles]]
        shape = {{ kind = "capsule", a = [0, 0], b = [0.5, 0.5], radius = 0.1 }}
        position = [0.5, 1.5]
        "#
    );
    Scenario::from_toml(&text).unwrap()
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
    let loops = [
        r#"control = "hold", control_every = 3, record_every = 2"#,
        r#"control = "predictor""#,
        r#"control = "continuous""#,
        r#"control = "hold", integrator = "semi_implicit_euler""#,
    ];
    for (task, reference) in [position, pose, table] {
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

/// Nor does one in which the end effector gives way, programme included.
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

/// The test can fail: the explicit form of the law, which is dense, does allocate.
#[test]
fn the_explicit_form_allocates() {
    let mut scenario =
        scenario("position", r#"{ kind = "setpoint", point = [4, 1] }"#, "dt = 1e-3", "dynamic");
    scenario.controller.formulation = vff_core::control::Formulation::ExtendedJacobian;
    let mut run = scenario.prepare().unwrap().run;
    assert!(allocations(|| _ = run.step()) > 0);
}
