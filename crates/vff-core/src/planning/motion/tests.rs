//! What is promised of plans, measured by means of their own.

use super::timing::TORQUE;
use super::*;
#[cfg(feature = "models")]
use crate::robot::{SpatialArm, models};
use crate::scenario::FromDocument;
use crate::simulation::{Plane, Space};
use crate::world::World;
use crate::world::space::SpatialGeometry;

const PLANAR: &str = r#"
    duration = 4.0
    q0 = [1.5, 0.6, 0.9, 1.0]
    arm = { lengths = [1, 1, 1, 1], masses = 1.0, radius = 0.05 }
"#;

fn planar(goal: &str, more: &str) -> Scenario {
    let text = format!("{PLANAR}\nreference = {{ kind = \"setpoint\", point = {goal} }}\n{more}");
    Scenario::from_toml(&text).unwrap()
}

/// A wall with a gap of 0.7 m between the arm and its goal.
const WALL: &str = r#"
    [[obstacles]]
    shape = { kind = "box", size = [0.3, 3.0] }
    position = [1.9, 2.1]
    [[obstacles]]
    shape = { kind = "box", size = [0.3, 3.0] }
    position = [1.9, -1.6]
"#;

fn found(scenario: &Scenario, settings: &PlanSettings) -> Plan {
    let plan = plan(scenario, settings).unwrap();
    assert_eq!(plan.status, PlanStatus::Found, "{plan:?}");
    plan
}

fn spline(plan: &Plan) -> JointSpline {
    let n = plan.q.len() / plan.times.len();
    let points: Vec<_> = plan.q.chunks(n).map(<[f64]>::to_vec).collect();
    JointSpline::new(&plan.times, &points).unwrap()
}

/// Calls `visit` with q, q̇ and q̈ every millisecond.
fn along(plan: &Plan, mut visit: impl FnMut(f64, [&[f64]; 3])) {
    let spline = spline(plan);
    let mut state = [0; 3].map(|_| vec![0.0; spline.dof()]);
    let [start, end] = spline.span();
    let mut t = start;
    while t <= end {
        spline.at(t, state.each_mut().map(Vec::as_mut_slice));
        visit(t, state.each_ref().map(Vec::as_slice));
        t += 1e-3;
    }
}

/// Every pair of link and obstacle by itself, without anything of the planner: the smallest distance at q and `t`.
fn least<S: FromDocument<D>, const D: usize>(
    arm: &Arc<S::Arm>,
    scene: &Scene<S, D>,
    q: &[f64],
    t: f64,
) -> f64 {
    let mut state = arm.state();
    state.update_positions(q);
    let mut world = World::<S::Geometry, D>::new(scene.obstacles.clone());
    world.update(t);
    let mut least = f64::INFINITY;
    world.for_each_pair(state.bodies(), |contact| least = least.min(contact.distance));
    least
}

/// A motion through a gap keeps its distance all along, its limits of speed and acceleration, starts and ends at rest
/// where it should, and comes back the same for the same seed.
#[test]
fn through_a_gap_in_the_plane() {
    let scenario = planar("[2.9, 0.5]", WALL);
    let AnyScene::Plane(scene) = &scenario.scene else { unreachable!() };
    let arm = Arc::new(Plane::arm(&scene.arm).unwrap());
    for seed in 0..6 {
        let settings = PlanSettings { seed, ..PlanSettings::default() };
        let motion = found(&scenario, &settings);
        assert_eq!(motion, found(&scenario, &settings));
        assert!((motion.margin - 0.02).abs() < 1e-15);
        let mut clearance = f64::INFINITY;
        along(&motion, |_, [q, dq, ddq]| {
            clearance = clearance.min(least::<Plane, 2>(&arm, scene, q, 0.0));
            assert!(dq.iter().all(|v| v.abs() <= 0.5 * MAX_SPEED * 1.001), "{dq:?}");
            assert!(ddq.iter().all(|a| a.abs() <= 0.5 * MAX_ACCELERATION[0] * 1.001), "{ddq:?}");
        });
        assert!(clearance >= 0.5 * motion.margin - 1e-3, "{clearance}");
        assert!((motion.clearance - clearance).abs() < 5e-3);
        assert_eq!(motion.q[..4], scenario.q0);
        let mut state = arm.state();
        state.update_positions(&motion.q[motion.q.len() - 4..]);
        let tip = Manipulator::<2, 2>::pose(&state);
        assert!((tip.x - 2.9).hypot(tip.y - 0.5) < 1e-6);
        for end in [&motion.dq[..4], &motion.dq[motion.dq.len() - 4..]] {
            assert!(end.iter().all(|v| v.abs() < 1e-12));
        }
    }
}

