//! What can be asked of a closed loop at its present instant.

use super::*;
use crate::control::force::is_pressed;
use crate::control::{CommandSettings, SelfMotionMap};
use crate::math::dot;
use crate::simulation::DepthPicture;

impl<S: System<D, M>, const D: usize, const M: usize> ClosedLoop<S, D, M> {
    /// Calls `visit` with the nearest points of every body and every obstacle as they are now.
    pub fn for_each_pair(&self, visit: impl FnMut(&Contact<D>)) {
        let ControlStack { controller, world, .. } = &self.stack;
        world.for_each_pair(controller.robot().bodies(), visit);
    }

    /// The repulsion of every link, as the point on its axis \[m\] at which it acts and the force \[N\]: the sum
    /// over all obstacles, at the mean of their points weighted with their forces. Allocates.
    pub fn pushes(&mut self) -> Vec<[Vector<D>; 2]> {
        let ControlStack { controller, world, .. } = &mut self.stack;
        let (robot, field) = (controller.robot(), controller.gains().field);
        let mut means = vec![(Vector::<D>::zeros(), 0.0); robot.dof()];
        world.for_each_contact(
            robot.bodies(),
            field.influence,
            |_, _| {},
            |contact| {
                let force = field.at(contact.distance).force;
                means[contact.link].0 += contact.point * force;
                means[contact.link].1 += force;
            },
        );
        let middle = |link: usize| {
            let body = robot.bodies().find(|body| body.link == link).map(|body| body.shape);
            body.map_or_else(Vector::zeros, |s| s.start + s.direction * (0.5 * s.length))
        };
        means
            .iter()
            .zip(controller.forces().resultant())
            .enumerate()
            .map(|(link, ((sum, weight), force))| {
                [if *weight > 0.0 { sum / *weight } else { middle(link) }, *force]
            })
            .collect()
    }

    /// Every wrench that pushes the arm over the next plant step. Allocates.
    pub fn wrenches(&self) -> Vec<Acting<D>> {
        self.plant.acting()
    }

    /// What somebody pulls with, and towards where \[m\].
    pub fn pulled(&self) -> Option<(Acting<D>, Vector<D>)> {
        self.plant.pulled()
    }

    /// The same over a plant step from time `t` \[s\] on, of an arm elsewhere at `q`. Allocates.
    pub fn wrenches_at(&mut self, t: f64, q: &[f64]) -> Vec<Acting<D>> {
        self.plant.feel(q, &self.dq, t, self.options.dt);
        self.plant.acting()
    }

    /// The controller's model of the arm.
    pub fn arm(&self) -> &Arc<S::Arm> {
        &self.arm
    }

    /// The position nearest to `goal` \[m\] that the end effector can take with the orientation of the reference.
    pub fn attainable(&self, goal: &Vector<D>) -> Vector<D> {
        S::attainable(&self.arm, &self.stack.controller.reference().x, goal)
    }

    /// The steps taken so far.
    pub fn step_count(&self) -> usize {
        self.step
    }

    /// The controller.
    pub fn controller(&self) -> &Controller<S::State, D, M> {
        &self.stack.controller
    }

    /// The controller whose torque is sent: in predictor mode the one that is asked for the middle of the control period (T33).
    fn sender(&self) -> &Controller<S::State, D, M> {
        &self.foresight.as_ref().unwrap_or(&self.stack).controller
    }

    /// What was left out so far, in the order of [`LeftOut::named`](crate::control::LeftOut::named); None of what there is not.
    pub fn left_out(&self) -> [Option<u64>; 5] {
        let controller = self.sender();
        let is_limited = controller.is_limited();
        let ahead = is_limited && controller.gains().looks_ahead();
        let keeps = controller.slack().is_some();
        let is_there = [is_limited, ahead, ahead, keeps, controller.has_program()];
        let mut counts = controller.left_out().named().into_iter().zip(is_there);
        [(); 5].map(|()| counts.next().and_then(|((_, count), there)| there.then_some(count)))
    }

    /// The obstacles.
    pub fn world(&self) -> &World<S::Geometry, D> {
        &self.stack.world
    }

    /// The pictures of depth cameras that arrived last. Allocates.
    pub fn pictures(&self) -> Vec<DepthPicture> {
        self.perception.as_ref().map_or_else(Vec::new, Perceive::pictures)
    }

