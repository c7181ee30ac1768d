//! The drives: how the torque that acts follows the one that is commanded.

use crate::math::ScalarOrVec;
use crate::settings::settings;

settings! {
    /// The `[actuator]` table of a scenario.
    pub struct ActuatorSettings {
        /// First-order lag, from zero torque at the start.
        time_constant: ScalarOrVec = ScalarOrVec::Uniform(0.0), "s", NOT_NEGATIVE;
    }
}

/// Drives with a first-order lag each, T τ̇ + τ = τ_commanded (T48), at zero torque in the beginning.
///
/// # Example
/// ```
/// use vff_core::simulation::{Actuator, ActuatorSettings};
///
/// let settings = ActuatorSettings { time_constant: vff_core::math::ScalarOrVec::Uniform(0.005), ..ActuatorSettings::default() };
/// let mut drive = Actuator::new(&settings, 1, 0.001);
/// drive.start();
/// let first = drive.advance(&[10.0])[0];
/// assert!(0.0 < first && first < 10.0 && drive.advance(&[10.0])[0] > first);
/// ```
#[derive(Debug, Clone)]
pub struct Actuator {
    /// e^(−Δt/T): what is left of the difference to the command after a step.
    decay: Vec<f64>,
    /// (1 − e^(−Δt/T)) T/Δt: its mean over the step.
    mean_decay: Vec<f64>,
    torque: Vec<f64>,
    before: Vec<f64>,
    mean: Vec<f64>,
}

impl Actuator {
    /// The drives of `n` joints, for plant steps of `dt` \[s\].
    pub fn new(settings: &ActuatorSettings, n: usize, dt: f64) -> Self {
        let constants = (0..n).map(|i| settings.time_constant.get(i));
        let (decay, mean_decay) = constants
            .map(|lag| {
                let steps = dt / lag;
                if lag > 0.0 && steps.is_finite() {
                    ((-steps).exp(), -(-steps).exp_m1() / steps)
                } else {
                    (0.0, 0.0)
                }
            })
            .unzip();
        let zeros = || vec![0.0; n];
        Self { decay, mean_decay, torque: zeros(), before: zeros(), mean: zeros() }
    }

    /// Begins anew, at zero torque.
    pub fn start(&mut self) {
        self.torque.fill(0.0);
    }

    /// The torque that acts now \[N·m\].
    pub fn torque(&self) -> &[f64] {
        &self.torque
    }

    /// Takes a new command \[N·m\]: drives without lag follow at once.
    pub fn command(&mut self, command: &[f64]) {
        for ((torque, command), decay) in self.torque.iter_mut().zip(command).zip(&self.decay) {
            if *decay == 0.0 {
                *torque = *command;
            }
        }
    }

    /// Holds a command \[N·m\] for one step and returns the mean of the torque over it, which is what
    /// the plant gets: the impulse of every step is exact.
    pub fn advance(&mut self, command: &[f64]) -> &[f64] {
        self.before.copy_from_slice(&self.torque);
        for (i, command) in command.iter().enumerate() {
            let behind = self.torque[i] - command;
            self.mean[i] = command + behind * self.mean_decay[i];
            self.torque[i] = command + behind * self.decay[i];
        }
        &self.mean
    }

    /// Takes the last step back.
    pub fn undo(&mut self) {
        self.torque.copy_from_slice(&self.before);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The response to a step is 1 − e^(−t/T) at every instant, whatever Δt/T, and its integral is
    /// t − T(1 − e^(−t/T)).
    #[test]
    fn step_response() {
        for (lag, dt) in [(0.01, 1e-3), (1e-3, 1e-2), (1e-5, 1e-2), (10.0, 1e-3)] {
            let settings = ActuatorSettings { time_constant: ScalarOrVec::Uniform(lag) };
            let mut drive = Actuator::new(&settings, 1, dt);
            let mut impulse = 0.0;
            for k in 1..=100 {
                impulse += dt * drive.advance(&[2.0])[0];
                let t = f64::from(k) * dt;
                let rise = -(-t / lag).exp_m1();
                assert!((drive.torque()[0] - 2.0 * rise).abs() < 1e-13, "{lag} {dt} {k}");
                assert!((impulse - 2.0 * (t - lag * rise)).abs() < 1e-12, "{lag} {dt} {k}");
            }
        }
    }

    /// Without lag the command acts unchanged, to the last bit.
    #[test]
    fn no_lag_is_no_drive() {
        let mut drive = Actuator::new(&ActuatorSettings::default(), 2, 1e-3);
        drive.command(&[0.1, -7.3]);
        assert_eq!(drive.torque(), [0.1, -7.3]);
        assert_eq!(drive.advance(&[0.3, 1.1]), [0.3, 1.1]);
    }
}
