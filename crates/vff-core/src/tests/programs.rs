//! The quadratic programs of `cbf` in runs of scenarios.

use crate::control::{Avoidance, Controller, Gains, Output};
use crate::math::{ScalarOrVec, Vector};
use crate::robot::{Manipulator, Model, PlanarState, Robot};
use crate::scenario::Scenario;
use crate::simulation::Control;
use crate::trajectory::Trajectory;
use crate::world::plane::World;
use std::sync::Arc;

/// The controller of a scenario, with its world and its reference.
fn loop_of(
    scenario: &Scenario,
) -> (Controller<PlanarState, 2, 2>, World, Trajectory<Vector<2>, 2>) {
    let scene = scenario.scene.plane().unwrap();
    let arm = Arc::new(scene.arm.build().unwrap());
    let mut start = arm.state();
    start.update(&scenario.q0, &vec![0.0; arm.dof()]);
    let trajectory = Trajectory::new(&scene.reference, &Manipulator::<2, 2>::pose(&start)).unwrap();
    let controller = Controller::new(arm.state(), Gains::new(&scenario.controller));
    (controller, World::new(scene.obstacles.clone()), trajectory)
}

/// The QPs of a run, also of one whose torque limits act, or the limits of their rate, have the solutions that Clarabel
/// finds.
#[test]
fn the_qps_of_a_run_agree_with_clarabel() {
    let text = include_str!("../../tests/scenarios/on-path.toml");
    for (torque, rate) in [(None, None), (Some(40.0), None), (None, Some(300.0))] {
        let mut scenario = Scenario::from_toml(text).unwrap();
        scenario.controller.avoidance = Avoidance::Cbf;
        scenario.simulation.control = Control::Hold;
        let [torque, rate] = [torque, rate].map(|limit| limit.map(ScalarOrVec::Uniform));
        scenario.scene.plane_mut().unwrap().arm.torque_limits.clone_from(&torque);
        scenario.controller.command.torque_rate.clone_from(&rate);
        let (mut controller, mut world, trajectory) = loop_of(&scenario);
        let mut output = Output::new(&scenario.controller.command, scenario.q0.len());
        let mut sent: Option<Vec<f64>> = None;
        let mut run = scenario.prepare().unwrap().run;
        let (mut solved, mut at_limit) = (0, 0);
        while run.step() {
            let s = run.snapshot();
            world.update(s.t);
            controller.observe(s.q, s.dq, &mut world);
            if let Some(sent) = &sent {
                controller.expect(&mut output, sent, 1e-3);
            }
            controller.command(&trajectory.at(s.t));
            sent = Some(s.torque.total.clone());
            let barrier = controller.barrier().expect("the scenario says cbf");
            let Some(found) = barrier.solution() else { continue };
            solved += 1;
            at_limit += usize::from(barrier.is_active_from(18));
            if solved % 5 == 0 {
                let expected = barrier.solution_by_clarabel();
                let scale = expected.iter().fold(1.0, |m: f64, y| m.max(y.abs()));
                for (y, expected) in found.iter().zip(&expected) {
                    assert!((y - expected).abs() < 1e-6 * scale, "{found:?} {expected:?}");
                }
            }
        }
        assert!(solved > 500, "{solved}");
        let often = if rate.is_some() { 10 } else { 50 }; // demands are shaped for the rate
        assert_eq!(at_limit > often, torque.or(rate).is_some(), "{at_limit}");
    }
}

/// A link held flat above a box, a capsule and a polygon, pushed down by its task, rocks through
/// parallel: in steps of 1e-5 rad the torque never changes by more than 0.05 N·m, and it pushes back.
#[test]
fn a_link_rocks_on_a_flat_side_without_a_jump() {
    let shapes = [
        r#"{ kind = "box", size = [0.6, 0.2] }"#,
        r#"{ kind = "capsule", a = [-0.3, 0], b = [0.3, 0], radius = 0.1 }"#,
        r#"{ kind = "polygon", vertices = [[-0.3, -0.2], [0.3, -0.2], [0.3, 0.1], [-0.3, 0.1]] }"#,
    ];
    for shape in shapes {
        let text = format!(
            r#"
            duration = 1.0
            q0 = [1.2, -1.2, 0.0]
            arm = {{ lengths = [1, 1, 1], masses = 1, radius = 0.05 }}
            reference = {{ kind = "setpoint", point = [2.3, 0.5] }}
            controller.avoidance = "cbf"
            controller.yielding = {{ margin = 0.03, rate = 20, task_weight = 5 }}
            [[obstacles]]
            shape = {shape}
            position = [1.86, 0.74]
            "#
        );
        let scenario = Scenario::from_toml(&text).unwrap();
        let (mut controller, mut world, trajectory) = loop_of(&scenario);
        let mut last: Option<Vec<f64>> = None;
        let (mut largest, mut pushed): (f64, usize) = (0.0, 0);
        for k in -1000..=1000 {
            let q = [1.2, -1.2 + 1e-5 * f64::from(k), 0.0];
            controller.observe(&q, &[0.0, -0.2, 0.0], &mut world);
            let torque = controller.command(&trajectory.at(0.0)).total.clone();
            pushed += usize::from(controller.slack().unwrap() > 0.0);
            if let Some(last) = last {
                let change = last.iter().zip(&torque).map(|(a, b)| (a - b).abs());
                largest = change.fold(largest, f64::max);
            }
            last = Some(torque);
        }
        assert!(largest < 0.05, "{shape}: {largest}");
        assert_eq!(pushed, 2001, "{shape}");
    }
}
