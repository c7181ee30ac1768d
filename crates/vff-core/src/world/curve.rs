//! A rotation along a smooth curve, with its rate and the rate of that (T178).

use super::{Rotation, Spin, Turn};
use crate::math::quintic::{horner, parts, piece, tops};
use crate::math::rotation::{UnitQuaternion, along, continued};
use crate::math::{Vector, sin_cos};

/// How long a quaternion between two orientations must surely be; below, it would spin round.
const LEAST: f64 = 0.3;

/// A rotation between two way points, in the time since the first of them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Curve {
    form: Form,
    /// What its rate never exceeds \[rad/s\].
    pub(super) top_rate: f64,
}

/// The coefficients of a quintic.
#[derive(Debug, Clone, PartialEq)]
enum Form {
    /// Of the angle in the plane.
    Angle([Vector<1>; 6]),
    /// Of a quaternion of any length.
    Quaternion(Box<[Vector<4>; 6]>),
}

impl Curve {
    /// From angle to angle \[rad\] at these instants \[s\], relative to the first.
    pub(super) fn angles(times: &[f64], angles: &[f64]) -> Vec<Self> {
        let n = times.len().min(angles.len());
        let angle = |i: usize| Vector::<1>::new(angles[i] - angles[0]);
        let curve = |i: usize| {
            let coefficients = piece(&times[..n], angle, i);
            let [top_rate, _] = tops(&coefficients, times[i + 1] - times[i]);
            Self { form: Form::Angle(coefficients), top_rate }
        };
        (0..n.saturating_sub(1)).map(curve).collect()
    }

    /// From orientation to orientation at these instants \[s\], relative to the first.
    ///
    /// # Errors
    /// The number of the first orientation that is too far from the one before.
    pub(super) fn orientations(
        times: &[f64],
        orientations: &[UnitQuaternion],
    ) -> Result<Vec<Self>, usize> {
        let n = times.len().min(orientations.len());
        let Some(first) = orientations.first() else { return Ok(vec![]) };
        let relative: Vec<_> = orientations[..n].iter().map(|q| *q * first.inverse()).collect();
        let knots = continued(&relative);
        let curve = |i: usize| {
            let coefficients = piece(&times[..n], |i| knots[i], i);
            let h = times[i + 1] - times[i];
            // What the control points have in common, all of the curve has.
            let middle = (knots[i] + knots[i + 1]).normalize();
            let along = |control: [Vector<4>; 6]| control.map(|p| p.dot(&middle));
            let length = parts(&coefficients, h).flat_map(along).fold(f64::INFINITY, f64::min);
            let is_long = length > LEAST; // not if it is no number
            if !is_long {
                return Err(i + 1);
            }
            let top_rate = 2.0 * tops(&coefficients, h)[0] / length;
            Ok(Self { form: Form::Quaternion(Box::new(coefficients)), top_rate })
        };
        (0..n.saturating_sub(1)).map(curve).collect()
    }

    /// How it is turned at `t` \[s\]. The rotation of the plane is the upper left block of that about z.
    pub(super) fn at<const D: usize>(&self, t: f64) -> Turn<D> {
        match &self.form {
            Form::Angle(coefficients) => {
                let at = horner(coefficients, t);
                let (sin, cos) = sin_cos(at.x[0]);
                let about_z = |rate: f64| Spin::spatial(&Vector::<3>::new(0.0, 0.0, rate)).block();
                let rotation = Rotation::<3>::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
                Turn {
                    rotation: block(&rotation),
                    spin: about_z(at.dx[0]),
                    spin_rate: about_z(at.ddx[0]),
                }
            }
            Form::Quaternion(coefficients) => {
                let (orientation, omega, alpha) = along(&horner(&coefficients[..], t));
                Turn {
                    rotation: block(&orientation.matrix()),
                    spin: Spin::spatial(&omega).block(),
                    spin_rate: Spin::spatial(&alpha).block(),
                }
            }
        }
    }
}

