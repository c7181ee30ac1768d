//! The nearest points of two links.

use super::{Capsule, Vector};

/// Where two capsules come nearest.
///
/// Moving the first by a small δ changes `distance` by `normal · δ`, outside and inside alike.
///
/// # Example
/// ```
/// use vff_core::math::{Capsule, Nearest, Vector, nearest};
///
/// let along = Capsule::new(Vector::<3>::zeros(), Vector::<3>::new(1.0, 0.0, 0.0), 0.1);
/// let across = Capsule::new(Vector::<3>::new(0.5, -1.0, 0.7), Vector::<3>::new(0.5, 1.0, 0.7), 0.1);
/// let Nearest { points, distance, .. } = nearest(&along, &across);
/// assert!((distance - 0.5).abs() < 1e-15);
/// assert_eq!(points[0].x, 0.5);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest<const D: usize> {
    /// The point on the axis of each \[m\].
    pub points: [Vector<D>; 2],
    /// Unit vector from the second to the first.
    pub normal: Vector<D>,
    /// Signed distance of the surfaces \[m\]. In the plane, where the axes cross, it is the shortest way back
    /// to touching axes that counts, negative. In space axes do not cross but by chance: the distance of the
    /// axes is never negative.
    pub distance: f64,
    /// Whether the point of each lies between the ends of its axis, and slides along it as the two move.
    pub slides: [bool; 2],
    /// Whether it is a flat face of one of them that the other is beside: the normal turns with that one.
    pub flat: [bool; 2],
}

/// The nearest points of two capsules.
///
/// Where the axes are parallel, pairs of nearest points are many: it is one with an end, and the other end may be
/// the next.
pub fn nearest<const D: usize>(a: &Capsule<D>, b: &Capsule<D>) -> Nearest<D> {
    // Away from crossings the shortest way in the plane starts at an end of one of the axes.
    let candidates = [
        (a.start, b.clamp(&a.start)),
        (a.end(), b.clamp(&a.end())),
        (a.clamp(&b.start), b.start),
        (a.clamp(&b.end()), b.end()),
    ];
    let mut best = 0;
    let mut points = candidates[0];
    for (k, pair) in candidates.iter().enumerate().skip(1) {
        if (pair.0 - pair.1).norm_squared() < (points.0 - points.1).norm_squared() {
            (best, points) = (k, *pair);
        }
    }
    let mut axes = (points.0 - points.1).norm();
    let mut sign = 1.0;
    let mut slides =
        if best < 2 { [false, b.has_beside(&points.0)] } else { [a.has_beside(&points.1), false] };
    if let Some(inside) = common_perpendicular(a, b) {
        let gap = (inside.0 - inside.1).norm();
        if D > 2 {
            if gap < axes {
                let normal = across(a, b, &(a.start - b.start));
                // Along it, feet that are a little off do not count.
                let gap = normal.dot(&(a.start - b.start)).max(0.0);
                let distance = gap - a.radius - b.radius;
                let points = [inside.0, inside.1];
                return Nearest { points, normal, distance, slides: [true; 2], flat: [false; 2] };
            }
        } else if gap <= 1e-12 * (a.length + b.length) {
            sign = -1.0; // the axes cross: the way out leads back through the nearest end
        } else if gap < axes {
            (points, axes, slides) = (inside, gap, [true; 2]);
        }
    }
    let normal = match axes {
        0.0 => Vector::zeros(),
        axes => (points.0 - points.1) * (sign / axes),
    };
    let distance = sign * axes - a.radius - b.radius;
    Nearest { points: [points.0, points.1], normal, distance, slides, flat: [false; 2] }
}

/// The unit vector across two axes that are not parallel, on the side of `offset`: known exactly, whereas the
/// difference of points that nearly meet has lost its direction.
fn across<const D: usize>(a: &Capsule<D>, b: &Capsule<D>, offset: &Vector<D>) -> Vector<D> {
    let second = (b.direction - a.direction * a.direction.dot(&b.direction)).normalize();
    let reject = |v: Vector<D>| {
        let v = v - a.direction * a.direction.dot(&v);
        v - second * second.dot(&v)
    };
    let axis = |k: usize| Vector::from_fn(|row, _| f64::from(u8::from(row == k)));
    let mut normal = Vector::<D>::zeros();
    for k in 0..D {
        let candidate = reject(axis(k));
        if candidate.norm_squared() > normal.norm_squared() {
            normal = candidate;
        }
    }
    // Twice, so that rounding does not tilt it.
    let normal = reject(normal).normalize();
    if normal.dot(offset) >= 0.0 { normal } else { -normal }
}

