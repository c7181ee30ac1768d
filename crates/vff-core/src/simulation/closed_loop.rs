//! Plant and controller, one plant step at a time.

use super::integrator::Stepper;
use super::{Control, Options, Snapshot};
use crate::control::{Controller, Gains, Torque};
use crate::math::Vector;
use crate::robot::{Limits, PlanarArm, PlanarState, Robot};
use crate::trajectory::Trajectory;
use crate::world::World;
use std::sync::Arc;

/// An arm under control among obstacles. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub struct ClosedLoop<const M: usize> {
    options: Options,
    arm: Arc<PlanarArm>,
    /// Evaluates the law at the present state (and, in continuous mode, in every stage).
    brain: Brain<M>,
    /// Evaluates it at the predicted state, in predictor mode.
    foresight: Option<Brain<M>>,
    /// The physical arm. It owns its state, which need not be the controller's model of it.
    plant: PlanarState,
    stepper: Stepper,
    step: usize,
    q: Vec<f64>,
    dq: Vec<f64>,
    /// (q, q̇) before the last step.
    before: [Vec<f64>; 2],
    held: Torque,
    null_acceleration: f64,
    /// Pose of the end effector, kept for the snapshot to borrow.
    x: Vector<M>,
    bias: Vec<f64>,
    predicted: [Vec<f64>; 3],
}

/// The controller with what it perceives and what it is told.
#[derive(Debug, Clone)]
struct Brain<const M: usize> {
    controller: Controller<PlanarState, 2, M>,
    world: World,
    trajectory: Trajectory<M>,
}

impl<const M: usize> Brain<M> {
    /// The torque of the law at (t, q, q̇).
    fn torque_at(&mut self, t: f64, q: &[f64], dq: &[f64]) -> &Torque {
        let Self { controller, world, trajectory } = self;
        world.update(t);
        controller.observe(q, dq, world);
        controller.command(&trajectory.at(t))
    }
}

impl<const M: usize> ClosedLoop<M> {
    /// A joint speed that no arm survives [rad/s]: beyond it a run has diverged.
    pub const MAX_SPEED: f64 = 1e4;

    /// A closed loop at (q, q̇) at t = 0.
    pub fn new(
        arm: &Arc<PlanarArm>,
        gains: Gains<M>,
        world: World,
        trajectory: Trajectory<M>,
        options: Options,
        q: Vec<f64>,
        dq: Vec<f64>,
    ) -> Self {
        let n = arm.dof();
        let zeros = || vec![0.0; n];
        let brain = Brain { controller: Controller::new(arm.state(), gains), world, trajectory };
        let mut this = Self {
            arm: Arc::clone(arm),
            foresight: (options.control == Control::Predictor).then(|| brain.clone()),
            brain,
            plant: arm.state(),
            stepper: Stepper::new(options.integrator, n),
            step: 0,
            q,
            dq,
            before: [zeros(), zeros()],
            held: Torque::zeros(n),
            null_acceleration: 0.0,
            x: Vector::zeros(),
            bias: zeros(),
            predicted: [zeros(), zeros(), zeros()],
            options,
        };
        this.control();
        this
    }

    /// The steps taken so far.
    pub fn step_count(&self) -> usize {
        self.step
    }

    /// What the joints can do.
    pub fn limits(&self) -> &Limits {
        self.arm.limits()
    }

    /// The present instant.
    pub fn time(&self) -> f64 {
        self.options.time(self.step)
    }

    /// Whether the state is finite and no joint turns faster than [`MAX_SPEED`](Self::MAX_SPEED).
    fn is_sane(&self) -> bool {
        self.q.iter().all(|q| q.is_finite()) && self.dq.iter().all(|v| v.abs() < Self::MAX_SPEED)
    }

