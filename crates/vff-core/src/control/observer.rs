//! What acts on the arm that its model does not know: an observer of its generalised momentum (De Luca, Mattone 2003), or
//! what the robot measures itself, and what the law does about it (T141, T142).
//!
//! ```text
//! r = K (p − ∫ (τ + Cᵀq̇ − g + r) dt),   p = M q̇      so that      ṙ = K (τ_ext − r)
//! ```
//!
//! r follows every torque that the model has not: of loads, of friction, of whoever leans on a link. No acceleration is
//! measured, no matrix inverted. As Ṁ = C + Cᵀ, τ_ext is all that is left of ṗ.

use super::OperationalSpace;
use super::detection::{ContactDetector, DetectionSettings};
use super::force::ForceSettings;
use super::reaction::ReactionSettings;
use crate::math::{ScalarOrVec, lag_share};
use crate::robot::Robot;
use crate::settings::settings;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

settings! {
    /// `[controller.observer]`.
    pub struct ObserverSettings {
        /// How fast the estimate follows; noise comes through with it, and the inertia of a load that is heavy beside the
        /// wrist wants it far from the poles of the loop.
        bandwidth: f64 = 80.0, "1/s", POSITIVE;
        /// What is less is taken for friction and not answered.
        threshold: ScalarOrVec = ScalarOrVec::Uniform(0.0), "N·m", NOT_NEGATIVE;
        /// `momentum`: what changes the momentum of the arm beyond its model; `measured`: the torque from outside that the robot
        /// measures, in a simulation that of `[[wrenches]]` and of obstacles with a `contact`.
        source: Source = Source::Momentum, "";
        /// What of the estimate is taken for a contact.
        detection: Option<DetectionSettings> = None;
    }
}

/// What the estimate of the torque from outside follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// What changes the momentum of the arm beyond its model.
    #[default]
    Momentum,
    /// What the robot measures.
    Measured,
}

/// What the law does about a torque that its model does not know.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// It gives in, as its impedance has it.
    #[default]
    Comply,
    /// It exerts the opposite.
    Reject,
}

settings! {
    /// `[controller.touch]`: the answer of the end effector and of the null space.
    pub struct Touch {
        /// `comply`: the end effector gives in as `stiffness` and `damping` have it; `reject`: the opposite is exerted, a load does
        /// not move it.
        task: Answer = Answer::Comply, "";
        /// The same for what moves links without the end effector.
        null_space: Answer = Answer::Comply, "";
        /// A force along one direction of the task, which the rest of this leaves alone.
        force: Option<ForceSettings> = None;
        /// What is done about a push that nobody foresaw.
        reaction: Option<ReactionSettings> = None;
    }
}

/// The observer with its memory. Nothing allocates after construction.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::control::observer::{Answer, MomentumObserver, ObserverSettings, Source, Touch};
/// use vff_core::math::Vector;
/// use vff_core::robot::{Model, PlanarArm, Robot, planar::Link};
///
/// let settings = ObserverSettings { source: Source::Momentum, ..ObserverSettings::default() };
/// let mut observer = MomentumObserver::new(&settings, 2);
/// let mut arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 2], Vector::<2>::zeros())).state();
/// for _ in 0..10 {
///     arm.update(&[0.3, 0.4], &[0.0; 2]);
///     observer.update(&arm, Some(0.001));
/// }
/// assert_eq!(observer.estimate(), [0.0; 2]); // nobody touches it
/// assert_ne!(Answer::Comply, Answer::Reject);
/// assert!(Touch::default() == Touch::default());
/// ```
#[derive(Debug, Clone)]
pub struct MomentumObserver {
    bandwidth: f64,
    source: Source,
    threshold: Vec<f64>,
    estimate: Vec<f64>,
    /// The same as a wrench at the end effector, in as many numbers as the task has.
    wrench: SVector<f64, 6>,
    /// What the robot has measured last, if it does.
    measured: Vec<f64>,
    /// M q̇ and Cᵀq̇ − g at the last state, and whether there was one.
    momentum: Vec<f64>,
    drift: Vec<f64>,
    has_begun: bool,
    /// C q̇ + g of the last command.
    bias: Vec<f64>,
    /// What has acted since then \[N·m, N\]; to be written before [`update`](Self::update).
    pub(super) acted: Vec<f64>,
    answer: Vec<f64>,
    scratch: [Vec<f64>; 2],
    /// What tells contacts from everything else, if anything does.
    detector: Option<Box<ContactDetector>>,
    /// The share of a contact that is not rejected.
    yielding: f64,
}

