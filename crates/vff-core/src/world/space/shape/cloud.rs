//! A cloud of points: balls of one radius that move and turn as one obstacle.
//!
//! Every ball is to a link what a sphere at that place would be, to the last bit; the link has a contact with each. Which
//! of them are near is found from boxes around few points each that lie side by side. The boxes are those of the cloud at
//! rest, where it is described: as with every solid it is the link that is moved and turned for the query, so that a cloud
//! that moves and turns costs no more than one that stands.

use super::sphere::cast_at_ball;
use crate::geometry::axis::{Nearest, Probe, perpendicular, seen_from};
use crate::geometry::point::{distance_to_point, square_to_point, to_point};
use crate::interrupt;
use crate::math::{UnitQuaternion, Vector};
use crate::world::space::contact::{axis_of, contact_of};
use crate::world::space::needed_points::{MAX_NEEDED, NeededPoints};
use crate::world::space::point_bvh::{PointBvh, Sight, around};
use crate::world::{Ahead, Contact, Feature, MotionState, Pair, ShapeFault};
use std::fmt;
use std::ops::Range;

/// The most points of a cloud.
pub const MAX_POINTS: usize = 50_000;

/// Points that are found at once.
const ROOM: usize = 256;

/// The points \[m\], relative to the obstacle's position and turned by its orientation, in boxes.
#[derive(Clone)]
pub(in super::super) struct Cloud {
    /// Those that lie side by side one after the other.
    points: Vec<Vector<3>>,
    /// Where each stood in the list that was given.
    numbers: Vec<u32>,
    runs: PointBvh,
    /// Opposite corners of a box around all of them \[m\].
    extent: [Vector<3>; 2],
    /// How far the farthest is from the position \[m\].
    reach: f64,
}

/// Whether they are few enough.
pub(super) fn check(points: &[[f64; 3]]) -> Result<(), ShapeFault> {
    match points.len() <= MAX_POINTS {
        true => Ok(()),
        false => {
            let told = format!("at most {MAX_POINTS} of them, got {}", points.len());
            Err(ShapeFault::told("points", told))
        }
    }
}

impl fmt::Debug for Cloud {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Cloud").field("points", &self.points.len()).finish_non_exhaustive()
    }
}

/// What is asked: a link, from an obstacle at a position.
struct Query<'a> {
    link: &'a Probe,
    position: &'a Vector<3>,
    /// Where the axis is; none where all points must be asked.
    sight: Option<Sight>,
}

impl Query<'_> {
    /// The distance of the axis from the centre of a ball \[m\], that of a sphere there.
    #[inline(always)]
    fn distance(&self, point: &Vector<3>) -> f64 {
        distance_to_point(&seen_from(self.link, &(self.position + point)), &Vector::zeros())
    }

    /// Its square \[m²\].
    #[inline(always)]
    fn square(&self, point: &Vector<3>) -> f64 {
        square_to_point(&seen_from(self.link, &(self.position + point)), &Vector::zeros())
    }
}

impl Cloud {
    /// Of these points, turned. Undefined numbers do not panic.
    #[expect(clippy::cast_possible_truncation, reason = "fewer than 2³² points")]
    pub(in super::super) fn new(points: &[[f64; 3]], turn: &UnitQuaternion) -> Self {
        interrupt::spend(64 * points.len());
        let turned: Vec<Vector<3>> =
            points.iter().map(|point| turn.rotate(&Vector::from(*point))).collect();
        let extent @ [low, high] = around(&turned);
        // The place on the curve above the number.
        let key = |(point, number)| u64::from(along_the_curve(point, &low, &high)) << 32 | number;
        let mut order: Vec<u64> = turned.iter().zip(0u64..).map(key).collect();
        order.sort_unstable();
        let numbers: Vec<u32> = order.iter().map(|key| *key as u32).collect();
        let points: Vec<Vector<3>> = numbers.iter().map(|i| turned[*i as usize]).collect();
        Self {
            runs: PointBvh::new(&points),
            reach: points.iter().map(Vector::norm).fold(0.0, f64::max),
            extent,
            points,
            numbers,
        }
    }

    /// How many points there are.
    pub(in super::super) fn len(&self) -> usize {
        self.points.len()
    }