    /// [`Controller::self_motion_map`].
    pub fn self_motion_map(&self) -> Option<SelfMotionMap> {
        self.controller().self_motion_map()
    }

    /// Whether the controller knows all obstacles.
    pub fn knows_obstacles(&self) -> bool {
        self.perception.is_none() && !self.stack.world.hides_any()
    }

    /// The true joint velocity \[rad/s\].
    pub fn velocity(&self) -> &[f64] {
        &self.dq
    }

    /// The true distance from each link to the nearest obstacle \[m\], as in the snapshot.
    pub fn clearance(&self) -> &[f64] {
        let perceived = || self.stack.controller.forces().clearance();
        self.truth.as_ref().map_or_else(perceived, |truth| &truth.clearance)
    }

    /// The smallest of those distances \[m\], but for what the tip is to press on; infinite without any.
    pub fn least_clearance(&self) -> f64 {
        let unpressed = self.unpressed();
        let links = self.clearance().len() - usize::from(unpressed.is_some());
        let others = self.clearance()[..links].iter();
        others.copied().chain(unpressed).fold(f64::INFINITY, f64::min)
    }

    /// The link and the obstacle that are nearest to each other, but for what the tip is to press on.
    pub fn nearest(&self) -> Option<[usize; 2]> {
        let mut nearest = (f64::INFINITY, None);
        self.for_each_pair(|contact| {
            if contact.distance < nearest.0 && !self.is_pressed_on(contact) {
                nearest = (contact.distance, Some([contact.link, contact.obstacle]));
            }
        });
        nearest.1
    }

    /// The arm as it is in truth.
    fn true_robot(&self) -> &S::State {
        self.truth.as_ref().map_or_else(|| self.controller().robot(), |_| self.plant.state())
    }

    /// Whether this is what the tip is to press on: a surface that resists, and faces it (T158).
    fn is_pressed_on(&self, contact: &Contact<D>) -> bool {
        let robot = self.true_robot();
        let pressed = self.controller().pressed_by(robot);
        is_pressed(robot, pressed.as_ref(), contact) && self.plant.resists(contact.obstacle)
    }

    /// Where the tip is to press on something, how near its link is to all else \[m\].
    #[inline]
    fn unpressed(&self) -> Option<f64> {
        let presses = self.controller().gains().touch.force.is_some();
        presses.then(|| self.least_unpressed())
    }

    #[inline(never)]
    fn least_unpressed(&self) -> f64 {
        let robot = self.true_robot();
        let mut least = f64::INFINITY;
        let mut look = |contact: &Contact<D>| {
            if contact.link + 1 == robot.dof() && !self.is_pressed_on(contact) {
                least = least.min(contact.distance);
            }
        };
        self.stack.world.for_each_pair(robot.bodies(), &mut look);
        if self.truth.is_some() {
            self.stack.world.for_each_hidden(robot.bodies(), &mut look);
        }
        least
    }

    /// What the joints can do.
    pub fn limits(&self) -> &Limits {
        self.arm.limits()
    }

    /// The present instant.
    pub fn time(&self) -> f64 {
        self.options.time(self.step)
    }

    /// The path time σ \[s\] of the reference; None without a governor.
    pub(super) fn path_time(&self) -> Option<f64> {
        self.governor.as_ref().map(|governor| governor.path_time(self.time()))
    }

    /// For how long the reference still moves, by its own clock \[s\], if it ever rests; and how late it is, with a governor only \[s\].
    pub fn left_of_reference(&self) -> [Option<f64>; 2] {
        let (t, sigma) = (self.time(), self.path_time());
        let clock = sigma.unwrap_or(t);
        let left = |rests_from: f64| (rests_from - clock).max(0.0);
        [self.stack.trajectory.rests_from().map(left), sigma.map(|sigma| t - sigma)]
    }

    /// Whether the state is finite and no joint turns faster than [`MAX_SPEED`](Self::MAX_SPEED).
    pub(super) fn is_sane(&self) -> bool {
        let slow = self.dq.iter().fold(true, |all, v| all & (v.abs() < Self::MAX_SPEED));
        slow && is_finite(&self.q)
    }

