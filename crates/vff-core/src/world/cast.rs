//! Rays among the obstacles.

use super::{MotionState, ObstacleGeometry, Placed, World};
use crate::interrupt;
use crate::math::Vector;

impl<S: ObstacleGeometry<D>, const D: usize> World<S, D> {
    /// The distance \[m\] from `origin` along the unit vector `direction` to the first obstacle within
    /// `range` \[m\]; 0 inside one. The obstacles stand where the last [`update`](Self::update) put them.
    pub fn cast(&self, origin: Vector<D>, direction: Vector<D>, range: f64) -> Option<f64> {
        interrupt::checkpoint(32 * self.obstacles.len());
        let all = 0..self.obstacles.len();
        all.filter_map(|j| self.cast_at(j, &origin, &direction, range)).reduce(f64::min)
    }

    /// The same to obstacle `j` alone; none if it is hidden.
    pub fn cast_at(
        &self,
        j: usize,
        origin: &Vector<D>,
        direction: &Vector<D>,
        range: f64,
    ) -> Option<f64> {
        let obstacle = &self.obstacles[j];
        if obstacle.is_hidden {
            return None;
        }
        let MotionState { position, elapsed, .. } = obstacle.state_at(self.time);
        let offset = origin - position;
        match obstacle.turn_at(self.time) {
            None => obstacle.geometry.cast(&offset, direction, range, elapsed),
            Some(turn) => {
                let [offset, along] = [offset, *direction].map(|v| turn.rotation.tr_mul(&v));
                obstacle.geometry.cast(&offset, &along, range, elapsed)
            }
        }
    }

    /// A ball around obstacle `j`: its middle, and a radius that its surface does not reach beyond \[m\], infinite where it has no end.
    pub fn ball(&self, j: usize) -> (Vector<D>, f64) {
        let Placed { geometry, since, .. } = &self.obstacles[j];
        let of_parts =
            if geometry.speed() > 0.0 { geometry.speed() * (self.time - since).abs() } else { 0.0 };
        (self.position(j), geometry.reach() + of_parts)
    }
}
