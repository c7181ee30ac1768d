//! A cloud of 50 000 points, or 10 000 balls that swing, around a Panda: how long other points take to be made ready and to
//! be swapped in, and a step of the closed loop beside the few that are near.
//!
//! `cargo bench --bench cloud`

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use std::fmt::Write as _;
use std::hint::black_box;
use std::time::{Duration, Instant};
use vff_core::scenario::Scenario;
use vff_core::world::CollisionQuery;
use vff_core::world::space::{MAX_POINTS, Obstacle, Points, Shape, World};

/// What a depth camera might see: points of a table and of three walls, none of them near the arm, and `near` beside its
/// elbow.
fn points(near: usize) -> Vec<[f64; 3]> {
    let mut points: Vec<_> = (0..near).map(|k| [-0.05, -0.22 - 0.01 * k as f64, 0.62]).collect();
    let count = MAX_POINTS - near;
    let side = (count as f64 / 4.0).sqrt();
    for k in 0..count {
        let (sheet, k) = (k % 4, (k / 4) as f64);
        let (u, v) = ((k / side).fract(), (k / side).floor() / side);
        let ripple = 2e-3 * (31.0 * u).sin() * (17.0 * v).cos();
        let (u, v) = (3.0 * u - 1.5, 3.0 * v);
        points.push(match sheet {
            0 => [u, v - 1.5, -0.6 + ripple],
            1 => [u, 1.4 + ripple, v - 0.6],
            2 => [u, -1.4 + ripple, v - 0.6],
            _ => [1.6 + ripple, u, v - 0.6],
        });
    }
    points
}

fn obstacle(points: Vec<[f64; 3]>) -> Obstacle {
    Obstacle::of(Shape::Points { points, radius: 0.01 })
}

/// Balls that swing, five of them where those points are.
fn balls() -> String {
    let mut text = String::new();
    for (k, [x, y, z]) in points(5).into_iter().take(10_000).enumerate() {
        let _ = writeln!(
            text,
            "[[obstacles]]
             shape = {{ kind = 'sphere', radius = 0.01 }}
             position = [{x}, {y}, {z}]
             motion = {{ kind = 'sinusoid', amplitude = [0.01, 0.0, 0.01], angular_frequency = 2.0, phase = {k} }}"
        );
    }
    text
}

/// The Panda holds a position or the pose of its hand among these obstacles.
fn scenario(task: &str, avoidance: &str, obstacles: &str) -> Scenario {
    let mut text = format!(
        "duration = 4.0
         q0 = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]
         arm = {{ model = 'panda' }}
         reference = {{ kind = 'setpoint' }}
         controller = {{ task = '{task}', stiffness = 400.0, damping = 40.0, avoidance = '{avoidance}',
                         field = {{ kind = 'bounded', gain = 5.0, influence = 0.25 }} }}
         simulation = {{ integrator = 'semi_implicit_euler', control = 'hold', record_every = 4000 }}
        "
    )
    .replace("\n         ", "\n")
    .replace(",\n                ", ", ");
    text.push_str(obstacles);
    Scenario::from_toml(&text).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// Time of `iterations` steps; another run begins outside the measured time.
fn timed(scenario: &Scenario, iterations: u64) -> Duration {
    let (mut elapsed, mut left) = (Duration::ZERO, iterations);
    while left > 0 {
        let mut run = scenario.prepare().unwrap().run;
        let now = left.min(4000);
        let start = Instant::now();
        for _ in 0..now {
            black_box(run.step());
        }
        elapsed += start.elapsed();
        left -= now;
    }
    elapsed
}

fn replacement(c: &mut Criterion) {
    let mut group = c.benchmark_group("cloud");
    let rest = [1.0, 0.0, 0.0, 0.0];
    group.bench_function("made ready/50000", |b| {
        b.iter_batched(|| points(5), |given| Points::new(given, rest), BatchSize::LargeInput);
    });
    let mut world = World::new(vec![obstacle(points(5))]);
    let mut other = Points::new(points(3), rest);
    group.bench_function("swapped in/50000", |b| {
        b.iter(|| black_box(world.swap_points(0, &mut other)));
    });
    assert_eq!(world.contact_count(), MAX_POINTS);
    group.finish();
}

fn steps(c: &mut Criterion) {
    let mut group = c.benchmark_group("cloud");
    let cloud = format!(
        "[[obstacles]]\nshape = {{ kind = 'points', points = {:?}, radius = 0.01 }}\n",
        points(5)
    );
    let ball = "[[obstacles]]\nshape = { kind = 'sphere', radius = 0.01 }\nposition = [-0.05, -0.22, 0.62]\n";
    let around = [
        ("nothing", String::new()),
        ("one ball", ball.to_owned()),
        ("5 of 50000", cloud),
        ("5 of 10000 balls that swing", balls()),
    ];
    for (task, avoidance) in
        [("position", "null_space"), ("pose", "null_space"), ("position", "cbf")]
    {
        for (name, obstacles) in &around {
            let scenario = scenario(task, avoidance, obstacles);
            group.bench_function(format!("step/{task}/{avoidance}/{name}"), |b| {
                b.iter_custom(|iterations| timed(&scenario, iterations));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, replacement, steps);
criterion_main!(benches);
