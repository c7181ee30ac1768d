//! An axis and a box.

use super::{ConvexCore, around};
use crate::geometry::axis::{Nearest, PARALLEL, Probe, across, across_normal, within};
use crate::geometry::{Convex, Onward};
use crate::math::{UnitQuaternion, Vector};
use crate::world::{Feature, TOUCHING};
use nalgebra::Matrix3;

/// Gaps above this \[m\] are not due to rounding at any size that a scene has.
const NEAR: f64 = 1e-6;
/// Share of the largest coordinate by which a gap may be off.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A box around the obstacle's position.
#[derive(Debug, Clone)]
pub(in super::super) struct Cuboid {
    /// Its axes as columns.
    axes: Matrix3<f64>,
    /// Half the lengths of its edges \[m\].
    half: Vector<3>,
}

/// The nearest point of an axis, in the frame of the box.
struct Found {
    distance: f64,
    /// Where on the axis \[m\].
    along: f64,
    /// What of the box, and a vector from there to the axis or a normal.
    part: Part,
}

/// What is nearest of the box.
enum Part {
    /// A side. With its normal.
    Side(Vector<3>),
    /// An edge along the axis with this number.
    Edge(usize, Vector<3>),
    Corner(Vector<3>),
    /// The edges along the axis with this number, for one that overlaps the box. With a unit vector across both.
    Across(usize, Vector<3>),
}

/// d × e_k.
#[inline(always)]
fn cross(d: &Vector<3>, k: usize) -> Vector<3> {
    match k {
        0 => Vector::<3>::new(0.0, d.z, -d.y),
        1 => Vector::<3>::new(-d.z, 0.0, d.x),
        _ => Vector::<3>::new(d.y, -d.x, 0.0),
    }
}

impl Cuboid {
    /// With edges of full lengths `size` \[m\], turned.
    pub(super) fn new(size: &[f64; 3], turn: &UnitQuaternion) -> Self {
        let half = Vector::from(size.map(|length| 0.5 * length));
        Self { axes: turn.matrix(), half }
    }

    /// A link as the box sees it.
    #[inline(always)]
    fn turned(&self, axis: &Probe) -> Probe {
        let turn = |v: &Vector<3>| self.axes.tr_mul(v);
        Probe { start: turn(&axis.start), direction: turn(&axis.direction), ..*axis }
    }

    /// The box's axis number `k` in the world.
    fn axis(&self, k: usize) -> Vector<3> {
        self.axes.column(k).into_owned()
    }

    /// How far `point` lies beyond the sides, along each axis of the box.
    #[inline(always)]
    fn excess(&self, point: &Vector<3>) -> Vector<3> {
        point.zip_map(&self.half, |x, half| x - x.max(-half).min(half))
    }

    /// Signed distance of an axis.
    #[inline(never)]
    fn nearest(&self, axis: &Probe) -> Nearest {
        let local = self.turned(axis);
        let Found { distance, along, part } = self.find(&local);
        let inside = 0.0 < along && along < axis.length;
        let (normal, feature) = match part {
            Part::Side(normal) => (normal, Feature::Face),
            Part::Edge(k, between) => {
                let (edge, cross) = (self.axis(k), cross(&local.direction, k));
                if !inside {
                    (between / between.norm(), Feature::Edge { edge, distance })
                } else if cross.norm() > PARALLEL {
                    let normal = across_normal(&cross, &between);
                    (normal, Feature::Crossing { edge, distance })
                } else {
                    (across_normal(&cross, &between), Feature::Side { distance })
                }
            }
            Part::Across(k, normal) if cross(&local.direction, k).norm() > PARALLEL => {
                (normal, Feature::Crossing { edge: self.axis(k), distance })
            }
            Part::Across(_, normal) => (normal, Feature::Face),
            Part::Corner(between) => {
                let feature =
                    if inside { Feature::Side { distance } } else { Feature::End { distance } };
                (between / between.norm(), feature)
            }
        };
        let point = axis.start + axis.direction * along;
        Nearest { distance, normal: self.axes * normal, point, feature }
    }

