//! Whether somebody touches the arm, and on which link: an estimate of the torque from outside is held against a threshold
//! that adapts to the error of the model, to friction and to noise (T166, T167; Haddadin, De Luca, Albu-Schäffer 2017;
//! Sotoudehnejad, Takhmar, Kermani, Polushin 2012).
//!
//! ```text
//! δ = r − r̄,   h = h₀ + 2 f + ε |y − ȳ| + k σ,      contact on the last link whose joint has |δ| > h
//! ```
//!
//! r is the estimate, y the torque of the model behind the same lag, a bar what either has been on average of late: a model
//! that is off by the share ε is off by ε (y − ȳ) in δ. f is what dry friction may be, σ how much r is scattered.

use crate::math::{ScalarOrVec, lag_share};
use crate::settings::settings;

settings! {
    /// `[controller.observer.detection]`.
    pub struct DetectionSettings {
        /// h₀, a torque that is no contact yet.
        least: ScalarOrVec = ScalarOrVec::Uniform(0.2), "N·m", NOT_NEGATIVE;
        /// ε, the share of the torque of the model that it may be off by: twice that of each link, as they may be off against each
        /// other.
        model_error: f64 = 0.1, "", NOT_NEGATIVE;
        /// k, so many standard deviations of the estimate are noise.
        noise: f64 = 7.0, "", NOT_NEGATIVE;
        /// What changes more slowly is no contact: loads, and what the model is always off by.
        memory: f64 = 1.0, "s", POSITIVE;
    }
}

/// Time constants of the observer after which its estimate is what it is, and those for which noise is then listened to.
const SETTLED: f64 = 5.0;
const LISTENED: f64 = 10.0;
/// Of the scatter \[s\].
const NOISE_MEMORY: f64 = 5.0;
/// For so long nothing has to be felt until a contact is over \[s\].
const QUIET: f64 = 0.1;

/// What is known of one joint \[N·m, N\].
#[derive(Debug, Clone, Copy, Default)]
struct Joint {
    least: f64,
    friction: f64,
    /// y, the torque of the model behind the lag of the estimate.
    model: f64,
    /// ȳ and r̄.
    mean_model: f64,
    mean: f64,
    /// r without most of its noise, and σ².
    smooth: f64,
    variance: f64,
}

/// The detector with its memory. Nothing allocates after construction.
///
/// # Example
/// ```
/// use vff_core::control::detection::{ContactDetector, DetectionSettings};
/// use vff_core::math::ScalarOrVec;
///
/// let settings = DetectionSettings::default();
/// let mut detector = ContactDetector::new(&settings, 80.0, &ScalarOrVec::Uniform(0.0), 2);
/// for k in 0..3000 {
///     assert_eq!(detector.link(), None); // what is always there is a load
///     let push = if k < 2999 { 0.0 } else { 5.0 };
///     detector.update(&[1.0 + push, 0.5], &[1.0, 0.5], 1e-3);
/// }
/// assert_eq!(detector.link(), Some(0));
/// ```
#[derive(Debug, Clone)]
pub struct ContactDetector {
    model_error: f64,
    noise: f64,
    memory: f64,
    bandwidth: f64,
    joints: Vec<Joint>,
    /// δ and h.
    deviation: Vec<f64>,
    threshold: Vec<f64>,
    /// How long it has been listening \[s\].
    age: f64,
    /// The link that is touched, and for how long it has not been felt \[s\].
    link: Option<usize>,
    quiet: f64,
}

impl ContactDetector {
    /// For `n` joints, behind an observer of this `bandwidth` \[1/s\] that takes up to `friction` for friction \[N·m\].
    pub fn new(
        settings: &DetectionSettings,
        bandwidth: f64,
        friction: &ScalarOrVec,
        n: usize,
    ) -> Self {
        let joint = |i| Joint {
            least: settings.least.get(i),
            friction: friction.get(i),
            ..Joint::default()
        };
        Self {
            model_error: settings.model_error,
            noise: settings.noise,
            memory: settings.memory,
            bandwidth,
            joints: (0..n).map(joint).collect(),
            deviation: vec![0.0; n],
            threshold: vec![f64::INFINITY; n],
            age: 0.0,
            link: None,
            quiet: 0.0,
        }
    }

