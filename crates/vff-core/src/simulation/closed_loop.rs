//! Plant and controller, one plant step at a time.

mod changes;
mod from_outside;
mod queries;
mod truth;

use super::actuator::Actuator;
use super::contact::{ContactSettings, hide_unseen};
use super::integrator::Stepper;
use super::measurement::Measurement;
use super::output_stage::OutputStage;
use super::perception::Perceive;
use super::plant::{Physics, Plant};
use super::pull::Pull;
use super::wrench::{Acting, MAX_WRENCHES, Wrench};
use super::{Control, Integrator, Moment, Options, Replan, Replanned, Snapshot, System};
use crate::control::{
    Controller, Gains, Gravity, ObjectiveScale, SelfCollision, Tank, Torque, limits,
};
use crate::interrupt;
use crate::math::{Pose, Vector};
use crate::robot::{Limits, Manipulator, Model, Robot};
use crate::trajectory::{Governor, Pace, Trajectory};
use crate::world::{CollisionQuery, Contact, ObstacleGeometry, Positions, World};
use from_outside::FromOutside;
use std::iter;
use std::sync::Arc;
use truth::Truth;

/// Where the world is not as the controller believes.
#[derive(Debug, Clone)]
pub struct Reality<A, P, const D: usize> {
    /// The physical arm.
    pub plant: Physics<A>,
    /// What the controller gets to know of the state; None if everything.
    pub measurement: Option<Measurement>,
    /// What the controller gets to know of the obstacles; None if everything.
    pub perception: Option<P>,
    /// What becomes of its torque; None if all of it acts at once.
    pub actuator: Option<Actuator>,
    /// What pushes the physical arm from outside.
    pub wrenches: Vec<Wrench<D>>,
    /// How each obstacle resists a link that presses into it, if it does.
    pub contacts: Vec<Option<ContactSettings>>,
}

/// An arm under control among obstacles. Nothing allocates after construction.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::control::{Gains, Settings};
/// use vff_core::math::Vector;
/// use vff_core::robot::{PlanarArm, planar::Link};
/// use vff_core::simulation::{ClosedLoop, Options, Physics, Plane, Reality, Run, Status};
/// use vff_core::trajectory::{Trajectory, plane::Reference};
/// use vff_core::world::plane::World;
///
/// let arm = Arc::new(PlanarArm::new(vec![Link::rod(0.5, 1.0); 3], Vector::<2>::zeros()));
/// let gains = Gains::<2>::new(&Settings::default());
/// let setpoint = Reference::Setpoint { point: vec![1.2, 0.5] };
/// let trajectory = Trajectory::new(&setpoint, &Vector::<2>::zeros()).unwrap();
/// let reality = Reality {
///     plant: Physics::of(&arm),
///     measurement: None,
///     perception: None,
///     actuator: None,
///     wrenches: vec![],
///     contacts: vec![],
/// };
/// let start = [vec![0.4, 0.5, -0.6], vec![0.0; 3]];
/// let closed_loop = ClosedLoop::<Plane, 2, 2>::new(
///     &arm, gains, World::new(vec![]), trajectory, Options::default(), reality, start,
/// );
/// let mut run = Run::new(closed_loop, &Options::default(), 0.1, true).unwrap();
/// while run.step() {}
/// assert_eq!(run.outcome().status, Status::Completed);
/// ```
///
/// # See also
/// [`Scenario::prepare`](crate::scenario::Scenario), which makes one of a document.
#[derive(Debug, Clone)]
pub struct ClosedLoop<S: System<D, M>, const D: usize, const M: usize> {
    options: Options,
    arm: Arc<S::Arm>,
    /// Evaluates the law at the present state (and, in continuous mode, in every stage).
    stack: ControlStack<S, D, M>,
    /// Evaluates it at the predicted state, in predictor mode.
    foresight: Option<ControlStack<S, D, M>>,
    plant: Plant<S::Arm, S::Geometry, D>,
    measurement: Option<Measurement>,
    perception: Option<S::Perception>,
    actuator: Option<Actuator>,
    /// What stands between the law and the robot, where that is not nothing.
    output: Option<Box<OutputStage>>,
    outside: FromOutside,
    /// What makes the reference wait.
    governor: Option<Governor>,
    /// Who makes another plan where the reference is one that leads nowhere any more.
    replanning: Option<Box<dyn Replan<S, D, M>>>,
    /// What is so, where the controller does not see it.
    truth: Option<Truth<S, D, M>>,
    stepper: Stepper,
    step: usize,
    q: Vec<f64>,
    dq: Vec<f64>,
    /// (q, q̇) at t = 0.
    start: [Vec<f64>; 2],
    /// (q, q̇) before the last step.
    before: [Vec<f64>; 2],
    held: Torque,
    objective_scale: ObjectiveScale,
    null_acceleration: f64,
    /// The step at which the observer was told last what acts.
    heard: Option<usize>,
    /// Pose of the end effector, kept for the snapshot to borrow.
    x: S::Pose,
    bias: Vec<f64>,
    predicted: [Vec<f64>; 3],
}

