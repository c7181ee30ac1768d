//! What is promised of plans that are watched over, moment by moment.

use super::*;
use crate::math::Vector;
use crate::simulation::Plane;
use crate::trajectory::{JointSpline, Pace};
use crate::world::plane::World as PlanarWorld;

fn progress(q: &[f64], error: f64, t: f64, progress: &mut Progress) -> Option<Reason> {
    let joints = JointSpline::new(&[0.0, 10.0], &[vec![0.0, 0.0], vec![1.0, -1.0]]).unwrap();
    let mut state = [0; 3].map(|_| vec![0.0; 2]);
    joints.at(t, state.each_mut().map(Vec::as_mut_slice));
    let [planned, ..] = &state;
    let settings = ReplanSettings::default();
    let place = Place {
        is_off: error > settings.tolerance,
        from_plan: farthest(&[false; 2], q, planned.iter()),
        left: farthest(&[false; 2], joints.last(), q.iter()),
    };
    progress.look(t, place, &settings)
}

/// An error of orientation counts as the way of a point 0.4 m away.
#[test]
fn orientations_count() {
    let turned = Vector::<6>::new(0.0, 0.01, 0.0, 0.0, 0.3, 0.4);
    assert!((size::<3, 6>(&turned) - 0.2).abs() < 1e-15);
    assert!((size::<3, 3>(&Vector::<3>::new(0.0, 3.0, 4.0)) - 5.0).abs() < 1e-15);
    assert!((size::<2, 3>(&Vector::<3>::new(0.0, 0.0, -2.0)) - 0.8).abs() < 1e-15);
}

/// Stuck is who is off the reference and comes no nearer to the end for as long as patience lasts: counted once, until it
/// goes on.
#[test]
fn stuck_is_who_comes_no_nearer() {
    let mut watched = Progress::default();
    let mut told = vec![];
    for k in 0..100 {
        let t = 0.1 * f64::from(k);
        // On the plan, in a corner from 2 to 5 s, and on again.
        let (q, error) = match t {
            _ if t < 2.0 => ([0.1 * t, -0.1 * t], 0.0),
            _ if t < 5.0 => ([0.2, -0.2], 0.3),
            _ => ([0.2 + 0.15 * (t - 5.0), -0.2 - 0.15 * (t - 5.0)], 0.3),
        };
        told.extend(progress(&q, error, t, &mut watched).map(|reason| (reason, k)));
    }
    let stuck: Vec<_> = told.iter().filter(|(reason, _)| *reason == Reason::Stuck).collect();
    assert_eq!(stuck.len(), 3, "{told:?}");
    assert!((29..=30).contains(&stuck[0].1), "{told:?}");
    assert_eq!(watched.times_stuck, 1);
}

/// Strayed is whose joints and end effector are off the plan for as long as patience lasts.
#[test]
fn strayed_is_who_is_off_the_plan() {
    let [mut watched, mut on_its_way] = [Progress::default(), Progress::default()];
    let told: Vec<_> = (0..100)
        .filter_map(|k| {
            let t = 0.1 * f64::from(k);
            let q = if t < 3.0 { [0.0, 0.6] } else { [1.0, -1.0] };
            assert_eq!(progress(&q, 0.0, t, &mut on_its_way), None);
            // It comes nearer all the time.
            progress(&[0.1 * t - 1.0, 1.0 - 0.1 * t], 0.1, t, &mut watched)
                .map(|reason| (reason, k))
        })
        .collect();
    assert_eq!(told[0], (Reason::Strayed, 10));
    assert!(told.iter().all(|(reason, _)| *reason == Reason::Strayed), "{told:?}");
}

/// What moves is looked for where it will be when the arm comes by, and no farther ahead than the horizon.
#[test]
fn what_moves_is_foreseen() {
    use crate::world::Motion;
    use crate::world::plane::{Obstacle, Shape};
    let plain = Scenario::from_toml(
        r#"
        duration = 8.0
        q0 = [0.2, 0.3, 0.3, 0.3]
        arm = { lengths = [1, 1, 1, 1], masses = 1.0, radius = 0.05 }
        reference = { kind = "plan", times = [0.0, 2.0, 4.0], points = [[0.2, 0.3, 0.3, 0.3], [1.0, 0.3, 0.3, 0.3], [1.8, 0.3, 0.3, 0.3]] }
        "#,
    )
    .unwrap();
    let crate::scenario::AnyScene::Plane(scene) = &plain.scene else { unreachable!() };
    let (closed_loop, _) = plain.closed_loop::<Plane, 2, 2>(scene).unwrap();
    let reference = closed_loop.reference();
    let plan = reference.joints().unwrap();
    let disc = |position: Vector<2>, velocity: Vector<2>| Obstacle {
        position: position.into(),
        motion: Motion::Linear { velocity: velocity.into() },
        ..Obstacle::of(Shape::Circle { radius: 0.2 })
    };
    let mut state = closed_loop.arm().state();
    let mut q = [0; 3].map(|_| vec![0.0; 4]);
    plan.at(0.6, q.each_mut().map(Vec::as_mut_slice));
    state.update_positions(&q[0]);
    let tip: Vector<2> = Manipulator::<2, 2>::pose(&state);
    let velocity = Vector::<2>::new(0.0, -2.0);
    // One that meets the tip after 0.6 s, one that is there now.
    let world = |since: f64| PlanarWorld::new(vec![disc(tip - velocity * since, velocity)]);
    let least = |world: &PlanarWorld, horizon: f64| {
        let settings = ReplanSettings { horizon, ..ReplanSettings::default() };
        let law = crate::control::Settings::default();
        let mut ahead = Ahead::<Plane, 2, 2>::new(closed_loop.arm().state(), world);
        let look = |k: u32| {
            let t = 1e-3 * f64::from(k);
            let (q, error) = (&[0.2, 0.3, 0.3, 0.3], &Vector::zeros());
            let moment = Moment {
                t,
                since: t,
                pace: Pace::of_time(t),
                q,
                posture: &[],
                error,
                reference,
                world,
                law: &law,
            };
            ahead.look(&moment, &settings, 0.0)
        };
        (0..110).map(look).fold(f64::INFINITY, f64::min)
    };
    assert!(least(&world(0.6), 1.0) < 0.0);
    assert!(least(&world(0.6), 0.3) > 0.1);
    assert!(least(&world(-1.5), 1.0) > 0.1);
}