    /// Opposite corners of a box around the balls \[m\].
    pub(in super::super) fn extent(&self, radius: f64) -> [Vector<3>; 2] {
        let [low, high] = if self.points.is_empty() { [Vector::zeros(); 2] } else { self.extent };
        [low.add_scalar(-radius), high.add_scalar(radius)]
    }

    /// How far the farthest point is from the position \[m\].
    pub(in super::super) fn reach(&self) -> f64 {
        self.reach
    }

    /// How far a ray goes until it meets the first of the balls \[m\]; 0 inside.
    pub(in super::super) fn cast(
        &self,
        origin: &Vector<3>,
        direction: &Vector<3>,
        radius: f64,
        range: f64,
    ) -> Option<f64> {
        let mut first = None;
        let ray = Probe { start: *origin, direction: *direction, length: range, radius: 0.0 };
        self.for_each_beside(&ray, radius, |point| {
            let met = cast_at_ball(&(origin - point), direction, radius);
            first = [first, met].into_iter().flatten().reduce(f64::min);
        });
        first
    }

    fn query<'a>(&self, link: &'a Probe, position: &'a Vector<3>) -> Query<'a> {
        Query { link, position, sight: self.runs.sight(link, position) }
    }

    /// Calls `measure` with the places of all points that may be within `limit` \[m\] of the axis of the link, and of others:
    /// run by run, nearest first as a rule. It returns the limit from then on.
    #[inline(always)]
    fn approach(
        &self,
        query: &Query<'_>,
        limit: f64,
        mut measure: impl FnMut(Range<usize>) -> f64,
    ) {
        match &query.sight {
            None => drop(measure(0..self.points.len())),
            Some(sight) => self.runs.approach(sight, limit, measure),
        }
    }

    /// The place of the point nearest to the axis of the link, the first in the list that was given among those equally
    /// near; none in an empty cloud. Where none is nearer than `limit` \[m\], any.
    fn nearest(&self, query: &Query<'_>, limit: f64) -> Option<usize> {
        let (mut least, mut first, mut nearest) = (f64::INFINITY, u32::MAX, 0);
        self.approach(query, limit, |places| {
            for place in places {
                let (square, number) = (query.square(&self.points[place]), self.numbers[place]);
                #[expect(clippy::float_cmp, reason = "whichever is first of the very same")]
                if square < least || square == least && number < first {
                    (least, first, nearest) = (square, number, place);
                }
            }
            least.sqrt()
        });
        (!self.points.is_empty()).then_some(nearest)
    }

    /// The distance of the nearest centre from the axis of a link \[m\], if that is less than `limit` \[m\], or else one that is
    /// not; ∞ in an empty cloud.
    pub(in super::super) fn distance(&self, link: &Probe, position: &Vector<3>, limit: f64) -> f64 {
        let query = self.query(link, position);
        self.nearest(&query, limit)
            .map_or(f64::INFINITY, |place| query.distance(&self.points[place]))
    }

    /// The contact with the nearest ball of this `radius` \[m\]. Of an empty cloud it is infinitely far.
    pub(in super::super) fn contact(
        &self,
        pair: Pair,
        link: &Probe,
        radius: f64,
        state: &MotionState<3>,
    ) -> Contact<3> {
        match self.nearest(&self.query(link, &state.position), f64::INFINITY) {
            Some(place) => self.touch(place, pair, link, radius, state),
            None => {
                let (distance, normal) = (f64::INFINITY, perpendicular(&link.direction));
                let nowhere =
                    Nearest { distance, normal, point: Vector::zeros(), feature: Feature::Face };
                let found =
                    contact_of(pair, &nowhere, &axis_of(link), [radius, link.radius], state);
                Contact { point: link.start, witness: link.start, ..found }
            }
        }
    }

    /// The contact with one ball: that with a sphere there.
    #[inline]
    fn touch(
        &self,
        place: usize,
        pair: Pair,
        link: &Probe,
        radius: f64,
        state: &MotionState<3>,
    ) -> Contact<3> {
        let centre = MotionState { position: state.position + self.points[place], ..*state };
        let nearest = to_point(&seen_from(link, &centre.position), &Vector::zeros());
        contact_of(pair, &nearest, &axis_of(link), [radius, link.radius], &centre)
    }

