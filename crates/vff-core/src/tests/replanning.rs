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
