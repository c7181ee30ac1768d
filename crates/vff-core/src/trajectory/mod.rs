//! What the end effector shall do: references x_r(t) with exact ẋ_r and ẍ_r.
//!
//! A scenario describes a [`Reference`]; [`Trajectory::new`] checks it against the task
//! dimension and prepares it; [`Trajectory::at`] evaluates it without allocating.

mod error;
mod governor;
mod line;
mod piecewise;
mod planar;
mod polynomial;
mod reference;
mod table;
mod waypoints;

pub use error::TrajectoryError;
pub use governor::{Governor, GovernorSettings};
pub use reference::Reference;

use crate::math::{ThirdOrderFilter, Vector};
use line::Line;
use piecewise::Piecewise;
use planar::{Circle, Lissajous};
use polynomial::Polynomial;

/// The reference at one instant, per task axis: x, y [m] and, for M = 3, the orientation φ
/// [rad], which is not wrapped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<const M: usize> {
    /// Position x_r [m, rad].
    pub x: Vector<M>,
    /// Velocity ẋ_r [m/s, rad/s].
    pub dx: Vector<M>,
    /// Acceleration ẍ_r [m/s², rad/s²].
    pub ddx: Vector<M>,
}

impl<const M: usize> Sample<M> {
    /// At rest at `x`.
    fn at_rest(x: Vector<M>) -> Self {
        Self { x, dx: Vector::zeros(), ddx: Vector::zeros() }
    }

    /// The reference `ahead` [s] later, were its velocity to stay.
    #[must_use]
    pub fn carried_on(&self, ahead: f64) -> Self {
        Self { x: self.x + self.dx * ahead, dx: self.dx, ddx: Vector::zeros() }
    }
}

/// A reference for a task of dimension `M`, ready to be evaluated.
///
/// `M` is 2 (position) or 3 (position and orientation); any other value does not compile.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory<const M: usize> {
    curve: Curve<M>,
}

#[derive(Debug, Clone, PartialEq)]
enum Curve<const M: usize> {
    Setpoint(Vector<M>),
    Polynomial(Polynomial<M>),
    Line(Line<M>),
    Circle(Circle<M>),
    Lissajous(Lissajous<M>),
    Waypoints(Piecewise<M, 6>),
    Table(Piecewise<M, 4>),
    Filtered(ThirdOrderFilter<M>),
}

impl<const M: usize> Trajectory<M> {
    /// Prepares `reference`.
    ///
    /// # Arguments
    /// * `start`: pose of the end effector at t = 0, where a line without `start` begins.
    ///
    /// # Errors
    /// When a list does not fit the task dimension or another list, when `orientation` is
    /// missing (M = 3) or of no use (M = 2), when times or a duration are unusable. That
    /// numbers are finite is not checked here.
    pub fn new(reference: &Reference, start: Vector<M>) -> Result<Self, TrajectoryError> {
        const {
            assert!(M == 2 || M == 3, "a task has 2 or 3 dimensions");
        }
        let curve = match reference {
            Reference::Setpoint { point } => Curve::Setpoint(vector("point", point)?),
            Reference::Polynomial { coefficients } => {
                Curve::Polynomial(Polynomial::new(coefficients)?)
            }
            Reference::Line { start: given, end, duration } => {
                let start = match given {
                    Some(given) => vector("start", given)?,
                    None => start,
                };
                Curve::Line(Line::new(start, vector("end", end)?, *duration)?)
            }
            Reference::Circle { center, radius, angular_velocity, phase, orientation } => {
                Curve::Circle(Circle {
                    center: planar::pose(*center, *orientation)?,
                    radius: *radius,
                    angular_velocity: *angular_velocity,
                    phase: *phase,
                })
            }
            Reference::Lissajous { center, amplitude, angular_frequency, phase, orientation } => {
                Curve::Lissajous(Lissajous {
                    center: planar::pose(*center, *orientation)?,
                    amplitude: *amplitude,
                    angular_frequency: *angular_frequency,
                    phase: *phase,
                })
            }
            Reference::Waypoints { times, points } => {
                Curve::Waypoints(waypoints::through(times, &piecewise::knots(times, points)?))
            }
            Reference::Table { times, points } => {
                Curve::Table(table::through(times, &piecewise::knots(times, points)?))
            }
        };
        Ok(Self { curve })
    }