/// Why there is no motion is said, and how far the search came.
#[test]
fn what_cannot_be_done_is_said() {
    let status = |goal: &str, more: &str, settings: &PlanSettings| {
        plan(&planar(goal, more), settings).unwrap()
    };
    let usual = PlanSettings { samples: 300, ..PlanSettings::default() };
    let out = status("[3.9, 3.0]", "", &usual);
    assert_eq!(out.status, PlanStatus::GoalOutOfReach);
    assert!((out.gap - (3.9_f64.hypot(3.0) - 4.0)).abs() < 1e-3, "{}", out.gap);
    assert!(out.message.contains("nearer to the goal than 0.920 m"), "{}", out.message);
    let disc = |x: f64, y: f64, radius: f64| {
        format!(
            "[[obstacles]]\nshape = {{ kind = \"circle\", radius = {radius} }}\nposition = [{x}, {y}]"
        )
    };
    let blocked = status("[2.0, -1.0]", &disc(2.0, -1.0, 0.4), &usual);
    assert_eq!(blocked.status, PlanStatus::GoalBlocked);
    // The tip is in the middle of the disc, with the radii of link and disc around it.
    let said = "at the goal link 3 is 450.00 mm inside obstacle 0; another goal helps, or `ignore` of the \
                obstacle where the link may touch it";
    assert_eq!(blocked.message, said);
    let blocked = status("[2.0, -1.0]", &disc(0.1, 1.0, 0.2), &usual);
    assert_eq!(blocked.status, PlanStatus::StartBlocked);
    // Joint 1, at (cos 1.5, sin 1.5), is 29 mm from the middle of the disc.
    assert!(
        blocked.message.contains(" is 220.63 mm inside obstacle 0; another start helps, or "),
        "{}",
        blocked.message
    );
    let beyond = PlanSettings { goal: Some(vec![9.0, 0.0, 0.0, 0.0]), ..usual.clone() };
    let scenario = planar("[2.0, 1.0]", "");
    let text = format!(
        "{}\nreference = {{ kind = \"setpoint\", point = [2.0, 1.0] }}",
        PLANAR.replace(
            "masses = 1.0",
            "masses = 1.0, joint_limits = [[-3, 3], [-2, 2], [-2, 2], [-2, 2]]"
        )
    );
    let limited = Scenario::from_toml(&text).unwrap();
    let stopped = plan(&limited, &beyond).unwrap();
    assert_eq!(stopped.status, PlanStatus::GoalOutOfReach);
    let said =
        "at the goal joint 0 is at 9.0000, 6.000 beyond its limit of 3.0000; another goal helps";
    assert_eq!(stopped.message, said);
    let off = PlanSettings { start: Some(vec![1.5, -2.25, 0.9, 1.0]), ..usual.clone() };
    let stopped = plan(&limited, &off).unwrap();
    assert_eq!(stopped.status, PlanStatus::StartBlocked);
    let said = "at the start joint 1 is at -2.2500, 0.250 beyond its limit of -2.0000; another start helps";
    assert_eq!(stopped.message, said);
    assert_eq!(plan(&scenario, &beyond).unwrap().status, PlanStatus::Found);
    // A goal behind a wall without a gap: both sides are free, and no motion leads from one to the other.
    let wall =
        "[[obstacles]]\nshape = { kind = \"box\", size = [0.2, 20.0] }\nposition = [1.9, 0.0]";
    let closed = status("[2.9, 0.5]", wall, &usual);
    assert_eq!(closed.status, PlanStatus::GoalBlocked);
    let post =
        "[[obstacles]]\nshape = { kind = \"box\", size = [0.5, 0.5] }\nposition = [1.2, 1.7]";
    let aside = PlanSettings { goal: Some(vec![0.3, 0.0, 0.0, 0.0]), samples: 0, ..usual };
    let stuck = status("[2.0, 1.0]", post, &aside);
    assert_eq!((stuck.status, stuck.samples), (PlanStatus::NotFound, 0));
    assert!(stuck.gap > 1.0 && stuck.q.len() >= 4 && stuck.times.is_empty(), "{stuck:?}");
    for (settings, path) in [
        (PlanSettings { margin: -0.1, ..PlanSettings::default() }, "margin"),
        (PlanSettings { speed: 1.5, ..PlanSettings::default() }, "speed"),
        (PlanSettings { speed: f64::NAN, ..PlanSettings::default() }, "speed"),
        (PlanSettings { horizon: Some(f64::INFINITY), ..PlanSettings::default() }, "horizon"),
        (PlanSettings { start: Some(vec![0.0]), ..PlanSettings::default() }, "start"),
        (PlanSettings { goal: Some(vec![0.0]), ..PlanSettings::default() }, "goal"),
    ] {
        let error = plan(&planar("[2.0, 1.0]", ""), &settings).unwrap_err();
        assert_eq!(error.path, path);
    }
}

