//! Whatever a scenario says, it is refused or it runs: no panic, no hang, and no number that is none
//! in the record of a run that has not diverged. 10⁵ texts are read, and 40 000 of them run. As many more as one likes:
//!
//! ```sh
//! VFF_CASES=1000000 cargo test --release -p vff-core --lib -- --ignored --nocapture scaled
//! ```

use proptest::collection::vec;
use proptest::option::of;
use proptest::prelude::*;
use proptest::sample::select;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::cell::Cell;
use std::fs::read_to_string;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::LazyLock;
use std::time::{Duration, Instant};
use toml::{Table, Value as Toml};
use vff_core::interrupt::{Watch, watched};
use vff_core::scenario::{Scenario, ScenarioError};
use vff_core::simulation::{Outcome, Status, Value};

/// Valid scenarios: the bundled ones, and one with everything that they lack.
const SEEDS: &[&str] = &[
    include_str!("scenarios/crowd.toml"),
    include_str!("scenarios/narrow-gap.toml"),
    include_str!("scenarios/on-path.toml"),
    include_str!("scenarios/paper-1.toml"),
    include_str!("scenarios/paper-1-ramp.toml"),
    include_str!("scenarios/paper-2.toml"),
    include_str!("scenarios/paper-2-moving.toml"),
    include_str!("scenarios/paper-2-printed.toml"),
    include_str!("scenarios/sweep-through.toml"),
    EVERYTHING,
    IN_SPACE,
];

const IN_SPACE: &str = r#"
duration = 0.05
q0 = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
arm = { model = "panda" }
reference = { kind = "setpoint" }
[controller]
stiffness = 400.0
damping = 40.0
avoidance = "cbf"
field = { kind = "bounded", gain = 20.0, influence = 0.25 }
[[obstacles]]
shape = { kind = "points", points = [[0.0, 0.0, 0.0], [0.05, 0.0, 0.02], [0.0, 0.04, 0.1]], radius = 0.02 }
position = [0.3, 0.3, 0.6]
angular_velocity = [0.0, 1.0, 2.0]
motion = { kind = "linear", velocity = [0.0, -0.3, 0.0] }
[[obstacles]]
shape = { kind = "sphere", radius = 0.08 }
position = [0.0, -0.6, 0.6]
motion = { kind = "sinusoid", amplitude = [0.0, 0.2, 0.1], angular_frequency = 2.0 }
"#;

const EVERYTHING: &str = r#"
duration = 0.05
q0 = [0.6, -0.4, 0.5, 0.3]
dq0 = [0.1, 0.0, -0.1, 0.2]
seed = 7
[arm]
lengths = [1.0, 0.9, 0.8, 0.7]
masses = [2.0, 1.5, 1.0, 0.5]
com = [[0.5, 0.1], 0.4, 0.3, [0.3, -0.1]]
inertias = [0.2, 0.1, 0.1, 0.05]
radius = [0.05, 0.04, 0.03, 0.0]
gravity = [1.0, -9.81]
joint_limits = [-3.0, 3.0]
torque_limits = 50.0
[controller]
task = "pose"
stiffness = [16.0, 16.0, 9.0]
damping = 8.0
null_damping = [2.0, 2.0, 1.0, 1.0]
posture = [0.0, 0.1, 0.2, 0.3]
posture_stiffness = 1.0
formulation = "recursive"
projection = "dynamic"
avoidance = "null_space"
singularity = 1e-3
[controller.governor]
inner = 0.01
outer = 0.2
rate = 30.0
floor = 0.1
[controller.field]
kind = "cubic"
gain = 0.5
influence = 0.8
floor = 0.1
approach_damping = 0.3
sliding = 20.0
[reference]
kind = "waypoints"
times = [0.0, 0.5, 1.0]
points = [[2.0, 1.0, 0.5], [2.1, 1.0, 0.6], [2.0, 1.1, 0.7]]
[[obstacles]]
shape = { kind = "capsule", a = [0.0, 0.0], b = [0.5, 0.5], radius = 0.1 }
position = [0.5, 1.0]
angle = 0.4
motion = { kind = "linear", velocity = [0.1, -0.2] }
[[obstacles]]
shape = { kind = "box", size = [0.4, 0.2] }
position = [2.0, 1.8]
motion = { kind = "waypoints", times = [0.0, 1.0], points = [[2.0, 1.8], [2.0, 1.0]] }
[[obstacles]]
shape = { kind = "polygon", vertices = [[0.0, 0.0], [0.3, 0.0], [0.1, 0.3]] }
position = [1.0, -1.0]
motion = { kind = "sinusoid", amplitude = [0.1, 0.2], angular_frequency = 3.0, phase = 0.1 }
[simulation]
dt = 1e-3
integrator = "semi_implicit_euler"
control = "predictor"
control_every = 2
record_every = 3
[plant]
masses = [2.1, 1.4, 1.2, 0.4]
com = [[0.4, 0.1], 0.3, 0.3, [0.3, -0.1]]
inertias = 0.1
gravity = 9.7
payload = 0.3
viscous_friction = 0.1
coulomb_friction = [0.5, 0.0, 0.2, 0.1]
joint_stops = true
[measurement]
position_noise = 1e-4
velocity_noise = [1e-3, 0.0, 1e-3, 2e-3]
position_resolution = 1e-3
velocity_resolution = 1e-2
delay = [0.0, 2e-3, 1e-3, 0.0]
[actuator]
time_constant = 5e-3
"#;

