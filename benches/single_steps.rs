//! The slowest steps of the closed loop, which an average does not show: every step is timed on its own.
//!
//! `cargo bench --bench single_steps`

mod panda;
mod scene;

use scene::{EULER, STEPS, barriers, prepare, preview, scene, searching};
use std::fmt::Write as _;
use std::hint::black_box;
use std::time::Instant;
use vff_core::scenario::Scenario;

/// Equal runs of each scene, and times of the clock alone.
const RUNS: usize = 100;
const TICKS: usize = 200_000;

/// Times of the single steps of `runs` equal runs [ns], and the least of every step in all of them: what the
/// step itself takes, whatever else the machine did meanwhile. A control loop records nothing, nor do they.
fn times(scenario: &Scenario, runs: usize) -> [Vec<u64>; 2] {
    let mut scenario = scenario.clone();
    scenario.simulation.record_every = STEPS as usize;
    let (mut all, mut least) = (vec![], vec![u64::MAX; STEPS as usize]);
    for _ in 0..runs {
        let mut run = prepare(&scenario);
        for least in &mut least {
            let time = timed(|| assert!(run.step()));
            all.push(time);
            *least = time.min(*least);
        }
    }
    all.sort_unstable();
    least.sort_unstable();
    [all, least]
}

/// How long it takes [ns], the clock included.
fn timed<T>(work: impl FnOnce() -> T) -> u64 {
    let start = Instant::now();
    black_box(work());
    start.elapsed().as_nanos() as u64
}

/// The time [µs] that so many per cent of these [ns] stay within.
fn at(times: &[u64], share: f64) -> f64 {
    let rank = (share / 100.0 * times.len() as f64).ceil() as usize;
    times[rank.clamp(1, times.len()) - 1] as f64 * 1e-3
}

fn main() {
    // `cargo bench -- --test` only wants to know whether it runs.
    let timing = !std::env::args().any(|a| a == "--test");
    let runs = if timing { RUNS } else { 1 };
    let mut clock: Vec<_> = (0..TICKS).map(|_| timed(|| ())).collect();
    clock.sort_unstable();
    let mut table = vec![("the clock alone".to_owned(), [clock.clone(), vec![clock[0]]])];
    for n in [6, 9] {
        for (what, scenario) in [
            ("1 disc", scene(n, 1, EULER)),
            ("1 disc, cbf", barriers(n, 1)),
            ("8 discs, cbf", barriers(n, 8)),
            ("8 discs, cbf + preview", preview(n, 8)),
            ("8 discs, cbf + preview, searching", searching(n, 8)),
        ] {
            table.push((format!("{n} joints, {what}"), times(&scenario, runs)));
        }
    }
    for (what, scenario) in [
        ("1 ball", panda::scene(1)),
        ("1 ball, cbf", panda::barriers(1)),
        ("8 balls, cbf", panda::barriers(8)),
        ("8 balls, cbf + preview", panda::preview(8)),
        ("8 balls, cbf + preview, searching", panda::searching(8)),
        ("8 balls, cbf, apart", panda::apart(panda::barriers(8))),
        ("of boxes, 8 balls, cbf", panda::of_boxes(panda::barriers(8))),
        ("of boxes, 8 balls, cbf + preview", panda::of_boxes(panda::preview(8))),
        ("of boxes, 8 balls, cbf, apart", panda::apart(panda::of_boxes(panda::barriers(8)))),
    ] {
        table.push((format!("Panda, pose, {what}"), times(&scenario, runs)));
    }
    let columns = ["mean", "p50", "p99", "p99.9", "max", "p99.9*", "max*"];
    println!("single steps of {runs} runs [µs]; * the least time of the same step in all of them");
    println!("{:48}{}", "", columns.map(|c| format!("{c:>9}")).concat());
    let mut json = String::new();
    for (name, [all, least]) in &table {
        let times = [
            all.iter().sum::<u64>() as f64 / all.len() as f64 * 1e-3,
            at(all, 50.0),
            at(all, 99.0),
            at(all, 99.9),
            at(all, 100.0),
            at(least, 99.9),
            at(least, 100.0),
        ];
        println!("{name:48}{}", times.map(|t| format!("{t:9.2}")).concat());
        let comma = if json.is_empty() { "" } else { ",\n" };
        let times = times.map(|t| format!("{t:.3}")).join(", ");
        let _ = write!(json, "{comma}  {name:?}: [{times}]");
    }
    if timing {
        // For benches/table.py.
        let file = concat!(env!("CARGO_TARGET_TMPDIR"), "/single_steps.json");
        std::fs::write(file, format!("{{\n{json}\n}}\n")).expect("a file that can be written");
    }
}
