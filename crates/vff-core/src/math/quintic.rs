//! Coordinates that move along polynomials, and the C² path of quintics through points.

use super::Vector;

/// Coordinates with their derivatives at one instant; angles are not wrapped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coordinates<const M: usize> {
    pub(crate) x: Vector<M>,
    pub(crate) dx: Vector<M>,
    pub(crate) ddx: Vector<M>,
}

impl<const M: usize> Coordinates<M> {
    /// At rest at `x`.
    pub(crate) fn at_rest(x: Vector<M>) -> Self {
        Self { x, dx: Vector::zeros(), ddx: Vector::zeros() }
    }
}

/// Value and derivatives at `t` of the polynomial with these factors of 1, t, t², …
#[inline]
pub(crate) fn horner<const M: usize>(coefficients: &[Vector<M>], t: f64) -> Coordinates<M> {
    // Horner's scheme, differentiated twice; the last sum is half the second derivative.
    let mut x = Vector::zeros();
    let mut dx = Vector::zeros();
    let mut half_ddx = Vector::zeros();
    for coefficient in coefficients.iter().rev() {
        half_ddx = half_ddx * t + dx;
        dx = dx * t + x;
        x = x * t + coefficient;
    }
    Coordinates { x, dx, ddx: half_ddx * 2.0 }
}

/// The quintic of duration `h` \[s\] between two states \[x, ẋ, ẍ\].
pub(crate) fn quintic<const M: usize>(
    [x0, dx0, ddx0]: [Vector<M>; 3],
    [x1, dx1, ddx1]: [Vector<M>; 3],
    h: f64,
) -> [Vector<M>; 6] {
    // What the first three terms leave to be made up at the end, scaled to unit duration.
    let x = x1 - x0 - dx0 * h - ddx0 * (0.5 * h * h);
    let dx = (dx1 - dx0 - ddx0 * h) * h;
    let ddx = (ddx1 - ddx0) * (h * h);
    [
        x0,
        dx0,
        ddx0 * 0.5,
        (x * 10.0 - dx * 4.0 + ddx * 0.5) / h.powi(3),
        (x * -15.0 + dx * 7.0 - ddx) / h.powi(4),
        (x * 6.0 - dx * 3.0 + ddx * 0.5) / h.powi(5),
    ]
}

/// The piece from knot `i` to the next of a path through `points` at increasing `times` \[s\], in the time since knot `i`
/// (T177).
///
/// At rest at both ends. At an interior point, velocity and acceleration are those of the
/// parabola through it and its two neighbours (three-point differences; for the velocity the
/// non-uniform Catmull–Rom rule). Local and linear in the points, exact on parabolas.
pub(crate) fn piece<const M: usize>(
    times: &[f64],
    point: impl Fn(usize) -> Vector<M>,
    i: usize,
) -> [Vector<M>; 6] {
    let [from, to] = [i, i + 1].map(|i| knot(times, &point, i));
    quintic(from, to, times[i + 1] - times[i])
}

/// Point, velocity and acceleration at knot `i` of that path.
fn knot<const M: usize>(
    times: &[f64],
    point: impl Fn(usize) -> Vector<M>,
    i: usize,
) -> [Vector<M>; 3] {
    if i == 0 || i + 1 == times.len() {
        return [point(i), Vector::zeros(), Vector::zeros()];
    }
    let duration = |i: usize| times[i + 1] - times[i];
    let slope = |i: usize| (point(i + 1) - point(i)) / duration(i);
    let (before, after) = (duration(i - 1), duration(i));
    let total = before + after;
    let dx = (slope(i - 1) * after + slope(i) * before) / total;
    let ddx = (slope(i) - slope(i - 1)) * (2.0 / total);
    [point(i), dx, ddx]
}