/// What may stand in the place of a number.
const NUMBERS: &[&str] = &[
    "0",
    "-0.0",
    "1",
    "-1",
    "2",
    "3.5",
    "1e-3",
    "1e-9",
    "1e5",
    "1e9",
    "1e18",
    "1e150",
    "-1e150",
    "1e-150",
    "1e308",
    "-1e308",
    "1e-308",
    "5e-324",
    "nan",
    "inf",
    "-inf",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551616",
    "true",
    "\"1\"",
    "[]",
    "[1, 2]",
    "{}",
    "1979-05-27",
];

/// What may stand in the place of a word: names of the schema, and none.
const WORDS: &[&str] = &[
    "khatib",
    "cubic",
    "bounded",
    "circle",
    "capsule",
    "box",
    "polygon",
    "static",
    "linear",
    "sinusoid",
    "waypoints",
    "setpoint",
    "line",
    "table",
    "lissajous",
    "polynomial",
    "position",
    "pose",
    "recursive",
    "extended_jacobian",
    "dynamic",
    "kinematic",
    "none",
    "rk4",
    "semi_implicit_euler",
    "continuous",
    "hold",
    "predictor",
    "kind",
    "gain",
    "floor",
    "radius",
    "points",
    "point",
    "times",
    "arm",
    "obstacles",
    "naïve",
    "",
];

/// What text is made of when it is not made of characters.
const FRAGMENTS: &[&str] = &[
    "\n",
    " = ",
    "[",
    "]",
    "[[",
    "]]",
    "{",
    "}",
    "\"",
    "'''",
    "\"\"\"",
    ",",
    ".",
    "#",
    "\\u0000",
    "q0",
    "arm",
    "duration",
    "reference",
    "lengths",
    "obstacles",
    "simulation",
    "kind",
    "1.0",
    "nan",
    "-1e308",
    "0x7f",
];

#[derive(Debug, Clone, Copy)]
enum Mutation {
    DeleteLine,
    DuplicateLine,
    MoveLine,
    Number,
    Word,
    Insert,
    Truncate,
}

/// Ranges of the maximal runs of characters that belong to a number or a name.
fn tokens(text: &str) -> Vec<std::ops::Range<usize>> {
    let belongs = |c: char| c.is_alphanumeric() || "+-._".contains(c);
    let mut found: Vec<std::ops::Range<usize>> = vec![];
    for (at, c) in text.char_indices().filter(|&(_, c)| belongs(c)) {
        let end = at + c.len_utf8();
        match found.last_mut() {
            Some(last) if last.end == at => last.end = end,
            _ => found.push(at..end),
        }
    }
    found
}

/// The text after one mutation; `place` and `choice` are taken modulo what there is.
fn mutate(text: &str, mutation: Mutation, place: usize, choice: usize) -> String {
    let replaced = |numbers: bool, by: &[&str]| {
        let fits =
            |range: &std::ops::Range<usize>| text[range.clone()].parse::<f64>().is_ok() == numbers;
        let places: Vec<_> = tokens(text).into_iter().filter(fits).collect();
        let mut text = text.to_owned();
        if let Some(range) = places.get(place % places.len().max(1)) {
            text.replace_range(range.clone(), by[choice % by.len()]);
        }
        text
    };
    let cut =
        (0..=place % (text.len() + 1)).rev().find(|&at| text.is_char_boundary(at)).unwrap_or(0);
    let mut lines: Vec<&str> = text.lines().collect();
    let line = place % lines.len().max(1);
    match mutation {
        Mutation::Number => return replaced(true, NUMBERS),
        Mutation::Word => return replaced(false, WORDS),
        Mutation::Truncate => return text[..cut].to_owned(),
        Mutation::Insert => {
            return [&text[..cut], FRAGMENTS[choice % FRAGMENTS.len()], &text[cut..]].concat();
        }
        _ if lines.is_empty() => {}
        Mutation::DeleteLine => drop(lines.remove(line)),
        Mutation::DuplicateLine => lines.insert(choice % lines.len(), lines[line]),
        Mutation::MoveLine => {
            let moved = lines.remove(line);
            lines.insert(choice % (lines.len() + 1), moved);
        }
    }
    lines.join("\n")
}