    /// The link that is touched, or one beyond it, counted from 0; None while nobody is felt.
    pub fn link(&self) -> Option<usize> {
        self.link
    }

    /// δ, what the estimate is beyond what it has been of late \[N·m, N\], (n).
    pub fn deviation(&self) -> &[f64] {
        &self.deviation
    }

    /// h, what it has to be to be felt \[N·m, N\], (n); infinite at first.
    pub fn threshold(&self) -> &[f64] {
        &self.threshold
    }

    /// Knows of nothing any more.
    pub fn forget(&mut self) {
        self.deviation.fill(0.0);
        self.threshold.fill(f64::INFINITY);
        (self.age, self.link, self.quiet) = (0.0, None, 0.0);
    }

    /// Takes over what another detector knows, where the estimate is so much `more` of each joint \[N·m, N\].
    pub fn believe(&mut self, other: &Self, more: impl Fn(usize) -> f64) {
        for (i, (joint, theirs)) in self.joints.iter_mut().zip(&other.joints).enumerate() {
            let Joint { least, friction, .. } = *joint;
            let (mean, smooth) = (theirs.mean + more(i), theirs.smooth + more(i));
            *joint = Joint { least, friction, mean, smooth, ..*theirs };
        }
        self.deviation.copy_from_slice(&other.deviation);
        self.threshold.copy_from_slice(&other.threshold);
        (self.age, self.link, self.quiet) = (other.age, other.link, other.quiet);
    }