/// What would take for ever, or more memory than there is, is refused with the number that is to blame. What takes an hour is not.
#[test]
fn what_has_no_end_is_refused() {
    let free = planar("[2.0, 1.0]", "");
    let to = |goal: [f64; 4]| PlanSettings { goal: Some(goal.to_vec()), ..PlanSettings::default() };
    let near = || to([0.3, 0.0, 0.4, 1.1]);
    for far in [101.0, -1e6, 1e308] {
        let error = plan(&free, &to([0.0, far, 0.0, 0.0])).unwrap_err();
        assert_eq!(error.path, "goal[1]");
        assert!(error.to_string().contains("within 100 rad"), "{error}");
        let away = PlanSettings { start: Some(vec![0.0, 0.0, far, 0.0]), ..near() };
        assert_eq!(plan(&free, &away).unwrap_err().path, "start[2]");
    }
    let limited = |limit: &str| {
        let text = PLANAR.replace("masses = 1.0", &format!("masses = 1.0, {limit}"));
        let reference = "reference = { kind = \"setpoint\", point = [2.0, 1.0] }";
        Scenario::from_toml(&format!("{text}\n{reference}")).unwrap()
    };
    for (limit, settings, path) in [
        ("velocity_limits = [1, 1, 1e-6, 1]", near(), "arm.velocity_limits[2]"),
        ("velocity_limits = 1e-12", near(), "arm.velocity_limits[0]"),
        ("velocity_limits = 1e-300", near(), "arm.velocity_limits[0]"),
        ("torque_limits = 1e-7", near(), "arm.torque_limits"),
        ("torque_limits = 1e-12", near(), "arm.torque_limits"),
        ("torque_limits = 1e-300", near(), "arm.torque_limits"),
        ("velocity_limits = 2.0", PlanSettings { speed: 1e-9, ..near() }, "speed"),
        ("gravity = 0.0", PlanSettings { speed: 1e-9, ..near() }, "speed"),
        ("velocity_limits = 1e-6", PlanSettings::default(), "arm.velocity_limits"),
    ] {
        let error = plan(&limited(limit), &settings).unwrap_err();
        assert!(error.path.starts_with(path), "{limit}: {error}");
        assert!(error.to_string().contains("up to 3600 s"), "{limit}: {error}");
    }
    let slow = plan(&limited("velocity_limits = 1e-3"), &near()).unwrap();
    assert_eq!(slow.status, PlanStatus::Found);
    assert!(
        slow.times.last().is_some_and(|end| (2400.0..2500.0).contains(end)),
        "{:?}",
        slow.times.last()
    );
    // Random configurations are drawn where a motion may go, however far joints may turn.
    let wide = PlanSettings { samples: 40, ..to([1.5, -0.9, 0.9, 1.0]) };
    let post =
        "[[obstacles]]\nshape = { kind = \"box\", size = [0.5, 0.5] }\nposition = [1.2, 1.7]";
    let text = PLANAR.replace("masses = 1.0", "masses = 1.0, joint_limits = [-1e9, 1e9]");
    let reference = "reference = { kind = \"setpoint\", point = [2.0, 1.0] }";
    let wide = plan(&Scenario::from_toml(&format!("{text}\n{reference}\n{post}")).unwrap(), &wide)
        .unwrap();
    assert!(wide.nodes < 100_000, "{}", wide.nodes);
}