/// A valid scenario after one to five mutations, of which those of numbers are the most.
fn mutated() -> impl Strategy<Value = String> {
    let mutation = prop_oneof![
        6 => Just(Mutation::Number),
        2 => Just(Mutation::Word),
        1 => select(&[
            Mutation::DeleteLine,
            Mutation::DuplicateLine,
            Mutation::MoveLine,
            Mutation::Insert,
            Mutation::Truncate,
        ][..]),
    ];
    (select(SEEDS), vec((mutation, any::<usize>(), any::<usize>()), 1..6)).prop_map(
        |(seed, mutations)| {
            mutations.into_iter().fold(seed.to_owned(), |text, (kind, place, choice)| {
                mutate(&text, kind, place, choice)
            })
        },
    )
}

/// Text that was never a scenario.
fn arbitrary() -> impl Strategy<Value = String> {
    let piece =
        prop_oneof![any::<char>().prop_map(String::from), select(FRAGMENTS).prop_map(String::from)];
    vec(piece, 0..40).prop_map(|pieces| pieces.concat())
}

/// Whether an error says what is wrong: a sentence, and no debug output of an empty one.
fn is_told(error: &ScenarioError) -> bool {
    !error.problem.to_string().trim().is_empty()
}

/// The longest that a few steps may take, in processor time.
const PATIENCE: Duration = Duration::from_secs(20);
const STEPS: f64 = 50.0;

/// Processor time of this thread so far, which other programs do not make longer; where there is no `/proc`, the time.
fn worked() -> Duration {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    let told = read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split(' ').next()?.parse().ok());
    nanoseconds.map_or_else(|| START.elapsed(), Duration::from_nanos)
}

/// Prepares a scenario as it is, then runs up to [`STEPS`] steps of it. None if it is refused.
fn run(scenario: &Scenario) -> Option<Outcome> {
    let start = worked();
    let ready = scenario.prepare();
    assert!(worked() - start < PATIENCE, "prepare hangs");
    if let Err(error) = ready {
        assert!(is_told(&error), "{error:?}");
        return None;
    }
    let mut short = scenario.clone();
    short.duration = short.duration.min(STEPS * short.simulation.dt);
    let mut ready = short.prepare().expect("a part of what has been accepted");
    while ready.run.step() {
        assert!(worked() - start < PATIENCE, "a step hangs");
    }
    Some(ready.run.outcome())
}

/// What must hold of every outcome.
fn validate(outcome: &Outcome) {
    let record = &outcome.record;
    for (metric, value) in &outcome.metrics {
        if let Value::Number(value) = value {
            assert!(
                value.is_finite(),
                "{} of a run that has {}",
                metric.name,
                outcome.status.name()
            );
        }
    }
    let arrays = [
        ("t", &record.t),
        ("q", &record.q),
        ("dq", &record.dq),
        ("tau", &record.tau),
        ("tau_task", &record.tau_task),
        ("tau_null", &record.tau_null),
        ("tau_vff", &record.tau_vff),
        ("x", &record.x),
        ("dx", &record.dx),
        ("x_ref", &record.x_ref),
        ("error", &record.error),
        ("force", &record.force),
        ("obstacles", &record.obstacles),
        ("q_measured", &record.q_measured),
        ("dq_measured", &record.dq_measured),
        ("tau_applied", &record.tau_applied),
        ("energy", &record.energy),
        ("power", &record.power),
        ("manipulability", &record.manipulability),
        ("objective_scale", &record.objective_scale),
        ("tank", &record.tank),
        ("slack", &record.slack),
        ("path_time", &record.path_time),
    ];
    assert!(record.rows >= 1 || outcome.status == Status::Diverged);
    assert_ne!(outcome.status, Status::Interrupted, "it was run to its end");
    for (name, values) in arrays {
        if outcome.status == Status::Diverged {
            let last = values.len() - values.len() / record.rows.max(1);
            assert!(values[last..].iter().all(|v| v.is_finite()), "{name} in the last row");
            continue;
        }
        let bad = values.iter().position(|v| !v.is_finite());
        assert_eq!(
            bad,
            None,
            "{name} of a run that has {}: {:?}",
            outcome.status.name(),
            bad.map(|i| values[i]),
        );
    }
    // Infinite where there is no obstacle, and where it is too far for its distance to be a number.
    let distance = |v: &f64| v.is_finite() || *v == f64::INFINITY;
    if outcome.status != Status::Diverged {
        assert!(
            record.clearance.iter().all(distance),
            "clearance of a run that has {}",
            outcome.status.name()
        );
    }
}

