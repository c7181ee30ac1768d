//! A small dense convex quadratic program (QP) by the dual active-set method.
//!
//! ```text
//! min ½ xᵀHx + gᵀx + Σ ½ δ_i²/s_i     so that     a_i·x + δ_i ≥ b_i
//! ```
//!
//! A constraint of softness s_i = 0 is hard (δ_i = 0); a soft constraint may be violated by δ_i at a cost, so that a QP
//! whose hard constraints do not contradict each other always has a solution.
//!
//! The method of D. Goldfarb and A. Idnani (*A numerically stable dual method for solving strictly
//! convex quadratic programs*, 1983) starts from the minimum without constraints and adds violated constraints one
//! by one, dropping those whose multipliers would become negative. Most instants of a controller need one
//! constraint or none, and the method needs no feasible point to start from. It keeps
//! `JᵀHJ = I` and `JᵀN = [R; 0]` for the normals N of the active constraints, R upper triangular.

use crate::interrupt;

/// What is to be minimised, and under which constraints: m of them, n unknowns.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// H, (n, n) row by row, symmetric and positive definite; its lower triangle is read.
    pub hessian: &'a [f64],
    /// g, (n).
    pub gradient: &'a [f64],
    /// The normals a_i, (m, n) row by row.
    pub normals: &'a [f64],
    /// The bounds b_i, (m).
    pub bounds: &'a [f64],
    /// s_i ≥ 0, (m): 0 for a hard constraint.
    pub softness: &'a [f64],
    /// So many constraints, the first, are passed over where there is no room for their δ: of those that are violated at once the
    /// ones that are violated less.
    pub spared: usize,
}

/// How the solution of a QP ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// At its minimum.
    Solved,
    /// The hard constraints contradict each other.
    Infeasible,
    /// H is not positive definite.
    NotConvex,
    /// At its minimum without constraints for which there was no room ([`Problem::spared`]).
    Crowded,
    /// Not finished within the allowed number of iterations or of violated soft constraints; the unknowns are those of
    /// the QP without the constraints that were not reached.
    Unfinished,
}

/// The solver with its workspace; nothing allocates after [`new`](Self::new)
/// and [`reserve`](Self::reserve).
///
/// ```
/// use vff_core::control::quadratic_program::{Outcome, Problem, QuadraticProgram};
///
/// // The point nearest to (0, 0) whose coordinates add up to 2 or more.
/// let problem = Problem {
///     hessian: &[1.0, 0.0, 0.0, 1.0],
///     gradient: &[0.0, 0.0],
///     normals: &[1.0, 1.0],
///     bounds: &[2.0],
///     softness: &[0.0],
///     spared: 0,
/// };
/// let mut program = QuadraticProgram::new(2, 1, 0);
/// assert_eq!(program.solve(&problem), Outcome::Solved);
/// assert!(program.x().iter().all(|x| (x - 1.0).abs() < 1e-12));
/// ```
#[derive(Debug, Clone)]
pub struct QuadraticProgram {
    n: usize,
    /// Number of unknowns with those δ that have become unknowns so far.
    size: usize,
    /// Length of a column of `j` and `r`.
    stride: usize,
    /// x, then the touched δ.
    x: Vec<f64>,
    /// J, column by column.
    j: Vec<f64>,
    /// R, column by column.
    r: Vec<f64>,
    /// Jᵀa of the constraint that is being added, and what becomes of it.
    d: Vec<f64>,
    /// Rates of change of the active constraints' multipliers.
    rates: Vec<f64>,
    /// Active constraints, in the order of the columns of R, and their multipliers.
    active: Vec<usize>,
    multipliers: Vec<f64>,
    /// Which unknown is the δ of a constraint, [`UNTOUCHED`] if none yet.
    slack: Vec<usize>,
    /// So many of the first may have one at most, and how many of them have.
    most_spared: usize,
    spared: usize,
    /// Constraints that the search passes over: active ones, and those that depend on active ones.
    passed: Vec<bool>,
    /// |a_i|.
    lengths: Vec<f64>,
    iterations: usize,
}

