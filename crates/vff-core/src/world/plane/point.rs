//! An axis and a point: the core of a disc, by far the most frequent query.

use super::Vec2;
use super::axis::{Axis, Meets, Nearest};

impl Axis {
    /// Distance to the centre of a disc, by far the most frequent query, in closed form: never
    /// negative, because only by chance do the two meet.
    #[inline]
    pub(super) fn to_disc(self, centre: Vec2) -> Nearest {
        let offset = self.start - centre;
        let along = -self.forward.dot(offset);
        if along > 0.0 && along < self.length {
            return self.beside(offset, self.start + self.forward * along);
        }
        let end = if along > 0.0 { self.length } else { 0.0 };
        let point = self.start + self.forward * end;
        let offset = offset + self.forward * end;
        let distance = offset.length();
        if distance > 0.0 {
            Nearest { distance, normal: offset / distance, point, meets: Meets::End }
        } else {
            // The centre is the end of the axis itself, or nothing at all (NaN).
            Nearest { distance, ..self.beside(offset, point) }
        }
    }

    /// The distance of [`to_disc`](Self::to_disc), bit for bit.
    #[inline(always)]
    pub(super) fn distance_to_disc(self, centre: Vec2) -> f64 {
        let offset = self.start - centre;
        let along = -self.forward.dot(offset);
        if along > 0.0 && along < self.length {
            return self.left().dot(offset).abs();
        }
        let end = if along > 0.0 { self.length } else { 0.0 };
        (offset + self.forward * end).length()
    }
}

#[cfg(test)]
mod tests {
    use super::super::Shape;
    use super::super::oracle::*;
    use super::*;
    use crate::math::Vector;
    use parry2d_f64::shape::Segment;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_1_SQRT_2;

    /// The point of an axis nearest to (x, y) as parry has it.
    fn projected(axis: &Axis, x: f64, y: f64) -> Nearest {
        use parry2d_f64::query::PointQuery;
        let centre = Vec2::new(x, y);
        let segment = Segment::new(axis.start, axis.end());
        let point = segment.project_local_point(centre, true).point;
        let offset = point - centre;
        let distance = offset.length();
        Nearest { distance, normal: offset / distance, point, meets: Meets::End }
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        /// The closed form for discs and parry's projection, to 1e-12.
        #[test]
        fn disc_agrees_with_parry(link in any_link(), x in -4.0..4.0, y in -4.0..4.0) {
            let axis = Axis::new(&link);
            let (found, expected) = (axis.to_disc(Vec2::new(x, y)), projected(&axis, x, y));
            prop_assert!((found.distance - expected.distance).abs() < 1e-12);
            prop_assert!((found.point - expected.point).length() < 1e-12);
            prop_assert!((found.normal - expected.normal).length() * found.distance < 1e-12);
        }
    }

    #[test]
    fn disc_beside_and_beyond_a_link() {
        let link = capsule([0.0, 0.0], [2.0, 0.0], 0.1);
        let disc = |position| fixed(Shape::Circle { radius: 0.5 }, position, 0.0);

        let beside = contact(&link, &disc([0.5, 2.0]));
        assert!((beside.distance - 1.4).abs() < 1e-15);
        assert_near(beside.normal, vec2(0.0, -1.0));
        assert_near(beside.point, vec2(0.5, 0.0));
        assert_near(beside.witness, vec2(0.5, 1.5));

        let beyond = contact(&link, &disc([5.0, 4.0]));
        assert!((beyond.distance - 4.4).abs() < 1e-15);
        assert_near(beyond.normal, vec2(-0.6, -0.8));
        assert_near(beyond.point, vec2(2.0, 0.0));
        assert_near(beyond.witness, vec2(4.7, 3.6));
    }

    #[test]
    fn centre_on_the_axis_gives_the_left_normal() {
        let link = capsule([0.0, 0.0], [1.0, 1.0], 0.1);
        let left = vec2(-FRAC_1_SQRT_2, FRAC_1_SQRT_2);
        for position in [[0.5, 0.5], [0.0, 0.0], [1.0, 1.0]] {
            let found = contact(&link, &fixed(Shape::Circle { radius: 0.5 }, position, 0.0));
            assert!((found.distance + 0.6).abs() < 1e-15);
            assert_near(found.normal, left);
            assert_near(found.point, Vector::from(position));
        }
    }
}
