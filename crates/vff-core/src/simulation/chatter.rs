//! Whether the torque goes to and fro from one command to the next.

/// Over so many commands it is averaged.
const COMMANDS: f64 = 50.0;
/// It is told of from this share of the largest torque on, and from so much on: less is rounding \[N·m\].
const TOLD: f64 = 0.03;
const LEAST: f64 = 1e-3;

/// How far the torque of each joint goes back at once: of two successive changes of opposite sign the smaller one, on average over
/// some 50 commands. A smooth torque turns now and then, and slowly; one jump is no turn.
#[derive(Debug, Clone)]
pub(super) struct Chatter {
    joints: Vec<Joint>,
    /// The largest torque \[N·m\].
    peak: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Joint {
    /// The last torque and its change \[N·m\].
    last: f64,
    change: f64,
    /// The average, and the largest that it has been \[N·m\].
    mean: f64,
    most: f64,
}

impl Joint {
    #[inline(always)]
    fn take_in(&mut self, tau: f64) {
        let change = tau - self.last;
        let back =
            if change * self.change < 0.0 { change.abs().min(self.change.abs()) } else { 0.0 };
        self.mean += (back - self.mean) / COMMANDS;
        self.most = if self.mean > self.most { self.mean } else { self.most };
        (self.last, self.change) = (tau, change);
    }
}

impl Chatter {
    /// Begins with this torque.
    pub fn new(torque: &[f64]) -> Self {
        let joints = torque.iter().map(|tau| Joint { last: *tau, ..Joint::default() }).collect();
        Self { joints, peak: torque.iter().fold(0.0, |peak: f64, tau| peak.max(tau.abs())) }
    }

    /// Takes in a torque, which may be that of before, held.
    #[inline]
    pub fn take_in(&mut self, torque: &[f64]) {
        if self.joints.iter().zip(torque).all(|(joint, tau)| joint.last.to_bits() == tau.to_bits())
        {
            return;
        }
        for (joint, tau) in self.joints.iter_mut().zip(torque) {
            joint.take_in(*tau);
            self.peak = if tau.abs() > self.peak { tau.abs() } else { self.peak };
        }
    }

    /// A sentence, where it does.
    pub fn sentence(&self) -> Option<String> {
        let joints = self.joints.iter().map(|joint| joint.most).enumerate();
        let (joint, most) = joints.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let share = most / self.peak;
        (share >= TOLD && share.is_finite() && most >= LEAST).then(|| {
            format!(
                "the torque chatters: that of joint {joint} goes to and fro by {most:.2} N·m from one command to the next, \
                 {:.0} % of the largest torque; lower gains, or a lower `controller.yielding.rate`, make it calmer",
                100.0 * share
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sentence(torque: impl Fn(u32) -> f64) -> Option<String> {
        let mut chatter = Chatter::new(&[torque(0), 0.0]);
        (1..2000).for_each(|k| chatter.take_in(&[torque(k), 0.0]));
        chatter.sentence()
    }

    /// Sines, jumps and torques that are held are quiet; what goes to and fro from one command to the next is told of, also where
    /// each command is held for three steps.
    #[test]
    fn what_goes_to_and_fro_is_told() {
        let sine = |k: u32| 20.0 * (0.05 * f64::from(k)).sin();
        assert_eq!(sentence(sine), None);
        assert_eq!(sentence(|k| sine(k / 7)), None);
        assert_eq!(sentence(|k| sine(k) + if k / 300 % 2 == 0 { 20.0 } else { -20.0 }), None);
        assert_eq!(sentence(|_| 3.0), None);
        let rough = |k: u32| sine(k) + if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        for torque in [&rough as &dyn Fn(u32) -> f64, &|k| rough(k / 3)] {
            let sentence = sentence(torque).unwrap();
            assert!(sentence.contains("joint 0"), "{sentence}");
        }
        assert_eq!(sentence(|k| sine(k) + if k % 2 == 0 { 0.05 } else { -0.05 }), None);
    }
}
