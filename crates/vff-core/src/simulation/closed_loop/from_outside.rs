//! What is sent from outside: in the place of the torque of the law, or beside it.

use super::*;
use crate::control::limits::largest_share;
use std::mem::replace;

/// What was sent from outside since the observer was told last. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub(super) struct FromOutside {
    /// On average over so many plant steps \[N·m\].
    mean: Vec<f64>,
    steps: usize,
}

impl FromOutside {
    pub(super) fn new(n: usize) -> Self {
        Self { mean: vec![0.0; n], steps: 0 }
    }

    pub(super) fn forget(&mut self) {
        self.steps = 0;
    }

    /// Takes in what is held over a plant step \[N·m\].
    #[expect(clippy::cast_precision_loss, reason = "steps of a control period")]
    pub(super) fn take(&mut self, tau: &[f64]) {
        self.steps += 1;
        if self.steps == 1 {
            self.mean.copy_from_slice(tau);
        }
        let count = self.steps as f64;
        self.mean.iter_mut().zip(tau).for_each(|(mean, tau)| *mean += (tau - *mean) / count);
    }

    /// What was sent on average over the last `passed` plant steps, that of the `law` where nothing else was, and forgets it; None
    /// if that was so in all of them.
    #[expect(clippy::cast_precision_loss, reason = "steps of a control period")]
    pub(super) fn sent(&mut self, law: &[f64], passed: usize) -> Option<&[f64]> {
        let steps = replace(&mut self.steps, 0);
        if steps == 0 {
            return None;
        }
        let rest = passed.saturating_sub(steps) as f64 / passed.max(1) as f64;
        self.mean.iter_mut().zip(law).for_each(|(mean, law)| *mean += rest * (law - *mean));
        Some(&self.mean)
    }
}

impl<S: System<D, M>, const D: usize, const M: usize> ClosedLoop<S, D, M> {
    /// Takes in what is sent from outside over the next plant step \[N·m\].
    pub(super) fn take_in(&mut self, tau: &[f64]) {
        self.outside.take(tau);
        if let Some(output_stage) = &mut self.output {
            output_stage.replace(tau);
        }
    }

    /// Turns a joint torque into what is sent with its share that the null space lets through (T4) beside the law \[N·m\], to be
    /// asked for once per control period. It gives way first, as a whole, where torque limits would be passed (T35), and grows
    /// no faster than drives follow.
    pub fn add_in_null_space(&mut self, tau: &mut [f64]) {
        let Self { stack, output, held, arm, options, .. } = self;
        stack.controller.project(tau);
        if let Some(output_stage) = output {
            return output_stage.add(tau, options.control_period());
        }
        let (law, limits) = (&held.total, &arm.limits().torque);
        let share = if stack.controller.gains().enforce_limits && !limits.is_empty() {
            largest_share(law, tau, limits.iter().map(|limit| [-limit, *limit])).unwrap_or(0.0)
        } else {
            1.0
        };
        tau.iter_mut().zip(law).for_each(|(tau, law)| *tau = law + share * *tau);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps in which something else was sent count as such, the others as the law; what is the same all the time is so to the
    /// last bit.
    #[test]
    fn mean_of_what_was_sent() {
        let mut outside = FromOutside::new(1);
        assert!(outside.sent(&[7.0], 4).is_none());
        (0..7).for_each(|_| outside.take(&[0.1]));
        assert_eq!(outside.sent(&[7.0], 7), Some(&[0.1][..]));
        assert!(outside.sent(&[7.0], 7).is_none());
        outside.take(&[1.0]);
        outside.take(&[2.0]);
        assert_eq!(outside.sent(&[7.5], 4), Some(&[4.5][..]));
        outside.take(&[1.0]);
        outside.forget();
        assert!(outside.sent(&[7.0], 1).is_none());
    }
}
