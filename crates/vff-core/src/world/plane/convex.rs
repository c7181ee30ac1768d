//! An axis and a convex polygon.

use super::axis::{Axis, Meets, Nearest};
use super::face::Face;
use crate::world::TOUCHING;

impl Axis {
    /// Signed distance to a convex polygon.
    ///
    /// The gap along a direction (how far the axis lies beyond the polygon) never exceeds the
    /// signed distance. Overlapping bodies have the greatest gap, the one nearest to zero,
    /// along a normal of one of them; it is minus the penetration depth.
    #[inline(never)]
    pub(super) fn to_convex(self, faces: &[Face]) -> Nearest {
        let (a, b) = (self.start, self.end());
        let left = self.left();
        let undefined = Nearest { distance: f64::NAN, normal: left, point: a, meets: Meets::Side };
        if !(a.is_finite() && b.is_finite()) {
            return undefined;
        }

        // One pass over the polygon: the greatest gap along its normals, its extent across and
        // along the axis, its vertex nearest to the axis.
        let mut face = Nearest { distance: f64::NEG_INFINITY, meets: Meets::Face, ..undefined };
        let mut faces_edge = false;
        let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
        let (mut rear, mut front) = (f64::INFINITY, f64::NEG_INFINITY);
        let (mut low_vertex, mut high_vertex) = (a, a);
        let (mut least_squared, mut near_vertex) = (f64::INFINITY, a);
        let length = self.length;
        for candidate in faces {
            let (at_a, at_b) = (candidate.height(a), candidate.height(b));
            let (gap, end) = if at_b < at_a { (at_b, b) } else { (at_a, a) };
            if gap > face.distance {
                face = Nearest { distance: gap, normal: candidate.normal, point: end, ..face };
                faces_edge = gap > 0.0 && candidate.is_below(end);
            }

            let vertex = candidate.start;
            let (height, along) = (left.dot(vertex - a), self.forward.dot(vertex - a));
            if height < lowest {
                (lowest, low_vertex) = (height, vertex);
            }
            if height > highest {
                (highest, high_vertex) = (height, vertex);
            }
            rear = rear.min(along);
            front = front.max(along);
            let beyond = (-along).max(along - length).max(0.0);
            let squared = height * height + beyond * beyond;
            if squared < least_squared {
                (least_squared, near_vertex) = (squared, vertex);
            }
        }
        // The axis lies to the left of the polygon by −highest, to its right by lowest.
        let flank = if -highest >= lowest {
            let point = high_vertex - left * highest;
            Nearest { distance: -highest, normal: left, point, ..undefined }
        } else {
            let point = low_vertex - left * lowest;
            Nearest { distance: lowest, normal: -left, point, ..undefined }
        };
        // A gap along the axis matters only beside an edge parallel to it (a segment in line
        // with the link), where no normal separates.
        let lengthwise = (-front).max(rear - length);

        let overlapping = if face.distance >= flank.distance { face } else { flank };
        if overlapping.distance.max(lengthwise) <= TOUCHING {
            return overlapping;
        }
        // Apart: nearest between an end of the axis and the inside of an edge, which then is
        // the edge with the greatest gap, or at a vertex of the polygon.
        let vertex = self.to_disc(near_vertex);
        if faces_edge && face.distance <= vertex.distance { face } else { vertex }
    }
}

