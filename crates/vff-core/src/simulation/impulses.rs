//! Impulses within bounds that bring joints to rest: dry friction and stops in one problem (T45).
//!
//! Given a velocity v*, find `v = v* + M⁻¹p` with `lower ≤ p ≤ upper` such that every joint either
//! stands still or gets all that its bounds allow against its motion,
//!
//! ```text
//! v_i > 0 ⇒ p_i = lower_i,    v_i < 0 ⇒ p_i = upper_i.
//! ```
//!
//! M⁻¹ is positive definite, so that there is exactly one such v; and since then `p_i v_i ≤ 0`, the
//! kinetic energy never rises (T46). The active set is found by block pivoting: all joints on the
//! wrong side change it at once, and one at a time where that does not converge.

use crate::interrupt;
use crate::robot::Robot;

/// What is assumed of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    /// The impulse is at its lower bound and the velocity is positive, or zero.
    Lower,
    /// The impulse is at its upper bound and the velocity is negative, or zero.
    Upper,
    /// The joint stands still under an impulse between the bounds.
    Still,
}

/// The problem with its workspace. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub struct Impulses {
    /// Smallest impulse per joint \[N·m·s\], ≤ 0; may be −∞.
    pub lower: Vec<f64>,
    /// Largest impulse per joint \[N·m·s\], ≥ 0; may be ∞.
    pub upper: Vec<f64>,
    /// Kept from solution to solution: what stood still mostly goes on to do so.
    sides: Vec<Side>,
    p: Vec<f64>,
    v: Vec<f64>,
    unit: Vec<f64>,
    change: Vec<f64>,
    still: Vec<usize>,
    /// The rows and columns of M⁻¹ of the joints that stand still, then their Cholesky factor.
    block: Vec<f64>,
}

impl Impulses {
    /// For `n` joints, with bounds of zero.
    pub fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self {
            lower: zeros(),
            upper: zeros(),
            sides: vec![Side::Still; n],
            p: zeros(),
            v: zeros(),
            unit: zeros(),
            change: zeros(),
            still: Vec::with_capacity(n),
            block: vec![0.0; n * n],
        }
    }

    /// Solves for the velocity, in place.
    pub fn apply<R: Robot<D>, const D: usize>(&mut self, robot: &R, dq: &mut [f64]) {
        let n = dq.len();
        self.admit();
        let (mut fewest, mut patience) = (usize::MAX, 10);
        for _ in 0..10 * n + 50 {
            self.guess(robot, dq);
            let wrong = (0..n).filter(|&i| self.opposite(i).is_some()).count();
            if wrong == 0 {
                dq.copy_from_slice(&self.v);
                return;
            }
            if wrong < fewest {
                (fewest, patience) = (wrong, 10);
            } else if patience > 0 {
                patience -= 1;
            }
            for i in (0..n).rev() {
                if let Some(side) = self.opposite(i) {
                    self.sides[i] = side;
                    if patience == 0 {
                        break;
                    }
                }
            }
        }
        // Rounding alone can bring it here. Impulses within the bounds are never wrong by much.
        for (p, (lower, upper)) in self.p.iter_mut().zip(self.lower.iter().zip(&self.upper)) {
            *p = p.clamp(*lower, *upper);
        }
        robot.mass_solve(&self.p, &mut self.change);
        dq.iter_mut().zip(&self.change).for_each(|(v, change)| *v += change);
    }

    /// Makes the assumptions of the last solution fit the present bounds.
    fn admit(&mut self) {
        for (side, (lower, upper)) in self.sides.iter_mut().zip(self.lower.iter().zip(&self.upper))
        {
            if upper <= lower {
                *side = Side::Lower;
            } else if *side == Side::Lower && lower.is_infinite()
                || *side == Side::Upper && upper.is_infinite()
            {
                *side = Side::Still;
            }
        }
    }

    /// Impulses and velocities if all assumptions are right.
    fn guess<R: Robot<D>, const D: usize>(&mut self, robot: &R, dq: &[f64]) {
        self.still.clear();
        for (i, side) in self.sides.iter().enumerate() {
            self.p[i] = match side {
                Side::Lower => self.lower[i],
                Side::Upper => self.upper[i],
                Side::Still => 0.0,
            };
            if *side == Side::Still {
                self.still.push(i);
            }
        }
        self.respond(robot, dq);
        let m = self.still.len();
        if m == 0 {
            return;
        }
        // (M⁻¹)_SS p_S = −v_S
        for (column, &joint) in self.still.iter().enumerate() {
            interrupt::checkpoint(16 * self.unit.len() + column * column);
            self.unit.fill(0.0);
            self.unit[joint] = 1.0;
            robot.mass_solve(&self.unit, &mut self.change);
            for (row, &i) in self.still.iter().enumerate() {
                self.block[row * m + column] = self.change[i];
            }
        }
        factorise(&mut self.block, m);
        let rest = &mut self.unit[..m];
        rest.iter_mut().zip(&self.still).for_each(|(rest, &i)| *rest = -self.v[i]);
        solve(&self.block, rest);
        for (p, &i) in rest.iter().zip(&self.still) {
            self.p[i] = *p;
        }
        self.respond(robot, dq);
        for &i in &self.still {
            self.v[i] = 0.0; // and not what rounding leaves of it
        }
    }

    /// `v = v* + M⁻¹p`.
    fn respond<R: Robot<D>, const D: usize>(&mut self, robot: &R, dq: &[f64]) {
        robot.mass_solve(&self.p, &mut self.v);
        self.v.iter_mut().zip(dq).for_each(|(v, dq)| *v += dq);
    }

    /// The side on which joint `i` is, if that is not the one assumed.
    fn opposite(&self, i: usize) -> Option<Side> {
        let (p, v, lower, upper) = (self.p[i], self.v[i], self.lower[i], self.upper[i]);
        match self.sides[i] {
            _ if upper <= lower => None,
            Side::Lower => (v < -ROUNDING).then_some(Side::Still),
            Side::Upper => (v > ROUNDING).then_some(Side::Still),
            Side::Still if p < lower => Some(Side::Lower),
            Side::Still if p > upper => Some(Side::Upper),
            Side::Still => None,
        }
    }
}