impl MomentumObserver {
    /// For `n` joints; it knows of nothing yet.
    pub fn new(settings: &ObserverSettings, n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self {
            bandwidth: settings.bandwidth,
            source: settings.source,
            threshold: (0..n).map(|i| settings.threshold.get(i)).collect(),
            estimate: zeros(),
            wrench: SVector::zeros(),
            measured: zeros(),
            momentum: zeros(),
            drift: zeros(),
            has_begun: false,
            bias: zeros(),
            acted: zeros(),
            answer: zeros(),
            scratch: [zeros(), zeros()],
            detector: settings.detection.as_ref().map(|given| {
                Box::new(ContactDetector::new(given, settings.bandwidth, &settings.threshold, n))
            }),
            yielding: 0.0,
        }
    }

    /// What tells contacts from everything else, if anything does.
    pub fn detector(&self) -> Option<&ContactDetector> {
        self.detector.as_deref()
    }

    /// Rejects no more than 1 − `share` of what is taken for a contact, from now on.
    pub fn yield_to_contact(&mut self, share: f64) {
        self.yielding = share;
    }

    /// Writes what there is to be rejected of the estimate \[N·m, N\], (n).
    pub fn write_resisted(&self, out: &mut [f64]) {
        write_resisted(&self.estimate, self.detector.as_deref(), self.yielding, out);
    }

    /// r, the torque that the model does not know \[N·m, N\], (n).
    pub fn estimate(&self) -> &[f64] {
        &self.estimate
    }

    /// J#ᵀr, the wrench at the end effector whose part in r moves it \[N, N·m\], (m): in world axes, linear before angular.
    pub fn wrench<const M: usize>(&self) -> &[f64] {
        &self.wrench.as_slice()[..M]
    }

    /// What the law adds because of it \[N·m, N\], (n).
    pub fn rejection(&self) -> &[f64] {
        &self.answer
    }

    /// Takes the estimate out of `bias`, C q̇ + g of the model \[N·m, N\], (n), which it remembers.
    pub(super) fn correct(&mut self, bias: &mut [f64]) {
        for ((own, bias), r) in self.bias.iter_mut().zip(bias).zip(&self.estimate) {
            *own = *bias;
            *bias -= r;
        }
    }

    /// C q̇ + g of the model where it was corrected last \[N·m, N\], (n).
    pub(super) fn model_bias(&self) -> &[f64] {
        &self.bias
    }

    /// Knows of nothing any more.
    pub fn forget(&mut self) {
        self.estimate.fill(0.0);
        self.answer.fill(0.0);
        self.wrench.fill(0.0);
        self.measured.fill(0.0);
        self.has_begun = false;
        self.yielding = 0.0;
        if let Some(detector) = &mut self.detector {
            detector.forget();
        }
    }

    /// Takes in what the robot measures \[N·m, N\], (n), until the next time; numbers that are none change nothing.
    pub fn sense(&mut self, measured: &[f64]) {
        if measured.iter().all(|tau| tau.is_finite()) {
            self.measured.copy_from_slice(measured);
        }
    }

    /// Takes over the estimate of another observer, with so much `more` of each joint \[N·m, N\].
    pub fn believe(&mut self, other: &Self, more: impl Fn(usize) -> f64) {
        for (i, (r, other)) in self.estimate.iter_mut().zip(&other.estimate).enumerate() {
            *r = other + more(i);
        }
        if let (Some(detector), Some(other)) = (&mut self.detector, &other.detector) {
            detector.believe(other, more);
        }
    }