/// Whether all values are finite. Only a full exponent plus one carries into the sign; bits, because
/// the compiler tests several at once without leaving early.
fn is_finite(values: &[f64]) -> bool {
    const EXPONENT: u64 = f64::INFINITY.to_bits();
    const ONE: u64 = 1 << 52;
    let signs = values.iter().fold(0, |signs, v| signs | ((v.to_bits() & EXPONENT) + ONE));
    signs >> 63 == 0
}

/// The controller with what it perceives and what it is told.
#[derive(Debug, Clone)]
struct ControlStack<S: System<D, M>, const D: usize, const M: usize> {
    controller: Controller<S::State, D, M>,
    world: World<S::Geometry, D>,
    trajectory: Trajectory<S::Pose, M>,
}

impl<S: System<D, M>, const D: usize, const M: usize> ControlStack<S, D, M> {
    /// The torque of the law at (t, q, q̇), with what `perception` has seen of the world, or all of it,
    /// for the reference that `governor` makes wait. `announce` tells the controller what can be sent.
    fn torque_at(
        &mut self,
        t: f64,
        [q, dq]: [&[f64]; 2],
        perception: Option<&mut S::Perception>,
        governor: Option<&Governor>,
        announce: impl FnOnce(&mut Controller<S::State, D, M>),
    ) -> &Torque {
        let Self { controller, world, trajectory } = self;
        world.update(t);
        if let Some(joints) = trajectory.joints() {
            let pace = governor.map_or_else(|| Pace::of_time(t), |governor| governor.pace(t));
            controller.move_posture(joints, &pace);
        } else {
            controller.leave_plan();
        }
        let reference = |ahead| match governor {
            Some(governor) => governor.sample(trajectory, t + ahead),
            None => trajectory.at(t + ahead),
        };
        let believed = match perception {
            Some(perception) => perception.believed(),
            None => Ok(world),
        };
        match believed {
            Ok(world) => {
                world.update(t);
                controller.observe(q, dq, world);
                announce(controller);
                controller.look_ahead(world, reference);
            }
            Err(points) => {
                controller.observe(q, dq, points);
                announce(controller);
                controller.look_ahead(points, reference);
            }
        }
        controller.command(&reference(0.0))
    }

    /// How far the end effector is from where the reference has it at time `t` \[s\] of that, as far as it follows \[m\].
    #[inline(never)] // with a governor only
    fn way_off(&self, t: f64) -> f64 {
        self.trajectory.way_off::<D>(&self.controller.followed_error(), t)
    }
}

impl<S: System<D, M>, const D: usize, const M: usize> ClosedLoop<S, D, M> {
    /// A joint speed that no arm survives \[rad/s\]: beyond it a run has diverged.
    pub const MAX_SPEED: f64 = 1e4;

    /// A closed loop at (q, q̇) at t = 0.
    pub fn new(
        arm: &Arc<S::Arm>,
        gains: Gains<M>,
        mut world: World<S::Geometry, D>,
        trajectory: Trajectory<S::Pose, M>,
        options: Options,
        reality: Reality<S::Arm, S::Perception, D>,
        [q, dq]: [Vec<f64>; 2],
    ) -> Self {
        let n = arm.dof();
        let zeros = || vec![0.0; n];
        let Reality { plant, mut measurement, perception, actuator, wrenches, contacts } = reality;
        let mut plant = Plant::new(plant);
        plant.push_with(&wrenches).expect("links that the scenario has found");
        plant.surround(&world, &contacts);
        hide_unseen(&mut world, &contacts);
        world.know_links(&arm.link_names());
        let imperfect = measurement.as_mut().is_some_and(|measurement| {
            measurement.start(&q, &dq);
            !measurement.is_perfect()
        });
        let imperfect = imperfect || perception.is_some() || world.hides_any();
        let governor = gains.governor.map(|settings| Governor::new(settings, 0.0));
        let output = OutputStage::new(&gains, n);
        let stack =
            ControlStack { controller: Controller::new(arm.state(), gains), world, trajectory };
        let x = stack.controller.pose();
        let mut this = Self {
            arm: Arc::clone(arm),
            foresight: (options.control == Control::Predictor).then(|| stack.clone()),
            stack,
            plant,
            measurement,
            perception,
            actuator,
            output,
            outside: FromOutside::new(n),
            governor,
            replanning: None,
            truth: imperfect.then(|| Truth::new(arm.state())),
            stepper: Stepper::new(options.integrator, n),
            step: 0,
            start: [q.clone(), dq.clone()],
            q,
            dq,
            before: [zeros(), zeros()],
            held: Torque::zeros(n),
            objective_scale: limits::ALL,
            null_acceleration: 0.0,
            heard: None,
            x,
            bias: zeros(),
            predicted: [zeros(), zeros(), zeros()],
            options,
        };
        this.start_perception();
        this.start_output();
        this.control();
        this
    }

