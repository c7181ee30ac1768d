//! What an obstacle looks like, in its own frame.

use crate::geometry::ShapeFault;
use crate::settings::{NOT_NEGATIVE, POSITIVE};
use serde::Deserialize;

/// The outline of an obstacle in the frame of the obstacle: the origin is the obstacle's
/// position, the axes are turned by its angle. Lengths in metres.
///
/// The values are taken as they are; `scenario` validates them. What each variant expects is
/// said beside it.
///
/// # Example
/// ```
/// use vff_core::world::plane::Shape;
///
/// assert!(Shape::Polygon { vertices: vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] }.check().is_ok());
/// assert!(Shape::Circle { radius: 0.0 }.check().is_err());
/// ```
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A disc around the origin.
    Circle {
        /// Radius \[m\], positive.
        radius: f64,
    },
    /// A segment swept by a disc.
    Capsule {
        /// First end of the segment \[m\].
        a: [f64; 2],
        /// Second end of the segment \[m\].
        b: [f64; 2],
        /// Radius of the disc \[m\], not negative.
        radius: f64,
    },
    /// A rectangle centred on the origin, its sides along the axes.
    Box {
        /// Full width and full height \[m\], both positive.
        size: [f64; 2],
    },
    /// A convex polygon.
    Polygon {
        /// Corners in order \[m\], strictly convex (see [`is_convex`]), in either sense.
        vertices: Vec<[f64; 2]>,
    },
}

impl Shape {
    /// Whether queries can be made of it.
    ///
    /// # Errors
    /// With the key of the first value that is wrong.
    pub fn check(&self) -> Result<(), ShapeFault> {
        match self {
            Self::Circle { radius } => ShapeFault::of_radius(*radius, &POSITIVE),
            Self::Capsule { a, b, radius } => {
                ShapeFault::of_radius(*radius, &NOT_NEGATIVE)?;
                ShapeFault::of_ends(a, b)
            }
            Self::Box { size } => ShapeFault::of_size(size),
            Self::Polygon { vertices } if !is_convex(vertices) => {
                let requirement = "the corners of a convex polygon in order";
                Err(ShapeFault::new("vertices", requirement.into(), vertices))
            }
            Self::Polygon { .. } => Ok(()),
        }
    }

    /// The most barriers that one link can have with it.
    pub fn barriers(&self) -> usize {
        match self {
            Self::Circle { .. } => 1,
            Self::Capsule { .. } => 4,
            Self::Box { .. } => 6,
            Self::Polygon { vertices } => 2 + vertices.len(),
        }
    }
}

/// Whether `vertices` (in order, either sense, \[m\]) bound a strictly convex polygon: at
/// least three corners, none repeated, none on the line through two neighbours.
///
/// Every corner turns the same way, and so does every triangle of the first corner and two neighbours: the corners
/// go once around the first one. A pentagram turns left at every corner, too, but goes around twice.
pub fn is_convex(vertices: &[[f64; 2]]) -> bool {
    let n = vertices.len();
    if n < 3 {
        return false;
    }
    let sense = signed_area(vertices).signum();
    let left = |a: usize, b: usize, c: usize| {
        sense * turn(vertices[a % n], vertices[b % n], vertices[c % n]) > 0.0
    };
    (0..n).all(|i| left(i, i + 1, i + 2)) && (1..n - 1).all(|i| left(0, i, i + 1))
}

/// The same polygon with its corners in counter-clockwise order.
pub fn counter_clockwise(vertices: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut ordered = vertices.to_vec();
    if signed_area(vertices) < 0.0 {
        ordered.reverse();
    }
    ordered
}

/// Area enclosed by the polygon \[m²\], positive when its corners run counter-clockwise.
fn signed_area(vertices: &[[f64; 2]]) -> f64 {
    // Measured from the first corner: a polygon far from the origin loses no digits.
    let Some((&first, rest)) = vertices.split_first() else {
        return 0.0;
    };
    rest.windows(2).map(|pair| 0.5 * turn(first, pair[0], pair[1])).sum()
}

/// Cross product of `b − a` and `c − a`: positive when `c` lies to the left of `a → b`.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn regular(n: usize, step: usize) -> Vec<[f64; 2]> {
        (0..n)
            .map(|k| {
                let (sin, cos) = (TAU * (k * step) as f64 / n as f64).sin_cos();
                [10.0 + cos, sin]
            })
            .collect()
    }

    #[test]
    fn convex_polygons_are_accepted_in_both_senses() {
        for n in 3..12 {
            let polygon = regular(n, 1);
            let reversed: Vec<_> = polygon.iter().rev().copied().collect();
            assert!(is_convex(&polygon) && is_convex(&reversed));
            assert_eq!(counter_clockwise(&polygon), polygon);
            assert!(signed_area(&counter_clockwise(&reversed)) > 0.0);
        }
    }

    #[test]
    fn other_polygons_are_refused() {
        let dart = [[0.0, 0.0], [2.0, 0.0], [0.5, 0.5], [0.0, 2.0]];
        let corner_on_edge = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 2.0]];
        let repeated = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 2.0]];
        let undefined = [[0.0, 0.0], [1.0, 0.0], [0.0, f64::NAN]];
        assert!(!is_convex(&dart));
        assert!(!is_convex(&corner_on_edge));
        assert!(!is_convex(&repeated));
        assert!(!is_convex(&undefined));
        assert!(!is_convex(&dart[..2]));
        assert!(!is_convex(&[]));
        assert!(!is_convex(&regular(5, 2)), "a pentagram is not convex");
    }

    #[test]
    fn signed_area_of_a_rectangle() {
        let rectangle = [[1.0, 1.0], [4.0, 1.0], [4.0, 3.0], [1.0, 3.0]];
        assert!((signed_area(&rectangle) - 6.0).abs() < 1e-15);
    }
}
