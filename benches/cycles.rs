//! What one control cycle costs, scene by scene and method by method: every cycle of a run is timed on its own.
//!
//! `cargo bench --bench cycles` prints a table; `cycles SCENE METHOD COUNT` takes so many steps and says nothing, for
//! programs that count instructions.

#[expect(dead_code, reason = "what other benches time")]
mod panda;
#[expect(dead_code, reason = "what other benches time")]
mod scene;

use scene::{EULER, STEPS, looking, prepare};
use std::fmt::Write as _;
use std::hint::black_box;
use std::time::Instant;
use vff_core::control::{Avoidance, Deadline, Yielding};
use vff_core::interrupt;
use vff_core::scenario::Scenario;
use vff_core::simulation::Value;

/// Equal runs of each scene: enough for each cycle to be left alone in one of them.
const RUNS: usize = 40;

/// Points of a wall of so many \[m\], 1.6 m wide and high, in the plane y = −`away`: rough by 2 mm.
fn wall(count: usize, away: f64) -> String {
    let side = (count as f64).sqrt();
    let point = |k: usize| {
        let k = k as f64;
        let (u, v) = ((k / side).fract(), (k / side).floor() / side);
        let ripple = 2e-3 * (31.0 * u).sin() * (17.0 * v).cos();
        [1.6 * u - 0.6, -away + ripple, 1.6 * v - 0.3]
    };
    let points: Vec<_> = (0..count).map(point).collect();
    format!("[[obstacles]]\nshape = {{ kind = 'points', points = {points:?}, radius = 0.01 }}\n")
}

/// A Panda that leads its hand along a line which is so long \[m\] in y, to and fro.
fn beside(obstacles: &str, end: [f64; 3]) -> Scenario {
    let mut text = format!(
        "duration = {duration}\n\
         q0 = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]\n\
         arm = {{ model = 'panda' }}\n\
         reference = {{ kind = 'line', end = {end:?}, duration = 1.0 }}\n\
         controller = {{ task = 'position', stiffness = 400, damping = 40, null_damping = 6, \
                         field = {{ kind = 'bounded', gain = 5, influence = 0.05 }} }}\n\
         simulation = {{ dt = 1e-3, {EULER} }}\n",
        duration = STEPS as f64 * 1e-3,
    );
    let _ = write!(text, "{obstacles}");
    Scenario::from_toml(&text).expect("a scene that can be run")
}

/// Scene by scene.
fn scenes() -> Vec<(&'static str, Scenario)> {
    let still = [0.32, 0.0, 0.6];
    vec![
        ("8 balls", panda::scene(8)),
        ("8 balls, one at the base", plain(panda::searching(8))),
        ("8 balls, of boxes", panda::of_boxes(panda::scene(8))),
        ("8 balls, of boxes, one at the base", plain(panda::of_boxes(panda::searching(8)))),
        ("8 balls, of boxes, apart", panda::apart(panda::of_boxes(panda::scene(8)))),
        ("5000 points at 0.34 m", beside(&wall(5000, 0.435), still)),
        ("50000 points at 0.3 m", beside(&wall(50_000, 0.395), still)),
        ("50000 points at 0.1 m", beside(&wall(50_000, 0.195), still)),
        ("5000 points, held up", beside(&wall(5000, 0.3), [0.4, -0.6, 0.5])),
        ("50000 points, held up", beside(&wall(50_000, 0.3), [0.4, -0.6, 0.5])),
    ]
}

/// The same by the law of the null space alone.
fn plain(mut scenario: Scenario) -> Scenario {
    scenario.controller.avoidance = Avoidance::NullSpace;
    scenario.controller.yielding = Yielding::default();
    scenario
}

