//! The controller that sees the present alone: observe, then command.

mod observing;

use crate::control::avoidance::preview::Present;
use crate::control::avoidance::{Avoider, Situation};
use crate::control::deadline::LeftOut;
use crate::control::force::ForceControl;
use crate::control::limits::{self, ObjectiveScale, Parts};
use crate::control::moving_posture::MovingPosture;
use crate::control::observer::MomentumObserver;
use crate::control::output::write_ends;
use crate::control::reaction::Reaction;
use crate::control::soft_posture::Spring;
use crate::control::{
    Formulation, Gains, Gravity, Law, OperationalSpace, Output, Tank, Torque, TorqueRange,
    VirtualForces, extended_jacobian, task,
};
use crate::interrupt;
use crate::math::{Pose, Vector, dot};
use crate::robot::Manipulator;
use crate::trajectory::{JointSpline, Pace, Sample};
use crate::world::CollisionQuery;
use std::mem::replace;

/// The torque controller of [`Controller`](super::Controller) without look-ahead: the law, the forces, the limits, and what gives way.
///
/// Call [`observe`](Self::observe) with the state and the surroundings, then [`command`](Self::command) with the
/// reference. Nothing allocates after construction (`formulation = recursive`).
#[derive(Debug, Clone)]
pub struct ReactiveController<R: Manipulator<D, M>, const D: usize, const M: usize> {
    pub(super) robot: R,
    pub(super) gains: Gains<M>,
    pub(super) space: OperationalSpace<M>,
    pub(super) forces: VirtualForces<R::Wrench, D>,
    pub(super) law: Law,
    /// All repulsion: of obstacles, of other links, of joint limits.
    pub(super) repulsion: Vec<f64>,
    /// τ_sec: what the tank lets through of it, and the posture spring.
    pub(super) tau_sec: Vec<f64>,
    /// What the posture of a plan asks for beyond its spring; None where the posture does not move.
    moving: Option<Box<MovingPosture>>,
    pub(super) joint_limit_potential: f64,
    parts: Parts,
    pub(super) objective_scale: ObjectiveScale,
    /// What knows of torques that the model does not know.
    pub(super) observer: Option<Box<MomentumObserver>>,
    /// What presses on a surface, if anything does.
    force: Option<Box<ForceControl<D>>>,
    /// What gives way to a push, if anything does.
    reaction: Option<Box<Reaction>>,
    pub(super) tank: Option<Tank>,
    /// Share of the repulsion that the tank lets through.
    pub(super) share: f64,
    /// What the tank and the torque limits change of the power into the null space \[W\].
    pub(super) scaling: f64,
    reference: Sample<R::Pose, M>,
    error: Vector<M>,
    /// What gives way where the null space is not enough.
    pub(super) avoider: Option<Box<Avoider<D, M>>>,
    /// What the drives accept next, where their torque cannot change at once; and whether that is known of the next command.
    range: Option<Box<TorqueRange>>,
    is_ranged: bool,
    /// What limits make of a torque that is not of the law.
    confined: Torque,
    /// Between which the torque of the law may be \[N·m, N\], and room for gravity where the robot adds that.
    ends: Vec<[f64; 2]>,
    gravity: Option<Vec<f64>>,
}

