//! The corner of a hull that is farthest along a direction: what a search for a plane between two hulls asks most.

use super::Hull;
use crate::math::Vector;
use wide::f64x2;

/// The corners of a hull two by two, a coordinate each; where one is missing, the first again.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Columns(Vec<[f64x2; 3]>);

impl Columns {
    pub fn of(corners: impl ExactSizeIterator<Item = Vector<3>>) -> Self {
        let corners: Vec<Vector<3>> = corners.collect();
        let pair = |pair: &[Vector<3>]| {
            let (one, other) = (pair[0], *pair.get(1).unwrap_or(&corners[0]));
            [0, 1, 2].map(|k| f64x2::new([one[k], other[k]]))
        };
        Self(corners.chunks(2).map(pair).collect())
    }
}

impl Hull {
    /// The number of its corner that is farthest along a direction, the first of several.
    pub(crate) fn farthest_corner(&self, direction: &Vector<3>) -> usize {
        let along = [0, 1, 2].map(|k| f64x2::splat(direction[k]));
        let two = f64x2::splat(2.0);
        let mut number = f64x2::new([0.0, 1.0]);
        let (mut most, mut best) = (f64x2::splat(f64::NEG_INFINITY), number);
        for [x, y, z] in &self.columns.0 {
            let ahead = *x * along[0] + *y * along[1] + *z * along[2];
            let is_farther = ahead.simd_gt(most);
            most = is_farther.select(ahead, most);
            best = is_farther.select(number, best);
            number += two;
        }
        let ([a, b], [i, k]) = (most.to_array(), best.to_array());
        let found = if b > a || (b >= a && k < i) { k } else { i };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a number of a corner"
        )]
        let found = found as usize;
        // Where the last has no neighbour the first stands beside it.
        if found < self.corners.len() { found } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::cases::any_vertices;
    use proptest::prelude::*;

    proptest! {
        /// None is farther, and of the ones as far it is the first, whatever their number.
        #[test]
        fn none_is_farther(vertices in any_vertices(), along in [-1.0..1.0, -1.0..1.0, -1.0..1.0]) {
            let hull = Hull::new(&vertices).unwrap();
            for along in [Vector::from(along), Vector::<3>::z(), hull.faces[0].normal] {
                let ahead: Vec<f64> = hull.corners.iter().map(|c| along.dot(&c.point)).collect();
                let most = ahead.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let first = ahead.iter().position(|ahead| *ahead >= most).unwrap();
                prop_assert_eq!(hull.farthest_corner(&along), first);
            }
        }
    }
}