fn config(cases: u32) -> ProptestConfig {
    // What is found becomes a test of its own below, not a file of seeds.
    ProptestConfig {
        cases,
        failure_persistence: None,
        max_shrink_iters: 4096,
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(config(20_000))]

    #[test]
    fn arbitrary_text_is_refused(text in arbitrary()) {
        let refused = Scenario::from_toml(&text);
        prop_assert!(refused.is_err_and(|error| is_told(&error)));
    }
}

proptest! {
    #![proptest_config(config(80_000))]

    #[test]
    fn mutated_text_is_read_or_refused(text in mutated()) {
        if let Err(error) = Scenario::from_toml(&text) {
            prop_assert!(is_told(&error), "{:?}", error);
        }
    }
}

proptest! {
    #![proptest_config(config(40_000))]

    #[test]
    fn mutated_scenarios_run_or_are_refused(text in mutated()) {
        if let Some(outcome) = Scenario::from_toml(&text).ok().and_then(|scenario| run(&scenario)) {
            validate(&outcome);
        }
    }
}

/// Every number between two bounds, as TOML.
fn between(low: f64, high: f64) -> impl Strategy<Value = String> + Clone {
    (low..high).prop_map(|x| format!("{x:?}"))
}

/// A list of `count` values.
fn list(count: usize, value: impl Strategy<Value = String>) -> impl Strategy<Value = String> {
    vec(value, count).prop_map(|values| format!("[{}]", values.join(", ")))
}

/// One value for all, or `count` of them.
fn each(
    count: usize,
    value: impl Strategy<Value = String> + Clone,
) -> impl Strategy<Value = String> {
    prop_oneof![value.clone(), list(count, value)]
}

fn words(choices: &'static [&'static str]) -> impl Strategy<Value = String> {
    select(choices).prop_map(|word| format!("{word:?}"))
}

/// n links of 0.5 to 1 m and all that can be said of them.
fn arms(n: usize) -> impl Strategy<Value = String> {
    let mass = between(0.1, 5.0);
    let offset = prop_oneof![between(0.1, 0.4), list(2, between(-0.4, 0.4))];
    let limits = "joint_limits = [-2.0, 2.0]\ntorque_limits = 10.0\n";
    (
        list(n, between(0.5, 1.0)),
        each(n, mass),
        list(n, offset),
        each(n, between(0.01, 0.5)),
        each(n, between(0.0, 0.1)),
        prop_oneof![between(-9.81, 9.81), list(2, between(-9.81, 9.81))],
        select(vec!["", limits]),
    )
        .prop_map(|(lengths, masses, com, inertias, radius, gravity, limits)| {
            format!(
                "[arm]\nlengths = {lengths}\nmasses = {masses}\ncom = {com}\ninertias = {inertias}\n\
                 radius = {radius}\ngravity = {gravity}\n{limits}"
            )
        })
}

/// A plant that is not the arm, sensors and drives; the last two under a sampled controller only.
fn realities(n: usize, sampled: bool) -> impl Strategy<Value = String> {
    let physics = (
        each(n, between(0.1, 5.0)),
        between(0.0, 3.0),
        each(n, between(0.0, 2.0)),
        each(n, between(0.0, 10.0)),
        any::<bool>(),
    )
        .prop_map(|(masses, payload, viscous, coulomb, stops)| {
            format!(
                "[plant]\nmasses = {masses}\npayload = {payload}\nviscous_friction = {viscous}\n\
                 coulomb_friction = {coulomb}\njoint_stops = {stops}\n"
            )
        });
    let sensors = (
        each(n, between(0.0, 1e-2)),
        each(n, between(0.0, 1e-1)),
        each(n, between(0.0, 1e-2)),
        each(n, between(0.0, 1e-1)),
        each(n, between(0.0, 1e-2)),
    )
        .prop_map(|(q, dq, q_step, dq_step, delay)| {
            format!(
                "[measurement]\nposition_noise = {q}\nvelocity_noise = {dq}\n\
                 position_resolution = {q_step}\nvelocity_resolution = {dq_step}\ndelay = {delay}\n"
            )
        });
    let drives =
        each(n, between(0.0, 1e-2)).prop_map(|lag| format!("[actuator]\ntime_constant = {lag}\n"));
    (of(physics), of(sensors), of(drives)).prop_map(move |(physics, sensors, drives)| {
        let parts = if sampled { vec![physics, sensors, drives] } else { vec![physics] };
        parts.into_iter().flatten().collect()
    })
}

