//! The nearest points of every body of the robot to every obstacle: one loop, whatever the space.

use super::hull_query::near_hull;
use super::{Asked, Carrier, Contact, Named, ObstacleGeometry, Outlook, Pair, Placed, Turn, World};
use crate::geometry::{Body, PlacedHull};
use crate::interrupt;
use crate::math::Capsule;

/// How much farther away than it was the nearest of all obstacles is expected at most when a body is asked again \[m\].
const STRIDE: f64 = 2e-3;
/// Less than this share below a limit, a distance may be rounded from one that is not.
const ROUNDING: f64 = 1e-9;

/// What a controller asks of the world around the arm: the nearest points of every body of
/// the robot to everything that it knows of.
///
/// # Example
/// The smallest distance from a link to any obstacle:
/// ```
/// use vff_core::geometry::Body;
/// use vff_core::math::{Capsule, Vector};
/// use vff_core::world::plane::{Obstacle, Shape, World};
/// use vff_core::world::CollisionQuery;
///
/// let disc = |x: f64| Obstacle {
///     position: [x, 0.5],
///     ..Obstacle::of(Shape::Circle { radius: 0.1 })
/// };
/// let mut world = World::new(vec![disc(0.2), disc(3.0)]);
/// assert_eq!(world.obstacle_count(), 2);
/// let link = Capsule::new(Vector::<2>::zeros(), Vector::<2>::new(1.0, 0.0), 0.1);
/// let mut least = f64::INFINITY;
/// world.for_each_pair([Body::new(0, link)], |contact| least = least.min(contact.distance));
/// assert!((least - 0.3).abs() < 1e-15);
/// ```
pub trait CollisionQuery<const D: usize> {
    /// How many obstacles there are.
    fn obstacle_count(&self) -> usize;

    /// The most contacts that one body can have: of most obstacles one each.
    fn contact_count(&self) -> usize {
        self.obstacle_count()
    }

