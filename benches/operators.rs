//! Every operator of an arm alone, the two forms of the law, and the distance to every shape.
//!
//! `cargo bench --bench operators`

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::SVector;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;
use vff_core::control::quadratic_program::{Outcome, Problem, QuadraticProgram};
use vff_core::control::{Controller, Formulation, Gains, OperationalSpace, Settings, TaskMetric};
use vff_core::geometry::Body;
use vff_core::math::{Capsule, Vector};
use vff_core::robot::planar::Link;
use vff_core::robot::{Manipulator, Model, PlanarArm, PlanarState, Robot};
use vff_core::trajectory::Sample;
use vff_core::world::plane::{Obstacle, Shape, World};

/// Numbers in (−1, 1), the same in every run.
fn numbers(n: usize, seed: f64) -> Vec<f64> {
    (0..n).map(|i| f64::sin(seed + 2.399 * i as f64)).collect()
}

/// 6 m and 6 kg of arm under gravity at a bent, moving state.
fn arm(n: usize) -> PlanarState {
    let link = Link::rod(6.0 / n as f64, 6.0 / n as f64);
    let mut state = Arc::new(PlanarArm::new(vec![link; n], Vector::<2>::new(0.0, -9.81))).state();
    state.update(&numbers(n, 0.3), &numbers(n, 0.7));
    state
}

type Group<'a> = BenchmarkGroup<'a, WallTime>;

fn operators(c: &mut Criterion) {
    let mut group = c.benchmark_group("operators");
    for n in [6, 100] {
        let robot = arm(n);
        on_joints(&mut group, &robot);
        on_the_task(&mut group, &robot);
        on_points(&mut group, &robot);
    }
    group.finish();
}

fn on_joints(group: &mut Group<'_>, robot: &PlanarState) {
    let n = robot.dof();
    let id = |name: &str| BenchmarkId::new(name, n);
    let (q, v) = (numbers(n, 0.3), numbers(n, 1.1));
    let (mut out, mut scratch) = (vec![0.0; n], vec![0.0; n]);
    let mut moving = robot.clone();
    group.bench_function(id("update"), |b| b.iter(|| moving.update(black_box(&q), black_box(&v))));
    group.bench_function(id("integrate"), |b| {
        b.iter(|| robot.integrate(&mut out, black_box(&v), 1e-3));
    });
    group.bench_function(id("mass_mul"), |b| b.iter(|| robot.mass_mul(black_box(&v), &mut out)));
    group
        .bench_function(id("mass_solve"), |b| b.iter(|| robot.mass_solve(black_box(&v), &mut out)));
    group.bench_function(id("coriolis_mul"), |b| {
        b.iter(|| robot.coriolis_mul(black_box(&v), &mut out));
    });
    group.bench_function(id("coriolis_tr_mul"), |b| {
        b.iter(|| robot.coriolis_tr_mul(black_box(&v), &mut out));
    });
    group.bench_function(id("gravity_torque"), |b| b.iter(|| robot.gravity_torque(&mut out)));
    group.bench_function(id("inverse_dynamics"), |b| {
        b.iter(|| robot.inverse_dynamics(black_box(&v), &mut scratch, &mut out));
    });
    group.bench_function(id("forward_dynamics"), |b| {
        b.iter(|| robot.forward_dynamics(black_box(&v), &mut scratch, &mut out));
    });
    group.bench_function(id("accelerate"), |b| {
        b.iter(|| robot.accelerate(black_box(&v), &q, &mut scratch, &mut out));
    });
    group.bench_function(id("potential_energy"), |b| b.iter(|| robot.potential_energy()));
    group.bench_function(id("matrices"), |b| b.iter(|| robot.matrices::<2>()));
}

fn on_the_task(group: &mut Group<'_>, robot: &PlanarState) {
    let n = robot.dof();
    let id = |name: &str| BenchmarkId::new(name, n);
    let (v, f) = (numbers(n, 1.1), SVector::<f64, 2>::new(0.4, -0.7));
    let mut out = vec![0.0; n];
    let mut y = vec![SVector::<f64, 2>::zeros(); n];
    group.bench_function(id("pose"), |b| b.iter(|| Manipulator::<2, 2>::pose(robot)));
    group.bench_function(id("jacobian_mul"), |b| {
        b.iter(|| robot.jacobian_mul::<2>(black_box(&v)));
    });
    group.bench_function(id("jacobian_tr_mul"), |b| {
        b.iter(|| robot.jacobian_tr_mul(black_box(&f), &mut out));
    });
    group.bench_function(id("jacobian_dot_mul"), |b| {
        b.iter(|| robot.jacobian_dot_mul::<2>(black_box(&v)));
    });
    group.bench_function(id("jacobian_dot_tr_mul"), |b| {
        b.iter(|| robot.jacobian_dot_tr_mul(black_box(&f), &mut out));
    });
    group.bench_function(id("task_response"), |b| b.iter(|| robot.task_response(&mut y)));
}

