//! A cloud of points: balls of one radius that move and turn as one obstacle.
//!
//! Every ball is to a link what a sphere at that place would be, to the last bit; the link has a contact with each. Which
//! of them are near is found from boxes around few points each that lie side by side. The boxes are those of the cloud at
//! rest, where it is described: as with every geometry it is the link that is moved and turned for the query, so that a cloud
//! that moves and turns costs no more than one that stands. Points may go on at velocities of their own within that frame
//! (T180): their boxes grow by what these differ.

use super::sphere::cast_at_ball;
use crate::geometry::axis::{Nearest, Probe, perpendicular, seen_from};
use crate::geometry::point::{distance_to_point, square_to_point, to_point};
use crate::geometry::{MAX_POINTS, extent};
use crate::interrupt;
use crate::math::{UnitQuaternion, Vector};
use crate::world::space::contact::{axis_of, contact_of};
use crate::world::space::needed_points::{MAX_NEEDED, NeededPoints};
use crate::world::space::point_bvh::{PointBvh, Sight, farthest};
use crate::world::{Ahead, Contact, Feature, MotionState, Pair};
use std::fmt;
use std::ops::Range;

/// So many near points are sorted; more are marked.
const ROOM: usize = 256;

/// The points \[m\], relative to the obstacle's position and turned by its orientation, in boxes.
#[derive(Clone)]
pub(in super::super) struct Cloud {
    /// Those that lie side by side one after the other.
    points: Vec<Vector<3>>,
    /// At which velocities they go on in that frame \[m/s\], place by place; none where all rest.
    velocities: Vec<Vector<3>>,
    /// Where each stood in the list that was given.
    numbers: Vec<u32>,
    /// The place of each, as that list has them.
    places: Vec<u32>,
    runs: PointBvh,
    /// Opposite corners of a box around all of them \[m\].
    extent: [Vector<3>; 2],
    /// How far the farthest is from the position \[m\].
    reach: f64,
    /// A speed that none exceeds in that frame \[m/s\].
    speed: f64,
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
    /// For how long the points have gone on \[s\].
    elapsed: f64,
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
    /// Of these points, turned, that go on at these velocities: one each, or none where all rest. Undefined numbers do not
    /// panic.
    #[expect(clippy::cast_possible_truncation, reason = "fewer than 2³² points")]
    pub(in super::super) fn new(
        points: &[[f64; 3]],
        velocities: &[[f64; 3]],
        turn: &UnitQuaternion,
    ) -> Self {
        interrupt::checkpoint(64 * points.len());
        let all_turned = |vectors: &[[f64; 3]]| -> Vec<Vector<3>> {
            vectors.iter().map(|vector| turn.rotate(&Vector::from(*vector))).collect()
        };
        let (turned, rates) = (all_turned(points), all_turned(velocities));
        let extent @ [low, high] = extent(&turned);
        // The place on the curve above the number.
        let key = |(point, number)| u64::from(along_the_curve(point, &low, &high)) << 32 | number;
        let mut order: Vec<u64> = turned.iter().zip(0u64..).map(key).collect();
        order.sort_unstable();
        let numbers: Vec<u32> = order.iter().map(|key| *key as u32).collect();
        let mut places = vec![0; numbers.len()];
        (0..).zip(&numbers).for_each(|(place, number)| places[*number as usize] = place);
        let points: Vec<Vector<3>> = numbers.iter().map(|i| turned[*i as usize]).collect();
        let is_moving = rates.len() == points.len() && farthest(&rates) > 0.0;
        let velocities: Vec<Vector<3>> =
            if is_moving { numbers.iter().map(|i| rates[*i as usize]).collect() } else { vec![] };
        let longest = |vectors: &[Vector<3>]| vectors.iter().map(Vector::norm).fold(0.0, f64::max);
        Self {
            runs: PointBvh::new(&points, &velocities),
            reach: longest(&points),
            speed: longest(&velocities),
            velocities,
            extent,
            points,
            numbers,
            places,
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

    /// A speed that no point exceeds, as seen from the cloud \[m/s\]: 0 where all rest.
    pub(in super::super) fn speed(&self) -> f64 {
        self.speed
    }

    /// Where the point at a place is after it has gone on for so long \[m\].
    #[inline(always)]
    fn point(&self, place: usize, elapsed: f64) -> Vector<3> {
        match self.velocities.get(place) {
            None => self.points[place],
            Some(velocity) => self.points[place] + velocity * elapsed,
        }
    }

    /// How far a ray goes until it meets the first of the balls \[m\]; 0 inside.
    pub(in super::super) fn cast(
        &self,
        origin: &Vector<3>,
        direction: &Vector<3>,
        radius: f64,
        range: f64,
        elapsed: f64,
    ) -> Option<f64> {
        let mut first = None;
        let ray = Probe { start: *origin, direction: *direction, length: range, radius: 0.0 };
        self.for_each_beside(&ray, radius, elapsed, |point| {
            let met = cast_at_ball(&(origin - point), direction, radius);
            first = [first, met].into_iter().flatten().reduce(f64::min);
        });
        first
    }

    fn query<'a>(&self, link: &'a Probe, position: &'a Vector<3>, elapsed: f64) -> Query<'a> {
        Query { link, position, elapsed, sight: self.runs.sight(link, position, elapsed) }
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
                let point = self.point(place, query.elapsed);
                let (square, number) = (query.square(&point), self.numbers[place]);
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
    pub(in super::super) fn distance(
        &self,
        link: &Probe,
        position: &Vector<3>,
        elapsed: f64,
        limit: f64,
    ) -> f64 {
        let query = self.query(link, position, elapsed);
        self.nearest(&query, limit)
            .map_or(f64::INFINITY, |place| query.distance(&self.point(place, elapsed)))
    }

    /// The contact with the nearest ball of this `radius` \[m\]. Of an empty cloud it is infinitely far.
    pub(in super::super) fn contact(
        &self,
        pair: Pair,
        link: &Probe,
        radius: f64,
        state: &MotionState<3>,
    ) -> Contact<3> {
        match self.nearest(&self.query(link, &state.position, state.elapsed), f64::INFINITY) {
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
        let mut centre =
            MotionState { position: state.position + self.point(place, state.elapsed), ..*state };
        if let Some(velocity) = self.velocities.get(place) {
            centre.velocity += velocity;
        }
        let nearest = to_point(&seen_from(link, &centre.position), &Vector::zeros());
        contact_of(pair, &nearest, &axis_of(link), [radius, link.radius], &centre)
    }

    /// The contacts with all balls nearer than `reach` \[m\], in the order in which their points were given. Compiled once,
    /// whoever visits them: there are many of these.
    pub(in super::super) fn for_each_contact(
        &self,
        pair: Pair,
        link: &Probe,
        radius: f64,
        state: &MotionState<3>,
        reach: f64,
        visit: &mut dyn FnMut(&Contact<3>),
    ) {
        let query = self.query(link, &state.position, state.elapsed);
        let mut room = [(0, 0); ROOM];
        let Some(found) = self.few_within(&query, radius, reach, &mut room) else {
            return self.for_each_of_many(&query, radius, reach, |place| {
                visit(&self.touch(place, pair, link, radius, state));
            });
        };
        interrupt::checkpoint(64 * found.len());
        for (_, place) in found {
            visit(&self.touch(*place as usize, pair, link, radius, state));
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
        ahead: &Ahead<'_, 3>,
        visit: &mut dyn FnMut(&Contact<3>),
    ) {
        if self.points.len() <= MAX_NEEDED {
            return self.for_each_contact(pair, link, radius, state, reach, visit);
        }
        let query = self.query(link, &state.position, state.elapsed);
        let mut needed = NeededPoints::new(ahead, radius + link.radius, reach, self.speed);
        let limit = needed.limit();
        self.approach(&query, limit, |places| {
            interrupt::checkpoint(16 * places.len());
            for place in places {
                let axis = seen_from(link, &(state.position + self.point(place, state.elapsed)));
                let velocity = self.velocities.get(place);
                needed.add(&axis, velocity, self.numbers[place], place as u32);
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

    /// Numbers and places of the points within reach, in the order of their numbers; none if there are more than fit.
    #[expect(clippy::cast_possible_truncation, reason = "fewer than 2³² points")]
    fn few_within<'r>(
        &self,
        query: &Query<'_>,
        radius: f64,
        reach: f64,
        room: &'r mut [(u32, u32); ROOM],
    ) -> Option<&'r [(u32, u32)]> {
        let mut count = 0;
        let limit = reach + radius + query.link.radius;
        self.approach(query, limit, |places| {
            for place in places {
                if self.is_within(query, place, radius, reach) {
                    if let Some(found) = room.get_mut(count) {
                        *found = (self.numbers[place], place as u32);
                    }
                    count += 1;
                }
            }
            // The rest is of no use.
            if count > ROOM { f64::NEG_INFINITY } else { limit }
        });
        let found = room.get_mut(..count)?;
        found.sort_unstable();
        Some(found)
    }

    /// Calls `visit` with the places of all points within reach, in the order of their numbers: the way through the tree marks
    /// them, and the marks are gone through. Nothing may be allocated here, and what it costs grows with how many there are.
    #[inline(never)]
    fn for_each_of_many(
        &self,
        query: &Query<'_>,
        radius: f64,
        reach: f64,
        mut visit: impl FnMut(usize),
    ) {
        const BITS: usize = u64::BITS as usize;
        const MARKS: usize = MAX_POINTS.div_ceil(BITS);
        let limit = reach + radius + query.link.radius;
        // Once: more points than that are refused.
        for first in (0..self.points.len()).step_by(BITS * MARKS) {
            let mut marks = [0u64; MARKS];
            self.approach(query, limit, |places| {
                for place in places {
                    let bit = (self.numbers[place] as usize).wrapping_sub(first);
                    if let Some(mark) = marks.get_mut(bit / BITS)
                        && self.is_within(query, place, radius, reach)
                    {
                        *mark |= 1 << (bit % BITS);
                    }
                }
                limit
            });
            for (k, mark) in marks.iter().enumerate() {
                let mut left = *mark;
                interrupt::checkpoint(64 * left.count_ones() as usize);
                while left != 0 {
                    visit(self.places[first + BITS * k + left.trailing_zeros() as usize] as usize);
                    left &= left - 1;
                }
            }
        }
    }

    /// Whether the ball at a place is nearer than `reach` \[m\].
    #[inline(always)]
    fn is_within(&self, query: &Query<'_>, place: usize, radius: f64, reach: f64) -> bool {
        let point = self.point(place, query.elapsed);
        query.distance(&point) - radius - query.link.radius < reach
    }

    /// Calls `visit` with the points within `radius` \[m\] of a segment, and others.
    fn for_each_beside(
        &self,
        segment: &Probe,
        radius: f64,
        elapsed: f64,
        mut visit: impl FnMut(&Vector<3>),
    ) {
        self.approach(&self.query(segment, &Vector::zeros(), elapsed), radius, |places| {
            places.for_each(|place| visit(&self.point(place, elapsed)));
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
pub(in super::super) mod tests;