    /// The contacts with all balls nearer than `reach` \[m\], in the order in which their points were given.
    pub(in super::super) fn for_each_contact(
        &self,
        pair: Pair,
        link: &Probe,
        radius: f64,
        state: &MotionState<3>,
        reach: f64,
        mut visit: impl FnMut(&Contact<3>),
    ) {
        let query = self.query(link, &state.position);
        let mut room = [(0, 0); ROOM];
        let mut first = 0;
        // The first few at a time, since nothing may be allocated here.
        loop {
            let found = self.within(&query, radius, reach, first, &mut room);
            interrupt::spend(64 * found.len());
            for (_, place) in found {
                visit(&self.touch(*place as usize, pair, link, radius, state));
            }
            match found {
                [.., (last, _)] if found.len() == ROOM => first = last + 1,
                _ => return,
            }
        }
    }

    /// Those of the contacts nearer than `reach` \[m\] that imply the others (T157), in the same order; of few points all.
    #[expect(clippy::too_many_arguments, reason = "two things, where they are, and a question")]
    #[expect(clippy::cast_possible_truncation, reason = "fewer than 2³² points")]
    pub(in super::super) fn for_each_needed(
        &self,
        pair: Pair,
        link: &Probe,
        radius: f64,
        state: &MotionState<3>,
        reach: f64,
        ahead: &Ahead<3>,
        mut visit: impl FnMut(&Contact<3>),
    ) {
        if self.points.len() <= MAX_NEEDED {
            return self.for_each_contact(pair, link, radius, state, reach, visit);
        }
        let query = self.query(link, &state.position);
        let mut needed = NeededPoints::new(ahead, radius + link.radius, reach);
        let limit = needed.limit();
        self.approach(&query, limit, |places| {
            interrupt::spend(16 * places.len());
            for place in places {
                let axis = seen_from(link, &(state.position + self.points[place]));
                needed.add(&axis, self.numbers[place], place as u32);
            }
            needed.limit()
        });
        for point in needed.finish() {
            let contact = self.touch(point.place as usize, pair, link, radius, state);
            if contact.distance < reach {
                visit(&contact);
            }
        }
    }

    /// Numbers and places of the points within reach whose number is `first` or higher: the lowest of them, as many as there
    /// is room for, in their order.
    #[expect(clippy::cast_possible_truncation, reason = "fewer than 2³² points")]
    fn within<'r>(
        &self,
        query: &Query<'_>,
        radius: f64,
        reach: f64,
        first: u32,
        room: &'r mut [(u32, u32); ROOM],
    ) -> &'r [(u32, u32)] {
        let mut count = 0;
        let limit = reach + radius + query.link.radius;
        self.approach(query, limit, |places| {
            for place in places {
                let found = (self.numbers[place], place as u32);
                let within =
                    query.distance(&self.points[place]) - radius - query.link.radius < reach;
                if !within || found.0 < first {
                    continue;
                }
                if count < ROOM {
                    room[count] = found;
                    count += 1;
                    if count == ROOM {
                        room.sort_unstable();
                    }
                } else if found < room[ROOM - 1] {
                    let at = room.partition_point(|other| *other < found);
                    room.copy_within(at..ROOM - 1, at + 1);
                    room[at] = found;
                }
            }
            limit
        });
        let found = &mut room[..count];
        if count < ROOM {
            found.sort_unstable();
        }
        found
    }

    /// Calls `visit` with the points within `radius` \[m\] of a segment, and others.
    fn for_each_beside(&self, segment: &Probe, radius: f64, mut visit: impl FnMut(&Vector<3>)) {
        self.approach(&self.query(segment, &Vector::zeros()), radius, |places| {
            self.points[places].iter().for_each(&mut visit);
            radius
        });
    }
}