fn controllers(n: usize, m: usize) -> impl Strategy<Value = String> {
    let field = (
        words(&["khatib", "cubic", "bounded"]),
        between(0.0, 5.0),
        between(0.3, 1.5),
        between(0.0, 1.0),
    );
    (
        each(m, between(0.0, 100.0)),
        each(m, between(0.0, 20.0)),
        each(n, between(0.0, 10.0)),
        (list(n, between(-3.0, 3.0)), each(n, between(0.0, 5.0))),
        words(&["recursive", "extended_jacobian"]),
        words(&["dynamic", "kinematic", "none"]),
        words(&["null_space", "relaxed", "priority", "cbf"]),
        field,
    )
        .prop_map(
            move |(
                stiffness,
                damping,
                null,
                (posture, spring),
                formulation,
                projection,
                avoidance,
                field,
            )| {
                let task = ["position", "pose"][m - 2];
                let (kind, gain, influence, approach) = field;
                format!(
                    "[controller]\ntask = {task:?}\nstiffness = {stiffness}\ndamping = {damping}\n\
                 null_damping = {null}\nposture = {posture}\nposture_stiffness = {spring}\n\
                 formulation = {formulation}\nprojection = {projection}\navoidance = {avoidance}\n\
                 field = {{ kind = {kind}, gain = {gain}, influence = {influence}, \
                 approach_damping = {approach} }}\n"
                )
            },
        )
}

/// References of every kind that stay within 0.5 m of the base, where these arms can put any pose.
fn references(m: usize) -> impl Strategy<Value = String> {
    let near = || between(-0.2, 0.2);
    let point = move || list(m, near());
    let orientation = if m == 3 { "orientation = 0.4" } else { "" };
    let knots = move || {
        (2..5_usize).prop_flat_map(move |count| {
            let times =
                (0..count).map(|i| format!("{:?}", 0.01 * i as f64)).collect::<Vec<_>>().join(", ");
            list(count, point())
                .prop_map(move |points| format!("times = [{times}]\npoints = {points}"))
        })
    };
    prop_oneof![
        point().prop_map(|point| format!("kind = \"setpoint\"\npoint = {point}")),
        list(m, list(3, near())).prop_map(|axes| format!("kind = \"polynomial\"\ncoefficients = {axes}")),
        (point(), point(), between(0.01, 2.0)).prop_map(|(start, end, duration)| {
            format!("kind = \"line\"\nstart = {start}\nend = {end}\nduration = {duration}")
        }),
        (list(2, near()), between(0.01, 0.2), between(-5.0, 5.0)).prop_map(move |(center, radius, speed)| {
            format!(
                "kind = \"circle\"\ncenter = {center}\nradius = {radius}\nangular_velocity = {speed}\n{orientation}"
            )
        }),
        (list(2, near()), list(2, near()), list(2, between(-5.0, 5.0))).prop_map(move |(center, size, speed)| {
            format!(
                "kind = \"lissajous\"\ncenter = {center}\namplitude = {size}\nangular_frequency = {speed}\n{orientation}"
            )
        }),
        knots().prop_map(|knots| format!("kind = \"waypoints\"\n{knots}")),
        knots().prop_map(|knots| format!("kind = \"table\"\n{knots}")),
    ]
    .prop_map(|body| format!("[reference]\n{body}\n"))
}

/// An obstacle of any shape and motion, as often as not in the middle of the arm.
fn obstacles() -> impl Strategy<Value = String> {
    let size = || between(0.05, 0.5);
    let shape = prop_oneof![
        size().prop_map(|radius| format!("{{ kind = \"circle\", radius = {radius} }}")),
        (size(), size()).prop_map(|(x, r)| format!(
            "{{ kind = \"capsule\", a = [0, 0], b = [{x}, 0.1], radius = {r} }}"
        )),
        list(2, size()).prop_map(|size| format!("{{ kind = \"box\", size = {size} }}")),
        size().prop_map(|x| format!(
            "{{ kind = \"polygon\", vertices = [[0, 0], [{x}, 0], [0.1, 0.3]] }}"
        )),
    ];
    let two = || list(2, between(-2.0, 2.0));
    let motion = prop_oneof![
        Just("{ kind = \"static\" }".to_owned()),
        two().prop_map(|velocity| format!("{{ kind = \"linear\", velocity = {velocity} }}")),
        (two(), between(-9.0, 9.0)).prop_map(|(size, speed)| {
            format!("{{ kind = \"sinusoid\", amplitude = {size}, angular_frequency = {speed} }}")
        }),
    ];
    let turns = (between(-9.0, 9.0), 0usize..3);
    (shape, two(), between(-7.0, 7.0), motion, two(), any::<bool>(), turns).prop_map(
        |(shape, position, angle, motion, to, walks, (rate, turns))| {
            let angles =
                if turns == 1 { format!(", angles = [{angle}, {rate}]") } else { String::new() };
            let walk = format!("{{ kind = \"waypoints\", times = [0, 0.02], points = [{position}, {to}]{angles} }}");
            let motion = if walks { walk } else { motion };
            let spin = if turns == 2 { format!("angular_velocity = {rate}\n") } else { String::new() };
            format!("[[obstacles]]\nshape = {shape}\nposition = {position}\nangle = {angle}\nmotion = {motion}\n{spin}")
        },
    )
}

