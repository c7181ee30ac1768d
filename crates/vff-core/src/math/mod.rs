//! The few types that every layer shares.

#[cfg(test)]
pub(crate) mod close;
mod feature;
mod jerk_limit;
pub mod memory;
mod nearest;
mod noise;
mod point;
mod pose;
pub(crate) mod quintic;
pub mod rotation;
mod scalar_or_vec;
mod sincos;
mod spatial_pose;
pub mod symmetric;
mod third_order_filter;

pub use feature::Feature;
pub use jerk_limit::{JointBounds, JointMotion, LimitedJoint};
pub use nearest::{Nearest, beside, crossing, nearest, nearest_of_lines};
pub use noise::Noise;
pub use point::Point;
pub use pose::{PlanarPose, Pose};
pub use rotation::UnitQuaternion;
pub(crate) use rotation::upright;
pub use scalar_or_vec::ScalarOrVec;
pub use sincos::{sin_cos, unit_vectors};
pub use spatial_pose::{Pointing, SpatialPose};
pub use third_order_filter::ThirdOrderFilter;

use nalgebra::SVector;
use std::cmp::Ordering;
use std::f64::consts::TAU;

/// A vector of the plane in space, where its third coordinate is 0; one in space as it is.
pub(crate) fn in_space<const D: usize>(v: &Vector<D>) -> Vector<3> {
    Vector::<3>::from_fn(|i, _| if i < D { v[i] } else { 0.0 })
}

/// The smallest number first, and what is as small in its order; compiled once for each `T`.
#[inline(never)]
pub(crate) fn sort_by_first<T>(all: &mut [(f64, T)]) {
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
}

/// Separations up to this \[m\] count as touching: the difference of two points that near is
/// mostly rounding and has no direction, whereas a separating axis always has one.
pub(crate) const TOUCHING: f64 = 1e-13;

/// What a corner gains in distance per metre that it lies beyond an end of a link (T77).
pub(crate) const RELIEF: f64 = 10.0;

/// Keeps the smaller of two values; a `value` that is NaN takes its place.
#[inline]
pub fn keep_least(least: &mut f64, value: f64) {
    if value.partial_cmp(least).is_none_or(Ordering::is_lt) {
        *least = value;
    }
}

/// The whole turns nearest to an angle \[rad\]; what is left of it is from −π to π.
#[inline]
pub fn whole_turns(angle: f64) -> f64 {
    TAU * (angle / TAU).round()
}

/// The way of a joint \[rad or m\], the short one round where it turns without an end: whole turns are nothing to it.
#[inline]
pub fn short_way(way: f64, is_endless: bool) -> f64 {
    if is_endless { way - whole_turns(way) } else { way }
}

/// 0 below 0, 1 above 1, and 3s² − 2s³ between.
#[inline]
pub fn smoothstep(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

/// What has passed of a time that comes to rest within `duration` \[s\], `t` \[s\] after it began to, its rate and how that changes: 1 − 3u² + 2u³
/// from the beginning to the end, where half of it has passed, and 1 before.
#[inline]
pub fn coming_to_rest(t: f64, duration: f64) -> [f64; 3] {
    if t <= 0.0 {
        return [t, 1.0, 0.0];
    }
    let u = (t / duration).min(1.0);
    [
        duration * u * (1.0 - u * u * (1.0 - 0.5 * u)),
        1.0 - smoothstep(u),
        -6.0 * u * (1.0 - u) / duration,
    ]
}

/// The share of a step that a lag of this `rate` \[1/s\] takes in `elapsed` \[s\]: 1 − exp(−rate · elapsed).
#[inline]
pub fn lag_share(rate: f64, elapsed: f64) -> f64 {
    -(-rate * elapsed).exp_m1()
}

/// `a · b`, as four sums side by side: one alone would wait for itself.
#[inline]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (a, b) in a.0.iter().zip(b.0) {
        for k in 0..4 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a.1.iter().zip(b.1).map(|(a, b)| a * b).sum();
    (sums[0] + sums[2]) + (sums[1] + sums[3]) + rest
}

/// A point, displacement, velocity or force in the `D`-dimensional space of the robot.
///
/// # Example
/// ```
/// use vff_core::math::{Vector, cross, perp};
///
/// let v = Vector::<2>::new(3.0, 4.0);
/// assert_eq!(v.norm(), 5.0);
/// assert_eq!(cross(v, perp(v)), 25.0);
/// ```
pub type Vector<const D: usize> = SVector<f64, D>;

/// A line segment swept by a disc (or ball): the shape of one link.
///
/// # Example
/// ```
/// use vff_core::math::{Capsule, Vector};
///
/// let link = Capsule::new(Vector::<3>::zeros(), Vector::<3>::new(0.0, 0.0, 0.4), 0.05);
/// assert_eq!(link.length, 0.4);
/// assert_eq!(link.clamp(&Vector::<3>::new(1.0, 0.0, 0.1)), Vector::<3>::new(0.0, 0.0, 0.1));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule<const D: usize> {
    /// First end of the axis \[m\].
    pub start: Vector<D>,
    /// Unit vector from the first end to the second.
    pub direction: Vector<D>,
    /// Distance between the ends \[m\], > 0.
    pub length: f64,
    /// Distance from the axis to the surface \[m\].
    pub radius: f64,
}

impl<const D: usize> Capsule<D> {
    /// The capsule between two different points.
    pub fn new(start: Vector<D>, end: Vector<D>, radius: f64) -> Self {
        let along = end - start;
        let length = along.norm();
        Self { start, direction: along / length, length, radius }
    }

    /// The second end of the axis \[m\].
    #[inline]
    pub fn end(&self) -> Vector<D> {
        self.start + self.direction * self.length
    }

    /// Whether the perpendicular from `point` meets the axis between its ends.
    #[inline]
    pub fn has_beside(&self, point: &Vector<D>) -> bool {
        let along = self.direction.dot(&(point - self.start));
        0.0 < along && along < self.length
    }

    /// The point of the axis that is nearest to `point` \[m\].
    #[inline]
    pub fn clamp(&self, point: &Vector<D>) -> Vector<D> {
        let along = self.direction.dot(&(point - self.start)).clamp(0.0, self.length);
        self.start + self.direction * along
    }
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
