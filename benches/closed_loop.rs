//! The closed loop, per plant step, as `simulate` runs it: obstacles and reference move, every pair
//! of link and obstacle is measured, the law is evaluated, the plant is integrated, every row is
//! recorded and every metric is updated.
//!
//! `cargo bench --bench closed_loop`

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use std::fmt::Write as _;
use std::hint::black_box;
use std::time::{Duration, Instant};
use vff_core::control::Avoidance;
use vff_core::control::avoidance::preview::PreviewSettings;
use vff_core::scenario::{AnyRun, Scenario};

/// Plant steps of one run; a longer measurement begins another run, outside the measured time.
const STEPS: u64 = 2000;

/// A scene of the same size whatever the number of joints: 6 m and 6 kg of arm, its tip on a
/// circle, `obstacles` discs that swing beside the links.
fn scene(n: usize, obstacles: usize, simulation: &str) -> Scenario {
    let places = |joints: &[[f64; 2]]| beside(joints).into_iter().take(obstacles).collect();
    furnished(n, places, true, simulation)
}

/// The same with 6 joints, 5 of the discs in the field and all others beyond it. Only the first
/// and the last row are recorded: a row holds the position of every disc.
fn crowd(discs: usize, moving: bool) -> Scenario {
    let places = |joints: &[[f64; 2]]| {
        let mut places = beside(joints);
        places.truncate(5);
        places.extend(beyond(joints).into_iter().take(discs - 5));
        places
    };
    furnished(6, places, moving, &format!("{EULER}, record_every = {STEPS}"))
}

fn furnished(
    n: usize,
    places: impl Fn(&[[f64; 2]]) -> Vec<[f64; 2]>,
    moving: bool,
    simulation: &str,
) -> Scenario {
    let length = 6.0 / n as f64;
    let angle = |i: usize| if i == 0 { 1.2 } else { -2.0 / (n - 1) as f64 };
    let (mut theta, mut joints) = (0.0, vec![[0.0, 0.0]]);
    for i in 0..n {
        theta += angle(i);
        let [x, y] = joints[i];
        joints.push([x + length * f64::cos(theta), y + length * f64::sin(theta)]);
    }
    let [x, y] = joints[n];
    let q0: Vec<f64> = (0..n).map(angle).collect();
    let mut text = format!(
        "duration = {duration}\n\
         q0 = {q0:?}\n\
         arm = {{ lengths = {lengths:?}, masses = {length} }}\n\
         reference = {{ kind = 'circle', center = [{center}, {y}], radius = 0.2, \
                        angular_velocity = 1.0 }}\n\
         controller = {{ stiffness = 100, damping = 20, null_damping = 6, \
                         field = {{ kind = 'khatib', gain = 0.2, influence = 0.6 }} }}\n\
         simulation = {{ dt = 1e-3, {simulation} }}\n",
        duration = STEPS as f64 * 1e-3,
        lengths = vec![length; n],
        center = x - 0.2,
    );
    for (j, [x, y]) in places(&joints).into_iter().enumerate() {
        let _ = write!(
            text,
            "[[obstacles]]\n\
             shape = {{ kind = 'circle', radius = 0.1 }}\n\
             position = [{x}, {y}]\n"
        );
        if moving {
            let _ = writeln!(
                text,
                "motion = {{ kind = 'sinusoid', amplitude = [0.03, 0.05], \
                             angular_frequency = 2.0, phase = {j} }}"
            );
        }
    }
    Scenario::from_toml(&text).expect("a scene that can be run")
}

/// Distance from a place to the axis of the arm.
fn distance(joints: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    let to_link = |pair: &[[f64; 2]]| {
        let ([ax, ay], [bx, by]) = (pair[0], pair[1]);
        let (dx, dy) = (bx - ax, by - ay);
        let s = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy);
        let s = s.clamp(0.0, 1.0);
        f64::hypot(x - ax - s * dx, y - ay - s * dy)
    };
    joints.windows(2).map(to_link).fold(f64::INFINITY, f64::min)
}