    /// Goes on from where another observer is, at the same state. Torques that `robot` has to exert against gravity and the model of
    /// `others` has not are from outside for one of them alone (T141); where the robot adds gravity itself, nothing is.
    pub fn go_on<R: Robot<D>, const D: usize>(
        &mut self,
        other: &Self,
        robot: &R,
        others: Option<&R>,
    ) {
        let is_by_model = [self.source, other.source] == [Source::Momentum; 2];
        let [mut own, mut theirs] = std::mem::take(&mut self.scratch);
        own.fill(0.0);
        theirs.fill(0.0);
        if let Some(others) = others.filter(|_| is_by_model) {
            robot.gravity_torque(&mut own);
            others.gravity_torque(&mut theirs);
        }
        self.believe(other, |i| own[i] - theirs[i]);
        self.scratch = [own, theirs];
        self.measured.copy_from_slice(&other.measured);
        robot.momentum_and_drift(&mut self.momentum, &mut self.drift);
        self.has_begun = other.has_begun;
    }

    /// Takes in the state of `robot`, `elapsed` \[s\] after the last one, over which `acted` has been exerted; None if nobody
    /// knows what was: the estimate stays as it is then. Exact for torques that are held, but for the change of Cᵀq̇ − g, of
    /// which the mean counts. With [`Source::Measured`], the time alone counts. It begins with what is measured, if anything is.
    pub fn update<R: Robot<D>, const D: usize>(&mut self, robot: &R, elapsed: Option<f64>) {
        match self.source {
            Source::Momentum => self.compare(robot, elapsed),
            Source::Measured => self.follow(elapsed),
        }
        if let (Some(detector), Some(elapsed)) = (&mut self.detector, elapsed)
            && elapsed > 0.0
        {
            detector.update(&self.estimate, &self.acted, elapsed);
        }
    }

    /// ṙ = K (τ_measured − r), from what is measured first.
    fn follow(&mut self, elapsed: Option<f64>) {
        let gain = match elapsed {
            _ if !self.has_begun => 1.0,
            Some(elapsed) => lag_share(self.bandwidth, elapsed.max(0.0)),
            None => 0.0,
        };
        for (r, measured) in self.estimate.iter_mut().zip(&self.measured) {
            *r += gain * (measured - *r);
        }
        self.has_begun = true;
    }

    fn compare<R: Robot<D>, const D: usize>(&mut self, robot: &R, elapsed: Option<f64>) {
        let Self {
            bandwidth, estimate, measured, momentum, drift, has_begun, acted, scratch, ..
        } = self;
        if !*has_begun {
            estimate.copy_from_slice(measured);
        }
        let [momentum_now, drift_now] = scratch;
        robot.momentum_and_drift(momentum_now, drift_now);
        if let Some(elapsed) = elapsed.filter(|elapsed| *has_begun && *elapsed > 0.0) {
            let (gain, n) = (lag_share(*bandwidth, elapsed), estimate.len());
            // All of one length: spares the loop its bounds checks.
            let (momentum_now, drift_now) = (&momentum_now[..n], &drift_now[..n]);
            let (momentum, drift, acted) = (&momentum[..n], &drift[..n], &acted[..n]);
            for i in 0..n {
                let force = (momentum_now[i] - momentum[i]) / elapsed;
                let known = acted[i] + 0.5 * (drift[i] + drift_now[i]);
                estimate[i] += gain * (force - known - estimate[i]);
            }
        }
        std::mem::swap(momentum, momentum_now);
        std::mem::swap(drift, drift_now);
        *has_begun = true;
    }