/// The control points of a quintic, from `start` to `end` within `h` \[s\]: a curve in Bernstein's form stays within the convex
/// hull of these (T177).
pub(crate) fn control_points<const M: usize>(
    start: &Coordinates<M>,
    end: &Coordinates<M>,
    h: f64,
) -> [Vector<M>; 6] {
    let [first, second] = [h / 5.0, h * h / 20.0];
    [
        start.x,
        start.x + start.dx * first,
        start.x + start.dx * (2.0 * first) + start.ddx * second,
        end.x - end.dx * (2.0 * first) + end.ddx * second,
        end.x - end.dx * first,
        end.x,
    ]
}

/// Into how many parts a piece is cut for bounds: what they are too large by falls with the square of it.
const PARTS: u32 = 8;

/// The control points of each of the equal parts of a piece of duration `h` \[s\].
pub(crate) fn parts<const M: usize>(
    coefficients: &[Vector<M>; 6],
    h: f64,
) -> impl Iterator<Item = [Vector<M>; 6]> + '_ {
    let step = h / f64::from(PARTS);
    (0..PARTS).map(move |k| {
        let [start, end] = [k, k + 1].map(|k| horner(coefficients, f64::from(k) * step));
        control_points(&start, &end, step)
    })
}

/// What the speed and the acceleration of a piece of duration `h` \[s\] never exceed, by the differences of control points.
pub(crate) fn tops<const M: usize>(coefficients: &[Vector<M>; 6], h: f64) -> [f64; 2] {
    let step = h / f64::from(PARTS);
    let [first, second] = [5.0 / step, 20.0 / (step * step)];
    parts(coefficients, h).fold([0.0; 2], |[speed, acceleration], p| {
        let speeds = p.windows(2).map(|p| (p[1] - p[0]).norm() * first);
        let accelerations = p.windows(3).map(|p| (p[2] - p[1] * 2.0 + p[0]).norm() * second);
        [speeds.fold(speed, f64::max), accelerations.fold(acceleration, f64::max)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    properties! {
        /// Control points hold the curve, and their differences bound its derivatives, on any part of a piece.
        #[test]
        fn control_points_bound_the_curve(
            points in prop::collection::vec([-2.0..2.0, -2.0..2.0], 5), steps in prop::collection::vec(0.1..2.0, 4),
            i in 0usize..4, part in [0.0..1.0, 0.0..1.0], share in 0.0..1.0,
        ) {
            let times: Vec<f64> = (0..5).map(|k| steps[..k].iter().sum()).collect();
            let coefficients = piece(&times, |k| Vector::<2>::from(points[k]), i);
            let [from, to] = if part[0] < part[1] { part } else { [part[1], part[0]] };
            let (from, h) = (from * steps[i], (to - from) * steps[i]);
            prop_assume!(h > 1e-3);
            let [start, end] = [from, from + h].map(|t| horner(&coefficients, t));
            let control = control_points(&start, &end, h);
            let at = horner(&coefficients, from + share * h);
            let [low, high] = control.iter().fold([control[0]; 2], |[low, high], p| [low.inf(p), high.sup(p)]);
            let scale = 1.0 + control.iter().map(|p| p.norm()).fold(0.0, f64::max);
            prop_assert!((low - at.x).max() < 1e-11 * scale && (at.x - high).max() < 1e-11 * scale);
            let [speed, acceleration] = tops(&coefficients, steps[i]);
            prop_assert!(at.dx.norm() <= speed * (1.0 + 1e-9));
            prop_assert!(at.ddx.norm() <= acceleration * (1.0 + 1e-9));
        }
    }

    /// From rest to rest within 1 s a metre takes 15/8 m/s and 10/√3 m/s²: the bounds are little more.
    #[test]
    fn bounds_are_tight() {
        let coefficients = piece(&[0.0, 1.0], |i| Vector::<1>::new(i as f64), 0);
        let [speed, acceleration] = tops(&coefficients, 1.0);
        assert!((1.875..1.92).contains(&speed), "{speed}");
        assert!((5.7735..6.1).contains(&acceleration), "{acceleration}");
    }
}
