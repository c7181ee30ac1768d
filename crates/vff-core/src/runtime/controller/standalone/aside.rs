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
    /// When that of the loop was called last \[s\], and whether that came to no good.
    last: Option<f64>,
    spoilt: bool,
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
    /// Something else than the next cycle is asked of a loop that is watched over: of a controller that knows what that of the loop
    /// knows by its observer. A law that is being left has no part in it.
    pub(super) fn step_aside(&mut self) {
        let has_cycled = self.supervisor.as_ref().is_some_and(|supervisor| supervisor.has_sent());
        let Some(aside) = self.aside.as_mut().filter(|_| has_cycled && !self.is_aside) else {
            return;
        };
        swap(&mut self.controller, &mut aside.controller);
        swap(&mut self.fading, &mut aside.fading);
        (aside.last, aside.spoilt) = (self.last, self.spoilt);
        let of = &aside.controller;
        if self.spoilt {
            self.controller.reset();
            self.spoilt = false;
        } else {
            let (q, dq) = (of.robot().configuration(), of.robot().velocity());
            self.controller.observe(q, dq, &mut self.world);
            self.controller.take_over(of);
            self.controller.keep_posture_of(of, false);
        }
        self.is_aside = true;
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
        if let Some(aside) = self.aside.as_mut().filter(|_| self.is_aside) {
            swap(&mut self.controller, &mut aside.controller);
            swap(&mut self.fading, &mut aside.fading);
            (self.last, self.spoilt) = (aside.last, aside.spoilt);
            self.is_aside = false;
        }
    }
}