/// The places of a grid of `side` × `side` that keep `gap` from the axis of the arm, the nearest
/// first.
fn grid(joints: &[[f64; 2]], side: u32, gap: f64, corner: [f64; 2]) -> Vec<[f64; 2]> {
    let at = |i: u32, k: u32| [corner[0] + 0.3 * f64::from(i), corner[1] + 0.3 * f64::from(k)];
    let all = (0..side).flat_map(|i| (0..side).map(move |k| at(i, k)));
    let mut places: Vec<_> = all.filter(|place| distance(joints, *place) > gap).collect();
    places.sort_by(|a, b| distance(joints, *a).total_cmp(&distance(joints, *b)));
    places
}

fn beside(joints: &[[f64; 2]]) -> Vec<[f64; 2]> {
    grid(joints, 40, 0.4, [0.0, -5.0])
}

/// Out of the reach of the field, whatever the arm does in a run.
fn beyond(joints: &[[f64; 2]]) -> Vec<[f64; 2]> {
    grid(joints, 110, 1.5, [-13.0, -16.0])
}

fn prepare(scenario: &Scenario) -> AnyRun {
    scenario.prepare().expect("a scene that can be run").run
}

/// The run reaches its end, and the field works in it.
fn check(scenario: &Scenario) {
    let mut run = prepare(scenario);
    let mut taken = 0;
    while run.step() {
        taken += 1;
    }
    assert_eq!(taken, STEPS);
    let outcome = run.outcome();
    assert_eq!(outcome.status.name(), "completed", "{}", outcome.message);
    assert!(outcome.record.force.iter().any(|f| *f > 0.1), "no force worth the name");
}

/// Time of `iterations` steps.
fn steps(scenario: &Scenario, iterations: u64) -> Duration {
    let mut elapsed = Duration::ZERO;
    let mut left = iterations;
    while left > 0 {
        let mut run = prepare(scenario);
        let now = left.min(STEPS);
        let start = Instant::now();
        for _ in 0..now {
            black_box(run.step());
        }
        elapsed += start.elapsed();
        left -= now;
    }
    elapsed
}

const EULER: &str = "integrator = 'semi_implicit_euler', control = 'hold'";

fn closed_loop(c: &mut Criterion) {
    let mut group = c.benchmark_group("closed_loop");
    let mut measure = |name: &str, parameter: usize, scenario: &Scenario| {
        check(scenario);
        group.bench_function(BenchmarkId::new(name, parameter), |b| {
            b.iter_custom(|iterations| steps(scenario, iterations));
        });
    };
    for n in [6, 10, 12, 24, 50, 100] {
        measure("euler-hold/joints", n, &scene(n, 1, EULER));
    }
    for (name, simulation) in [
        ("rk4-hold/joints", "integrator = 'rk4', control = 'hold'"),
        ("rk4-continuous/joints", "integrator = 'rk4', control = 'continuous'"),
    ] {
        measure(name, 6, &scene(6, 1, simulation));
    }
    for discs in [1, 8] {
        // Every pair is a row, and the margin is so wide that some rows always act.
        let mut scenario = scene(6, discs, EULER);
        scenario.controller.avoidance = Avoidance::Cbf;
        scenario.controller.yielding.activation = 100.0;
        scenario.controller.yielding.margin = 0.45;
        measure("euler-hold-cbf/discs", discs, &scenario);
    }
    for discs in [1, 8] {
        // A look every 20 ms; what a look costs is in the average.
        let mut scenario = scene(6, discs, EULER);
        scenario.controller.avoidance = Avoidance::Cbf;
        scenario.controller.yielding.preview = Some(PreviewSettings::default());
        measure("euler-hold-preview/discs", discs, &scenario);
        // Alarmed all the time: no roll-out ever keeps the margin.
        scenario.controller.yielding.margin = 0.45;
        scenario.controller.yielding.preview =
            Some(PreviewSettings { alarm: 1.2, clearance: 0.6, ..PreviewSettings::default() });
        measure("euler-hold-preview-alarmed/discs", discs, &scenario);
    }
    for obstacles in [1, 10, 100] {
        measure("euler-hold/obstacles", obstacles, &scene(6, obstacles, EULER));
    }
    for discs in [10, 100, 1000, 10_000] {
        measure("euler-hold/static", discs, &crowd(discs, false));
        measure("euler-hold/moving", discs, &crowd(discs, true));
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(40)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_millis(2500));
    targets = closed_loop
}
criterion_main!(benches);
