//! Plant and controller, one plant step at a time.

use super::integrator::Stepper;
use super::{Control, Options, Snapshot};
use crate::control::{Controller, Gains, Torque};
use crate::math::Capsule;
use crate::robot::{PlanarArm, PlanarState, Robot};
use crate::trajectory::Trajectory;
use crate::world::{Contact, World};
use std::sync::Arc;

/// An arm under control among obstacles. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub struct ClosedLoop<const M: usize> {
    options: Options,
    brain: Brain<M>,
    plant: PlanarState,
    stepper: Stepper,
    bias: Vec<f64>,
    held: Torque,
    predicted: [Vec<f64>; 3],
    step: usize,
    q: Vec<f64>,
    dq: Vec<f64>,
    snapshot: Snapshot,
}

/// The controller with what it perceives and what it is told.
#[derive(Debug, Clone)]
struct Brain<const M: usize> {
    controller: Controller<PlanarState, 2, M>,
    world: World,
    trajectory: Trajectory<M>,
    contacts: Vec<Contact<2>>,
}

impl<const M: usize> Brain<M> {
    /// The torque of the law at (t, q, q̇).
    fn torque_at(&mut self, t: f64, q: &[f64], dq: &[f64]) -> &Torque {
        let Self { controller, world, trajectory, contacts } = self;
        world.update(t);
        controller.observe(q, dq);
        find_contacts(controller.robot(), world, contacts);
        controller.sense(contacts);
        controller.command(&trajectory.at(t))
    }
}

/// The contacts of all links with all obstacles.
pub fn find_contacts(robot: &PlanarState, world: &World, contacts: &mut Vec<Contact<2>>) {
    contacts.clear();
    if !world.is_empty() {
        let links = (0..robot.dof()).map(|i| -> Capsule<2> { robot.link(i) });
        world.for_each_contact(links, |contact| contacts.push(*contact));
    }
}

impl<const M: usize> ClosedLoop<M> {
    /// A closed loop at rest in `q`, moving with `dq`, at t = 0.
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
        let mut this = Self {
            snapshot: Snapshot::new(n, M, world.len()),
            brain: Brain {
                controller: Controller::new(arm.state(), gains),
                contacts: Vec::with_capacity(n * world.len()),
                world,
                trajectory,
            },
            plant: arm.state(),
            stepper: Stepper::new(options.integrator, n),
            bias: zeros(),
            held: Torque::zeros(n),
            predicted: [zeros(), zeros(), zeros()],
            step: 0,
            options,
            q,
            dq,
        };
        this.control();
        this
    }

    /// The state and everything that the law made of it, at the present instant.
    pub fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    /// The steps taken so far.
    pub fn step_count(&self) -> usize {
        self.step
    }

    /// Whether the state is finite and no joint turns faster than [`MAX_SPEED`](Self::MAX_SPEED).
    pub fn is_sane(&self) -> bool {
        self.q.iter().all(|q| q.is_finite()) && self.dq.iter().all(|v| v.abs() < Self::MAX_SPEED)
    }

    /// A joint speed that no arm survives [rad/s]: beyond it a run has diverged.
    pub const MAX_SPEED: f64 = 1e4;

    /// Advances by one plant step, under the controller's torque or under `external` [N·m], held
    /// over the step. Returns false, and stays where it was in its snapshot, if the new state is
    /// not [sane](Self::is_sane).
    pub fn advance(&mut self, external: Option<&[f64]>) -> bool {
        let Self { brain, plant, stepper, bias, held, options, q, dq, .. } = self;
        let t = options.time(self.step);
        // The controller has just seen this very state: its factorisation serves the plant too.
        let seen = options.control != Control::Predictor;
        let arm = Arc::clone(plant.arm());
        let integrate = |q: &mut [f64], v: &[f64], dt: f64| arm.integrate(q, v, dt);
        let continuous = options.control == Control::Continuous && external.is_none();
        let held = external.unwrap_or(&held.total);
        stepper.step(options.dt, q, dq, integrate, |stage, q, dq, ddq| {
            if continuous {
                if !stage.first {
                    brain.torque_at(t + stage.offset, q, dq);
                }
                let controller = &brain.controller;
                controller.robot().forward_dynamics(&controller.torque().total, bias, ddq);
            } else if stage.first && seen {
                brain.controller.robot().forward_dynamics(held, bias, ddq);
            } else {
                plant.update(q, dq);
                plant.forward_dynamics(held, bias, ddq);
            }
        });
        self.step += 1;
        let sane = self.is_sane();
        if sane {
            self.control();
        }
        sane
    }

    /// Evaluates the law at the present state and, at the beginning of a control period, takes over
    /// its torque.
    fn control(&mut self) {
        let t = self.options.time(self.step);
        let torque = self.brain.torque_at(t, &self.q, &self.dq);
        let period_begins = self.step.is_multiple_of(self.options.control_every);
        if period_begins {
            self.held.copy_from(torque);
        }
        self.observe(t);
        if period_begins && self.options.control == Control::Predictor {
            self.predict(t);
        }
        if period_begins {
            self.snapshot.null_acceleration =
                self.brain.controller.space().response(&self.held.null).norm();
        }
        self.snapshot.tau.copy_from_slice(&self.held.total);
        self.snapshot.tau_task.copy_from_slice(&self.held.task);
        self.snapshot.tau_null.copy_from_slice(&self.held.null);
    }

    /// The torque for the state predicted for the middle of the control period.
    fn predict(&mut self, t: f64) {
        let [q, dq, ddq] = &mut self.predicted;
        let half = 0.5 * self.options.control_period();
        let robot = self.brain.controller.robot();
        robot.forward_dynamics(&self.held.total, &mut self.bias, ddq);
        q.copy_from_slice(&self.q);
        for (v, (dq, ddq)) in dq.iter_mut().zip(self.dq.iter().zip(ddq.iter())) {
            *v = dq + 0.5 * half * ddq;
        }
        robot.integrate(q, dq, half);
        for (v, ddq) in dq.iter_mut().zip(ddq.iter()) {
            *v += 0.5 * half * ddq;
        }
        self.held.copy_from(self.brain.torque_at(t + half, q, dq));
    }

    /// Writes down what the controller sees at the present state.
    fn observe(&mut self, t: f64) {
        let Self { brain: Brain { controller, world, trajectory, .. }, snapshot: s, .. } = self;
        let reference = trajectory.at(t);
        let forces = controller.forces();
        s.t = t;
        s.q.copy_from_slice(&self.q);
        s.dq.copy_from_slice(&self.dq);
        s.tau_vff.copy_from_slice(forces.torque());
        s.x.copy_from_slice(controller.robot().pose::<M>().as_slice());
        s.dx.copy_from_slice(controller.space().dx.as_slice());
        s.x_ref.copy_from_slice(reference.x.as_slice());
        s.error.copy_from_slice(controller.error(&reference).as_slice());
        for (out, f) in s.force.iter_mut().zip(forces.resultant()) {
            *out = f.norm();
        }
        s.clearance.copy_from_slice(forces.clearance());
        for (j, out) in s.obstacles.iter_mut().enumerate() {
            *out = world.position(j);
        }
        s.singular = controller.space().singular;
        s.null_storage = controller.null_energy(&mut self.bias)
            + forces.potential()
            + controller.gains().posture_energy(&self.q);
        let posture_power: f64 =
            crate::control::dot(&self.dq, controller.secondary_torque()) - forces.power(&self.dq);
        s.null_supply = controller.null_power() - controller.damping_power()
            + forces.potential_rate()
            - posture_power;
    }
}
