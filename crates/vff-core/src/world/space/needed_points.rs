//! Which points of a cloud a program that keeps distances needs beside a link: those that imply the others (T157).

use crate::geometry::axis::{Probe, perpendicular};
use crate::geometry::point::foot;
use crate::math::{TOUCHING, Vector};
use crate::world::Ahead;

/// The most that are needed of one link.
pub(super) const MAX_NEEDED: usize = 64;

/// By how much what is left out may be violated \[m\], and as a share of what is left of the distance.
const ALLOWED: f64 = 5e-4;
const ALLOWED_SHARE: f64 = 0.1;

/// Passes that leave out: one as points are found, one when all are known.
const PASSES: f64 = 2.0;

/// Doublings of what is allowed after which everything is implied by anything.
const DOUBLINGS: usize = 64;

/// A point, as the program sees it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Needed {
    /// d + 2ḋ/k above what is kept \[m\].
    height: f64,
    /// How that changes with where the ends of the axis are.
    lever: [Vector<3>; 2],
    /// Where it stands in the list that was given, and in the cloud.
    pub(super) number: u32,
    pub(super) place: u32,
}

impl Needed {
    /// Whether `other` implies this one, where so much more is allowed \[m\].
    #[inline]
    fn is_implied_by(&self, other: &Self, ahead: &Ahead<'_, 3>, allowed: f64) -> bool {
        let Self { height, lever: [a, b], .. } = self;
        let room = height - other.height + (allowed + ALLOWED_SHARE * height.max(0.0)) / PASSES;
        // The sum of the lengths of four parts, which is 2 in all.
        room >= 2.0 * ahead.implied
            || room >= 0.0
                && room
                    >= ahead.implied * ((a - other.lever[0]).norm() + (b - other.lever[1]).norm())
    }
}

/// Those that are needed so far.
pub(super) struct NeededPoints<'a> {
    ahead: &'a Ahead<'a, 3>,
    /// Of the link and the balls together \[m\].
    radii: f64,
    /// What is farther is not needed at all \[m\].
    reach: f64,
    /// By how much a point goes on by itself at most until d + 2ḋ/k \[m\].
    onward: f64,
    found: [Needed; MAX_NEEDED],
    count: usize,
    least: f64,
    allowed: f64,
}

impl<'a> NeededPoints<'a> {
    /// None as yet, of those nearer than `reach` \[m\] that go on at no more than this speed \[m/s\].
    pub(super) fn new(ahead: &'a Ahead<'a, 3>, radii: f64, reach: f64, speed: f64) -> Self {
        Self {
            ahead,
            radii,
            reach,
            onward: ahead.horizon * speed,
            found: [Needed::default(); MAX_NEEDED],
            count: 0,
            least: ahead.unharmed,
            allowed: ALLOWED,
        }
    }

    /// No point that is farther than this from the axis is needed \[m\]: the height of a point at d is not less than
    /// d − |2u/k|, and what is higher than the lowest by what the levers can make is implied.
    #[inline]
    pub(super) fn limit(&self) -> f64 {
        let Self { ahead, least, .. } = self;
        let highest = (least + 2.0 * ahead.implied).min(ahead.unharmed);
        self.reach.min(highest + ahead.kept + ahead.farthest() + self.onward) + self.radii
    }

    /// Takes in the point at the origin, as `axis` is seen from there, that goes on at a velocity \[m/s\] or rests.
    #[inline]
    pub(super) fn add(
        &mut self,
        axis: &Probe,
        velocity: Option<&Vector<3>>,
        number: u32,
        place: u32,
    ) {
        let Self { ahead, radii, .. } = self;
        let (along, offset) = foot(axis, &Vector::zeros());
        let gap = offset.norm();
        let normal = if gap > TOUCHING { offset / gap } else { perpendicular(&axis.direction) };
        let share = if axis.length > 0.0 { along / axis.length } else { 0.0 };
        let lever = [normal * (1.0 - share), normal * share];
        let onward = lever[0].dot(&ahead.shift[0]) + lever[1].dot(&ahead.shift[1]);
        let gone = velocity.map_or(0.0, |velocity| ahead.horizon * normal.dot(velocity));
        let height = gap - *radii + (onward - gone) - ahead.kept;
        // False for what is not a number.
        let matters = gap - *radii < self.reach && height < ahead.unharmed;
        let point = Needed { height, lever, number, place };
        if !matters || self.is_implied(&point, self.count) {
            return;
        }
        if self.count == MAX_NEEDED {
            self.make_room();
        }
        self.found[self.count] = point;
        self.count += 1;
        self.least = self.least.min(height);
    }

    /// Whether one of the first so many implies this one. Counts those that do so only because more is allowed.
    fn is_implied(&self, point: &Needed, count: usize) -> bool {
        let implied = |allowed: f64| {
            let implies = |other: &Needed| point.is_implied_by(other, self.ahead, allowed);
            self.found[..count].iter().any(implies)
        };
        let is_implied = implied(self.allowed);
        if is_implied && self.allowed > ALLOWED && !implied(ALLOWED) {
            self.ahead.coarsened.update(|count| count + 1);
        }
        is_implied
    }

    /// Leaves out those that others imply.
    fn thin(&mut self) {
        let order =
            |a: &Needed, b: &Needed| a.height.total_cmp(&b.height).then(a.number.cmp(&b.number));
        self.found[..self.count].sort_unstable_by(order);
        let mut kept = 0;
        for next in 0..self.count {
            if !self.is_implied(&self.found[next], kept) {
                self.found[kept] = self.found[next];
                kept += 1;
            }
        }
        self.count = kept;
    }

    /// Allows more until some are implied.
    #[cold]
    fn make_room(&mut self) {
        for _ in 0..DOUBLINGS {
            self.thin();
            if self.count <= MAX_NEEDED / 2 {
                return;
            }
            self.allowed *= 2.0;
        }
        self.count = self.count.min(MAX_NEEDED / 2); // where numbers are beyond all bounds
    }

    /// Those that are needed, in the order in which they were given.
    pub(super) fn finish(&mut self) -> &[Needed] {
        self.thin();
        let found = &mut self.found[..self.count];
        found.sort_unstable_by_key(|point| point.number);
        found
    }
}
