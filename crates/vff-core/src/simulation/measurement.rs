//! The sensors: what the controller gets to know of the state.

use crate::math::{Noise, ScalarOrVec};
use crate::settings::settings;

settings! {
    /// The `[measurement]` table of a scenario; each one number or one per joint, 0 for none.
    pub struct MeasurementSettings {
        /// Standard deviation of Gaussian noise, new every step.
        position_noise: ScalarOrVec = ScalarOrVec::Uniform(0.0), "rad", NOT_NEGATIVE;
        /// The same for the velocity.
        velocity_noise: ScalarOrVec = ScalarOrVec::Uniform(0.0), "rad/s", NOT_NEGATIVE;
        /// Readings are rounded to multiples of it.
        position_resolution: ScalarOrVec = ScalarOrVec::Uniform(0.0), "rad", NOT_NEGATIVE;
        /// The same for the velocity.
        velocity_resolution: ScalarOrVec = ScalarOrVec::Uniform(0.0), "rad/s", NOT_NEGATIVE;
        /// Age of the readings, rounded up to whole steps, at most 10 000.
        delay: ScalarOrVec = ScalarOrVec::Uniform(0.0), "s", NOT_NEGATIVE;
    }
}

impl MeasurementSettings {
    /// Whether every reading is the state itself.
    fn is_perfect(&self) -> bool {
        let settings = [
            &self.position_noise,
            &self.velocity_noise,
            &self.position_resolution,
            &self.velocity_resolution,
            &self.delay,
        ];
        settings.iter().all(|setting| setting.values().iter().all(|value| *value == 0.0))
    }

    /// A delay in plant steps of `dt` \[s\], rounded up.
    pub fn steps(delay: f64, dt: f64) -> f64 {
        (delay / dt - 1e-9).ceil().max(0.0)
    }
}

/// One kind of sensor at every joint.
#[derive(Debug, Clone)]
struct Sensors {
    noise: Noise,
    deviation: Vec<f64>,
    resolution: Vec<f64>,
    /// The readings of the last steps, one row a step, as a ring.
    readings: Vec<f64>,
    /// What the controller gets.
    seen: Vec<f64>,
}

impl Sensors {
    fn new(
        noise: Noise,
        deviation: &ScalarOrVec,
        resolution: &ScalarOrVec,
        [n, rows]: [usize; 2],
    ) -> Self {
        Self {
            noise,
            deviation: (0..n).map(|i| deviation.get(i)).collect(),
            resolution: (0..n).map(|i| resolution.get(i)).collect(),
            readings: vec![0.0; n * rows],
            seen: vec![0.0; n],
        }
    }

    fn read(&mut self, truth: &[f64], row: usize) {
        let n = truth.len();
        for (i, reading) in self.readings[row * n..][..n].iter_mut().enumerate() {
            let value = truth[i] + self.deviation[i] * self.noise.draw();
            *reading = rounded(value, self.resolution[i]);
        }
    }
}

/// The multiple of `step` nearest to a value.
pub(super) fn rounded(value: f64, step: f64) -> f64 {
    let count = value / step;
    if count.is_finite() { count.round() * step } else { value }
}

/// Sensors of q and q̇: noise, then rounding, then delay (T47).
///
/// # Example
/// ```
/// use vff_core::simulation::{Measurement, MeasurementSettings};
///
/// let mut sensors = Measurement::new(&MeasurementSettings::default(), 7, 2, 0.001);
/// assert!(sensors.is_perfect());
/// sensors.start(&[0.1, 0.2], &[0.0; 2]);
/// let [q, _] = sensors.seen();
/// assert_eq!(q, [0.1, 0.2]);
/// ```
#[derive(Debug, Clone)]
pub struct Measurement {
    position: Sensors,
    velocity: Sensors,
    /// Delay per joint \[steps\].
    delay: Vec<usize>,
    /// Rows of the rings, and the one that was written last.
    rows: usize,
    row: usize,
    perfect: bool,
}

impl Measurement {
    /// The most plant steps that a reading may be late.
    pub const MAX_DELAY: f64 = 1e4;

