//! How the end effector is to be turned: curves through orientations with exact ω and α (T101, T102).

use super::SpatialReference;
use super::position::direction;
use crate::math::quintic::Coordinates;
use crate::math::rotation::{UnitQuaternion, along, continued, left_jacobian, left_jacobian_rate};
use crate::math::{ThirdOrderFilter, Vector};
use crate::trajectory::line::Line;
use crate::trajectory::piecewise::Piecewise;
use crate::trajectory::{TrajectoryError, table, waypoints};

/// The squared length of the quaternion that a spline must keep between its knots: below, it would spin round.
const LEAST: f64 = 0.1;
/// Instants per piece at which that is checked.
const CHECKS: u32 = 16;

/// An orientation with its angular velocity \[rad/s\] and acceleration \[rad/s²\] in world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Turning {
    pub(super) orientation: UnitQuaternion,
    pub(super) omega: Vector<3>,
    pub(super) alpha: Vector<3>,
}

/// A curve through orientations.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Orientation(Kind);

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    Constant(UnitQuaternion),
    /// exp(φ(t)) R₀ with φ along one axis.
    Geodesic(Box<(UnitQuaternion, Line<3>)>),
    /// exp(ωt) R₀.
    Uniform(UnitQuaternion, Vector<3>),
    Waypoints(Piecewise<4, 6>),
    Table(Piecewise<4, 4>),
    /// exp(φ(t)) R₀ with φ coming to rest.
    Resting(Box<(UnitQuaternion, ThirdOrderFilter<3>)>),
}

impl Orientation {
    /// The orientations of `reference` for an end effector that has the orientation `start` at t = 0.
    pub(super) fn new(
        reference: &SpatialReference,
        start: UnitQuaternion,
    ) -> Result<Self, TrajectoryError> {
        use SpatialReference as Given;
        let read = |field: &str, given: [f64; 4], relative: bool| {
            let given = UnitQuaternion::new(given).map_err(|error| {
                TrajectoryError::Orientation { field: field.into(), norm: error.norm }
            })?;
            Ok(if relative { given * start } else { given })
        };
        let or_start = |field: &str, given: &Option<[f64; 4]>, relative: bool| {
            given.map_or(Ok(start), |given| read(field, given, relative))
        };
        let all = |times: &[f64], given: &[[f64; 4]], relative: bool| {
            if given.len() != times.len() {
                let (times, given) = (times.len(), given.len());
                return Err(TrajectoryError::OrientationCount { times, given });
            }
            let read = |(i, given): (usize, &[f64; 4])| {
                read(&format!("orientations[{i}]"), *given, relative)
            };
            given.iter().enumerate().map(read).collect::<Result<Vec<_>, _>>()
        };
        Ok(Self(match reference {
            Given::Plan { .. } => return Err(TrajectoryError::WithoutArm),
            Given::Setpoint { orientation, relative, .. }
            | Given::Polynomial { orientation, relative, .. }
            | Given::Lissajous { orientation, relative, .. } => {
                Kind::Constant(or_start("orientation", orientation, *relative)?)
            }
            Given::Circle { orientation, relative, turning, angular_velocity, normal, .. } => {
                let first = or_start("orientation", orientation, *relative)?;
                match turning {
                    true => Kind::Uniform(first, direction(*normal)? * *angular_velocity),
                    false => Kind::Constant(first),
                }
            }
            Given::Line { start_orientation, orientation, duration, relative, .. } => {
                let first = or_start("start_orientation", start_orientation, *relative)?;
                match orientation {
                    None => Kind::Constant(first),
                    Some(given) => {
                        let last = read("orientation", *given, *relative)?;
                        let turn = (last * first.inverse()).log();
                        let line = Line::new(Vector::zeros(), turn, *duration)?;
                        Kind::Geodesic(Box::new((first, line)))
                    }
                }
            }
            Given::Waypoints { times, orientations: Some(given), relative, .. } => {
                let spline = waypoints::through(times, &continued(&all(times, given, *relative)?));
                Kind::Waypoints(bounded(spline, times)?)
            }
            Given::Table { times, orientations: Some(given), relative, .. } => {
                let spline = table::through(times, &continued(&all(times, given, *relative)?));
                Kind::Table(bounded(spline, times)?)
            }
            Given::Waypoints { orientations: None, .. }
            | Given::Table { orientations: None, .. } => Kind::Constant(start),
        }))
    }