    /// Writes the wrench that the estimate is, and the torque that the law adds: the opposite of what it is to reject of the
    /// estimate, as far as that is beyond what friction may be \[N·m, N\], (n). What it is along `pressed`, a unit vector of the
    /// task, is not rejected of the task.
    pub fn reject<R: Robot<D>, const D: usize, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        touch: &Touch,
        pressed: Option<&SVector<f64, M>>,
    ) {
        let Self { estimate, threshold, answer, wrench, detector, yielding, .. } = self;
        wrench.as_mut_slice()[..M].copy_from_slice(space.pinv_tr_mul(estimate).as_slice());
        write_resisted(estimate, detector.as_deref(), *yielding, answer);
        // The opposite of what is beyond friction.
        for (answer, most) in answer.iter_mut().zip(threshold) {
            *answer = answer.max(-*most).min(*most) - *answer;
        }
        let rejects = |answer| f64::from(u8::from(answer == Answer::Reject));
        let (task, null) = (rejects(touch.task), rejects(touch.null_space));
        // Its J#ᵀ, whose Jᵀ is the part that moves the end effector (T142).
        let moving = (touch.task != touch.null_space || pressed.is_some())
            .then(|| space.pinv_tr_mul(answer));
        if touch.null_space == Answer::Comply {
            answer.fill(0.0);
        }
        if let Some(moving) = moving {
            let mut force = moving * (task - null);
            if let Some(u) = pressed {
                force -= u * (task * u.dot(&moving));
            }
            for (i, answer) in answer.iter_mut().enumerate() {
                *answer += robot.jacobian_column::<M>(i).dot(&force);
            }
        }
    }
}