const UNTOUCHED: usize = usize::MAX;
/// A constraint counts as fulfilled within this part of the size of its terms.
const FULFILLED: f64 = 1e-12;
/// A normal whose part outside the active ones is smaller than this fraction depends on them.
const DEPENDENT: f64 = 1e-11;
/// A dependent constraint contradicts the active ones if it is violated by more than this part of its terms.
const CONTRADICTS: f64 = 1e-10;

impl QuadraticProgram {
    /// For `n` unknowns and at most so many `constraints`, `soft` of which may be violated on the way.
    pub fn new(n: usize, constraints: usize, soft: usize) -> Self {
        Self::sparing(n, constraints, [soft, soft])
    }

    /// The same where `soft` counts all of them, and those that may be [passed over](Problem::spared).
    pub fn sparing(n: usize, constraints: usize, [soft, most_spared]: [usize; 2]) -> Self {
        let stride = n + soft;
        Self {
            n,
            size: n,
            stride,
            x: vec![0.0; stride],
            j: vec![0.0; stride * stride],
            r: vec![0.0; stride * stride],
            d: vec![0.0; stride],
            rates: vec![0.0; stride],
            active: Vec::with_capacity(stride),
            multipliers: Vec::with_capacity(stride),
            slack: vec![UNTOUCHED; constraints],
            most_spared,
            spared: 0,
            passed: vec![false; constraints],
            lengths: vec![0.0; constraints],
            iterations: 0,
        }
    }

    /// Makes room for so many `constraints` in all; needed of a clone, too, before it can do without allocating.
    pub fn reserve(&mut self, constraints: usize) {
        self.active.clear();
        self.active.reserve(self.stride);
        self.multipliers.clear();
        self.multipliers.reserve(self.stride);
        if constraints > self.slack.len() {
            self.slack.resize(constraints, UNTOUCHED);
            self.passed.resize(constraints, false);
            self.lengths.resize(constraints, 0.0);
        }
    }

    /// The unknowns of the last QP.
    pub fn x(&self) -> &[f64] {
        &self.x[..self.n]
    }

    /// The constraints that hold with equality, δ included, and their multipliers, > 0.
    pub fn active(&self) -> impl Iterator<Item = (usize, f64)> {
        self.active.iter().copied().zip(self.multipliers.iter().copied())
    }

    /// How often a constraint was added or dropped.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// Solves a QP.
    ///
    /// # Panics
    /// If it has more constraints than there is room for, or a slice has the wrong length.
    pub fn solve(&mut self, problem: &Problem<'_>) -> Outcome {
        let (n, m) = (self.n, problem.bounds.len());
        assert_eq!(problem.normals.len(), n * m, "one normal per bound");
        assert_eq!(problem.softness.len(), m, "one softness per bound");
        self.size = n;
        self.iterations = 0;
        self.spared = 0;
        self.active.clear();
        self.multipliers.clear();
        self.slack[..m].fill(UNTOUCHED);
        self.passed[..m].fill(false);
        for (length, a) in self.lengths.iter_mut().zip(problem.normals.chunks_exact(n)) {
            *length = dot(a, a).sqrt();
        }
        if !self.factorise(problem.hessian) {
            return Outcome::NotConvex;
        }
        self.minimise_without_constraints(problem.gradient);

        let limit = 20 * (n + m) + 20;
        let mut outcome = Outcome::Solved;
        while let Some(constraint) = self.most_violated(problem) {
            if !self.touch(constraint, problem) {
                if constraint >= problem.spared {
                    return Outcome::Unfinished;
                }
                self.passed[constraint] = true;
                outcome = Outcome::Crowded;
                continue;
            }
            let mut multiplier = 0.0;
            loop {
                self.iterations += 1;
                interrupt::checkpoint(3 * self.size * self.size);
                if self.iterations > limit {
                    return Outcome::Unfinished;
                }
                let outside = self.directions(constraint, problem);
                let (dual, leaving) = self.longest_dual_step();
                let violation = -self.residual(constraint, problem);
                if outside == 0.0 && leaving.is_none() {
                    self.polish(problem);
                    if -self.residual(constraint, problem)
                        > CONTRADICTS * self.terms(constraint, problem)
                    {
                        return Outcome::Infeasible;
                    }
                    self.passed[constraint] = true;
                    break;
                }
                let primal = if outside > 0.0 { violation / outside } else { f64::INFINITY };
                let step = primal.min(dual).max(0.0);
                multiplier += step;
                for (u, rate) in self.multipliers.iter_mut().zip(&self.rates) {
                    *u = (*u - step * rate).max(0.0);
                }
                if outside > 0.0 {
                    self.advance(step);
                }
                match leaving {
                    Some(position) if dual < primal => self.drop_row(position),
                    _ => {
                        self.add(constraint, multiplier);
                        break;
                    }
                }
            }
        }
        self.polish(problem);
        outcome
    }