#[cfg(test)]
mod tests {
    use super::super::oracle::*;
    use super::super::{Shape, Vec2, to_glam};
    use crate::math::{Capsule, Vector, perp};
    use parry2d_f64::shape::Segment;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    properties! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        #[test]
        fn agrees_with_parry(link in any_link(), size in [0.05..2.0, 0.05..2.0], angle in -PI..PI) {
            use parry2d_f64::{math::Pose, query, shape::Cuboid};
            let segment = Segment::new(to_glam(link.start), to_glam(link.end()));
            let cuboid = Cuboid::new(Vec2::new(0.5 * size[0], 0.5 * size[1]));
            let pose = Pose::new(Vec2::new(0.3, -0.2), angle);
            let expected = query::distance(&Pose::IDENTITY, &segment, &pose, &cuboid)
                .unwrap()
                .distance;
            let found = contact(&link, &fixed(Shape::Box { size }, [0.3, -0.2], angle));
            prop_assert!(((found.distance + link.radius).max(0.0) - expected).abs() < 1e-10);
        }
    }

    /// From a millimetre to a hundred kilometres.
    fn any_size() -> impl Strategy<Value = f64> {
        (-3.0..5.0).prop_map(|exponent| f64::powf(10.0, exponent))
    }

    /// Signed, of an axis: by search along it outside, inside the most that a line across a normal of either keeps. The
    /// search ends at the border of an overlap, up to the rounding of coordinates of a `scale` \[m\].
    fn expected_distance(link: &Capsule<2>, corners: &[Vector<2>], scale: f64) -> f64 {
        let outside = searched_distance(link, corners);
        let n = corners.len();
        let edges = (0..n).map(|i| (corners[(i + 1) % n] - corners[i]).normalize());
        let gaps = edges.chain([link.end() - link.start]).flat_map(|along| {
            let normal = perp(along.normalize());
            [normal, -normal]
        });
        let gaps = gaps.map(|normal| {
            let far =
                corners.iter().map(|corner| normal.dot(corner)).fold(f64::NEG_INFINITY, f64::max);
            normal.dot(&link.start).min(normal.dot(&link.end())) - far
        });
        if outside > 1e-14 * scale { outside } else { gaps.fold(f64::NEG_INFINITY, f64::max) }
    }

    /// As exact as the coordinates are.
    fn check(
        shape: Shape,
        gap: f64,
        [aside, way]: [f64; 2],
        length: f64,
        share: f64,
    ) -> Result<(), TestCaseError> {
        let obstacle = fixed(shape, [0.0; 2], 0.0);
        let corners = corners(&obstacle);
        let toward = |angle: f64| rotated(vec2(1.0, 0.0), angle);
        let start = corners[0] + toward(aside) * gap - toward(way) * (share * length);
        let link = Capsule::new(start, start + toward(way) * length, 0.02);
        let found = contact(&link, &obstacle).distance + 0.02;
        let points = corners.iter().copied().chain([link.start, link.end()]);
        let scale = points.map(|point| point.norm()).fold(1.0, f64::max);
        let expected = expected_distance(&link, &corners, scale);
        prop_assert!(
            (found - expected).abs() < 1e-14 * scale,
            "{found} is not {expected}, of {scale} m"
        );
        Ok(())
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        /// Whatever is how much larger than the other or than the gap.
        #[test]
        fn sizes_of_a_millimetre_and_of_a_hundred_kilometres_meet(
            size in [any_size(), any_size()], polygon in any_polygon(), by in any_size(), gap in any_size(),
            angles in [-PI..PI, -PI..PI], length in any_size(), share in -0.2..1.2,
        ) {
            check(Shape::Box { size }, gap, angles, length, share)?;
            check(Shape::Box { size }, 0.0, angles, length, share)?;
            let Shape::Polygon { mut vertices } = polygon else { unreachable!("a polygon was drawn") };
            vertices.iter_mut().flatten().for_each(|x| *x *= by);
            check(Shape::Polygon { vertices }, gap, angles, length, share)?;
        }
    }

    #[test]
    fn box_from_outside_to_inside() {
        let side = fixed(Shape::Box { size: [2.0, 4.0] }, [1.0, 1.0], 0.0);
        for (x, distance) in [(5.0, 3.0), (2.0, 0.0), (1.75, -0.25)] {
            let found = contact(&capsule([x, 0.5], [x + 1.0, 2.0], 0.0), &side);
            assert!((found.distance - distance).abs() < 1e-15);
            assert_near(found.normal, vec2(1.0, 0.0));
            assert_near(found.point, vec2(x, 0.5));
            assert_near(found.witness, vec2(2.0, 0.5));
        }
        // Turned by 90°, width and height change places.
        let turned = fixed(Shape::Box { size: [4.0, 2.0] }, [1.0, 1.0], 0.5 * PI);
        let found = contact(&capsule([5.0, 0.5], [6.0, 2.0], 0.0), &turned);
        assert!((found.distance - 3.0).abs() < 1e-15);
    }
}
