//! The nearest points of one body and one obstacle, and of all of them in pairs.

use super::{Carrier, Contact, ObstacleGeometry, Placed, World};
use crate::geometry::Body;

impl<S: ObstacleGeometry<D>, const D: usize> World<S, D> {
    /// The nearest points between `body`, which is number `index` of the robot, and obstacle `j`.
    ///
    /// Where several pairs are nearest (the axis of a body through the centre of a circle, parallel
    /// edges) one of them is taken, always the same.
    ///
    /// # Arguments
    /// * `body`: NaN coordinates give a NaN distance.
    ///
    /// # Panics
    /// If `j` is not less than [`World::len`].
    #[inline]
    pub fn contact(&self, index: usize, body: &Body<'_, D>, j: usize) -> Contact<D> {
        let obstacle = &self.obstacles[j];
        let moved;
        let state = if obstacle.is_at(self.time) {
            &obstacle.state
        } else {
            moved = obstacle.moved_to(self.time);
            &moved
        };
        let pair = obstacle.pair(index, Carrier::of(body), j);
        let turn = obstacle.turn_at(self.time);
        let probe = S::probe(&body.shape);
        match &body.hull {
            None => obstacle.contact(pair, &probe, state, turn.as_ref()),
            Some(hull) => obstacle.hull_contact(pair, hull, &probe, state, turn.as_ref()),
        }
    }

    /// Calls `visit` with the nearest points of every body and every obstacle that it is measured against and that is not hidden, however far:
    /// one contact a pair, body by body from the first of `bodies` on, and for each in the order of the obstacles.
    pub fn for_each_pair<'a>(
        &self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        mut visit: impl FnMut(&Contact<D>),
    ) {
        for (index, body) in bodies.into_iter().enumerate() {
            let seen = self.measured(Carrier::of(&body), false);
            seen.for_each(|j| visit(&self.contact(index, &body, j)));
        }
    }

    /// The same with every obstacle that is hidden and is there.
    pub fn for_each_hidden<'a>(
        &self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        mut visit: impl FnMut(&Contact<D>),
    ) {
        if self.hides_any() {
            for (index, body) in bodies.into_iter().enumerate() {
                let hidden = self.measured(Carrier::of(&body), true);
                hidden.for_each(|j| visit(&self.contact(index, &body, j)));
            }
        }
    }

    /// The obstacles that a body is measured against, those that are hidden or the others.
    fn measured(&self, carrier: Carrier, hidden: bool) -> impl Iterator<Item = usize> {
        let all = self.obstacles.iter().enumerate();
        let is_meant = move |it: &Placed<S, D>| it.is_hidden == hidden && !it.is_future();
        let asked = all.filter(move |(_, it)| is_meant(it) && !it.is_ignored_by(carrier));
        asked.map(|(j, _)| j)
    }
}