    /// J = L⁻ᵀ with H = LLᵀ; false if H is not positive definite.
    fn factorise(&mut self, hessian: &[f64]) -> bool {
        let (n, stride) = (self.n, self.stride);
        // L row by row in R, which is empty as yet.
        let l = &mut self.r;
        for i in 0..n {
            interrupt::checkpoint(i * i / 2);
            for k in 0..=i {
                let (done, rest) = l.split_at_mut(i * stride);
                let row_k = if k < i { &done[k * stride..k * stride + k] } else { &[] };
                let rest_i = &mut rest[..=i];
                if k < i {
                    let sum = hessian[i * n + k] - dot(row_k, &rest_i[..k]);
                    rest_i[k] = sum * done[k * stride + k];
                } else {
                    let pivot = hessian[i * n + i] - dot(&rest_i[..i], &rest_i[..i]);
                    // A pivot that is rounding error is none.
                    if pivot.is_nan() || pivot <= 4.0 * f64::EPSILON * hessian[i * n + i].abs() {
                        return false;
                    }
                    rest_i[i] = 1.0 / pivot.sqrt(); // its inverse, which is all that is needed
                }
            }
        }
        // Column k of L⁻ᵀ is row k of L⁻¹: forward substitution, one row after the other.
        for k in 0..n {
            interrupt::checkpoint(k * n);
            let (done, rest) = self.j.split_at_mut(k * stride);
            let row = &mut rest[..n];
            row.fill(0.0);
            let l = &self.r[k * stride..=k * stride + k];
            for (i, factor) in l[..k].iter().enumerate() {
                let inner = &done[i * stride..=i * stride + i];
                row.iter_mut().zip(inner).for_each(|(row, inner)| *row -= factor * inner);
            }
            row[..k].iter_mut().for_each(|x| *x *= l[k]);
            row[k] = l[k];
        }
        true
    }

    /// x = −J Jᵀ g.
    fn minimise_without_constraints(&mut self, gradient: &[f64]) {
        let (n, stride) = (self.n, self.stride);
        self.x[..n].fill(0.0);
        for column in self.j.chunks_exact(stride).take(n) {
            let along = dot(&column[..n], gradient);
            self.x.iter_mut().zip(&column[..n]).for_each(|(x, j)| *x -= along * j);
        }
    }

    /// a·x + δ − b.
    fn residual(&self, constraint: usize, problem: &Problem<'_>) -> f64 {
        let a = &problem.normals[constraint * self.n..(constraint + 1) * self.n];
        let delta = self.slack[constraint];
        let delta = if delta == UNTOUCHED { 0.0 } else { self.x[delta] };
        dot(a, &self.x[..self.n]) + delta - problem.bounds[constraint]
    }