    /// Goes back to t = 0.
    pub fn restart(&mut self) {
        (self.step, self.heard) = (0, None);
        self.outside.forget();
        self.plant.forget_added_wrenches();
        self.stack.controller.reset();
        if let Some(foresight) = &mut self.foresight {
            foresight.controller.reset();
        }
        let settings = self.controller().gains().governor;
        self.governor = settings.map(|settings| Governor::new(settings, 0.0));
        self.q.copy_from_slice(&self.start[0]);
        self.dq.copy_from_slice(&self.start[1]);
        if let Some(measurement) = &mut self.measurement {
            measurement.start(&self.q, &self.dq);
        }
        if let Some(actuator) = &mut self.actuator {
            actuator.start();
        }
        if let Some(replanning) = &mut self.replanning {
            let plan = replanning.restart();
            self.follow(&plan);
        }
        self.start_perception();
        self.start_output();
        self.control();
    }

    /// The robot has held its arm still until now.
    fn start_output(&mut self) {
        let Self { output, plant, q, dq, .. } = self;
        if let Some(output_stage) = output {
            plant.update(q, dq);
            output_stage.start(plant);
        }
    }

    /// Whether the controller sees the arm or its surroundings through sensors.
    pub(super) fn is_measured(&self) -> bool {
        self.measurement.is_some() || self.perception.is_some()
    }

    fn start_perception(&mut self) {
        let Self { perception, plant, stack, q, dq, .. } = self;
        if let Some(perception) = perception {
            stack.world.update(0.0);
            plant.update(q, dq);
            perception.start(plant.state(), &stack.world);
        }
    }

    /// Advances by one plant step, under the controller's torque or under `external` \[N·m\], held
    /// over the step. Returns false, and stays where it is, if the new state would not be
    /// finite and slower than [`MAX_SPEED`](Self::MAX_SPEED), or the law not
    /// [defined](Self::is_defined) there.
    pub fn advance(&mut self, external: Option<&[f64]>) -> bool {
        interrupt::checkpoint(256 * self.q.len());
        let t = self.time();
        self.remember();
        if let Some(tau) = external {
            self.take_in(tau);
        }
        let ideal = self.is_ideal();
        let Self { stack, plant, actuator, stepper, held, output, options, arm, q, dq, .. } = self;
        let continuous = options.control == Control::Continuous && external.is_none();
        let (held, mut output) = match output.as_deref_mut() {
            Some(OutputStage { sent, output, .. }) => (&*sent, Some(output)),
            None => (&held.total, None),
        };
        let held = external.unwrap_or(held);
        let held = match actuator {
            Some(actuator) => actuator.advance(held),
            None => held,
        };
        let integrate = |q: &mut [f64], v: &[f64], dt: f64| arm.integrate(q, v, dt);
        let parts = plant.parts(options.dt);
        let part = options.dt / f64::from(parts);
        for k in 0..parts {
            stepper.step(part, q, dq, integrate, |stage, q, dq, ddq| {
                let begins = stage.first && k == 0;
                let now = t + (f64::from(k) * part + stage.offset);
                if continuous && !begins {
                    stack.torque_at(now, [q, dq], None, None, |_| {});
                }
                plant.go_to(now);
                let controller = &stack.controller;
                let tau = match &mut output {
                    _ if !continuous => held,
                    None => &controller.torque().total,
                    Some(output) => {
                        let law = &controller.torque().total;
                        output.convert(controller.robot(), law)
                    }
                };
                if ideal && (continuous || begins) {
                    plant.accelerate_as(controller.robot(), tau, controller.model_bias(), ddq);
                } else {
                    plant.accelerate(q, dq, tau, ddq);
                }
            });
        }
        let weight = match options.integrator {
            Integrator::Rk4 => 0.5,
            Integrator::SemiImplicitEuler => 1.0,
        };
        let tau = match &output {
            _ if !continuous => held,
            None => &stack.controller.torque().total,
            Some(output) => output.wanted(),
        };
        plant.settle(tau, &self.before, q, dq, [options.dt, weight]);
        self.arrive()
    }