    /// Sensors of `n` joints for plant steps of `dt` \[s\]; the same seed gives the same noise.
    pub fn new(settings: &MeasurementSettings, seed: u64, n: usize, dt: f64) -> Self {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "validated before"
        )]
        let delay: Vec<_> = (0..n)
            .map(|i| MeasurementSettings::steps(settings.delay.get(i), dt) as usize)
            .collect();
        let rows = delay.iter().max().map_or(0, |longest| *longest) + 2; // one more to take a step back
        let sensors = |stream, deviation, resolution| {
            Sensors::new(Noise::new(seed, stream), deviation, resolution, [n, rows])
        };
        Self {
            position: sensors(0, &settings.position_noise, &settings.position_resolution),
            velocity: sensors(1, &settings.velocity_noise, &settings.velocity_resolution),
            delay,
            rows,
            row: 0,
            perfect: settings.is_perfect(),
        }
    }

    /// Whether the controller sees the state itself.
    pub fn is_perfect(&self) -> bool {
        self.perfect
    }

    /// What the controller sees: q \[rad\] and q̇ \[rad/s\].
    pub fn seen(&self) -> [&[f64]; 2] {
        [&self.position.seen, &self.velocity.seen]
    }

    /// Begins at (q, q̇), where the arm has been all the time before.
    pub fn start(&mut self, q: &[f64], dq: &[f64]) {
        for (sensors, truth) in [(&mut self.position, q), (&mut self.velocity, dq)] {
            sensors.read(truth, 0);
            for row in 1..self.rows {
                sensors.readings.copy_within(..truth.len(), row * truth.len());
            }
        }
        self.row = 0;
        self.refresh();
    }

    /// Reads the state (q, q̇) one plant step later.
    pub fn advance(&mut self, q: &[f64], dq: &[f64]) {
        self.row = (self.row + 1) % self.rows;
        self.position.read(q, self.row);
        self.velocity.read(dq, self.row);
        self.refresh();
    }

    /// Takes the last step back.
    pub fn undo(&mut self) {
        self.row = (self.row + self.rows - 1) % self.rows;
        self.refresh();
    }

    /// Fetches the readings that have arrived by now.
    fn refresh(&mut self) {
        let n = self.delay.len();
        for (i, delay) in self.delay.iter().enumerate() {
            let row = (self.row + self.rows - delay) % self.rows;
            self.position.seen[i] = self.position.readings[row * n + i];
            self.velocity.seen[i] = self.velocity.readings[row * n + i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensors(delay: f64, noise: f64) -> Measurement {
        let settings = MeasurementSettings {
            position_noise: ScalarOrVec::Uniform(noise),
            delay: ScalarOrVec::Each(vec![0.0, delay]),
            ..MeasurementSettings::default()
        };
        let mut sensors = Measurement::new(&settings, 5, 2, 1e-3);
        sensors.start(&[0.0, 10.0], &[0.0, 0.0]);
        sensors
    }

    /// A step that is taken back leaves what was seen before it, to the last bit.
    #[test]
    fn undo() {
        for delay in [0.0, 1e-3, 3e-3] {
            let mut sensors = sensors(delay, 0.1);
            for k in 1..12 {
                let before = sensors.seen().map(<[f64]>::to_vec);
                sensors.advance(&[1e3, 1e3], &[1e3, 1e3]);
                assert_ne!(sensors.seen().map(<[f64]>::to_vec), before);
                sensors.undo();
                assert_eq!(sensors.seen().map(<[f64]>::to_vec), before, "{delay} {k}");
                let x = f64::from(k);
                sensors.advance(&[x, 10.0 + x], &[x, x]);
            }
        }
    }

    /// Delays are rounded up to whole steps, and a multiple that is not exact in binary stays one.
    #[test]
    fn delays_in_steps() {
        for (delay, steps) in
            [(0.0, 0.0), (1e-3, 1.0), (3.0 * 1e-3, 3.0), (3.1e-3, 4.0), (1e-9, 1.0)]
        {
            assert!((MeasurementSettings::steps(delay, 1e-3) - steps).abs() < 0.5, "{delay}");
        }
        let mut sensors = sensors(2e-3, 0.0);
        for k in 1..5 {
            let x = f64::from(k);
            sensors.advance(&[x, 10.0 + x], &[x, x]);
            assert_eq!(sensors.seen()[0], [x, 10.0 + (x - 2.0).max(0.0)]);
        }
    }
}
