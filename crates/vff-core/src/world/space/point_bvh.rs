//! Boxes around runs of points that lie side by side, in a tree of eight to a node: which runs are near an axis.
//!
//! Nothing is grouped here: the points come in an order that leads from neighbour to neighbour, so that what follows one
//! another is what belongs together. The tree of 50 000 points is made in a fraction of the time that it takes to group
//! them, and asks eight boxes at once, in single precision: boxes are rounded outward, and what single precision may lose
//! is taken off every gap.
//!
//! Where every point goes on at a velocity of its own, each box has one around these velocities: at a time e after the
//! tree was made, what is in [l, h] at rates in [l', h'] is in [l + l'e, h + h'e] (T180).

use crate::geometry::{Probe, extent};
use crate::interrupt;
use crate::math::Vector;
use crate::world::broad_phase::MARGIN;
use std::ops::Range;
use wide::f32x8;

/// Points in a run, and boxes in a node.
const RUN: usize = 8;
/// As far as single precision goes: the square of a distance may not overflow \[m\].
const FARTHEST: f64 = 1e12;
/// Where the boxes are that a node has too few of \[m\].
const NOWHERE: f32 = 1e15;
/// What a gap may be wrong by, as a share of the numbers that it is made of: 32 units in the last place.
const ROUNDING: f64 = 32.0 * f32::EPSILON as f64;

/// Eight boxes: the lower and the upper corners, coordinate by coordinate \[m\].
#[derive(Clone)]
struct Node {
    low: [f32x8; 3],
    high: [f32x8; 3],
}

/// The tree. Level by level from the root down, each the boxes of the next, the last those of the runs.
#[derive(Clone)]
pub(super) struct PointBvh {
    /// How many points there are.
    count: usize,
    /// Of every level where its nodes begin, and how many boxes it has.
    levels: Vec<(usize, usize)>,
    nodes: Vec<Node>,
    /// The same boxes around the velocities \[m/s\]; none of points that rest.
    rates: Vec<Node>,
    /// How far the farthest coordinate is \[m\]; ∞ if some are not numbers.
    size: f64,
    /// The same of the velocities \[m/s\].
    speed: f64,
}

/// Where an axis is, in single precision.
pub(super) struct Sight {
    start: [f32; 3],
    direction: [f32; 3],
    length: f32,
    /// The time since the tree was made \[s\].
    elapsed: f32,
    /// What the gap to a box that is as far away as the axis is long may be wrong by \[m\].
    rounding: f32,
}

impl PointBvh {
    /// Of points in this order, and of their velocities where they move.
    pub(super) fn new(points: &[Vector<3>], velocities: &[Vector<3>]) -> Self {
        let (levels, nodes) = tree(points);
        let (_, rates) = if velocities.is_empty() { (vec![], vec![]) } else { tree(velocities) };
        let (size, speed) = (farthest(points), farthest(velocities));
        Self { count: points.len(), levels, nodes, rates, size, speed }
    }

    /// Where the axis of a link is, from an obstacle at a position, so long after the tree was made \[s\]; none if that is
    /// nowhere, or farther away than single precision goes.
    #[expect(clippy::cast_possible_truncation, reason = "allowed for by the margin")]
    pub(super) fn sight(&self, link: &Probe, position: &Vector<3>, elapsed: f64) -> Option<Sight> {
        let sum = |v: &Vector<3>| v.abs().sum();
        let start = link.start - position;
        let reach =
            if self.rates.is_empty() { self.size } else { self.size + self.speed * elapsed.abs() };
        let size = 1.0 + sum(&start) + link.length + reach;
        let far = sum(position) + sum(&link.start) + reach;
        // False for what is not a number.
        let near = size <= FARTHEST && far <= FARTHEST && sum(&link.direction) <= 2.0;
        near.then(|| Sight {
            start: [start.x, start.y, start.z].map(|x| x as f32),
            direction: [link.direction.x, link.direction.y, link.direction.z].map(|x| x as f32),
            length: link.length as f32,
            elapsed: elapsed as f32,
            rounding: (ROUNDING * size + MARGIN * far) as f32,
        })
    }

    /// Calls `measure` with runs of points, nearest first as a rule, until no other can hold a point within `limit` \[m\] of
    /// the axis. It returns what the limit is from then on, if that is less.
    #[inline(always)]
    pub(super) fn approach(
        &self,
        sight: &Sight,
        limit: f64,
        mut measure: impl FnMut(Range<usize>) -> f64,
    ) {
        if self.count > 0 {
            self.descend(sight, &mut { limit }, &mut measure, 0, 0);
        }
    }

    /// Within a node of a level.
    fn descend(
        &self,
        sight: &Sight,
        limit: &mut f64,
        measure: &mut impl FnMut(Range<usize>) -> f64,
        level: usize,
        node: usize,
    ) {
        interrupt::checkpoint(64);
        let (begin, count) = self.levels[level];
        let gaps = match self.rates.get(begin + node) {
            None => self.nodes[begin + node].gaps(sight),
            Some(rates) => self.nodes[begin + node].after(sight.elapsed, rates).gaps(sight),
        };
        let first = RUN * node;
        let exist = (1u32 << (count - first).min(RUN)) - 1;
        let mut left = exist & within(gaps, *limit);
        let gaps = gaps.to_array();
        while left != 0 {
            let mut nearest = left.trailing_zeros() as usize;
            let mut others = left & (left - 1);
            while others != 0 {
                let other = others.trailing_zeros() as usize;
                if gaps[other] < gaps[nearest] {
                    nearest = other;
                }
                others &= others - 1;
            }
            left &= !(1 << nearest);
            if f64::from(gaps[nearest]) > *limit {
                return;
            }
            let child = first + nearest;
            if level + 1 == self.levels.len() {
                interrupt::checkpoint(64);
                let start = RUN * child;
                *limit = limit.min(measure(start..(start + RUN).min(self.count)));
            } else {
                self.descend(sight, limit, measure, level + 1, child);
            }
        }
    }
}

