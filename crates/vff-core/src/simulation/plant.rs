//! The physical arm: what the torque meets, whatever the controller believes.

use super::impulses::Impulses;
use crate::math::dot;
use crate::robot::{Model, Robot};
use std::sync::Arc;

/// The parameters of the physical arm. A list is empty where there is none of it.
#[derive(Debug, Clone)]
pub struct Physics<A> {
    /// Its links; the controller's own model if there is no difference.
    pub arm: Arc<A>,
    /// Viscous friction of the joints \[N·m·s/rad\].
    pub viscous: Vec<f64>,
    /// Dry friction of the joints \[N·m\].
    pub coulomb: Vec<f64>,
    /// Where the joints stop: \[lower, upper\] \[rad\].
    pub stops: Vec<[f64; 2]>,
    /// Whether the robot adds the torque that holds these links against gravity.
    pub compensates_gravity: bool,
}

impl<A> Physics<A> {
    /// The arm alone.
    pub fn of(arm: &Arc<A>) -> Self {
        Self {
            arm: Arc::clone(arm),
            viscous: vec![],
            coulomb: vec![],
            stops: vec![],
            compensates_gravity: false,
        }
    }
}

/// The physical arm with its workspace. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub struct Plant<A: Model<D>, const D: usize> {
    physics: Physics<A>,
    state: A::State,
    impulses: Impulses,
    /// The torque that viscous friction leaves.
    torque: Vec<f64>,
    /// The torque against gravity that the robot adds.
    gravity: Vec<f64>,
    scratch: Vec<f64>,
    /// What the impulses change of the velocity.
    change: Vec<f64>,
}

impl<A> Physics<A> {
    /// Whether anything acts that is not continuous: stops and dry friction.
    pub fn has_impulses(&self) -> bool {
        !(self.coulomb.is_empty() && self.stops.is_empty())
    }
}

impl<A: Model<D>, const D: usize> Plant<A, D> {
    /// A plant at q = 0, at rest.
    pub fn new(physics: Physics<A>) -> Self {
        let n = physics.arm.dof();
        let zeros = || vec![0.0; n];
        Self {
            state: physics.arm.state(),
            // Its matrix is large for a long arm, and of no use to one without stops and dry friction.
            impulses: Impulses::new(if physics.has_impulses() { n } else { 0 }),
            torque: zeros(),
            gravity: zeros(),
            scratch: zeros(),
            change: zeros(),
            physics,
        }
    }

    /// The links.
    pub fn arm(&self) -> &Arc<A> {
        &self.physics.arm
    }

    /// The links at the state of the last [`update`](Self::update).
    pub fn state(&self) -> &A::State {
        &self.state
    }

    /// Moves to the state (q, q̇).
    pub fn update(&mut self, q: &[f64], dq: &[f64]) {
        self.state.update(q, dq);
    }

    /// Moves to the state (q, q̇): q̈ under a torque there.
    pub fn accelerate(&mut self, q: &[f64], dq: &[f64], tau: &[f64], ddq: &mut [f64]) {
        let Self { physics, state, torque, gravity, scratch, .. } = self;
        let tau = resisted(&physics.viscous, tau, dq, torque);
        if physics.compensates_gravity {
            state.update(q, dq);
            state.forward_dynamics(carried(state, tau, gravity), scratch, ddq);
        } else {
            state.update_with_dynamics(q, dq, tau, scratch, ddq);
        }
    }

    /// The same where a controller whose model is the plant stands at this very state: what it has
    /// factorised serves the plant too.
    pub fn accelerate_as(&mut self, model: &A::State, tau: &[f64], bias: &[f64], ddq: &mut [f64]) {
        let Self { physics, torque, gravity, scratch, .. } = self;
        let tau = resisted(&physics.viscous, tau, model.velocity(), torque);
        let tau = match physics.compensates_gravity {
            true => carried(model, tau, gravity),
            false => tau,
        };
        model.accelerate(tau, bias, scratch, ddq);
    }

