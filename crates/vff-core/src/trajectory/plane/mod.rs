//! References in the plane; circles and Lissajous figures with a constant orientation.

mod curve;
mod reference;

use super::lissajous::oscillation;
use super::{Guided, Knots, Sample, TrajectoryError};
use crate::math::quintic::Coordinates;
use crate::math::{PlanarPose, Vector, sin_cos};
use curve::Curve;

pub use reference::Reference;

/// A position in the plane.
impl Guided<2> for Vector<2> {
    type Reference = Reference;
    type Curve = Curve<2>;

    fn curve(reference: &Reference, start: &Self) -> Result<Curve<2>, TrajectoryError> {
        Curve::new(reference, *start, |position, orientation| match orientation {
            None => Ok(position.into()),
            Some(given) => Err(TrajectoryError::UnexpectedOrientation { given }),
        })
    }

    #[inline]
    fn at(curve: &Curve<2>, t: f64) -> Sample<Self, 2> {
        let Coordinates { x, dx, ddx } = curve.at(t);
        Sample { x, dx, ddx }
    }

    fn aim(curve: &Curve<2>, t: f64, goal: &[f64], rate: f64) -> Curve<2> {
        curve.aim(t, goal, rate)
    }

    fn leave(state: &Sample<Self, 2>, t: f64, goal: &[f64], rate: f64) -> Curve<2> {
        let Sample { x, dx, ddx } = *state;
        Curve::leave(Coordinates { x, dx, ddx }, t, goal, rate)
    }

    fn plan(reference: &Reference) -> Option<Knots<'_>> {
        reference.plan()
    }

    fn rests_from(curve: &Self::Curve) -> Option<f64> {
        curve.rests_from()
    }
}

/// A position and an orientation in the plane.
impl Guided<3> for PlanarPose {
    type Reference = Reference;
    type Curve = Curve<3>;

    fn curve(reference: &Reference, start: &Self) -> Result<Curve<3>, TrajectoryError> {
        Curve::new(reference, start.0, |position, orientation| match orientation {
            None => Err(TrajectoryError::MissingOrientation),
            Some(angle) => Ok(extend(position, angle)),
        })
    }

    #[inline]
    fn at(curve: &Curve<3>, t: f64) -> Sample<Self, 3> {
        let Coordinates { x, dx, ddx } = curve.at(t);
        Sample { x: Self(x), dx, ddx }
    }

    fn aim(curve: &Curve<3>, t: f64, goal: &[f64], rate: f64) -> Curve<3> {
        curve.aim(t, goal, rate)
    }

    fn leave(state: &Sample<Self, 3>, t: f64, goal: &[f64], rate: f64) -> Curve<3> {
        let Sample { x, dx, ddx } = *state;
        Curve::leave(Coordinates { x: x.0, dx, ddx }, t, goal, rate)
    }

    fn plan(reference: &Reference) -> Option<Knots<'_>> {
        reference.plan()
    }

    fn rests_from(curve: &Self::Curve) -> Option<f64> {
        curve.rests_from()
    }
}

