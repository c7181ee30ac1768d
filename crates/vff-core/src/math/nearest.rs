//! The nearest points of two links.

use super::{Capsule, Vector};

/// Where two capsules come nearest.
///
/// Moving the first by a small δ changes `distance` by `normal · δ`, outside and inside alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest<const D: usize> {
    /// The point on the axis of each [m].
    pub points: [Vector<D>; 2],
    /// Unit vector from the second to the first.
    pub normal: Vector<D>,
    /// Signed distance of the surfaces [m]. Where the axes cross, it is the shortest way back to
    /// touching axes that counts, negative.
    pub distance: f64,
}

/// The nearest points of two capsules.
pub fn nearest<const D: usize>(a: &Capsule<D>, b: &Capsule<D>) -> Nearest<D> {
    // Away from crossings the shortest way in the plane starts at an end of one of the axes.
    let candidates = [
        (a.start, b.clamp(&a.start)),
        (a.end(), b.clamp(&a.end())),
        (a.clamp(&b.start), b.start),
        (a.clamp(&b.end()), b.end()),
    ];
    let mut points = candidates[0];
    for pair in &candidates[1..] {
        if (pair.0 - pair.1).norm_squared() < (points.0 - points.1).norm_squared() {
            points = *pair;
        }
    }
    let mut axes = (points.0 - points.1).norm();
    let mut sign = 1.0;
    if let Some(inside) = common_perpendicular(a, b) {
        let gap = (inside.0 - inside.1).norm();
        if gap <= 1e-12 * (a.length + b.length) {
            sign = -1.0; // the axes cross: the way out leads back through the nearest end
        } else if gap < axes {
            (points, axes) = (inside, gap);
        }
    }
    let normal = match axes {
        0.0 => Vector::zeros(),
        axes => (points.0 - points.1) * (sign / axes),
    };
    Nearest { points: [points.0, points.1], normal, distance: sign * axes - a.radius - b.radius }
}

/// The feet of the common perpendicular of two axes, if both lie within.
fn common_perpendicular<const D: usize>(
    a: &Capsule<D>,
    b: &Capsule<D>,
) -> Option<(Vector<D>, Vector<D>)> {
    let between = a.start - b.start;
    let cos = a.direction.dot(&b.direction);
    let (along_a, along_b) = (a.direction.dot(&between), b.direction.dot(&between));
    let sin_squared = 1.0 - cos * cos;
    if sin_squared <= 1e-14 {
        return None;
    }
    let s = (cos * along_b - along_a) / sin_squared;
    let t = (along_b - cos * along_a) / sin_squared;
    let within = (0.0..=a.length).contains(&s) && (0.0..=b.length).contains(&t);
    within.then(|| (a.start + a.direction * s, b.start + b.direction * t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn capsule<const D: usize>() -> impl Strategy<Value = Capsule<D>> {
        let point = || prop::array::uniform::<_, D>(-2.0..2.0).prop_map(Vector::<D>::from);
        (point(), point(), 0.0..0.2)
            .prop_filter("no point", |(a, b, _)| (a - b).norm() > 1e-2)
            .prop_map(|(a, b, radius)| Capsule::new(a, b, radius))
    }

    /// The distance of the axes by brute force over a grid of points on both.
    fn by_grid<const D: usize>(a: &Capsule<D>, b: &Capsule<D>) -> f64 {
        let on = |c: &Capsule<D>, k: u32| c.start + c.direction * (c.length * f64::from(k) / 300.0);
        let pairs = (0..=300).flat_map(|i| (0..=300).map(move |j| (i, j)));
        pairs.map(|(i, j)| (on(a, i) - on(b, j)).norm()).fold(f64::INFINITY, f64::min)
    }

    proptest! {
        /// Never above the grid's distance, nor below by more than its spacing; where the axes cross,
        /// not positive. The normal is the gradient of the distance.
        #[test]
        fn planar(a in capsule::<2>(), b in capsule::<2>()) {
            let found = nearest(&a, &b);
            let axes = found.distance + a.radius + b.radius;
            let grid = by_grid(&a, &b);
            prop_assert!(axes <= grid + 1e-12);
            if axes > 0.0 {
                prop_assert!(grid - axes < (a.length + b.length) / 300.0);
            }
            let shift = Vector::<2>::new(3e-7, -5e-7);
            let moved = nearest(&Capsule { start: a.start + shift, ..a }, &b);
            prop_assume!((moved.points[0] - found.points[0]).norm() < 1e-4);
            prop_assume!(axes.abs() > 1e-2);
            let slope = moved.distance - found.distance;
            prop_assert!((slope - found.normal.dot(&shift)).abs() < 1e-9);
        }

        /// The two see each other from opposite sides.
        #[test]
        fn symmetric(a in capsule::<2>(), b in capsule::<2>()) {
            let (one, two) = (nearest(&a, &b), nearest(&b, &a));
            prop_assert!((one.distance - two.distance).abs() < 1e-12);
            prop_assume!(one.distance.abs() > 1e-3);
            prop_assume!((one.points[0] - two.points[1]).norm() < 1e-9);
            prop_assert!((one.normal + two.normal).norm() < 1e-9);
        }

        #[test]
        fn spatial(a in capsule::<3>(), b in capsule::<3>()) {
            let axes = nearest(&a, &b).distance + a.radius + b.radius;
            let grid = by_grid(&a, &b);
            prop_assert!(axes <= grid + 1e-12 && grid - axes < (a.length + b.length) / 300.0);
        }
    }

    /// A rod that is pushed with its end through another: the distance goes on to fall, without a jump.
    #[test]
    fn distance_falls_through_a_crossing() {
        let wall = Capsule::new(Vector::<2>::new(-1.0, 0.0), Vector::<2>::new(1.0, 0.0), 0.1);
        let rod =
            |y: f64| Capsule::new(Vector::<2>::new(0.2, y + 1.0), Vector::<2>::new(0.2, y), 0.05);
        for k in -30..60 {
            let y = 0.01 * f64::from(k) + 0.005;
            let found = nearest(&rod(y), &wall);
            assert!((found.distance - (y - 0.15)).abs() < 1e-12, "{y}: {found:?}");
            assert!((found.normal - Vector::<2>::new(0.0, 1.0)).norm() < 1e-9);
        }
    }
}
