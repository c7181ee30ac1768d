//! Arms in space, from the document to the end of the run.

use std::fmt::Write as _;
use vff_core::runtime::points::make;
use vff_core::runtime::{AnyArm, AnyController, AnyObstacles, PointsError, Target};
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

/// Points on a sheet that sweeps along beside the arm, and a few far away.
fn sheet() -> Vec<[f64; 3]> {
    let near = (0..24)
        .map(|k| [0.02 * f64::from(k % 6), 0.013 * f64::from(k / 6), 0.05 * f64::from(k % 3)]);
    near.chain((0..40).map(|k| [3.0 + 0.1 * f64::from(k), 1.0, 0.2])).collect()
}

/// A run among a cloud is that among spheres at its points, to the last bit: the arm, the torque, the clearance and every
/// metric, however it gives way without a field, whose push is joined (T192).
#[test]
fn a_cloud_is_its_spheres() {
    const MOVED: &str = "motion = { kind = 'linear', velocity = [0.0, 0.3, 0.0] }";
    const STILL: &str = "motion = { kind = 'static' }"; // where it will be is not rounded
    let controllers = [
        "avoidance = 'priority'",
        "avoidance = 'cbf'",
        "avoidance = 'cbf', yielding = { preview = { trigger = 0.6 } }",
    ];
    for (avoidance, controller) in controllers.into_iter().enumerate() {
        // What stands is within the margin.
        let shift = [-0.1, if avoidance == 2 { -0.14 } else { -0.2 }, 0.55];
        let points: Vec<_> =
            sheet().into_iter().map(|p| [0, 1, 2].map(|i| p[i] + shift[i])).collect();
        for control in ["hold", "predictor", "continuous"] {
            let looks_ahead = avoidance == 2;
            if control == "continuous" && looks_ahead {
                continue;
            }
            let motion = if looks_ahead { STILL } else { MOVED };
            let text = format!(
                "duration = 0.3\n\
                 q0 = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]\n\
                 arm = {{ model = 'panda' }}\n\
                 reference = {{ kind = 'setpoint' }}\n\
                 controller = {{ stiffness = 400.0, damping = 40.0, {} }}\n\
                 simulation = {{ control = '{control}', dt = 2e-3 }}\n",
                controller.replace('\n', " ")
            );
            let cloud = format!(
                "{text}[[obstacles]]\n{motion}\n\
                 shape = {{ kind = 'points', points = {points:?}, radius = 0.015 }}\n"
            );
            let mut spheres = text.clone();
            for point in &points {
                let _ = write!(
                    spheres,
                    "[[obstacles]]\n{motion}\nposition = {point:?}\n\
                     shape = {{ kind = 'sphere', radius = 0.015 }}\n"
                );
            }
            let [one, many] = [run(&cloud), run(&spheres)];
            let alone = run(&text);
            assert_ne!(one.record.q, alone.record.q, "nothing gives way: {controller}, {control}");
            assert_eq!(one.status, many.status);
            assert_eq!(one.record.q, many.record.q, "{controller}, {control}");
            assert_eq!(one.record.tau, many.record.tau);
            assert_eq!(one.record.force, many.record.force);
            assert_eq!(one.record.clearance, many.record.clearance);
            assert_eq!(format!("{:?}", one.metrics), format!("{:?}", many.metrics));
        }
    }
}

fn panda(settings: &str) -> (AnyArm, AnyController) {
    let arm = AnyArm::read(&"model = 'panda'".parse().unwrap()).unwrap();
    let controller = AnyController::new(&arm, &settings.parse().unwrap()).unwrap();
    (arm, controller)
}

fn around(arm: &AnyArm, points: &[[f64; 3]]) -> AnyObstacles {
    let mut obstacles = arm.no_obstacles();
    let ball = "shape = { kind = 'sphere', radius = 0.05 }\nposition = [0.6, 0.0, 0.2]";
    let cloud = format!(
        "shape = {{ kind = 'points', points = {points:?}, radius = 0.02 }}\n\
         position = [0.1, -0.3, 0.6]\norientation = [0.8, 0.6, 0.0, 0.0]\nangular_velocity = [0.3, 0.0, 1.0]"
    );
    for text in [ball, &cloud] {
        obstacles.read(&text.parse().unwrap()).unwrap();
    }
    obstacles
}