/// A planar vector continued by `third` where the task has a third axis.
#[inline]
fn extend<const M: usize>(planar: [f64; 2], third: f64) -> Vector<M> {
    Vector::from_fn(|axis, _| planar.get(axis).copied().unwrap_or(third))
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Circle<const M: usize> {
    pub(super) center: Vector<M>,
    pub(super) radius: f64,
    pub(super) angular_velocity: f64,
    pub(super) phase: f64,
}

impl<const M: usize> Circle<M> {
    #[inline]
    pub(super) fn at(&self, t: f64) -> Coordinates<M> {
        let omega = self.angular_velocity;
        let (sin, cos) = sin_cos(omega * t + self.phase);
        let outward = extend([self.radius * cos, self.radius * sin], 0.0);
        let tangent: Vector<M> = extend([-self.radius * sin, self.radius * cos], 0.0);
        Coordinates {
            x: self.center + outward,
            dx: tangent * omega,
            ddx: outward * (-omega * omega),
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Lissajous<const M: usize> {
    pub(super) center: Vector<M>,
    pub(super) amplitude: [f64; 2],
    pub(super) angular_frequency: [f64; 2],
    pub(super) phase: [f64; 2],
}

impl<const M: usize> Lissajous<M> {
    #[inline]
    pub(super) fn at(&self, t: f64) -> Coordinates<M> {
        let [[x, dx, ddx], [y, dy, ddy]] = [0, 1].map(|axis| {
            oscillation(self.amplitude[axis], self.angular_frequency[axis], self.phase[axis], t)
        });
        Coordinates {
            x: self.center + extend([x, y], 0.0),
            dx: extend([dx, dy], 0.0),
            ddx: extend([ddx, ddy], 0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{PlanarPose, Vector};
    use crate::trajectory::testing::{assert_close, check_derivatives};
    use crate::trajectory::{Reference, Trajectory, TrajectoryError};
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn two(limit: f64) -> impl Strategy<Value = [f64; 2]> {
        [-limit..limit, -limit..limit]
    }

    fn position(reference: &Reference) -> Result<Trajectory<Vector<2>, 2>, TrajectoryError> {
        Trajectory::new(reference, &Vector::zeros())
    }

    fn pose(reference: &Reference) -> Result<Trajectory<PlanarPose, 3>, TrajectoryError> {
        Trajectory::new(reference, &PlanarPose(Vector::zeros()))
    }

    fn circle(orientation: Option<f64>) -> Reference {
        Reference::Circle {
            center: [2.0, 1.0],
            radius: 0.5,
            angular_velocity: 2.0,
            phase: FRAC_PI_2,
            orientation,
        }
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn derivatives_are_exact(
            center in two(2.0), amplitude in two(2.0), angular_frequency in two(3.0),
            phase in two(3.0), angle in -3.0..3.0, t in -5.0..5.0,
        ) {
            let circle = |orientation| Reference::Circle {
                center, radius: amplitude[0], angular_velocity: angular_frequency[0],
                phase: phase[0], orientation,
            };
            let lissajous = |orientation| Reference::Lissajous {
                center, amplitude, angular_frequency, phase, orientation,
            };
            check_derivatives(&position(&circle(None)).unwrap(), t);
            check_derivatives(&pose(&circle(Some(angle))).unwrap(), t);
            check_derivatives(&position(&lissajous(None)).unwrap(), t);
            check_derivatives(&pose(&lissajous(Some(angle))).unwrap(), t);
        }
    }

    #[test]
    fn circle_starts_at_its_phase_and_keeps_the_orientation() {
        let sample = pose(&circle(Some(0.7))).unwrap().at(0.0);
        assert_close(sample.x.0, Vector::<3>::new(2.0, 1.5, 0.7), 1e-15);
        assert_close(sample.dx, Vector::<3>::new(-1.0, 0.0, 0.0), 1e-15);
        assert_close(sample.ddx, Vector::<3>::new(0.0, -2.0, 0.0), 1e-15);
    }

    #[test]
    fn lissajous_is_a_sine_on_each_axis() {
        let reference = Reference::Lissajous {
            center: [2.0, 1.0],
            amplitude: [0.5, 0.25],
            angular_frequency: [1.0, 2.0],
            phase: [0.0, FRAC_PI_2],
            orientation: None,
        };
        let sample = position(&reference).unwrap().at(0.0);
        assert_close(sample.x, Vector::<2>::new(2.0, 1.25), 1e-15);
        assert_close(sample.dx, Vector::<2>::new(0.5, 0.0), 1e-15);
        assert_close(sample.ddx, Vector::<2>::new(0.0, -1.0), 1e-15);
    }

    #[test]
    fn orientation_is_given_exactly_when_the_task_controls_it() {
        assert_eq!(pose(&circle(None)), Err(TrajectoryError::MissingOrientation));
        let error = position(&circle(Some(0.7))).unwrap_err();
        assert_eq!(error, TrajectoryError::UnexpectedOrientation { given: 0.7 });
        assert_eq!(error.field(), "orientation");
    }
}
