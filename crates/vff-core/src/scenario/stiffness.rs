//! Friction and springs that are too fast for the step that computes them.

use super::Scenario;
use crate::interrupt;
use crate::robot::{Model, Robot};
use crate::simulation::{Control, Physics};
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// Joints of the longest arm that is looked at: the matrices of more are not worth their time.
const MAX_JOINTS: usize = 100;
/// Joints of the longest arm that is looked at in other postures, too.
const MAX_BENT: usize = 20;
/// Euler's limit for a rate of decay times the step; that of Runge and Kutta is 2.8.
const FASTEST: f64 = 2.0;

impl Scenario {
    /// Viscous friction too fast for the step of the simulation, which integrates it explicitly.
    ///
    /// Files of small arms often have a damping that stops a light wrist within microseconds; a step of a
    /// millisecond then makes it swing, or diverge.
    pub(super) fn stiff_friction<A: Model<D>, const D: usize>(
        &self,
        plant: &Physics<A>,
    ) -> Option<String> {
        let n = plant.viscous.len();
        if n == 0 || n > MAX_JOINTS {
            return None;
        }
        let friction = DMatrix::from_diagonal(&DVector::from_column_slice(&plant.viscous));
        let step = self.simulation.dt;
        let too_fast = |q: &[f64]| {
            let (rate, mode) = fastest(&friction, mass_matrix(&plant.arm, q))?;
            (rate * step > FASTEST).then_some((rate, mode))
        };
        let (rate, mode, posture) = match too_fast(&self.q0) {
            Some((rate, mode)) => (rate, mode, String::new()),
            None => self.where_friction_is_fastest(plant, too_fast)?,
        };
        // Where most is lost.
        let joint = largest((0..n).map(|i| plant.viscous[i].sqrt() * mode[i].abs()));
        let finer = (rate * step / FASTEST).ceil();
        let every = finer * count(self.simulation.control_every);
        let sampled = match self.simulation.control {
            Control::Continuous => String::new(),
            _ => format!(" and simulation.control_every = {every}"),
        };
        Some(format!(
            "plant: viscous friction stops `{}` at a rate of {} 1/s{posture}, too fast for a step of {step} s: it \
             swings or diverges. simulation.dt = {}{sampled} can follow it; plant.viscous_friction = 0 takes \
             it away",
            plant.arm.joint_name(joint),
            significant(rate, 3),
            significant(step / finer, 6),
        ))
    }

    /// The rate and the motion that `too_fast` finds to be the fastest where one joint is straight and the others are as in
    /// q0, and which joint that is: the links beyond it are lighter about an axis that they come to lie along.
    fn where_friction_is_fastest<A: Model<D>, const D: usize>(
        &self,
        plant: &Physics<A>,
        too_fast: impl Fn(&[f64]) -> Option<(f64, DVector<f64>)>,
    ) -> Option<(f64, DVector<f64>, String)> {
        let n = plant.viscous.len();
        if n > MAX_BENT || plant.viscous.iter().all(|friction| *friction == 0.0) {
            return None;
        }
        let mut fastest: Option<(f64, DVector<f64>, usize, f64)> = None;
        for i in 0..n {
            let limits = plant.arm.limits().joint.get(i);
            let straight = limits.map_or(0.0, |[low, high]| 0.0_f64.clamp(*low, *high));
            let mut q = self.q0.clone();
            q[i] = straight;
            if let Some((rate, mode)) = too_fast(&q)
                && fastest.as_ref().is_none_or(|(most, ..)| rate > *most)
            {
                fastest = Some((rate, mode, i, straight));
            }
        }
        let (rate, mode, i, straight) = fastest?;
        let joint = plant.arm.joint_name(i);
        let unit = if plant.arm.slides(i) { "m" } else { "rad" };
        let straight = (1e3 * straight).round() / 1e3;
        Some((rate, mode, format!(" where `{joint}` is at {straight} {unit}")))
    }

