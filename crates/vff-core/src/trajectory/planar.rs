//! Circles and Lissajous figures: paths in the plane with a constant orientation.

use super::{Sample, TrajectoryError};
use crate::math::{Vector, sin_cos};

/// A position [m] with the orientation [rad] that the task demands.
pub(super) fn pose<const M: usize>(
    position: [f64; 2],
    orientation: Option<f64>,
) -> Result<Vector<M>, TrajectoryError> {
    match (M, orientation) {
        (3, None) => Err(TrajectoryError::MissingOrientation),
        (3, Some(angle)) => Ok(extend(position, angle)),
        (_, Some(given)) => Err(TrajectoryError::UnexpectedOrientation { given }),
        (_, None) => Ok(extend(position, 0.0)),
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
    pub(super) fn at(&self, t: f64) -> Sample<M> {
        let omega = self.angular_velocity;
        let (sin, cos) = sin_cos(omega * t + self.phase);
        let outward = extend([self.radius * cos, self.radius * sin], 0.0);
        let tangent: Vector<M> = extend([-self.radius * sin, self.radius * cos], 0.0);
        Sample { x: self.center + outward, dx: tangent * omega, ddx: outward * (-omega * omega) }
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
    pub(super) fn at(&self, t: f64) -> Sample<M> {
        let [[x, dx, ddx], [y, dy, ddy]] = [0, 1].map(|axis| {
            let omega = self.angular_frequency[axis];
            let (sin, cos) = sin_cos(omega * t + self.phase[axis]);
            let (sin, cos) = (self.amplitude[axis] * sin, self.amplitude[axis] * cos);
            [sin, omega * cos, -omega * omega * sin]
        });
        Sample {
            x: self.center + extend([x, y], 0.0),
            dx: extend([dx, dy], 0.0),
            ddx: extend([ddx, ddy], 0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::math::Vector;
    use crate::trajectory::testing::{assert_close, check_derivatives};
    use crate::trajectory::{Reference, Trajectory, TrajectoryError};
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn two(limit: f64) -> impl Strategy<Value = [f64; 2]> {
        [-limit..limit, -limit..limit]
    }

    fn compile<const M: usize>(reference: &Reference) -> Result<Trajectory<M>, TrajectoryError> {
        Trajectory::new(reference, Vector::zeros())
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

    proptest! {
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
            check_derivatives(&compile::<2>(&circle(None)).unwrap(), t);
            check_derivatives(&compile::<3>(&circle(Some(angle))).unwrap(), t);
            check_derivatives(&compile::<2>(&lissajous(None)).unwrap(), t);
            check_derivatives(&compile::<3>(&lissajous(Some(angle))).unwrap(), t);
        }
    }

    #[test]
    fn circle_starts_at_its_phase_and_keeps_the_orientation() {
        let sample = compile::<3>(&circle(Some(0.7))).unwrap().at(0.0);
        assert_close(sample.x, Vector::<3>::new(2.0, 1.5, 0.7), 1e-15);
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
        let sample = compile::<2>(&reference).unwrap().at(0.0);
        assert_close(sample.x, Vector::<2>::new(2.0, 1.25), 1e-15);
        assert_close(sample.dx, Vector::<2>::new(0.5, 0.0), 1e-15);
        assert_close(sample.ddx, Vector::<2>::new(0.0, -1.0), 1e-15);
    }

    #[test]
    fn orientation_is_given_exactly_when_the_task_controls_it() {
        assert_eq!(compile::<3>(&circle(None)), Err(TrajectoryError::MissingOrientation));
        let error = compile::<2>(&circle(Some(0.7))).unwrap_err();
        assert_eq!(error, TrajectoryError::UnexpectedOrientation { given: 0.7 });
        assert_eq!(error.field(), "orientation");
    }
}
