//! The parts strung together: observe, then command.
//!
//! [`ReactiveController`] sees the present alone. [`Controller`] is the same with look-ahead on top of it, if the
//! settings ask for that; the look-ahead runs a reactive controller of its own.

use super::avoidance::Avoider;
use super::avoidance::preview::Preview;
use super::limits::{self, ObjectiveScale, Parts};
use super::moving_posture::MovingPosture;
use super::{
    Avoidance, Energy, Formulation, Gains, Law, OperationalSpace, Output, Power, Projection,
    StablePeriod, Tank, Torque, TorqueRange, VirtualForces, Yielding, extended_jacobian,
    operational_space, sampling, task,
};
use crate::math::{Pose, Vector, dot};
use crate::robot::Manipulator;
use crate::trajectory::{JointSpline, Pace, Sample};
use crate::world::CollisionQuery;
use nalgebra::{DMatrix, SMatrix};
use std::ops::Deref;

/// The torque controller of [`Controller`] without look-ahead: the law, the forces, the limits, and what gives way.
///
/// Call [`observe`](Self::observe) with the state and the surroundings, then [`command`](Self::command) with the
/// reference. Nothing allocates after construction (`formulation = recursive`).
#[derive(Debug, Clone)]
pub struct ReactiveController<R: Manipulator<D, M>, const D: usize, const M: usize> {
    robot: R,
    gains: Gains<M>,
    space: OperationalSpace<M>,
    forces: VirtualForces<R::Wrench, D>,
    law: Law,
    /// All repulsion: of obstacles, of other links, of joint limits.
    repulsion: Vec<f64>,
    /// τ_sec: what the tank lets through of it, and the posture spring.
    tau_sec: Vec<f64>,
    /// What the posture of a plan asks for beyond its spring; None where the posture does not move.
    moving: Option<Box<MovingPosture>>,
    joint_limit_potential: f64,
    parts: Parts,
    objective_scale: ObjectiveScale,
    tank: Option<Tank>,
    /// Share of the repulsion that the tank lets through.
    share: f64,
    /// What the tank and the torque limits change of the power into the null space \[W\].
    scaling: f64,
    reference: Sample<R::Pose, M>,
    error: Vector<M>,
    /// What gives way where the null space is not enough.
    pub(super) avoider: Option<Box<Avoider<D, M>>>,
    /// What the drives accept next, where their torque cannot change at once; and whether that is known of the next command.
    range: Option<Box<TorqueRange>>,
    is_ranged: bool,
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

    /// The torque of the last command \[N·m\].
    pub fn torque(&self) -> &Torque {
        &self.law.torque
    }

    /// The secondary torque τ_sec = repulsion + posture spring, before projection \[N·m\].
    pub fn secondary_torque(&self) -> &[f64] {
        &self.tau_sec
    }

    /// Takes in the state (q, q̇) and what is around: clearances and forces.
    pub fn observe(&mut self, q: &[f64], dq: &[f64], surroundings: &mut impl CollisionQuery<D>) {
        self.space.update(&mut self.robot, q, dq);
        self.forces.refresh(&self.robot, &self.space, &self.gains, surroundings);
        if let Some(avoider) = &mut self.avoider {
            avoider.observe(&self.robot, surroundings);
        }
    }

    /// Lets the posture of the null space be where `joints` has it at `pace`, which makes of a time \[s\] the positions,
    /// velocities and accelerations of the joints, from the next command on. Allocates the first time.
    pub fn move_posture(&mut self, joints: &JointSpline, pace: &Pace) {
        let n = self.robot.dof();
        let moving = self.moving.get_or_insert_with(|| Box::new(MovingPosture::new(n)));
        moving.go_to(joints, pace);
        self.gains.move_posture(&moving.state[0]);
    }

    /// Where the posture was moved to last \[rad or m\], (n); none if it never was.
    pub fn moved_posture(&self) -> Option<&[f64]> {
        self.moving.as_ref().map(|moving| moving.state[0].as_slice())
    }

