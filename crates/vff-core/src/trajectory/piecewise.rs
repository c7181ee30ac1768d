//! Piecewise polynomials between knots, held outside: what waypoints and tables become.

use super::{TrajectoryError, vector};
use crate::math::Vector;
use crate::math::quintic::{Coordinates, horner};

/// A polynomial with `K` coefficients between any two neighbouring knots.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Piecewise<const M: usize, const K: usize> {
    /// Instants of the knots \[s\].
    times: Vec<f64>,
    /// One for each interval, in the time since its first knot.
    pieces: Vec<[Vector<M>; K]>,
    /// Point at the first knot.
    first: Vector<M>,
    /// Point at the last knot.
    last: Vector<M>,
}

impl<const M: usize, const K: usize> Piecewise<M, K> {
    /// Through `points` (checked by [`check`]) at `times`, with the polynomial `piece(i)`
    /// between the knots i and i + 1.
    pub(super) fn new(
        times: &[f64],
        points: &[Vector<M>],
        piece: impl Fn(usize) -> [Vector<M>; K],
    ) -> Self {
        Self {
            times: times.to_vec(),
            pieces: (0..points.len() - 1).map(piece).collect(),
            first: points[0],
            last: points[points.len() - 1],
        }
    }

    /// The instant of the last knot \[s\].
    pub(super) fn end(&self) -> f64 {
        self.times[self.pieces.len()]
    }

    /// The first and the last knot themselves belong to the pieces, not to the holds.
    #[inline]
    pub(super) fn at(&self, t: f64) -> Coordinates<M> {
        let end = self.pieces.len();
        if t < self.times[0] {
            return Coordinates::at_rest(self.first);
        }
        if t > self.times[end] {
            return Coordinates::at_rest(self.last);
        }
        let inner = &self.times[1..end];
        let i = inner.partition_point(|&time| time <= t);
        horner(&self.pieces[i], t - self.times[i])
    }
}

/// Checks that there are at least two times, as many points, and that the times increase.
pub(super) fn check(times: &[f64], points: usize) -> Result<(), TrajectoryError> {
    if times.len() < 2 {
        return Err(TrajectoryError::TooFewTimes { given: times.len() });
    }
    if points != times.len() {
        return Err(TrajectoryError::PointCount { times: times.len(), points });
    }
    for (i, pair) in times.windows(2).enumerate() {
        let increasing = pair[0] < pair[1]; // false for NaN
        if !increasing {
            return Err(TrajectoryError::TimesNotIncreasing {
                index: i + 1,
                previous: pair[0],
                given: pair[1],
            });
        }
    }
    Ok(())
}

/// The points as vectors, after [`check`].
pub(super) fn knots<const M: usize>(
    times: &[f64],
    points: &[Vec<f64>],
) -> Result<Vec<Vector<M>>, TrajectoryError> {
    check(times, points.len())?;
    points.iter().enumerate().map(|(i, point)| vector(format!("points[{i}]"), point)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory::{Reference, Trajectory};

    fn field(times: &[f64], points: &[Vec<f64>]) -> String {
        let (times, points) = (times.to_vec(), points.to_vec());
        let waypoints = Reference::Waypoints { times: times.clone(), points: points.clone() };
        let table = Reference::Table { times, points };
        let [a, b] = [waypoints, table].map(|reference| {
            Trajectory::new(&reference, &Vector::<2>::zeros()).unwrap_err().field()
        });
        assert_eq!(a, b);
        a
    }

    #[test]
    fn unusable_knots_are_named() {
        let point = vec![1.0, 2.0];
        let three = [point.clone(), point.clone(), point.clone()];
        assert_eq!(field(&[], &[]), "times");
        assert_eq!(field(&[0.0], &three[..1]), "times");
        assert_eq!(field(&[0.0, 1.0], &three), "points");
        assert_eq!(field(&[0.0, 1.0, 1.0], &three), "times[2]");
        assert_eq!(field(&[0.0, f64::NAN, 1.0], &three), "times[1]");
        assert_eq!(field(&[0.0, 1.0, 2.0], &[point.clone(), point, vec![1.0]]), "points[2]");
    }

    #[test]
    fn unordered_time_does_not_panic() {
        let piecewise = Piecewise::<1, 1>::new(
            &[0.0, 1.0, 2.0],
            &[Vector::<1>::new(0.0), Vector::<1>::new(1.0), Vector::<1>::new(2.0)],
            |i| [Vector::<1>::new(i as f64)],
        );
        for (t, x) in [(-1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (2.0, 1.0), (3.0, 2.0)] {
            assert_eq!(piecewise.at(t).x, Vector::<1>::new(x));
        }
        piecewise.at(f64::NAN);
        piecewise.at(f64::INFINITY);
    }
}
