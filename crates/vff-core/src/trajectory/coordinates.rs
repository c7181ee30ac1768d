//! Vectors of coordinates that move, each of which follows a curve of its own.

use crate::math::Vector;

/// Coordinates with their derivatives at one instant; angles are not wrapped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Coordinates<const M: usize> {
    pub(super) x: Vector<M>,
    pub(super) dx: Vector<M>,
    pub(super) ddx: Vector<M>,
}

impl<const M: usize> Coordinates<M> {
    /// At rest at `x`.
    pub(super) fn at_rest(x: Vector<M>) -> Self {
        Self { x, dx: Vector::zeros(), ddx: Vector::zeros() }
    }
}