    /// Calls `visit` with the contacts nearer than `reach` \[m\], and `distance`, body by body,
    /// with the index of the link and the signed distance to whatever is nearest, however far \[m\].
    fn for_each_contact<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        distance: impl FnMut(usize, f64),
        visit: impl FnMut(&Contact<D>),
    );

    /// Calls `visit` with the index of every obstacle nearer than `reach` \[m\] to a body, once or more for each body, and of every possible
    /// future, wherever that begins.
    fn for_each_obstacle_near<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        mut visit: impl FnMut(usize),
    ) {
        self.for_each_contact(bodies, reach, |_, _| {}, |contact| visit(contact.obstacle));
    }

    /// How likely it is at most that this possible future or one that is no likelier comes true; ∞ of an obstacle that is there (T204).
    ///
    /// # Example
    /// ```
    /// use vff_core::world::CollisionQuery;
    /// use vff_core::world::plane::{Obstacle, Shape, World};
    ///
    /// let of = |likelihood| Obstacle { likelihood, ..Obstacle::of(Shape::Circle { radius: 0.1 }) };
    /// let mut obstacles = [Some(0.5), None, Some(0.25), Some(0.125), Some(0.125)].map(of);
    /// // Two parts of one future count once.
    /// obstacles[3..].iter_mut().for_each(|it| it.future = Some("both hands".into()));
    /// let world = World::new(obstacles.to_vec());
    /// let likely = [0, 1, 2, 3, 4].map(|j| world.likelihood_up_to(j));
    /// assert_eq!(likely, [0.875, f64::INFINITY, 0.375, 0.125, 0.125]);
    /// ```
    fn likelihood_up_to(&self, obstacle: usize) -> f64 {
        let _ = obstacle;
        f64::INFINITY
    }

    /// The most barriers that one body can have.
    fn barrier_count(&self) -> usize {
        self.contact_count()
    }

    /// The largest margin of its own that a pair has \[m\]; 0 if none has one.
    fn most_margin(&self) -> f64 {
        0.0
    }

    /// The most barriers that one hull can have.
    fn hull_barrier_count(&self) -> usize {
        self.barrier_count()
    }

    /// Calls `visit` with all distances nearer than `reach` \[m\] that must be kept so that every contact is:
    /// the contacts themselves, or, where nearest features change at once, each feature that may be next.
    fn for_each_barrier<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        visit: impl FnMut(&Contact<D>),
    ) {
        self.for_each_contact(bodies, reach, |_, _| {}, visit);
    }

    /// The same, but for those of a cloud that others imply for a program of this `outlook` (T157).
    fn for_each_needed<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        outlook: &Outlook<'_, D>,
        visit: impl FnMut(&Contact<D>),
    ) {
        let _ = outlook;
        self.for_each_barrier(bodies, reach, visit);
    }

    /// A speed that no point of an obstacle exceeds from now on \[m/s\], where that of its nearest point does not tell: it is carried on
    /// where its motion has it, faster or slower than now (see [`Motion::is_foreseen`](super::Motion::is_foreseen)), or it is a cloud
    /// whose points move by themselves.
    fn speed_bound(&self, obstacle: usize) -> Option<f64> {
        let _ = obstacle;
        None
    }

    /// The contact of body number `index` with `obstacle`, infinitely far where these are not measured against each other, were that carried on for `after` \[s\], or back for −`after`, at
    /// its present velocity and rate of turning, or as it is foreseen.
    fn contact_after(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
    ) -> Contact<D>;

    /// What `take` makes of it; calls `visit` with all of their contacts nearer than `reach` \[m\], of which it is the
    /// nearest. Nothing is computed that neither of them asks for.
    #[expect(clippy::too_many_arguments, reason = "a question, and what is wanted of the answer")]
    #[inline]
    fn for_each_contact_after<T>(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        mut visit: impl FnMut(&Contact<D>),
        take: impl Fn(&Contact<D>) -> T,
    ) -> T {
        let nearest = self.contact_after(index, body, obstacle, after);
        if nearest.distance < reach {
            visit(&nearest);
        }
        take(&nearest)
    }

    /// The same, but of a cloud those contacts alone that a program of this `outlook` needs (T157).
    #[expect(clippy::too_many_arguments, reason = "a question, and what is wanted of the answer")]
    fn for_each_needed_after(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        outlook: &Outlook<'_, D>,
        visit: impl FnMut(&Contact<D>),
    ) {
        let _ = outlook;
        self.for_each_contact_after(index, body, obstacle, after, reach, visit, |_| {});
    }

    /// The same, but of a cloud the contact of the body and those of the ends of its axis alone.
    #[expect(clippy::too_many_arguments, reason = "a question, and what is wanted of the answer")]
    #[inline]
    fn approach_after<T>(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        visit: impl FnMut(&Contact<D>),
        take: impl Fn(&Contact<D>) -> T,
    ) -> T {
        self.for_each_contact_after(index, body, obstacle, after, reach, visit, take)
    }
}

/// Points of whatever space, as they are written: one coordinate after the other.
pub trait Positions {
    /// How many points there are.
    fn count(&self) -> usize;
    /// Appends the coordinates of all of them \[m\].
    fn append_to(&self, out: &mut Vec<f64>);
}