    /// Takes in the estimate, `elapsed` \[s\] after the last one, over which `acted` was exerted \[N·m, N\].
    pub fn update(&mut self, estimate: &[f64], acted: &[f64], elapsed: f64) {
        if self.age == 0.0 {
            for (joint, (r, acted)) in self.joints.iter_mut().zip(estimate.iter().zip(acted)) {
                let (mean, model) = (*r, *acted);
                *joint =
                    Joint { mean, smooth: mean, model, mean_model: model, variance: 0.0, ..*joint };
            }
        }
        self.age += elapsed;
        let begun = self.age - SETTLED / self.bandwidth;
        let lag = lag_share(self.bandwidth, elapsed);
        let smooth = lag_share(0.5 * self.bandwidth, elapsed);
        // Means of all that there has been, until that is longer than they remember.
        let of_late = |memory: f64| if begun > elapsed { elapsed / begun.min(memory) } else { 1.0 };
        let (memory, scatter) = (of_late(self.memory).min(1.0), of_late(NOISE_MEMORY).min(1.0));
        let is_touched = self.link.is_some();
        let mut felt = None;
        for (i, joint) in self.joints.iter_mut().enumerate() {
            let r = estimate[i];
            joint.model += lag * (acted[i] - joint.model);
            let model_error = self.model_error * (joint.model - joint.mean_model).abs();
            let noise = self.noise * joint.variance.sqrt();
            self.threshold[i] = joint.least + 2.0 * joint.friction + model_error + noise;
            self.deviation[i] = r - joint.mean;
            if self.deviation[i].abs() > self.threshold[i] {
                felt = Some(i);
            }
            if !is_touched {
                joint.mean += memory * (r - joint.mean);
                joint.mean_model += memory * (joint.model - joint.mean_model);
                joint.smooth += smooth * (r - joint.smooth);
                let off = r - joint.smooth;
                joint.variance += scatter * (off * off - joint.variance);
            }
        }
        if begun < LISTENED / self.bandwidth {
            self.threshold.fill(f64::INFINITY);
            felt = None;
        }
        self.quiet = if felt.is_some() { 0.0 } else { self.quiet + elapsed };
        if felt.is_some() || self.quiet >= QUIET {
            self.link = felt;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 1e-3;

    fn detector(settings: &DetectionSettings, friction: f64) -> ContactDetector {
        ContactDetector::new(settings, 80.0, &ScalarOrVec::Uniform(friction), 2)
    }

    /// What is always there is no contact, nor what comes slowly; what comes at once is, on the last joint that feels it, until
    /// it has been gone for a while.
    #[test]
    fn what_comes_at_once_is_felt() {
        let mut detector = detector(&DetectionSettings::default(), 0.0);
        let mut feel = |r: [f64; 2], seconds: f64| {
            for _ in 0..(seconds / PERIOD).round() as usize {
                detector.update(&r, &[0.0; 2], PERIOD);
            }
            (detector.link(), detector.deviation().to_vec())
        };
        let (link, deviation) = feel([3.0, -2.0], 1.0);
        assert_eq!(link, None);
        assert!(deviation.iter().all(|delta| delta.abs() < 1e-9), "{deviation:?}");
        assert_eq!(feel([3.3, -2.05], PERIOD).0, Some(0));
        let (link, deviation) = feel([3.3, -2.3], 3.0);
        assert_eq!(link, Some(1));
        assert!((deviation[0] - 0.3).abs() < 1e-2 && (deviation[1] + 0.3).abs() < 1e-2);
        assert_eq!(feel([3.0, -2.0], 0.09).0, Some(1));
        assert_eq!(feel([3.0, -2.0], 0.02).0, None);
    }

    #[test]
    fn what_comes_slowly_is_not() {
        let mut detector = detector(&DetectionSettings::default(), 0.0);
        for k in 0..20_000 {
            let slow = 0.08 * PERIOD * f64::from(k);
            detector.update(&[slow, -slow], &[0.0; 2], PERIOD);
            assert_eq!(detector.link(), None);
        }
    }

    /// A model that is off by a share of its torque, however that changes, is never taken for a contact (T166).
    #[test]
    fn an_error_of_the_model_is_none() {
        let settings = DetectionSettings { model_error: 0.1, ..DetectionSettings::default() };
        let mut detector = detector(&settings, 0.0);
        let (mut r, mut most, lag) = ([0.0; 2], 0.0_f64, lag_share(80.0, PERIOD));
        for k in 0..20_000 {
            let t = PERIOD * f64::from(k);
            let acted = [40.0 * (3.0 * t).sin(), if t % 2.0 < 1.0 { 30.0 } else { -30.0 }];
            for i in 0..2 {
                r[i] += lag * (0.1 * acted[i] - r[i]);
            }
            detector.update(&r, &acted, PERIOD);
            assert_eq!(detector.link(), None, "{t} s");
            most = most.max(r[0].abs());
        }
        assert!(most > 3.0, "that is far more than `least`");
    }

    /// Friction turns round by twice itself; noise that is there from the start raises the threshold to k σ.
    #[test]
    fn friction_and_noise_are_none() {
        let mut rough = detector(&DetectionSettings::default(), 0.5);
        for k in 0..5_000 {
            let r = if k % 1000 < 500 { 0.5 } else { -0.5 };
            rough.update(&[r, r], &[0.0; 2], PERIOD);
            assert_eq!(rough.link(), None);
        }
        let settings = DetectionSettings { least: ScalarOrVec::Uniform(0.0), ..Default::default() };
        let mut noisy = detector(&settings, 0.0);
        for k in 0..10_000_u32 {
            let r = if k.count_ones() % 2 == 0 { 0.3 } else { -0.3 };
            noisy.update(&[r, r], &[0.0; 2], PERIOD);
            assert_eq!(noisy.link(), None);
        }
        assert!((noisy.threshold()[0] / (7.0 * 0.3) - 1.0).abs() < 0.1, "{:?}", noisy.threshold());
    }
}
