//! A smooth path through dense samples: the natural cubic spline.

use super::piecewise::Piecewise;
use super::spline::{Ends, cubics};
use crate::math::Vector;

/// Cubics through `points` at `times` (checked by [`super::piecewise::check`]): C², without
/// curvature at both ends.
pub(super) fn through<const M: usize>(times: &[f64], points: &[Vector<M>]) -> Piecewise<M, 4> {
    let pieces = cubics(times, |i| points[i], Ends::Natural);
    Piecewise::new(times, points, |i| pieces[i])
}

#[cfg(test)]
mod tests {
    use crate::math::Vector;
    use crate::trajectory::testing::{assert_close, check_continuity, check_derivatives};
    use crate::trajectory::{Reference, Sample, Trajectory};
    use proptest::prelude::*;

    fn table(times: &[f64], points: &[Vec<f64>]) -> Trajectory<Vector<2>, 2> {
        let reference = Reference::Table { times: times.to_vec(), points: points.to_vec() };
        Trajectory::new(&reference, &Vector::zeros()).unwrap()
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn smooth_through_every_point(
            steps in prop::collection::vec(0.2..1.0, 1..12),
            coordinates in prop::collection::vec(-1.0..1.0, 26), fraction in 0.01..0.99,
        ) {
            let mut times = vec![-1.0];
            for step in steps {
                times.push(times[times.len() - 1] + step);
            }
            let points: Vec<_> = coordinates.chunks(2).take(times.len()).map(<[f64]>::to_vec).collect();
            let trajectory = table(&times, &points);
            let end = times.len() - 1;
            for (&t, point) in times.iter().zip(&points) {
                assert_close(trajectory.at(t).x, Vector::from_column_slice(point), 1e-13);
            }
            for &t in &times[1..end] {
                check_continuity(&trajectory, t);
            }
            for pair in times.windows(2) {
                check_derivatives(&trajectory, pair[0] + fraction * (pair[1] - pair[0]));
            }
            assert_close(trajectory.at(times[0]).ddx, Vector::zeros(), 1e-12);
            assert_close(trajectory.at(times[end]).ddx, Vector::zeros(), 1e-11);
            for (t, point) in [(-1.0 - fraction, &points[0]), (99.0, &points[end])] {
                let expected = Sample::at_rest(Vector::from_column_slice(point));
                prop_assert_eq!(trajectory.at(t), expected);
            }
        }
    }

    #[test]
    fn a_straight_line_stays_straight() {
        let times = [0.0, 0.5, 2.0, 2.25];
        let trajectory = table(&times, &times.map(|t| vec![1.0 + 2.0 * t, -t]));
        for t in [0.0, 0.4, 1.0, 2.1, 2.25] {
            let sample = trajectory.at(t);
            assert_close(sample.x, Vector::<2>::new(1.0 + 2.0 * t, -t), 1e-14);
            assert_close(sample.dx, Vector::<2>::new(2.0, -1.0), 1e-14);
            assert_close(sample.ddx, Vector::zeros(), 1e-13);
        }
    }

    #[test]
    fn follows_a_sampled_sine_with_fourth_order() {
        // sin has no curvature at 0 and 2π, as the natural spline demands.
        let error = |n: usize| {
            let h = std::f64::consts::TAU / n as f64;
            let times: Vec<_> = (0..=n).map(|k| k as f64 * h).collect();
            let points: Vec<_> = times.iter().map(|t| vec![t.sin(), 0.0]).collect();
            let trajectory = table(&times, &points);
            (0..n)
                .map(|k| (k as f64 + 0.5) * h)
                .map(|t| (trajectory.at(t).x[0] - t.sin()).abs())
                .fold(0.0, f64::max)
        };
        let ratio = error(20) / error(40);
        assert!((ratio - 16.0).abs() < 1.0, "{ratio}");
    }
}