/// Where a point comes along Hilbert's curve through a box, which leads from neighbour to neighbour (Skilling,
/// "Programming the Hilbert curve", AIP Conference Proceedings 707, 2004).
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "from 0 to 1023; 0 for what is not a number"
)]
fn along_the_curve(point: &Vector<3>, low: &Vector<3>, high: &Vector<3>) -> u32 {
    const BITS: u32 = 10;
    let side = (high - low).max();
    let [mut x, mut y, mut z] = [0, 1, 2].map(|k| (1023.0 * ((point[k] - low[k]) / side)) as u32);
    for bit in (1..BITS).rev() {
        let below = (1 << bit) - 1;
        // All ones where the bit is set, or else all zeros.
        let set = |coordinate: u32| 0u32.wrapping_sub(coordinate >> bit & 1);
        x ^= below & set(x);
        for other in [&mut y, &mut z] {
            let (inverted, exchanged) = (below & set(*other), (x ^ *other) & below & !set(*other));
            x ^= inverted | exchanged;
            *other ^= exchanged;
        }
    }
    y ^= x;
    z ^= y;
    let turns = |turns, bit| turns ^ (((1u32 << bit) - 1) & 0u32.wrapping_sub(z >> bit & 1));
    let turns = (1..BITS).fold(0, turns);
    let spread = |coordinate: u32| {
        // Two bits of room after each bit.
        let cell = coordinate ^ turns;
        let cell = (cell | cell << 16) & 0x0300_00ff;
        let cell = (cell | cell << 8) & 0x0300_f00f;
        let cell = (cell | cell << 4) & 0x030c_30c3;
        (cell | cell << 2) & 0x0924_9249
    };
    spread(x) << 2 | spread(y) << 1 | spread(z)
}

#[cfg(test)]
pub(in super::super) mod tests {
    use super::*;
    use crate::geometry::Body;
    use crate::math::Capsule;
    use crate::world::broad_phase::LEAST;
    use crate::world::broad_phase::tests::{motion, point, reach};
    use crate::world::space::oracle::*;
    use crate::world::space::{Obstacle, Points, Shape, Volume, World};
    use crate::world::{CollisionQuery, Motion, Solid};
    use proptest::prelude::*;

    fn cloud(points: Vec<[f64; 3]>, radius: f64) -> Obstacle {
        fixed(Shape::Points { points, radius }, [0.0; 3])
    }

    /// Anywhere, on a lattice where many are equally near and some coincide, or all in one place.
    pub fn any_points() -> impl Strategy<Value = Vec<[f64; 3]>> {
        let lattice = [-2i8..3, -2i8..3, -2i8..3].prop_map(|p| p.map(|x| 0.5 * f64::from(x)));
        prop_oneof![
            3 => prop::collection::vec(point(2.0), 0..40),
            2 => prop::collection::vec(lattice, 1..600),
            1 => (point(1.0), 1usize..20).prop_map(|(point, count)| vec![point; count]),
        ]
    }