    /// The distance of [`nearest`](Self::nearest), bit for bit.
    #[inline(never)]
    fn distance(&self, axis: &Probe) -> f64 {
        self.find(&self.turned(axis)).distance
    }

    /// Along the axis the squared distance is convex, once differentiable and quadratic between the places where the axis
    /// passes through the plane of a side: its slope, at these, says between which of them it is least (T94).
    #[inline(always)]
    fn find(&self, axis: &Probe) -> Found {
        let Probe { start: p, direction: d, length, .. } = *axis;
        let (mut low, mut high) = (0.0, length);
        for k in 0..3 {
            for side in [-self.half[k], self.half[k]] {
                let s = (side - p[k]) / d[k];
                // False for sides that the axis is parallel to.
                if low < s && s < high {
                    if d.dot(&self.excess(&(p + d * s))) < 0.0 {
                        low = s;
                    } else {
                        high = s;
                    }
                }
            }
        }
        // Between those, the same sides are passed everywhere.
        let middle = self.excess(&(p + d * (0.5 * (low + high))));
        let beyond = middle.map(|x| f64::from(u8::from(x != 0.0)));
        let side = self.half.zip_map(&middle, f64::copysign);
        let offset = (p - side).component_mul(&beyond);
        let towards = d.component_mul(&beyond);
        let curvature = towards.norm_squared();
        let least = -towards.dot(&offset) / curvature;
        let along = if curvature > 0.0 { least.max(low).min(high) } else { low };
        let between = offset + towards * along;
        let sides = beyond.sum();
        let gap = between.norm();
        // Far coordinates are rounded more than that: an axis that pierces a plate would seem to touch it.
        if gap <= TOUCHING || gap < NEAR && gap <= ROUNDING * (p.amax() + length + self.half.max())
        {
            return self.way_out(axis);
        }
        if sides > 2.0 {
            return Found { distance: gap, along, part: Part::Corner(between) };
        }
        if sides < 2.0 {
            return Found { distance: gap, along, part: Part::Side(between / gap) };
        }
        let k = beyond.imin();
        if along <= 0.0 || along >= length {
            return Found { distance: gap, along, part: Part::Edge(k, between) };
        }
        // Where the edge ends, the lines would come nearer still.
        if along <= low || along >= high {
            return Found { distance: gap, along, part: Part::Corner(between) };
        }
        Found { distance: across(&cross(&d, k), &between), along, part: Part::Edge(k, between) }
    }

    /// The shortest way out for an axis that overlaps the box: through the side or across the edges, of all that the sum
    /// of both bodies has, along whose normal the least is to go (T95).
    #[inline(never)]
    fn way_out(&self, axis: &Probe) -> Found {
        let Probe { start: p, direction: d, length, .. } = *axis;
        let end = p + d * length;
        let mut best = Found { distance: f64::NEG_INFINITY, along: 0.0, part: Part::Side(p) };
        for k in 0..3 {
            for sign in [1.0, -1.0] {
                let (at_start, at_end) = (sign * p[k], sign * end[k]);
                let (lower, along) =
                    if at_end < at_start { (at_end, length) } else { (at_start, 0.0) };
                let distance = lower - self.half[k];
                if distance > best.distance {
                    let mut normal = Vector::zeros();
                    normal[k] = sign;
                    best = Found { distance, along, part: Part::Side(normal) };
                }
            }
        }
        for k in 0..3 {
            let cross = cross(&d, k);
            let sin = cross.norm();
            // A link of length 0 has no direction. An axis along an edge crosses none.
            if sin <= f64::MIN_POSITIVE || length <= 0.0 {
                continue;
            }
            let height = cross.dot(&p) / sin;
            let normal = cross * (1f64.copysign(height) / sin);
            let distance = height.abs() - normal.abs().dot(&self.half);
            if distance > best.distance {
                // The foot of the edge that is supporting along the normal.
                let mut offset = self.half.zip_map(&normal, f64::copysign) - p;
                offset[k] = 0.0;
                let along = within(d.dot(&offset) / (sin * sin), length);
                best = Found { distance, along, part: Part::Across(k, normal) };
            }
        }
        best
    }
}