    /// A reference that pursues a goal.
    pub fn filtered(filter: ThirdOrderFilter<M>) -> Self {
        Self { curve: Curve::Filtered(filter) }
    }

    /// The reference at time `t` [s]. Does not allocate.
    #[inline]
    pub fn at(&self, t: f64) -> Sample<M> {
        match &self.curve {
            Curve::Setpoint(point) => Sample::at_rest(*point),
            Curve::Polynomial(polynomial) => polynomial.at(t),
            Curve::Line(line) => line.at(t),
            Curve::Circle(circle) => circle.at(t),
            Curve::Lissajous(lissajous) => lissajous.at(t),
            Curve::Waypoints(quintics) => quintics.at(t),
            Curve::Table(cubics) => cubics.at(t),
            Curve::Filtered(filter) => {
                let [x, dx, ddx] = filter.at(t);
                Sample { x, dx, ddx }
            }
        }
    }
}

/// `values` as a vector of the task, if there is one for each axis.
fn vector<const M: usize>(
    field: impl Into<String>,
    values: &[f64],
) -> Result<Vector<M>, TrajectoryError> {
    if values.len() == M {
        Ok(Vector::from_column_slice(values))
    } else {
        Err(TrajectoryError::Dimension { field: field.into(), expected: M, given: values.len() })
    }
}

/// What the tests of all kinds share.
#[cfg(test)]
mod testing {
    use super::*;

    /// Checks ẋ and ẍ at `t` against finite differences of x and ẋ; `t ± 1e-4` must lie in
    /// one smooth piece.
    pub(super) fn check_derivatives<const M: usize>(trajectory: &Trajectory<M>, t: f64) {
        let h = 1e-4;
        let (before, now, after) = (trajectory.at(t - h), trajectory.at(t), trajectory.at(t + h));
        let dx = (after.x - before.x) / (2.0 * h);
        let ddx = (after.dx - before.dx) / (2.0 * h);
        let scale = 1.0 + now.x.norm() + now.dx.norm() + now.ddx.norm();
        assert!((now.dx - dx).norm() < 1e-5 * scale, "at {t}: {now:?}, {dx}");
        assert!((now.ddx - ddx).norm() < 1e-5 * scale, "at {t}: {now:?}, {ddx}");
    }

    /// Checks that x, ẋ and ẍ do not jump at `t`.
    pub(super) fn check_continuity<const M: usize>(trajectory: &Trajectory<M>, t: f64) {
        let h = 1e-9;
        let (before, after) = (trajectory.at(t - h), trajectory.at(t + h));
        assert!((after.x - before.x).norm() < 1e-5, "x jumps at {t}");
        assert!((after.dx - before.dx).norm() < 1e-5, "dx jumps at {t}");
        assert!((after.ddx - before.ddx).norm() < 1e-5, "ddx jumps at {t}");
    }

    pub(super) fn assert_close<const M: usize>(a: Vector<M>, b: Vector<M>, tolerance: f64) {
        assert!((a - b).norm() <= tolerance, "{a} is not {b}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn setpoint_rests() {
        let reference = Reference::Setpoint { point: vec![2.8, 1.6, 0.1] };
        let trajectory = Trajectory::<3>::new(&reference, Vector::zeros()).unwrap();
        let expected = Sample::at_rest(Vector::<3>::new(2.8, 1.6, 0.1));
        assert_eq!(trajectory.at(-1.0), expected);
        assert_eq!(trajectory.at(7.0), expected);
    }

    #[test]
    fn errors_name_the_field_and_both_sizes() {
        let reference = Reference::Setpoint { point: vec![2.8, 1.6, 0.1] };
        let error = Trajectory::<2>::new(&reference, Vector::zeros()).unwrap_err();
        assert_eq!(error.field(), "point");
        let text = error.to_string();
        assert!(text.contains("expected 2") && text.contains("given 3"), "{text}");
    }
}
