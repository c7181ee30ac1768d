//! Where the end effector is to be: curves through points of space.

use super::SpatialReference;
use crate::math::quintic::Coordinates;
use crate::math::{ThirdOrderFilter, Vector, sin_cos};
use crate::trajectory::line::Line;
use crate::trajectory::lissajous::oscillation;
use crate::trajectory::piecewise::{self, Piecewise};
use crate::trajectory::polynomial::Polynomial;
use crate::trajectory::{TrajectoryError, table, waypoints};

/// A curve through positions.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Position(Kind);

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    Point(Vector<3>),
    /// Added to the origin that a relative reference has.
    Polynomial(Vector<3>, Polynomial<3>),
    Line(Line<3>),
    Circle(Circle),
    Lissajous(Box<Lissajous>),
    Waypoints(Piecewise<3, 6>),
    Table(Piecewise<3, 4>),
    Filtered(ThirdOrderFilter<3>),
}

impl Position {
    /// The positions of `reference` for an end effector that is at `start` at t = 0.
    pub(super) fn new(
        reference: &SpatialReference,
        start: Vector<3>,
    ) -> Result<Self, TrajectoryError> {
        use SpatialReference as Given;
        let origin = |relative: bool| if relative { start } else { Vector::zeros() };
        let all = |points: &[[f64; 3]], relative: bool| -> Vec<_> {
            points.iter().map(|point| Vector::from(*point) + origin(relative)).collect()
        };
        Ok(Self(match reference {
            Given::Plan { .. } => return Err(TrajectoryError::WithoutArm),
            Given::Setpoint { point, relative, .. } => {
                Kind::Point(point.map_or(start, |point| Vector::from(point) + origin(*relative)))
            }
            Given::Polynomial { coefficients, relative, .. } => {
                Kind::Polynomial(origin(*relative), Polynomial::new(coefficients)?)
            }
            Given::Line { start: given, end, duration, relative, .. } => {
                let [first, last] =
                    [*given, Some(*end)].map(|x| x.map(|x| Vector::from(x) + origin(*relative)));
                let last = last.unwrap_or(start);
                Kind::Line(Line::new(first.unwrap_or(start), last, *duration)?)
            }
            Given::Circle { center, radius, angular_velocity, phase, normal, relative, .. } => {
                let [across, along] = axes(&direction(*normal)?);
                Kind::Circle(Circle {
                    center: Vector::from(*center) + origin(*relative),
                    axes: [across * *radius, along * *radius],
                    angular_velocity: *angular_velocity,
                    phase: *phase,
                })
            }
            Given::Lissajous { center, amplitude, angular_frequency, phase, relative, .. } => {
                Kind::Lissajous(Box::new(Lissajous {
                    center: Vector::from(*center) + origin(*relative),
                    amplitude: *amplitude,
                    angular_frequency: *angular_frequency,
                    phase: *phase,
                }))
            }
            Given::Waypoints { times, points, relative, .. } => {
                piecewise::check(times, points.len())?;
                Kind::Waypoints(waypoints::through(times, &all(points, *relative)))
            }
            Given::Table { times, points, relative, .. } => {
                piecewise::check(times, points.len())?;
                Kind::Table(table::through(times, &all(points, *relative)))
            }
        }))
    }

    /// Where it is at time `t` \[s\].
    #[inline]
    pub(super) fn at(&self, t: f64) -> Coordinates<3> {
        match &self.0 {
            Kind::Point(point) => Coordinates::at_rest(*point),
            Kind::Polynomial(origin, polynomial) => {
                let at = polynomial.at(t);
                Coordinates { x: at.x + origin, ..at }
            }
            Kind::Line(line) => line.at(t),
            Kind::Circle(circle) => circle.at(t),
            Kind::Lissajous(lissajous) => lissajous.at(t),
            Kind::Waypoints(quintics) => quintics.at(t),
            Kind::Table(cubics) => cubics.at(t),
            Kind::Filtered(filter) => {
                let [x, dx, ddx] = filter.at(t);
                Coordinates { x, dx, ddx }
            }
        }
    }

    /// From when on it is at rest for good \[s\].
    pub(super) fn rests_from(&self) -> Option<f64> {
        match &self.0 {
            Kind::Point(_) => Some(f64::NEG_INFINITY),
            Kind::Line(line) => Some(line.duration()),
            Kind::Waypoints(quintics) => Some(quintics.end()),
            Kind::Table(cubics) => Some(cubics.end()),
            Kind::Filtered(filter) => Some(filter.rests_from()),
            Kind::Polynomial(..) | Kind::Circle(_) | Kind::Lissajous(_) => None,
        }
    }