impl Cuboid {
    /// The signs of the coordinates of the corners.
    fn corners(&self) -> impl Iterator<Item = Vector<3>> {
        let sign = |bit: u8| if bit == 0 { -1.0 } else { 1.0 };
        (0..8u8).map(move |i| Vector::<3>::new(sign(i & 1), sign(i & 2), sign(i & 4)))
    }

    /// Of every edge the axis that it is along, and the signs of its other coordinates.
    fn edges(&self) -> impl Iterator<Item = (usize, Vector<3>)> {
        (0..3).flat_map(|k| {
            self.corners().filter(move |corner| corner[k] < 0.0).map(move |mut corner| {
                corner[k] = 0.0;
                (k, corner)
            })
        })
    }

    fn at(&self, signs: &Vector<3>) -> Vector<3> {
        self.axes * self.half.component_mul(signs)
    }
}

impl Convex for Cuboid {
    fn nearest(&self, axis: &Probe) -> Nearest {
        Self::nearest(self, axis)
    }

    fn offset(&self, point: &Vector<3>) -> Vector<3> {
        self.axes * self.excess(&self.axes.tr_mul(point))
    }

    fn farthest(&self, direction: &Vector<3>) -> Vector<3> {
        let along = self.axes.tr_mul(direction);
        self.axes * self.half.zip_map(&along, f64::copysign)
    }

