//! One law takes the place of another one, while the loop goes on.

use super::super::SuccessionError;
use super::super::fading::Fading;
use super::Standalone;
use super::aside::Aside;
use super::made::USED;
use crate::control::output::BeginError;
use crate::robot::{Model, Robot};
use crate::simulation::System;
use crate::world::CollisionQuery;
use std::mem::swap;

impl<S: System<D, M>, const D: usize, const M: usize> Standalone<S, D, M> {
    /// One like `like`, ready to take the place of this one. Allocates.
    pub(super) fn made_like(&self, like: &Self) -> Result<Self, SuccessionError> {
        let joints =
            |arm: &S::Arm| -> Vec<String> { (0..arm.dof()).map(|i| arm.joint_name(i)).collect() };
        if self.kin == USED {
            return Err(SuccessionError::Used);
        }
        if joints(&like.arm) != joints(&self.arm) {
            return Err(SuccessionError::Another);
        }
        if like.settings.command != self.settings.command {
            return Err(SuccessionError::Command);
        }
        self.period.map_or(Ok(()), |period| BeginError::check(&like.settings, period))?;
        let mut next = like.clone();
        // What it has been through is not of this loop.
        next.move_within(self.controller.gains().moved.as_ref());
        next.fits(self.world.barrier_count())?;
        for j in 0..self.world.len() {
            next.sees(self.world.obstacle(j))
                .map_err(|error| error.inside(&format!("obstacles[{j}]")))?;
        }
        next.world = self.world.clone();
        (next.supervisor, next.spoilt, next.is_aside) = (None, false, false);
        next.kin = self.kin;
        next.aside = Some(Aside::like(&next.controller)); // a loop may begin before it is needed
        next.fading = Some(Box::new(Fading::room(&next.controller)));
        next.followed.clone_from(&self.followed);
        next.reserve();
        next.followed = None;
        Ok(next)
    }

    /// Whether a law is still being left, or blended in: what confines that is the program of one law, in full.
    pub(super) fn changes_over(&self) -> bool {
        let is_blending = self.supervisor.as_ref().is_some_and(|it| it.is_blending());
        is_blending || self.fading.as_ref().is_some_and(|fading| fading.is_left())
    }

    /// Lets `next`, which was made by [`made_like`](Self::made_like), take the place of this law within `duration` \[s\]. Whether both
    /// have the same tip.
    pub(super) fn give_way_to(
        &mut self,
        next: &mut Self,
        duration: f64,
    ) -> Result<bool, SuccessionError> {
        self.come_back();
        if next.kin == USED {
            return Err(SuccessionError::Used);
        }
        if next.kin != self.kin {
            return Err(SuccessionError::Another);
        }
        if self.changes_over() {
            return Err(SuccessionError::Succeeding);
        }
        self.period.map_or(Ok(()), |period| BeginError::check(&next.settings, period))?;
        let mut fading = next.fading.take().ok_or(SuccessionError::Another)?;
        if self.spoilt {
            self.reset();
        }
        swap(&mut self.controller, &mut next.controller);
        swap(&mut fading.controller, &mut next.controller);
        swap(&mut self.arm, &mut next.arm);
        swap(&mut self.settings, &mut next.settings);
        swap(&mut self.reach, &mut next.reach);
        if self.aside.is_some() {
            swap(&mut self.aside, &mut next.aside);
        }
        self.left_out = self.left_out.with(fading.controller.left_out());
        self.keep_time();
        let Self { controller, world, supervisor, settings, .. } = self;
        let before = &fading.controller;
        controller.observe(before.robot().configuration(), before.robot().velocity(), world);
        controller.take_over(before);
        controller.keep_posture_of(before, settings.posture.is_some());
        if let Some(supervisor) = supervisor {
            supervisor.exchange_robot(&mut fading.robots[0], controller, duration);
        }
        fading.controller.share_cycle(2);
        let is_same = fading.begin(controller, duration);
        if let Some(followed) = &mut self.followed {
            followed.wait(controller.gains().governor, world.time() + self.epoch);
            followed.exchange_arm(&self.arm, &mut fading.robots[1]);
            if !is_same {
                followed.lead(controller.robot());
            }
        }
        (next.fading, next.kin) = (self.fading.replace(fading), USED);
        Ok(is_same)
    }
}
