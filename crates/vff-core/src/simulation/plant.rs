//! The physical arm: what the torque meets, whatever the controller believes.

use super::contact::{ContactSettings, Contacts};
use super::impulses::Impulses;
use super::pull::{Pull, Spring};
use super::wrench::{Acting, Wrench};
use super::wrenches::Wrenches;
use crate::math::{Vector, dot};
use crate::robot::{Model, Robot};
use crate::world::{ObstacleGeometry, World};
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

/// Of the fastest motion that a spring makes, an integrator's step passes at most this share of a radian (T147).
const SHARE: f64 = 0.25;
/// The most parts of a plant step.
const MAX_PARTS: f64 = 1000.0;

/// The physical arm with its workspace. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub struct Plant<A: Model<D>, S: ObstacleGeometry<D>, const D: usize> {
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
    /// What pushes from outside, if anything does.
    wrenches: Option<Box<Wrenches<A::State, D>>>,
    /// Which obstacles are felt, if any are.
    contacts: Option<Box<Contacts<A::State, S, D>>>,
    /// Their torque over the present step \[N·m, N\]; zeros without any.
    external: Vec<f64>,
    /// Whether their torque is told of even where nothing pushes.
    is_touchable: bool,
    /// No eigenvalue of what springs make of the arm is larger over the present step \[1/s\].
    rate: f64,
}

impl<A> Physics<A> {
    /// Whether anything acts that is not continuous: stops and dry friction.
    pub fn has_impulses(&self) -> bool {
        !(self.coulomb.is_empty() && self.stops.is_empty())
    }
}

impl<A: Model<D>, S: ObstacleGeometry<D>, const D: usize> Plant<A, S, D> {
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
            wrenches: None,
            contacts: None,
            external: zeros(),
            is_touchable: false,
            rate: 0.0,
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

    /// Lets these push from outside, from now on.
    ///
    /// # Errors
    /// As [`Wrenches::new`].
    pub fn push_with(&mut self, given: &[Wrench<D>]) -> Result<(), (usize, Vec<String>)> {
        let wrenches = Wrenches::new(given, &*self.physics.arm)?;
        self.wrenches = Some(Box::new(wrenches)).filter(|wrenches| !wrenches.is_empty());
        Ok(())
    }

    /// One more.
    ///
    /// # Errors
    /// As [`Wrenches::add`].
    pub fn add_wrench(&mut self, wrench: Wrench<D>) -> Result<(), Vec<String>> {
        let arm = Arc::clone(&self.physics.arm);
        self.wrenches_mut().add(wrench, &*arm)
    }

    /// What pushes from outside, also where nothing has until now.
    fn wrenches_mut(&mut self) -> &mut Wrenches<A::State, D> {
        let none =
            || Wrenches::new(&[], &*self.physics.arm).expect("every arm has none of the links");
        self.wrenches.get_or_insert_with(|| Box::new(none()))
    }

    /// Lets somebody pull at the arm at (q, q̇) from now on, or let go; moves there.
    ///
    /// # Errors
    /// As [`Spring::new`]; then all is as before.
    pub fn pull(
        &mut self,
        pull: Option<&Pull<D>>,
        q: &[f64],
        dq: &[f64],
    ) -> Result<(), Vec<String>> {
        self.state.update(q, dq);
        let spring = pull.map(|pull| Spring::new(pull, &*self.physics.arm, &self.state));
        let spring = spring.transpose()?;
        self.wrenches_mut().pull(spring);
        Ok(())
    }

    /// Lets whoever pulls do so towards another place \[m\].
    pub fn pull_towards(&mut self, anchor: Vector<D>) {
        if let Some(spring) = self.wrenches.as_mut().and_then(|wrenches| wrenches.pulled_mut()) {
            spring.anchor = anchor;
        }
    }

