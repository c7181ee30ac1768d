//! What is asked between the cycles of a loop is asked of another controller, so that the next cycle goes on from the one before.

use super::super::fading::Fading;
use super::Standalone;
use crate::control::{Controller, StablePeriod};
use crate::robot::Robot;
use crate::simulation::System;
use std::mem::swap;

/// The controller that is not asked now: that of the loop, or one like it.
#[derive(Debug, Clone)]
pub(super) struct Aside<S: System<D, M>, const D: usize, const M: usize> {
    pub(super) controller: Controller<S::State, D, M>,
    pub(super) fading: Option<Box<Fading<S, D, M>>>,
    /// Whether its last call came to no good.
    spoilt: bool,
    /// When that of the loop was called last \[s\].
    last: Option<f64>,
}

impl<S: System<D, M>, const D: usize, const M: usize> Aside<S, D, M> {
    /// One like `controller`. Allocates.
    pub(super) fn like(controller: &Controller<S::State, D, M>) -> Box<Self> {
        let controller = controller.clone();
        Box::new(Self { controller, fading: None, last: None, spoilt: false })
    }

    /// What the robot measures is for the next cycle.
    pub(super) fn sense(&mut self, tau_ext: &[f64]) {
        self.controller.sense(tau_ext);
        if let Some(fading) = &mut self.fading {
            fading.controller.sense(tau_ext);
        }
    }
}

impl<S: System<D, M>, const D: usize, const M: usize> Standalone<S, D, M> {
    /// Whether it is in a loop that is watched over or sets points: what is asked of it beside that is no cycle.
    pub(super) fn is_in_loop(&self) -> bool {
        self.supervisor.is_some() || self.sets_points
    }

    /// Something else than the next cycle is asked of a loop that is watched over or sets points: of a controller that knows what
    /// that of the loop knows by its observer. A law that is being left has no part in it.
    pub(super) fn step_aside(&mut self) {
        let has_cycled = self.supervisor.as_ref().is_some_and(|supervisor| supervisor.has_sent());
        if self.is_aside || !(has_cycled || self.sets_points) || self.aside.is_none() {
            return;
        }
        let last = self.last;
        self.change_sides();
        if self.spoilt {
            self.reset(); // that question was broken off
        }
        let Some(aside) = &mut self.aside else { return };
        aside.last = last;
        let of = &aside.controller;
        if aside.spoilt {
            self.controller.reset();
        } else {
            self.spoilt = true; // until this has come to its end
            let (q, dq) = (of.robot().configuration(), of.robot().velocity());
            self.controller.observe(q, dq, &mut self.world);
            self.controller.take_over(of);
            self.controller.keep_posture_of(of, false);
            self.spoilt = false;
        }
    }

    /// Exchanges both controllers.
    fn change_sides(&mut self) {
        if let Some(aside) = &mut self.aside {
            swap(&mut self.controller, &mut aside.controller);
            swap(&mut self.fading, &mut aside.fading);
            swap(&mut self.spoilt, &mut aside.spoilt);
            self.is_aside = !self.is_aside;
        }
    }

    /// At which period damping is stable with the arm at rest at `q` \[rad, m\]: asked of a copy, for the law goes on from its last state.
    pub(super) fn stable_period_at(&mut self, q: &[f64], t: f64) -> StablePeriod {
        let mut asked = self.controller.clone();
        let (now, then) = (self.world.time(), self.loop_time(t) - self.epoch);
        self.world.update(then);
        asked.observe(q, &vec![0.0; q.len()], &mut self.world);
        let found = asked.stable_period(&mut self.world);
        self.world.update(now);
        found
    }

    /// Goes on from what the last cycle has left behind.
    pub(super) fn come_back(&mut self) {
        if self.is_aside {
            self.change_sides();
            self.last = self.aside.as_ref().and_then(|aside| aside.last);
        }
    }
}