    /// Lets the posture be that of another controller, at rest.
    pub(super) fn rest_at_posture_of(&mut self, gains: &Gains<M>) {
        self.gains.posture.clone_from(&gains.posture);
    }

    /// Makes room for so many contacts of each body, so that observing them does not allocate.
    pub(crate) fn reserve(&mut self, contacts: usize) {
        if let Some(avoider) = &mut self.avoider {
            avoider.reserve(self.robot.body_count() * contacts);
        }
    }

    /// The pose x of the end effector at the observed state.
    pub fn pose(&self) -> R::Pose {
        self.robot.pose()
    }

    /// √det(J Jᵀ) at the observed state \[m²\]; 0 in a singularity.
    pub fn manipulability(&self) -> f64 {
        operational_space::manipulability::<R, D, M>(&self.robot)
    }

    /// The reference of the last command.
    pub fn reference(&self) -> &Sample<R::Pose, M> {
        &self.reference
    }

    /// The error x − x_r of the task at the last command.
    pub fn error(&self) -> &Vector<M> {
        &self.error
    }

    /// Lets the next command ask for what `output` can send in the next `period` \[s\] after it has sent `sent` \[N·m, N\], at the
    /// observed state. Nothing without a limit of the torque rate.
    pub fn expect(&mut self, output: &mut Output, sent: &[f64], period: f64) {
        if let Some(range) = &mut self.range {
            output.write_range(&self.robot, sent, period, range);
            self.is_ranged = true;
        }
    }

    /// The torque at the observed and sensed state for this reference.
    pub fn command(&mut self, reference: &Sample<R::Pose, M>) -> &Torque {
        self.follow(reference);
        self.give_way();
        &self.law.torque
    }

    /// The torque of the null-space law, within the torque limits.
    fn follow(&mut self, reference: &Sample<R::Pose, M>) {
        self.reference = *reference;
        self.error = self.robot.pose().error(&reference.x);
        self.objective_scale = limits::ALL;
        let ddx_c = self.commanded_acceleration();
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
        if self.gains.enforce_limits
            && !self.keeps_limits()
            && !limits::within(&self.law.torque.total, &self.robot.limits().torque)
        {
            self.fit_torque(&ddx_c);
        }
    }

    /// Changes that torque where the end effector has to give way, or the drives cannot follow.
    fn give_way(&mut self) {
        let range = self.range.as_deref().filter(|_| self.is_ranged);
        if let Some(avoider) = &mut self.avoider {
            let Law { bias, torque, .. } = &mut self.law;
            if range.is_some() || avoider.yields() {
                avoider.act(&self.robot, &self.space, &self.forces, bias, range, torque);
            }
        }
        self.is_ranged = false;
    }

    /// Whether a QP has the limits of torque and speed among its rows, which finds other joints for the same motion.
    fn keeps_limits(&self) -> bool {
        self.is_ranged || self.slack().is_some()
    }