/// A joint slower than this stands still \[rad/s\].
const ROUNDING: f64 = 1e-14;

/// The Cholesky factor of the m × m matrix whose lower triangle begins `a`, in its place. A pivot
/// that is not positive, which only rounding makes, takes its joint out of the problem.
fn factorise(a: &mut [f64], m: usize) {
    for j in 0..m {
        for i in j..m {
            let inner: f64 = (0..j).map(|k| a[i * m + k] * a[j * m + k]).sum();
            let rest = a[i * m + j] - inner;
            a[i * m + j] = if i > j {
                rest / a[j * m + j]
            } else if rest > 0.0 {
                rest.sqrt()
            } else {
                f64::INFINITY
            };
        }
    }
}

/// Solves with the factor, in place.
fn solve(factor: &[f64], x: &mut [f64]) {
    let m = x.len();
    for i in 0..m {
        let inner: f64 = (0..i).map(|k| factor[i * m + k] * x[k]).sum();
        x[i] = (x[i] - inner) / factor[i * m + i];
    }
    for i in (0..m).rev() {
        let inner: f64 = (i + 1..m).map(|k| factor[k * m + i] * x[k]).sum();
        x[i] = (x[i] - inner) / factor[i * m + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::case;
    use proptest::prelude::*;

    properties! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// Every joint moves against its bound or stands still within its bounds, v = v* + M⁻¹p, and
        /// the kinetic energy has not risen: for dry friction of any strength and stops of any side.
        #[test]
        fn solutions_satisfy_the_problem(c in case(1usize..12), scale in -4.0..1.0, warm in any::<bool>()) {
            let n = c.q.len();
            let robot = c.state();
            let mut problem = Impulses::new(n);
            for i in 0..n {
                let friction = 10f64.powf(scale) * c.u[i].abs();
                problem.lower[i] = if c.v[i] < -2.0 { f64::NEG_INFINITY } else { -friction };
                problem.upper[i] = if c.v[i] > 2.0 { f64::INFINITY } else { friction };
                if c.v[i].abs() < 0.5 {
                    problem.lower[i] = 0.0;
                    problem.upper[i] = if c.v[i] > 0.0 { f64::INFINITY } else { 0.0 };
                }
            }
            if warm {
                problem.apply(&robot, &mut c.u.clone());
            }
            let mut dq = c.dq.clone();
            problem.apply(&robot, &mut dq);
            let mut p = vec![0.0; n];
            let change: Vec<_> = dq.iter().zip(&c.dq).map(|(after, before)| after - before).collect();
            robot.mass_mul(&change, &mut p);
            let size = p.iter().fold(1e-3, |m: f64, p| m.max(p.abs()));
            for i in 0..n {
                let (lower, upper) = (problem.lower[i], problem.upper[i]);
                let slack = 1e-9 * size;
                prop_assert!(lower - slack <= p[i] && p[i] <= upper + slack, "{}: {} {lower} {upper}", i, p[i]);
                if dq[i] > 1e-12 {
                    prop_assert!((p[i] - lower).abs() <= slack, "{}: {} at {}", i, p[i], dq[i]);
                }
                if dq[i] < -1e-12 {
                    prop_assert!((p[i] - upper).abs() <= slack, "{}: {} at {}", i, p[i], dq[i]);
                }
            }
            let energy = |v: &[f64]| {
                let mut momentum = vec![0.0; n];
                robot.mass_mul(v, &mut momentum);
                0.5 * momentum.iter().zip(v).map(|(m, v)| m * v).sum::<f64>()
            };
            let (before, after) = (energy(&c.dq), energy(&dq));
            prop_assert!(after <= before * (1.0 + 1e-12), "{before} -> {after}");
        }
    }
}
