//! The shapes of bodies in space, in their own frames: obstacles are one each, links carry any number.

use super::{ShapeFault, check_hull};
use crate::math::Vector;
use crate::math::rotation::UNIT_TOLERANCE;
use crate::settings::{NOT_NEGATIVE, POSITIVE};
use serde::{Deserialize, Serialize};

/// The most points of a cloud.
pub const MAX_POINTS: usize = 50_000;

/// Makes the enum, and the way in which links write it: with a `kind` among its keys.
macro_rules! shape {
    ($(#[$meta:meta])* pub enum Shape $variants:tt) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, Deserialize)]
        #[serde(rename_all = "snake_case", deny_unknown_fields)]
        pub enum Shape $variants

        #[derive(Deserialize, Serialize)]
        #[serde(remote = "Shape", tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
        pub(crate) enum WithKind $variants
    };
}

shape! {
    /// The surface of a body in its own frame. Lengths in metres.
    ///
    /// Of an obstacle the origin is its position, and its orientation turns the axes; of what a link carries see
    /// [`PlacedShape`](crate::robot::description::PlacedShape). The values are taken as they are: [`check`](Self::check) says whether
    /// they are what is said beside each.
    ///
    /// # Example
    /// ```
    /// use vff_core::geometry::Shape;
    ///
    /// assert!(Shape::Box { size: [0.4, 0.4, 0.1] }.check().is_ok());
    /// assert!(Shape::Sphere { radius: -0.1 }.check().is_err());
    /// ```
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
            /// The points \[m\], at most [`MAX_POINTS`], maybe none.
            points: Vec<[f64; 3]>,
            /// Radius of the balls \[m\], not negative.
            radius: f64,
        },
    }
}

impl Shape {
    /// Whether queries can be made of it.
    ///
    /// # Errors
    /// With the key of the first value that is wrong.
    pub fn check(&self) -> Result<(), ShapeFault> {
        match self {
            Self::Sphere { radius } => ShapeFault::of_radius(*radius, &POSITIVE),
            Self::Capsule { a, b, radius } => {
                ShapeFault::of_radius(*radius, &NOT_NEGATIVE)?;
                ShapeFault::of_numbers("a", a)?;
                ShapeFault::of_numbers("b", b)?;
                ShapeFault::of_ends(a, b)
            }
            Self::Box { size } => ShapeFault::of_size(size),
            Self::Convex { vertices } => {
                ShapeFault::of_numbers("vertices", vertices.as_flattened())?;
                check_hull(vertices)
                    .map_err(|error| ShapeFault::stated("vertices", error.to_string()))
            }
            Self::HalfSpace { normal } => {
                let norm = Vector::from(*normal).norm();
                match (norm - 1.0).abs() <= UNIT_TOLERANCE {
                    true => Ok(()),
                    false => {
                        let requirement = format!("a vector of norm 1, not {norm}");
                        Err(ShapeFault::new("normal", requirement, normal))
                    }
                }
            }
            Self::Points { points, radius } => {
                ShapeFault::of_radius(*radius, &NOT_NEGATIVE)?;
                ShapeFault::of_numbers("points", points.as_flattened())?;
                match points.len() {
                    0..=MAX_POINTS => Ok(()),
                    count => {
                        let sentence = format!("at most {MAX_POINTS} of them, got {count}");
                        Err(ShapeFault::stated("points", sentence))
                    }
                }
            }
        }
    }
}
