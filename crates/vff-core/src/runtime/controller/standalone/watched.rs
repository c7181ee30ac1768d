//! A loop of torques that is watched over.

use super::super::{CycleError, FromNumbers, Reading, Target};
use super::Standalone;
use super::aside::Aside;
use crate::control::LeftOut;
use crate::control::output::{BeginError, Phase, Supervisor};
use crate::robot::Model;
use crate::simulation::System;

impl<S, const D: usize, const M: usize> Standalone<S, D, M>
where
    S: System<D, M, State: FromNumbers<D, M, Pose = <S as System<D, M>>::Pose>>,
{
    /// A loop of `period` \[s\] begins that is watched over; then nothing has changed if it does not.
    pub(super) fn watch_over(
        &mut self,
        period: f64,
        measured: Option<&[f64]>,
    ) -> Result<(), BeginError> {
        self.come_back();
        let robot = self.controller.robot().clone();
        let supervisor = Supervisor::new(&self.settings, robot, period, measured)?;
        if self.sets_points {
            self.move_within(None);
        }
        self.supervisor = Some(Box::new(supervisor.counting_turns(self.arm.endless())));
        self.aside = Some(Aside::like(&self.controller));
        self.period = Some(period);
        self.placed.fill(None); // on a clock that may be another one
        self.reserve();
        self.keep_time();
        self.forget_past();
        Ok(())
    }

    /// One cycle of it.
    pub(super) fn watched_cycle(
        &mut self,
        reading: Option<Reading<'_>>,
        target: Option<&Target<'_>>,
    ) -> Result<Phase, CycleError> {
        target.map_or(Ok(()), S::State::check)?;
        self.come_back();
        let mut supervisor = self.supervisor.take().ok_or(CycleError::NotBegun)?;
        let is_first = supervisor.now().is_none();
        let ahead = supervisor.clock_ahead();
        let news = reading.and_then(|Reading { t, q, dq }| supervisor.admit(t, q, dq));
        if self.reached.is_none() {
            self.epoch -= supervisor.clock_ahead() - ahead; // what came with a state has the clock of that state
        }
        if let Some(t) = news {
            let [q, dq] = supervisor.state();
            let elapsed = self.take_in(q, dq, t, is_first);
            let begins = !supervisor.has_begun() && supervisor.wants_torque();
            let elsewhere = || self.missed().filter(|_| target.is_none());
            if begins && let Some(missed) = self.far_beyond(q).or_else(elsewhere) {
                self.supervisor = Some(supervisor);
                return Err(missed.into());
            }
            supervisor.report(&mut self.controller, elapsed);
            self.left().into_iter().for_each(|left| supervisor.report_too(left));
        }
        let wanted = news.is_some() && supervisor.wants_torque();
        if wanted {
            supervisor.announce(&mut self.controller);
            self.left().into_iter().for_each(|left| supervisor.announce(left));
            self.act_for(target, true);
        }
        let phase = match news {
            Some(_) if wanted => supervisor.follow(&mut self.controller),
            Some(_) => supervisor.rest(&mut self.controller),
            None => supervisor.miss(),
        };
        self.supervisor = Some(supervisor);
        Ok(phase)
    }

    /// Forgets the past, and ends a loop that is over.
    #[inline(never)]
    pub(super) fn forget_past(&mut self) {
        self.come_back();
        if self.supervisor.as_ref().is_some_and(|supervisor| supervisor.phase().is_over()) {
            self.end_watch();
            self.leave_clock();
        } else if self.are_points_over {
            self.move_within(None);
            self.leave_clock();
        }
        self.left_out = LeftOut::default();
        self.controller.reset();
        self.end_fading();
        self.last = None;
        let waits = self.is_in_loop();
        self.followed.iter_mut().for_each(|followed| followed.restart(waits));
    }

    /// What comes next is of another loop, by another clock.
    #[inline(never)]
    fn leave_clock(&mut self) {
        self.placed.fill(None);
        self.period = None;
        self.keep_time();
    }
}