impl<S: ObstacleGeometry<D>, const D: usize> World<S, D> {
    /// Body by body from the first of `bodies` on, and for each in the order of the obstacles: `meet` is called with those
    /// that may be within reach, and how they are turned. The distance of what is nearest is needed below `limit` \[m\] only, and not
    /// at all where that is no more than `reach`.
    #[inline(always)] // three times
    fn for_each_near<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        limit: f64,
        distance: &mut dyn FnMut(usize, f64),
        mut meet: impl FnMut(
            Pair,
            &S::Probe,
            Option<&PlacedHull<'_, D>>,
            &Placed<S, D>,
            Option<&Turn<D>>,
        ),
    ) {
        if self.obstacles.is_empty() {
            return;
        }
        let Self { obstacles, named, time, remembered, contacts, .. } = self;
        // The same is done with all as with the few that a crowd names: measured first, and only bodies with
        // something in reach are looked at again. Two loops, for the first needs all the registers, and asks nobody
        // whether it turns.
        let bodies = bodies.into_iter().enumerate();
        if let Named::All = named {
            for (index, body) in bodies {
                let Body { link, shape, hull, .. } = body;
                let probe = S::probe(&shape);
                // There are no hulls in the plane.
                if D > 2
                    && let Some(hull) = &hull
                {
                    let mut found = |pair, obstacle: &_, turn: Option<&_>| {
                        meet(pair, &probe, Some(hull), obstacle, turn);
                    };
                    let (asked, limits) = ((index, &body, hull), [reach, limit]);
                    distance(
                        link,
                        near_hull(obstacles, named, *time, asked, &probe, limits, &mut found),
                    );
                    continue;
                }
                let least = least_distance(obstacles.iter(), |obstacle| {
                    obstacle.geometry.distance_below(&probe, &obstacle.state, limit)
                });
                distance(link, least);
                if least < reach {
                    for (j, obstacle) in obstacles.iter().enumerate() {
                        let pair = obstacle.pair(index, Carrier::of(&body), j);
                        meet(pair, &probe, None, obstacle, None);
                    }
                }
            }
            return;
        }
        // What was nearest before is worth a second look where one obstacle alone has many points to search.
        let searched = *contacts > obstacles.len();
        for (index, body) in bodies {
            interrupt::checkpoint(256);
            let (Body { link, shape, hull, .. }, carrier) = (body, Carrier::of(&body));
            let probe = S::probe(&shape);
            if let Some(hull) = &hull {
                let mut found = |pair, obstacle: &_, turn: Option<&_>| {
                    meet(pair, &probe, Some(hull), obstacle, turn);
                };
                let (asked, limits) = ((index, &body, hull), [reach, limit]);
                distance(
                    link,
                    near_hull(obstacles, named, *time, asked, &probe, limits, &mut found),
                );
                continue;
            }
            let near = match named {
                Named::All => &[],
                Named::Each(all) => &all[..],
                Named::BroadPhase(broad_phase) => {
                    broad_phase.near(obstacles, *time, carrier, &probe, reach)
                }
            };
            let work = 64 * near.len();
            let near = || near.iter().copied().filter(|&j| !obstacles[j].is_ignored_by(carrier));
            // Where no distance is asked for, a search for the nearest point does not pay: they are searched for all in reach.
            if searched && limit <= reach && limit.is_finite() {
                interrupt::checkpoint(work);
                for j in near() {
                    let obstacle = &obstacles[j];
                    let pair = obstacle.pair(index, carrier, j);
                    meet(pair, &probe, None, obstacle, obstacle.turn());
                }
                continue;
            }
            let below = |limit: f64| {
                let near = near().map(|j| &obstacles[j]);
                least_distance(near, |obstacle| obstacle.distance_below(&probe, limit))
            };
            let before = remembered.get_mut(index).filter(|_| searched);
            let expected = before.as_ref().map_or(f64::INFINITY, |before| **before + STRIDE);
            let mut least = below(expected.min(limit));
            if expected < limit && least >= expected - ROUNDING * (1.0 + expected.abs()) {
                least = below(limit);
            }
            if let Some(before) = before
                && limit.is_infinite()
            {
                *before = least;
            }
            distance(link, least);
            if least < reach {
                interrupt::checkpoint(work);
                for j in near() {
                    let obstacle = &obstacles[j];
                    let pair = obstacle.pair(index, carrier, j);
                    meet(pair, &probe, None, obstacle, obstacle.turn());
                }
            }
        }
    }
}