/// A controller whose points are replaced while it runs gives the torque of a new one with those points, to the last bit;
/// what is refused changes nothing.
#[test]
fn replaced_points_are_those_of_a_new_controller() {
    let q = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8];
    let dq = [0.1, 0.0, -0.2, 0.1, 0.0, 0.3, 0.0];
    let target = Target { x: &[0.4, 0.0, 0.5], dx: &[0.0; 3], ddx: &[0.0; 3] };
    for settings in [
        "field = { kind = 'bounded', gain = 20.0, influence = 0.3 }",
        "field = { kind = 'bounded', gain = 20.0, influence = 0.3 }\navoidance = 'cbf'",
    ] {
        let (arm, mut controller) = panda(settings);
        controller.surround(around(&arm, &sheet())).unwrap();
        let first = controller.torque(&q, &dq, &target, 0.0).unwrap().to_vec();
        for k in 0..5 {
            let t = 0.1 * f64::from(k);
            let new: Vec<_> =
                sheet().into_iter().skip(7 * k as usize).map(|[x, y, z]| [y, x, z - t]).collect();
            let orientation = controller.orientation_of_points(1).unwrap();
            let mut points = make(new.clone().into(), orientation).unwrap();
            controller.swap_points(1, &mut points).unwrap();
            let found = controller.torque(&q, &dq, &target, t).unwrap().to_vec();
            let (arm, mut fresh) = panda(settings);
            fresh.surround(around(&arm, &new)).unwrap();
            let expected = fresh.torque(&q, &dq, &target, t).unwrap();
            assert_eq!(found, expected);
            assert_ne!(found, first);
            // Refused: other obstacles, too many, made for another orientation.
            let fault = |error: PointsError| error.to_string();
            assert!(
                fault(controller.orientation_of_points(0).unwrap_err()).contains("not a cloud")
            );
            assert!(
                fault(controller.orientation_of_points(2).unwrap_err()).contains("there are 2")
            );
            assert!(
                fault(make(vec![[0.0; 3]; 50_001].into(), orientation).unwrap_err())
                    .contains("50001")
            );
            let mut others = make(vec![].into(), [1.0, 0.0, 0.0, 0.0]).unwrap();
            assert_eq!(controller.swap_points(1, &mut others), Err(PointsError::NotACloud(1)));
            assert_eq!(controller.torque(&q, &dq, &target, t).unwrap(), found);
        }
    }
    let arm = AnyArm::read(&"lengths = [1, 1, 1]\nmasses = 1".parse().unwrap()).unwrap();
    let mut planar = AnyController::new(&arm, &Default::default()).unwrap();
    assert_eq!(planar.orientation_of_points(0), Err(PointsError::InThePlane));
}

/// In a run the points of the scenario are replaced likewise, in every mode of control.
#[test]
fn replaced_points_of_a_run_are_those_of_another() {
    for control in ["hold", "predictor", "continuous"] {
        let text = |points: &[[f64; 3]]| {
            PANDA.replace("'continuous'", &format!("'{control}'")).replace(
                "kind = 'sphere', radius = 0.08",
                &format!("kind = 'points', points = {points:?}, radius = 0.02"),
            )
        };
        let new: Vec<_> = sheet().into_iter().map(|[x, y, z]| [x, z, y]).collect();
        let [mut run, mut other] = [&sheet(), &new].map(|points| {
            let scenario = Scenario::from_toml(&text(points)).unwrap();
            (scenario.prepare_recorded(false).unwrap().run, scenario.controller)
        });
        let orientation = run.0.orientation_of_points(0).unwrap();
        let points = make(new.into(), orientation).unwrap();
        run.0.update_points(0, &points, &run.1).unwrap();
        for _ in 0..50 {
            assert!(run.0.advance(None) && other.0.advance(None));
        }
        let [run, other] = [run.0.snapshot(), other.0.snapshot()];
        assert_eq!((run.q, run.clearance), (other.q, other.clearance), "{control}");
        assert_eq!(run.torque.total, other.torque.total);
    }
}

/// What is wrong with a cloud is said with its path.
#[test]
fn unusable_clouds_are_refused() {
    let many = format!("kind = 'points', points = {:?}, radius = 0.01", vec![[0.0; 3]; 50_001]);
    for (shape, path, sentence) in [
        (
            "kind = 'points', points = [[0, 0, 0], [0, 0]], radius = 0.1",
            "shape.points[1]",
            "expected 3 values, got 2",
        ),
        (
            "kind = 'points', points = [[0, 0, nan]], radius = 0.1",
            "shape.points[0][2]",
            "a finite number",
        ),
        ("kind = 'points', points = [[0, 0, 0]], radius = -0.1", "shape.radius", "0 or more"),
        ("kind = 'points', points = [[0, 0, 0]]", "shape", "missing key `radius`"),
        (&many, "shape.points", "at most 50000 of them, got 50001"),
    ] {
        let error = refused("kind = 'sphere', radius = 0.08", shape);
        assert_eq!(error.path, format!("obstacles[0].{path}"));
        assert!(error.to_string().contains(sentence), "{error}");
    }
    let empty = PANDA
        .replace("kind = 'sphere', radius = 0.08", "kind = 'points', points = [], radius = 0.0");
    assert_eq!(run(&empty).status, Status::Completed);
    let plane = "duration = 1\nq0 = [0.1, 0.2]\narm = { lengths = [1, 1], masses = 1 }\n\
                 reference = { kind = 'setpoint', point = [1, 1] }\n[[obstacles]]\nposition = [0, 0]\n\
                 shape = { kind = 'points', points = [], radius = 0.1 }";
    let error = Scenario::from_toml(plane).unwrap_err().to_string();
    assert!(error.contains("that is a shape of obstacles in space"), "{error}");
}