/// Places that a disc will pass within the horizon are kept free; those that it passes later are not, and with None it
/// is not there at all.
#[test]
fn swept_places_are_kept_free() {
    let disc = "[[obstacles]]\nshape = { kind = \"circle\", radius = 0.3 }\nposition = [2.6, -3.0]\n\
                motion = { kind = \"linear\", velocity = [0.0, 1.0] }";
    let scenario = planar("[2.6, -0.6]", disc);
    let AnyScene::Plane(scene) = &scenario.scene else { unreachable!() };
    let arm = Arc::new(Plane::arm(&scene.arm).unwrap());
    let with =
        |horizon| plan(&scenario, &PlanSettings { horizon, ..PlanSettings::default() }).unwrap();
    // At t = 2.4 s it is at the goal.
    let blocked = with(Some(3.0));
    assert_eq!(blocked.status, PlanStatus::GoalBlocked);
    let said = "obstacle 0 passes within the horizon of 3 s where link 3 is at the goal, ";
    assert!(blocked.message.starts_with(said), "{}", blocked.message);
    let free = with(None);
    assert!(free.clearance == f64::INFINITY);
    let soon = with(Some(1.5));
    assert_eq!(soon.status, PlanStatus::Found);
    along(&soon, |_, [q, ..]| {
        for k in 0..=15 {
            let apart = least::<Plane, 2>(&arm, scene, q, 0.1 * f64::from(k));
            assert!(apart > 0.0, "{apart}");
        }
    });
}

#[cfg(feature = "models")]
fn panda(more: &str) -> Scenario {
    let text = format!(
        r#"
        duration = 4.0
        q0 = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]
        arm.model = "panda"
        {more}
        "#
    );
    Scenario::from_toml(&text).unwrap()
}

/// A Panda reaches a pose beside a post, within its limits of angle, speed and torque, and without touching the post or
/// itself.
#[cfg(feature = "models")]
#[test]
fn around_a_post_in_space() {
    let scenario = panda(
        r#"
        controller = { task = "pose", self_collision = "avoid" }
        reference = { kind = "setpoint", point = [0.25, 0.5, 0.4], orientation = [0.0, 1.0, 0.0, 0.0] }
        [[obstacles]]
        shape = { kind = "box", size = [0.1, 0.1, 1.2] }
        position = [0.4, 0.28, 0.5]
        "#,
    );
    let AnyScene::Space(scene) = &scenario.scene else { unreachable!() };
    let arm = Arc::new(Space::arm(&scene.arm).unwrap());
    let limits = arm.limits();
    let settings = PlanSettings { speed: 1.0, ..PlanSettings::default() };
    let motion = found(&scenario, &settings);
    let mut state = arm.state();
    let (mut scratch, mut torque) = (vec![0.0; 7], vec![0.0; 7]);
    let mut bodies = vec![];
    let (mut fastest, mut nearest) = (0.0_f64, f64::INFINITY);
    along(&motion, |_, [q, dq, ddq]| {
        nearest = nearest.min(least::<Space, 3>(&arm, scene, q, 0.0));
        state.update(q, dq);
        state.inverse_dynamics(ddq, &mut scratch, &mut torque);
        for i in 0..7 {
            let [lower, upper] = limits.joint[i];
            assert!(lower <= q[i] && q[i] <= upper);
            assert!(dq[i].abs() <= 1.001 * limits.velocity[i]);
            assert!(ddq[i].abs() <= 1.001 * MAX_ACCELERATION[1]);
            assert!(torque[i].abs() <= 1.001 * TORQUE * limits.torque[i], "{torque:?}");
            fastest = fastest
                .max(dq[i].abs() / limits.velocity[i])
                .max(ddq[i].abs() / MAX_ACCELERATION[1]);
        }
        crate::control::distance::OwnPair::for_each_within(&state, &mut bodies, 1.0, |pair| {
            assert!(pair.nearest.distance > 0.0);
            1.0
        });
    });
    assert!(nearest > 0.5 * motion.margin - 1e-3);
    // What is said of it, of the pieces that may come nearest alone.
    assert!((motion.clearance - nearest).abs() < 2e-4, "{} {nearest}", motion.clearance);
    // It is not slower than it has to be.
    assert!(fastest > 0.9, "{fastest}");
    state.update_positions(&motion.q[motion.q.len() - 7..]);
    let tip = Manipulator::<3, 6>::pose(&state);
    assert!((tip.position() - crate::math::Vector::<3>::new(0.25, 0.5, 0.4)).norm() < 1e-6);
}

