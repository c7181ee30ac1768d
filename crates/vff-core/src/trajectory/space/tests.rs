//! Every kind of reference in space: derivatives, knots, defaults, errors.

use super::*;
use crate::math::{Pose, UnitQuaternion};
use crate::trajectory::testing::{assert_close, check_continuity, check_derivatives};
use crate::trajectory::{Reference, Trajectory};
use proptest::prelude::*;
use std::f64::consts::PI;

fn vector(size: f64) -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-size..size)
}

fn quaternion() -> impl Strategy<Value = [f64; 4]> {
    vector(1.8).prop_map(|phi| UnitQuaternion::exp(&phi.into()).to_array())
}

fn start() -> impl Strategy<Value = SpatialPose> {
    (vector(1.0), quaternion()).prop_map(|(x, q)| pose(x, q))
}

fn pose(x: [f64; 3], q: [f64; 4]) -> SpatialPose {
    SpatialPose::new(x.into(), UnitQuaternion::new(q).unwrap())
}

/// Orientations that differ by less than a quarter turn, and times between them.
fn orientations() -> impl Strategy<Value = (Vec<f64>, Vec<[f64; 4]>, Vec<[f64; 3]>)> {
    prop::collection::vec((0.5..2.0, vector(0.7), vector(1.0)), 2..7).prop_map(|steps| {
        let (mut t, mut at) = (-1.0, UnitQuaternion::exp(&Vector::<3>::new(0.4, 2.0, -1.0)));
        let (mut times, mut turns, mut points) = (vec![], vec![], vec![]);
        for (duration, turn, point) in steps {
            (t, at) = (t + duration, UnitQuaternion::exp(&turn.into()) * at);
            times.push(t);
            turns.push(at.to_array());
            points.push(point);
        }
        (times, turns, points)
    })
}

