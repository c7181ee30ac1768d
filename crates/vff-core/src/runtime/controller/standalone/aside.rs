//! What is asked between the cycles of a loop: the next cycle goes on from the one before.

use super::super::fading::Fading;
use super::super::followed::Followed;
use super::Standalone;
use crate::control::Controller;
use crate::simulation::System;
use std::mem::swap;

/// What of a controller a call changes.
#[derive(Debug, Clone)]
pub(super) struct Memory<S: System<D, M>, const D: usize, const M: usize> {
    controller: Controller<S::State, D, M>,
    fading: Option<Box<Fading<S, D, M>>>,
    followed: Option<Box<Followed<S, D, M>>>,
    last: Option<f64>,
    spoilt: bool,
}

impl<S: System<D, M>, const D: usize, const M: usize> Memory<S, D, M> {
    /// What the robot measures is for the next cycle.
    pub(super) fn sense(&mut self, tau_ext: &[f64]) {
        self.controller.sense(tau_ext);
        if let Some(fading) = &mut self.fading {
            fading.controller.sense(tau_ext);
        }
    }
}

impl<S: System<D, M>, const D: usize, const M: usize> Standalone<S, D, M> {
    /// Something else than the next cycle is asked of a loop that is watched over: what the last one has left behind is kept. Allocates.
    pub(super) fn step_aside(&mut self) {
        if self.is_aside || !self.has_cycled || self.supervisor.is_none() {
            return;
        }
        self.memory = Some(Box::new(Memory {
            controller: self.controller.clone(),
            fading: self.fading.clone(),
            followed: self.followed.clone(),
            last: self.last,
            spoilt: self.spoilt,
        }));
        self.is_aside = true;
    }

    /// Goes on from what the last cycle has left behind. Frees nothing: that is for whoever asks something else again.
    pub(super) fn come_back(&mut self) {
        if let Some(memory) = self.memory.as_mut().filter(|_| self.is_aside) {
            swap(&mut self.controller, &mut memory.controller);
            swap(&mut self.fading, &mut memory.fading);
            swap(&mut self.followed, &mut memory.followed);
            (self.last, self.spoilt) = (memory.last, memory.spoilt);
            self.is_aside = false;
        }
    }
}