// Compiled once for each kind of bodies, whoever visits.
impl<S: ObstacleGeometry<D>, const D: usize> World<S, D> {
    fn for_each_contact_of<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        distance: &mut dyn FnMut(usize, f64),
        visit: &mut dyn FnMut(&Contact<D>),
    ) {
        let all = f64::INFINITY;
        self.for_each_near(bodies, reach, all, distance, |pair, probe, hull, obstacle, turn| {
            let state = &obstacle.state;
            match hull {
                None => obstacle.for_each_contact(pair, probe, state, turn, reach, &mut *visit),
                Some(hull) => {
                    let asked = Asked::Contacts(reach);
                    obstacle.meet_hull(pair, hull, probe, state, turn, asked, visit);
                }
            }
        });
    }

    /// All barriers, or those of clouds that a program of this `outlook` needs.
    fn for_each_barrier_of<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        outlook: Option<&Outlook<'_, D>>,
        visit: &mut dyn FnMut(&Contact<D>),
    ) {
        self.for_each_near(
            bodies,
            reach,
            reach,
            &mut |_, _| {},
            |pair, probe, hull, obstacle, turn| {
                let state = &obstacle.state;
                if let Some(hull) = hull {
                    let asked = Asked::Barriers(reach);
                    return obstacle.meet_hull(pair, hull, probe, state, turn, asked, visit);
                }
                if let Some(outlook) = outlook.filter(|_| obstacle.geometry.contacts() > 1) {
                    let visit = &mut *visit;
                    return obstacle
                        .for_each_needed(pair, probe, state, turn, reach, outlook, visit);
                }
                obstacle.for_each_barrier(pair, probe, turn, reach, |barrier| {
                    if barrier.distance < reach {
                        visit(barrier);
                    }
                });
            },
        );
    }
}

impl<S: ObstacleGeometry<D>, const D: usize> CollisionQuery<D> for World<S, D> {
    fn obstacle_count(&self) -> usize {
        self.len()
    }

    fn contact_count(&self) -> usize {
        self.contacts
    }

