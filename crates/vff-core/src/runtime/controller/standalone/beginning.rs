//! Where a loop may begin.

use super::Standalone;
use crate::robot::{Manipulator, Model, Robot};
use crate::runtime::controller::MissedStart;
use crate::simulation::System;
use std::f64::consts::TAU;

/// So far beyond its stops a joint that turns, or slides, may be when a loop begins \[rad, m\]: it is brought back.
const BEYOND: [f64; 2] = [0.2, 0.05];

impl<S: System<D, M>, const D: usize, const M: usize> Standalone<S, D, M> {
    /// Why the arm is too far from where the reference of the scenario begins, if it is.
    pub(super) fn missed(&self) -> Option<MissedStart> {
        let robot = self.controller.robot();
        let followed = self.followed.as_ref().filter(|followed| !followed.has_begun())?;
        followed.missed_start(robot.configuration(), &robot.pose(), self.controller.gains())
    }

    /// The same of an arm at `q`, when the reference begins once more.
    #[inline(never)]
    pub(super) fn missed_at(&self, q: &[f64]) -> Option<MissedStart> {
        let followed = self.followed.as_ref()?;
        let mut robot = self.controller.robot().clone();
        robot.update_positions(q);
        followed.missed_start(q, &robot.pose(), self.controller.gains())
    }

    /// Sees the arm at rest at `q`.
    pub(super) fn stand_at(&mut self, q: &[f64]) {
        self.come_back();
        self.controller.observe(q, &vec![0.0; q.len()], &mut self.world);
    }

    /// The joint that is farthest beyond what a loop may begin with, if one is.
    #[inline(never)]
    pub(super) fn far_beyond(&self, q: &[f64]) -> Option<MissedStart> {
        let (arm, stops) = (&self.arm, &self.arm.limits().joint);
        let beyond = |(i, [low, high]): (usize, &[f64; 2])| {
            let stop = q[i].clamp(*low, *high);
            let ways = (q[i] - stop).abs() / BEYOND[usize::from(arm.slides(i))];
            (ways > 1.0).then_some((ways, i, stop))
        };
        let all = stops.iter().enumerate().filter_map(beyond);
        let (_, joint, stop) = all.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let fits = |(i, [low, high]): (usize, &[f64; 2])| {
            let q = if arm.slides(i) { q[i] } else { q[i].to_radians() };
            (*low..=*high).contains(&q)
        };
        let turned = q[joint].abs() > TAU && !arm.slides(joint);
        let in_degrees = turned && stops.iter().enumerate().all(fits);
        Some(MissedStart::Stop { joint, q: q[joint], stop, in_degrees })
    }
}