impl<R: Manipulator<D, M>, const D: usize, const M: usize> ReactiveController<R, D, M> {
    /// A controller for `robot`, with gains resolved for its number of joints.
    pub fn new(robot: R, gains: Gains<M>) -> Self {
        let n = robot.dof();
        Self {
            space: OperationalSpace::new(
                n,
                gains.singularity / robot.total_mass(),
                gains.metric::<D>(),
            ),
            forces: VirtualForces::new(n, robot.body_count()),
            law: Law::new(n),
            repulsion: vec![0.0; n],
            tau_sec: vec![0.0; n],
            moving: None,
            joint_limit_potential: 0.0,
            parts: Parts::new(n),
            objective_scale: limits::ALL,
            observer: gains
                .observer
                .as_ref()
                .map(|given| Box::new(MomentumObserver::new(given, n))),
            force: gains.touch.force.as_ref().map(|given| Box::new(ForceControl::new(given))),
            reaction: gains.touch.reaction.as_ref().map(|given| Box::new(Reaction::new(given, n))),
            tank: gains.tank.map(Tank::new),
            share: 1.0,
            scaling: 0.0,
            reference: Sample::at_rest(robot.pose()),
            error: Vector::zeros(),
            avoider: Avoider::new(&gains, &robot),
            range: gains
                .command
                .torque_rate
                .as_ref()
                .map(|rate| Box::new(TorqueRange::new((0..n).map(|i| rate.get(i)).collect()))),
            is_ranged: false,
            confined: Torque::zeros(n),
            ends: robot.limits().torque.iter().map(|limit| [-limit, *limit]).collect(),
            gravity: (gains.command.gravity == Gravity::Robot && !robot.limits().torque.is_empty())
                .then(|| vec![0.0; n]),
            robot,
            gains,
        }
    }

    /// The robot at the observed state.
    pub fn robot(&self) -> &R {
        &self.robot
    }

    /// The gains in use.
    pub fn gains(&self) -> &Gains<M> {
        &self.gains
    }

    /// Λ, J# and N at the observed state.
    pub fn space(&self) -> &OperationalSpace<M> {
        &self.space
    }

    /// What the field does at the observed state.
    pub fn forces(&self) -> &VirtualForces<R::Wrench, D> {
        &self.forces
    }

    /// The way in which the tip of `robot` is to press, of length 1; None where no force is asked for.
    pub fn pressed_by(&self, robot: &R) -> Option<Vector<D>> {
        self.force.as_ref().map(|force| force.direction(robot))
    }

    /// The torque of the last command \[N·m\].
    pub fn torque(&self) -> &Torque {
        &self.law.torque
    }

    /// Takes in the state (q, q̇) and what is around: clearances and forces.
    pub fn observe(&mut self, q: &[f64], dq: &[f64], surroundings: &mut impl CollisionQuery<D>) {
        interrupt::checkpoint(32 * D * D * q.len());
        self.space.update(&mut self.robot, q, dq);
        let pressed = self.pressed_by(&self.robot);
        let pressed = pressed.as_ref();
        self.forces.refresh(&self.robot, &self.space, &self.gains, surroundings, pressed);
        if let Some(avoider) = &mut self.avoider {
            avoider.observe(&self.robot, surroundings, pressed);
        }
    }

    /// Lets the posture of the null space be where `joints` has it at `pace`, which makes of a time \[s\] the positions,
    /// velocities and accelerations of the joints, from the next command on, and barriers keep what `joints` is known to
    /// keep there. Allocates the first time.
    pub fn move_posture(&mut self, joints: &JointSpline, pace: &Pace) {
        let n = self.robot.dof();
        let moving = self.moving.get_or_insert_with(|| Box::new(MovingPosture::new(n)));
        moving.go_to(joints, pace);
        self.gains.move_posture(&moving.state[0]);
        self.keep(Some((joints, pace)));
    }

    /// Makes room for a plan, so that nothing allocates when the posture is moved along it; where that is, it stays.
    pub fn reserve_plan(&mut self, joints: &JointSpline) {
        let n = self.robot.dof();
        self.moving.get_or_insert_with(|| Box::new(MovingPosture::new(n)));
        self.gains.reserve_posture(n);
        self.keep(Some((joints, &Pace { time: 0.0, speed: 0.0, change: 0.0 })));
        self.keep(None);
    }

    /// Lets the posture be where another controller has moved it, and go on as there, if it has; one that `has_own` posture does so
    /// along a plan alone, not where that was left.
    pub fn keep_posture_of(&mut self, other: &Self, has_own: bool) {
        if let (Some(moving), Some(other)) = (&mut self.moving, &other.moving)
            && (other.is_along() || other.has_moved() && !has_own)
        {
            moving.take_over(other);
            self.gains.move_posture(&moving.state[0]);
        }
    }

