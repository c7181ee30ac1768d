//! The axis of a link, and where it is nearest to something.

use super::{Vec2, to_glam};
use crate::math::Capsule;

/// A link, made ready for the questions of many obstacles.
#[derive(Debug, Clone, Copy)]
pub struct Probe {
    pub(super) axis: Axis,
    /// Radius of the link \[m\].
    pub(super) radius: f64,
}

/// The axis of a link.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    pub(super) start: Vec2,
    /// Unit vector from start to end.
    pub(super) forward: Vec2,
    pub(super) length: f64,
}

/// The nearest points of an axis and a core. The one on the core is
/// `point − distance · normal`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    pub(super) distance: f64,
    pub(super) normal: Vec2,
    pub(super) point: Vec2,
    pub(super) meets: Meets,
}

/// The kinds of [`Feature`](crate::world::Feature).
#[derive(Debug, Clone, Copy)]
pub(super) enum Meets {
    Side,
    End,
    Face,
}

impl Axis {
    #[inline]
    pub(super) fn new(capsule: &Capsule<2>) -> Self {
        Self {
            start: to_glam(capsule.start),
            forward: to_glam(capsule.direction),
            length: capsule.length,
        }
    }

    #[inline]
    pub(super) fn seen_from(&self, position: Vec2) -> Self {
        Self { start: self.start - position, ..*self }
    }

    #[inline]
    pub(super) fn end(&self) -> Vec2 {
        self.start + self.forward * self.length
    }

    /// Left normal of the axis.
    #[inline]
    pub(super) fn left(&self) -> Vec2 {
        self.forward.perp()
    }

    /// The foot `point` of the perpendicular lies between the ends: the normal of the axis is known
    /// exactly, whereas the difference of the two points would lose its direction close to the core.
    /// `offset` leads from the core to the start.
    #[inline]
    pub(super) fn beside(self, offset: Vec2, point: Vec2) -> Nearest {
        let left = self.left();
        let height = left.dot(offset);
        let normal = if height >= 0.0 { left } else { -left };
        Nearest { distance: height.abs(), normal, point, meets: Meets::Side }
    }
}
