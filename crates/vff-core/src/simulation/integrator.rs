//! Integrators of q̈ = a(t, q, q̇).

use super::Integrator;

/// An integrator with its workspace.
#[derive(Debug, Clone)]
pub struct Stepper {
    kind: Integrator,
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    sum_dq: Vec<f64>,
    sum_ddq: Vec<f64>,
}

/// One evaluation of the acceleration within a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stage {
    /// Whether this is the state where the step begins.
    pub first: bool,
    /// Time since the step began \[s\].
    pub offset: f64,
}

impl Stepper {
    /// For `n` joints.
    pub fn new(kind: Integrator, n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self { kind, q: zeros(), dq: zeros(), ddq: zeros(), sum_dq: zeros(), sum_ddq: zeros() }
    }

    /// Advances (q, q̇) by `dt`.
    ///
    /// `acceleration(stage, q, q̇, q̈)` fills q̈; `integrate(q, v, dt)` moves a configuration along
    /// a velocity ([`crate::robot::integrate`]).
    pub fn step(
        &mut self,
        dt: f64,
        q: &mut [f64],
        dq: &mut [f64],
        integrate: impl Fn(&mut [f64], &[f64], f64),
        mut acceleration: impl FnMut(Stage, &[f64], &[f64], &mut [f64]),
    ) {
        acceleration(Stage { first: true, offset: 0.0 }, q, dq, &mut self.ddq);
        match self.kind {
            Integrator::SemiImplicitEuler => {
                add_scaled(dq, dt, &self.ddq);
                integrate(q, dq, dt);
            }
            Integrator::Rk4 => {
                self.sum_dq.copy_from_slice(dq);
                self.sum_ddq.copy_from_slice(&self.ddq);
                self.dq.copy_from_slice(dq);
                for (offset, weight) in [(0.5 * dt, 2.0), (0.5 * dt, 2.0), (dt, 1.0)] {
                    self.q.copy_from_slice(q);
                    integrate(&mut self.q, &self.dq, offset);
                    set_sum(&mut self.dq, dq, offset, &self.ddq);
                    let stage = Stage { first: false, offset };
                    acceleration(stage, &self.q, &self.dq, &mut self.ddq);
                    add_scaled(&mut self.sum_dq, weight, &self.dq);
                    add_scaled(&mut self.sum_ddq, weight, &self.ddq);
                }
                integrate(q, &self.sum_dq, dt / 6.0);
                add_scaled(dq, dt / 6.0, &self.sum_ddq);
            }
        }
    }
}

fn add_scaled(y: &mut [f64], a: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// `out = y + a x`.
fn set_sum(out: &mut [f64], y: &[f64], a: f64, x: &[f64]) {
    out.iter_mut().zip(y).zip(x).for_each(|((out, y), x)| *out = y + a * x);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The harmonic oscillator q̈ = −q after one second from (1, 0): error against cos, −sin.
    fn oscillator_error(kind: Integrator, steps: u32) -> f64 {
        let mut stepper = Stepper::new(kind, 1);
        let (mut q, mut dq) = ([1.0], [0.0]);
        for _ in 0..steps {
            let integrate = |q: &mut [f64], v: &[f64], dt: f64| q[0] += v[0] * dt;
            let spring = |_: Stage, q: &[f64], _: &[f64], ddq: &mut [f64]| ddq[0] = -q[0];
            stepper.step(1.0 / f64::from(steps), &mut q, &mut dq, integrate, spring);
        }
        (q[0] - 1f64.cos()).hypot(dq[0] + 1f64.sin())
    }

    /// RK4 is of fourth order, semi-implicit Euler of first.
    #[test]
    fn orders() {
        for (kind, order) in [(Integrator::Rk4, 4.0), (Integrator::SemiImplicitEuler, 1.0)] {
            let ratio = oscillator_error(kind, 50) / oscillator_error(kind, 100);
            assert!((ratio.log2() - order).abs() < 0.1, "{kind:?}: {ratio}");
        }
    }
}