impl<const D: usize> Nearest<D> {
    /// What the sliding of the nearest points and the turning of the normal add to the acceleration of the
    /// distance \[m/s²\]: d̈ = n̂ᵀP̈ + this, where P leads from the material point of `b` to that of `a`.
    ///
    /// With ρ the distance of the axes, (|Ṗ⊥|² − bᵀH⁻¹b)/ρ, where b is the rate of the gradient of ½|P|² along the
    /// axes that are slid along. Where both are, H = [\[1, −c\], \[−c, 1\]], and Ṗ⊥ lies in their plane in space: its
    /// part cancels, and nothing is divided by ρ. It may have either sign.
    ///
    /// # Arguments
    /// * `velocity`: Ṗ \[m/s\].
    /// * `turning`: the rates of the directions of the two axes \[1/s\].
    pub fn sliding(
        &self,
        [a, b]: [&Capsule<D>; 2],
        velocity: &Vector<D>,
        turning: [Vector<D>; 2],
    ) -> f64 {
        let Self { normal, distance, slides, .. } = self;
        let axes = distance + a.radius + b.radius;
        let rate = normal.dot(velocity);
        let tilt = turning.map(|turning| normal.dot(&turning));
        match slides {
            [false, false] => (velocity - normal * rate).norm_squared() / axes,
            [true, false] => beside(velocity, normal, rate, &a.direction, tilt[0], axes),
            [false, true] => beside(velocity, normal, rate, &b.direction, tilt[1], axes),
            [true, true] => {
                let tilt = [tilt[0], -tilt[1]];
                crossing(velocity, [&a.direction, &b.direction], tilt, axes)
            }
        }
    }
}

/// The same for a point beside an axis along `t` that turns towards the normal at the rate `tilt`: n̂ ⟂ t, so
/// that |Ṗ|² − (n̂ᵀṖ)² − ṡ² with ṡ = −(tᵀṖ + ρ n̂ᵀṫ) loses its factor 1/ρ. What is left over, across both n̂ and
/// t, is nothing in the plane.
#[inline]
pub fn beside<const D: usize>(
    velocity: &Vector<D>,
    normal: &Vector<D>,
    rate: f64,
    t: &Vector<D>,
    tilt: f64,
    distance: f64,
) -> f64 {
    let along = t.dot(velocity);
    let across = velocity - normal * rate - t * along;
    let across = if D > 2 { across.norm_squared() / distance } else { 0.0 };
    across - tilt * (distance * tilt + 2.0 * along)
}

/// The same for the insides of two axes along `a` and `b` that are not parallel: the first turns towards the normal
/// at the rate `tilt[0]`, the second away from it at `tilt[1]`.
#[inline]
pub fn crossing<const D: usize>(
    velocity: &Vector<D>,
    [a, b]: [&Vector<D>; 2],
    tilt: [f64; 2],
    distance: f64,
) -> f64 {
    let cos = a.dot(b);
    let sin_squared = 1.0 - cos * cos;
    let along = [a.dot(velocity), -b.dot(velocity)];
    // H⁻¹ tilt.
    let slid = [tilt[0] + cos * tilt[1], cos * tilt[0] + tilt[1]];
    let product = |u: [f64; 2]| (u[0] * slid[0] + u[1] * slid[1]) / sin_squared;
    -2.0 * product(along) - distance * product(tilt)
}

/// Where the lines through the axes of two capsules in space come nearest, and how far beyond the ends of both \[m\]; none
/// if they are parallel, or in the plane.
pub fn nearest_of_lines<const D: usize>(
    a: &Capsule<D>,
    b: &Capsule<D>,
) -> Option<(Nearest<D>, f64)> {
    let [s, t] = feet(a, b).filter(|_| D > 2)?;
    let points = [a.start + a.direction * s, b.start + b.direction * t];
    let normal = across(a, b, &(a.start - b.start));
    let gap = normal.dot(&(a.start - b.start)).max(0.0);
    let distance = gap - a.radius - b.radius;
    let beyond = |along: f64, length: f64| (-along).max(along - length).max(0.0);
    let nearest = Nearest { points, normal, distance, slides: [true; 2], flat: [false; 2] };
    Some((nearest, beyond(s, a.length) + beyond(t, b.length)))
}

