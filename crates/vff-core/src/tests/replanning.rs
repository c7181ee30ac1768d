//! What is promised of runs whose plan is watched over.

use crate::runtime::AnyRun;
use crate::scenario::Scenario;
use crate::simulation::{Outcome, Reason, Status, Value};
use std::thread;
use std::time::{Duration, Instant};

/// An arm that is to turn by a right angle, along a plan that knows nothing of what is in the way.
fn scenario(obstacles: &str, more: &str) -> Scenario {
    Scenario::from_toml(&format!(
        r#"
        duration = 8.0
        q0 = [0.2, 0.3, 0.3, 0.3]
        arm = {{ lengths = [1, 1, 1, 1], masses = 1.0, radius = 0.05 }}
        controller = {{ stiffness = 100.0, damping = 20.0, null_damping = 10.0, posture_stiffness = 200.0, avoidance = "cbf" }}
        reference = {{ kind = "plan", times = [0.0, 2.0, 4.0], points = [[0.2, 0.3, 0.3, 0.3], [1.0, 0.3, 0.3, 0.3], [1.8, 0.3, 0.3, 0.3]] }}
        {more}
        {obstacles}
        "#
    ))
    .unwrap()
}

fn run(scenario: &Scenario) -> Outcome {
    let mut run = scenario.prepare().unwrap().run;
    while run.step() {}
    run.outcome()
}

fn metric(outcome: &Outcome, name: &str) -> Value {
    outcome.metrics.iter().find(|(metric, _)| metric.name == name).unwrap().1
}

/// Far out in the sweep of the arm, which has to bend to come by.
const IN_THE_WAY: &str = r#"
    [[obstacles]]
    shape = { kind = "circle", radius = 0.2 }
    position = [0.5, 2.9]
"#;

/// A plan that is blocked is replaced after the latency, without a jump; the goal is reached without contact, and another run
/// is the same to the last bit. Without `[replan]` the arm is still on its way.
#[test]
fn a_blocked_plan_is_replaced() {
    let watched = scenario(IN_THE_WAY, "replan = { latency = 0.25 }");
    let outcome = run(&watched);
    assert_eq!(outcome.status, Status::Completed, "{}", outcome.message);
    let first = outcome.replans[0];
    assert_eq!((first.reason, first.status), (Reason::Blocked, Some("found")));
    assert!(first.asked < 0.11, "{first:?}");
    assert!((first.taken.unwrap() - first.asked - 0.25).abs() < 2e-3, "{first:?}");
    assert_eq!(metric(&outcome, "replans"), Value::Count(outcome.replans.len()));

    let record = &outcome.record;
    let last: Vec<_> = record.error.rchunks(2).next().unwrap().to_vec();
    assert!(last[0].hypot(last[1]) < 5e-3, "{last:?}");
    // Half of a plan's speed is 1 rad/s or so, of its acceleration 5 rad/s².
    let plan: Vec<_> = record.q_plan.chunks(4).collect();
    for three in plan.windows(3) {
        for (a, (b, c)) in three[0].iter().zip(three[1].iter().zip(three[2])) {
            assert!((b - a).abs() < 4e-3, "{a} {b}");
            assert!((c - 2.0 * b + a).abs() < 6e-5, "{a} {b} {c}");
        }
    }
    let again = run(&watched);
    assert_eq!((&again.record, &again.replans), (&outcome.record, &outcome.replans));

    let alone = run(&scenario(IN_THE_WAY, ""));
    assert!(alone.replans.is_empty() && metric(&alone, "replans") == Value::None);
    let last: Vec<_> = alone.record.error.rchunks(2).next().unwrap().to_vec();
    assert!(last[0].hypot(last[1]) > 0.1, "{last:?}");
}

/// However often it is to be looked through, a plan is looked through once in a period of control at most.
#[test]
fn a_plan_is_looked_through_once_a_period() {
    let far = "[[obstacles]]\nshape = { kind = \"circle\", radius = 0.2 }\nposition = [-3.0, -2.0]";
    let begun = Instant::now();
    let record = |every: f64| {
        let mut watched = scenario(far, &format!("replan = {{ every = {every:e} }}"));
        watched.duration = 0.1;
        run(&watched).record
    };
    assert_eq!(record(1e-9), record(1e-3));
    assert!(begun.elapsed() < Duration::from_secs(30));
}

/// A plan that is free is left alone, and the run is that without `[replan]`.
#[test]
fn a_free_plan_is_left_alone() {
    let far = "[[obstacles]]\nshape = { kind = \"circle\", radius = 0.2 }\nposition = [-3.0, -2.0]";
    let (watched, plain) = (run(&scenario(far, "replan = {}")), run(&scenario(far, "")));
    assert!(watched.replans.is_empty());
    assert_eq!(watched.record, plain.record);
    assert_eq!(metric(&watched, "replans"), Value::Count(0));
    assert_eq!(metric(&watched, "times_stuck"), Value::Count(0));
}

/// A closed loop that goes back to its start begins with the first plan, and does the same again.
#[test]
fn a_restart_begins_with_the_first_plan() {
    let mut loop_ = scenario(IN_THE_WAY, "replan = {}").prepare_recorded(false).unwrap().run;
    let mut states = [vec![], vec![]];
    for states in &mut states {
        loop_.restart();
        for _ in 0..1500 {
            assert!(loop_.advance(None));
            states.extend_from_slice(loop_.snapshot().q);
        }
    }
    assert!(loop_.snapshot().replans.unwrap().taken > 0);
    assert_eq!(states[0], states[1]);
}