    /// The size of the terms of [`residual`](Self::residual), against which it is small or not.
    fn terms(&self, constraint: usize, problem: &Problem<'_>) -> f64 {
        let x = &self.x[..self.n];
        self.lengths[constraint] * dot(x, x).sqrt() + problem.bounds[constraint].abs()
    }

    /// The constraint that lies farthest away from x on its wrong side.
    fn most_violated(&self, problem: &Problem<'_>) -> Option<usize> {
        interrupt::checkpoint(self.n * problem.bounds.len());
        let x = &self.x[..self.n];
        let size = dot(x, x).sqrt();
        let (mut worst, mut found) = (0.0, None);
        for (constraint, &bound) in problem.bounds.iter().enumerate() {
            if self.passed[constraint] {
                continue;
            }
            let length = self.lengths[constraint];
            let violation = -self.residual(constraint, problem);
            if violation > FULFILLED * (length * size + bound.abs()) {
                let distance = if length > 0.0 { violation / length } else { f64::INFINITY };
                if distance > worst {
                    (worst, found) = (distance, Some(constraint));
                }
            }
        }
        found
    }

    /// Gives a soft constraint its δ: one more unknown, with √s on the diagonal of J. False without room.
    fn touch(&mut self, constraint: usize, problem: &Problem<'_>) -> bool {
        let softness = problem.softness[constraint];
        if softness <= 0.0 || self.slack[constraint] != UNTOUCHED {
            return true;
        }
        let (new, stride) = (self.size, self.stride);
        let is_spared = constraint < problem.spared;
        if new == stride || is_spared && self.spared == self.most_spared {
            return false;
        }
        self.spared += usize::from(is_spared);
        for column in self.j.chunks_exact_mut(stride).take(new) {
            column[new] = 0.0;
        }
        let column = &mut self.j[new * stride..=new * stride + new];
        column.fill(0.0);
        column[new] = softness.sqrt();
        self.x[new] = 0.0;
        self.slack[constraint] = new;
        self.size += 1;
        true
    }

    /// d = Jᵀa; the multipliers' rates R⁻¹d₁. Returns |d₂|², the speed at which a step along
    /// z = J₂d₂ fulfils the constraint; 0 if the constraint depends on the active ones.
    fn directions(&mut self, constraint: usize, problem: &Problem<'_>) -> f64 {
        let (n, size, stride, q) = (self.n, self.size, self.stride, self.active.len());
        let a = &problem.normals[constraint * n..(constraint + 1) * n];
        let delta = self.slack[constraint];
        for (d, column) in self.d[..size].iter_mut().zip(self.j.chunks_exact(stride)) {
            *d = dot(a, &column[..n]) + if delta == UNTOUCHED { 0.0 } else { column[delta] };
        }
        self.rates[..q].copy_from_slice(&self.d[..q]);
        for k in (0..q).rev() {
            let column = &self.r[k * stride..=k * stride + k];
            let rate = self.rates[k] / column[k];
            self.rates[k] = rate;
            self.rates[..k].iter_mut().zip(column).for_each(|(x, r)| *x -= rate * r);
        }
        let inside = dot(&self.d[..q], &self.d[..q]);
        let outside = dot(&self.d[q..size], &self.d[q..size]);
        if outside <= DEPENDENT * DEPENDENT * (inside + outside) { 0.0 } else { outside }
    }

    /// How far the multipliers can go until one of them vanishes, and which.
    fn longest_dual_step(&self) -> (f64, Option<usize>) {
        let (mut step, mut leaving) = (f64::INFINITY, None);
        for (position, (u, rate)) in self.multipliers.iter().zip(&self.rates).enumerate() {
            if *rate > 0.0 && u / rate < step {
                (step, leaving) = (u / rate, Some(position));
            }
        }
        (step, leaving)
    }

