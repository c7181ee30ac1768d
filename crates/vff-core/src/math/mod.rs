//! The few types that every layer shares.

mod broadcast;

pub use broadcast::Broadcast;

use nalgebra::SVector;

/// A point, displacement, velocity or force in the `D`-dimensional space of the robot.
pub type Vector<const D: usize> = SVector<f64, D>;

/// A line segment swept by a disc (or ball): the shape of one link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule<const D: usize> {
    /// First end of the axis [m].
    pub start: Vector<D>,
    /// Second end of the axis [m].
    pub end: Vector<D>,
    /// Distance from the axis to the surface [m].
    pub radius: f64,
}

/// `v` turned by +90°: the derivative of a planar vector by its angle.
#[inline]
pub fn perp(v: Vector<2>) -> Vector<2> {
    Vector::<2>::new(-v.y, v.x)
}

/// The planar cross product `a × b`, a scalar.
#[inline]
pub fn cross(a: Vector<2>, b: Vector<2>) -> f64 {
    a.x * b.y - a.y * b.x
}
