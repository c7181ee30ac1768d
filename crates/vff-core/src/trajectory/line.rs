//! A straight line from rest to rest.

use super::TrajectoryError;
use crate::math::Vector;
use crate::math::quintic::Coordinates;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Line<const M: usize> {
    start: Vector<M>,
    displacement: Vector<M>,
    duration: f64,
}

impl<const M: usize> Line<M> {
    /// From `start` to `end` in `duration` \[s\].
    pub(super) fn new(
        start: Vector<M>,
        end: Vector<M>,
        duration: f64,
    ) -> Result<Self, TrajectoryError> {
        if duration > 0.0 {
            Ok(Self { start, displacement: end - start, duration })
        } else {
            Err(TrajectoryError::Duration { given: duration })
        }
    }

    /// When it comes to rest \[s\].
    pub(super) fn duration(&self) -> f64 {
        self.duration
    }

    #[inline]
    pub(super) fn at(&self, t: f64) -> Coordinates<M> {
        // Clamped time is all that a hold needs: both derivatives vanish at s = 0 and s = 1.
        let s = (t / self.duration).clamp(0.0, 1.0);
        let rest = 1.0 - s;
        let fraction = s * s * s * (10.0 + s * (-15.0 + s * 6.0));
        let slope = 30.0 * s * s * rest * rest / self.duration;
        let curvature = 60.0 * s * rest * (rest - s) / (self.duration * self.duration);
        Coordinates {
            x: self.start + self.displacement * fraction,
            dx: self.displacement * slope,
            ddx: self.displacement * curvature,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{PlanarPose, Vector};
    use crate::trajectory::testing::{assert_close, check_continuity, check_derivatives};
    use crate::trajectory::{Reference, Sample, Trajectory, TrajectoryError};
    use proptest::prelude::*;

    fn line(
        start: Option<Vec<f64>>,
        end: Vec<f64>,
        duration: f64,
    ) -> Result<Trajectory<PlanarPose, 3>, TrajectoryError> {
        let reference = Reference::Line { start, end, duration };
        Trajectory::new(&reference, &PlanarPose(Vector::<3>::new(7.0, 8.0, 9.0)))
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn rest_to_rest_then_hold(
            start in prop::collection::vec(-2.0..2.0, 3), end in prop::collection::vec(-2.0..2.0, 3),
            duration in 1.0..10.0, fraction in 0.01..0.99,
        ) {
            let trajectory = line(Some(start.clone()), end.clone(), duration).unwrap();
            check_derivatives(&trajectory, fraction * duration);
            check_continuity(&trajectory, 0.0);
            check_continuity(&trajectory, duration);
            let start = Vector::<3>::from_column_slice(&start);
            let end = Vector::<3>::from_column_slice(&end);
            prop_assert_eq!(trajectory.at(-1.0), Sample::at_rest(PlanarPose(start)));
            prop_assert_eq!(trajectory.at(0.0), Sample::at_rest(PlanarPose(start)));
            assert_close(trajectory.at(0.5 * duration).x.0, 0.5 * (start + end), 1e-14);
            for t in [duration, 2.0 * duration] {
                let sample = trajectory.at(t);
                assert_close(sample.x.0, end, 1e-15 * 4.0);
                prop_assert_eq!(sample, Sample::at_rest(sample.x));
            }
        }
    }

    #[test]
    fn starts_at_the_end_effector_by_default() {
        let trajectory = line(None, vec![0.0; 3], 1.0).unwrap();
        assert_eq!(trajectory.at(0.0).x.0, Vector::<3>::new(7.0, 8.0, 9.0));
    }

    #[test]
    fn unusable_values_are_named() {
        let field = |start, end, duration| line(start, end, duration).unwrap_err().field();
        assert_eq!(field(Some(vec![0.0; 2]), vec![0.0; 3], 1.0), "start");
        assert_eq!(field(None, vec![0.0; 4], 1.0), "end");
        for duration in [0.0, -1.0, f64::NAN] {
            assert_eq!(field(None, vec![0.0; 3], duration), "duration");
        }
    }
}