/// Whole scenarios that are right in every part.
fn valid() -> impl Strategy<Value = String> {
    let simulation = prop_oneof![
        (1..5_usize, words(&["hold", "predictor"])).prop_map(|(every, control)| {
            format!("control = {control}\ncontrol_every = {every}\n")
        }),
        Just("control = \"continuous\"\n".to_owned()),
    ];
    let numerics = (simulation, words(&["rk4", "semi_implicit_euler"]), 1..5_usize);
    (4..9_usize, 2..=3_usize, numerics).prop_flat_map(|(n, m, (control, integrator, record))| {
        let angles = || list(n, between(-3.0, 3.0));
        let reality = realities(n, !control.contains("continuous"));
        let parts = (arms(n), controllers(n, m), references(m), vec(obstacles(), 0..4), reality);
        (angles(), angles(), parts).prop_map(move |(q0, dq0, (arm, controller, reference, obstacles, reality))| {
            format!(
                "duration = 0.05\nq0 = {q0}\ndq0 = {dq0}\n{arm}{controller}{reference}{}[simulation]\n\
                 {control}integrator = {integrator}\nrecord_every = {record}\n{reality}",
                obstacles.concat()
            )
        })
    })
}

proptest! {
    #![proptest_config(config(4000))]

    /// They are accepted, run to their end, and twice to the same bits.
    #[test]
    fn valid_scenarios_run(text in valid()) {
        let scenario = Scenario::from_toml(&text).map_err(|error| TestCaseError::fail(error.to_string()))?;
        let outcome = run(&scenario).ok_or_else(|| TestCaseError::fail("refused"))?;
        validate(&outcome);
        let rows = 50 / scenario.simulation.record_every + 1;
        prop_assert!(outcome.record.rows == rows || outcome.status == Status::Diverged);
        let again = run(&scenario).unwrap();
        prop_assert_eq!(outcome.status, again.status);
        prop_assert!(bits(&outcome.record.q) == bits(&again.record.q));
        prop_assert!(bits(&outcome.record.tau) == bits(&again.record.tau));
    }
}

/// What the bundled scenarios do not have: one of these tables takes the place of the controller's.
const CONTROLLERS: &[&str] = &[
    "avoidance = 'cbf'\nyielding = { preview = {} }",
    "avoidance = 'cbf'\nyielding = { rate = 40.0, margin = 0.02, activation = 1.2, task_weight = 20.0, \
     slack_weight = 4e4, speed = 6.0, preview = { period = 0.02, horizon = 1.2, trigger = 1.2, steps = 16, \
     candidates = 64, clearance = 0.1, speed = 1.0 } }\ndamping = 8.0\nnull_damping = 2.0",
    "avoidance = 'cbf'\nself_collision = 'avoid'",
    "avoidance = 'priority'\nyielding = { rate = 20.0, margin = 0.02, inner = 0.05, outer = 0.3 }",
    "avoidance = 'relaxed'\nyielding = { saturation = 0.5, inner = 0.05, outer = 0.3 }",
    "tank = { capacity = 5.0, initial = 1.0, floor = 0.1 }",
    "enforce_limits = true\ndamping = 8.0",
    "governor = { inner = 0.01, outer = 0.2, rate = 30.0, floor = 0.1 }",
    "field = { kind = 'khatib', gain = 50.0, influence = 0.6, floor = 0.05, approach_damping = 0.5, sliding = 5.0 }",
    "formulation = 'extended_jacobian'",
];

/// Every number of a document that is one of a setting, each to be changed.
fn numbers<'a>(value: &'a mut Toml, found: &mut Vec<&'a mut Toml>) {
    match value {
        Toml::Array(values) => values.iter_mut().for_each(|value| numbers(value, found)),
        Toml::Table(table) => table.iter_mut().for_each(|(_, value)| numbers(value, found)),
        Toml::Float(_) | Toml::Integer(_) => found.push(value),
        _ => {}
    }
}