/// Where nobody asked to keep bodies of the arm apart, a motion that takes one into another says so; kept apart, that goal is
/// blocked by the same pair.
#[cfg(feature = "models")]
#[test]
fn a_motion_through_itself_is_told() {
    let goal = vec![0.0, 0.0, 0.0, -3.05, 0.0, 0.3, 0.8];
    let of = |self_collision: &str| {
        let scenario = panda(&format!(
            r#"
            controller = {{ self_collision = "{self_collision}" }}
            reference = {{ kind = "setpoint", point = [0.5, 0.2, 0.4] }}
            "#
        ));
        plan(&scenario, &PlanSettings { goal: Some(goal.clone()), ..PlanSettings::default() })
            .unwrap()
    };
    let (through, blocked) = (of("ignore"), of("avoid"));
    assert_eq!(
        [through.status, blocked.status],
        [PlanStatus::Found, PlanStatus::GoalBlocked],
        "{} / {}",
        through.message,
        blocked.message
    );
    let pair = through.message.split_once("it takes ").expect("what it goes through").1;
    let [a, b] = [1, 3].map(|k| pair.split('`').nth(k).unwrap());
    assert!(blocked.message.contains(a) && blocked.message.contains(b), "{}", blocked.message);
}

/// A goal at which bodies of the arm are nearer to each other than they have to be is reached; they keep as much as they have there,
/// and what they have to away from it.
#[cfg(feature = "models")]
#[test]
fn bodies_of_the_arm_keep_less_near_an_end_that_has_less() {
    let scenario =
        panda("reference = { kind = \"setpoint\" }\ncontroller.self_collision = \"avoid\"");
    let AnyScene::Space(scene) = &scenario.scene else { unreachable!() };
    let arm = Arc::new(Space::arm(&scene.arm).unwrap());
    let world = World::new(vec![]);
    let mut space = FreeSpace::<_, SpatialGeometry, 3>::new(arm.state(), &world, None, true, 0.0);
    let folded = |angle: f64| vec![0.4, -0.5, 0.0, -2.3, 0.0, angle, 0.8];
    let (mut near, mut apart) = (0.3, 1.5);
    for _ in 0..60 {
        let middle = 0.5 * (near + apart);
        let is_near = space.own_room(&folded(middle), 1.0) < 1e-3;
        *if is_near { &mut near } else { &mut apart } = middle;
    }
    let goal = Some(folded(apart));
    let plan = found(&scenario, &PlanSettings { goal, ..PlanSettings::default() });
    let said = "; bodies of the arm keep 0.90 mm at the goal from each other, up to 2 mm elsewhere";
    assert!(plan.message.ends_with(said), "{}", plan.message);
    let end = plan.times[plan.times.len() - 1];
    along(&plan, |t, [q, ..]| {
        let own = space.own_room(q, 1.0);
        assert!(
            own > if t < 0.5 * end { 1.6e-3 - 1e-4 } else { 0.8 * 0.9e-3 - 1e-4 },
            "{own} at {t}"
        );
    });
}

/// A joint that cannot hold its links is named, with what it may hold.
#[cfg(feature = "models")]
#[test]
fn a_weak_joint_is_named() {
    let scenario = panda(
        r#"
        arm.torque_limits = [87, 20, 87, 87, 12, 12, 12]
        reference = { kind = "setpoint", point = [0.5, 0.2, 0.4] }
        "#,
    );
    let heavy = plan(&scenario, &PlanSettings::default()).unwrap();
    assert_eq!(heavy.status, PlanStatus::TooHeavy);
    assert!(
        heavy.message.starts_with("on the way `panda_joint2` would have to hold "),
        "{}",
        heavy.message
    );
    assert!(heavy.message.contains(" N·m, and may take 16.000 N·m, 80 % of its limit; "));
}