/// The feet of the common perpendicular of two axes, if both lie within.
fn common_perpendicular<const D: usize>(
    a: &Capsule<D>,
    b: &Capsule<D>,
) -> Option<(Vector<D>, Vector<D>)> {
    let [s, t] = feet(a, b)?;
    let within = (0.0..=a.length).contains(&s) && (0.0..=b.length).contains(&t);
    within.then(|| (a.start + a.direction * s, b.start + b.direction * t))
}

/// Where they are along the lines of both \[m\]; none if these are parallel.
fn feet<const D: usize>(a: &Capsule<D>, b: &Capsule<D>) -> Option<[f64; 2]> {
    let between = a.start - b.start;
    let cos = a.direction.dot(&b.direction);
    let (along_a, along_b) = (a.direction.dot(&between), b.direction.dot(&between));
    let sin_squared = 1.0 - cos * cos;
    if sin_squared <= 1e-14 {
        return None;
    }
    let s = (cos * along_b - along_a) / sin_squared;
    let t = (along_b - cos * along_a) / sin_squared;
    Some([s, t])
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

    properties! {
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

    /// A rod that flies and turns: its capsule, the rate of its direction, and the velocity and the acceleration
    /// of its material points.
    #[derive(Debug, Clone, Copy)]
    struct Rod {
        center: Vector<3>,
        velocity: Vector<3>,
        acceleration: Vector<3>,
        /// Constant angular velocity \[rad/s\], in the world frame.
        turning: Vector<3>,
        along: Vector<3>,
        radius: f64,
    }

    impl Rod {
        fn at(&self, t: f64) -> Capsule<3> {
            let center = self.center + self.velocity * t + self.acceleration * (0.5 * t * t);
            let along = nalgebra::Rotation3::new(self.turning * t) * self.along;
            Capsule::new(center - along, center + along, self.radius)
        }

        /// At t = 0.
        fn motion(&self, point: &Vector<3>) -> [Vector<3>; 2] {
            let arm = self.turning.cross(&(point - self.center));
            [self.velocity + arm, self.acceleration + self.turning.cross(&arm)]
        }
    }

    fn rod() -> impl Strategy<Value = Rod> {
        let three =
            |range: f64| [-range..range, -range..range, -range..range].prop_map(Vector::<3>::from);
        (three(1.0), three(1.0), three(1.0), three(1.5), three(1.0), 0.0..0.1)
            .prop_filter("no point", |(.., along, _)| along.norm() > 0.2)
            .prop_map(|(center, velocity, acceleration, turning, along, radius)| Rod {
                center,
                velocity,
                acceleration,
                turning,
                along,
                radius,
            })
    }

    properties! {
        #![proptest_config(ProptestConfig { max_global_rejects: 100_000, ..ProptestConfig::with_cases(2000) })]

        /// ḋ and d̈ of two rods in space are those of the distances a moment before and after, whichever features
        /// are nearest.
        #[test]
        fn sliding_is_exact_in_space(a in rod(), b in rod()) {
            let h = 1e-4;
            let [before, now, after] = [-h, 0.0, h].map(|t| nearest(&a.at(t), &b.at(t)));
            // Across a change of the nearest features d̈ jumps, and near parallel axes it changes within h.
            prop_assume!(before.slides == now.slides && after.slides == now.slides);
            prop_assume!((before.points[0] - after.points[0]).norm() < 1e-2);
            let axes = now.distance + a.radius + b.radius;
            let cos = a.at(0.0).direction.dot(&b.at(0.0).direction);
            prop_assume!(axes > 0.05 && cos.abs() < 0.95);
            let [[va, aa], [vb, ab]] = [a.motion(&now.points[0]), b.motion(&now.points[1])];
            let turning = [&a, &b].map(|rod| rod.turning.cross(&rod.at(0.0).direction));
            let rate = now.normal.dot(&(va - vb));
            let second = now.normal.dot(&(aa - ab))
                + now.sliding([&a.at(0.0), &b.at(0.0)], &(va - vb), turning);
            let slope = (after.distance - before.distance) / (2.0 * h);
            let curvature = (after.distance - 2.0 * now.distance + before.distance) / (h * h);
            prop_assert!((slope - rate).abs() < 1e-4 * (1.0 + rate.abs()) , "{slope} {rate}");
            prop_assert!((curvature - second).abs() < 1e-3 * (1.0 + second.abs()),
                "{curvature} {second} {:?}", now.slides);
        }

        /// Over a way on which features change, ḋ is the integral of the d̈ that is stated: nothing is missing where one
        /// pair of features hands over to the next, for ḋ does not jump there.
        #[test]
        fn rates_are_continuous_through_feature_changes(a in rod(), b in rod()) {
            let steps = 4000;
            let h = 0.5 / f64::from(steps);
            let at = |t: f64| {
                let forward = |rod: &Rod| {
                    // The same rod, seen from time t on.
                    let velocity = rod.velocity + rod.acceleration * t;
                    let center = rod.center + rod.velocity * t + rod.acceleration * (0.5 * t * t);
                    let along = nalgebra::Rotation3::new(rod.turning * t) * rod.along;
                    Rod { center, velocity, along, ..*rod }
                };
                let (a, b) = (forward(&a), forward(&b));
                let now = nearest(&a.at(0.0), &b.at(0.0));
                let [[va, aa], [vb, ab]] = [a.motion(&now.points[0]), b.motion(&now.points[1])];
                let turning = [&a, &b].map(|rod| rod.turning.cross(&rod.at(0.0).direction));
                let second = now.normal.dot(&(aa - ab))
                    + now.sliding([&a.at(0.0), &b.at(0.0)], &(va - vb), turning);
                let cos = a.at(0.0).direction.dot(&b.at(0.0).direction);
                (now, now.normal.dot(&(va - vb)), second, cos)
            };
            let (mut integral, mut bound) = (0.0, 0.0);
            let mut changes = 0;
            let (mut last, first_rate, mut second, _) = at(0.0);
            let mut rate = first_rate;
            for k in 0..steps {
                let t = h * f64::from(k);
                // Where features change, others may be nearest for a fraction of a step.
                let changed = at(t + h).0.slides != last.slides;
                changes += u32::from(changed);
                let parts = if changed { 64 } else { 1 };
                let part = h / f64::from(parts);
                for i in 1..=parts {
                    let (now, next_rate, next_second, cos) = at(t + part * f64::from(i));
                    prop_assume!(now.distance + a.radius + b.radius > 0.1 && cos.abs() < 0.95);
                    // Only where the nearest points go on without a jump: two ends may be as near as one another.
                    prop_assume!((now.points[0] - last.points[0]).norm() < 0.05);
                    integral += 0.5 * part * (second + next_second);
                    bound += 0.5 * part * (next_second - second).abs();
                    (last, rate, second) = (now, next_rate, next_second);
                }
            }
            prop_assume!(changes > 0);
            // Within a step d̈ lies between its values at both ends, jumps included.
            prop_assert!((rate - first_rate - integral).abs() < bound + 1e-6,
                "{} is not {integral} to {bound}", rate - first_rate);
        }

        /// Where axes nearly meet, the normal is still across both, and their distance is not negative.
        #[test]
        fn axes_that_nearly_meet_in_space(
            u in [-1.0..1.0, -1.0..1.0, -1.0..1.0], v in [-1.0..1.0, -1.0..1.0, -1.0..1.0], exponent in -18.0..-6.0,
        ) {
            let [u, v] = [u, v].map(Vector::<3>::from);
            prop_assume!(u.cross(&v).norm() > 0.1);
            let offset = u.cross(&v).normalize() * f64::powf(10.0, exponent);
            let (a, b) = (Capsule::new(offset - u, offset + u, 0.1), Capsule::new(-v, v, 0.1));
            let found = nearest(&a, &b);
            // The coordinates, of size 1, are rounded to 1e-16 each.
            prop_assert!(found.distance >= -0.2);
            prop_assert!((found.distance + 0.2 - offset.norm()).abs() < 2e-15);
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14);
            prop_assert!(found.normal.dot(&u).abs() < 1e-14 && found.normal.dot(&v).abs() < 1e-14);
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
