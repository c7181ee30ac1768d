//! Twists, wrenches and inertias in one common frame: world axes, origin at the robot's base.

use crate::math::Vector;
use nalgebra::Matrix3;
use std::ops::{Add, AddAssign, Mul, Sub, SubAssign};
use wide::f64x2;

/// A twist or a wrench.
///
/// A twist is an angular velocity and the velocity of the body's point that is now at the origin; a
/// wrench is a moment about the origin and a force. Accelerations and momenta likewise.
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::robot::spatial::Spatial;
///
/// // A wrench: its moment and its force.
/// let push = Spatial { angular: Vector::<3>::zeros(), linear: Vector::<3>::new(0.0, 0.0, -10.0) };
/// assert_eq!(push.linear.norm(), 10.0);
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Spatial {
    /// Angular velocity \[rad/s\], or moment about the origin \[N·m\].
    pub angular: Vector<3>,
    /// Velocity of the point at the origin \[m/s\], or force \[N\].
    pub linear: Vector<3>,
}

impl Spatial {
    pub(super) const ZERO: Self =
        Self::new(Vector::<3>::new(0.0, 0.0, 0.0), Vector::<3>::new(0.0, 0.0, 0.0));

    #[inline(always)]
    pub(super) const fn new(angular: Vector<3>, linear: Vector<3>) -> Self {
        Self { angular, linear }
    }

    /// The wrench of a force and a moment that act at `point`.
    #[inline(always)]
    pub(super) fn at(point: &Vector<3>, force: Vector<3>, moment: Vector<3>) -> Self {
        Self::new(point.cross(&force) + moment, force)
    }

    /// Angular before linear.
    #[inline(always)]
    pub(super) fn components(&self) -> [f64; 6] {
        let Self { angular: a, linear: l } = self;
        [a.x, a.y, a.z, l.x, l.y, l.z]
    }

    #[inline(always)]
    pub(super) fn from_components(w: &[f64; 6]) -> Self {
        Self::new(Vector::<3>::new(w[0], w[1], w[2]), Vector::<3>::new(w[3], w[4], w[5]))
    }

    /// Two components at a time.
    #[inline(always)]
    fn lanes(&self) -> [f64x2; 3] {
        let Self { angular: a, linear: l } = self;
        [f64x2::new([a.x, a.y]), f64x2::new([a.z, l.x]), f64x2::new([l.y, l.z])]
    }

    #[inline(always)]
    fn from_lanes(lanes: [f64x2; 3]) -> Self {
        let [[ax, ay], [az, lx], [ly, lz]] = lanes.map(f64x2::to_array);
        Self::new(Vector::<3>::new(ax, ay, az), Vector::<3>::new(lx, ly, lz))
    }

    /// The power of a wrench on a twist, in either order.
    #[inline(always)]
    pub(super) fn dot(&self, other: &Self) -> f64 {
        let (a, b) = (self.lanes(), other.lanes());
        let [x, y] = ((a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]).to_array();
        x + y
    }

    /// V × W, the rate of a twist W that is carried along with V.
    #[inline(always)]
    pub(super) fn cross(&self, other: &Self) -> Self {
        Self::new(
            self.angular.cross(&other.angular),
            self.angular.cross(&other.linear) + self.linear.cross(&other.angular),
        )
    }

    /// V ×* F, the rate of a wrench F that is carried along with V.
    #[inline(always)]
    pub(super) fn cross_wrench(&self, wrench: &Self) -> Self {
        Self::new(
            self.angular.cross(&wrench.angular) + self.linear.cross(&wrench.linear),
            self.angular.cross(&wrench.linear),
        )
    }

    /// The velocity of the body's point that is now at `point`.
    #[inline(always)]
    pub(super) fn velocity_at(&self, point: &Vector<3>) -> Vector<3> {
        self.linear + self.angular.cross(point)
    }
}

impl Add for Spatial {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let (a, b) = (self.lanes(), other.lanes());
        Self::from_lanes([a[0] + b[0], a[1] + b[1], a[2] + b[2]])
    }
}

impl Sub for Spatial {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let (a, b) = (self.lanes(), other.lanes());
        Self::from_lanes([a[0] - b[0], a[1] - b[1], a[2] - b[2]])
    }
}

impl AddAssign for Spatial {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Spatial {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Mul<f64> for Spatial {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        Self::from_lanes(self.lanes().map(|lane| lane * factor))
    }
}

/// A symmetric 3×3 matrix: diagonal, and the entries xy, xz, yz.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Symmetric {
    pub diagonal: Vector<3>,
    pub off: Vector<3>,
}

