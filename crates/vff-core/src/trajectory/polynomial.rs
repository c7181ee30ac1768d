//! Polynomials in time.

use super::TrajectoryError;
use crate::math::Vector;
use crate::math::quintic::{Coordinates, horner};

/// A polynomial for each axis; all axes are evaluated together.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Polynomial<const M: usize> {
    /// Factors of 1, t, t², …
    coefficients: Vec<Vector<M>>,
}

impl<const M: usize> Polynomial<M> {
    /// From one list per axis; shorter ones are continued by zeros.
    pub(super) fn new(axes: &[Vec<f64>]) -> Result<Self, TrajectoryError> {
        if axes.len() != M {
            return Err(TrajectoryError::Dimension {
                field: "coefficients".into(),
                expected: M,
                given: axes.len(),
            });
        }
        let terms = axes.iter().map(Vec::len).max().unwrap_or(0);
        let coefficients = (0..terms)
            .map(|power| {
                Vector::from_fn(|axis, _| axes[axis].get(power).copied().unwrap_or_default())
            })
            .collect();
        Ok(Self { coefficients })
    }

    #[inline]
    pub(super) fn at(&self, t: f64) -> Coordinates<M> {
        horner(&self.coefficients, t)
    }
}

#[cfg(test)]
mod tests {
    use crate::math::Vector;
    use crate::trajectory::testing::{assert_close, check_derivatives};
    use crate::trajectory::{Reference, Sample, Trajectory, TrajectoryError};
    use proptest::prelude::*;

    fn polynomial(
        coefficients: Vec<Vec<f64>>,
    ) -> Result<Trajectory<Vector<2>, 2>, TrajectoryError> {
        Trajectory::new(&Reference::Polynomial { coefficients }, &Vector::zeros())
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn derivatives_are_exact(
            x in prop::collection::vec(-2.0..2.0, 0..6),
            y in prop::collection::vec(-2.0..2.0, 0..6),
            t in -2.0..2.0,
        ) {
            check_derivatives(&polynomial(vec![x, y]).unwrap(), t);
        }
    }

    #[test]
    fn the_paper_cubic_is_rest_to_rest() {
        // Scenario 2: y rises from 0.5 m to 2.5 m within 10 s.
        let trajectory = polynomial(vec![vec![2.5], vec![0.5, 0.0, 0.06, -0.004]]).unwrap();
        let (begin, end) = (trajectory.at(0.0), trajectory.at(10.0));
        assert_close(begin.x, Vector::<2>::new(2.5, 0.5), 0.0);
        assert_close(begin.dx, Vector::zeros(), 0.0);
        assert_close(end.x, Vector::<2>::new(2.5, 2.5), 1e-14);
        assert_close(end.dx, Vector::zeros(), 1e-14);
        assert_close(end.ddx, Vector::<2>::new(0.0, -0.12), 1e-14);
    }

    #[test]
    fn no_coefficients_are_zero() {
        let trajectory = polynomial(vec![vec![], vec![]]).unwrap();
        assert_eq!(trajectory.at(3.0), Sample::at_rest(Vector::zeros()));
    }

    #[test]
    fn one_list_per_axis() {
        let error = polynomial(vec![vec![1.0]]).unwrap_err();
        assert_eq!(error.field(), "coefficients");
    }
}