/// A scenario with up to eight of its numbers scaled by powers of ten, sometimes all of a table at once.
fn scaled(seed: u64) -> Table {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = |count: usize| (random.next_u64() % count as u64) as usize;
    let mut table: Table = SEEDS[draw(SEEDS.len())].parse().unwrap();
    let mut simulation =
        table.get("simulation").and_then(Toml::as_table).cloned().unwrap_or_default();
    if draw(2) == 0 {
        let controller: Table = CONTROLLERS[draw(CONTROLLERS.len())].parse().unwrap();
        let old = table.entry("controller").or_insert_with(|| Table::new().into());
        let old = old.as_table_mut().unwrap();
        old.extend(controller);
    }
    if draw(4) == 0 {
        let modes = ["hold", "predictor", "continuous"];
        simulation.insert("control".into(), modes[draw(3)].into());
        table.insert("simulation".into(), simulation.into());
    }
    if draw(4) == 0 {
        let arm = table["arm"].as_table_mut().unwrap();
        arm.insert("velocity_limits".into(), Toml::Float(2.0));
        arm.insert("torque_limits".into(), Toml::Float(50.0));
    }
    // The length of the run is no setting that breaks anything.
    table.insert("duration".into(), Toml::Float(0.05));
    let mut whole = Toml::Table(table);
    let parts: Vec<String> = whole.as_table().unwrap().keys().cloned().collect();
    let part = (draw(6) == 0).then(|| parts[draw(parts.len())].clone());
    let mut found = vec![];
    match &part {
        Some(part) => numbers(&mut whole[part.as_str()], &mut found),
        None => numbers(&mut whole, &mut found),
    }
    let power = |draw: &mut dyn FnMut(usize) -> usize| {
        let small = draw(2) == 0;
        let reach = if small { 3 } else { 18 };
        10_f64.powi(draw(2 * reach + 1) as i32 - reach as i32)
    };
    let (together, several) = (power(&mut draw), 1 + draw(8));
    let count = found.len();
    for k in 0..if part.is_some() { count } else { several.min(count) } {
        let (which, by) = match part {
            Some(_) => (k, together),
            None => (draw(count), power(&mut draw)),
        };
        let scaled = match &*found[which] {
            Toml::Integer(number) => *number as f64 * by,
            other => other.as_float().unwrap() * by,
        };
        *found[which] = match &*found[which] {
            Toml::Integer(_) if (1.0..9e18).contains(&scaled) => Toml::Integer(scaled as i64),
            Toml::Integer(number) => Toml::Integer(*number),
            _ => Toml::Float(scaled),
        };
    }
    match whole {
        Toml::Table(table) => table,
        _ => unreachable!(),
    }
}

thread_local! {
    static BEGUN: Cell<Option<Duration>> = const { Cell::new(None) };
}

/// The longest that one step, or preparing, may take, in processor time.
const LONGEST: Duration = Duration::from_secs(5);

/// Whether what was begun last has not taken too long.
fn in_time() -> bool {
    BEGUN.get().is_none_or(|begun| worked() - begun < 2 * LONGEST)
}

/// Prepares and runs a scenario for up to [`STEPS`] steps. `Ok(false)` if it is refused.
fn survives(document: &Table) -> Result<bool, String> {
    let begin = || BEGUN.set(Some(worked()));
    let slow = |what: &str| match worked() - BEGUN.get().unwrap() {
        taken if taken > LONGEST => panic!("{what} takes {taken:?}"),
        _ => {}
    };
    let run = || {
        begin();
        let scenario = Scenario::from_document(document);
        slow("reading");
        let ready = scenario.and_then(|mut scenario| {
            scenario.duration = scenario.duration.min(STEPS * scenario.simulation.dt);
            begin();
            scenario.prepare()
        });
        slow("preparing");
        let mut ready = match ready {
            Ok(ready) => ready,
            Err(error) => {
                assert!(is_told(&error), "{error:?}");
                return false;
            }
        };
        loop {
            begin();
            let over = !ready.run.step();
            slow("a step");
            if over {
                break;
            }
        }
        validate(&ready.run.outcome());
        true
    };
    let done = catch_unwind(AssertUnwindSafe(|| watched(Watch::Ask(in_time), run)));
    match done {
        Ok(Ok(ran)) => Ok(ran),
        Ok(Err(_)) => Err("a hang".into()),
        Err(panic) => Err(panic
            .downcast_ref::<String>()
            .cloned()
            .or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()))
            .unwrap_or_default()),
    }
}