impl Symmetric {
    pub fn matrix(&self) -> Matrix3<f64> {
        let Self { diagonal: d, off: o } = self;
        Matrix3::new(d.x, o.x, o.y, o.x, d.y, o.z, o.y, o.z, d.z)
    }

    #[inline(always)]
    pub fn trace(&self) -> f64 {
        self.diagonal.x + self.diagonal.y + self.diagonal.z
    }

    #[inline(always)]
    pub fn mul(&self, v: &Vector<3>) -> Vector<3> {
        let Self { diagonal: d, off: o } = self;
        Vector::<3>::new(
            d.x * v.x + o.x * v.y + o.y * v.z,
            o.x * v.x + d.y * v.y + o.z * v.z,
            o.y * v.x + o.z * v.y + d.z * v.z,
        )
    }

    /// `r self rᵀ`.
    #[inline(always)]
    pub fn turned(&self, r: &Matrix3<f64>) -> Self {
        let t = r * self.matrix();
        let entry = |i: usize, j: usize| {
            t[(i, 0)] * r[(j, 0)] + t[(i, 1)] * r[(j, 1)] + t[(i, 2)] * r[(j, 2)]
        };
        Self {
            diagonal: Vector::<3>::new(entry(0, 0), entry(1, 1), entry(2, 2)),
            off: Vector::<3>::new(entry(0, 1), entry(0, 2), entry(1, 2)),
        }
    }

    /// `self − u uᵀ s`.
    #[inline(always)]
    pub fn minus_square(&self, u: &Vector<3>, s: f64) -> Self {
        let us = u * s;
        Self {
            diagonal: self.diagonal - u.component_mul(&us),
            off: self.off - Vector::<3>::new(u.x * us.y, u.x * us.z, u.y * us.z),
        }
    }
}

/// The inertia of one body about the origin.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Inertia {
    /// Mass \[kg\].
    pub mass: f64,
    /// First moment m c \[kg·m\].
    pub moment: Vector<3>,
    /// Second moments J about the origin \[kg·m²\].
    pub tensor: Symmetric,
}

impl Inertia {
    /// Of a mass at `com` with the inertia tensor `central` about it, all in the axes of the frame.
    #[inline(always)]
    pub fn new(mass: f64, com: &Vector<3>, central: Symmetric) -> Self {
        let moment = com * mass;
        let square = moment.component_mul(com);
        let tensor = Symmetric {
            diagonal: central.diagonal
                + Vector::<3>::new(square.y + square.z, square.x + square.z, square.x + square.y),
            off: central.off
                - Vector::<3>::new(moment.x * com.y, moment.x * com.z, moment.y * com.z),
        };
        Self { mass, moment, tensor }
    }

    pub const ZERO: Self = Self {
        mass: 0.0,
        moment: Vector::<3>::new(0.0, 0.0, 0.0),
        tensor: Symmetric {
            diagonal: Vector::<3>::new(0.0, 0.0, 0.0),
            off: Vector::<3>::new(0.0, 0.0, 0.0),
        },
    };

    /// Linear momentum m v + ω × h of a body that moves with `v`.
    #[inline(always)]
    pub fn momentum(&self, v: &Spatial) -> Vector<3> {
        v.linear * self.mass + v.angular.cross(&self.moment)
    }

    /// I W: (J α + h × u, m u + α × h).
    #[inline(always)]
    pub fn mul(&self, w: &Spatial) -> Spatial {
        Spatial::new(self.tensor.mul(&w.angular) + self.moment.cross(&w.linear), self.momentum(w))
    }

    /// Σ w with Σ = ½ tr(J) 1 − J, the second moments ∫ r rᵀ dm.
    #[inline(always)]
    fn second_moments_mul(&self, w: &Vector<3>) -> Vector<3> {
        w * (0.5 * self.tensor.trace()) - self.tensor.mul(w)
    }

    /// B W of a body that moves with `v` and has the momentum `l`, where C = Σ SᵀI Ṡ + SᵀB S (T87).
    #[inline(always)]
    pub fn coriolis_mul(&self, v: &Spatial, l: &Vector<3>, w: &Spatial) -> Spatial {
        let alpha = &w.angular;
        let turning = v.angular.cross(&self.second_moments_mul(alpha));
        Spatial::new(self.moment.cross(&alpha.cross(&v.linear)) - turning, alpha.cross(l))
    }

    /// The angular part of Bᵀ W; its linear part is 0.
    #[inline(always)]
    pub fn coriolis_tr_mul(&self, v: &Spatial, l: &Vector<3>, w: &Spatial) -> Vector<3> {
        let alpha = &w.angular;
        v.linear.cross(&alpha.cross(&self.moment))
            + self.second_moments_mul(&v.angular.cross(alpha))
            + l.cross(&w.linear)
    }
}