    /// The field of `reference` that speaks of an orientation, if there is one.
    pub(super) fn spoken_of(reference: &SpatialReference) -> Option<&'static str> {
        use SpatialReference as Given;
        match reference {
            Given::Line { start_orientation: Some(_), .. } => Some("start_orientation"),
            Given::Setpoint { orientation: Some(_), .. }
            | Given::Polynomial { orientation: Some(_), .. }
            | Given::Lissajous { orientation: Some(_), .. }
            | Given::Circle { orientation: Some(_), .. }
            | Given::Line { orientation: Some(_), .. } => Some("orientation"),
            Given::Circle { turning: true, .. } => Some("turning"),
            Given::Waypoints { orientations: Some(_), .. }
            | Given::Table { orientations: Some(_), .. } => Some("orientations"),
            _ => None,
        }
    }

    /// How it is turned at time `t` \[s\].
    #[inline]
    pub(super) fn at(&self, t: f64) -> Turning {
        match &self.0 {
            Kind::Constant(orientation) => Turning {
                orientation: *orientation,
                omega: Vector::zeros(),
                alpha: Vector::zeros(),
            },
            Kind::Geodesic(geodesic) => {
                let (first, line) = &**geodesic;
                let Coordinates { x, dx, ddx } = line.at(t);
                // Along one axis J_l φ̇ is φ̇.
                let orientation = UnitQuaternion::exp(&x) * *first;
                Turning { orientation, omega: dx, alpha: ddx }
            }
            Kind::Uniform(first, omega) => Turning {
                orientation: UnitQuaternion::exp(&(omega * t)) * *first,
                omega: *omega,
                alpha: Vector::zeros(),
            },
            Kind::Waypoints(quintics) => Turning::along(&quintics.at(t)),
            Kind::Table(cubics) => Turning::along(&cubics.at(t)),
            Kind::Resting(resting) => {
                let (there, filter) = &**resting;
                let [phi, rate, change] = filter.at(t);
                let (j, dj) = (left_jacobian(&phi), left_jacobian_rate(&phi, &rate));
                Turning {
                    orientation: UnitQuaternion::exp(&phi) * *there,
                    omega: j * rate,
                    alpha: j * change + dj * rate,
                }
            }
        }
    }

    /// From when on it is at rest for good \[s\].
    pub(super) fn rests_from(&self) -> Option<f64> {
        match &self.0 {
            Kind::Constant(_) => Some(f64::NEG_INFINITY),
            Kind::Geodesic(geodesic) => Some(geodesic.1.duration()),
            Kind::Waypoints(quintics) => Some(quintics.end()),
            Kind::Table(cubics) => Some(cubics.end()),
            Kind::Resting(resting) => Some(resting.1.rests_from()),
            Kind::Uniform(..) => None,
        }
    }

    /// Comes to rest in the orientation `goal`, or in the one that it has at time `t` \[s\], with the pole `rate` \[1/s\].
    pub(super) fn rest(&self, t: f64, goal: Option<UnitQuaternion>, rate: f64) -> Self {
        self.at(t).rest(t, goal, rate)
    }
}

impl Turning {
    /// Turned by a quaternion of any length.
    fn along(p: &Coordinates<4>) -> Self {
        let (orientation, omega, alpha) = along(p);
        Self { orientation, omega, alpha }
    }

    /// What turns like this at time `t` \[s\] and comes to rest in the orientation `goal`, or in this one, with the pole
    /// `rate` \[1/s\].
    pub(super) fn rest(&self, t: f64, goal: Option<UnitQuaternion>, rate: f64) -> Orientation {
        let Self { orientation, omega, alpha } = *self;
        let zero = Vector::zeros();
        let turn = goal.map_or(zero, |goal| (goal * orientation.inverse()).log());
        if [omega, alpha, turn] == [zero; 3] {
            return Orientation(Kind::Constant(orientation));
        }
        // Where φ is 0, its derivatives are ω and α.
        let filter = ThirdOrderFilter::new(t, [zero, omega, alpha], turn, rate);
        Orientation(Kind::Resting(Box::new((orientation, filter))))
    }
}

/// `spline`, if none of its pieces comes near to the zero quaternion, which is no orientation.
fn bounded<const K: usize>(
    spline: Piecewise<4, K>,
    times: &[f64],
) -> Result<Piecewise<4, K>, TrajectoryError> {
    let narrow = |pair: &[f64]| {
        (1..CHECKS).any(|k| {
            let t = pair[0] + (pair[1] - pair[0]) * (f64::from(k) / f64::from(CHECKS));
            spline.at(t).x.norm_squared() < LEAST
        })
    };
    match times.windows(2).position(narrow) {
        Some(i) => Err(TrajectoryError::OrientationsApart { index: i + 1 }),
        None => Ok(spline),
    }
}