    /// Completes a step of `dt` \[s\] under the torque `tau` from `before` to (q, q̇) by what does not
    /// act continuously: joints stop at their stops, without bouncing, and dry friction takes its
    /// share (T45).
    ///
    /// The impulses act as a constant torque would: `weight` of their change of velocity, ½ or what
    /// the integrator uses, counts for the positions at the end of the step.
    pub fn settle(
        &mut self,
        tau: &[f64],
        before: &[Vec<f64>; 2],
        q: &mut [f64],
        dq: &mut [f64],
        [dt, weight]: [f64; 2],
    ) {
        let stops = &self.physics.stops;
        let beyond = |(q, [lower, upper]): (&f64, &[f64; 2])| q <= lower || upper <= q;
        if self.physics.coulomb.is_empty() && !q.iter().zip(stops).any(beyond) {
            return;
        }
        self.state.update(q, dq);
        let [kinetic, potential] = self.energies();
        let mut allowed = kinetic + potential - dot(tau, q);

        let Self { physics, state, impulses, change, .. } = self;
        for (i, q) in q.iter_mut().enumerate() {
            let friction = dt * physics.coulomb.get(i).copied().unwrap_or(0.0);
            let (mut lower, mut upper) = (-friction, friction);
            if let Some([least, most]) = physics.stops.get(i) {
                if *q <= *least {
                    (*q, upper) = (*least, f64::INFINITY);
                } else if *q >= *most {
                    (*q, lower) = (*most, f64::NEG_INFINITY);
                }
            }
            (impulses.lower[i], impulses.upper[i]) = (lower, upper);
        }
        state.update(q, dq);
        change.copy_from_slice(dq);
        impulses.apply(state, dq);
        for i in 0..q.len() {
            let stopped = impulses.lower[i].is_infinite() || impulses.upper[i].is_infinite();
            let stands = before[1][i] == 0.0 && dq[i] == 0.0;
            if stands && !stopped {
                q[i] = before[0][i];
            }
            change[i] = if stands || stopped { 0.0 } else { dq[i] - change[i] };
        }
        physics.arm.integrate(q, change, weight * dt);
        for (q, [lower, upper]) in q.iter_mut().zip(&physics.stops) {
            *q = q.clamp(*lower, *upper);
        }

        // Putting joints back has changed the energy, by little, but the wrong way as easily as the
        // right one: what there is too much of is taken out of the motion (T46).
        state.update(q, dq);
        let [kinetic, potential] = self.energies();
        allowed = (allowed + dot(tau, q) - potential).max(0.0);
        if kinetic > allowed {
            let slower = (allowed / kinetic).sqrt();
            dq.iter_mut().for_each(|v| *v *= slower);
        }
    }

    /// `out +=` the torque that the robot adds by itself at (q, q̇) \[N·m\]; moves there. Nothing if it adds none.
    pub fn add_own_torque(&mut self, q: &[f64], dq: &[f64], out: &mut [f64]) {
        if self.physics.compensates_gravity {
            self.update(q, dq);
            self.state.gravity_torque(&mut self.gravity);
            out.iter_mut().zip(&self.gravity).for_each(|(out, g)| *out += g);
        }
    }

    /// Whether the robot adds gravity's torque, from now on.
    pub fn compensate_gravity(&mut self, does: bool) {
        self.physics.compensates_gravity = does;
    }

    /// Kinetic and potential energy \[J\] at the state of the last [`update`](Self::update); where the robot holds itself
    /// against gravity, height costs nothing.
    fn energies(&mut self) -> [f64; 2] {
        let Self { state, scratch, .. } = self;
        state.mass_mul(state.velocity(), scratch);
        let held = self.physics.compensates_gravity;
        let potential = if held { 0.0 } else { state.potential_energy() };
        [0.5 * dot(scratch, state.velocity()), potential]
    }
}

/// τ − B q̇ (T44), in `out` where there is any friction.
fn resisted<'a>(viscous: &[f64], tau: &'a [f64], dq: &[f64], out: &'a mut [f64]) -> &'a [f64] {
    if viscous.is_empty() {
        return tau;
    }
    for (i, out) in out.iter_mut().enumerate() {
        *out = tau[i] - viscous[i] * dq[i];
    }
    out
}

/// τ + g, in `out`.
fn carried<'a, R: Robot<D>, const D: usize>(
    robot: &R,
    tau: &[f64],
    out: &'a mut [f64],
) -> &'a [f64] {
    robot.gravity_torque(out);
    out.iter_mut().zip(tau).for_each(|(out, tau)| *out += tau);
    out
}
