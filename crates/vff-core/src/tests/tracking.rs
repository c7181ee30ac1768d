//! Moving references under the law: the error moves as if the reference stood still (T104, T105).

use super::law_in_space::Nothing;
use crate::control::{Controller, Gains, Settings};
use crate::math::rotation::OrientationError;
use crate::math::{Pointing, ScalarOrVec, SpatialPose, UnitQuaternion, Vector};
use crate::robot::spatial::cases::panda_like;
use crate::robot::{Manipulator, Robot};
use crate::robot::{SpatialArm, SpatialState};
use crate::trajectory::{Guided, Sample, SpatialReference, Trajectory};
use std::sync::Arc;

const STEP: f64 = 1e-3;
/// K and D of a task by default: two poles at −4/s.
const GAINS: [f64; 2] = [16.0, 8.0];
const Q0: [f64; 7] = [0.3, -0.6, 0.2, -2.0, 0.4, 1.7, 0.5];

/// From rest at the start pose, through turns about several axes, while the position moves.
fn reference() -> SpatialReference {
    let turn = |x, y, z| UnitQuaternion::exp(&Vector::<3>::new(x, y, z)).to_array();
    SpatialReference::Waypoints {
        times: vec![0.0, 0.5, 1.0, 1.4],
        points: vec![[0.0; 3], [0.05, 0.1, -0.05], [0.1, 0.0, 0.1], [0.0, -0.1, 0.0]],
        orientations: Some(vec![
            turn(0.0, 0.0, 0.0),
            turn(0.3, -0.2, 0.4),
            turn(0.1, 0.5, -0.2),
            turn(-0.3, 0.2, 0.3),
        ]),
        relative: true,
    }
}

/// The arm under the law from rest at `Q0` (Runge and Kutta's fourth-order steps): its state every 0.1 s.
fn run<P, const M: usize>(
    arm: &Arc<SpatialArm>,
    reference: impl Fn(f64, &SpatialState) -> Sample<P, M>,
) -> Vec<(f64, SpatialState)>
where
    P: Guided<M>,
    SpatialState: Manipulator<3, M, Pose = P>,
{
    // Something moves the null space, and the tool about its free axis.
    let settings = Settings {
        posture: Some(vec![-0.5, 0.4, -0.7, -1.4, -0.8, 1.2, -1.0]),
        posture_stiffness: ScalarOrVec::Uniform(20.0),
        // It pulls light wrists harder than a joint may be accelerated towards a stop two radians away (T162).
        enforce_limits: false,
        ..Settings::default()
    };
    let mut controller = Controller::<_, 3, M>::new(arm.state(), Gains::new(&settings));
    let (mut state, mut scratch) = (arm.state(), vec![0.0; 7]);
    let mut rate = |t: f64, x: &[f64]| {
        let (q, dq) = x.split_at(7);
        state.update(q, dq);
        controller.observe(q, dq, &mut Nothing);
        let torque = controller.command(&reference(t, &state));
        let mut out = dq.to_vec();
        out.resize(14, 0.0);
        state.forward_dynamics(&torque.total, &mut scratch, &mut out[7..]);
        out
    };
    let mut x = [Q0.to_vec(), vec![0.0; 7]].concat();
    let moved = |x: &[f64], dx: &[f64], h: f64| -> Vec<f64> {
        x.iter().zip(dx).map(|(x, dx)| x + h * dx).collect()
    };
    let mut states = vec![];
    for k in 0..1400_u32 {
        let t = STEP * f64::from(k);
        if k % 100 == 0 {
            let mut state = arm.state();
            state.update(&x[..7], &x[7..]);
            states.push((t, state));
        }
        let a = rate(t, &x);
        let b = rate(t + 0.5 * STEP, &moved(&x, &a, 0.5 * STEP));
        let c = rate(t + 0.5 * STEP, &moved(&x, &b, 0.5 * STEP));
        let d = rate(t + STEP, &moved(&x, &c, STEP));
        for i in 0..14 {
            x[i] += STEP / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
        }
    }
    states
}

/// θ from rest at `theta` under θ̈ = −D θ̇ − 2K sin ½θ, every 0.1 s.
fn decay(theta: f64) -> Vec<f64> {
    let f = |x: [f64; 2]| [x[1], -GAINS[1] * x[1] - GAINS[0] * 2.0 * (0.5 * x[0]).sin()];
    let (mut x, mut out) = ([theta, 0.0], vec![]);
    let moved = |x: [f64; 2], dx: [f64; 2], h: f64| [x[0] + h * dx[0], x[1] + h * dx[1]];
    for k in 0..1400 {
        if k % 100 == 0 {
            out.push(x[0]);
        }
        let a = f(x);
        let b = f(moved(x, a, 0.5 * STEP));
        let c = f(moved(x, b, 0.5 * STEP));
        let d = f(moved(x, c, STEP));
        for i in 0..2 {
            x[i] += STEP / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
        }
    }
    out
}

fn start(arm: &Arc<SpatialArm>) -> SpatialPose {
    let (position, orientation) = arm.pose(&Q0);
    SpatialPose::new(position, orientation)
}