    /// Everything that the world tells of these links, the obstacle's number left out.
    fn told(world: &mut World, links: &[Capsule<3>], reach: f64, after: f64) -> Vec<String> {
        let bodies = || links.iter().enumerate().map(|(link, shape)| Body::new(link, *shape));
        let text = |contact: &Contact<3>| format!("{:?}", Contact { obstacle: 0, ..*contact });
        let (mut found, mut rows, mut later) = (vec![], vec![], vec![]);
        let distances = |link: usize, d: f64| rows.push(format!("{link} {}", d.to_bits()));
        world.for_each_contact(bodies(), reach, distances, |contact| found.push(text(contact)));
        world.for_each_barrier(bodies(), reach, |barrier| rows.push(text(barrier)));
        for (i, body) in bodies().enumerate() {
            let mut least = f64::INFINITY;
            for j in 0..world.len() {
                let visit = |contact: &Contact<3>| later.push(text(contact));
                let nearest =
                    world.for_each_contact_after(i, &body, j, after, reach, visit, |nearest| {
                        *nearest
                    });
                least = least.min(nearest.distance);
            }
            later.push(format!("{}", least.to_bits()));
        }
        [found, rows, later].concat()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(512))]

        /// A cloud is the balls at its points, to the last bit: contacts in their order, distances, barriers, and what is
        /// predicted, but for the rounding of where a cloud on its way will be. In a world of its own, where the balls are a
        /// crowd or not, and beside others.
        #[test]
        fn a_cloud_is_the_balls_at_its_points(
            points in any_points(),
            radius in prop_oneof![Just(0.0), 0.0..0.3],
            links in prop::collection::vec(any_link(), 1..4),
            (position, orientation, spin) in (point(2.0), any_orientation(), three(3.0)),
            motion in motion(),
            (kind, others) in (0..3, 0..25usize),
            (reach, after, t) in (reach(), -0.5..0.5, -1.0..2.0),
        ) {
            // A world without any obstacle tells no distance, one with an empty cloud ∞.
            prop_assume!(!points.is_empty() || others > 0);
            let own = matches!(motion, Motion::Waypoints { .. } | Motion::Carried(_));
            let place = |shape, position| fixed(shape, position);
            let whole = Shape::Points { points: points.clone(), radius };
            let (cloud, balls): (_, Vec<_>) = match kind {
                // Where it stands.
                0 => (place(whole, position), points.iter().map(|point| {
                    let there = Vector::from(position) + Vector::from(*point);
                    place(Shape::Sphere { radius }, there.into())
                }).collect()),
                // On its way.
                1 if !own => {
                    let moving = |obstacle| Obstacle { motion: motion.clone(), ..obstacle };
                    let balls = points.iter().map(|point| moving(place(Shape::Sphere { radius }, *point)));
                    (moving(place(whole, [0.0; 3])), balls.collect())
                }
                // Turned and turning: a capsule without length is a ball beside its position.
                _ => {
                    let angular_velocity = spin.into();
                    let turning = |shape| Obstacle {
                        orientation, angular_velocity, motion: motion.clone(), ..place(shape, position)
                    };
                    let ball = |point: &[f64; 3]| turning(Shape::Capsule { a: *point, b: *point, radius });
                    (turning(whole), points.iter().map(ball).collect())
                }
            };
            let rest: Vec<_> = (0..others).map(|k| {
                let far = [0.3 * k as f64 - 2.0, 1.5, -0.5];
                place(Shape::Sphere { radius: 0.1 }, far)
            }).collect();
            let after = if kind == 1 { 0.0 } else { after };
            let mut one = World::new([vec![cloud], rest.clone()].concat());
            let mut many = World::new([balls, rest].concat());
            for t in [0.0, t, t + 0.01] {
                one.update(t);
                many.update(t);
                prop_assert_eq!(told(&mut one, &links, reach, after), told(&mut many, &links, reach, after));
            }
            prop_assert_eq!(one.barrier_count(), many.barrier_count());
            prop_assert_eq!(one.contact_count(), many.contact_count());
        }

        /// The nearest contact is that of the nearest ball.
        #[test]
        fn the_nearest_is_that_of_the_nearest_ball(points in any_points(), link in any_link()) {
            prop_assume!(!points.is_empty());
            let body = Body::new(0, link);
            let found = World::new(vec![cloud(points.clone(), 0.1)]).contact(0, &body, 0);
            let ball = |p: &[f64; 3]| contact(&link, &fixed(Shape::Sphere { radius: 0.1 }, *p));
            let balls: Vec<_> = points.iter().map(ball).collect();
            let least = balls.iter().map(|ball| ball.distance).fold(f64::INFINITY, f64::min);
            prop_assert_eq!(found.distance.to_bits(), least.to_bits());
            prop_assert!(balls.contains(&found));
        }

        /// With other points in place of its own a world is one that was made with them; the old ones come back.
        #[test]
        fn swapped_points_are_those_of_a_new_world(
            [old, new] in [any_points(), any_points()],
            link in any_link(),
            (orientation, spin, motion) in (any_orientation(), three(2.0), motion()),
            crowd in any::<bool>(),
            (reach, t) in (reach(), -1.0..2.0),
        ) {
            let turning = |points: &Vec<[f64; 3]>| Obstacle {
                orientation,
                angular_velocity: spin.into(),
                motion: motion.clone(),
                ..cloud(points.clone(), 0.05)
            };
            let others = if crowd { LEAST } else { 1 };
            let world = |points| {
                let far = |k: usize| fixed(Shape::Sphere { radius: 0.1 }, [4.0 + k as f64, 0.0, 0.0]);
                World::new((0..others).map(far).chain([turning(points)]).collect())
            };
            let mut swapped = world(&old);
            swapped.update(t);
            let mut points = Points::new(new.clone(), orientation);
            prop_assert!(swapped.swap_points(others, &mut points));
            prop_assert!(!swapped.swap_points(0, &mut points), "a sphere has no points");
            prop_assert_eq!(&points.given, &old);
            let mut made = world(&new);
            prop_assert_eq!(swapped.obstacle(others), made.obstacle(others));
            prop_assert_eq!(swapped.barrier_count(), made.barrier_count());
            for t in [t, t + 0.3] {
                swapped.update(t);
                made.update(t);
                prop_assert_eq!(told(&mut swapped, &[link], reach, 0.1), told(&mut made, &[link], reach, 0.1));
            }
        }

        /// A ray ends at the first ball.
        #[test]
        fn a_ray_ends_at_the_first_ball(
            points in any_points(), origin in three(3.0), along in direction(), range in 0.1..8.0,
        ) {
            let found = World::new(vec![cloud(points.clone(), 0.2)]).cast(origin, along, range);
            let balls = points.iter().map(|point| fixed(Shape::Sphere { radius: 0.2 }, *point));
            let expected = World::new(balls.collect()).cast(origin, along, range);
            prop_assert_eq!(found.is_some(), expected.is_some());
            prop_assert!((found.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 1e-13);
        }

        #[test]
        fn the_extent_holds_the_balls(points in any_points(), turn in any_orientation()) {
            prop_assume!(!points.is_empty());
            let shape = Shape::Points { points: points.clone(), radius: 0.3 };
            let solid = Volume::new(&Obstacle { orientation: turn, ..fixed(shape, [0.0; 3]) });
            let ([low, high], turn) = (solid.extent(), UnitQuaternion::new(turn).unwrap());
            for point in points.iter().map(|point| turn.rotate(&Vector::from(*point))) {
                let [rear, front] = [-0.3, 0.3].map(|radius| point.add_scalar(radius));
                prop_assert!(low.inf(&rear) == low && high.sup(&front) == high);
                prop_assert!(point.norm() + 0.3 <= solid.reach());
            }
        }
    }

    /// From cell to cell of a cube it goes through one face: along the curve, neighbours are neighbours.
    #[test]
    fn the_curve_leads_from_neighbour_to_neighbour() {
        let (low, high) = (Vec3::zeros(), Vec3::repeat(1023.0));
        let side = 0..16u32;
        let cells =
            side.clone().flat_map(|i| (0..16).flat_map(move |j| (0..16).map(move |k| [i, j, k])));
        let mut along: Vec<_> = cells
            .map(|cell| {
                let place =
                    along_the_curve(&Vec3::from(cell.map(|x| f64::from(x) + 0.5)), &low, &high);
                (place, cell)
            })
            .collect();
        along.sort_unstable();
        assert_eq!(along.last().unwrap().0, 16 * 16 * 16 - 1);
        for pair in along.windows(2) {
            let ([(a, from), (b, to)], mut steps) = ([pair[0], pair[1]], 0);
            (0..3).for_each(|k| steps += from[k].abs_diff(to[k]));
            assert_eq!((b - a, steps), (1, 1), "{from:?} to {to:?}");
        }
    }

    /// What a depth camera sees where there is nothing: infinitely far, and nothing undefined but for that.
    #[test]
    fn an_empty_cloud_is_nowhere() {
        let mut world = World::new(vec![cloud(vec![], 0.1)]);
        let link = capsule([0.0; 3], [1.0, 0.0, 0.0], 0.1);
        let body = Body::new(0, link);
        let found = world.contact(0, &body, 0);
        assert!(found.distance.is_infinite() && found.distance > 0.0);
        assert!(!format!("{found:?}").contains("NaN"));
        assert!((found.normal.norm() - 1.0).abs() < 1e-14);
        let (mut count, mut least) = (0, 0.0);
        world.for_each_contact([body], f64::INFINITY, |_, d| least = d, |_| count += 1);
        assert!(count == 0 && least.is_infinite() && least > 0.0);
        assert_eq!(world.cast(Vec3::zeros(), Vec3::x(), 9.0), None);
        assert_eq!((world.contact_count(), world.barrier_count()), (0, 0));
    }

    #[test]
    fn unusable_values_do_not_panic() {
        for value in [0.0, 1e-300, 1e150, f64::MAX, f64::INFINITY, f64::NAN] {
            for count in [1, 9, 300] {
                let points: Vec<_> =
                    (0..count).map(|k| [value * f64::from(k), value, 0.1]).collect();
                let mut world = World::new(vec![cloud(points.clone(), value)]);
                for link in
                    [capsule([0.0; 3], [1.0; 3], 0.1), capsule([value; 3], [0.0, 1.0, value], 0.1)]
                {
                    told(&mut world, &[link], f64::INFINITY, 0.0);
                    world.cast(link.start, link.direction, value);
                }
            }
        }
    }
}
