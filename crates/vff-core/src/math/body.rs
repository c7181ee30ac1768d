//! The parts of a robot that must not touch anything.

use super::Capsule;
use std::cmp::Ordering;

/// One of them: a capsule in the world that a link carries. A link may carry any number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body<const D: usize> {
    /// Index of the link that carries it, from 0 at the base.
    pub link: usize,
    /// Its shape, from the end nearer to the base to the one farther away. A ball has the length 0 and any
    /// unit vector as its direction.
    pub shape: Capsule<D>,
}

impl<const D: usize> Body<D> {
    /// A capsule that is carried by `link`.
    #[inline]
    pub fn new(link: usize, shape: Capsule<D>) -> Self {
        Self { link, shape }
    }
}

/// Keeps the smaller of two values; a `value` that is NaN takes its place.
#[inline]
pub fn keep_least(least: &mut f64, value: f64) {
    if value.partial_cmp(least).is_none_or(Ordering::is_lt) {
        *least = value;
    }
}
