//! The dual active-set method against the conditions of optimality and against Clarabel, an
//! interior-point method that shares nothing with it, on QPs of every kind.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT,
};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};
use vff_core::control::quadratic_program::{Outcome, Problem, QuadraticProgram};

/// A QP with its own memory.
#[derive(Debug, Clone)]
struct Owned {
    n: usize,
    hessian: DMatrix<f64>,
    gradient: Vec<f64>,
    normals: Vec<Vec<f64>>,
    bounds: Vec<f64>,
    softness: Vec<f64>,
}

impl Owned {
    fn solve(&self) -> (Outcome, QuadraticProgram) {
        let normals = self.normals.concat();
        let mut solver = QuadraticProgram::new(self.n, self.bounds.len(), self.bounds.len());
        let outcome = solver.solve(&Problem {
            hessian: self.hessian.as_slice(),
            gradient: &self.gradient,
            normals: &normals,
            bounds: &self.bounds,
            softness: &self.softness,
            spared: 0,
        });
        (outcome, solver)
    }

    fn soft(&self) -> Vec<usize> {
        (0..self.softness.len()).filter(|&i| self.softness[i] > 0.0).collect()
    }

    /// ½xᵀHx + gᵀx + Σ ½δ²/s with the smallest δ that x allows.
    fn value(&self, x: &[f64]) -> f64 {
        let v = DVector::from_column_slice(x);
        let delta = |i: usize| (self.bounds[i] - dot(&self.normals[i], x)).max(0.0);
        let price: f64 =
            self.soft().iter().map(|&i| 0.5 * delta(i).powi(2) / self.softness[i]).sum();
        0.5 * v.dot(&(&self.hessian * &v)) + dot(&self.gradient, x) + price
    }

    /// The same by Clarabel, the δ as unknowns of their own; None if it gives up.
    fn oracle(&self) -> Option<(SolverStatus, Vec<f64>, f64)> {
        let (n, soft, m) = (self.n, self.soft(), self.bounds.len());
        let size = n + soft.len();
        let mut p = DMatrix::zeros(size, size);
        p.view_mut((0, 0), (n, n)).copy_from(&self.hessian);
        let mut a = DMatrix::zeros(m, size);
        for (i, normal) in self.normals.iter().enumerate() {
            a.view_mut((i, 0), (1, n))
                .copy_from_slice(&normal.iter().map(|x| -x).collect::<Vec<_>>());
        }
        for (k, &i) in soft.iter().enumerate() {
            p[(n + k, n + k)] = 1.0 / self.softness[i];
            a[(i, n + k)] = -1.0;
        }
        let mut q = self.gradient.clone();
        q.resize(size, 0.0);
        let b: Vec<f64> = self.bounds.iter().map(|b| -b).collect();
        let cones: Vec<SupportedConeT<f64>> = vec![NonnegativeConeT(m)];
        let settings = DefaultSettings {
            verbose: false,
            tol_gap_abs: 1e-11,
            tol_gap_rel: 1e-11,
            tol_feas: 1e-11,
            ..DefaultSettings::default()
        };
        let (p, a) = (sparse(&p.upper_triangle()), sparse(&a));
        let mut solver = DefaultSolver::new(&p, &q, &a, &b, &cones, settings).ok()?;
        solver.solve();
        let solution = &solver.solution;
        Some((solution.status, solution.x[..n].to_vec(), solution.obj_val))
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

fn sparse(dense: &DMatrix<f64>) -> CscMatrix<f64> {
    let (mut colptr, mut rowval, mut nzval) = (vec![0], vec![], vec![]);
    for column in dense.column_iter() {
        for (row, value) in column.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            rowval.push(row);
            nzval.push(*value);
        }
        colptr.push(rowval.len());
    }
    CscMatrix::new(dense.nrows(), dense.ncols(), colptr, rowval, nzval)
}

/// What the rows of a QP are made of.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Fresh,
    /// The same as an earlier row.
    Copy,
    /// An earlier one times a number, with another bound.
    Parallel,
    /// The sum of two earlier ones.
    Sum,
    Zero,
}

fn kind() -> impl Strategy<Value = Kind> {
    prop_oneof![
        8 => Just(Kind::Fresh),
        1 => Just(Kind::Copy),
        1 => Just(Kind::Parallel),
        1 => Just(Kind::Sum),
        1 => Just(Kind::Zero),
    ]
}