    /// The torque that the drives hold over the next plant step \[N·m\], for a plant elsewhere; to be asked for once per
    /// step.
    pub fn drive(&mut self) -> &[f64] {
        let Self { actuator, output, plant, held, q, dq, .. } = self;
        match (actuator, output) {
            (None, None) => &held.total,
            (Some(actuator), None) => actuator.advance(&held.total),
            (actuator, Some(output_stage)) => {
                let OutputStage { sent, acting, .. } = &mut **output_stage;
                let driven = actuator.as_mut().map_or(&sent[..], |actuator| actuator.advance(sent));
                acting.copy_from_slice(driven);
                plant.add_own_torque(q, dq, acting);
                acting
            }
        }
    }

    /// The law at an instant of the next plant step, for a plant elsewhere that asks for it continuously \[N·m\].
    pub fn torque_at(&mut self, t: f64, q: &[f64], dq: &[f64]) -> &[f64] {
        let Self { stack, output, plant, .. } = self;
        stack.torque_at(t, [q, dq], None, None, |_| {});
        let controller = &stack.controller;
        let law = &controller.torque().total;
        let Some(output_stage) = output else { return law };
        let OutputStage { output, acting, .. } = &mut **output_stage;
        acting.copy_from_slice(output.convert(controller.robot(), law));
        plant.add_own_torque(q, dq, acting);
        acting
    }

    /// Takes over the state to which a plant elsewhere has come within one plant step. Returns false, and stays
    /// where it is, as [`advance`](Self::advance) does.
    pub fn arrive_at(&mut self, q: &[f64], dq: &[f64]) -> bool {
        self.remember();
        self.q.copy_from_slice(q);
        self.dq.copy_from_slice(dq);
        self.arrive()
    }

    fn remember(&mut self) {
        self.before[0].copy_from_slice(&self.q);
        self.before[1].copy_from_slice(&self.dq);
    }

    /// One plant step has passed and has led to (q, q̇); goes back if nothing can go on from there.
    fn arrive(&mut self) -> bool {
        if self.is_sane() {
            self.step += 1;
            self.elapse();
            if let Some(measurement) = &mut self.measurement {
                measurement.advance(&self.q, &self.dq);
            }
            let t = self.time();
            let Self { perception, plant, stack, q, dq, .. } = self;
            if let Some(perception) = perception {
                stack.world.update(t);
                plant.update(q, dq);
                perception.advance(plant.state(), &stack.world);
            }
            self.control();
            if self.is_defined() {
                if self.replanning.is_some() && self.step.is_multiple_of(self.options.control_every)
                {
                    self.replan();
                }
                return true;
            }
            if let Some(output_stage) = &mut self.output {
                output_stage.undo(self.step);
            }
            self.step -= 1;
            let t = self.time();
            if let Some(governor) = &mut self.governor {
                governor.undo(t);
            }
            if let Some(measurement) = &mut self.measurement {
                measurement.undo();
            }
            if let Some(perception) = &mut self.perception {
                perception.undo();
            }
        }
        if let Some(actuator) = &mut self.actuator {
            actuator.undo();
        }
        self.q.copy_from_slice(&self.before[0]);
        self.dq.copy_from_slice(&self.before[1]);
        self.control();
        false
    }

    /// Lets one plant step pass for what has a memory in the controller.
    fn elapse(&mut self) {
        self.stack.controller.elapse(self.options.dt);
        if let Some(foresight) = &mut self.foresight {
            foresight.controller.elapse(self.options.dt);
        }
    }

    /// Whether everything that the law made of the present state is finite.
    pub fn is_defined(&self) -> bool {
        let forces = self.stack.controller.forces();
        let total = self.stack.controller.torque().total.as_slice();
        let sent = self.output.as_ref().is_none_or(|output_stage| is_finite(&output_stage.acting));
        is_finite(total) && is_finite(&self.held.total) && is_finite(forces.magnitude()) && sent
    }

