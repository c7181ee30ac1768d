//! What is asked of an obstacle in space.
//!
//! Here is what becomes of a [`Shape`], which people describe: the [`Core`] that is asked. A file per shape has its answers.

mod capsule;
pub(super) mod cloud;
mod convex;
mod cuboid;
mod half_space;
mod sphere;

pub(super) use capsule::cast_at_capsule;
pub(super) use sphere::Point;

use crate::geometry::axis::{Nearest, Probe};
use crate::geometry::{Convex, Hull, HullContact, PlacedHull, Shape};
use crate::math::{Feature, UnitQuaternion, Vector};
use crate::world::Asked;
use cloud::Cloud;
use cuboid::Cuboid;
use half_space::HalfSpace;
use std::sync::Arc;

impl Shape {
    /// What remains when the radius is taken away, turned, and that radius \[m\].
    pub(super) fn core(&self, turn: &UnitQuaternion) -> (Core, f64) {
        match self {
            Self::Sphere { radius } => (Core::Point(Point(Vector::zeros())), *radius),
            Self::Capsule { a, b, radius } => {
                (capsule::between([a, b].map(|end| turn.rotate(&Vector::from(*end)))), *radius)
            }
            Self::Box { size } => (Core::Box(Box::new(Cuboid::new(size, turn))), 0.0),
            Self::Convex { vertices } => (convex::around(vertices, turn), 0.0),
            Self::HalfSpace { normal } => (Core::HalfSpace(HalfSpace::new(normal, turn)), 0.0),
            Self::Points { points, radius } => {
                (Core::Cloud(Arc::new(Cloud::new(points, &[], turn))), *radius)
            }
        }
    }
}

/// A shape without its radius, relative to the obstacle's position and turned by its orientation.
#[derive(Debug, Clone)]
pub(super) enum Core {
    Point(Point),
    Segment(Probe),
    Box(Box<Cuboid>),
    Hull(Box<Hull>),
    HalfSpace(HalfSpace),
    /// Shared with the copies of a world.
    Cloud(Arc<Cloud>),
}

/// The one dispatch: what any shape answers; or what a convex one does, and otherwise a cloud.
macro_rules! dispatch {
    ($core:expr, $shape:ident => $answer:expr) => {
        $crate::world::space::shape::dispatch!($core, $shape => $answer, $shape => $answer)
    };
    ($core:expr, $shape:ident => $answer:expr, $cloud:ident => $other:expr) => {
        match $core {
            $crate::world::space::shape::Core::Point($shape) => $answer,
            $crate::world::space::shape::Core::Segment($shape) => $answer,
            $crate::world::space::shape::Core::Box($shape) => {
                let $shape = &**$shape;
                $answer
            }
            $crate::world::space::shape::Core::Hull($shape) => {
                let $shape = &**$shape;
                $answer
            }
            $crate::world::space::shape::Core::HalfSpace($shape) => $answer,
            $crate::world::space::shape::Core::Cloud($cloud) => $other,
        }
    };
}
pub(super) use dispatch;

/// What is asked of the core of a convex shape, beside what is [`Convex`]. A radius \[m\] is that around the core.
pub(super) trait ConvexCore: Convex {
    /// The distance of [`nearest`](Convex::nearest), bit for bit.
    fn distance(&self, axis: &Probe) -> f64;

    /// The same where it is less than `limit` \[m\]; otherwise anything that is not.
    #[inline(always)]
    fn distance_below(&self, axis: &Probe, limit: f64) -> f64 {
        let _ = limit;
        self.distance(axis)
    }

    /// How many corners and edges may be next to an axis when features change hands; none of a point, which has none.
    fn features(&self) -> Option<usize>;

    /// Opposite corners of a box around it \[m\].
    fn extent(&self, radius: f64) -> [Vector<3>; 2];

    /// How far it reaches from the position \[m\].
    fn reach(&self) -> f64;

    /// How far a ray goes from `origin` along the unit vector `direction` until it meets it \[m\]; 0 inside. Beyond `range` \[m\]
    /// it may be anything that is beyond.
    fn cast(
        &self,
        origin: &Vector<3>,
        direction: &Vector<3>,
        radius: f64,
        range: f64,
    ) -> Option<f64>;

    /// An end of a link outside. It counts as opposite a face everywhere: that the normal turns about an edge or a corner is
    /// left out, which is the safe side (T77).
    #[inline]
    fn end(&self, end: Vector<3>) -> Nearest {
        let offset = self.offset(&end);
        let distance = offset.norm();
        Nearest { distance, normal: offset / distance, point: end, feature: Feature::Face }
    }

    /// Where it and a hull come nearest, for what is `asked`.
    fn meet(&self, hull: &PlacedHull<'_, 3>, asked: Asked) -> HullContact
    where
        Self: Sized,
    {
        let _ = asked;
        hull.meet(self)
    }

    /// How far a hull is from it at least, within its radius; see [`PlacedHull::gap`].
    fn gap(&self, hull: &PlacedHull<'_, 3>, radius: f64, limit: f64, plane: &mut Vector<3>) -> f64
    where
        Self: Sized,
    {
        hull.gap(self, radius, limit, plane)
    }

    /// Calls `visit` with the pairs of features of it and a hull that may be next; see [`PlacedHull::for_each_row`].
    fn for_each_row(
        &self,
        hull: &PlacedHull<'_, 3>,
        nearest: &Nearest,
        reach: f64,
        visit: impl FnMut(&HullContact, f64),
    ) where
        Self: Sized,
    {
        hull.for_each_row(self, nearest, reach, visit);
    }
}

/// Opposite corners of a box around its middle.
fn around(middle: Vector<3>, half: Vector<3>, radius: f64) -> [Vector<3>; 2] {
    let half = half.add_scalar(radius);
    [middle - half, middle + half]
}