/// QPs of `scaled` decades of unequal scales. Bounds are drawn around a point, so that about
/// half of those with hard rows alone are feasible.
fn qp(scaled: f64) -> impl Strategy<Value = Owned> {
    (1usize..15, prop_oneof![0usize..8, 0usize..101], 0.0..1.0f64, -2.0..1.0f64)
        .prop_flat_map(move |(n, m, softened, shift)| {
            let one = || -1.0..1.0f64;
            (
                prop::collection::vec(one(), n * n),
                prop::collection::vec(one(), n),
                prop::collection::vec(one(), n),
                prop::collection::vec(-scaled..=scaled, n),
                prop::collection::vec((prop::collection::vec(one(), n), one(), kind()), m),
                prop::collection::vec(
                    (
                        0.0..1.0f64,
                        prop_oneof![Just(1e-4), Just(1.0)],
                        -scaled..=scaled,
                        0usize..100,
                    ),
                    m,
                ),
                Just((n, softened, shift)),
            )
        })
        .prop_map(|(factor, gradient, centre, scales, rows, extras, (n, softened, shift))| {
            let scales: Vec<f64> = scales.iter().map(|s| 10f64.powf(*s)).collect();
            let factor = DMatrix::from_vec(n, n, factor);
            let scale = DMatrix::from_diagonal(&DVector::from_column_slice(&scales));
            let core = &factor * factor.transpose() + DMatrix::identity(n, n) * 0.05;
            let hessian = &scale * core * &scale;
            let gradient: Vec<f64> =
                gradient.iter().zip(&scales).map(|(g, s)| 3.0 * g * s).collect();
            let (mut normals, mut bounds, mut softness) = (vec![], vec![], vec![]);
            for ((normal, offset, kind), (chance, soft, size, pick)) in rows.into_iter().zip(extras)
            {
                let earlier =
                    |k: usize, normals: &Vec<Vec<f64>>| normals[k % normals.len()].clone();
                let fresh: Vec<f64> = normal.iter().zip(&scales).map(|(a, s)| a * s).collect();
                let size = 10f64.powf(size);
                let (normal, bound) = match kind {
                    Kind::Copy if !normals.is_empty() => {
                        (earlier(pick, &normals), bounds[pick % bounds.len()])
                    }
                    Kind::Parallel if !normals.is_empty() => {
                        let a: Vec<f64> =
                            earlier(pick, &normals).iter().map(|x| offset * x).collect();
                        let b = offset * bounds[pick % bounds.len()] - 0.1 * offset.abs();
                        (a, b)
                    }
                    Kind::Sum if !normals.is_empty() => {
                        let (a, b) = (earlier(pick, &normals), earlier(pick / 7, &normals));
                        let sum = a.iter().zip(&b).map(|(a, b)| a + b).collect();
                        (sum, bounds[pick % bounds.len()] + bounds[(pick / 7) % bounds.len()])
                    }
                    Kind::Zero => (vec![0.0; n], offset.min(0.0)),
                    _ => {
                        let at: f64 = normal.iter().zip(&centre).map(|(a, c)| a * c).sum();
                        (
                            fresh.iter().map(|a| size * a).collect(),
                            size * (at + 0.4 * (offset + shift)),
                        )
                    }
                };
                normals.push(normal);
                bounds.push(bound);
                softness.push(if chance < softened { soft } else { 0.0 });
            }
            Owned { n, hessian, gradient, normals, bounds, softness }
        })
}

/// Hx + g = Σ u a, u ≥ 0, rows fulfilled, u only where they hold with equality: with H > 0 these are
/// enough for the one minimum. Residuals relative to the terms that they are the sums of.
fn check_optimality(
    p: &Owned,
    solver: &QuadraticProgram,
    tolerance: f64,
) -> Result<(), TestCaseError> {
    let x = solver.x();
    let v = DVector::from_column_slice(x);
    let mut gradient = &p.hessian * &v;
    let mut size = DVector::from_fn(p.n, |i, _| {
        p.hessian.row(i).iter().zip(x).map(|(h, x)| (h * x).abs()).sum::<f64>()
            + p.gradient[i].abs()
    });
    gradient += DVector::from_column_slice(&p.gradient);
    let mut multipliers = vec![0.0; p.bounds.len()];
    for (row, u) in solver.active() {
        prop_assert!(u >= 0.0);
        multipliers[row] = u;
        gradient -= DVector::from_column_slice(&p.normals[row]) * u;
        size += DVector::from_iterator(p.n, p.normals[row].iter().map(|a| (a * u).abs()));
    }
    for i in 0..p.n {
        let residual = gradient[i].abs() / size[i].max(1e-300);
        prop_assert!(residual <= tolerance, "stationarity {residual:e}");
    }
    // Rounding gives every multiplier an error in proportion to the largest.
    let largest = multipliers.iter().copied().fold(0.0, f64::max);
    for (row, u) in multipliers.iter().enumerate() {
        let residual = dot(&p.normals[row], x) + p.softness[row] * u - p.bounds[row];
        let terms = norm(&p.normals[row]) * norm(x)
            + p.bounds[row].abs()
            + p.softness[row] * (u + 1e-4 * largest);
        prop_assert!(residual >= -tolerance * terms, "row {row} by {residual:e} of {terms:e}");
        if *u > 0.0 {
            prop_assert!(residual <= tolerance * terms, "loose row {row} pulls: {residual:e}");
        }
    }
    Ok(())
}

