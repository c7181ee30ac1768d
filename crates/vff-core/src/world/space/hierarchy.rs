//! Which of many boxes are near a link: parry's hierarchy of bounding boxes.

use super::axis::Probe;
use crate::math::Vector;
use crate::world::crowd::MARGIN;
use crate::world::HORIZON;
use parry3d_f64::math::Vector as Vec3;

crate::world::hierarchy::boxes!(parry3d_f64, 3, Probe, Region, to_glam);

/// Where a link is, and how far around it rounding may reach.
pub struct Region {
    low: Vec3,
    high: Vec3,
    start: Vec3,
    /// Unit vectors across the axis and each coordinate axis; 0 if these are parallel.
    across: [Vec3; 3],
    /// Its radius and the margin \[m\].
    radius: f64,
}

impl Region {
    /// None for a link that is nowhere, or beyond the horizon.
    fn of_link(link: &Probe) -> Option<Self> {
        let (start, end, direction) = (link.start, link.end(), to_glam(link.direction));
        let size = 1.0 + start.abs().sum() + link.length;
        // False for NaN.
        let finite = end.iter().all(|x| x.is_finite());
        let inside = size <= HORIZON && finite && link.radius <= HORIZON;
        inside.then(|| Self {
            low: to_glam(start.inf(&end)),
            high: to_glam(start.sup(&end)),
            start: to_glam(start),
            across: [Vec3::X, Vec3::Y, Vec3::Z].map(|k| direction.cross(k).normalize_or_zero()),
            radius: link.radius + MARGIN * size,
        })
    }

    /// Whether every obstacle in the box of `node` is further away than `distance` \[m\].
    #[inline]
    fn is_beyond(&self, node: &BvhNode, distance: f64) -> bool {
        // Where the axis and the box overlap, the bodies may do so by any depth.
        let distance = (distance + self.radius).max(0.0);
        let (low, high) = (node.mins(), node.maxs());
        let gap = (low - self.high).max(self.low - high).max(Vec3::ZERO);
        if gap.length_squared() > distance * distance {
            return true;
        }
        // An oblique axis leaves much of its own box empty. (Measured from corner to corner: the
        // middle of a box with one far side would have lost its last digits.)
        let (low, high) = (low - self.start, high - self.start);
        self.across.iter().any(|across| {
            let (a, b) = (*across * low, *across * high);
            let (lowest, highest) = (a.min(b).element_sum(), a.max(b).element_sum());
            lowest > distance || -highest > distance
        })
    }
}

fn to_glam(v: Vector<3>) -> Vec3 {
    Vec3::new(v.x, v.y, v.z)
}
