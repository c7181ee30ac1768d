//! The scenes of an arm in space whose steps are timed one by one.

use crate::scene::{EULER, STEPS, looking};
use nalgebra::Matrix3;
use std::fmt::Write as _;
use vff_core::control::{Avoidance, SelfCollision};
use vff_core::geometry::{Shape, perpendicular};
use vff_core::math::{Capsule, UnitQuaternion};
use vff_core::robot::description::PlacedShape;
use vff_core::robot::models;
use vff_core::scenario::{AnyScene, Scenario};
use vff_core::world::Motion;

/// A Panda that holds the pose of its hand under gravity, and so has one joint to spare, among `balls` that swing about
/// its links; the first of them at most 4 cm from its elbow.
pub fn scene(balls: usize) -> Scenario {
    let mut text = format!(
        "duration = {duration}\n\
         q0 = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]\n\
         arm = {{ model = 'panda' }}\n\
         reference = {{ kind = 'setpoint' }}\n\
         controller = {{ task = 'pose', stiffness = 900, damping = 60, null_damping = 6, \
                         field = {{ kind = 'bounded', gain = 20, influence = 0.3 }} }}\n\
         simulation = {{ dt = 1e-3, {EULER} }}\n",
        duration = STEPS as f64 * 1e-3,
    );
    let places = [
        [-0.05, -0.25, 0.62],
        [0.30, 0.30, 0.75],
        [-0.30, 0.05, 0.45],
        [0.35, -0.30, 0.55],
        [0.60, 0.05, 0.70],
        [0.10, 0.35, 0.40],
        [0.25, 0.05, 1.05],
        [0.65, -0.20, 0.35],
    ];
    for (j, [x, y, z]) in places.into_iter().take(balls).enumerate() {
        let _ = write!(
            text,
            "[[obstacles]]\n\
             shape = {{ kind = 'sphere', radius = 0.08 }}\n\
             position = [{x}, {y}, {z}]\n\
             motion = {{ kind = 'sinusoid', amplitude = [0.03, 0.05, 0.0], angular_frequency = 2.0, phase = {j} }}\n"
        );
    }
    Scenario::from_toml(&text).expect("a scene that can be run")
}

/// The same under `cbf`, where every pair is a row.
pub fn barriers(balls: usize) -> Scenario {
    let mut scenario = scene(balls);
    scenario.controller.avoidance = Avoidance::Cbf;
    scenario.controller.yielding.activation = Some(100.0);
    scenario
}

/// The same under `cbf` with its own settings, looking ahead.
pub fn preview(balls: usize) -> Scenario {
    looking(scene(balls))
}

/// The same with a box in place of every capsule of the arm: as long, and 1.4 radii wide.
pub fn of_boxes(mut scenario: Scenario) -> Scenario {
    let AnyScene::Space(scene) = &mut scenario.scene else { unreachable!("an arm in space") };
    let mut parts = models::named("panda").expect("it is bundled").collision;
    for part in &mut parts {
        if let Shape::Capsule { a, b, radius } = part.shape.shape {
            let axis = Capsule::<3>::new(a.into(), b.into(), radius);
            let z = axis.direction;
            let x = perpendicular(&z);
            let turn = Matrix3::from_columns(&[x, z.cross(&x), z]);
            let width = 1.4 * radius;
            part.shape = PlacedShape {
                shape: Shape::Box { size: [width, width, axis.length + width] },
                center: Some((axis.start + z * (0.5 * axis.length)).into()),
                orientation: Some(UnitQuaternion::from_matrix(&turn).to_array()),
            };
        }
    }
    scene.arm.collision = Some(parts);
    scenario
}

/// The same where bodies of the arm must not touch each other.
pub fn apart(mut scenario: Scenario) -> Scenario {
    scenario.controller.self_collision = SelfCollision::Avoid;
    scenario
}

/// And searching all the time: one more ball is at the base, where no candidate avoids it.
pub fn searching(balls: usize) -> Scenario {
    let mut scenario = preview(balls);
    let AnyScene::Space(scene) = &mut scenario.scene else { unreachable!("an arm in space") };
    let last = scene.obstacles.last_mut().expect("a ball");
    (last.position, last.motion) = ([0.0, 0.0, 0.1], Motion::default());
    scenario
}