/// `VFF_CASES` scenarios from the seed `VFF_SEED` on: what is found is told with its seed.
#[test]
#[ignore = "as long as one likes"]
fn scaled_scenarios_run_or_are_refused() {
    let number = |name: &str, default| {
        std::env::var(name).map_or(default, |text| text.parse::<u64>().expect("a whole number"))
    };
    let (cases, first) = (number("VFF_CASES", 10_000), number("VFF_SEED", 0));
    let (mut ran, mut faults) = (0, 0);
    for seed in first..first + cases {
        match survives(&scaled(seed)) {
            Ok(accepted) => ran += u64::from(accepted),
            Err(fault) => {
                faults += 1;
                println!("seed {seed}: {fault}");
            }
        }
        if (seed - first) % 10_000 == 9_999 {
            println!("{} cases, {ran} ran, {faults} faults", seed - first + 1);
        }
    }
    println!("{cases} cases from {first}, {ran} ran, {faults} faults");
    assert_eq!(faults, 0);
}

proptest! {
    #![proptest_config(config(3000))]

    /// The same, with seeds that are new every time.
    #[test]
    fn settings_of_any_size_run_or_are_refused(seed in any::<u64>()) {
        let done = survives(&scaled(seed));
        prop_assert!(done.is_ok(), "seed {}: {:?}", seed, done);
    }
}

/// Seeds of [`scaled`] at which something was wrong once.
#[test]
fn what_was_found_stays_mended() {
    for seed in FOUND {
        let done = survives(&scaled(*seed));
        assert!(done.is_ok(), "seed {seed}: {done:?}");
    }
}

const FOUND: &[u64] = &[];

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// A text with one line replaced by another, refused or run as every other.
fn refused_or_sane(seed: &str, line: &str, by: &str) {
    assert_eq!(seed.matches(line).count(), 1, "{line}");
    let scenario = Scenario::from_toml(&seed.replace(line, by));
    if let Some(outcome) = scenario.ok().and_then(|scenario| run(&scenario)) {
        validate(&outcome);
    }
}

/// Before its numbers are scaled, every controller is one that runs: what is refused would find nothing.
#[test]
fn controllers_are_valid() {
    for controller in CONTROLLERS {
        let table: Table = controller.parse().unwrap();
        let mut document: Table = include_str!("scenarios/crowd.toml").parse().unwrap();
        document["controller"].as_table_mut().unwrap().extend(table);
        // What fills or hears from sample to sample needs samples.
        let simulation = document["simulation"].as_table_mut().unwrap();
        simulation.insert("control".into(), "hold".into());
        let scenario =
            Scenario::from_document(&document).unwrap_or_else(|e| panic!("{controller}: {e}"));
        assert!(run(&scenario).is_some(), "{controller}");
    }
}

/// The seeds are what they claim to be, and all of them run.
#[test]
fn seeds_are_valid() {
    for seed in SEEDS {
        let outcome = run(&Scenario::from_toml(seed).unwrap()).unwrap();
        validate(&outcome);
        assert_ne!(outcome.status, Status::Diverged, "{}", outcome.message);
    }
}

/// Nesting without end is refused before it has used up the stack.
#[test]
fn deep_nesting_is_refused() {
    let deep = 100_000;
    for text in [
        format!("q0 = {}{}", "[".repeat(deep), "]".repeat(deep)),
        format!("arm = {}", "{ a = ".repeat(deep)),
        format!("{}a = 1", "a.".repeat(deep)),
        format!("[{}a]", "a.".repeat(deep)),
    ] {
        assert!(is_told(&Scenario::from_toml(&text).unwrap_err()));
    }
}

// Faults that were found by the above.

/// 0.8 m within 5e-324 s was an infinite velocity, and the obstacle's position not a number.
#[test]
fn waypoints_at_infinite_speed() {
    let line =
        r#"motion = { kind = "waypoints", times = [0.0, 1.0], points = [[2.0, 1.8], [2.0, 1.0]] }"#;
    refused_or_sane(EVERYTHING, line, &line.replace("1.0], p", "5e-324], p"));
}

/// Forces of 1e308 N were recorded as infinite ones, in a run that had collided but not diverged.
#[test]
fn a_force_beyond_all_numbers() {
    let text = SEEDS[2].replace("gain = 50.0 ", "gain = 1e308 ");
    refused_or_sane(&text, "position = [3.22, 0.3] ", "position = [0.0, 0.0] ");
}

/// An obstacle with 1e308 m/s was infinitely far away after two seconds, and the run completed.
#[test]
fn an_obstacle_beyond_all_numbers() {
    let text = SEEDS[8].replace("dt = 1e-3 ", "dt = 2 ");
    refused_or_sane(&text, "velocity = [0.0, -0.35]", "velocity = [1e308, -0.35]");
}

/// A field 1e-308 m wide made a torque that is not a number; in the last row it was recorded.
#[test]
fn a_field_thinner_than_all_numbers() {
    let text = SEEDS[8].replace("dt = 1e-3 ", "dt = 2 ");
    refused_or_sane(&text, "influence = 0.6 ", "influence = 1e-308 ");
}
