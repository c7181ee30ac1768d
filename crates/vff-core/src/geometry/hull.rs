//! An axis and a convex polyhedron, the hull of points.

mod build;
mod enclosing;
mod farthest;

pub use build::{HullError, MAX_CORNERS, check_hull, faces_of_hull};
pub(crate) use enclosing::{box_around, extent};

use farthest::Farthest;

use super::axis::{Nearest, PARALLEL, Probe, within};
use super::segment::{Feet, between, feet};
use crate::math::{Capsule, Feature, TOUCHING, Vector};
use std::sync::Arc;

/// The convex hull of points: a polyhedron, at rest in its own frame. A clone shares all of it.
///
/// # Example
/// ```
/// use vff_core::geometry::Hull;
///
/// let mut corners = vec![];
/// for (x, y, z) in [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)] {
///     corners.push([x, y, z].map(f64::from));
/// }
/// assert_eq!(Hull::new(&corners).unwrap().edge_count(), 6);
/// assert!(Hull::new(&corners[..3]).is_err());
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Hull<const D: usize = 3> {
    pub(crate) corners: Arc<[Corner<D>]>,
    farthest: Farthest,
    pub(crate) edges: Arc<[Edge<D>]>,
    /// At most as many as there are bits in [`Facing`].
    pub(crate) faces: Arc<[Face<D>]>,
    /// What rounding may make of a height \[m\].
    pub(crate) slack: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Corner<const D: usize> {
    pub(crate) point: Vector<D>,
    /// Unit vectors along the edges that meet here, away from it.
    pub(crate) along: Vec<Vector<D>>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Edge<const D: usize> {
    pub(crate) line: Capsule<D>,
    /// The corners that it leads from and to.
    pub(crate) ends: [usize; 2],
    /// The faces that meet here.
    faces: [usize; 2],
    /// Unit vectors across the edge, into each of them.
    pub(crate) into: [Vector<D>; 2],
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Face<const D: usize> {
    /// Unit vector, outward.
    pub(crate) normal: Vector<D>,
    /// Of its plane from the origin \[m\].
    pub(crate) offset: f64,
    /// The edges around it, and which of their faces it is.
    border: Vec<(usize, usize)>,
}

/// Which faces an axis is above, somewhere.
type Facing = u128;

/// Where an axis and the hull come nearest.
struct Found {
    distance: f64,
    part: Part,
}

/// What is nearest of the hull.
enum Part {
    /// The face with this number, to a place on the axis \[m\].
    Face(usize, f64),
    /// The edge with this number, its ends included.
    Edge(usize, Feet),
    /// The edge with this number, for an axis that overlaps the hull. With a unit vector across both and the place on the
    /// axis \[m\].
    Across(usize, Vector<3>, f64),
}

impl Face<3> {
    /// Signed distance of a point from its plane, positive outside.
    #[inline(always)]
    fn height(&self, point: &Vector<3>) -> f64 {
        self.normal.dot(point) - self.offset
    }
}

/// The face that an end of an axis is highest above, and how high.
#[derive(Clone, Copy)]
struct Highest {
    face: usize,
    height: f64,
}

impl Highest {
    const NONE: Self = Self { face: 0, height: f64::NEG_INFINITY };

    #[inline(always)]
    fn or(self, face: usize, height: f64) -> Self {
        if height > self.height { Self { face, height } } else { self }
    }
}

impl Hull {
    /// Signed distance of an axis.
    #[inline(never)]
    pub(crate) fn nearest(&self, axis: &Probe) -> Nearest {
        let Found { distance, part } = self.find(axis);
        match part {
            Part::Edge(i, feet) => between(axis, &self.edges[i].line, &feet),
            Part::Face(i, along) => {
                let (normal, point) = (self.faces[i].normal, axis.start + axis.direction * along);
                Nearest { distance, normal, point, feature: Feature::Face }
            }
            Part::Across(i, normal, along) => {
                let edge = self.edges[i].line.direction;
                let crosses = axis.direction.cross(&edge).norm() > PARALLEL;
                let feature =
                    if crosses { Feature::Crossing { edge, distance } } else { Feature::Face };
                let point = axis.start + axis.direction * along;
                Nearest { distance, normal, point, feature }
            }
        }
    }

    /// The distance of [`nearest`](Self::nearest), bit for bit.
    #[inline(never)]
    pub(crate) fn distance(&self, axis: &Probe) -> f64 {
        self.find(axis).distance
    }

    /// Whether one of its faces tells that an axis is no nearer than this \[m\].
    #[inline]
    pub(crate) fn is_farther(&self, axis: &Probe, limit: f64) -> bool {
        let (a, b, least) = (axis.start, axis.end(), limit.max(0.0) + self.slack);
        self.faces.iter().any(|face| face.height(&a).min(face.height(&b)) > least)
    }

    /// Apart, the nearest points are an end of the axis above the inside of a face, or lie on an edge that meets a face
    /// which the axis is above (T107).
    #[inline(always)]
    fn find(&self, axis: &Probe) -> Found {
        let (a, b) = (axis.start, axis.end());
        if !(a + b).sum().is_finite() {
            return Found { distance: f64::NAN, part: Part::Face(0, 0.0) };
        }
        // One pass over the faces: which may matter, the highest of each end, what they leave of the axis.
        let mut facing: Facing = 0;
        let mut highest = [Highest::NONE; 2];
        let (mut enters, mut leaves, mut apart) = (0f64, 1f64, false);
        for (i, face) in self.faces.iter().enumerate() {
            let (at_a, at_b) = (face.height(&a), face.height(&b));
            facing |= Facing::from(at_a.max(at_b) > -self.slack) << i;
            highest = [highest[0].or(i, at_a), highest[1].or(i, at_b)];
            if at_a > 0.0 {
                if at_b > 0.0 {
                    apart = true;
                } else {
                    enters = enters.max(at_a / (at_a - at_b));
                }
            } else if at_b > 0.0 {
                leaves = leaves.min(at_a / (at_a - at_b));
            }
        }
        if !apart && enters <= leaves {
            return self.way_out(axis);
        }
        let mut best = Found { distance: f64::INFINITY, part: Part::Face(0, 0.0) };
        for (Highest { face, height }, point, along) in
            [(highest[0], a, 0.0), (highest[1], b, axis.length)]
        {
            if height > 0.0 && height < best.distance && self.is_below(face, &point) {
                best = Found { distance: height, part: Part::Face(face, along) };
            }
        }
        for (i, edge) in self.edges.iter().enumerate() {
            if edge.faces.iter().any(|face| facing >> face & 1 == 1) {
                let feet = feet(axis, &edge.line);
                if feet.distance < best.distance {
                    best = Found { distance: feet.distance, part: Part::Edge(i, feet) };
                }
            }
        }
        if best.distance <= TOUCHING { self.way_out(axis) } else { best }
    }

    /// Whether the perpendicular from `point` to the plane of a face meets the face.
    #[inline]
    fn is_below(&self, face: usize, point: &Vector<3>) -> bool {
        self.faces[face].border.iter().all(|&(edge, side)| {
            let Edge { line, into, .. } = &self.edges[edge];
            into[side].dot(&(point - line.start)) >= 0.0
        })
    }

    /// The shortest way out for an axis that overlaps the hull, as for a box (T95): through a face, or across an edge of the
    /// outline that the hull has along the axis.
    #[inline(never)]
    fn way_out(&self, axis: &Probe) -> Found {
        let Probe { start: p, direction: d, length, .. } = *axis;
        let end = axis.end();
        let mut best = Found { distance: f64::NEG_INFINITY, part: Part::Face(0, 0.0) };
        for (i, face) in self.faces.iter().enumerate() {
            let (at_start, at_end) = (face.height(&p), face.height(&end));
            let (distance, along) =
                if at_end < at_start { (at_end, length) } else { (at_start, 0.0) };
            if distance > best.distance {
                best = Found { distance, part: Part::Face(i, along) };
            }
        }
        // A link of length 0 has no direction.
        if length <= 0.0 {
            return best;
        }
        for (i, Edge { line, faces, .. }) in self.edges.iter().enumerate() {
            let [one, other] = faces.map(|face| self.faces[face].normal);
            let cross = d.cross(&line.direction);
            let sin = cross.norm();
            // An axis along an edge crosses none.
            if one.dot(&d) * other.dot(&d) >= 0.0 || sin <= TOUCHING {
                continue;
            }
            let normal = cross / sin.copysign(cross.dot(&(one + other)));
            if normal.dot(&(p - line.start)) <= best.distance {
                continue;
            }
            // Rounding tilts the normal of an axis nearly along the edge: no further than the hull reaches along it.
            let farthest = self.corners.iter().map(|corner| normal.dot(&corner.point));
            let farthest = farthest.fold(f64::NEG_INFINITY, f64::max);
            let distance = normal.dot(&p).min(normal.dot(&end)) - farthest;
            if distance > best.distance {
                let offset = line.start - p;
                let across = offset - line.direction * line.direction.dot(&offset);
                let along = within(d.dot(&across) / (sin * sin), length);
                best = Found { distance, part: Part::Across(i, normal, along) };
            }
        }
        best
    }

    /// How many edges it has.
    pub fn edge_count(&self) -> usize {
        self.edges.len()
    }

    fn highest(&self, point: &Vector<3>) -> Highest {
        let heights = self.faces.iter().map(|face| face.height(point)).enumerate();
        heights.fold(Highest::NONE, |best, (i, height)| best.or(i, height))
    }

    /// The face that a point is above, with its height \[m\]; none beside all of them, or inside.
    pub(crate) fn face_below(&self, point: &Vector<3>) -> Option<(&Face<3>, f64)> {
        let Highest { face, height } = self.highest(point);
        (height > 0.0 && self.is_below(face, point)).then(|| (&self.faces[face], height))
    }

    /// The face through which a point inside gets out soonest, with its height \[m\]; none outside.
    pub(crate) fn way_out_of(&self, point: &Vector<3>) -> Option<(&Face<3>, f64)> {
        let Highest { face, height } = self.highest(point);
        (height <= 0.0).then(|| (&self.faces[face], height))
    }

    /// From the nearest point of the hull to a point outside.
    pub(crate) fn offset(&self, point: &Vector<3>) -> Vector<3> {
        if let Some((face, height)) = self.face_below(point) {
            return face.normal * height;
        }
        let beside = self.edges.iter().map(|edge| point - edge.line.clamp(point));
        beside.fold(Vector::repeat(f64::INFINITY), |best, offset| {
            if offset.norm_squared() < best.norm_squared() { offset } else { best }
        })
    }

    /// Whether the segment between two points is inside somewhere.
    pub(crate) fn is_entered_by(&self, [a, b]: [Vector<3>; 2]) -> bool {
        let (mut enters, mut leaves) = (0f64, 1f64);
        for face in self.faces.iter() {
            match (face.height(&a), face.height(&b)) {
                (at_a, at_b) if at_a > 0.0 && at_b > 0.0 => return false,
                (at_a, at_b) if at_a > 0.0 => enters = enters.max(at_a / (at_a - at_b)),
                (at_a, at_b) if at_b > 0.0 => leaves = leaves.min(at_a / (at_a - at_b)),
                _ => {}
            }
        }
        enters <= leaves
    }

    /// Where a ray that starts at `origin` gets in, if it does: behind all the faces that it is above, and before it leaves.
    pub(crate) fn meet_ray(&self, origin: &Vector<3>, direction: &Vector<3>) -> Option<f64> {
        let (mut enters, mut leaves) = (0f64, f64::INFINITY);
        for face in self.faces.iter() {
            let (height, fall) = (face.height(origin), -face.normal.dot(direction));
            if height > 0.0 {
                if fall <= 0.0 {
                    return None;
                }
                enters = enters.max(height / fall);
            } else if fall < 0.0 {
                leaves = leaves.min(height / fall);
            }
        }
        (enters <= leaves).then_some(enters)
    }

    /// From the obstacle's position to the farthest corner \[m\].
    pub(crate) fn reach(&self) -> f64 {
        self.corners.iter().map(|corner| corner.point.norm()).fold(0.0, f64::max)
    }

    /// Opposite corners of a box around it \[m\].
    pub(crate) fn bounds(&self) -> [Vector<3>; 2] {
        let points = || self.corners.iter().map(|corner| corner.point);
        let (none, all) = (Vector::repeat(f64::INFINITY), Vector::repeat(f64::NEG_INFINITY));
        [points().fold(none, |low, p| low.inf(&p)), points().fold(all, |high, p| high.sup(&p))]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::cases::*;

    #[test]
    fn corners_edges_and_faces() {
        let count = |vertices: &[[f64; 3]]| {
            let hull = Hull::new(vertices).unwrap();
            [hull.corners.len(), hull.edges.len(), hull.faces.len()]
        };
        let cube = corners_of([1.0; 3]);
        assert_eq!(count(&cube), [8, 12, 6]);
        // A lattice of which most points are inside, within a side or on an edge.
        let lattice: Vec<_> = (0..64).map(|i| [i % 4, i / 4 % 4, i / 16].map(f64::from)).collect();
        assert_eq!(count(&lattice), [8, 12, 6]);
        assert_eq!(count(&[cube.clone(), cube].concat()), [8, 12, 6]);
        let tetrahedron = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert_eq!(count(&tetrahedron), [4, 6, 4]);
        // Far from the origin, small, large, and a plate.
        let moved = |scale: [f64; 3], by: f64| -> Vec<[f64; 3]> {
            let corners = corners_of([1.0; 3]).into_iter();
            corners.map(|p| [0, 1, 2].map(|k: usize| p[k] * scale[k] + by)).collect()
        };
        for (scale, by) in
            [([1.0; 3], 1e3), ([1e-6; 3], 0.0), ([1e60; 3], 0.0), ([1.0, 1.0, 1e-5], 0.0)]
        {
            assert_eq!(count(&moved(scale, by)), [8, 12, 6], "{scale:?} {by}");
        }
        let ball: Vec<[f64; 3]> = directions(64).map(Into::into).collect();
        assert_eq!(count(&ball), [64, 186, 124]);
    }

    /// Every face is a ring around its plane, and every side of it leads the other way in one other face.
    #[test]
    fn rings_of_faces() {
        let mut cube = corners_of([1.0, 2.0, 3.0]);
        cube.insert(3, [0.5, 0.0, 0.0]); // in a side
        let faces = faces_of_hull(&cube).unwrap();
        assert_eq!(faces.len(), 6);
        let mut sides = std::collections::HashSet::new();
        for ring in &faces {
            assert_eq!(ring.len(), 4);
            let at = |k: usize| Vec3::from(cube[ring[k % 4]]);
            for k in 0..4 {
                let out = (at(k + 1) - at(k)).cross(&(at(k + 2) - at(k + 1)));
                assert!(out.dot(&at(k)) > 0.0, "{faces:?}");
                assert!(sides.insert([ring[k], ring[(k + 1) % 4]]));
            }
        }
        assert!(sides.iter().all(|[a, b]| sides.contains(&[*b, *a])) && sides.len() == 24);
    }

    #[test]
    fn points_without_a_hull_are_refused() {
        let refused = |vertices: &[[f64; 3]]| check_hull(vertices).unwrap_err();
        let cube = corners_of([1.0; 3]);
        assert_eq!(refused(&[]), HullError::TooFew(0));
        assert_eq!(refused(&[cube[0]; 9]), HullError::TooFew(1));
        assert_eq!(refused(&cube[..3]), HullError::TooFew(3));
        assert_eq!(refused(&[[f64::NAN; 3]; 5]), HullError::TooFew(0));
        let line: Vec<_> = (0..9).map(|k| [f64::from(k), 1.0, 2.0 * f64::from(k)]).collect();
        assert!(matches!(refused(&line), HullError::Flat(_)));
        let turned = crate::math::UnitQuaternion::exp(&vec3(0.3, -0.5, 0.2));
        let plane: Vec<_> =
            directions(30).map(|p| turned.rotate(&vec3(p.x, p.y, 0.0)).into()).collect();
        assert!(matches!(refused(&plane), HullError::Flat(_)));
        let ball: Vec<[f64; 3]> = directions(65).map(Into::into).collect();
        assert_eq!(refused(&ball), HullError::TooManyCorners(65));
        assert!(matches!(refused(&vec![[0.0; 3]; 10_001]), HullError::TooMany(10_001)));
    }
}