    /// What somebody pulls with where the arm was felt last, and towards where \[m\].
    pub fn pulled(&self) -> Option<(Acting<D>, Vector<D>)> {
        let spring = self.wrenches.as_ref()?.pulled()?;
        Some((spring.acting(&self.state), spring.anchor))
    }

    /// Tells of the torque from outside even where nothing pushes, so that records have room for it.
    pub fn make_touchable(&mut self) {
        self.is_touchable = true;
    }

    /// Forgets those that were added and are over at time `t` \[s\]; how many there are then.
    pub fn forget_past_wrenches(&mut self, t: f64) -> usize {
        self.wrenches.as_mut().map_or(0, |wrenches| {
            wrenches.forget_past(t);
            wrenches.count()
        })
    }

    /// Forgets those that were added.
    pub fn forget_added_wrenches(&mut self) {
        if let Some(wrenches) = &mut self.wrenches {
            wrenches.forget_added();
        }
        if self.wrenches.take_if(|wrenches| wrenches.is_empty()).is_some() {
            self.external.fill(0.0);
            self.rate = 0.0;
        }
    }

    /// Lets obstacles of a world be felt that resist, from now on.
    pub fn surround(&mut self, world: &World<S, D>, settings: &[Option<ContactSettings>]) {
        self.contacts = Contacts::new(world, settings, &self.state).map(Box::new);
    }

    /// What is felt of the obstacles, if any is.
    pub fn contacts_mut(&mut self) -> Option<&mut Contacts<A::State, S, D>> {
        self.contacts.as_deref_mut()
    }

    /// Lets a plant elsewhere say what is felt of the obstacles, where any is.
    pub fn listen(&mut self) {
        self.external.fill(0.0);
        if let Some(contacts) = &mut self.contacts {
            contacts.listen();
        }
    }

    /// Whether a link that presses into obstacle `j` is resisted; of any where no contact is felt.
    pub fn resists(&self, j: usize) -> bool {
        self.contacts.as_ref().is_none_or(|contacts| contacts.resists(j))
    }

    /// Takes in what that says of the contacts where the arm was felt last: the obstacle of each, and the force on a link.
    pub fn tell(&mut self, told: impl Iterator<Item = (usize, Acting<D>)>) {
        if let Some(contacts) = &mut self.contacts {
            contacts.tell(&self.state, told);
        }
    }

    /// The force of each obstacle where the arm was felt last \[N\], one coordinate after the other; None if none is felt.
    pub fn contact_forces(&self) -> Option<&[f64]> {
        self.contacts.as_deref().map(Contacts::forces)
    }

    /// Obstacles that are felt move to time `t` \[s\].
    pub fn go_to(&mut self, t: f64) {
        if let Some(contacts) = &mut self.contacts {
            contacts.go_to(t);
        }
    }

    /// Whether anything is there to push.
    fn is_touched(&self) -> bool {
        self.wrenches.is_some() || self.contacts.is_some()
    }

    /// Lets what pushes over a plant step of `dt` \[s\] from time `t` \[s\] on act on the arm at (q, q̇); moves there, if
    /// anything does. Wrenches are, over a step, what they are in its middle.
    pub fn feel(&mut self, q: &[f64], dq: &[f64], t: f64, dt: f64) {
        if !self.is_touched() {
            return;
        }
        let Self { wrenches, contacts, external, state, rate, .. } = self;
        state.update(q, dq);
        external.fill(0.0);
        *rate = 0.0;
        if let Some(wrenches) = wrenches {
            wrenches.go_to(t + 0.5 * dt);
            external.copy_from_slice(wrenches.torque(state));
            *rate = wrenches.pulled().map_or(0.0, |spring| spring.rate(state));
        }
        if let Some(contacts) = contacts {
            contacts.go_to(t);
            let torque = contacts.torque(state).iter();
            external.iter_mut().zip(torque).for_each(|(sum, torque)| *sum += torque);
            *rate += contacts.rate(state, dt);
        }
    }

