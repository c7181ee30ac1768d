//! Arms in space, from the document to the end of the run.

use vff_core::scenario::{Scenario, ScenarioError};
use vff_core::simulation::{Outcome, Status};

const PANDA: &str = "
    duration = 1.5
    q0 = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]
    arm = { model = 'panda' }
    reference = { kind = 'setpoint' }
    obstacles = [{ shape = { kind = 'sphere', radius = 0.08 }, position = [-0.05, -0.3, 0.62],
                   motion = { kind = 'linear', velocity = [0.0, 0.2, 0.0] } }]
    controller = { task = 'pose', stiffness = 400.0, damping = 40.0,
                   field = { kind = 'bounded', gain = 80.0, influence = 0.25 } }
    simulation = { control = 'continuous' }";

fn run(text: &str) -> Outcome {
    let mut run = Scenario::from_toml(text).unwrap().prepare().unwrap().run;
    while run.step() {}
    run.outcome()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().map(|x| x.abs()).fold(0.0, f64::max)
}

fn refused(from: &str, to: &str) -> ScenarioError {
    let text = PANDA.replace(from, to);
    assert_ne!(text, PANDA, "{from} is not there");
    let scenario = Scenario::from_toml(&text);
    scenario.and_then(|scenario| scenario.prepare().map(drop)).unwrap_err()
}

/// The elbow gives way, by a turn of the first joint that is to be seen, and the hand keeps its pose to the error of the
/// integrator (continuous law, RK4 at 1 ms): for every task.
#[test]
fn the_hand_stays_while_the_elbow_gives_way() {
    for task in ["position", "pointing", "pose"] {
        let outcome = run(&PANDA.replace("'pose'", &format!("'{task}'")));
        assert_eq!(outcome.status, Status::Completed, "{task}");
        let record = outcome.record;
        assert!(largest(&record.error) < 1e-10, "{task}: {}", largest(&record.error));
        let n = record.sizes.joints;
        let moved = record.q.chunks(n).map(|q| (q[0] - record.q[0]).abs()).fold(0.0, f64::max);
        assert!(moved > 0.05, "{task}: {moved}");
        assert_eq!(record.orientation.is_empty(), task == "position");
        assert_eq!(record.obstacles.len(), 3 * record.rows);
    }
}

/// Without the field the ball hits the elbow in the same scene, which shows that the field is what clears it.
#[test]
fn without_the_field_it_is_hit() {
    let still = run(&PANDA.replace("gain = 80.0", "gain = 0.0"));
    assert_eq!(still.status, Status::Collided);
}

/// A turn of base, gravity and obstacles together changes no angle of any joint, nor does a displacement.
#[test]
fn a_turned_world_is_the_same_world() {
    let here = run(PANDA).record;
    // A quarter of a turn about x: y becomes z, z becomes −y.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let there = PANDA
        .replace(
            "model = 'panda'",
            &format!(
                "model = 'panda', gravity = [0.0, 9.81, 0.0], mount = {{ position = [1.0, 2.0, 3.0], \
                 orientation = [{half}, {half}, 0.0, 0.0] }}"
            ),
        )
        .replace("position = [-0.05, -0.3, 0.62]", "position = [0.95, 1.38, 2.7]")
        .replace("velocity = [0.0, 0.2, 0.0]", "velocity = [0.0, 0.0, 0.2]");
    let there = run(&there).record;
    let apart = here.q.iter().zip(&there.q).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 1e-9, "{apart}");
}

/// A payload that the controller does not know of pulls the hand down by Λ⁻¹F/K: four times the stiffness leaves a
/// quarter of it, as far as Λ stays the same.
#[test]
fn the_plant_may_carry_more_than_the_model() {
    let sag = |stiffness: f64| {
        let text = PANDA
            .replace("'continuous'", "'hold'")
            .replace("gain = 80.0", "gain = 0.0")
            .replace("velocity = [0.0, 0.2, 0.0]", "velocity = [0.0, -0.2, 0.0]")
            .replace(
                "stiffness = 400.0, damping = 40.0",
                &format!("stiffness = {stiffness}, damping = {}", 2.0 * stiffness.sqrt()),
            );
        let load =
            "[plant]\npayload = { mass = 0.2, com = [0.0, 0.0, 0.02] }\nviscous_friction = 1.0\n";
        let record = run(&format!("{text}\n{load}")).record;
        largest(&record.error[record.error.len() - 6..])
    };
    let [soft, stiff] = [400.0, 1600.0].map(sag);
    assert!(soft > 1e-3 && (3.4..4.6).contains(&(soft / stiff)), "{soft} {stiff}");
}

#[test]
fn faults_are_named_with_their_place() {
    for (from, to, expected) in [
        ("'panda'", "'pandas'", "arm.model: there is no bundled arm `pandas`"),
        ("'pose'", "'poses'", "controller.task: unknown value `poses`"),
        ("[-0.05, -0.3, 0.62]", "[-0.05, 0.62]", "obstacles[0].position: expected 3 values, got 2"),
        (
            "'sphere', radius = 0.08",
            "'circle', radius = 0.08",
            "obstacles[0].shape.kind: unknown value `circle`",
        ),
        ("radius = 0.08", "radius = -0.08", "obstacles[0].shape.radius: must be greater than 0"),
        (
            "'setpoint'",
            "'setpoint', point = [2.0, 0.0, 0.5]",
            "reference: cannot be reached from t = 0.0000 s",
        ),
        ("'setpoint'", "'setpoint', orientation = [1.0, 1.0, 0.0, 0.0]", "reference.orientation: "),
        ("model = 'panda'", "model = 'panda', mass = 3.0", "arm: unknown key `mass`"),
        ("model = 'panda'", "urdf = 'a.urdf'", "arm.urdf: has to be read before"),
        ("model = 'panda'", "model = 'panda', joints = []", "arm.joints: a bundled arm has joints"),
        ("0.7854]", "0.7854, 1.0]", "q0: expected 7 values, got 8"),
        (
            "stiffness = 400.0",
            "stiffness = [1.0, 1.0]",
            "controller.stiffness: expected 6 values, got 2",
        ),
    ] {
        let text = refused(from, to).to_string();
        assert!(text.starts_with(expected), "{text}\nis not\n{expected}");
    }
}

/// How far the arm stays away where it is farthest: a Panda reaches 0.9 m or so, the point moves off to 2 m. The angle
/// is told where the task has one.
#[test]
fn out_of_reach_is_told_in_metres() {
    let line = "'line', start = [0.4, 0.0, 0.5], end = [2.0, 0.0, 0.5], duration = 0.1";
    for (task, rad) in [("'position'", false), ("'pose'", true)] {
        let text = PANDA.replace("'setpoint'", line).replace("'pose'", task);
        let text = Scenario::from_toml(&text).unwrap().prepare().unwrap_err().to_string();
        let (_, far) = text.split_once("stays as far as ").expect("a distance");
        let far: f64 = far.split_once(" m").unwrap().0.parse().unwrap();
        assert!((1.0..1.3).contains(&far), "{text}");
        assert_eq!(text.contains("rad"), rad, "{text}");
    }
}

/// A task of the other space is refused by name.
#[test]
fn pointing_needs_space() {
    let text = "
        duration = 1.0
        q0 = [0.5, 0.5, 0.5]
        arm = { lengths = [1, 1, 1], masses = 1 }
        reference = { kind = 'setpoint', point = [1.5, 1.5] }
        controller = { task = 'pointing' }";
    let error = Scenario::from_toml(text).unwrap_err().to_string();
    assert!(error.starts_with("controller.task: needs an arm in space"), "{error}");
}
