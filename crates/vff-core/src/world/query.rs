//! The nearest points of every link to every obstacle: one loop, whatever the space.

use super::{Contact, Placed, Solid, World};
use crate::interrupt;
use crate::math::{Capsule, Vector};

/// What a controller asks of the world around the arm: the nearest points of every link to
/// everything that it knows of.
pub trait CollisionQuery<const D: usize> {
    /// The most contacts that one link can have.
    fn obstacle_count(&self) -> usize;

    /// Calls `visit` with the contacts nearer than `reach` [m], and `distance` with the index of
    /// every link and its signed distance to whatever is nearest, however far [m].
    fn for_each_contact(
        &mut self,
        links: impl IntoIterator<Item = Capsule<D>>,
        reach: f64,
        distance: impl FnMut(usize, f64),
        visit: impl FnMut(&Contact<D>),
    );

    /// The most barriers that one link can have.
    fn barrier_count(&self) -> usize {
        self.obstacle_count()
    }

    /// Calls `visit` with all distances nearer than `reach` [m] that must be kept so that every contact is:
    /// the contacts themselves, or, where nearest features change at once, each feature that may be next.
    fn for_each_barrier(
        &mut self,
        links: impl IntoIterator<Item = Capsule<D>>,
        reach: f64,
        visit: impl FnMut(&Contact<D>),
    ) {
        self.for_each_contact(links, reach, |_, _| {}, visit);
    }

    /// The contact of a link with `obstacle`, were that carried on for `after` [s], or back for −`after`, at
    /// its present velocity.
    fn contact_after(
        &self,
        link: usize,
        capsule: &Capsule<D>,
        obstacle: usize,
        after: f64,
    ) -> Contact<D>;
}

impl<S: Solid<D>, const D: usize> World<S, D> {
    /// The nearest points between `capsule`, which is link number `link`, and obstacle `j`.
    ///
    /// Where several pairs are nearest (the axis of a link through the centre of a circle, parallel
    /// edges) one of them is taken, always the same.
    ///
    /// # Arguments
    /// * `capsule`: in the world frame, with `start` ≠ `end` [m]. NaN coordinates give a NaN
    ///   distance.
    ///
    /// # Panics
    /// If `j` is not less than [`World::len`].
    #[inline]
    pub fn contact(&self, link: usize, capsule: &Capsule<D>, j: usize) -> Contact<D> {
        let obstacle = &self.obstacles[j];
        let moved;
        let state = if obstacle.is_at(self.time) {
            &obstacle.state
        } else {
            moved = obstacle.moved_to(self.time);
            &moved
        };
        obstacle.solid.contact([link, j], &S::probe(capsule), state)
    }

    /// The distance [m] from `origin` along the unit vector `direction` to the first obstacle within
    /// `range` [m]; 0 inside one. The obstacles stand where the last [`update`](Self::update) put them.
    pub fn cast(&self, origin: Vector<D>, direction: Vector<D>, range: f64) -> Option<f64> {
        let hit = |obstacle: &Placed<S, D>| {
            let position = obstacle.state_at(self.time).position;
            obstacle.solid.cast(&(origin - position), &direction, range)
        };
        self.obstacles.iter().filter_map(hit).reduce(f64::min)
    }

    /// Link by link from the first of `links` on, and for each link in the order of the obstacles.
    ///
    /// See [`World::contact`] for what is expected of a link.
    #[inline(always)] // twice
    fn for_each_near(
        &mut self,
        links: impl IntoIterator<Item = Capsule<D>>,
        reach: f64,
        mut distance: impl FnMut(usize, f64),
        mut visit: impl FnMut(&Contact<D>, &S::Probe, &Placed<S, D>),
    ) {
        let Self { obstacles, crowd, time, .. } = self;
        if obstacles.is_empty() {
            return;
        }
        let mut meet = |link: usize, probe: &S::Probe, j: usize, obstacle: &Placed<S, D>| {
            let contact = obstacle.solid.contact([link, j], probe, &obstacle.state);
            if contact.distance < reach {
                visit(&contact, probe, obstacle);
            }
        };
        for (link, capsule) in links.into_iter().enumerate() {
            let probe = S::probe(&capsule);
            let near = match crowd {
                Some(crowd) => {
                    interrupt::spend(256);
                    crowd.near(obstacles, *time, &probe, reach)
                }
                None => None,
            };
            // The same is done with the few that a crowd names as with all: measured first, and only
            // links with something in reach are looked at again.
            let obstacles = &*obstacles;
            let least = match near {
                None => least_distance(obstacles, &probe),
                Some(near) => least_distance(near.iter().map(|&j| &obstacles[j]), &probe),
            };
            distance(link, least);
            if least < reach {
                let mut meet = |j: usize| meet(link, &probe, j, &obstacles[j]);
                match near {
                    None => (0..obstacles.len()).for_each(meet),
                    Some(near) => {
                        interrupt::spend(64 * near.len());
                        near.iter().for_each(|&j| meet(j));
                    }
                }
            }
        }
    }
}

impl<S: Solid<D>, const D: usize> CollisionQuery<D> for World<S, D> {
    fn obstacle_count(&self) -> usize {
        self.len()
    }

    #[inline]
    fn for_each_contact(
        &mut self,
        links: impl IntoIterator<Item = Capsule<D>>,
        reach: f64,
        distance: impl FnMut(usize, f64),
        mut visit: impl FnMut(&Contact<D>),
    ) {
        self.for_each_near(links, reach, distance, |contact, _, _| visit(contact));
    }

    fn barrier_count(&self) -> usize {
        self.barriers
    }

    #[inline]
    fn for_each_barrier(
        &mut self,
        links: impl IntoIterator<Item = Capsule<D>>,
        reach: f64,
        mut visit: impl FnMut(&Contact<D>),
    ) {
        self.for_each_near(
            links,
            reach,
            |_, _| {},
            |contact, probe, obstacle| {
                obstacle.solid.for_each_barrier(contact, probe, &obstacle.state, |barrier| {
                    if barrier.distance < reach {
                        visit(barrier);
                    }
                });
            },
        );
    }

    #[inline]
    fn contact_after(
        &self,
        link: usize,
        capsule: &Capsule<D>,
        obstacle: usize,
        after: f64,
    ) -> Contact<D> {
        let placed = &self.obstacles[obstacle];
        let mut state = placed.state_at(self.time);
        state.position += state.velocity * after;
        placed.solid.contact([link, obstacle], &S::probe(capsule), &state)
    }
}

/// The distance between the surfaces of a link and the nearest of these obstacles [m]; ∞ if there are none.
#[inline(always)] // discs, by far the most frequent, stay within the loop over the links
fn least_distance<'a, S: Solid<D> + 'a, const D: usize>(
    obstacles: impl IntoIterator<Item = &'a Placed<S, D>>,
    probe: &S::Probe,
) -> f64 {
    let distances = obstacles.into_iter().map(|obstacle| obstacle.distance(probe));
    let least = distances.fold(f64::INFINITY, |a, b| if b < a { b } else { a });
    // Of 0 and −0 either may have been the first: + 0 makes them one.
    least + 0.0
}