    /// x += step · J₂d₂.
    fn advance(&mut self, step: f64) {
        let (size, stride, q) = (self.size, self.stride, self.active.len());
        for (d, column) in self.d[q..size].iter().zip(self.j.chunks_exact(stride).skip(q)) {
            let along = step * d;
            self.x[..size].iter_mut().zip(column).for_each(|(x, j)| *x += along * j);
        }
    }

    /// Makes a constraint active: a reflection of J₂ turns d₂ into a multiple of the first unit vector.
    fn add(&mut self, constraint: usize, multiplier: f64) {
        let (size, stride, q) = (self.size, self.stride, self.active.len());
        let norm = dot(&self.d[q..size], &self.d[q..size]).sqrt();
        let pivot = if self.d[q] > 0.0 { -norm } else { norm };
        // v = d₂ − pivot e₁; |v|² = −2 pivot v₁ without cancellation.
        self.d[q] -= pivot;
        let v = &self.d[q..size];
        let scale = -1.0 / (pivot * v[0]);
        if scale.is_finite() {
            let columns = &mut self.j[q * stride..size * stride];
            self.rates[..size].fill(0.0);
            for (v, column) in v.iter().zip(columns.chunks_exact(stride)) {
                self.rates[..size].iter_mut().zip(column).for_each(|(sum, j)| *sum += v * j);
            }
            for (v, column) in v.iter().zip(columns.chunks_exact_mut(stride)) {
                let by = -scale * v;
                column[..size].iter_mut().zip(&self.rates).for_each(|(j, sum)| *j += by * sum);
            }
        }
        let column = &mut self.r[q * stride..=q * stride + q];
        column[..q].copy_from_slice(&self.d[..q]);
        column[q] = pivot;
        self.active.push(constraint);
        self.multipliers.push(multiplier);
        self.passed[constraint] = true;
    }

    /// Drops an active constraint: rotations make what remains of R triangular again.
    fn drop_row(&mut self, position: usize) {
        let (size, stride) = (self.size, self.stride);
        self.passed[self.active.remove(position)] = false;
        self.multipliers.remove(position);
        let q = self.active.len();
        for k in position..q {
            // Column k + 1 moves to k; its element below the diagonal is turned away.
            self.r.copy_within((k + 1) * stride..=(k + 1) * stride + k + 1, k * stride);
        }
        for k in position..q {
            let (a, b) = (self.r[k * stride + k], self.r[k * stride + k + 1]);
            let norm = a.hypot(b);
            let (c, s) = if norm > 0.0 { (a / norm, b / norm) } else { (1.0, 0.0) };
            for column in k..q {
                let pair = &mut self.r[column * stride + k..column * stride + k + 2];
                (pair[0], pair[1]) = (c * pair[0] + s * pair[1], c * pair[1] - s * pair[0]);
            }
            let (left, right) = self.j[k * stride..].split_at_mut(stride);
            for (x, y) in left[..size].iter_mut().zip(right) {
                (*x, *y) = (c * *x + s * *y, c * *y - s * *x);
            }
        }
    }

    /// Takes the rounding error out of the active constraints: x −= J₁R⁻ᵀ(residuals).
    fn polish(&mut self, problem: &Problem<'_>) {
        let (size, stride) = (self.size, self.stride);
        for k in 0..self.active.len() {
            let column = &self.r[k * stride..=k * stride + k];
            let residual = self.residual(self.active[k], problem);
            self.rates[k] = (residual - dot(&column[..k], &self.rates[..k])) / column[k];
        }
        for (k, column) in self.j.chunks_exact(stride).take(self.active.len()).enumerate() {
            let by = self.rates[k];
            self.x[..size].iter_mut().zip(column).for_each(|(x, j)| *x -= by * j);
        }
    }
}