/// The inertia of the outer part of the arm as one link shows it, all joints beyond it yielding: a
/// symmetric 6×6 matrix of blocks (J, H; Hᵀ, M) (T88).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ArticulatedInertia {
    tensor: Symmetric,
    coupling: Matrix3<f64>,
    mass: Symmetric,
}

impl ArticulatedInertia {
    /// Takes in the link itself.
    #[inline(always)]
    pub fn add(&mut self, body: &Inertia) {
        self.tensor.diagonal += body.tensor.diagonal;
        self.tensor.off += body.tensor.off;
        let h = &body.moment;
        self.coupling[(0, 1)] -= h.z;
        self.coupling[(0, 2)] += h.y;
        self.coupling[(1, 0)] += h.z;
        self.coupling[(1, 2)] -= h.x;
        self.coupling[(2, 0)] -= h.y;
        self.coupling[(2, 1)] += h.x;
        self.mass.diagonal.add_scalar_mut(body.mass);
    }

    #[inline(always)]
    pub fn mul(&self, w: &Spatial) -> Spatial {
        Spatial::new(
            self.tensor.mul(&w.angular) + self.coupling * w.linear,
            self.coupling.tr_mul(&w.angular) + self.mass.mul(&w.linear),
        )
    }

    /// Lets the joint yield that needs the wrench `u` per unit acceleration and has the pivot 1/`d_inv`.
    #[inline(always)]
    pub fn release(&mut self, u: &Spatial, d_inv: f64) {
        self.tensor = self.tensor.minus_square(&u.angular, d_inv);
        self.coupling -= u.angular * (u.linear * d_inv).transpose();
        self.mass = self.mass.minus_square(&u.linear, d_inv);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rotation::skew;
    use nalgebra::{Matrix6, Vector6};

    fn numbers(seed: f64) -> Vector<3> {
        Vector::<3>::from_fn(|i, _| f64::sin(seed + 2.4 * i as f64))
    }

    fn column(w: &Spatial) -> Vector6<f64> {
        Vector6::from_iterator(w.angular.iter().chain(&w.linear).copied())
    }

    /// The 6×6 matrices of the textbook, block by block.
    #[test]
    fn products_are_those_of_matrices() {
        let (mass, com) = (1.7, numbers(0.1));
        let central = Symmetric { diagonal: numbers(1.0).add_scalar(2.0), off: numbers(2.0) };
        let body = Inertia::new(mass, &com, central);
        let (v, w) =
            (Spatial::new(numbers(3.0), numbers(4.0)), Spatial::new(numbers(5.0), numbers(6.0)));
        let blocks = |a: Matrix3<f64>, b: Matrix3<f64>, c: Matrix3<f64>, d: Matrix3<f64>| {
            Matrix6::from_fn(|i, j| {
                let block = match (i < 3, j < 3) {
                    (true, true) => &a,
                    (true, false) => &b,
                    (false, true) => &c,
                    (false, false) => &d,
                };
                block[(i % 3, j % 3)]
            })
        };
        let (c, one) = (skew(&com), Matrix3::<f64>::identity());
        let inertia = blocks(central.matrix() - c * c * mass, c * mass, -c * mass, one * mass);
        let close =
            |a: Spatial, b: Vector6<f64>| assert!((column(&a) - b).norm() < 1e-14, "{a:?} {b}");
        close(body.mul(&w), inertia * column(&w));
        let motion = blocks(skew(&v.angular), Matrix3::zeros(), skew(&v.linear), skew(&v.angular));
        close(v.cross(&w), motion * column(&w));
        close(v.cross_wrench(&w), -motion.transpose() * column(&w));
        let mut outer = ArticulatedInertia::default();
        outer.add(&body);
        close(outer.mul(&w), inertia * column(&w));
        let u = column(&v);
        outer.release(&v, 0.3);
        close(outer.mul(&w), (inertia - u * u.transpose() * 0.3) * column(&w));
        let momentum = body.mul(&v);
        let product = body.coriolis_mul(&v, &momentum.linear, &w).dot(&v);
        let transposed = body.coriolis_tr_mul(&v, &momentum.linear, &v).dot(&w.angular);
        assert!((product - transposed).abs() < 1e-14, "{product} {transposed}");
        // What C is made of gives the bias force: B V = V ×* I V.
        close(body.coriolis_mul(&v, &momentum.linear, &v), column(&v.cross_wrench(&momentum)));
    }
}