    /// From where it is at time `t` \[s\] on to the point whose first coordinates are `goal`.
    pub(super) fn aim(&self, t: f64, goal: &[f64], rate: f64) -> Self {
        Self::leave(self.at(t), t, goal, rate)
    }

    /// The same from a state that no curve has led to.
    pub(super) fn leave(state: Coordinates<3>, t: f64, goal: &[f64], rate: f64) -> Self {
        let Coordinates { x, dx, ddx } = state;
        let end = Vector::from_fn(|axis, _| goal.get(axis).copied().unwrap_or(x[axis]));
        Self(Kind::Filtered(ThirdOrderFilter::new(t, [x, dx, ddx], end, rate)))
    }
}

/// The unit vector along the normal of a circle.
pub(super) fn direction(normal: [f64; 3]) -> Result<Vector<3>, TrajectoryError> {
    let normal = Vector::from(normal);
    // Scaled first, so that neither large nor small vectors leave the range of numbers.
    let size = normal.amax();
    if size > 0.0 && size.is_finite() {
        Ok((normal / size).normalize())
    } else {
        Err(TrajectoryError::Normal { given: normal.into() })
    }
}

/// What the least rotation of z to the unit vector `n` makes of x and y: continuous in n but for −z, where both of
/// them are turned about x.
fn axes(n: &Vector<3>) -> [Vector<3>; 2] {
    // 1 + z without cancellation below the equator.
    let across = n.x * n.x + n.y * n.y;
    let room = if n.z >= 0.0 { 1.0 + n.z } else { across / (1.0 - n.z) };
    if room <= 0.0 {
        return [Vector::<3>::x(), -Vector::<3>::y()];
    }
    // (x, y)/room in a form that does not overflow next to −z.
    let (x, y) = (n.x / room, n.y / room);
    [
        Vector::<3>::new(1.0 - n.x * x, -n.x * y, -n.x),
        Vector::<3>::new(-n.x * y, 1.0 - n.y * y, -n.y),
    ]
}

#[derive(Debug, Clone, PartialEq)]
struct Circle {
    center: Vector<3>,
    /// Where its angle is 0 and a quarter turn, from the centre.
    axes: [Vector<3>; 2],
    angular_velocity: f64,
    phase: f64,
}

impl Circle {
    #[inline]
    fn at(&self, t: f64) -> Coordinates<3> {
        let (omega, [across, along]) = (self.angular_velocity, &self.axes);
        let (sin, cos) = sin_cos(omega * t + self.phase);
        let outward = across * cos + along * sin;
        let tangent = along * cos - across * sin;
        Coordinates {
            x: self.center + outward,
            dx: tangent * omega,
            ddx: outward * (-omega * omega),
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
struct Lissajous {
    center: Vector<3>,
    amplitude: [f64; 3],
    angular_frequency: [f64; 3],
    phase: [f64; 3],
}

impl Lissajous {
    fn at(&self, t: f64) -> Coordinates<3> {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            oscillation(self.amplitude[axis], self.angular_frequency[axis], self.phase[axis], t)
        });
        let row = |k: usize| Vector::<3>::new(x[k], y[k], z[k]);
        Coordinates { x: self.center + row(0), dx: row(1), ddx: row(2) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    properties! {
        /// The axes of a circle's plane are orthonormal and right-handed with its normal, also next to −z.
        #[test]
        fn axes_of_a_plane(x in -1.0..1.0_f64, y in -1.0..1.0, z in -1.0..1.0, power in 0..17_i32) {
            let flat = 10.0_f64.powi(-power);
            let n = direction([x * flat, y * flat, z]).unwrap();
            let [a, b] = axes(&n);
            prop_assert!((a.norm() - 1.0).abs() + (b.norm() - 1.0).abs() < 2e-15);
            prop_assert!((a.cross(&b) - n).norm() < 4e-15, "{n} {a} {b}");
            // The least rotation turns about z × n.
            let axis = Vector::<3>::z().cross(&n);
            prop_assert!((axis.dot(&a) - axis.x).abs() < 1e-15);
        }
    }

    #[test]
    fn axes_along_z() {
        assert_eq!(axes(&Vector::<3>::z()), [Vector::<3>::x(), Vector::<3>::y()]);
        assert_eq!(axes(&-Vector::<3>::z()), [Vector::<3>::x(), -Vector::<3>::y()]);
    }
}