#[inline]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solve(
        hessian: &[f64],
        gradient: &[f64],
        constraints: &[(&[f64], f64, f64)],
    ) -> (Outcome, QuadraticProgram) {
        let normals: Vec<_> =
            constraints.iter().flat_map(|constraint| constraint.0.iter().copied()).collect();
        let bounds: Vec<_> = constraints.iter().map(|constraint| constraint.1).collect();
        let softness: Vec<_> = constraints.iter().map(|constraint| constraint.2).collect();
        let mut program =
            QuadraticProgram::new(gradient.len(), constraints.len(), constraints.len());
        let problem = Problem {
            hessian,
            gradient,
            normals: &normals,
            bounds: &bounds,
            softness: &softness,
            spared: 0,
        };
        (program.solve(&problem), program)
    }

    /// The example of Goldfarb and Idnani's paper, easily redone by hand:
    /// min ½xᵀ\[4 −2; −2 4\]x + 6x₁ with x ≥ 0 and x₁ + x₂ ≥ 2 has the minimum 6.5 at (0.5, 1.5).
    #[test]
    fn the_example_of_the_paper() {
        let (outcome, program) = solve(
            &[4.0, -2.0, -2.0, 4.0],
            &[6.0, 0.0],
            &[(&[1.0, 0.0], 0.0, 0.0), (&[0.0, 1.0], 0.0, 0.0), (&[1.0, 1.0], 2.0, 0.0)],
        );
        assert_eq!(outcome, Outcome::Solved);
        assert!((program.x()[0] - 0.5).abs() < 1e-15 && (program.x()[1] - 1.5).abs() < 1e-15);
        let x = program.x();
        let value = 2.0 * x[0] * x[0] - 2.0 * x[0] * x[1] + 2.0 * x[1] * x[1] + 6.0 * x[0];
        assert!((value - 6.5).abs() < 1e-14);
    }

    #[test]
    fn soft_rows_share_a_contradiction() {
        // x ≥ 1 and −x ≥ 1 with softness s each: x = 0, δ = 1.
        let constraints: &[(&[f64], f64, f64)] = &[(&[1.0], 1.0, 1e-4), (&[-1.0], 1.0, 1e-4)];
        let (outcome, program) = solve(&[1.0], &[0.0], constraints);
        assert_eq!(outcome, Outcome::Solved);
        assert!(program.x()[0].abs() < 1e-13);
        for (_, multiplier) in program.active() {
            assert!((multiplier * 1e-4 - 1.0).abs() < 1e-12);
        }
        let hard: &[(&[f64], f64, f64)] = &[(&[1.0], 1.0, 0.0), (&[-1.0], 1.0, 0.0)];
        assert_eq!(solve(&[1.0], &[0.0], hard).0, Outcome::Infeasible);
    }

    #[test]
    fn zero_rows_mean_something_only_if_nothing_can_fulfil_them() {
        let zero: &[f64] = &[0.0, 0.0];
        let h = [2.0, 0.0, 0.0, 1.0];
        assert_eq!(solve(&h, &[2.0, 1.0], &[(zero, 0.0, 0.0)]).0, Outcome::Solved);
        assert_eq!(solve(&h, &[2.0, 1.0], &[(zero, -1.0, 0.0)]).0, Outcome::Solved);
        assert_eq!(solve(&h, &[2.0, 1.0], &[(zero, 1.0, 0.0)]).0, Outcome::Infeasible);
        let (outcome, program) = solve(&h, &[2.0, 1.0], &[(zero, 1.0, 0.1)]);
        assert_eq!(outcome, Outcome::Solved);
        assert!(program.x().iter().all(|x| (x + 1.0).abs() < 1e-15));
    }

    #[test]
    fn indefinite_and_undefined_hessians_are_refused() {
        for hessian in [[1.0, 2.0, 2.0, 1.0], [0.0; 4], [f64::NAN, 0.0, 0.0, 1.0]] {
            assert_eq!(solve(&hessian, &[0.0, 0.0], &[]).0, Outcome::NotConvex);
        }
    }
}