/// What is certified to be free is: every motion between random configurations among random bodies, looked at in a
/// thousand places; and what is refused is not.
#[cfg(feature = "models")]
#[test]
fn certified_motions_are_free() {
    certified("", 400);
}

/// Nor is anything missed that turns about the axis of a link: boards, whose capsules hardly move.
#[cfg(feature = "models")]
#[test]
fn certified_motions_of_boards_are_free() {
    certified(
        r#"
        [[arm.collision]]
        link = "panda_link3"
        shape = { kind = "box", center = [0.0, 0.0, -0.1], size = [0.3, 0.03, 0.2] }
        [[arm.collision]]
        link = "panda_link5"
        shape = { kind = "convex", vertices = [[0, 0, 0], [0.02, 0.2, -0.3], [0, -0.1, -0.3], [0.1, 0, -0.2]] }
        [[arm.collision]]
        link = "panda_link7"
        shape = { kind = "box", center = [0.0, 0.0, 0.1], size = [0.25, 0.03, 0.1] }
        "#,
        120,
    );
}

/// Nor of several that one link carries, which are looked at together first: a gripper of boxes, and a bracket.
#[cfg(feature = "models")]
#[test]
fn certified_motions_of_grippers_are_free() {
    let gripper = |center: &str, size: &str| {
        format!(
            "[[arm.collision]]\nlink = \"panda_link7\"\nshape = {{ kind = \"box\", center = {center}, size = {size} }}\n"
        )
    };
    let parts = [
        gripper("[0.0, 0.0, 0.12]", "[0.2, 0.05, 0.06]"),
        gripper("[0.08, 0.0, 0.2]", "[0.02, 0.02, 0.1]"),
        gripper("[-0.08, 0.0, 0.2]", "[0.02, 0.02, 0.1]"),
        gripper("[0.0, 0.1, 0.2]", "[0.02, 0.02, 0.1]"),
        gripper("[0.1, 0.0, 0.1]", "[0.1, 0.02, 0.02]").replace("link7", "link5"),
        gripper("[0.1, 0.0, 0.0]", "[0.02, 0.1, 0.1]").replace("link7", "link5"),
    ];
    let scenario = among_boxes(&parts.concat());
    let AnyScene::Space(scene) = &scenario.scene else { unreachable!() };
    let arm = Arc::new(Space::arm(&scene.arm).unwrap());
    let members = arm.state().bundles().into_iter().map(|bundle| bundle.members.len());
    assert_eq!(members.collect::<Vec<_>>(), [4, 2]);
    certified_of(&arm, &scenario, 200);
}

/// Joints of arms that people have turn about any axis of their links.
#[cfg(feature = "models")]
#[test]
fn certified_motions_about_other_axes_are_free() {
    let mut panda = models::named("panda").unwrap();
    panda.joints[1].axis = [0.0, 1.0, 0.0];
    panda.joints[3].axis = [-0.6, 0.0, 0.8];
    certified_of(&Arc::new(panda.build().unwrap()), &among_boxes(""), 200);
}

#[cfg(feature = "models")]
fn certified(shapes: &str, motions: u32) {
    let scenario = among_boxes(shapes);
    let AnyScene::Space(scene) = &scenario.scene else { unreachable!() };
    certified_of(&Arc::new(Space::arm(&scene.arm).unwrap()), &scenario, motions);
}

#[cfg(feature = "models")]
fn among_boxes(shapes: &str) -> Scenario {
    let boxes: String = (0..8)
        .map(|k| {
            let angle = 0.8 * f64::from(k);
            let (x, y, z) = (0.55 * angle.cos(), 0.55 * angle.sin(), 0.15 + 0.1 * f64::from(k));
            format!(
                "[[obstacles]]\nshape = {{ kind = \"box\", size = [0.15, 0.1, 0.2] }}\nposition = [{x}, {y}, {z}]\n"
            )
        })
        .collect();
    panda(&format!("reference = {{ kind = \"setpoint\" }}\n{boxes}\n{shapes}"))
}