    /// Lets barriers keep what the settings ask for, and the posture come to rest: no plan is followed any more.
    pub fn leave_plan(&mut self) {
        self.keep(None);
        if let Some(moving) = &mut self.moving {
            moving.leave();
        }
    }

    fn keep(&mut self, plan: Option<(&JointSpline, &Pace)>) {
        if let Some(avoider) = &mut self.avoider {
            avoider.keep(plan);
        }
    }

    /// Where the plan has the joints to which the posture was moved last \[rad or m\], (n); none if it never was.
    pub fn planned(&self) -> Option<&[f64]> {
        let moving = self.moving.as_ref().filter(|moving| moving.has_moved());
        moving.map(|moving| moving.planned.as_slice())
    }

    /// How the plan accelerates the joints \[rad/s², m/s²\], if the posture is on one.
    pub fn planned_acceleration(&self) -> Option<&[f64]> {
        let moving = self.moving.as_ref().filter(|moving| moving.is_along());
        moving.map(|moving| moving.state[2].as_slice())
    }

    /// Lets the posture be that of another controller, at rest.
    pub(in crate::control) fn rest_at_posture_of(&mut self, gains: &Gains<M>) {
        self.gains.posture.clone_from(&gains.posture);
    }

    /// Makes room for so many contacts of each body, so that observing them does not allocate.
    pub(crate) fn reserve(&mut self, contacts: usize) {
        self.forces.reserve(self.robot.body_count());
        if let Some(avoider) = &mut self.avoider {
            avoider.reserve(self.robot.body_count() * contacts);
        }
    }

    /// The pose x of the end effector at the observed state.
    pub fn pose(&self) -> R::Pose {
        self.robot.pose()
    }

    /// The reference of the last command.
    pub fn reference(&self) -> &Sample<R::Pose, M> {
        &self.reference
    }

    /// The error x − x_r of the task at the last command.
    pub fn error(&self) -> &Vector<M> {
        &self.error
    }

    /// The same without the part against which a tip that presses does nothing: there it does not follow the reference.
    pub fn followed_error(&self) -> Vector<M> {
        let free = self.force.as_ref().map(|force| force.free_part(&self.robot, &self.error));
        free.map_or(self.error, |free| self.error - free)
    }

    /// Lets the next command ask for what `output` can send in the next `period` \[s\] after it has sent `sent` \[N·m, N\], at the
    /// observed state. Nothing without a limit of the torque rate.
    pub fn expect(&mut self, output: &mut Output, sent: &[f64], period: f64) {
        if let Some(range) = &mut self.range {
            output.write_range(&self.robot, sent, period, range);
            self.is_ranged = true;
        }
    }

