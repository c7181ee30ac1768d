//! What an obstacle in space looks like, in its own frame.

use serde::Deserialize;

/// The surface of an obstacle in the frame of the obstacle: the origin is the obstacle's position, the axes are turned by
/// its orientation. Lengths in metres.
///
/// The values are taken as they are; `scenario` validates them. What each variant expects is
/// said beside it.
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
        /// The points \[m\], at most [`MOST_POINTS`](super::MOST_POINTS), maybe none.
        points: Vec<[f64; 3]>,
        /// Radius of the balls \[m\], not negative.
        radius: f64,
    },
}
