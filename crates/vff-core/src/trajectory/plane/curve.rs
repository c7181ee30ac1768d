//! A reference of the plane, whose poses are vectors of coordinates, ready to be evaluated.

use super::{Circle, Lissajous, Reference};
use crate::math::quintic::Coordinates;
use crate::math::{ThirdOrderFilter, Vector};
use crate::trajectory::line::Line;
use crate::trajectory::piecewise::{self, Piecewise};
use crate::trajectory::polynomial::Polynomial;
use crate::trajectory::{TrajectoryError, table, vector, waypoints};

/// A curve through coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve<const M: usize>(Kind<M>);

#[derive(Debug, Clone, PartialEq)]
enum Kind<const M: usize> {
    Setpoint(Vector<M>),
    Polynomial(Polynomial<M>),
    Line(Line<M>),
    Circle(Circle<M>),
    Lissajous(Lissajous<M>),
    Waypoints(Piecewise<M, 6>),
    Table(Piecewise<M, 4>),
    Filtered(ThirdOrderFilter<M>),
}

impl<const M: usize> Curve<M> {
    /// The curve of `reference`, from `start` where it says nothing else. `pose` makes coordinates of a point of
    /// the plane and an orientation.
    pub(super) fn new(
        reference: &Reference,
        start: Vector<M>,
        pose: impl Fn([f64; 2], Option<f64>) -> Result<Vector<M>, TrajectoryError>,
    ) -> Result<Self, TrajectoryError> {
        Ok(Self(match reference {
            Reference::Setpoint { point } => Kind::Setpoint(vector("point", point)?),
            Reference::Polynomial { coefficients } => {
                Kind::Polynomial(Polynomial::new(coefficients)?)
            }
            Reference::Line { start: given, end, duration } => {
                let start = match given {
                    Some(given) => vector("start", given)?,
                    None => start,
                };
                Kind::Line(Line::new(start, vector("end", end)?, *duration)?)
            }
            Reference::Circle { center, radius, angular_velocity, phase, orientation } => {
                Kind::Circle(Circle {
                    center: pose(*center, *orientation)?,
                    radius: *radius,
                    angular_velocity: *angular_velocity,
                    phase: *phase,
                })
            }
            Reference::Lissajous { center, amplitude, angular_frequency, phase, orientation } => {
                Kind::Lissajous(Lissajous {
                    center: pose(*center, *orientation)?,
                    amplitude: *amplitude,
                    angular_frequency: *angular_frequency,
                    phase: *phase,
                })
            }
            Reference::Waypoints { times, points } => {
                Kind::Waypoints(waypoints::through(times, &piecewise::knots(times, points)?))
            }
            Reference::Table { times, points } => {
                Kind::Table(table::through(times, &piecewise::knots(times, points)?))
            }
            Reference::Plan { .. } => return Err(TrajectoryError::WithoutArm),
        }))
    }

    /// The coordinates at time `t` \[s\].
    #[inline]
    pub(super) fn at(&self, t: f64) -> Coordinates<M> {
        match &self.0 {
            Kind::Setpoint(point) => Coordinates::at_rest(*point),
            Kind::Polynomial(polynomial) => polynomial.at(t),
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
            Kind::Setpoint(_) => Some(f64::NEG_INFINITY),
            Kind::Line(line) => Some(line.duration()),
            Kind::Waypoints(quintics) => Some(quintics.end()),
            Kind::Table(cubics) => Some(cubics.end()),
            Kind::Filtered(filter) => Some(filter.rests_from()),
            Kind::Polynomial(_) | Kind::Circle(_) | Kind::Lissajous(_) => None,
        }
    }

    /// From where it is at time `t` \[s\] on to the point whose first coordinates are `goal`.
    pub(super) fn aim(&self, t: f64, goal: &[f64], rate: f64) -> Self {
        Self::leave(self.at(t), t, goal, rate)
    }

    /// The same from a state that no curve has led to.
    pub(super) fn leave(state: Coordinates<M>, t: f64, goal: &[f64], rate: f64) -> Self {
        let Coordinates { x, dx, ddx } = state;
        let end = Vector::from_fn(|axis, _| goal.get(axis).copied().unwrap_or(x[axis]));
        Self(Kind::Filtered(ThirdOrderFilter::new(t, [x, dx, ddx], end, rate)))
    }
}
