//! Which of many boxes are near a link: parry's hierarchy of bounding boxes.

use super::axis::Probe;
use super::{Vec2, to_glam};
use crate::math::Vector;
use crate::world::crowd::MARGIN;
use crate::world::{HORIZON, Hierarchy};
use parry2d_f64::bounding_volume::Aabb;
use parry2d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhNode, BvhWorkspace, TraversalAction};
use std::fmt;

/// Where a link is, and how far around it rounding may reach.
pub struct Region {
    low: Vec2,
    high: Vec2,
    start: Vec2,
    left: Vec2,
    /// Its radius and the margin \[m\].
    radius: f64,
}

impl Region {
    /// None for a link that is nowhere, or beyond the horizon.
    fn of_link(Probe { axis, radius }: &Probe) -> Option<Self> {
        let (start, end) = (axis.start, axis.end());
        let size = 1.0 + start.abs().element_sum() + axis.length;
        // False for NaN.
        let inside = size <= HORIZON && end.is_finite() && *radius <= HORIZON;
        inside.then(|| Self {
            low: start.min(end),
            high: start.max(end),
            start,
            left: axis.left(),
            radius: radius + MARGIN * size,
        })
    }

    /// Whether every obstacle in the box of `node` is further away than `distance` \[m\].
    #[inline]
    fn is_beyond(&self, node: &BvhNode, distance: f64) -> bool {
        // Where the axis and the box overlap, the bodies may do so by any depth.
        let distance = (distance + self.radius).max(0.0);
        let (low, high) = (node.mins(), node.maxs());
        let gap = (low - self.high).max(self.low - high).max(Vec2::ZERO);
        if gap.length_squared() > distance * distance {
            return true;
        }
        // An oblique axis leaves much of its own box empty. (Measured from corner to corner: the
        // middle of a box with one far side would have lost its last digits.)
        let (a, b) = (self.left * (low - self.start), self.left * (high - self.start));
        let (lowest, highest) = (a.min(b).element_sum(), a.max(b).element_sum());
        lowest > distance || -highest > distance
    }
}

/// Boxes with their hierarchy.
#[derive(Clone)]
pub struct Boxes {
    hierarchy: Bvh,
    workspace: BvhWorkspace,
}

impl Hierarchy<Probe, 2> for Boxes {
    type Region = Region;

    fn new(boxes: &[[Vector<2>; 2]]) -> Self {
        let boxes: Vec<Aabb> = boxes.iter().copied().map(aabb).collect();
        let hierarchy = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        Self { hierarchy, workspace: BvhWorkspace::default() }
    }

    fn renew(&mut self, boxes: impl Iterator<Item = [Vector<2>; 2]>, regroup: bool) {
        for (leaf, renewed) in (0..).zip(boxes) {
            self.hierarchy.update_partially_if_present(aabb(renewed), leaf, 0.0);
        }
        if regroup {
            self.hierarchy.rebuild(&mut self.workspace, BvhBuildStrategy::Binned);
        }
        self.hierarchy.refit(&mut self.workspace);
    }

    fn region(link: &Probe) -> Option<Region> {
        Region::of_link(link)
    }

    #[inline]
    fn for_each_within(
        &self,
        region: &Region,
        mut limit: f64,
        mut measure: impl FnMut(usize) -> f64,
    ) -> usize {
        let mut count = 0;
        self.hierarchy.traverse(|node| {
            if region.is_beyond(node, limit) {
                return TraversalAction::Prune;
            }
            if let Some(leaf) = node.leaf_data() {
                limit = measure(leaf as usize);
                count += 1;
            }
            TraversalAction::Continue
        });
        count
    }
}

fn aabb([low, high]: [Vector<2>; 2]) -> Aabb {
    Aabb::new(to_glam(low), to_glam(high))
}

impl fmt::Debug for Boxes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Boxes").finish_non_exhaustive()
    }
}