    /// How fast the end effector moves and turns, as shares of what `command` lets it.
    fn tip_shares(&self, dx: &Vector<M>) -> [Option<f64>; 2] {
        let CommandSettings { tip_speed, tip_angular_speed, .. } =
            self.stack.controller.gains().command;
        let turning = || {
            let seen = self.stack.controller.robot();
            let [turning, _] = self.truth.as_ref().map_or(seen, |_| self.plant.state()).turning();
            turning.norm()
        };
        [
            tip_speed.map(|most| dx.fixed_rows::<D>(0).norm() / most),
            tip_angular_speed.map(|most| turning() / most),
        ]
    }

    /// Whether viscous friction brakes the joints of the plant.
    pub fn is_braked(&self) -> bool {
        self.plant.is_braked()
    }

    /// Whether torque or speed limits hold for the controller.
    pub(super) fn is_limited(&self) -> bool {
        let Limits { velocity, torque, .. } = self.arm.limits();
        self.stack.controller.gains().enforce_limits && !(velocity.is_empty() && torque.is_empty())
    }

    /// Whether the controller stands at the state of the plant, with a model that is the plant.
    pub(super) fn is_ideal(&self) -> bool {
        self.truth.is_none() && Arc::ptr_eq(self.plant.arm(), &self.arm)
    }

    /// The state and everything that the law made of it, at the present instant.
    pub fn snapshot(&self) -> Snapshot<'_> {
        let controller = &self.stack.controller;
        let (forces, space, gains) = (controller.forces(), controller.space(), controller.gains());
        let [q_measured, dq_measured] =
            self.measurement.as_ref().map_or([&[][..]; 2], Measurement::seen);
        let (dx, error, clearance) = match &self.truth {
            Some(truth) => (&truth.dx, &truth.error, truth.clearance.as_slice()),
            None => (&space.dx, controller.error(), forces.clearance()),
        };
        let (self_clearance, nearest_pair, manipulability) = match &self.truth {
            Some(truth) => (truth.self_clearance, truth.nearest_pair, truth.manipulability),
            None => (forces.self_clearance(), forces.nearest_pair(), controller.manipulability()),
        };
        let driven = || self.actuator.as_ref().map_or(&[][..], Actuator::torque);
        let tau_applied =
            self.output.as_ref().map_or_else(driven, |output_stage| &output_stage.acting);
        let acting = if tau_applied.is_empty() { &self.held.total } else { tau_applied };
        let sender = self.sender();
        let (mut energy, mut power) = (controller.energy(), controller.power(acting));
        if let Some(truth) = &self.truth {
            [energy.kinetic, energy.gravitational] = truth.energy;
            power.actuators = dot(&self.dq, acting);
        }
        Snapshot {
            dimension: D,
            t: self.time(),
            q: &self.q,
            dq: &self.dq,
            q_measured,
            dq_measured,
            sensed: self.perception.as_ref().map(|perception| perception as &dyn Positions),
            torque: &self.held,
            tau_applied,
            tau_vff: forces.torque(),
            x: self.x.as_slice(),
            dx: dx.as_slice(),
            tip_shares: self.tip_shares(dx),
            x_ref: controller.reference().x.as_slice(),
            path_time: self.path_time(),
            q_plan: self.stack.trajectory.joints().and_then(|_| controller.planned()),
            replans: self.replanning.as_ref().map(|replanning| replanning.counts()),
            error: error.as_slice(),
            force: forces.magnitude(),
            clearance,
            unpressed: self.unpressed(),
            obstacles: &self.stack.world,
            null_acceleration: self.null_acceleration,
            energy,
            power,
            objective_scale: self.is_limited().then_some(&self.objective_scale),
            tank: controller.tank().map(Tank::level),
            tau_ext: self.plant.external_torque(),
            contact_force: self.plant.contact_forces(),
            tau_ext_estimate: controller.external_torque(),
            wrench_estimate: controller.external_wrench(),
            touched_link: controller.touched_link(),
            contact_deviation: controller.contact_deviation(),
            contact_threshold: controller.contact_threshold(),
            yielded: sender.yielded(),
            released: sender.released(),
            is_stopped: sender.is_stopped(),
            self_clearance: (gains.self_collision != SelfCollision::Ignore)
                .then_some(self_clearance),
            nearest_pair,
            slack: sender.slack(),
            yields: controller.yields(),
            manipulability,
            singular: space.singular,
        }
    }
}
