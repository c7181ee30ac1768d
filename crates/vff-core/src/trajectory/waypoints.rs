//! A smooth path through a few points, from rest to rest.

use super::piecewise::Piecewise;
use crate::math::Vector;
use crate::math::quintic::piece;

/// Quintics through `points` at `times` (checked by [`super::piecewise::check`]): [`piece`] after piece.
pub(super) fn through<const M: usize>(times: &[f64], points: &[Vector<M>]) -> Piecewise<M, 6> {
    Piecewise::new(times, points, |i| piece(times, |i| points[i], i))
}

#[cfg(test)]
mod tests {
    use crate::math::Vector;
    use crate::trajectory::testing::{assert_close, check_continuity, check_derivatives};
    use crate::trajectory::{Reference, Sample, Trajectory};
    use proptest::prelude::*;

    fn waypoints(times: &[f64], points: &[Vec<f64>]) -> Trajectory<Vector<2>, 2> {
        let reference = Reference::Waypoints { times: times.to_vec(), points: points.to_vec() };
        Trajectory::new(&reference, &Vector::zeros()).unwrap()
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn smooth_through_every_point(
            steps in prop::collection::vec(0.5..3.0, 1..6),
            coordinates in prop::collection::vec(-2.0..2.0, 14), fraction in 0.01..0.99,
        ) {
            let mut times = vec![-1.0];
            for step in steps {
                times.push(times[times.len() - 1] + step);
            }
            let points: Vec<_> = coordinates.chunks(2).take(times.len()).map(<[f64]>::to_vec).collect();
            let trajectory = waypoints(&times, &points);
            for (&t, point) in times.iter().zip(&points) {
                assert_close(trajectory.at(t).x, Vector::from_column_slice(point), 1e-13);
                check_continuity(&trajectory, t);
            }
            for pair in times.windows(2) {
                check_derivatives(&trajectory, pair[0] + fraction * (pair[1] - pair[0]));
            }
            for (t, point) in [(-1.0 - fraction, &points[0]), (99.0, &points[points.len() - 1])] {
                let expected = Sample::at_rest(Vector::from_column_slice(point));
                prop_assert_eq!(trajectory.at(t), expected);
            }
        }
    }

    #[test]
    fn two_points_are_a_line() {
        let (start, end) = (vec![1.0, 0.0], vec![0.0, 2.0]);
        let trajectory = waypoints(&[0.0, 4.0], &[start.clone(), end.clone()]);
        let reference = Reference::Line { start: Some(start), end, duration: 4.0 };
        let line = Trajectory::new(&reference, &Vector::<2>::zeros()).unwrap();
        for t in [0.0, 0.3, 1.0, 3.9, 4.0] {
            let (a, b) = (trajectory.at(t), line.at(t));
            assert_close(a.x, b.x, 1e-14);
            assert_close(a.dx, b.dx, 1e-14);
            assert_close(a.ddx, b.ddx, 1e-14);
        }
    }

    #[test]
    fn exact_on_a_parabola_between_interior_points() {
        let parabola = |t: f64| vec![1.0 + 2.0 * t - 0.5 * t * t, -t + t * t];
        let times = [0.0, 1.0, 1.5, 3.0, 4.0];
        let trajectory = waypoints(&times, &times.map(parabola));
        for t in [1.0, 1.2, 1.5, 2.0, 2.9] {
            let sample = trajectory.at(t);
            assert_close(sample.x, Vector::from_vec(parabola(t)), 1e-13);
            assert_close(sample.dx, Vector::<2>::new(2.0 - t, -1.0 + 2.0 * t), 1e-13);
            assert_close(sample.ddx, Vector::<2>::new(-1.0, 2.0), 1e-12);
        }
    }
}