    /// A posture spring that a held torque makes unstable: (T34) with K_n that of the spring, at q0.
    pub(super) fn stiff_posture<A: Model<D>, const D: usize, const M: usize>(
        &self,
        arm: &Arc<A>,
    ) -> Option<String> {
        let (n, spring) = (arm.dof(), &self.controller.posture_stiffness);
        if n > MAX_JOINTS || spring.values().iter().all(|k| *k == 0.0) {
            return None;
        }
        let mut state = arm.state();
        state.update(&self.q0, &vec![0.0; n]);
        let z = null_space::<_, D, M>(&state, n)?;
        let root = DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| {
            self.controller.null_damping.get(i).sqrt()
        }));
        let damping = z.tr_mul(&(&root * mass_matrix(arm, &self.q0) * &root * &z));
        let stiffness = z.tr_mul(&DMatrix::from_fn(n, z.ncols(), |i, j| spring.get(i) * z[(i, j)]));
        let sizes = damping.symmetric_eigenvalues();
        if sizes.min() <= 1e-12 * sizes.max() {
            return None; // undamped on purpose: no period is short enough
        }
        let (rate, mode) = fastest(&stiffness, damping)?;
        let (longest, period) = (2.0 / rate, self.simulation.control_period());
        let joint = largest((&z * mode).iter().map(|v| v.abs()));
        (period >= longest).then(|| {
            format!(
                "controller.posture_stiffness: held over a control period of {period} s it lets `{}` swing \
                 more and more; at q0 the null space is stable up to {} s. Less of it at light joints, more \
                 null_damping or a shorter period helps",
                arm.joint_name(joint),
                significant(longest, 2),
            )
        })
    }
}

/// M(q), (n, n).
fn mass_matrix<A: Model<D>, const D: usize>(arm: &Arc<A>, q: &[f64]) -> DMatrix<f64> {
    let n = arm.dof();
    interrupt::checkpoint(n * n * n);
    let mut state = arm.state();
    state.update(q, &vec![0.0; n]);
    let mut mass = DMatrix::zeros(n, n);
    let mut unit = vec![0.0; n];
    for i in 0..n {
        unit[i] = 1.0;
        state.mass_mul(&unit, mass.column_mut(i).as_mut_slice());
        unit[i] = 0.0;
    }
    mass
}

/// An orthonormal basis of the joint velocities that a task of dimension `M` does not see, (n, n − rank);
/// None if it sees all.
fn null_space<R: Robot<D>, const D: usize, const M: usize>(
    state: &R,
    n: usize,
) -> Option<DMatrix<f64>> {
    let columns: Vec<_> = (0..n).map(|i| state.jacobian_column::<M>(i)).collect();
    let seen = DMatrix::from_fn(n, n, |i, j| columns[i].dot(&columns[j])).symmetric_eigen();
    let least = 1e-12 * seen.eigenvalues.max();
    let unseen: Vec<_> = (0..n)
        .filter(|i| seen.eigenvalues[*i] <= least)
        .map(|i| seen.eigenvectors.column(i))
        .collect();
    (!unseen.is_empty()).then(|| DMatrix::from_columns(&unseen))
}

/// The largest λ of a v = λ b v and its v, of a symmetric `a` and a `b` that is positive definite.
fn fastest(a: &DMatrix<f64>, b: DMatrix<f64>) -> Option<(f64, DVector<f64>)> {
    let lower = b.cholesky()?.unpack();
    let half = lower.solve_lower_triangular(a)?;
    let both = lower.solve_lower_triangular(&half.transpose())?;
    let found = both.symmetric_eigen();
    let (most, rate) = found.eigenvalues.argmax();
    let mode = lower.tr_solve_lower_triangular(&found.eigenvectors.column(most).into_owned())?;
    rate.is_finite().then_some((rate, mode))
}

fn largest(values: impl Iterator<Item = f64>) -> usize {
    values.enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i)
}

#[expect(clippy::cast_precision_loss, reason = "steps of a period")]
fn count(steps: usize) -> f64 {
    steps as f64
}

/// A positive number with so many digits that count.
fn significant(value: f64, digits: i32) -> String {
    let shift = digits - 1 - value.log10().floor() as i32;
    let power = 10_f64.powi(shift.abs());
    let rounded =
        if shift < 0 { (value / power).round() * power } else { (value * power).round() / power };
    format!("{rounded}")
}