/// The upper left block of a matrix.
pub(super) fn block<const D: usize>(matrix: &Rotation<3>) -> Rotation<D> {
    Rotation::from_fn(|i, j| matrix[(i, j)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Turning;
    use proptest::prelude::*;

    const TIMES: [f64; 4] = [-1.0, 0.5, 1.0, 4.0];

    /// The rate is the derivative of the rotation and its rate that of the rate; neither jumps at a way point, and the rate
    /// keeps its bound.
    fn check<const D: usize>(
        turning: &Turning<D>,
        leg: usize,
        share: f64,
    ) -> Result<(), TestCaseError> {
        let t = TIMES[leg] + share * (TIMES[leg + 1] - TIMES[leg]);
        let h = 1e-5;
        let [before, now, after] = [-h, 0.0, h].map(|step| turning.at(t + step));
        let difference = |a: &Rotation<D>, b: &Rotation<D>| (b - a) / (2.0 * h);
        let scale = 1.0 + turning.top_rate().powi(3);
        let columns = |spin: &Spin<D>, m: &Rotation<D>| {
            Rotation::<D>::from_columns(&std::array::from_fn::<_, D, _>(|j| {
                spin.rate_of(&m.column(j).into())
            }))
        };
        let identity = Rotation::identity();
        let rate = columns(&now.spin, &now.rotation);
        prop_assert!((rate - difference(&before.rotation, &after.rotation)).norm() < 1e-7 * scale);
        let [first, middle, last] =
            [before.spin, now.spin_rate, after.spin].map(|spin| columns(&spin, &identity));
        prop_assert!((middle - difference(&first, &last)).norm() < 1e-6 * scale);
        prop_assert!(now.spin.magnitude() <= turning.top_rate() * (1.0 + 1e-9));
        prop_assert!((now.rotation.tr_mul(&now.rotation) - identity).norm() < 1e-12);
        for time in TIMES {
            let [before, now] = [turning.at(time - 1e-9), turning.at(time)];
            prop_assert!(
                (columns(&before.spin, &identity) - columns(&now.spin, &identity)).norm()
                    < 1e-7 * scale
            );
            prop_assert!(
                (columns(&before.spin_rate, &identity) - columns(&now.spin_rate, &identity)).norm()
                    < 1e-5 * scale
            );
        }
        prop_assert!(turning.at(-9.0).spin.is_none() && turning.at(4.0).spin.is_none());
        Ok(())
    }

    properties! {
        #[test]
        fn rates_are_exact_in_space(
            steps in prop::collection::vec([-0.4..0.4, -0.4..0.4, -0.4..0.4], 4), leg in 0usize..3, share in 0.01..0.99,
        ) {
            let mut orientation = UnitQuaternion::IDENTITY;
            let turns: Vec<_> = steps
                .iter()
                .map(|step| {
                    orientation = UnitQuaternion::exp(&Vector::from(*step)) * orientation;
                    orientation
                })
                .collect();
            let turning = Turning::<3>::smooth(&TIMES, Curve::orientations(&TIMES, &turns).unwrap());
            for (time, turn) in TIMES.iter().zip(&turns) {
                let expected = (*turn * turns[0].inverse()).matrix();
                prop_assert!((turning.at(*time).rotation - expected).norm() < 1e-12);
            }
            check(&turning, leg, share)?;
        }

        #[test]
        fn rates_are_exact_in_the_plane(
            angles in prop::collection::vec(-9.0..9.0, 4), leg in 0usize..3, share in 0.01..0.99,
        ) {
            let turning = Turning::<2>::smooth(&TIMES, Curve::angles(&TIMES, &angles));
            for (time, angle) in TIMES.iter().zip(&angles) {
                let (sin, cos) = f64::sin_cos(angle - angles[0]);
                prop_assert!((turning.at(*time).rotation - Rotation::<2>::new(cos, -sin, sin, cos)).norm() < 1e-12);
            }
            check(&turning, leg, share)?;
        }
    }

    /// A jerk towards where the way goes on, and far beyond, would lead past the zero quaternion: it is refused. In equal steps
    /// nearly half a turn each is not.
    #[test]
    fn orientations_that_would_spin_are_named() {
        let about_x = |angle: f64| UnitQuaternion::exp(&Vector::<3>::new(angle, 0.0, 0.0));
        let turns = [1.5, 0.0, 3.0].map(about_x);
        assert_eq!(Curve::orientations(&[0.0, 0.01, 3.0], &turns), Err(2));
        let turns = [0.0, 3.0, 6.0, 9.0].map(about_x);
        assert!(Curve::orientations(&[0.0, 1.0, 2.0, 3.0], &turns).is_ok());
    }
}
