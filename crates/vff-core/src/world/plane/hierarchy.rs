//! Which of many boxes are near a link: parry's hierarchy of bounding boxes.

use super::axis::Probe;
use super::{Vec2, to_glam};
use crate::world::HORIZON;
use crate::world::broad_phase::MARGIN;

crate::world::hierarchy::boxes!(parry2d_f64, 2, Probe, Region, to_glam);

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