/// ẋ and ẍ at `t`, for a pose and, where it says nothing of orientations, for a position; the direction of pointing
/// moves as ż and z̈ say.
fn check(reference: &SpatialReference, start: &SpatialPose, t: f64) {
    let whole = Trajectory::<SpatialPose, 6>::new(reference, start).unwrap();
    check_derivatives(&whole, t);
    if Orientation::spoken_of(reference).is_none() {
        let position = Trajectory::<Vector<3>, 3>::new(reference, &start.position()).unwrap();
        check_derivatives(&position, t);
        assert_eq!(position.at(t).x, whole.at(t).x.position());
    }
    let pointing = Trajectory::<Pointing, 5>::new(reference, &Pointing(*start)).unwrap();
    let h = 1e-4;
    let [before, now, after] = [t - h, t, t + h].map(|t| pointing.at(t));
    let z = |sample: &Sample<Pointing, 5>| sample.x.0.orientation().rotate(&Vector::<3>::z());
    // z × ż and z × z̈, in the axes of the reference.
    let own = |x: Vector<3>| {
        let x = now.x.0.orientation().inverse().rotate(&z(&now).cross(&x));
        Vector::<2>::new(x.x, x.y)
    };
    let rate = own((z(&after) - z(&before)) / (2.0 * h));
    let change = own((z(&after) + z(&before) - z(&now) * 2.0) / (h * h));
    let turning = whole.at(t);
    let scale = 1.0 + turning.dx.norm_squared() + turning.ddx.norm();
    assert_close(now.dx.fixed_rows::<2>(3).into_owned(), rate, 1e-5 * scale);
    assert_close(now.ddx.fixed_rows::<2>(3).into_owned(), change, 1e-5 * scale);
    let given = Sample::in_world_axes(turning.x, &turning.dx, &turning.ddx);
    assert_close(given.dx, now.dx, 1e-14 * scale);
    assert_close(given.ddx, now.ddx, 1e-14 * scale);
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn derivatives_are_exact(
        x in start(), [a, b, c] in prop::array::uniform3(vector(1.5)), turn in quaternion(), other in quaternion(),
        t in -3.0..3.0, relative in any::<bool>(), turning in any::<bool>(), given in any::<bool>(),
    ) {
        let orientation = given.then_some(turn);
        let circle = |normal| SpatialReference::Circle {
            center: a, radius: b[0], angular_velocity: b[1], phase: b[2], normal, orientation, turning, relative,
        };
        check(&circle(c), &x, t);
        check(&circle([0.0, 0.0, -1.0]), &x, t);
        check(&SpatialReference::Lissajous {
            center: a, amplitude: b, angular_frequency: c, phase: a, orientation, relative,
        }, &x, t);
        let coefficients = [a.to_vec(), b[..2].to_vec(), vec![]];
        check(&SpatialReference::Polynomial { coefficients, orientation, relative }, &x, t);
        let line = SpatialReference::Line {
            start: given.then_some(a), end: b, duration: 3.0, start_orientation: orientation,
            orientation: turning.then_some(other), relative,
        };
        check(&line, &x, 1.5 + 0.45 * t);
        let trajectory = Trajectory::<SpatialPose, 6>::new(&line, &x).unwrap();
        check_continuity(&trajectory, 0.0);
        check_continuity(&trajectory, 3.0);
        prop_assert_eq!(trajectory.at(4.0).dx, Vector::<6>::zeros());
        check(&SpatialReference::Setpoint { point: given.then_some(a), orientation, relative }, &x, t);
    }

    /// Splines go through every pose, without a jump, and their ω and α are the derivatives of what they turn.
    #[test]
    fn splines(x in start(), (times, turns, points) in orientations(), fraction in 0.01..0.99, relative in any::<bool>()) {
        let end = times.len() - 1;
        for rests in [true, false] {
            let reference = {
                let (times, points) = (times.clone(), points.clone());
                let orientations = Some(turns.clone());
                match rests {
                    true => SpatialReference::Waypoints { times, points, orientations, relative },
                    false => SpatialReference::Table { times, points, orientations, relative },
                }
            };
            let trajectory = Trajectory::<SpatialPose, 6>::new(&reference, &x).unwrap();
            for (k, &t) in times.iter().enumerate() {
                let given = pose(points[k], turns[k]);
                let (p, r) = (given.position(), given.orientation());
                let expected = match relative {
                    true => SpatialPose::new(p + x.position(), r * x.orientation()),
                    false => given,
                };
                prop_assert!(trajectory.at(t).x.error(&expected).norm() < 1e-13);
                if rests || (k > 0 && k < end) {
                    check_continuity(&trajectory, t);
                }
            }
            for pair in times.windows(2) {
                check(&reference, &x, pair[0] + fraction * (pair[1] - pair[0]));
            }
            prop_assert_eq!(trajectory.at(-1.5).dx, Vector::<6>::zeros());
        }
    }

    /// Turning the world, and the tool in its hand, before or after interpolation is the same.
    #[test]
    fn splines_have_no_favourite_axes(
        (times, turns, points) in orientations(), world in quaternion(), tool in quaternion(), share in 0.0..1.0,
    ) {
        let [world, tool] = [world, tool].map(|q| UnitQuaternion::new(q).unwrap());
        let t = times[0] + share * (times[times.len() - 1] - times[0]);
        let at = |turns: Vec<[f64; 4]>| {
            let (times, points, orientations) = (times.clone(), points.clone(), Some(turns));
            let table = SpatialReference::Table { times, points, orientations, relative: false };
            Orientation::new(&table, UnitQuaternion::IDENTITY).unwrap().at(t)
        };
        let plain = at(turns.clone());
        let turned = at(turns.iter().map(|q| (world * UnitQuaternion::new(*q).unwrap() * tool).to_array()).collect());
        let expected = (world * plain.orientation * tool).to_array();
        assert_close(turned.orientation.to_array().into(), Vector::<4>::from(expected), 1e-13);
        assert_close(turned.omega, world.rotate(&plain.omega), 1e-12);
        assert_close(turned.alpha, world.rotate(&plain.alpha), 1e-11);
    }

    /// A reference that is left keeps its state, goes to its goal, and its orientation comes to rest.
    #[test]
    fn aiming_does_not_jump(x in start(), (times, turns, points) in orientations(), goal in vector(1.0), share in 0.1..0.9) {
        let left = times[0] + share * (times[times.len() - 1] - times[0]);
        let waypoints = SpatialReference::Waypoints { times, points, orientations: Some(turns), relative: false };
        let mut trajectory = Trajectory::<SpatialPose, 6>::new(&waypoints, &x).unwrap();
        let before = trajectory.at(left);
        trajectory.aim(left, &goal, 6.0);
        let after = trajectory.at(left);
        prop_assert!(after.x.error(&before.x).norm() + (after.dx - before.dx).norm() < 1e-12);
        prop_assert!((after.ddx - before.ddx).norm() < 1e-10);
        check_derivatives(&trajectory, left + 0.3);
        let end = trajectory.at(left + 20.0);
        prop_assert!((end.x.position() - Vector::from(goal)).norm() < 1e-9);
        prop_assert!(end.x.orientation().error(&before.x.orientation(), Default::default()).norm() < 1e-9);
        prop_assert!(end.dx.norm() < 1e-9);
    }

    /// The same on the way to a whole pose: it turns to the wanted orientation, too.
    #[test]
    fn aiming_at_a_pose_does_not_jump(
        x in start(), (times, turns, points) in orientations(), goal in vector(1.0), turn in vector(1.5), share in 0.1..0.9,
    ) {
        let left = times[0] + share * (times[times.len() - 1] - times[0]);
        let waypoints = SpatialReference::Waypoints { times, points, orientations: Some(turns), relative: false };
        let mut trajectory = Trajectory::<SpatialPose, 6>::new(&waypoints, &x).unwrap();
        let before = trajectory.at(left);
        let wanted = UnitQuaternion::exp(&Vector::from(turn)) * before.x.orientation();
        trajectory.aim(left, SpatialPose::new(goal.into(), wanted).as_slice(), 6.0);
        let after = trajectory.at(left);
        prop_assert!(after.x.error(&before.x).norm() + (after.dx - before.dx).norm() < 1e-12);
        prop_assert!((after.ddx - before.ddx).norm() < 1e-10);
        check_derivatives(&trajectory, left + 0.3);
        let end = trajectory.at(left + 20.0);
        prop_assert!(end.x.error(&SpatialPose::new(goal.into(), wanted)).norm() < 1e-9);
        prop_assert!(end.dx.norm() < 1e-9);
    }
}