/// r − a δ, the estimate without the share that is yielded to of what is taken for a contact \[N·m, N\], (n).
fn write_resisted(
    estimate: &[f64],
    detector: Option<&ContactDetector>,
    yielding: f64,
    out: &mut [f64],
) {
    out.copy_from_slice(estimate);
    if let Some(detector) = detector {
        for (out, deviation) in out.iter_mut().zip(detector.deviation()) {
            *out -= yielding * deviation;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vector;
    use crate::robot::{Model, PlanarArm, planar::Link};
    use crate::testing::case;
    use proptest::prelude::*;
    use std::sync::Arc;

    fn with(bandwidth: f64, threshold: f64) -> ObserverSettings {
        ObserverSettings {
            bandwidth,
            threshold: ScalarOrVec::Uniform(threshold),
            source: Source::Momentum,
            detection: None,
        }
    }

    /// Velocities after `period`, by steps small beside it, under `tau` and `external`.
    fn moved<R: Robot<2>>(robot: &mut R, tau: &[f64], external: &[f64], period: f64) {
        let n = tau.len();
        let total: Vec<f64> = tau.iter().zip(external).map(|(a, b)| a + b).collect();
        let [mut scratch, mut ddq] = [vec![0.0; n], vec![0.0; n]];
        let (mut q, mut dq) = (robot.configuration().to_vec(), robot.velocity().to_vec());
        for _ in 0..20 {
            robot.forward_dynamics(&total, &mut scratch, &mut ddq);
            for i in 0..n {
                let before = dq[i];
                dq[i] += period / 20.0 * ddq[i];
                q[i] += period / 40.0 * (before + dq[i]);
            }
            robot.update(&q, &dq);
        }
    }

    properties! {
        /// An arm that moves under any torque: the estimate comes to what acts on it beside that, as 1 − exp(−K t) does.
        #[test]
        fn follows_a_step_as_a_lag_of_first_order(c in case(1usize..8), bandwidth in 10.0..200.0) {
            let (n, period) = (c.q.len(), 1e-3);
            let mut observer = MomentumObserver::new(&with(bandwidth, 0.0), n);
            let mut robot = c.state();
            let [mut gravity, still] = [vec![0.0; n], vec![0.0; n]];
            robot.update(&c.q, &still);
            observer.update(&robot, None);
            for k in 1..=100 {
                robot.gravity_torque(&mut gravity);
                observer.acted.copy_from_slice(&gravity);
                let external: Vec<f64> = c.u.iter().map(|u| 0.3 * u).collect();
                moved(&mut robot, &gravity, &external, period);
                observer.update(&robot, Some(period));
                let share = 1.0 - (-bandwidth * period * f64::from(k)).exp();
                let speed = robot.velocity().iter().fold(0.0_f64, |m, dq| m.max(dq.abs()));
                for (r, external) in observer.estimate().iter().zip(&external) {
                    let scale = 1.0 + external.abs() + speed * speed;
                    prop_assert!((r - share * external).abs() < 5e-3 * scale, "{k}: {r} {external} {share}");
                }
            }
        }

        /// What is rejected of the task and of the null space adds up to all of it, and the part of the null space does not move
        /// the end effector.
        #[test]
        fn the_answer_has_two_parts(c in case(3usize..8)) {
            let n = c.q.len();
            let mut robot = c.state();
            let mut space = OperationalSpace::<2>::new(n, 1e-3, crate::control::TaskMetric::new::<2>(1.0));
            space.update(&mut robot, &c.q, &c.dq);
            let mut observer = MomentumObserver::new(&ObserverSettings::default(), n);
            observer.estimate.copy_from_slice(&c.u);
            let mut part = |task, null_space| {
                let touch = Touch { task, null_space, force: None, reaction: None };
                observer.reject(&robot, &space, &touch, None);
                observer.rejection().to_vec()
            };
            use Answer::{Comply, Reject};
            let [all, task, null, none] =
                [part(Reject, Reject), part(Reject, Comply), part(Comply, Reject), part(Comply, Comply)];
            let size = c.u.iter().fold(1.0_f64, |m, u| m.max(u.abs()));
            for i in 0..n {
                prop_assert!((all[i] + c.u[i]).abs() < 1e-12 * size && none[i] == 0.0);
                prop_assert!((task[i] + null[i] - all[i]).abs() < 1e-9 * size);
            }
            if !space.singular {
                let scale = space.response(&all).norm() + 1.0;
                prop_assert!(space.response(&null).norm() < 1e-8 * scale);
            }
        }
    }

    /// What friction may be is not answered, and of more only what is beyond it.
    #[test]
    fn what_may_be_friction_is_left_to_it() {
        let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 3], Vector::<2>::zeros()));
        let mut robot = arm.state();
        let mut space =
            OperationalSpace::<2>::new(3, 1e-3, crate::control::TaskMetric::new::<2>(1.0));
        space.update(&mut robot, &[0.3, 0.4, 0.5], &[0.0; 3]);
        let mut observer = MomentumObserver::new(&with(20.0, 0.5), 3);
        observer.estimate.copy_from_slice(&[0.4, -2.0, 0.5]);
        let reject = Answer::Reject;
        let touch = Touch { task: reject, null_space: reject, force: None, reaction: None };
        observer.reject(&robot, &space, &touch, None);
        assert_eq!(observer.rejection(), [0.0, 1.5, 0.0]);
        assert_eq!(observer.estimate(), [0.4, -2.0, 0.5]);
    }

    /// Over a time in which nobody knows what was sent, and before anything is known, the estimate stays.
    #[test]
    fn what_is_not_known_changes_nothing() {
        let arm =
            Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); 2], Vector::<2>::new(0.0, -9.81)));
        let mut robot = arm.state();
        let mut observer = MomentumObserver::new(&ObserverSettings::default(), 2);
        robot.update(&[0.3, 0.4], &[1.0, -2.0]);
        observer.update(&robot, Some(1e-3));
        assert_eq!(observer.estimate(), [0.0, 0.0]);
        robot.update(&[0.3, 0.4], &[5.0, 2.0]);
        observer.update(&robot, None);
        assert_eq!(observer.estimate(), [0.0, 0.0]);
        observer.update(&robot, Some(1e-3));
        assert!(
            observer.estimate().iter().all(|r| r.abs() > 0.0),
            "gravity pulls where nothing is sent"
        );
        let before = observer.estimate().to_vec();
        observer.update(&robot, Some(0.0));
        assert_eq!(observer.estimate(), before);
    }
}
