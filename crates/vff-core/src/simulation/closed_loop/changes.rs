//! What can be changed of a closed loop while it runs: its plan, gains, obstacles and goal.

use super::*;
use crate::world::Description;

impl<S: System<D, M>, const D: usize, const M: usize> ClosedLoop<S, D, M> {
    /// From now on `replanning` watches over the reference.
    pub fn set_replanning(&mut self, replanning: Box<dyn Replan<S, D, M>>) {
        self.replanning = Some(replanning);
    }

    /// Lets it plan in a thread of its own, as long as it takes.
    pub fn plan_beside(&mut self) {
        if let Some(replanning) = &mut self.replanning {
            replanning.plan_beside();
        }
    }

    /// Has it look for a plan now, whether the arm needs another one or not. Whether anybody watches over the reference.
    pub fn want_plan(&mut self) -> bool {
        self.replanning.as_mut().map(|replanning| replanning.want()).is_some()
    }

    /// The searches for another plan so far.
    pub fn replans(&self) -> &[Replanned] {
        self.replanning.as_ref().map_or(&[], |replanning| replanning.searches())
    }

    /// The reference.
    pub fn reference(&self) -> &Trajectory<S::Pose, M> {
        &self.stack.trajectory
    }

    pub(super) fn follow(&mut self, trajectory: &Trajectory<S::Pose, M>) {
        for stack in iter::once(&mut self.stack).chain(&mut self.foresight) {
            stack.trajectory = trajectory.clone();
        }
    }

    /// Where a control period begins: a plan, if there is one, from the next step on.
    #[inline(never)]
    pub(super) fn replan(&mut self) {
        let t = self.time();
        let pace = self.governor.as_ref().map_or(Pace::of_time(t), |governor| governor.pace(t));
        let Self { replanning, stack: ControlStack { controller, world, trajectory }, .. } = self;
        let Some(replanning) = replanning else { return };
        let found = replanning.look(&Moment {
            t,
            since: t,
            pace,
            q: controller.robot().configuration(),
            posture: &controller.gains().posture,
            error: &controller.followed_error(),
            reference: trajectory,
            world,
            law: controller.gains(),
        });
        if let Some(trajectory) = found {
            self.follow(&trajectory);
        }
    }

    /// Takes over other gains, from now on. Allocates; what the controller remembers begins anew.
    pub fn set_gains(&mut self, gains: &Gains<M>) {
        let another_output = gains.command != self.controller().gains().command;
        for stack in iter::once(&mut self.stack).chain(&mut self.foresight) {
            stack.controller = Controller::new(self.arm.state(), gains.clone());
        }
        if another_output {
            self.output = OutputStage::new(gains, self.q.len());
            self.plant.compensate_gravity(gains.command.gravity == Gravity::Robot);
            self.start_output();
        }
        let t = self.time();
        match (&mut self.governor, gains.governor) {
            (Some(governor), settings) => governor.configure(settings, t),
            (none, settings) => *none = settings.map(|settings| Governor::new(settings, t)),
        }
        self.control();
    }

    /// Pushes the arm from now on: the wrench's start counts from the present instant. Allocates.
    ///
    /// # Errors
    /// With the names of its links, if the arm has no such link; with none, if [`MAX_WRENCHES`] push already.
    pub fn push(&mut self, wrench: Wrench<D>) -> Result<(), Vec<String>> {
        let t = self.time();
        if self.plant.forget_past_wrenches(t) >= MAX_WRENCHES {
            return Err(vec![]);
        }
        self.plant.add_wrench(Wrench { start: t + wrench.start, ..wrench })?;
        self.feel();
        Ok(())
    }

    /// Lets somebody pull at the arm from now on, or let go. Allocates.
    ///
    /// # Errors
    /// With the names of its links, if the arm has no such link.
    pub fn pull(&mut self, pull: Option<&Pull<D>>) -> Result<(), Vec<String>> {
        self.plant.pull(pull, &self.q, &self.dq)?;
        self.feel();
        Ok(())
    }

    /// Lets whoever pulls do so towards another place \[m\].
    pub fn pull_towards(&mut self, anchor: Vector<D>) {
        self.plant.pull_towards(anchor);
        self.feel();
    }

    /// Tells of the torque from outside even where nothing pushes.
    pub fn make_touchable(&mut self) {
        self.plant.make_touchable();
    }

    /// Lets a plant elsewhere say what is felt of the obstacles.
    pub fn listen(&mut self) {
        self.plant.listen();
    }

    /// Takes in what that says of the contacts over the plant step that it is about to end: the obstacle of each, and the
    /// force on a link.
    pub fn tell(&mut self, told: impl Iterator<Item = (usize, Acting<D>)>) {
        self.plant.tell(told);
    }

    fn feel(&mut self) {
        let t = self.time();
        self.plant.feel(&self.q, &self.dq, t, self.options.dt);
    }

    /// Changes the world, of which predictor mode has two.
    pub fn change_world(&mut self, change: impl Fn(&mut World<S::Geometry, D>)) {
        let t = self.time();
        for stack in iter::once(&mut self.stack).chain(&mut self.foresight) {
            stack.world.update(t);
            change(&mut stack.world);
        }
        if let Some(contacts) = self.plant.contacts_mut() {
            contacts.go_to(t);
            change(contacts.world_mut());
        }
        self.control();
    }

    /// Adds an obstacle, the last one from now on, and how it resists, if it does. Allocates.
    pub fn add_obstacle(
        &mut self,
        obstacle: &<S::Geometry as ObstacleGeometry<D>>::Obstacle,
        settings: Option<ContactSettings>,
    ) {
        if let Some(contacts) = self.plant.contacts_mut() {
            contacts.add(settings);
        }
        self.change_world(|world| world.add(obstacle.clone()));
        if self.plant.contacts_mut().is_none() {
            let world = &self.stack.world;
            let all: Vec<_> = iter::repeat_n(None, world.len() - 1).chain([settings]).collect();
            self.plant.surround(world, &all);
            self.feel();
        }
        let is_unseen = settings.is_some_and(|settings| !settings.seen);
        if is_unseen {
            let arm = &self.arm;
            self.truth.get_or_insert_with(|| Truth::new(arm.state()));
        }
        if is_unseen || obstacle.key_of_links().is_some() {
            let links = self.arm.link_names();
            for stack in iter::once(&mut self.stack).chain(&mut self.foresight) {
                stack.world.know_links(&links);
                if is_unseen {
                    stack.world.hide(stack.world.len() - 1);
                }
            }
            self.control();
        }
    }

    /// Takes obstacle `j` away.
    pub fn remove_obstacle(&mut self, j: usize) {
        if let Some(contacts) = self.plant.contacts_mut() {
            contacts.remove(j);
        }
        self.change_world(|world| world.remove(j));
    }

    /// Lets go of the reference and sends the end effector to `goal` from now on, smoothly, with the pole `rate` \[1/s\]:
    /// see [`Guided::aim`](crate::trajectory::Guided::aim).
    pub fn aim(&mut self, goal: &[f64], rate: f64) {
        let t = self.path_time().unwrap_or(self.time());
        for stack in iter::once(&mut self.stack).chain(&mut self.foresight) {
            stack.trajectory.aim(t, goal, rate);
        }
        self.control();
    }
}