/// Which of eight gaps are not more than `limit`, a bit each.
#[expect(clippy::cast_possible_truncation, reason = "rounded up")]
fn within(gaps: f32x8, limit: f64) -> u32 {
    gaps.simd_le(f32x8::splat((limit as f32).next_up())).to_bitmask()
}

impl Node {
    /// Of up to eight boxes.
    fn new(boxes: &[[Vector<3>; 2]]) -> Self {
        let corner = |which: usize, k: usize, outward: fn(f64) -> f32| {
            let of = |j: usize| boxes.get(j).map_or(NOWHERE, |each| outward(each[which][k]));
            f32x8::new(std::array::from_fn(of))
        };
        Self {
            low: std::array::from_fn(|k| corner(0, k, below)),
            high: std::array::from_fn(|k| corner(1, k, above)),
        }
    }

    /// Around what was in these boxes and has gone on for so long \[s\] at velocities in the boxes of `rates`.
    #[inline]
    fn after(&self, elapsed: f32, rates: &Self) -> Self {
        let (least, most) =
            if elapsed < 0.0 { (&rates.high, &rates.low) } else { (&rates.low, &rates.high) };
        let elapsed = f32x8::splat(elapsed);
        Self {
            low: std::array::from_fn(|k| self.low[k] + least[k] * elapsed),
            high: std::array::from_fn(|k| self.high[k] + most[k] * elapsed),
        }
    }

    /// What the boxes are away from the axis at least \[m\]: the distance from a point of the axis beside each, less what is
    /// gained at most along the axis, of which the distance is a convex function. Tight where a box is small.
    #[inline(always)]
    fn gaps(&self, sight: &Sight) -> f32x8 {
        let (start, along) = (sight.start.map(f32x8::splat), sight.direction.map(f32x8::splat));
        let length = f32x8::splat(sight.length);
        let [x, y, z] = std::array::from_fn(|k| {
            along[k] * (f32x8::splat(0.5) * (self.low[k] + self.high[k]) - start[k])
        });
        let before = (x + y + z).fast_max(f32x8::ZERO).fast_min(length);
        let away: [f32x8; 3] = std::array::from_fn(|k| {
            let beside = start[k] + along[k] * before;
            beside - beside.fast_max(self.low[k]).fast_min(self.high[k])
        });
        let square = away[0] * away[0] + away[1] * away[1] + away[2] * away[2];
        let distance = square.sqrt();
        let inverse = f32x8::ONE / distance.fast_max(f32x8::splat(f32::MIN_POSITIVE));
        let slope = (along[0] * away[0] + along[1] * away[1] + along[2] * away[2]) * inverse;
        let gained = (slope * before).fast_max(slope * (before - length));
        // Near a box the direction away from it is known less well.
        let rounding = f32x8::splat(sight.rounding);
        distance - gained - rounding - rounding * length * inverse
    }
}

/// Boxes around runs of these vectors, level by level from the root down, and of every level where its nodes begin, and how
/// many boxes it has.
fn tree(vectors: &[Vector<3>]) -> (Vec<(usize, usize)>, Vec<Node>) {
    let mut boxes: Vec<[Vector<3>; 2]> = vectors.chunks(RUN).map(extent).collect();
    let mut below = vec![];
    let mut counts = vec![];
    loop {
        counts.push(boxes.len());
        let nodes: Vec<Node> = boxes.chunks(RUN).map(Node::new).collect();
        let last = nodes.len() <= 1;
        below.push(nodes);
        if last {
            break;
        }
        boxes = boxes.chunks(RUN).map(around_all).collect();
    }
    let mut levels = Vec::with_capacity(below.len());
    let mut nodes = vec![];
    for (level, count) in below.into_iter().zip(counts).rev() {
        levels.push((nodes.len(), count));
        nodes.extend(level);
    }
    (levels, nodes)
}

/// How far the farthest coordinate is; ∞ if some are not numbers.
pub(super) fn farthest(vectors: &[Vector<3>]) -> f64 {
    let coordinates = vectors.iter().flat_map(|vector| vector.iter());
    coordinates.fold(0.0, |size: f64, x| {
        // False for what is not a number.
        if x.abs() <= size {
            size
        } else if x.is_nan() {
            f64::INFINITY
        } else {
            x.abs()
        }
    })
}

fn around_all(boxes: &[[Vector<3>; 2]]) -> [Vector<3>; 2] {
    let both = |[a, b]: [Vector<3>; 2], [c, d]: &[Vector<3>; 2]| [a.inf(c), b.sup(d)];
    boxes[1..].iter().fold(boxes[0], both)
}

/// The next number of single precision that is not more.
#[expect(clippy::cast_possible_truncation, reason = "rounded")]
fn below(x: f64) -> f32 {
    let rounded = x as f32;
    if f64::from(rounded) > x { rounded.next_down() } else { rounded }
}

/// The next number of single precision that is not less.
fn above(x: f64) -> f32 {
    -below(-x)
}