/// A name, and what makes a scenario use it.
type Method = (&'static str, fn(Scenario) -> Scenario);

fn methods() -> [Method; 4] {
    [
        ("null_space", |scenario| scenario),
        ("cbf", |mut scenario| {
            scenario.controller.avoidance = Avoidance::Cbf;
            scenario
        }),
        ("cbf + preview", looking),
        ("cbf + preview, 100 µs", |scenario| {
            let mut scenario = looking(scenario);
            scenario.controller.deadline = Some(Deadline::Micros(100.0));
            scenario
        }),
    ]
}

/// Times of the single steps of `runs` equal runs \[ns\], and the least of every step in all of them: what the step itself
/// takes, whatever else the machine did meanwhile. What `begin` returns takes a step, and says whether there was one.
fn times<F: FnMut() -> bool>(runs: usize, begin: impl Fn() -> F) -> [Vec<u64>; 2] {
    let (mut all, mut least) = (vec![], vec![u64::MAX; STEPS as usize]);
    for _ in 0..runs {
        let mut step = begin();
        for least in &mut least {
            let start = Instant::now();
            if !black_box(step()) {
                break;
            }
            let time = start.elapsed().as_nanos() as u64;
            all.push(time);
            *least = time.min(*least);
        }
    }
    least.retain(|time| *time < u64::MAX);
    all.sort_unstable();
    least.sort_unstable();
    [all, least]
}

/// A step of some ten microseconds that is always the same: by it one sees what the machine does meanwhile.
fn a_thousand_roots() -> bool {
    black_box((0..1000).fold(black_box(2.0_f64), |x, _| (x + 1.0).sqrt())) > 0.0
}

/// The time \[µs\] that so many per cent of these \[ns\] stay within.
fn at(times: &[u64], share: f64) -> f64 {
    let rank = (share / 100.0 * times.len() as f64).ceil() as usize;
    times[rank.clamp(1, times.len()) - 1] as f64 * 1e-3
}

fn main() {
    let arguments: Vec<_> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let silent = |mut scenario: Scenario| {
        scenario.simulation.record_every = STEPS as usize;
        scenario
    };
    if let [which, method, count] = &arguments[..] {
        let (_, scenario) = scenes().into_iter().find(|(name, _)| name == which).expect("a scene");
        let (_, how) = methods().into_iter().find(|(name, _)| name == method).expect("a method");
        let mut run = prepare(&silent(how(scenario)));
        let count: u64 = count.parse().expect("a whole number");
        (0..count).for_each(|_| assert!(black_box(run.step())));
        return;
    }
    // `cargo bench -- --test` only wants to know whether it runs.
    let runs = if std::env::args().any(|a| a == "--test") { 1 } else { RUNS };
    let columns = ["p50", "p99.9", "p99.99", "max", "p50*", "p99.9*", "max*", "work"];
    println!(
        "one cycle of {runs} runs of {STEPS} [µs], plant included; * the least time of the same cycle in all runs;\n\
         work: the most that one of them reports, as a deadline counts it [µs]; late, cut, roll-outs left out; clearance [m]"
    );
    println!("{:58}{}", "", columns.map(|c| format!("{c:>10}")).concat());
    let shown = |[all, least]: [Vec<u64>; 2]| {
        let of_all = [50.0, 99.9, 99.99, 100.0].map(|share| at(&all, share));
        let of_least = [50.0, 99.9, 100.0].map(|share| at(&least, share));
        let shares = of_all.iter().chain(&of_least).map(|time| format!("{time:10.1}"));
        shares.collect::<String>()
    };
    println!(
        "{:58}{}",
        "a thousand roots, one after the other",
        shown(times(runs, || a_thousand_roots))
    );
    for (name, scenario) in scenes() {
        for (method, how) in methods() {
            let scenario = silent(how(scenario.clone()));
            let mut run = prepare(&scenario);
            let mut work = 0;
            loop {
                let before = interrupt::spent();
                if !run.step() {
                    break;
                }
                work = work.max(interrupt::spent().wrapping_sub(before));
            }
            let metrics = run.outcome().metrics;
            let told = |name| match metrics.iter().find(|(metric, _)| metric.name == name) {
                Some((_, Value::Number(x))) => format!("{x:.4}"),
                Some((_, Value::Count(count))) => count.to_string(),
                _ => "–".to_owned(),
            };
            let names = ["late_cycles", "cut_cycles", "rollouts_left_out", "min_clearance"];
            let told = names.map(told).join(" ");
            let shares = shown(times(runs, || {
                let mut run = prepare(&scenario);
                move || run.step()
            }));
            let work = work as f64 * 1e-3;
            println!("{:58}{shares}{work:10.1}  {told}", format!("{name}, {method}"));
        }
    }
}