fn on_points(group: &mut Group<'_>, robot: &PlanarState) {
    let n = robot.dof();
    let id = |name: &str| BenchmarkId::new(name, n);
    // The middle of the last link: the operators run over the whole arm.
    let last = n - 1;
    let link = robot.link(last);
    let point = (link.start + link.end()) * 0.5;
    let force = Vector::<2>::new(0.6, 0.8);
    let mut out = vec![0.0; n];
    let mut wrenches = vec![<PlanarState as Robot<2>>::Wrench::default(); n];
    group.bench_function(id("link"), |b| b.iter(|| robot.link(black_box(last))));
    group.bench_function(id("point_velocity"), |b| {
        b.iter(|| robot.point_velocity(last, black_box(&point)));
    });
    group.bench_function(id("point_jacobian_tr_mul"), |b| {
        b.iter(|| robot.point_jacobian_tr_mul(last, black_box(&point), &force, &mut out));
    });
    group.bench_function(id("point_bias_acceleration"), |b| {
        b.iter(|| robot.point_bias_acceleration(last, black_box(&point)));
    });
    group.bench_function(id("point_mobility"), |b| {
        b.iter(|| robot.point_mobility(last, black_box(&point), &force));
    });
    group.bench_function(id("add_force"), |b| {
        b.iter(|| robot.add_force(&mut wrenches, last, black_box(&point), &force));
    });
    group.bench_function(id("wrenches_tr_mul"), |b| {
        b.iter(|| robot.wrenches_tr_mul(black_box(&wrenches), &mut out));
    });
}

/// The law alone, both forms, where the arm and the forces on it are known already.
fn law(c: &mut Criterion) {
    let mut group = c.benchmark_group("law");
    let reference = Sample {
        x: Vector::<2>::new(1.0, 2.0),
        dx: Vector::<2>::new(0.1, 0.2),
        ddx: Vector::<2>::new(0.3, -0.2),
    };
    for n in [6, 100] {
        let robot = arm(n);
        let mut space =
            OperationalSpace::<2>::new(n, 1e-3 / robot.total_mass(), TaskMetric::new::<2>(1.0));
        group.bench_function(BenchmarkId::new("operational_space", n), |b| {
            b.iter(|| space.refresh(black_box(&robot)));
        });
        for (name, formulation) in [
            ("recursive", Formulation::Recursive),
            ("extended_jacobian", Formulation::ExtendedJacobian),
        ] {
            let settings = Settings { formulation, ..Settings::default() };
            let mut controller = Controller::<_, 2, 2>::new(arm(n), Gains::new(&settings));
            controller.observe(robot.configuration(), robot.velocity(), &mut World::new(vec![]));
            group.bench_function(BenchmarkId::new(name, n), |b| {
                b.iter(|| controller.command(black_box(&reference)).total[0]);
            });
        }
    }
    group.finish();
}

/// One link against one obstacle, averaged over links all around it.
fn proximity(c: &mut Criterion) {
    let shapes = [
        ("circle", Shape::Circle { radius: 0.3 }),
        ("capsule", Shape::Capsule { a: [-0.4, 0.0], b: [0.4, 0.1], radius: 0.2 }),
        ("box", Shape::Box { size: [0.8, 0.5] }),
        (
            "polygon-8",
            Shape::Polygon {
                vertices: (0..8)
                    .map(|k| f64::from(k) * std::f64::consts::FRAC_PI_4)
                    .map(|angle| [0.4 * angle.cos(), 0.4 * angle.sin()])
                    .collect(),
            },
        ),
    ];
    let coordinates = numbers(256, 0.1);
    let links: Vec<_> = coordinates
        .chunks_exact(4)
        .map(|c| {
            let (start, end) = (Vector::<2>::new(c[0], c[1]), Vector::<2>::new(c[2], c[3]));
            Body::new(0, Capsule::new(start * 2.0, end * 2.0, 0.05))
        })
        .collect();
    let mut group = c.benchmark_group("proximity");
    for (name, shape) in shapes {
        let world = World::new(vec![Obstacle { angle: 0.3, ..Obstacle::of(shape) }]);
        let mut next = links.iter().cycle();
        group.bench_function(name, |b| {
            b.iter(|| next.next().map(|link| world.contact(0, black_box(link), 0)));
        });
    }
    group.finish();
}

/// A QP of 6 unknowns: rows that all hold, and rows that nearly hold at a common point, so that
/// several act in the end.
fn quadratic_program(c: &mut Criterion) {
    let mut group = c.benchmark_group("quadratic_program");
    let n = 6;
    let hessian: Vec<f64> = (0..n * n)
        .map(|k| if k % (n + 1) == 0 { 2.0 } else { 0.3 * f64::sin((k / n * (k % n)) as f64) })
        .collect();
    for rows in [6, 60] {
        let mut program = QuadraticProgram::new(n, rows, rows);
        let normals = numbers(n * rows, 0.4);
        let softness = vec![1e-4; rows];
        let point = numbers(n, 1.3);
        let at = |a: &[f64]| a.iter().zip(&point).map(|(a, x)| a * x).sum::<f64>() - 0.1;
        let acting: Vec<f64> = normals.chunks_exact(n).map(at).collect();
        for (name, bounds) in [("idle", vec![-5.0; rows]), ("acting", acting)] {
            let problem = Problem {
                hessian: &hessian,
                gradient: &[0.0; 6],
                normals: &normals,
                bounds: &bounds,
                softness: &softness,
                spared: 0,
            };
            assert_eq!(program.solve(&problem), Outcome::Solved);
            group.bench_function(BenchmarkId::new(name, rows), |b| {
                b.iter(|| program.solve(black_box(&problem)));
            });
        }
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(150))
        .measurement_time(Duration::from_millis(500));
    targets = operators, law, proximity, quadratic_program
}
criterion_main!(benches);
