//! What an obstacle in space looks like, in its own frame, and what is asked of it.
//!
//! Here are the only lists of shapes: the [`Shape`] that people describe, what becomes of it, and the [`Core`] that is asked.
//! A file per shape has its answers.

mod capsule;
pub(super) mod cloud;
mod convex;
mod cuboid;
mod half_space;
mod sphere;

pub(super) use capsule::cast_at_capsule;
pub(super) use sphere::Point;

use crate::geometry::axis::{Nearest, Probe};
use crate::geometry::{Carried, Convex, Hull, Meeting};
use crate::math::{Feature, UnitQuaternion, Vector};
use crate::settings::{NOT_NEGATIVE, POSITIVE};
use crate::world::{Asked, ShapeFault};
use cloud::Cloud;
use cuboid::Cuboid;
use half_space::HalfSpace;
use serde::Deserialize;
use std::sync::Arc;

/// The surface of an obstacle in the frame of the obstacle: the origin is the obstacle's position, the axes are turned by
/// its orientation. Lengths in metres.
///
/// The values are taken as they are; `scenario` validates them. What each variant expects is
/// said beside it.
///
/// # Example
/// ```
/// use vff_core::world::space::Shape;
///
/// assert!(Shape::Box { size: [0.4, 0.4, 0.1] }.check().is_ok());
/// assert!(Shape::Sphere { radius: -0.1 }.check().is_err());
/// ```
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A ball around the origin.
    Sphere {
        /// Radius \[m\], positive.
        radius: f64,
    },
    /// A segment swept by a ball.
    Capsule {
        /// First end of the segment \[m\].
        a: [f64; 3],
        /// Second end of the segment \[m\].
        b: [f64; 3],
        /// Radius of the ball \[m\], not negative.
        radius: f64,
    },
    /// A cuboid centred on the origin, its edges along the axes.
    Box {
        /// Full lengths of the edges \[m\], all positive.
        size: [f64; 3],
    },
    /// The convex hull of points.
    Convex {
        /// Four or more points that do not lie in one plane \[m\], not all of which need be corners.
        vertices: Vec<[f64; 3]>,
    },
    /// Everything on one side of a plane through the origin: a floor, a wall.
    HalfSpace {
        /// Unit vector out of the solid, of norm 1 within 10⁻⁶.
        normal: [f64; 3],
    },
    /// A cloud of points, each swept by a ball: what a depth camera sees. Not convex: a link has a contact with every ball
    /// that is near.
    Points {
        /// The points \[m\], at most [`MAX_POINTS`](super::MAX_POINTS), maybe none.
        points: Vec<[f64; 3]>,
        /// Radius of the balls \[m\], not negative.
        radius: f64,
    },
}

impl Shape {
    /// Whether queries can be made of it.
    ///
    /// # Errors
    /// With the key of the first value that is wrong.
    pub fn check(&self) -> Result<(), ShapeFault> {
        match self {
            Self::Sphere { radius } => ShapeFault::unless("radius", *radius, &POSITIVE),
            Self::Capsule { a, b, radius } => {
                ShapeFault::unless("radius", *radius, &NOT_NEGATIVE)?;
                ShapeFault::of_ends(a, b)
            }
            Self::Box { size } => ShapeFault::of_size(size),
            Self::Convex { vertices } => convex::check(vertices),
            Self::HalfSpace { normal } => half_space::check(normal),
            Self::Points { points, radius } => {
                ShapeFault::unless("radius", *radius, &NOT_NEGATIVE)?;
                cloud::check(points)
            }
        }
    }

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
                (Core::Cloud(Arc::new(Cloud::new(points, turn))), *radius)
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
    fn meet(&self, hull: &Carried<'_, 3>, asked: Asked) -> Meeting
    where
        Self: Sized,
    {
        let _ = asked;
        hull.meet(self)
    }

    /// Calls `visit` with the pairs of features of it and a hull that may be next; see [`Carried::for_each_row`].
    fn for_each_row(
        &self,
        hull: &Carried<'_, 3>,
        nearest: &Nearest,
        reach: f64,
        visit: impl FnMut(&Meeting, f64),
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