/// The pose with an offset of 0.02 m and `angle` about an axis across, and with `turn` more about its own z axis.
fn beside(pose: &SpatialPose, angle: f64, turn: f64) -> SpatialPose {
    let tilt = UnitQuaternion::exp(&(Vector::<3>::new(0.6, -0.8, 0.0) * angle));
    let about = UnitQuaternion::exp(&Vector::<3>::new(0.0, 0.0, turn));
    let offset = Vector::<3>::new(0.02, 0.0, 0.0) * f64::from(angle != 0.0);
    SpatialPose::new(pose.position() + offset, pose.orientation() * tilt * about)
}

/// e₀(1 + 4t)e^(−4t), the answer of two poles at −4/s.
fn linear(t: f64) -> f64 {
    (1.0 + 4.0 * t) * (-4.0 * t).exp()
}

fn check_position(t: f64, state: &SpatialState, reference: &Vector<3>, offset: f64) {
    let e = state.position() - reference;
    let expected = Vector::<3>::new(-offset * linear(t), 0.0, 0.0);
    assert!((e - expected).norm() < 1e-9, "{t}: {e} is not {expected}");
}

/// However the tool turns about its own axis beside the reference, the angle of pointing decays as if nothing moved.
#[test]
fn pointing_keeps_its_error_dynamics() {
    let arm = panda_like();
    for (angle, turn) in [(0.0, 0.0), (0.0, 1.3), (0.4, 0.0), (0.4, -2.0)] {
        let from = Pointing(beside(&start(&arm), angle, turn));
        let trajectory = Trajectory::<Pointing, 5>::new(&reference(), &from).unwrap();
        let mut spun = 0.0_f64;
        let states = run(&arm, |t, _| trajectory.at(t));
        for ((t, state), theta) in states.iter().zip(decay(angle)) {
            let wanted = trajectory.at(*t).x.0;
            let error = state
                .orientation()
                .pointing_error(&wanted.orientation(), OrientationError::Logarithm);
            assert!(
                (error.norm() - theta).abs() < 1e-9,
                "{angle} {turn} {t}: {error} is not {theta}"
            );
            let offset = if angle == 0.0 { 0.0 } else { 0.02 };
            check_position(*t, state, &wanted.position(), offset);
            spun = spun.max(state.tool_rate().dot(&state.tool_axes().column(2)).abs());
        }
        assert!(spun > 0.2, "the tool hardly turns about its own axis: {spun}");
    }
}

/// Seen from the reference, the error of a pose keeps its axis and decays as if nothing moved.
#[test]
fn a_pose_keeps_its_error_dynamics() {
    let arm = panda_like();
    for (angle, turn) in [(0.0, 0.0), (0.5, 0.3)] {
        let from = beside(&start(&arm), angle, turn);
        let trajectory = Trajectory::<SpatialPose, 6>::new(&reference(), &from).unwrap();
        let states = run(&arm, |t, _| trajectory.at(t));
        let seen = |t: f64, state: &SpatialState| {
            let wanted = trajectory.at(t).x.orientation();
            (wanted.inverse() * state.orientation()).log()
        };
        let first = seen(0.0, &states[0].1);
        for ((t, state), theta) in states.iter().zip(decay(first.norm())) {
            let e = seen(*t, state);
            let expected = first.try_normalize(1e-9).unwrap_or_default() * theta;
            assert!((e - expected).norm() < 1e-9, "{t}: {e} is not {expected}");
            let offset = if angle == 0.0 { 0.0 } else { 0.02 };
            check_position(*t, state, &trajectory.at(*t).x.position(), offset);
        }
    }
}

/// With the rotation vector as its error, ë + D ė + K e = 0 holds for a pose to the accuracy of the integration.
#[test]
fn the_logarithm_obeys_a_linear_equation() {
    let arm = panda_like();
    let trajectory =
        Trajectory::<SpatialPose, 6>::new(&reference(), &beside(&start(&arm), 1.2, 0.5)).unwrap();
    let seen = |t: f64, state: &SpatialState| {
        let wanted = trajectory.at(t).x.orientation();
        (wanted.inverse() * state.orientation()).log()
    };
    // A reference whose 2 sin ½θ is the θ of the true one.
    let states = run(&arm, |t, state| {
        let sample = trajectory.at(t);
        let orientation = state.orientation();
        let phi = orientation.error(&sample.x.orientation(), OrientationError::Logarithm);
        let size = phi.norm();
        let stretched = if size > 0.0 { phi * (2.0 * (0.5 * size).asin() / size) } else { phi };
        let wanted = UnitQuaternion::exp(&-stretched) * orientation;
        Sample { x: SpatialPose::new(sample.x.position(), wanted), ..sample }
    });
    let first = seen(0.0, &states[0].1);
    for (t, state) in &states {
        let (e, expected) = (seen(*t, state), first * linear(*t));
        assert!((e - expected).norm() < 1e-9, "{t}: {e} is not {expected}");
    }
}