/// Counts of outcomes, so that a generator that makes one kind only is noticed.
#[derive(Debug, Default)]
struct Seen {
    solved: usize,
    infeasible: usize,
    compared: usize,
    longest: usize,
}

fn check(p: &Owned, tolerance: f64, seen: &mut Seen) -> Result<(), TestCaseError> {
    let (outcome, solver) = p.solve();
    seen.longest = seen.longest.max(solver.iterations());
    match outcome {
        Outcome::Solved => {
            seen.solved += 1;
            check_optimality(p, &solver, tolerance)?;
        }
        Outcome::Infeasible => seen.infeasible += 1,
        other => prop_assert!(false, "{other:?} after {} iterations", solver.iterations()),
    }
    let Some((status, x, value)) = p.oracle() else { return Ok(()) };
    match (outcome, status) {
        (Outcome::Solved, SolverStatus::Solved) => {
            seen.compared += 1;
            let size = 1.0 + value.abs();
            prop_assert!((p.value(solver.x()) - value).abs() <= 1e-7 * size, "{value}");
            // In the norm of H, in which a gap of the values bounds the distance of the points.
            let apart = DVector::from_iterator(p.n, x.iter().zip(solver.x()).map(|(a, b)| a - b));
            let apart = apart.dot(&(&p.hessian * &apart)).sqrt();
            prop_assert!(apart <= 1e-4 * size.sqrt(), "{apart:e} apart");
        }
        (Outcome::Infeasible, SolverStatus::PrimalInfeasible) => seen.compared += 1,
        (Outcome::Solved, SolverStatus::PrimalInfeasible)
        | (Outcome::Infeasible, SolverStatus::Solved) => {
            prop_assert!(false, "{outcome:?}, but {status:?}");
        }
        _ => {} // Clarabel reached less than the accuracy asked for.
    }
    Ok(())
}

fn run(cases: u32, scaled: f64, tolerance: f64) -> Seen {
    let mut seen = Seen::default();
    let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]);
    let mut runner = TestRunner::new_with_rng(ProptestConfig::default(), rng);
    let strategy = qp(scaled);
    let mut faults = vec![];
    for case in 0..cases {
        let qp = strategy.new_tree(&mut runner).expect("a QP").current();
        if let Err(fault) = check(&qp, tolerance, &mut seen) {
            faults.push(format!("{case} ({}, {}): {fault}", qp.n, qp.bounds.len()));
        }
    }
    assert!(faults.is_empty(), "{} faults: {:#?}", faults.len(), &faults[..faults.len().min(20)]);
    assert!(seen.solved > cases as usize / 4 && seen.infeasible > cases as usize / 50, "{seen:?}");
    assert!(seen.compared > cases as usize * 9 / 10, "{seen:?}");
    seen
}

/// Ten thousand QPs of one to 14 unknowns and none to 100 rows, hard and soft, among them
/// copies, multiples, sums and zeros of rows.
#[test]
fn random_qps() {
    run(10_000, 0.0, 1e-9);
}

/// Unknowns and rows whose scales differ by up to six decades: H has a condition of 10¹².
#[test]
fn badly_scaled_qps() {
    run(4_000, 1.5, 1e-8);
}

/// Of soft constraints that may be passed over the most violated have room; the others are as if they were not there, and none that
/// may not be passed over falls out.
#[test]
fn what_has_no_room_is_passed_over() {
    let bounds = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 3.5];
    let mut normals = DMatrix::<f64>::identity(6, 6).as_slice().to_vec();
    normals.extend([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let solve = |bounds: &[f64], room: [usize; 2]| {
        let hessian = DMatrix::<f64>::identity(6, 6);
        let problem = Problem {
            hessian: hessian.as_slice(),
            gradient: &[0.0; 6],
            normals: &normals,
            bounds,
            softness: &[1e-3; 7],
            spared: 6,
        };
        let mut solver = QuadraticProgram::sparing(6, 7, room);
        (solver.solve(&problem), solver.x().to_vec())
    };
    let (outcome, crowded) = solve(&bounds, [4, 3]);
    assert_eq!(outcome, Outcome::Crowded);
    let (outcome, fewer) = solve(&[-1.0, -1.0, -1.0, 4.0, 5.0, 6.0, 3.5], [7, 6]);
    assert_eq!(outcome, Outcome::Solved);
    for (a, b) in crowded.iter().zip(&fewer) {
        assert!((a - b).abs() < 1e-12, "{crowded:?} {fewer:?}");
    }
    assert!(crowded[0] > 3.4 && crowded[1].abs() < 1e-12 && crowded[5] > 5.9, "{crowded:?}");
    assert_eq!(solve(&bounds, [7, 6]).0, Outcome::Solved);
}