    /// Evaluates the law at the present state, as far as it is known, and, at the beginning of a
    /// control period, takes over its torque.
    fn control(&mut self) {
        let t = self.time();
        let seen = self.measurement.as_ref().map_or([&self.q[..], &self.dq], Measurement::seen);
        let period_begins = self.step.is_multiple_of(self.options.control_every);
        if period_begins && let Some(governor) = &mut self.governor {
            governor.begin(t);
        }
        let (step, period) = (self.step, self.options.control_period());
        let is_new = period_begins && self.heard != Some(step);
        let elapsed = self.heard.map(|heard| self.options.time(step) - self.options.time(heard));
        let passed = self.heard.map_or(0, |heard| step.saturating_sub(heard));
        let Self { output, held, plant, outside, .. } = self;
        let announce = |controller: &mut Controller<S::State, D, M>| {
            if is_new {
                controller.sense(plant.external());
            }
            match output {
                Some(output_stage) => {
                    if is_new {
                        let other = outside.sent(&output_stage.sent, passed);
                        output_stage.report(controller, other, elapsed);
                    }
                    output_stage.announce(controller, step, period);
                }
                None if is_new => {
                    let sent = outside.sent(&held.total, passed).unwrap_or(&held.total);
                    controller.hear(None, sent, elapsed);
                }
                None => {}
            }
        };
        let (perception, governor) = (self.perception.as_mut(), self.governor.as_ref());
        let torque = self.stack.torque_at(t, seen, perception, governor, announce);
        self.plant.feel(&self.q, &self.dq, t, self.options.dt);
        if period_begins {
            self.heard = Some(step);
            self.held.copy_from(torque);
            self.objective_scale = *self.stack.controller.objective_scale();
            if let Some(governor) = &mut self.governor {
                governor.hear(self.stack.way_off(governor.path_time(t)));
            }
        }
        self.x = match &mut self.truth {
            Some(truth) => {
                self.plant.update(&self.q, &self.dq);
                let state = self.plant.state();
                let reference = self.stack.controller.reference().x;
                let measures_itself =
                    self.stack.controller.gains().self_collision != SelfCollision::Ignore;
                truth.refresh(state, &reference, &mut self.stack.world, measures_itself);
                state.pose()
            }
            None => self.stack.controller.pose(),
        };
        if period_begins {
            self.null_acceleration = self.stack.controller.null_acceleration();
            self.predict(t);
            if let Some(output_stage) = &mut self.output {
                let stack = self.foresight.as_ref().unwrap_or(&self.stack);
                let period = self.options.control_period();
                output_stage.send(&stack.controller, &self.held.total, self.step, period);
            }
            if let Some(actuator) = &mut self.actuator {
                actuator.command(match &self.output {
                    Some(output_stage) => &output_stage.sent,
                    None => &self.held.total,
                });
            }
        }
        if let Some(output_stage) = &mut self.output {
            output_stage.look(self.actuator.as_ref(), &mut self.plant, [&self.q, &self.dq]);
        }
    }

    /// In predictor mode: the torque for the state in the middle of the control period (T33).
    fn predict(&mut self, t: f64) {
        let Some(foresight) = &mut self.foresight else { return };
        let [q, dq, ddq] = &mut self.predicted;
        let half = 0.5 * self.options.control_period();
        let controller = &self.stack.controller;
        let robot = controller.robot();
        robot.accelerate(&self.held.total, controller.bias(), &mut self.bias, ddq);
        for (v, (dq, ddq)) in dq.iter_mut().zip(robot.velocity().iter().zip(ddq.iter())) {
            *v = dq + 0.5 * half * ddq;
        }
        q.copy_from_slice(robot.configuration());
        robot.integrate(q, dq, half);
        for (v, ddq) in dq.iter_mut().zip(ddq.iter()) {
            *v += 0.5 * half * ddq;
        }
        let (perception, governor) = (self.perception.as_mut(), self.governor.as_ref());
        let (step, period, output) = (self.step, 2.0 * half, &mut self.output);
        let announce = |foresight: &mut Controller<S::State, D, M>| {
            foresight.believe(controller);
            if let Some(output_stage) = output {
                output_stage.announce(foresight, step, period);
            }
        };
        let state = [q.as_slice(), dq.as_slice()];
        self.held.copy_from(foresight.torque_at(t + half, state, perception, governor, announce));
        self.objective_scale = *foresight.controller.objective_scale();
        self.null_acceleration = foresight.controller.null_acceleration();
    }
}