    fn for_each_corner(&self, mut visit: impl FnMut(&Vector<3>, Onward<'_>)) {
        for outward in self.corners() {
            visit(&self.at(&outward), Onward::Against(&self.axes, outward));
        }
    }

    fn for_each_edge(&self, mut visit: impl FnMut(&Probe, Onward<'_>)) {
        for (k, outward) in self.edges() {
            let mut start = outward;
            start[k] = -1.0;
            let (direction, length) = (self.axis(k), 2.0 * self.half[k]);
            let edge = Probe { start: self.at(&start), direction, length, radius: 0.0 };
            visit(&edge, Onward::Against(&self.axes, outward));
        }
    }

    fn for_each_face(&self, mut visit: impl FnMut(&Vector<3>, f64)) {
        for k in 0..3 {
            let normal = self.axis(k);
            visit(&normal, self.half[k]);
            visit(&-normal, self.half[k]);
        }
    }
}

impl ConvexCore for Cuboid {
    #[inline(always)]
    fn distance(&self, axis: &Probe) -> f64 {
        Self::distance(self, axis)
    }

    fn features(&self) -> Option<usize> {
        Some(8 + 12)
    }

    fn extent(&self, radius: f64) -> [Vector<3>; 2] {
        around(Vector::zeros(), self.axes.abs() * self.half, radius)
    }

    fn reach(&self) -> f64 {
        self.half.norm()
    }

    /// The ray is inside between the last side that it enters and the first that it leaves.
    fn cast(&self, origin: &Vector<3>, direction: &Vector<3>, _: f64, _: f64) -> Option<f64> {
        let (p, d) = (self.axes.tr_mul(origin), self.axes.tr_mul(direction));
        let (mut enters, mut leaves) = (0f64, f64::INFINITY);
        for k in 0..3 {
            let half = self.half[k];
            if d[k] == 0.0 {
                if p[k].abs() > half {
                    return None;
                }
                continue;
            }
            let (a, b) = ((-half - p[k]) / d[k], (half - p[k]) / d[k]);
            enters = enters.max(a.min(b));
            leaves = leaves.min(a.max(b));
        }
        (enters <= leaves).then_some(enters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::space::oracle::*;
    use crate::world::space::{Obstacle, Shape};
    use parry3d_f64::math::{Pose, Rotation, Vector as Vec3d};
    use parry3d_f64::{query, shape};
    use proptest::prelude::*;

    properties! {
        #![proptest_config(ProptestConfig::with_cases(1500))]

        #[test]
        fn agrees_with_parry(
            link in any_link(), size in [0.05..2.0, 0.05..2.0, 0.05..2.0], orientation in any_orientation(),
        ) {
            let glam = |v: Vec3| Vec3d::new(v.x, v.y, v.z);
            let segment = shape::Segment::new(glam(link.start), glam(link.end()));
            let cuboid = shape::Cuboid::new(glam(Vec3::from(size) * 0.5));
            let [w, x, y, z] = orientation;
            let pose = Pose::from_parts(Vec3d::new(0.3, -0.2, 0.1), Rotation::from_xyzw(x, y, z, w));
            let expected =
                query::distance(&Pose::IDENTITY, &segment, &pose, &cuboid).unwrap().distance;
            let obstacle = Obstacle { orientation, ..fixed(Shape::Box { size }, [0.3, -0.2, 0.1]) };
            let found = contact(&link, &obstacle);
            prop_assert!(((found.distance + link.radius).max(0.0) - expected).abs() < 1e-7);
        }

        /// Almost along a side or an edge, close by, through or inside.
        #[test]
        fn nearly_parallel_axes_are_exact(
            k in 0usize..3, tilt in three(1.0), exponent in -18.0..0.0, height_exponent in -12.0..0.0,
            start in three(1.5), length in 0.1..3.0, side in prop::bool::ANY,
        ) {
            let mut way = tilt * f64::powf(10.0, exponent);
            way[k] = 1.0;
            let mut start = start;
            // Beside a side or an edge.
            start[(k + 1) % 3] = 0.5 + f64::powf(10.0, height_exponent);
            if side {
                start[(k + 2) % 3] = 0.5 + f64::powf(10.0, height_exponent);
            }
            let link = Probe { start, direction: way.normalize(), length, radius: 0.0 };
            let obstacle = fixed(Shape::Box { size: [1.0; 3] }, [0.0; 3]);
            let found = contact(&link, &obstacle);
            let expected = searched_distance(&link, &obstacle);
            prop_assert!((found.distance.max(0.0) - expected).abs() < 1e-14, "{found:?} is not {expected}");
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14);
        }
    }

    /// From a millimetre to a hundred kilometres.
    fn any_size() -> impl Strategy<Value = f64> {
        (-3.0..5.0).prop_map(|exponent| f64::powf(10.0, exponent))
    }

    /// Signed, of an axis: by search along it outside, inside the most that a plane across a normal of either keeps. The
    /// search ends at the border of an overlap, up to the rounding of coordinates of a `scale` \[m\].
    fn expected_distance(link: &Probe, obstacle: &Obstacle, scale: f64) -> f64 {
        let outside = searched_distance(link, obstacle);
        let turn = rotation(obstacle);
        let sides = [0, 1, 2].map(|k| turn.matrix().column(k).into_owned());
        let crossed = sides.map(|edge| link.direction.cross(&edge));
        let normals = sides.into_iter().chain(crossed).filter_map(|n| n.try_normalize(1e-12));
        let gaps = normals
            .flat_map(|n| [n, -n])
            .map(|n| n.dot(&link.start).min(n.dot(&link.end())) - support(obstacle, &n));
        let inside = gaps.fold(f64::NEG_INFINITY, f64::max);
        if outside > 1e-14 * scale { outside } else { inside }
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        /// As exact as the coordinates are, whatever is how much larger than the other or than the gap.
        #[test]
        fn sizes_of_a_millimetre_and_of_a_hundred_kilometres_meet(
            size in [any_size(), any_size(), any_size()], orientation in any_orientation(),
            on_box in three(0.5), gap in any_size(), touching in prop::bool::ANY, way in direction(), aside in direction(),
            length in any_size(), share in -0.2..1.2, radius in 0.0..0.3,
        ) {
            let obstacle = Obstacle { orientation, ..fixed(Shape::Box { size }, [0.0; 3]) };
            let place = rotation(&obstacle) * Vec3::from(size).component_mul(&on_box);
            let place = place + aside * if touching { 0.0 } else { gap };
            let link = Probe { start: place - way * (share * length), direction: way, length, radius };
            let found = contact(&link, &obstacle).distance + radius;
            let scale = link.start.norm().max(link.end().norm()).max(Vec3::from(size).norm()).max(1.0);
            let expected = expected_distance(&link, &obstacle, scale);
            prop_assert!((found - expected).abs() < 1e-14 * scale, "{found} is not {expected}, of {scale} m");
        }
    }

    /// A capsule of a kilometre passes a box of 0.3 m.
    #[test]
    fn a_kilometre_beside_a_box() {
        let obstacle = fixed(Shape::Box { size: [0.3; 3] }, [0.0; 3]);
        for aside in [1.0, 2.08, 500.0] {
            let link = capsule([-500.0, aside, 0.1], [500.0, aside, -0.1], 0.05);
            let found = contact(&link, &obstacle).distance;
            assert!((found - (aside - 0.2)).abs() < 1e-13 * aside, "{found}");
            // Askew: it comes nearest to a corner or an edge.
            let link = capsule([-300.0, aside - 400.0, 0.1], [300.0, aside + 400.0, 0.3], 0.05);
            let (found, expected) = (
                contact(&link, &obstacle).distance + 0.05,
                expected_distance(&link, &obstacle, 500.0),
            );
            assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
        }
    }

    #[test]
    fn from_outside_to_inside() {
        let obstacle = fixed(Shape::Box { size: [2.0, 4.0, 6.0] }, [1.0, 1.0, 1.0]);
        for (x, distance) in [(5.0, 3.0), (2.0, 0.0), (1.75, -0.25)] {
            let found = contact(&capsule([x, 0.5, 0.0], [x + 1.0, 2.0, 1.0], 0.0), &obstacle);
            assert!((found.distance - distance).abs() < 1e-15);
            assert_near(found.normal, vec3(1.0, 0.0, 0.0));
            assert_near(found.point, vec3(x, 0.5, 0.0));
            assert_near(found.witness, vec3(2.0, 0.5, 0.0));
            assert_eq!(found.feature, Feature::Face);
        }
    }

    #[test]
    fn what_meets_what() {
        let obstacle = fixed(Shape::Box { size: [2.0; 3] }, [0.0; 3]);
        let meets = |start, end| contact(&capsule(start, end, 0.0), &obstacle).feature;
        let edge = vec3(0.0, 0.0, 1.0);
        let root = 2f64.sqrt();
        assert_eq!(meets([2.0, 0.0, 0.3], [3.0, 0.1, 0.5]), Feature::Face);
        assert_eq!(meets([2.0, 2.0, 0.3], [3.0, 4.0, 0.5]), Feature::Edge { edge, distance: root });
        let Feature::Crossing { edge: found, distance } = meets([1.0, 3.0, 0.3], [3.0, 1.0, 0.5])
        else {
            panic!("no crossing");
        };
        assert!(found == edge && (distance - root).abs() < 1e-15);
        assert_eq!(meets([2.0, 2.0, 2.0], [3.0, 4.0, 5.0]), Feature::End { distance: 3f64.sqrt() });
        let Feature::Side { distance } = meets([0.0, 2.5, 2.0], [4.0, 1.5, 2.0]) else {
            panic!("no corner");
        };
        assert!(
            (distance
                - searched_distance(&capsule([0.0, 2.5, 2.0], [4.0, 1.5, 2.0], 0.0), &obstacle))
            .abs()
                < 1e-14
        );
        // Through the box close to an edge: out across it.
        let Feature::Crossing { edge: found, distance } = meets([0.5, 2.0, 0.3], [2.0, 0.5, 0.4])
        else {
            panic!("no way out across the edge");
        };
        assert!(found == edge && distance > 0.0);
        let Feature::Crossing { edge: found, distance } = meets([0.3, 1.5, 0.3], [1.5, 0.3, 0.4])
        else {
            panic!("no way out across the edge");
        };
        assert!(found == edge && (distance + 0.1 * root).abs() < 1e-14, "{distance}");
    }
}