    /// ẍ_c (T9), slowed down where a joint would turn too fast (T36, T37), or the drives could not follow (T133).
    fn commanded_acceleration(&mut self) -> Vector<M> {
        let keeps_speeds = self.keeps_limits();
        let Self { robot, space, gains, reference, parts, .. } = self;
        let error = match &self.avoider {
            Some(avoider) => avoider.pull(self.forces.clearance(), self.error),
            None => self.error,
        };
        let [dx_r, ddx_r] = robot.resolve(&reference.x, &reference.dx, &reference.ddx);
        let speed = &robot.limits().velocity;
        self.law.brake = 0.0;
        if gains.enforce_limits && !keeps_speeds && !speed.is_empty() {
            // The task velocity that K and D ask for: ẍ_c = ẍ_r − D (ẋ − ẋ_d).
            let pull = gains.stiffness.component_mul(&error).component_div(&gains.damping);
            let dx_d = dx_r - pull;
            let share = limits::speed_share(robot, space, &dx_d);
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

    /// τ_sec: the repulsion that the tank lets through, and the posture spring (T10).
    fn gather_secondary(&mut self) {
        let Self { robot, space, gains, repulsion, tau_sec, .. } = self;
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
        gains.add_posture_torque(robot.configuration(), tau_sec);
        if let Some(moving) = &mut self.moving {
            moving.update_torque(robot, gains);
            tau_sec.iter_mut().zip(&moving.torque).for_each(|(tau, along)| *tau += along);
        }
    }

    /// Scales the objectives until every joint is within its torque limit (T35).
    #[cold]
    fn fit_torque(&mut self, ddx_c: &Vector<M>) {
        let Self { robot, space, gains, parts, law, .. } = self;
        let dq = robot.velocity();
        let Parts { posture, task, damping, avoidance, .. } = parts;
        robot.jacobian_tr_mul(&(space.lambda_damped * ddx_c), task);
        // N q̇, its momentum, and D_q N q̇, with two of the parts as workspaces.
        space.pinv_mul(&space.dx, posture);
        posture.iter_mut().zip(dq).for_each(|(v, dq)| *v = dq - *v);
        robot.mass_mul(posture, damping);
        gains.null_damping.scale_momentum(robot, law.brake, posture, damping, avoidance);
        damping.iter_mut().for_each(|tau| *tau = -*tau);
        posture.fill(0.0);
        gains.add_posture_torque(robot.configuration(), posture);
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
        let objective_scale = parts.fit(&robot.limits().torque, &mut law.torque);
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

    /// `tau ← Nᵀ tau` at the observed state, N of the chosen projection (T4).
    pub fn project(&mut self, tau: &mut [f64]) {
        let Self { robot, space, gains, law, .. } = self;
        law.project(robot, space, gains.projection, tau);
    }

    /// The null projector N of the chosen projection as a matrix, (n, n), for people.
    pub fn null_projector(&self) -> DMatrix<f64> {
        let n = self.robot.dof();
        let j = self.robot.matrices::<M>().jacobian;
        let identity = DMatrix::identity(n, n);
        match self.gains.projection {
            Projection::Dynamic => {
                let pinv = DMatrix::from_fn(n, M, |k, i| (self.space.lambda * self.space.y[k])[i]);
                identity - pinv * j
            }
            Projection::Kinematic => {
                let gram: SMatrix<f64, M, M> = &j * j.transpose();
                let inverse = gram.try_inverse().unwrap_or_else(SMatrix::zeros);
                identity - j.transpose() * inverse * j
            }
            Projection::None => identity,
        }
    }

    /// C q̇ + g at the state of the last command \[N·m\].
    pub fn bias(&self) -> &[f64] {
        &self.law.bias
    }

    /// ‖J M⁻¹ τ_null‖ of the last command: what leaks into the task \[m/s²\] (T4).
    pub fn null_acceleration(&self) -> f64 {
        self.gains.metric::<D>().norm(&self.space.response(&self.law.torque.null))
    }

    /// Energies of the arm at the last command.
    pub fn energy(&self) -> Energy {
        let (dx, q) = (&self.space.dx, self.robot.configuration());
        Energy {
            kinetic: 0.5 * dx.dot(&(self.space.lambda * dx)) + self.law.null_energy,
            gravitational: self.robot.potential_energy(),
            null_storage: self.law.null_energy
                + self.forces.potential()
                + self.joint_limit_potential
                + self.gains.posture_energy(q),
        }
    }

    /// Powers through the ports of (T17) at the last command, and that of `applied`, the torque of the
    /// motors \[N·m\].
    pub fn power(&self, applied: &[f64]) -> Power {
        let Self { robot, space, forces, law, .. } = self;
        let mut along_task = space.dx.dot(&space.pinv_tr_mul(&self.tau_sec));
        if self.share < 1.0 {
            along_task += (1.0 - self.share) * space.dx.dot(&space.pinv_tr_mul(&self.repulsion));
        }
        Power {
            actuators: dot(robot.velocity(), applied),
            damping: -law.damping_power,
            task: -along_task,
            obstacles: forces.obstacle_power(),
            approach: forces.approach_power(),
            scaling: self.scaling,
        }
    }

    /// The share that was granted of each objective at the last command ([`limits::OBJECTIVES`]).
    pub fn objective_scale(&self) -> &ObjectiveScale {
        &self.objective_scale
    }

    /// The energy tank, if there is one.
    pub fn tank(&self) -> Option<&Tank> {
        self.tank.as_ref()
    }

    /// Forgets what it remembers of the past: the tank is as full as at the start.
    pub fn reset(&mut self) {
        self.tank = self.gains.tank.map(Tank::new);
    }

    /// Lets `dt` \[s\] pass under the last command: the tank fills or empties.
    pub fn elapse(&mut self, dt: f64) {
        if let Some(tank) = &mut self.tank {
            let injected = null_power(&self.space, self.robot.velocity(), &self.repulsion);
            tank.elapse(dt, self.law.damping_power - self.share * injected);
        }
    }

    /// The largest control period at which the null space is stable at the observed state (T34).
    /// Allocates.
    pub fn stable_period(&self, surroundings: &mut impl CollisionQuery<D>) -> StablePeriod {
        sampling::stable_period(&self.robot, &self.space, &self.gains, surroundings)
    }

    /// The same for an obstacle that is still to come, at `speed` \[m/s\]. Allocates.
    pub fn stable_period_against(&self, speed: f64) -> StablePeriod {
        sampling::stable_period_against(&self.robot, &self.space, &self.gains, speed)
    }
}

/// A torque controller for a robot `R` with a task of dimension `M`.
///
/// Call [`observe`](Self::observe) with the state and the surroundings, [`look_ahead`](Self::look_ahead) if the
/// settings ask for look-ahead, then [`command`](Self::command) with the reference. Nothing allocates after
/// construction (`formulation = recursive`). Everything that can be read is that of the [`ReactiveController`]
/// below.
#[derive(Debug, Clone)]
pub struct Controller<R: Manipulator<D, M>, const D: usize, const M: usize> {
    reactive: ReactiveController<R, D, M>,
    preview: Option<Box<Preview<R, D, M>>>,
}

impl<R: Manipulator<D, M>, const D: usize, const M: usize> Deref for Controller<R, D, M> {
    type Target = ReactiveController<R, D, M>;

    fn deref(&self) -> &Self::Target {
        &self.reactive
    }
}

impl<R: Manipulator<D, M> + Clone, const D: usize, const M: usize> Controller<R, D, M> {
    /// A controller for `robot`, with gains resolved for its number of joints.
    pub fn new(robot: R, gains: Gains<M>) -> Self {
        let preview = match (gains.avoidance, &gains.yielding) {
            (Avoidance::Cbf, Yielding { preview: Some(settings), .. }) => {
                Some(Box::new(Preview::new(&robot, &gains, settings)))
            }
            _ => None,
        };
        Self { reactive: ReactiveController::new(robot, gains), preview }
    }

    /// Takes in the state (q, q̇) and what is around: clearances and forces.
    pub fn observe(&mut self, q: &[f64], dq: &[f64], surroundings: &mut impl CollisionQuery<D>) {
        self.reactive.observe(q, dq, surroundings);
    }

    /// Makes room for all contacts with these surroundings, so that the next observation, look-ahead and command among
    /// them do not allocate. What was observed is to be observed again.
    pub fn reserve(&mut self, surroundings: &impl CollisionQuery<D>) {
        let most = surroundings.contact_count().max(surroundings.barrier_count());
        self.reactive.reserve(most);
        if let Some(preview) = &mut self.preview {
            preview.reserve(surroundings.obstacle_count(), most);
        }
    }

    /// [`ReactiveController::moved_posture`].
    pub fn moved_posture(&self) -> Option<&[f64]> {
        self.reactive.moved_posture()
    }

    /// [`ReactiveController::move_posture`]; the look-ahead takes the posture for one at rest.
    pub fn move_posture(&mut self, joints: &JointSpline, pace: &Pace) {
        self.reactive.move_posture(joints, pace);
        if let Some(preview) = &mut self.preview {
            preview.rest_at_posture_of(&self.reactive.gains);
        }
    }

    /// [`ReactiveController::expect`].
    pub fn expect(&mut self, output: &mut Output, sent: &[f64], period: f64) {
        self.reactive.expect(output, sent, period);
    }

    /// Looks ahead from the observed state, if it is time: `reference(s)` is that in s seconds.
    pub fn look_ahead(
        &mut self,
        surroundings: &mut impl CollisionQuery<D>,
        reference: impl Fn(f64) -> Sample<R::Pose, M>,
    ) {
        if let Some(preview) = &mut self.preview {
            preview.advance(&self.reactive.robot, surroundings, &reference);
        }
    }

    /// The torque at the observed state for this reference.
    pub fn command(&mut self, reference: &Sample<R::Pose, M>) -> &Torque {
        let Self { reactive, preview } = self;
        reactive.follow(reference);
        if let Some(preview) = preview {
            let Law { bias, torque, .. } = &mut reactive.law;
            preview.act(&reactive.robot, &reactive.space, bias, torque);
        }
        reactive.give_way();
        &reactive.law.torque
    }

    /// `tau ← Nᵀ tau` at the observed state, N of the chosen projection (T4).
    pub fn project(&mut self, tau: &mut [f64]) {
        self.reactive.project(tau);
    }

    /// Forgets what it remembers of the past: the tank is as full as at the start, and no candidate is taken.
    pub fn reset(&mut self) {
        self.reactive.reset();
        if let Some(preview) = &mut self.preview {
            preview.reset();
        }
    }

    /// Lets `dt` \[s\] pass under the last command: the tank fills or empties, the look-ahead's time goes on.
    pub fn elapse(&mut self, dt: f64) {
        if let Some(preview) = &mut self.preview {
            preview.elapse(dt);
        }
        self.reactive.elapse(dt);
    }
}

/// (N q̇)ᵀτ, the power of a joint torque into the null motion \[W\].
fn null_power<const M: usize>(space: &OperationalSpace<M>, dq: &[f64], tau: &[f64]) -> f64 {
    dot(dq, tau) - space.dx.dot(&space.pinv_tr_mul(tau))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Settings;
    use crate::field::{Field, FieldKind};
    use crate::math::ScalarOrVec;
    use crate::robot::{Model, PlanarState, Robot};
    use crate::testing::{Case, assert_close, case};
    use crate::world::Motion;
    use crate::world::plane::{Obstacle, Shape, World};
    use nalgebra::DVector;
    use proptest::prelude::*;

    const FORMULATIONS: [Formulation; 2] = [Formulation::Recursive, Formulation::ExtendedJacobian];

    fn settings(formulation: Formulation, projection: Projection) -> Settings {
        let field = Field {
            kind: FieldKind::Khatib,
            gain: 0.8,
            influence: 2.0,
            floor: None,
            approach_damping: 0.5,
            sliding: 20.0,
        };
        Settings { field, formulation, projection, ..Settings::default() }
    }

    /// Two discs near the arm, one of them moving, and what the arm makes of them.
    fn sensed<const M: usize>(c: &Case, settings: &Settings) -> Controller<PlanarState, 2, M>
    where
        PlanarState: Manipulator<2, M>,
    {
        let mut controller = Controller::<_, 2, M>::new(c.arm.state(), Gains::new(settings));
        let middle = c.state().link(c.q.len() / 2);
        let near = middle.start + middle.direction * (0.3 * middle.length);
        let disc = |x: f64, y: f64, velocity| Obstacle {
            shape: Shape::Circle { radius: 0.2 },
            position: [near.x + x, near.y + y],
            angle: 0.0,
            angular_velocity: 0.0,
            motion: Motion::Linear { velocity },
        };
        let mut world = World::new(vec![disc(0.5, 0.6, [-1.0, -0.4]), disc(-0.7, 0.2, [0.0, 0.0])]);
        controller.observe(&c.q, &c.dq, &mut world);
        controller
    }

    fn reference<P: From<Vector<M>>, const M: usize>() -> Sample<P, M> {
        let fill = |a: f64, b: f64| Vector::<M>::from_fn(|i, _| a + b * i as f64);
        Sample { x: fill(1.0, -0.3).into(), dx: fill(0.2, 0.5), ddx: fill(-0.7, 0.4) }
    }

    /// How far the state is from a singularity: the smallest eigenvalue of Λ⁻¹ over the largest.
    fn conditioning<const M: usize>(controller: &Controller<PlanarState, 2, M>) -> f64
    where
        PlanarState: Manipulator<2, M>,
    {
        let lambda = controller.space().lambda;
        let inverse = lambda.try_inverse().map_or(f64::INFINITY, |inverse| inverse.norm());
        1.0 / (lambda.norm() * inverse)
    }

    /// ẍ = ẍ_c exactly and J M⁻¹ τ_null = 0 (T14, T4), and both formulations give one torque.
    fn check_law<const M: usize>(c: &Case, projection: Projection) -> Result<(), TestCaseError>
    where
        PlanarState: Manipulator<2, M>,
        <PlanarState as Manipulator<2, M>>::Pose: From<Vector<M>>,
    {
        let n = c.q.len();
        let mut totals = vec![];
        for formulation in FORMULATIONS {
            let mut controller = sensed::<M>(c, &settings(formulation, projection));
            prop_assume!(conditioning(&controller) > 1e-4 && !controller.space().singular);
            let sample = reference();
            let torque = controller.command(&sample).clone();
            let e = *controller.error();
            let robot = c.state();
            let (mut scratch, mut ddq) = (vec![0.0; n], vec![0.0; n]);
            robot.forward_dynamics(&torque.total, &mut scratch, &mut ddq);
            let ddx = robot.jacobian_mul::<M>(&ddq) + robot.jacobian_dot_mul::<M>(&c.dq);
            let de = robot.jacobian_mul::<M>(&c.dq) - sample.dx;
            let expected = sample.ddx - de * 8.0 - e * 16.0;
            robot.mass_solve(&torque.null, &mut ddq);
            let leak = robot.jacobian_mul::<M>(&ddq).norm();
            let scale = 1.0 + DVector::from_column_slice(&ddq).norm();
            if projection == Projection::Dynamic {
                prop_assert!(leak <= 1e-9 * scale, "{formulation:?} leaks {leak} of {scale}");
                let size = 1.0 + expected.norm();
                prop_assert!((ddx - expected).norm() <= 1e-7 * size, "{ddx} {expected}");
            }
            totals.push(torque.total);
        }
        assert_close(&totals[0], &totals[1], 1e-8);
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]

        #[test]
        fn law_in_both_formulations(c in case(3usize..13)) {
            check_law::<2>(&c, Projection::Dynamic)?;
        }

        #[test]
        fn law_for_a_pose(c in case(4usize..13)) {
            check_law::<3>(&c, Projection::Dynamic)?;
        }

        #[test]
        fn comparison_projections_in_both_formulations(c in case(3usize..9)) {
            check_law::<2>(&c, Projection::Kinematic)?;
            check_law::<2>(&c, Projection::None)?;
        }

        /// Per-joint damping D_q = √d M √d is symmetric and takes power in every state.
        #[test]
        fn null_damping_dissipates(c in case(3usize..9)) {
            let each = (0..c.q.len()).map(|i| 0.5 + i as f64).collect();
            for formulation in FORMULATIONS {
                let base = settings(formulation, Projection::Dynamic);
                let settings = Settings { null_damping: ScalarOrVec::Each(Clone::clone(&each)), ..base };
                let mut controller = sensed::<2>(&c, &settings);
                controller.command(&reference());
                prop_assert!(controller.law.damping_power >= 0.0);
            }
        }

        /// The sliding force (T82) is orthogonal to the relative velocity of link and obstacle: all its power
        /// comes from obstacles that move.
        #[test]
        fn sliding_does_no_work_of_its_own(c in case(3usize..9)) {
            let slid = settings(Formulation::Recursive, Projection::Dynamic);
            let mut plain = slid.clone();
            plain.field.sliding = 0.0;
            let (slid, plain) = (sensed::<2>(&c, &slid), sensed::<2>(&c, &plain));
            let power = slid.forces.power(&c.dq) - plain.forces.power(&c.dq);
            let moved = slid.forces.obstacle_power() - plain.forces.obstacle_power();
            let scale = slid.forces.power(&c.dq).abs() + slid.forces.obstacle_power().abs() + 1.0;
            prop_assert!((power - moved).abs() <= 1e-10 * scale, "{power} {moved}");
        }

        /// Basis independence: the extended Jacobian in a turned basis ZR has
        /// the same projector, block-diagonal E_e, J_e J_e⁻¹ = I and Ė − 2μ skew by its
        /// symmetric part μ + μᵀ = Ė.
        #[test]
        fn extended_jacobian_identities(c in case(4usize..9), angle in 0.1..3.0) {
            use super::extended_jacobian::ExtendedJacobian;
            let state = c.state();
            let m = state.matrices::<2>();
            let Some(extended) = ExtendedJacobian::new(&m) else { return Err(TestCaseError::reject("singular")) };
            prop_assume!(extended.lambda_x.norm() * extended.lambda_x.clone().try_inverse().unwrap().norm() < 1e4);
            let n = c.q.len();
            let identity = DMatrix::<f64>::identity(n, n);
            prop_assert!((&extended.j_e * &extended.j_e_inv - &identity).norm() < 1e-9);
            let e = extended.j_e_inv.transpose() * &m.mass * &extended.j_e_inv;
            prop_assert!((e - &extended.e_e).norm() < 1e-9 * extended.e_e.norm());
            let mut turn = DMatrix::<f64>::identity(n - 2, n - 2);
            let (sin, cos) = f64::sin_cos(angle);
            turn[(0, 0)] = cos;
            turn[(0, 1)] = -sin;
            turn[(1, 0)] = sin;
            turn[(1, 1)] = cos;
            let turned = ExtendedJacobian::with_basis(&m, &extended.z * turn).unwrap();
            prop_assert!((turned.null_projector() - extended.null_projector()).norm() < 1e-9);
        }
    }

    /// Stretched, folded and short arms: finite torque, a damped task force, and whatever acts in
    /// the null space still does not move the end effector where it can move at all.
    #[test]
    fn singular_configurations_stay_finite() {
        use crate::robot::{PlanarArm, planar::Link};
        for (n, q) in [
            (1, vec![0.3]),
            (2, vec![0.3, 0.0]),
            (6, vec![0.0; 6]),
            (3, vec![0.2, std::f64::consts::PI, 0.0]),
        ] {
            let arm = PlanarArm::new(vec![Link::rod(1.0, 1.0); n], Vector::<2>::new(0.0, -9.81));
            let zero = vec![0.0; n];
            let c = Case { arm: arm.into(), q, dq: vec![0.1; n], u: zero.clone(), v: zero };
            for formulation in FORMULATIONS {
                let mut controller = sensed::<2>(&c, &settings(formulation, Projection::Dynamic));
                assert!(controller.space().singular);
                let torque = controller.command(&reference()).clone();
                assert!(torque.total.iter().all(|t| t.is_finite()), "{n}: {torque:?}");
                let leak = controller.space().response(&torque.null).norm();
                assert!(leak < 1e-9, "{n}: {leak}");
            }
        }
    }
}
