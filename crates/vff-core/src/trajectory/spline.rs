//! Cubic splines through knots.

use crate::math::Vector;

/// What holds at both ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ends {
    /// No acceleration.
    Natural,
    /// No velocity.
    Clamped,
}

/// The cubics between each two knots (checked by [`super::piecewise::check`]), C² across them: their coefficients.
///
/// Equal velocities on both sides of knot i, with h the durations and s the slopes:
/// hᵢ₋₁ ẍᵢ₋₁ + 2(hᵢ₋₁ + hᵢ) ẍᵢ + hᵢ ẍᵢ₊₁ = 6(sᵢ − sᵢ₋₁). At the ends either ẍ = 0, or the same holds with h and s = 0
/// beyond them. Tridiagonal and diagonally dominant: elimination without pivots, then substitution from the end.
pub(super) fn cubics<const M: usize>(
    times: &[f64],
    point: impl Fn(usize) -> Vector<M>,
    ends: Ends,
) -> Vec<[Vector<M>; 4]> {
    let last = times.len() - 1;
    let duration = |i: usize| times[i + 1] - times[i];
    let slope = |i: usize| (point(i + 1) - point(i)) / duration(i);
    let side = |i: usize| (duration(i), slope(i));
    let beyond = (0.0, Vector::zeros());
    let mut ddx = vec![Vector::zeros(); last + 1];
    let mut upper = vec![0.0; last + 1];
    let solved = if ends == Ends::Natural { 1..last } else { 0..last + 1 };
    for i in solved.clone() {
        let (before, slope_before) = if i > 0 { side(i - 1) } else { beyond };
        let (after, slope_after) = if i < last { side(i) } else { beyond };
        let (upper_before, ddx_before) =
            if i > 0 { (upper[i - 1], ddx[i - 1]) } else { (0.0, Vector::zeros()) };
        let pivot = 2.0 * (before + after) - before * upper_before;
        upper[i] = after / pivot;
        ddx[i] = ((slope_after - slope_before) * 6.0 - ddx_before * before) / pivot;
    }
    for i in solved.rev().filter(|i| *i < last) {
        let next = ddx[i + 1];
        ddx[i] -= next * upper[i];
    }
    (0..last)
        .map(|i| {
            let h = duration(i);
            [
                point(i),
                slope(i) - (ddx[i] * 2.0 + ddx[i + 1]) * (h / 6.0),
                ddx[i] * 0.5,
                (ddx[i + 1] - ddx[i]) / (6.0 * h),
            ]
        })
        .collect()
}
