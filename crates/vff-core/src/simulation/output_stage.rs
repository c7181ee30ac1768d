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
            Box::new(Self { output, sent: zeros(), last: zeros(), acting: zeros(), sent_at: None })
        })
    }

    /// The robot has held its arm still where `plant` is.
    pub(super) fn start<A: Model<D>, S: ObstacleGeometry<D>, const D: usize>(
        &mut self,
        plant: &Plant<A, S, D>,
    ) {
        self.output.begin_at_rest(plant.state());
        self.sent_at = None;
    }

    /// Lets the observer of `controller` know what has been sent for `elapsed` \[s\], if anything has.
    pub(super) fn report<R: Manipulator<D, M> + Clone, const D: usize, const M: usize>(
        &mut self,
        controller: &mut Controller<R, D, M>,
        elapsed: Option<f64>,
    ) {
        self.last.copy_from_slice(self.output.sent());
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