    /// Where roll-outs from the observed state begin.
    pub(super) fn present(&self) -> Present<'_, R> {
        let range = self.range.as_deref().filter(|_| self.is_ranged);
        Present {
            robot: &self.robot,
            sent: range.map(|range| range.present.as_slice()),
            unknown: self.external_torque().unwrap_or(&[]),
        }
    }

    /// The torque at the observed and sensed state for this reference.
    pub fn command(&mut self, reference: &Sample<R::Pose, M>) -> &Torque {
        self.follow(reference);
        self.give_way();
        &self.law.torque
    }

    /// The torque of the null-space law, within the torque limits.
    pub(super) fn follow(&mut self, reference: &Sample<R::Pose, M>) {
        let before = replace(&mut self.reference, *reference);
        self.error = self.robot.pose().error(&reference.x);
        if let Some(reaction) = &mut self.reaction {
            reaction.let_go_on(&(self.error - self.robot.pose().error(&before.x)));
        }
        self.objective_scale = limits::ALL;
        let motion = self.commanded_acceleration();
        let ddx_c = self.press(motion);
        self.gather_secondary();
        match self.gains.formulation {
            Formulation::Recursive => {
                self.law.evaluate(&self.robot, &self.space, &self.gains, &ddx_c, &self.tau_sec);
            }
            Formulation::ExtendedJacobian => extended_jacobian::evaluate(
                &self.robot,
                &self.space,
                &self.gains,
                &ddx_c,
                &self.tau_sec,
                &mut self.law,
            ),
        }
        if let Some(observer) = &mut self.observer {
            let Law { bias, torque, .. } = &mut self.law;
            observer.correct(bias);
            let answer = observer.rejection();
            torque.add_to_task(|i| answer[i]);
        }
        self.find_ends();
        if self.gains.enforce_limits
            && !self.keeps_limits()
            && !limits::within(&self.law.torque.total, &self.ends)
        {
            self.fit_torque(&ddx_c);
        }
    }

    /// Finds between which the torque of the law may be at the observed state, where the drives do not say it.
    fn find_ends(&mut self) {
        if let Some(gravity) = self.gravity.as_mut().filter(|_| !self.is_ranged) {
            write_ends(&self.robot, gravity, &mut self.ends);
        }
    }

    /// Changes that torque where the end effector has to give way, or the drives cannot follow.
    pub(super) fn give_way(&mut self) {
        let Self { robot, space, forces, law, range, avoider, ends, confined, .. } = self;
        let range = range.as_deref().filter(|_| self.is_ranged);
        if let Some(avoider) = avoider {
            let Law { bias, torque, .. } = law;
            let situation = Situation { robot, space, forces, bias, range, ends };
            if avoider.yields() {
                avoider.act(&situation, torque);
            } else {
                // Where only limits act, the balance of the null space (T39) has what they change.
                let change = &mut confined.total;
                change.copy_from_slice(&torque.total);
                avoider.act(&situation, torque);
                if *change != torque.total {
                    change.iter_mut().zip(&torque.total).for_each(|(old, tau)| *old = tau - *old);
                    self.scaling += null_power(space, robot.velocity(), change);
                }
            }
        }
        self.is_ranged = false;
    }

    /// What limits, and distances too where `spares_distances`, make of a torque at the observed state that is not of the law
    /// \[N·m, N\]; None if they leave it as it is.
    pub fn confine(&mut self, wanted: &[f64], spares_distances: bool) -> Option<&[f64]> {
        self.find_ends();
        let is_ranged = replace(&mut self.is_ranged, false);
        let Self { robot, space, forces, law, range, avoider, observer, confined, ends, .. } = self;
        let avoider = avoider.as_mut()?;
        robot.bias_torque(&mut law.bias);
        if let Some(observer) = observer {
            observer.correct(&mut law.bias);
        }
        let range = range.as_deref().filter(|_| is_ranged);
        confined.set(wanted);
        let situation = Situation { robot, space, forces, bias: &law.bias, range, ends };
        avoider.confine(&situation, spares_distances, confined);
        (confined.total != wanted).then_some(confined.total.as_slice())
    }

    /// Whether a QP has the limits of torque and speed among its constraints, which finds other joints for the same motion.
    fn keeps_limits(&self) -> bool {
        self.is_ranged || self.avoider.as_ref().is_some_and(|avoider| avoider.keeps_limits())
    }

    /// ẍ_c (T9), slowed down where a joint would turn too fast (T36, T37), or the drives could not follow (T133).
    fn commanded_acceleration(&mut self) -> Vector<M> {
        let keeps_speeds = self.keeps_limits();
        let Self { robot, space, gains, reference, parts, .. } = self;
        let error = match &self.reaction {
            Some(reaction) => self.error - reaction.offset::<M>(),
            None => self.error,
        };
        let error = match &self.avoider {
            Some(avoider) => avoider.pull(self.forces.clearance(), error),
            None => error,
        };
        let pace = self.reaction.as_ref().map_or(1.0, |reaction| reaction.pace());
        let [dx_r, ddx_r] =
            robot.resolve(&reference.x, &(reference.dx * pace), &(reference.ddx * pace));
        let speed = gains.speed_limits(robot);
        self.law.brake = 0.0;
        if gains.enforce_limits && !keeps_speeds && !speed.is_empty() {
            // The task velocity that K and D ask for: ẍ_c = ẍ_r − D (ẋ − ẋ_d).
            let pull = gains.stiffness.component_mul(&error).component_div(&gains.damping);
            let dx_d = dx_r - pull;
            let share = limits::speed_share(robot, space, &dx_d, speed);
            let brake = limits::brake(robot.velocity(), speed);
            self.law.brake = brake;
            if share < 1.0 || brake > 0.0 {
                self.objective_scale[limits::SPEED] = share;
                let damping = gains.damping.add_scalar(brake);
                return ddx_r * share - damping.component_mul(&(space.dx - dx_d * share));
            }
        }
        let de = space.dx - dx_r;
        match self.range.as_deref().filter(|_| self.is_ranged) {
            None => task::commanded_acceleration(gains, &ddx_r, error, de),
            Some(range) => {
                let torque = &mut parts.task;
                let mut build_up = |ddx: &Vector<M>| {
                    robot.jacobian_tr_mul(&(space.lambda_damped * ddx), torque);
                    range.build_up(torque)
                };
                task::sendable_acceleration(gains, &ddx_r, error, de, &mut build_up)
            }
        }
    }

    /// The same with a force in the place of what moves along one direction, if that is asked for (T158).
    fn press(&mut self, motion: Vector<M>) -> Vector<M> {
        let Self { robot, space, gains, error, observer, force, .. } = self;
        match (force, observer) {
            (Some(force), Some(observer)) => {
                let wrench = observer.wrench::<M>();
                force.select(robot, space, &gains.stiffness, error, wrench, &motion)
            }
            _ => motion,
        }
    }

    /// τ_sec: the repulsion that the tank lets through, and the posture spring (T10).
    fn gather_secondary(&mut self) {
        let Self { robot, space, gains, law, repulsion, tau_sec, parts, .. } = self;
        repulsion.copy_from_slice(self.forces.torque());
        if let Some(field) = &gains.joint_limit_field {
            self.joint_limit_potential = limits::add_joint_limit_torque(
                field,
                robot.limits(),
                robot.configuration(),
                repulsion,
            );
        }
        tau_sec.copy_from_slice(repulsion);
        (self.share, self.scaling) = (1.0, 0.0);
        if let Some(tank) = &mut self.tank {
            let injected = null_power(space, robot.velocity(), repulsion);
            self.share = tank.share(injected);
            self.scaling = (self.share - 1.0) * injected;
            tau_sec.iter_mut().for_each(|tau| *tau *= self.share);
        }
        let Parts { task, posture, .. } = parts;
        let (moving, reaction) = (self.moving.as_deref(), self.reaction.as_deref());
        Spring { moving, reaction }.add_torque(robot, gains, [task, posture], tau_sec);
        if let Some(moving) = self.moving.as_mut().filter(|moving| moving.has_moved()) {
            moving.update_torque(robot, gains, law.brake);
            tau_sec.iter_mut().zip(&moving.torque).for_each(|(tau, along)| *tau += along);
        }
        if let Some(reaction) = reaction {
            self.scaling += dot(robot.velocity(), reaction.torque());
        }
    }

    /// Scales the objectives until every joint is within its torque limit (T35).
    #[cold]
    fn fit_torque(&mut self, ddx_c: &Vector<M>) {
        let Self { robot, space, gains, parts, law, ends, .. } = self;
        let dq = robot.velocity();
        let Parts { posture, task, damping, avoidance, .. } = parts;
        // N q̇, its momentum, and D_q N q̇, with two of the parts as workspaces.
        space.pinv_mul(&space.dx, posture);
        posture.iter_mut().zip(dq).for_each(|(v, dq)| *v = dq - *v);
        robot.mass_mul(posture, damping);
        gains.null_damping.scale_momentum(robot, law.brake, posture, damping, avoidance);
        damping.iter_mut().for_each(|tau| *tau = -*tau);
        posture.fill(0.0);
        let (moving, reaction) = (self.moving.as_deref(), self.reaction.as_deref());
        Spring { moving, reaction }.add_torque(robot, gains, [task, avoidance], posture);
        robot.jacobian_tr_mul(&(space.lambda_damped * ddx_c), task);
        if let Some(moving) = &self.moving {
            posture.iter_mut().zip(&moving.torque).for_each(|(tau, along)| *tau += along);
        }
        for (tau, repulsion) in avoidance.iter_mut().zip(&self.repulsion) {
            *tau = self.share * repulsion;
        }
        for part in [posture, damping, avoidance] {
            law.project(robot, space, gains.projection, part);
        }
        let before = null_power(space, dq, &law.torque.total);
        let objective_scale = parts.fit(ends, &mut law.torque);
        self.scaling += null_power(space, dq, &law.torque.total) - before;
        self.objective_scale[..limits::SPEED].copy_from_slice(&objective_scale[..limits::SPEED]);
    }

    /// Whether the end effector may give way.
    pub fn yields(&self) -> bool {
        self.avoider.as_ref().is_some_and(|avoider| avoider.yields())
    }

    /// By how much the last command violates the barriers at most \[m/s²\]; None without barriers.
    pub fn slack(&self) -> Option<f64> {
        self.avoider.as_ref().and_then(|avoider| avoider.slack())
    }

    /// Whether a program acts at times.
    pub fn has_program(&self) -> bool {
        self.avoider.as_ref().is_some_and(|avoider| avoider.has_program())
    }

    /// What bounds have left out since the beginning.
    pub fn left_out(&self) -> LeftOut {
        self.avoider.as_ref().map_or_else(LeftOut::default, |avoider| avoider.left_out())
    }

    /// `tau ← Nᵀ tau` at the observed state, N of the chosen projection (T4).
    pub fn project(&mut self, tau: &mut [f64]) {
        let Self { robot, space, gains, law, .. } = self;
        law.project(robot, space, gains.projection, tau);
    }

    /// Forgets what it remembers of the past: the tank is as full as at the start, no external torque is known.
    pub fn reset(&mut self) {
        if let Some(observer) = &mut self.observer {
            observer.forget();
        }
        if let Some(avoider) = &mut self.avoider {
            avoider.forget();
        }
        if let Some(force) = &mut self.force {
            force.forget();
        }
        if let Some(reaction) = &mut self.reaction {
            reaction.forget();
        }
        if let Some(moving) = &mut self.moving {
            moving.forget();
            self.gains.forget_posture();
        }
        self.tank = self.gains.tank.map(Tank::new);
    }

    /// Lets `dt` \[s\] pass under the last command: the tank fills or empties.
    pub fn elapse(&mut self, dt: f64) {
        if let Some(moving) = &mut self.moving
            && moving.elapse(dt)
        {
            self.gains.move_posture(&moving.state[0]);
        }
        if let Some(force) = &mut self.force {
            force.elapse(dt);
        }
        if let Some(reaction) = &mut self.reaction {
            reaction.elapse(dt, &self.gains, self.robot.configuration(), &self.error);
        }
        if let Some(tank) = &mut self.tank {
            let injected = null_power(&self.space, self.robot.velocity(), &self.repulsion);
            // Of both as much as torque limits have left.
            let [.., damping, avoidance, _, _] = self.objective_scale;
            tank.elapse(dt, damping * self.law.damping_power - avoidance * self.share * injected);
        }
    }
}

/// (N q̇)ᵀτ, the power of a joint torque into the null motion \[W\].
fn null_power<const M: usize>(space: &OperationalSpace<M>, dq: &[f64], tau: &[f64]) -> f64 {
    dot(dq, tau) - space.dx.dot(&space.pinv_tr_mul(tau))
}
