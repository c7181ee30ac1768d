//! Where obstacles are that somebody has seen, by the clock of whoever saw them.

use super::Standalone;
use crate::control::output::Clock;
use crate::math::Vector;
use crate::simulation::System;

impl<S: System<D, M>, const D: usize, const M: usize> Standalone<S, D, M> {
    /// The time of the obstacles \[s\] when the clock of the states says `t`. In a loop that is watched over, as long as it is not over,
    /// that clock may have been set since the last state: what is said to be a second away from now is now. Before its first state, a time
    /// that lies back is of another clock than the last loop's, and the obstacles are where they were; as before the first of set points.
    #[inline(never)]
    pub(super) fn world_time(&self, t: f64) -> f64 {
        let at = self.loop_time(t) - self.epoch;
        let begins = match self.supervisor.as_ref().filter(|it| !it.phase().is_over()) {
            Some(supervisor) => match supervisor.now().map(|now| now - self.epoch) {
                Some(now) if (at - now).abs() > Clock::LONGEST => return now,
                now => now.is_none(),
            },
            None => self.sets_points && self.last.is_none(),
        };
        self.gone_back(at).filter(|_| begins).unwrap_or(at)
    }

    /// What the last loop has reached, if `at` \[s\] lies so far before that its clock is another one.
    fn gone_back(&self, at: f64) -> Option<f64> {
        self.reached.filter(|reached| at < reached - Clock::LONGEST)
    }

    /// Takes in the state of a cycle of a loop that is watched over or sets points, at a time of the loop \[s\], and returns the time since
    /// the last one \[s\].
    pub(super) fn take_in(&mut self, q: &[f64], dq: &[f64], t: f64, is_first: bool) -> f64 {
        if is_first {
            self.begin_at(t);
        }
        let elapsed = self.observe_at(q, dq, t);
        self.reached = Some(t - self.epoch);
        elapsed
    }

    /// The first state of a loop that is watched over or sets points is of time `t` \[s\]: where that lies back, time goes on from what the last
    /// loop has reached.
    fn begin_at(&mut self, t: f64) {
        if let Some(reached) = self.gone_back(t - self.epoch) {
            self.epoch = t - reached;
        }
    }

    /// Obstacle `j` was seen at a `position` \[m\] at `t` \[s\] and goes on at a `velocity` \[m/s\]; how far from where it may be
    /// \[m\] that is, if it is doubted.
    pub(super) fn place_at(
        &mut self,
        j: usize,
        t: f64,
        [position, velocity]: [Vector<D>; 2],
    ) -> f64 {
        let t = self.world_time(t);
        let Self { world, placed, settings, .. } = self;
        let Some(speed) = settings.command.obstacle_speed else {
            world.place(j, t, position, velocity);
            return 0.0;
        };
        let here = world.position_at(j, t);
        let (way, last) = (position - here, placed[j]);
        let (distance, since) = (way.norm(), last.map(|last| (t - last).max(0.0)));
        placed[j] = Some(last.map_or(t, |last| last.max(t)));
        if since.is_none_or(|since| distance <= speed * since) {
            world.place(j, t, position, velocity.cap_magnitude(speed));
            return 0.0;
        }
        // What is seen elsewhere at the same time tells nothing of how it moves.
        let is_later = since > Some(0.0);
        let velocity =
            if is_later { way * (speed / distance) } else { velocity.cap_magnitude(speed) };
        world.place(j, t, here, velocity);
        distance
    }
}