/// What the simplest document says: the pose at t = 0 is held.
#[test]
fn nothing_said_is_kept() {
    let x = pose([0.3, -0.2, 0.9], [0.0, 0.6, 0.8, 0.0]);
    #[derive(serde::Deserialize)]
    struct Document {
        reference: Vec<SpatialReference>,
    }
    let document: Document = toml::from_str(
        "reference = [\n\
         { setpoint = {} },\n\
         { line = { end = [0.3, -0.2, 0.9], duration = 1 } },\n\
         { setpoint = { point = [0.0, 0.0, 0.0], relative = true } },\n\
         { circle = { center = [-0.5, 0.0, 0.0], radius = 0.5, angular_velocity = 1.0, relative = true } },\n\
         { waypoints = { times = [0.0, 1.0], points = [[0.3, -0.2, 0.9], [0.0, 0.0, 1.0]] } },\n\
         ]",
    )
    .unwrap();
    for reference in &document.reference {
        let sample = Trajectory::<SpatialPose, 6>::new(reference, &x).unwrap().at(0.0);
        assert!(sample.x.error(&x).norm() < 1e-15, "{reference:?}: {sample:?}");
        assert_eq!(sample.dx.fixed_rows::<3>(3), Vector::<3>::zeros());
        assert!(Trajectory::<Vector<3>, 3>::new(reference, &x.position()).is_ok());
    }
    for text in ["setpoint = { speed = 1.0 }", "spiral = {}", "setpoint = { point = [1.0, 2.0] }"] {
        let error = toml::from_str::<SpatialReference>(text).unwrap_err().to_string();
        assert!(error.contains("expected") || error.contains("invalid length"), "{error}");
    }
}

/// About z, a circle is that of the plane; a turning tool turns with the angle of the circle.
#[test]
fn circles() {
    let plane = Reference::Circle {
        center: [0.4, 0.1],
        radius: 0.3,
        angular_velocity: -0.7,
        phase: 0.5,
        orientation: None,
    };
    let plane = Trajectory::<Vector<2>, 2>::new(&plane, &Vector::zeros()).unwrap();
    let x = pose([0.0; 3], [0.5, -0.5, 0.5, 0.5]);
    let space = |normal| {
        let circle = SpatialReference::Circle {
            center: [0.4, 0.1, 0.2],
            radius: 0.3,
            angular_velocity: -0.7,
            phase: 0.5,
            normal,
            orientation: None,
            turning: true,
            relative: false,
        };
        Trajectory::<SpatialPose, 6>::new(&circle, &x).unwrap()
    };
    let flat = space([0.0, 0.0, 2.0]);
    for t in [-1.0, 0.0, 2.0, 7.0] {
        let (a, b) = (plane.at(t), flat.at(t));
        assert_close(b.x.position(), Vector::<3>::new(a.x.x, a.x.y, 0.2), 1e-15);
        assert_close(b.dx, Vector::<6>::new(a.dx.x, a.dx.y, 0.0, 0.0, 0.0, -0.7), 1e-15);
    }
    // On a slanted one the radius, seen from the tool, never changes.
    let slanted = space([1.0, -2.0, 0.5]);
    let seen = |t| {
        let x = slanted.at(t).x;
        x.orientation().inverse().rotate(&(x.position() - Vector::<3>::new(0.4, 0.1, 0.2)))
    };
    for t in [-2.0, 1.0, 30.0] {
        assert_close(seen(t), seen(0.0), 1e-14);
    }
}

