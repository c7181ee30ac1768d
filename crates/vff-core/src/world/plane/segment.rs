//! An axis and a segment: the core of a capsule.

use super::Vec2;
use super::axis::{Axis, Meets, Nearest};
use super::face::Face;
use crate::world::TOUCHING;

impl Axis {
    /// Signed distance to a segment: [`to_convex`](Self::to_convex) for a polygon with two edges,
    /// there and back.
    #[inline(never)]
    pub(super) fn to_segment(self, core: &Face) -> Nearest {
        let (a, b, c, d) = (self.start, self.end(), core.start, core.end());
        let left = self.left();
        let undefined = Nearest { distance: f64::NAN, normal: left, point: a, meets: Meets::Side };
        if !(a.is_finite() && b.is_finite()) {
            return undefined;
        }
        // How far the ends of each lie to one side of the other, and of the core along the axis.
        let (at_a, at_b) = (core.height(a), core.height(b));
        let (at_c, at_d) = (left.dot(c - a), left.dot(d - a));
        let (along_c, along_d) = (self.forward.dot(c - a), self.forward.dot(d - a));

        // The greater gap of the two sides, and the end that it is measured at: by selection, for
        // no processor can foresee the branches.
        let gap = |first: f64, second: f64, normal: Vec2, ends: [Vec2; 2], meets: Meets| {
            let (low, high) = (first.min(second), first.max(second));
            let side = if low >= -high { 1.0 } else { -1.0 };
            let first_is_nearer = side * first <= side * second;
            Nearest {
                distance: low.max(-high),
                normal: normal * side,
                point: if first_is_nearer { ends[0] } else { ends[1] },
                meets,
            }
        };
        let face = gap(at_a, at_b, core.normal, [a, b], Meets::Face);
        let flank = gap(at_c, at_d, -left, [c - left * at_c, d - left * at_d], Meets::Side);
        let lengthwise = (-along_c.max(along_d)).max(along_c.min(along_d) - self.length);
        let overlapping = if face.distance >= flank.distance { face } else { flank };
        if overlapping.distance.max(lengthwise) <= TOUCHING {
            return overlapping;
        }

        // Apart: nearest at an end of the link or at an end of the core.
        let beyond = |along: f64| (-along).max(along - self.length).max(0.0);
        let (beyond_c, beyond_d) = (beyond(along_c), beyond(along_d));
        let c_is_nearer = at_c * at_c + beyond_c * beyond_c <= at_d * at_d + beyond_d * beyond_d;
        let vertex = self.to_disc(if c_is_nearer { c } else { d });
        let faces_edge = face.distance > 0.0 && core.is_below(face.point);
        if faces_edge && face.distance <= vertex.distance { face } else { vertex }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Shape;
    use super::super::face::faces;
    use super::super::oracle::*;
    use super::*;
    use parry2d_f64::shape::Segment;
    use proptest::prelude::*;

    properties! {
        #![proptest_config(ProptestConfig { max_global_rejects: 10_000, ..ProptestConfig::with_cases(1000) })]


        /// The closed form for segments and parry's, to 1e-12 (not nearly parallel, where parry's
        /// errs, see `nearly_parallel_segments_are_exact`), and the general form, to rounding.
        #[test]
        fn segment_agrees_with_parry_and_with_the_general_form(
            link in any_link(), other in any_link(),
        ) {
            use parry2d_f64::{math::Pose, query};
            let (axis, core) = (Axis::new(&link), Axis::new(&other));
            let there_and_back = faces(&[core.start, core.end()]);
            let found = axis.to_segment(&there_and_back[0]);
            let general = axis.to_convex(&there_and_back);
            prop_assert!((found.distance - general.distance).abs() < 1e-14);
            prop_assert!((found.point - general.point).length() < 1e-13);
            prop_assert!((found.normal - general.normal).length() < 1e-12);

            prop_assume!(axis.forward.perp_dot(core.forward).abs() > 1e-3);
            let segment = |axis: &Axis| Segment::new(axis.start, axis.end());
            let expected =
                query::distance(&Pose::IDENTITY, &segment(&axis), &Pose::IDENTITY, &segment(&core))
                    .unwrap()
                    .distance;
            prop_assert!((found.distance.max(0.0) - expected).abs() < 1e-12,
                "{found:?} is not {expected}");
        }

        #[test]
        fn nearly_parallel_segments_are_exact(
            exponent in -17.0..0.0, offset in -2.0..2.0, gap in -1e-3..1e-3, length in 0.01..2.0,
        ) {
            // Where the closed form for two lines divides by almost zero.
            let link = capsule([0.0, 0.0], [1.0, 0.0], 0.0);
            let angle = f64::powf(10.0, exponent);
            let b = [length * angle.cos(), length * angle.sin()];
            let obstacle = fixed(
                Shape::Capsule { a: [0.0, 0.0], b, radius: 0.0 }, [offset, gap], 0.0,
            );
            let expected = searched_distance(&link, &corners(&obstacle));
            let found = contact(&link, &obstacle);
            prop_assert!((found.distance.max(0.0) - expected).abs() < 1e-12,
                "{} is not {expected}", found.distance);
        }
    }

    #[test]
    fn crossing_a_capsule_leaves_the_shorter_way() {
        let link = capsule([0.0, -1.0], [0.0, 3.0], 0.0);
        let bar = |a, b| Shape::Capsule { a: [a, 0.0], b: [b, 0.0], radius: 0.1 };
        for (a, b, depth, normal) in [
            (-2.0, 0.5, 0.5, vec2(1.0, 0.0)),
            (-0.5, 2.0, 0.5, vec2(-1.0, 0.0)),
            (-2.0, 2.0, 1.0, vec2(0.0, 1.0)),
        ] {
            let found = contact(&link, &fixed(bar(a, b), [0.0, 0.0], 0.0));
            assert!((found.distance + depth + 0.1).abs() < 1e-15);
            assert_near(found.normal, normal);
        }
    }

    #[test]
    fn collinear_segments_apart() {
        let bar = Shape::Capsule { a: [-1.0, 0.0], b: [1.0, 0.0], radius: 0.0 };
        let found = contact(&capsule([6.0, 0.0], [4.0, 0.0], 0.0), &fixed(bar, [0.0; 2], 0.0));
        assert!((found.distance - 3.0).abs() < 1e-15);
        assert_near(found.normal, vec2(1.0, 0.0));
        assert_near(found.point, vec2(4.0, 0.0));
        assert_near(found.witness, vec2(1.0, 0.0));
    }
}
