//! Directions that are spread evenly.

use crate::math::Vector;

/// The golden angle \[rad\]: whoever turns by it again and again comes near to no direction twice (Vogel, 1979).
pub(crate) const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// So many unit vectors that are spread evenly over the sphere (a Fibonacci lattice).
pub(crate) fn directions(count: u32) -> impl Iterator<Item = Vector<3>> {
    (0..count).map(move |k| {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(count);
        let (sin, cos) = (f64::from(k) * GOLDEN_ANGLE).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vector::<3>::new(r * cos, r * sin, z)
    })
}