/// Half of a geodesic is half of its angle; the long way is never taken.
#[test]
fn lines_turn_about_one_axis() {
    let x = pose([0.0; 3], [1.0, 0.0, 0.0, 0.0]);
    let turn = UnitQuaternion::exp(&Vector::<3>::new(0.0, 0.0, 1.5 * PI));
    let line = SpatialReference::Line {
        start: None,
        end: [1.0, 0.0, 0.0],
        duration: 2.0,
        start_orientation: None,
        orientation: Some(turn.to_array()),
        relative: false,
    };
    let middle = Trajectory::<SpatialPose, 6>::new(&line, &x).unwrap().at(1.0).x;
    assert_close(middle.orientation().log(), Vector::<3>::new(0.0, 0.0, -0.25 * PI), 1e-14);
    assert_close(middle.position(), Vector::<3>::new(0.5, 0.0, 0.0), 1e-14);
}

#[test]
fn unusable_values_are_named() {
    let x = pose([0.0; 3], [1.0, 0.0, 0.0, 0.0]);
    let field = |text: &str| {
        let reference = toml::from_str::<SpatialReference>(text).unwrap();
        let [a, b] = [
            Trajectory::<SpatialPose, 6>::new(&reference, &x).map(drop),
            Trajectory::<Pointing, 5>::new(&reference, &Pointing(x)).map(drop),
        ];
        assert_eq!(a, b);
        a.unwrap_err().field()
    };
    let two = "times = [0, 1], points = [[0, 0, 0], [1, 0, 0]]";
    let half = "[1, 0, 0, 0], [0, 1, 0, 0]";
    assert_eq!(field("setpoint = { orientation = [1, 0, 0, 0.2] }"), "orientation");
    assert_eq!(
        field("line = { end = [0, 0, 0], duration = 1, start_orientation = [2, 0, 0, 0] }"),
        "start_orientation"
    );
    assert_eq!(field("line = { end = [0, 0, 0], duration = 0 }"), "duration");
    assert_eq!(
        field(
            "circle = { center = [0, 0, 0], radius = 1, angular_velocity = 1, normal = [0, 0, 0] }"
        ),
        "normal"
    );
    assert_eq!(field("waypoints = { times = [0], points = [[0, 0, 0]] }"), "times");
    assert_eq!(field("table = { times = [1, 0], points = [[0, 0, 0], [0, 0, 0]] }"), "times[1]");
    assert_eq!(field("table = { times = [0, 1], points = [[0, 0, 0]] }"), "points");
    assert_eq!(
        field(&format!("table = {{ {two}, orientations = [[1, 0, 0, 0]] }}")),
        "orientations"
    );
    assert_eq!(
        field(&format!("waypoints = {{ {two}, orientations = [[1, 0, 0, 0], [1, 1, 0, 0]] }}")),
        "orientations[1]"
    );
    // Almost half turns about several axes, unevenly in time: the curve would come near to no orientation at all.
    let wild = [
        [-0.471, -0.583, 0.364, -0.553],
        [-0.851, 0.22, 0.321, 0.352],
        [-0.751, -0.513, 0.198, 0.365],
        [0.246, -0.085, -0.341, 0.903],
    ];
    let wild = SpatialReference::Table {
        times: vec![0.0, 5.933, 8.337, 8.655],
        points: vec![[0.0; 3]; 4],
        orientations: Some(wild.map(|q| UnitQuaternion::normalised(q).to_array()).into()),
        relative: false,
    };
    let error = Trajectory::<SpatialPose, 6>::new(&wild, &x).unwrap_err();
    assert_eq!(error, TrajectoryError::OrientationsApart { index: 1 });
    assert_eq!(error.field(), "orientations[1]");

    let useless = |text: &str| {
        let reference = toml::from_str::<SpatialReference>(text).unwrap();
        Trajectory::<Vector<3>, 3>::new(&reference, &Vector::zeros()).unwrap_err().field()
    };
    assert_eq!(useless("setpoint = { orientation = [1, 0, 0, 0] }"), "orientation");
    assert_eq!(
        useless(
            "circle = { center = [0, 0, 0], radius = 1, angular_velocity = 1, turning = true }"
        ),
        "turning"
    );
    assert_eq!(useless(&format!("table = {{ {two}, orientations = [{half}] }}")), "orientations");
}