    #[inline]
    fn for_each_contact<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        mut distance: impl FnMut(usize, f64),
        mut visit: impl FnMut(&Contact<D>),
    ) {
        self.for_each_contact_of(bodies, reach, &mut distance, &mut visit);
    }

    fn for_each_obstacle_near<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        mut visit: impl FnMut(usize),
    ) {
        self.for_each_near(bodies, reach, reach, &mut |_, _| {}, |pair, probe, _, obstacle, _| {
            // Of a hull by the capsule around it: some may be farther.
            if obstacle.distance_below(probe, reach) < reach {
                visit(pair.obstacle);
            }
        });
        if matches!(self.named, Named::Each(_)) {
            let all = self.obstacles.iter().enumerate();
            all.filter(|(_, it)| it.is_future()).for_each(|(j, _)| visit(j));
        }
    }

    fn likelihood_up_to(&self, obstacle: usize) -> f64 {
        self.obstacles[obstacle].likelihood_up_to.unwrap_or(f64::INFINITY)
    }

    fn barrier_count(&self) -> usize {
        self.barriers
    }

    fn most_margin(&self) -> f64 {
        self.most_margin
    }

    fn speed_bound(&self, obstacle: usize) -> Option<f64> {
        self.obstacles[obstacle].speed_bound()
    }

    fn hull_barrier_count(&self) -> usize {
        self.hull_barriers
    }

    #[inline]
    fn for_each_barrier<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        mut visit: impl FnMut(&Contact<D>),
    ) {
        self.for_each_barrier_of(bodies, reach, None, &mut visit);
    }

    #[inline]
    fn for_each_needed<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        outlook: &Outlook<'_, D>,
        mut visit: impl FnMut(&Contact<D>),
    ) {
        self.for_each_barrier_of(bodies, reach, Some(outlook), &mut visit);
    }

    fn for_each_needed_after(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        outlook: &Outlook<'_, D>,
        visit: impl FnMut(&Contact<D>),
    ) {
        let placed = &self.obstacles[obstacle];
        if placed.is_ignored_by(Carrier::of(body)) {
            return;
        }
        if placed.geometry.contacts() == 1 || body.hull.is_some() {
            return self.for_each_contact_after(index, body, obstacle, after, reach, visit, |_| {});
        }
        let pair = placed.pair(index, Carrier::of(body), obstacle);
        let (probe, state) = (S::probe(&body.shape), placed.state_after(self.time, after));
        let turn = placed.turn_after(self.time, after);
        placed.for_each_needed(pair, &probe, &state, turn.as_ref(), reach, outlook, visit);
    }

    #[inline]
    fn approach_after<T>(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        mut visit: impl FnMut(&Contact<D>),
        take: impl Fn(&Contact<D>) -> T,
    ) -> T {
        let placed = &self.obstacles[obstacle];
        let is_simple = placed.geometry.contacts() == 1 || body.hull.is_some();
        if is_simple || placed.is_ignored_by(Carrier::of(body)) {
            return self.for_each_contact_after(index, body, obstacle, after, reach, visit, take);
        }
        let shape = &body.shape;
        let pair = placed.pair(index, Carrier::of(body), obstacle);
        let state = placed.state_after(self.time, after);
        let turn = placed.turn_after(self.time, after);
        let contact =
            |shape: &Capsule<D>| placed.contact(pair, &S::probe(shape), &state, turn.as_ref());
        let nearest = contact(shape);
        if nearest.distance < reach {
            visit(&nearest);
            if shape.length > 0.0 {
                for end in [shape.start, shape.end()].iter().filter(|end| **end != nearest.point) {
                    let of_end = contact(&Capsule { start: *end, length: 0.0, ..*shape });
                    if of_end.distance < reach {
                        visit(&of_end);
                    }
                }
            }
        }
        take(&nearest)
    }

    #[inline]
    fn contact_after(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
    ) -> Contact<D> {
        let (unvisited, whole) = (|_: &Contact<D>| {}, |nearest: &Contact<D>| *nearest);
        let none = f64::NEG_INFINITY;
        self.for_each_contact_after(index, body, obstacle, after, none, unvisited, whole)
    }

    #[inline]
    fn for_each_contact_after<T>(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        mut visit: impl FnMut(&Contact<D>),
        take: impl Fn(&Contact<D>) -> T,
    ) -> T {
        let placed = &self.obstacles[obstacle];
        let pair = placed.pair(index, Carrier::of(body), obstacle);
        let (probe, state) = (S::probe(&body.shape), placed.state_after(self.time, after));
        // Most are like this: apart, so that nothing is computed that the caller does not ask for.
        let is_simple = placed.turned.is_none() && placed.ignored.is_empty();
        if body.hull.is_none() && is_simple && placed.geometry.contacts() == 1 {
            let contact = placed.geometry.contact(pair, &probe, &state);
            if contact.distance < reach {
                visit(&contact);
            }
            return take(&contact);
        }
        let turn = placed.turn_after(self.time, after);
        let turn = turn.as_ref();
        let nearest = match &body.hull {
            None => placed.contact(pair, &probe, &state, turn),
            Some(hull) => placed.hull_contact(pair, hull, &probe, &state, turn),
        };
        if placed.is_ignored_by(Carrier::of(body)) {
            return take(&Contact { distance: f64::INFINITY, ..nearest });
        }
        if nearest.distance < reach {
            if placed.geometry.contacts() == 1 {
                visit(&nearest);
            } else if let Some(hull) = &body.hull {
                let asked = Asked::Contacts(reach);
                placed.meet_hull(pair, hull, &probe, &state, turn, asked, &mut visit);
            } else {
                placed.for_each_contact(pair, &probe, &state, turn, reach, visit);
            }
        }
        take(&nearest)
    }
}

impl<S: ObstacleGeometry<D>, const D: usize> Positions for World<S, D> {
    fn count(&self) -> usize {
        self.len()
    }

    fn append_to(&self, out: &mut Vec<f64>) {
        (0..self.len()).for_each(|j| out.extend_from_slice(self.position(j).as_slice()));
    }
}

/// The distance between the surfaces of a body and the nearest of these obstacles \[m\]; ∞ if there are none.
#[inline(always)] // discs, by far the most frequent, stay within the loop over the bodies
fn least_distance<'a, S: ObstacleGeometry<D> + 'a, const D: usize>(
    obstacles: impl Iterator<Item = &'a Placed<S, D>>,
    distance: impl Fn(&Placed<S, D>) -> f64,
) -> f64 {
    let distances = obstacles.map(distance);
    let least = distances.fold(f64::INFINITY, |a, b| if b < a { b } else { a });
    // Of 0 and −0 either may have been the first: + 0 makes them one.
    least + 0.0
}