/// In a thread of its own a plan comes while the loop goes on, which waits for nothing.
#[test]
fn a_plan_comes_from_beside() {
    let mut beside = scenario(IN_THE_WAY, "replan = {}").prepare_recorded(false).unwrap().run;
    beside.plan_beside();
    let begin = Instant::now();
    let taken = |run: &AnyRun| run.snapshot().replans.unwrap().taken;
    while taken(&beside) == 0 && begin.elapsed() < Duration::from_secs(60) {
        assert!(beside.advance(None));
        thread::sleep(Duration::from_millis(1));
    }
    assert!(taken(&beside) > 0);
}

/// A hand that is to go straight through what is in its way, with a posture stiff enough to take the side that a plan takes.
fn straight(more: &str, control: &str) -> Scenario {
    Scenario::from_toml(&format!(
        r#"
        duration = 8.0
        q0 = [0.9, 0.5, 0.4, 0.3]
        arm = {{ lengths = [1, 1, 1, 1], masses = 1.0, radius = 0.05 }}
        reference = {{ kind = "line", end = [2.2, -0.4], duration = 2.0 }}
        {more}
        [controller]
        {control}
        stiffness = 100.0
        damping = 20.0
        null_damping = 10.0
        posture = [0.5, 0.5, 0.5, 0.5]
        posture_stiffness = 60.0
        avoidance = "cbf"
        "#
    ))
    .unwrap()
}

/// A wall across the way, to be passed at its outer end.
const WALL: &str = r#"obstacles = [{ shape = { kind = "circle", radius = 0.3 }, position = [1.2, 1.1] }, { shape = { kind = "circle", radius = 0.3 }, position = [1.5, 0.6] }]"#;

/// Who follows no plan asks for one when it comes no nearer to where its reference rests, and arrives; neither reference nor
/// torque jumps, the same run is the same to the last bit, and also a clock that stands still in front of an obstacle goes on.
#[test]
fn a_curve_that_leads_nowhere_is_left_for_a_plan() {
    let alone = run(&straight(WALL, ""));
    let off = |outcome: &Outcome| {
        let last = outcome.record.error.rchunks(2).next().unwrap();
        last[0].hypot(last[1])
    };
    assert!(off(&alone) > 0.3, "{}", off(&alone));
    for waiting in ["", "governor = {}", "governor = { floor = 0.0 }"] {
        let watched = straight(&format!("replan = {{}}\n{WALL}"), waiting);
        let outcome = run(&watched);
        assert_eq!(outcome.status, Status::Completed, "{}", outcome.message);
        let first = outcome.replans[0];
        assert_eq!((first.reason, first.status), (Reason::Stuck, Some("found")), "{waiting}");
        assert!(off(&outcome) < 5e-3, "{waiting}: {}, {:?}", off(&outcome), outcome.replans);
        let record = &outcome.record;
        let clearance = record.clearance.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(clearance > 5e-3, "{waiting}: {clearance}");
        let taken = first.taken.unwrap();
        let plan = record.q_plan.chunks(4).zip(&record.t);
        assert!(
            plan.clone().all(|(q, t)| q.iter().all(|q| q.is_nan() == (*t <= taken))),
            "{waiting}"
        );
        let moved = record.x_ref.chunks(2).collect::<Vec<_>>();
        for three in moved.windows(3) {
            for ((a, b), c) in three[0].iter().zip(three[1]).zip(three[2]) {
                // Within half a second it comes back to the arm, by two metres.
                let [step, next] = [b - a, c - b];
                assert!(step.abs() < 0.012, "{waiting}: {step}");
                assert!((next - step).abs() < 1e-4, "{waiting}: {step} {next}");
            }
        }
        let tau = record.tau.chunks(4).collect::<Vec<_>>();
        for (two, t) in tau.windows(2).zip(&record.t) {
            let step = two[0].iter().zip(two[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!((t - taken).abs() > 0.02 || step < 2.0, "{waiting}: {step} N·m at {t}");
        }
        let again = run(&watched);
        // What is not a number is not the same as itself.
        assert_eq!((&again.record.q, &again.replans), (&record.q, &outcome.replans));
    }
}

/// A curve that leads where it is to is left alone, and the run is that without `[replan]`.
#[test]
fn a_curve_that_is_free_is_left_alone() {
    let (watched, plain) = (run(&straight("replan = {}", "")), run(&straight("", "")));
    assert!(watched.replans.is_empty());
    assert_eq!((&watched.record.tau, &watched.record.q), (&plain.record.tau, &plain.record.q));
    assert_eq!(metric(&watched, "times_stuck"), Value::Count(0));
    assert!(watched.record.q_plan.iter().all(|q| q.is_nan()));
}

/// A goal that somebody drags is planned for as well: where a hand comes no nearer to it.
#[test]
fn who_is_led_elsewhere_is_planned_for_elsewhere() {
    let mut loop_ =
        straight(&format!("replan = {{}}\n{WALL}"), "").prepare_recorded(false).unwrap().run;
    for k in 0..9000 {
        if k == 500 {
            loop_.aim(&[2.4, -0.2], 10.0);
        }
        assert!(loop_.advance(None));
    }
    let snapshot = loop_.snapshot();
    assert!(snapshot.replans.unwrap().taken > 0);
    let off = (snapshot.x[0] - 2.4).hypot(snapshot.x[1] + 0.2);
    assert!(off < 5e-3, "{off}");
    // And back at the start it is the line again that is followed, by the posture of the settings.
    loop_.restart();
    let states = |run: &mut AnyRun| {
        (0..1000)
            .map(|_| {
                run.advance(None);
                run.snapshot().q.to_vec()
            })
            .collect::<Vec<_>>()
    };
    let mut fresh =
        straight(&format!("replan = {{}}\n{WALL}"), "").prepare_recorded(false).unwrap().run;
    let differs = states(&mut loop_).iter().zip(&states(&mut fresh)).position(|(a, b)| a != b);
    assert_eq!(differs, None);
}
