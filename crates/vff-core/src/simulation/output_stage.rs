//! What is sent to a simulated robot that does not take the torque of the law as it is, and what acts on its joints then.

use super::actuator::Actuator;
use super::plant::Plant;
use crate::control::{Controller, Gains, Output};
use crate::robot::{Manipulator, Model};
use crate::world::ObstacleGeometry;

/// What stands between the law and the simulated robot. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub(super) struct OutputStage {
    pub(super) output: Output,
    /// What is held over the control period \[N·m\].
    pub(super) sent: Vec<f64>,
    /// What was held over the one before.
    last: Vec<f64>,
    /// What is sent beside it, from outside \[N·m\].
    beside: Vec<f64>,
    /// The torque at the joints: of the drives, and of the robot by itself \[N·m\].
    pub(super) acting: Vec<f64>,
    /// The step in which it was sent.
    sent_at: Option<usize>,
}

impl OutputStage {
    /// What the settings ask for; None if the robot takes the torque of the law as it is.
    pub(super) fn new<const M: usize>(gains: &Gains<M>, n: usize) -> Option<Box<Self>> {
        let zeros = || vec![0.0; n];
        gains.command.changes_torque().then(|| {
            let output = Output::new(&gains.command, n);
            let [sent, last, beside, acting] = [zeros(), zeros(), zeros(), zeros()];
            Box::new(Self { output, sent, last, beside, acting, sent_at: None })
        })
    }

    /// The robot has held its arm still where `plant` is.
    pub(super) fn start<A: Model<D>, S: ObstacleGeometry<D>, const D: usize>(
        &mut self,
        plant: &Plant<A, S, D>,
    ) {
        self.output.begin_at_rest(plant.state());
        self.beside.fill(0.0);
        self.sent_at = None;
    }

    /// Lets the observer of `controller` know what has been sent for `elapsed` \[s\], if anything has: `other`, if that was something
    /// from outside.
    pub(super) fn report<R: Manipulator<D, M> + Clone, const D: usize, const M: usize>(
        &mut self,
        controller: &mut Controller<R, D, M>,
        other: Option<&[f64]>,
        elapsed: Option<f64>,
    ) {
        self.last.copy_from_slice(other.unwrap_or(self.output.sent()));
        controller.hear(Some(&mut self.output), &self.last, elapsed);
    }

    /// Lets the next command of `controller` in `step` ask for what can be sent then, for `period` \[s\].
    pub(super) fn announce<R: Manipulator<D, M> + Clone, const D: usize, const M: usize>(
        &mut self,
        controller: &mut Controller<R, D, M>,
        step: usize,
        period: f64,
    ) {
        let again = self.sent_at == Some(step);
        let output = &mut self.output;
        let sent = if again { output.sent_before() } else { output.sent() };
        self.last.copy_from_slice(sent);
        controller.expect(output, &self.last, period);
    }

    /// Sends the torque `tau` of a controller in `step`, for `period` \[s\]; what was sent in this step before is taken back.
    pub(super) fn send<R: Manipulator<D, M> + Clone, const D: usize, const M: usize>(
        &mut self,
        controller: &Controller<R, D, M>,
        tau: &[f64],
        step: usize,
        period: f64,
    ) {
        if self.sent_at.replace(step) == Some(step) {
            self.output.undo();
        }
        self.output.convert(controller.robot(), tau);
        self.sent.copy_from_slice(self.output.send(period));
    }

    /// Turns a torque from outside into all that is sent with as much of it as fits beside what is sent \[N·m\], for `period` \[s\].
    pub(super) fn add(&mut self, tau: &mut [f64], period: f64) {
        self.output.add(tau, &mut self.beside, period);
        tau.iter_mut().zip(&self.sent).zip(&self.beside).for_each(|((t, s), b)| *t = s + b);
    }

    /// Takes note that `tau` \[N·m\] was sent instead, which has in it what is sent beside: the law goes on from the rest.
    pub(super) fn replace(&mut self, tau: &[f64]) {
        self.last.iter_mut().zip(tau).zip(&self.beside).for_each(|((l, t), b)| *l = t - b);
        self.output.begin_at(&self.last);
    }

    /// Takes back what was sent in `step`; the one before is to be sent again.
    pub(super) fn undo(&mut self, step: usize) {
        if self.sent_at == Some(step) {
            self.output.undo();
            self.sent_at = step.checked_sub(1);
        }
    }

    /// Looks at what acts on the joints at (q, q̇).
    pub(super) fn look<A: Model<D>, S: ObstacleGeometry<D>, const D: usize>(
        &mut self,
        actuator: Option<&Actuator>,
        plant: &mut Plant<A, S, D>,
        [q, dq]: [&[f64]; 2],
    ) {
        let Self { sent, acting, .. } = self;
        acting.copy_from_slice(actuator.map_or(sent, Actuator::torque));
        plant.add_own_torque(q, dq, acting);
    }
}