    /// The state and everything that the law made of it, at the present instant.
    pub fn snapshot(&self) -> Snapshot<'_> {
        let controller = &self.brain.controller;
        let (forces, space) = (controller.forces(), controller.space());
        Snapshot {
            t: self.time(),
            q: &self.q,
            dq: &self.dq,
            torque: &self.held,
            tau_vff: forces.torque(),
            x: self.x.as_slice(),
            dx: space.dx.as_slice(),
            x_ref: controller.reference().x.as_slice(),
            error: controller.error().as_slice(),
            force: forces.magnitude(),
            clearance: forces.clearance(),
            world: &self.brain.world,
            null_acceleration: self.null_acceleration,
            null_storage: controller.null_storage(),
            null_supply: controller.null_supply(),
            slack: controller.slack(),
            yields: controller.yields(),
            singular: space.singular,
        }
    }

    /// Advances by one plant step, under the controller's torque or under `external` [N·m], held
    /// over the step. Returns false, and stays where it is, if the new state would not be
    /// finite and slower than [`MAX_SPEED`](Self::MAX_SPEED), or the law not
    /// [defined](Self::is_defined) there.
    pub fn advance(&mut self, external: Option<&[f64]>) -> bool {
        let t = self.time();
        self.before[0].copy_from_slice(&self.q);
        self.before[1].copy_from_slice(&self.dq);
        let Self { brain, plant, stepper, bias, held, options, arm, q, dq, .. } = self;
        let continuous = options.control == Control::Continuous && external.is_none();
        let held = external.unwrap_or(&held.total);
        let integrate = |q: &mut [f64], v: &[f64], dt: f64| arm.integrate(q, v, dt);
        stepper.step(options.dt, q, dq, integrate, |stage, q, dq, ddq| {
            if continuous && !stage.first {
                brain.torque_at(t + stage.offset, q, dq);
            }
            if continuous || stage.first {
                // The controller stands at this very state: what it has factorised serves the
                // plant too, as long as its model is the plant.
                let controller = &brain.controller;
                let tau = if continuous { &controller.torque().total } else { held };
                controller.robot().accelerate(tau, controller.bias(), bias, ddq);
            } else {
                plant.update(q, dq);
                plant.forward_dynamics(held, bias, ddq);
            }
        });
        if self.is_sane() {
            self.step += 1;
            self.control();
            if self.is_defined() {
                return true;
            }
            self.step -= 1;
        }
        self.q.copy_from_slice(&self.before[0]);
        self.dq.copy_from_slice(&self.before[1]);
        self.control();
        false
    }

    /// Whether everything that the law made of the present state is finite.
    pub fn is_defined(&self) -> bool {
        let forces = self.brain.controller.forces();
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let total = self.brain.controller.torque().total.as_slice();
        finite(total) && finite(&self.held.total) && finite(forces.magnitude())
    }

    /// Evaluates the law at the present state and, at the beginning of a control period, takes over
    /// its torque.
    fn control(&mut self) {
        let t = self.time();
        let torque = self.brain.torque_at(t, &self.q, &self.dq);
        let period_begins = self.step.is_multiple_of(self.options.control_every);
        if period_begins {
            self.held.copy_from(torque);
        }
        self.x = self.brain.controller.pose();
        if period_begins {
            self.null_acceleration = self.brain.controller.null_acceleration();
            self.predict(t);
        }
    }

    /// In predictor mode: the torque for the state in the middle of the control period (T33).
    fn predict(&mut self, t: f64) {
        let Some(foresight) = &mut self.foresight else { return };
        let [q, dq, ddq] = &mut self.predicted;
        let half = 0.5 * self.options.control_period();
        let controller = &self.brain.controller;
        let robot = controller.robot();
        robot.accelerate(&self.held.total, controller.bias(), &mut self.bias, ddq);
        for (v, (dq, ddq)) in dq.iter_mut().zip(self.dq.iter().zip(ddq.iter())) {
            *v = dq + 0.5 * half * ddq;
        }
        q.copy_from_slice(&self.q);
        robot.integrate(q, dq, half);
        for (v, ddq) in dq.iter_mut().zip(ddq.iter()) {
            *v += 0.5 * half * ddq;
        }
        self.held.copy_from(foresight.torque_at(t + half, q, dq));
        self.null_acceleration = foresight.controller.null_acceleration();
    }
}
