//! The closed loop, per plant step, as `simulate` runs it: obstacles and reference move, every pair
//! of link and obstacle is measured, the law is evaluated, the plant is integrated, every row is
//! recorded and every metric is updated.
//!
//! `cargo bench --bench closed_loop`

mod scene;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use scene::{EULER, STEPS, barriers, beside, furnished, grid, prepare, preview, scene, searching};
use std::hint::black_box;
use std::time::{Duration, Instant};
use vff_core::scenario::Scenario;

/// The scene with 6 joints, 5 of the discs in the field and all others beyond it. Only the first
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

/// Out of the reach of the field, whatever the arm does in a run.
fn beyond(joints: &[[f64; 2]]) -> Vec<[f64; 2]> {
    grid(joints, 110, 1.5, [-13.0, -16.0])
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
    // A disc at the base, which triggers the search, is a collision from the beginning.
    let ends = ["completed", "collided"];
    assert!(ends.contains(&outcome.status.name()), "{}", outcome.message);
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
        measure("euler-hold-cbf/discs", discs, &barriers(6, discs));
    }
    for discs in [1, 8] {
        // What a planning cycle costs is in the average.
        measure("euler-hold-preview/discs", discs, &preview(6, discs));
        measure("euler-hold-preview-searching/discs", discs, &searching(6, discs));
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