#[cfg(feature = "models")]
fn certified_of(arm: &Arc<SpatialArm>, scenario: &Scenario, motions: u32) {
    let AnyScene::Space(scene) = &scenario.scene else { unreachable!() };
    let window = Window { start: 0.0, duration: Some(0.0), in_time: false };
    let margin = 0.01;
    let world = World::new(scene.obstacles.clone());
    let mut space =
        FreeSpace::<_, SpatialGeometry, 3>::new(arm.state(), &world, Some(window), true, margin);
    let mut noise = Noise::new(3, 1);
    let mut draw = || -> Vec<f64> {
        let within = |[lower, upper]: &[f64; 2]| lower + (upper - lower) * noise.share();
        arm.limits().joint.iter().map(within).collect()
    };
    let (mut free, mut blocked) = (0, 0);
    for _ in 0..motions {
        let (a, b) = (draw(), draw());
        let b: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a + 0.15 * (b - a)).collect();
        let least = (0..=1000)
            .map(|k| {
                let share = f64::from(k) / 1000.0;
                let q: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a + share * (b - a)).collect();
                let [outside, own] = space.distances(&q);
                (outside - margin).min(own - 2e-3)
            })
            .fold(f64::INFINITY, f64::min);
        if space.is_free_between(&a, &b) {
            free += 1;
            assert!(least > -2e-3, "{least}");
        } else {
            blocked += 1;
            assert!(least < 1e-4, "{least}");
        }
    }
    assert!(free.min(blocked) > motions / 10, "{free} {blocked}");
}

/// A hand that is to stay upright does, at every sample, wherever it has to go: over a wall, to a position alone, and in the plane, where it
/// keeps its angle. What cannot is said.
#[cfg(feature = "models")]
#[test]
fn what_is_carried_stays_upright() {
    let text = r#"
        duration = 4.0
        q0 = [0.6, 0.2, 0.0, -2.2, 0.0, 2.4, 0.8]
        arm = { model = "panda" }
        reference = { kind = "setpoint", point = [0.45, -0.35, 0.3] }
        [controller]
        task = "position"
        [[obstacles]]
        shape = { kind = "box", size = [0.5, 0.1, 0.5] }
        position = [0.6, 0.0, 0.25]
    "#;
    let scenario = Scenario::from_toml(text).unwrap();
    let AnyScene::Space(scene) = &scenario.scene else { unreachable!() };
    let arm = Space::arm(&scene.arm).unwrap();
    let arm = Arc::new(arm);
    let tilt_of = |plan: &Plan| {
        let axis = |q: &[f64]| arm.pose(q).1.matrix().tr_mul(&crate::math::Vector::<3>::z());
        let upright = axis(&scenario.q0);
        let mut worst: f64 = 0.0;
        along(plan, |_, [q, ..]| worst = worst.max(axis(q).dot(&upright).clamp(-1.0, 1.0).acos()));
        worst
    };
    let free = found(&scenario, &PlanSettings::default());
    assert!(tilt_of(&free) > 0.4, "{}", tilt_of(&free));
    assert_eq!(free.tilt, None);
    for tilt in [0.3, 0.1, 0.03] {
        let settings = PlanSettings { tilt: Some(tilt), paths: 1, ..PlanSettings::default() };
        let upright = found(&scenario, &settings);
        let seen = tilt_of(&upright);
        assert!(seen <= tilt, "{seen} of {tilt}");
        assert!((upright.tilt.unwrap() - seen).abs() < 0.02 * tilt, "{:?} {seen}", upright.tilt);
        assert!(
            upright.clearance > 0.0 && upright.message.contains("tilts by up to"),
            "{}",
            upright.message
        );
        assert_eq!(upright, plan(&scenario, &settings).unwrap());
    }
    let goal = Some(vec![0.6, 0.2, 0.0, -2.2, 0.0, 1.9, 0.8]);
    let settings = PlanSettings { goal, tilt: Some(0.3), ..PlanSettings::default() };
    let blocked = plan(&scenario, &settings).unwrap();
    assert_eq!(blocked.status, PlanStatus::GoalBlocked);
    assert!(
        blocked.message.contains("is tilted by 28.65°, and may be by 16.33°"),
        "{}",
        blocked.message
    );
    for tilt in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let settings = PlanSettings { tilt: Some(tilt), ..PlanSettings::default() };
        assert!(plan(&scenario, &settings).unwrap_err().to_string().starts_with("tilt"));
    }
}