    /// In how many parts a plant step of `dt` \[s\] is taken, so that no spring is too stiff for it (T147).
    #[inline]
    pub fn parts(&self, dt: f64) -> u32 {
        if self.rate <= 0.0 {
            return 1; // most arms touch nothing
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let parts = (self.rate * dt / SHARE).ceil().clamp(1.0, MAX_PARTS) as u32;
        parts
    }

    /// The torque from outside as of the last [`feel`](Self::feel) \[N·m, N\], (n); zeros if nothing is there to push.
    pub fn external(&self) -> &[f64] {
        &self.external
    }

    /// The torque from outside as of the last [`feel`](Self::feel) \[N·m, N\], (n); None if nothing is there to push.
    pub fn external_torque(&self) -> Option<&[f64]> {
        (self.is_touchable || self.is_touched()).then_some(&self.external)
    }

    /// Every wrench that acts over the present step, where the arm was felt last.
    pub fn acting(&self) -> Vec<Acting<D>> {
        let acting = |wrenches: &Wrenches<_, D>| wrenches.acting(&self.state).collect();
        self.wrenches.as_deref().map_or(vec![], acting)
    }

    /// Whether joints have viscous friction.
    pub fn is_braked(&self) -> bool {
        self.physics.viscous.iter().any(|friction| *friction > 0.0)
    }

    /// Moves to the state (q, q̇): q̈ under a torque there.
    pub fn accelerate(&mut self, q: &[f64], dq: &[f64], tau: &[f64], ddq: &mut [f64]) {
        let is_touched = self.is_touched();
        let Self { physics, state, torque, gravity, scratch, wrenches, contacts, .. } = self;
        let tau = resisted(&physics.viscous, tau, dq, torque);
        if !physics.compensates_gravity && !is_touched {
            state.update_with_dynamics(q, dq, tau, scratch, ddq);
            return;
        }
        state.update(q, dq);
        let tau = match physics.compensates_gravity {
            true => carried(state, tau, gravity),
            false => tau,
        };
        state.forward_dynamics(pushed(wrenches, contacts, state, tau), scratch, ddq);
    }

    /// The same where a controller whose model is the plant stands at this very state: what it has
    /// factorised serves the plant too.
    pub fn accelerate_as(&mut self, model: &A::State, tau: &[f64], bias: &[f64], ddq: &mut [f64]) {
        let Self { physics, torque, gravity, scratch, wrenches, contacts, .. } = self;
        let tau = resisted(&physics.viscous, tau, model.velocity(), torque);
        let tau = match physics.compensates_gravity {
            true => carried(model, tau, gravity),
            false => tau,
        };
        model.accelerate(pushed(wrenches, contacts, model, tau), bias, scratch, ddq);
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
        let is_touched = self.is_touched();
        let Self { physics, state, impulses, change, external, .. } = self;
        // What pushes from outside does work like a torque that is held.
        let outside = |q: &[f64]| if is_touched { dot(external, q) } else { 0.0 };
        let mut allowed = kinetic + potential - dot(tau, q) - outside(q);

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
        let outside = if is_touched { dot(&self.external, q) } else { 0.0 };
        allowed = (allowed + dot(tau, q) + outside - potential).max(0.0);
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

/// τ + τ_ext where `robot` is, if anything pushes.
fn pushed<'a, R: Robot<D>, S: ObstacleGeometry<D>, const D: usize>(
    wrenches: &'a mut Option<Box<Wrenches<R, D>>>,
    contacts: &'a mut Option<Box<Contacts<R, S, D>>>,
    robot: &R,
    tau: &'a [f64],
) -> &'a [f64] {
    let tau = match wrenches {
        Some(wrenches) => wrenches.add_to(robot, tau),
        None => tau,
    };
    match contacts {
        Some(contacts) => contacts.add_to(robot, tau),
        None => tau,
    }
}
