//! A hull that a link carries and something convex.
//!
//! Apart, the nearest points are a corner of the other above the inside of a face of the hull, or one of them lies on an
//! edge of the hull (T122). Which pair it is proves itself: along the normal, no point of one is nearer to the other.

use super::axis::{Nearest, PARALLEL, to_edge, within};
use super::hull::{Edge, Hull, MAX_CORNERS};
use super::{PlacedHull, Probe};
use crate::math::{Feature, RELIEF, TOUCHING, Vector};

/// The most contact features of a hull and something else: the nearest ones.
pub(crate) const MAX_FEATURES: usize = 32;

/// What is farther than the nearest pair by this \[m\] is none: it cannot be the nearest for some periods of control.
const WINDOW: f64 = 0.02;

/// What a row counts as farther than it is, if it is farther than the nearest pair by `excess`: nothing for that pair, and
/// without bound where it is no row any more, so that rows come and go where they cannot act \[m\].
fn fading(excess: f64) -> f64 {
    excess * excess / (WINDOW - excess)
}

/// Something convex without its radius, in the frame in which a hull is measured against it.
pub(crate) trait Convex {
    /// Signed distance of an axis from it.
    fn nearest(&self, axis: &Probe) -> Nearest;
    /// From its nearest point to a point outside.
    fn offset(&self, point: &Vector<3>) -> Vector<3>;
    /// Calls `visit` with its corners, the ends of an axis, or a centre; `onward` are unit vectors along which it goes on
    /// there, among others between them.
    fn for_each_corner(&self, visit: impl FnMut(&Vector<3>, Onward<'_>));
    /// The corner that is farthest along a direction.
    fn farthest(&self, direction: &Vector<3>) -> Vector<3> {
        let mut best = (f64::NEG_INFINITY, Vector::zeros());
        self.for_each_corner(|corner, _| {
            let ahead = direction.dot(corner);
            if ahead > best.0 {
                best = (ahead, *corner);
            }
        });
        best.1
    }
    /// Calls `visit` with its edges. `onward` as there.
    fn for_each_edge(&self, visit: impl FnMut(&Probe, Onward<'_>));
    /// Calls `visit` with the outward unit normals of its faces, and their offsets \[m\].
    fn for_each_face(&self, visit: impl FnMut(&Vector<3>, f64));
}

/// In which directions something convex goes on beside a corner or an edge.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Onward<'a> {
    /// In these, and in those between them.
    Along(&'a [Vector<3>]),
    /// Along three axes, or against them where the sign is positive; 0 both ways.
    Against(&'a nalgebra::Matrix3<f64>, Vector<3>),
}

impl Onward<'_> {
    /// How much it gains along `normal` per metre at most; 0 where this is the last point along it.
    #[inline]
    pub(crate) fn most_along(&self, normal: &Vector<3>) -> f64 {
        match self {
            Self::Along(ways) => ways.iter().map(|way| normal.dot(way)).fold(0.0, f64::max),
            Self::Against(axes, outward) => {
                (-axes.tr_mul(normal).component_mul(outward).min()).max(0.0)
            }
        }
    }
}

/// How far something convex comes towards an axis beside a corner or an edge: 0 where that is the nearest \[m\].
pub(crate) fn averted(nearest: &Nearest, onward: Onward<'_>) -> f64 {
    nearest.distance * onward.most_along(&nearest.normal)
}

/// Where a hull and something convex come nearest, in the frame of the latter.
#[derive(Debug, Clone, Copy)]
pub(crate) struct HullContact {
    /// With the point on the hull; the other one is `point − distance · normal`.
    pub nearest: Nearest,
    /// Unit vector along the edge of the hull on which that point lies; zero where it is none.
    pub axis: Vector<3>,
}

impl HullContact {
    const NOWHERE: Self = Self {
        nearest: Nearest {
            distance: f64::INFINITY,
            normal: Vector::<3>::new(0.0, 0.0, 1.0),
            point: Vector::<3>::new(0.0, 0.0, 0.0),
            feature: Feature::Face,
        },
        axis: Vector::<3>::new(0.0, 0.0, 0.0),
    };

    /// A corner of the other at `corner`, along `outward`, a face's normal, from the hull.
    fn above(corner: &Vector<3>, outward: &Vector<3>, distance: f64) -> Self {
        let (normal, point) = (-outward, corner - outward * distance);
        let feature = Feature::LinkFace { distance };
        Self { nearest: Nearest { distance, normal, point, feature }, axis: Vector::zeros() }
    }
}

/// A plane that something convex lies behind, and touches. What lies before it is no nearer than the plane.
#[derive(Debug, Clone, Copy)]
struct Plane {
    /// Unit vector, away from it.
    normal: Vector<3>,
    offset: f64,
}

impl Plane {
    /// Everything is before it, infinitely far behind.
    const NOWHERE: Self = Self { normal: Vector::<3>::new(0.0, 0.0, 0.0), offset: f64::INFINITY };

    fn beside(other: &impl Convex, normal: Vector<3>) -> Self {
        let mut offset = f64::NEG_INFINITY;
        other.for_each_corner(|corner, _| offset = offset.max(normal.dot(corner)));
        Self { normal, offset }
    }
}

/// How high the corners of a hull are above a plane \[m\].
struct Heights {
    of_corner: [f64; MAX_CORNERS],
    count: usize,
}

impl Heights {
    fn above(plane: &Plane, PlacedHull { hull, rotation, position }: &PlacedHull<'_, 3>) -> Self {
        let normal = rotation.tr_mul(&plane.normal);
        let offset = plane.normal.dot(position) - plane.offset;
        let mut of_corner = [0.0; MAX_CORNERS];
        for (height, corner) in of_corner.iter_mut().zip(hull.corners.iter()) {
            *height = normal.dot(&corner.point) + offset;
        }
        Self { of_corner, count: hull.corners.len().min(MAX_CORNERS) }
    }

    /// Of the lower end of an edge.
    #[inline]
    fn of(&self, edge: &Edge<3>) -> f64 {
        let [a, b] = edge.ends.map(|end| self.of_corner[end]);
        a.min(b)
    }

    fn least(&self) -> f64 {
        self.of_corner[..self.count].iter().copied().fold(f64::INFINITY, f64::min)
    }
}

impl PlacedHull<'_, 3> {
    /// Where it comes nearest to `other`, overlapping or not; NaN where something is undefined.
    pub(crate) fn meet(&self, other: &impl Convex) -> HullContact {
        let mut best = HullContact::NOWHERE;
        // The edge that begins where the hull comes farthest towards the other's middle is likely to be near.
        let (mut sum, mut count) = (Vector::zeros(), 0.0);
        other.for_each_corner(|corner, _| (sum, count) = (sum + corner, count + 1.0));
        let towards = self.rotation.tr_mul(&(sum / count - self.position));
        let ahead = |edge: &&Edge<3>| towards.dot(&edge.line.start);
        let farther = |a, b| if ahead(&b) > ahead(&a) { b } else { a };
        let first = self.hull.edges.iter().reduce(farther);
        let mut plane = Plane::NOWHERE;
        let mut heights = Heights::above(&plane, self);
        for edge in first.into_iter().chain(self.hull.edges.iter()) {
            if heights.of(edge) >= best.nearest.distance {
                continue;
            }
            let line = self.edge(&edge.line);
            let nearest = other.nearest(&line);
            // False where it is undefined, which then is what is found.
            let is_farther = nearest.distance >= best.nearest.distance;
            if !is_farther {
                best = HullContact { nearest, axis: line.direction };
                plane = Plane::beside(other, nearest.normal);
                heights = Heights::above(&plane, self);
            }
        }
        let lowest = heights.least() + plane.offset;
        other.for_each_corner(|corner, _| {
            if lowest - plane.normal.dot(corner) < best.nearest.distance
                && let Some((face, height)) = self.hull.face_below(&self.seen(corner))
                && height < best.nearest.distance
            {
                best = HullContact::above(corner, &(self.rotation * face.normal), height);
            }
        });
        let Nearest { distance, normal, .. } = best.nearest;
        if distance.is_nan() {
            return best;
        }
        // Both lie on their own sides of two planes that far apart, or else they overlap, where no edge of this one meets the
        // other: then one of the other enters this. (A long way from here rounding moves the planes.)
        let plane = Plane::beside(other, normal);
        let is_apart = || {
            Heights::above(&plane, self).least() >= distance - self.hull.slack
                || !self.is_entered_by(other)
        };
        if distance > TOUCHING && is_apart() { best } else { self.way_out(other) }
    }

    /// Whether an edge of `other` is inside somewhere.
    fn is_entered_by(&self, other: &impl Convex) -> bool {
        let mut is_entered = false;
        other.for_each_edge(|edge, _| {
            is_entered |=
                self.hull.is_entered_by([edge.start, edge.end()].map(|end| self.seen(&end)));
        });
        is_entered
    }

    /// Where it comes nearest to a point, outside and inside.
    pub(crate) fn meet_point(&self, point: &Vector<3>) -> HullContact {
        let seen = self.seen(point);
        if let Some((face, height)) =
            self.hull.face_below(&seen).or_else(|| self.hull.way_out_of(&seen))
        {
            return HullContact::above(point, &(self.rotation * face.normal), height);
        }
        let gap = |edge: &Probe| (edge.clamp(&seen) - seen).norm_squared();
        let lines = self.hull.edges.iter().map(|edge| &edge.line);
        let Some(line) = lines.min_by(|a, b| gap(a).total_cmp(&gap(b))) else {
            return HullContact::NOWHERE;
        };
        let edge = self.edge(line);
        HullContact { nearest: super::point::to_point(&edge, point), axis: edge.direction }
    }

    /// Where it comes nearest to a point outside, as if that were above a face: that the normal turns about an edge or a corner
    /// is left out, which is the safe side (T77).
    pub(crate) fn above_face(&self, point: &Vector<3>) -> HullContact {
        let offset = self.rotation * self.hull.offset(&self.seen(point));
        let distance = offset.norm();
        HullContact::above(point, &(offset / distance), distance)
    }

    /// Calls `visit` with every pair of features nearer than `reach` \[m\] that may be the nearest when these change hands, and
    /// its distance with relief for what lies beyond its place and for what is not the nearest: of the corners of both, which count as opposite a face
    /// everywhere, and of the edges of both where they cross (T98, T122). They must be apart, with this `nearest` pair;
    /// what is farther than that by more than [`WINDOW`] is not next.
    pub(crate) fn for_each_row(
        &self,
        other: &impl Convex,
        nearest: &Nearest,
        reach: f64,
        mut visit: impl FnMut(&HullContact, f64),
    ) {
        let farthest = reach;
        let reach = reach.min(nearest.distance + WINDOW);
        let mut visit = |contact: &HullContact, distance: f64| {
            if distance < reach {
                let distance = distance + fading(distance - nearest.distance);
                if distance < farthest {
                    visit(contact, distance);
                }
            }
        };
        // What lies beyond a slab between the two is too far.
        let plane = Plane::beside(other, nearest.normal);
        let heights = Heights::above(&plane, self);
        let rear = heights.least() + plane.offset;
        let is_opposite = |point: &Vector<3>| rear - plane.normal.dot(point) < reach;
        for (corner, height) in self.hull.corners.iter().zip(&heights.of_corner) {
            if *height >= reach {
                continue;
            }
            let point = self.placed(&corner.point);
            let offset = other.offset(&point);
            let distance = offset.norm();
            let normal = offset / distance;
            let nearest = Nearest { distance, normal, point, feature: Feature::Face };
            visit(&HullContact { nearest, axis: Vector::zeros() }, distance);
        }
        other.for_each_corner(|corner, _| {
            if is_opposite(corner) {
                let contact = self.above_face(corner);
                visit(&contact, contact.nearest.distance);
            }
        });
        for own in self.hull.edges.iter() {
            if heights.of(own) >= reach {
                continue;
            }
            let line = self.edge(&own.line);
            let into = own.into.map(|way| self.rotation * way);
            other.for_each_edge(|edge, onward| {
                if (is_opposite(&edge.start) || is_opposite(&edge.end()))
                    && let Some((nearest, beyond)) = to_edge(&line, edge)
                    && nearest.distance + RELIEF * beyond < reach
                {
                    let own = Onward::Along(&into).most_along(&-nearest.normal);
                    let beyond = beyond + nearest.distance * own + averted(&nearest, onward);
                    let contact = HullContact { nearest, axis: line.direction };
                    visit(&contact, nearest.distance + RELIEF * beyond);
                }
            });
        }
    }

    /// The shortest translation that frees it from `other`: of all the faces that the difference of the two bodies has, those
    /// of either and one for each two edges that cross seen from within, that to which the way is shortest.
    fn way_out(&self, other: &impl Convex) -> HullContact {
        let mut best = HullContact::NOWHERE;
        best.nearest.distance = f64::NEG_INFINITY;
        for face in self.hull.faces.iter() {
            let outward = self.rotation * face.normal;
            let offset = face.offset + outward.dot(&self.position);
            let mut lowest = (f64::INFINITY, Vector::zeros());
            other.for_each_corner(|corner, _| {
                let height = outward.dot(corner) - offset;
                if height < lowest.0 {
                    lowest = (height, *corner);
                }
            });
            if lowest.0 > best.nearest.distance {
                best = HullContact::above(&lowest.1, &outward, lowest.0);
            }
        }
        other.for_each_face(|normal, offset| {
            let heights = self.corners().map(|corner| (normal.dot(&corner) - offset, corner));
            let lowest = heights.reduce(|a, b| if b.0 < a.0 { b } else { a });
            if let Some((distance, point)) = lowest.filter(|low| low.0 > best.nearest.distance) {
                let nearest = Nearest { distance, normal: *normal, point, feature: Feature::Face };
                best = HullContact { nearest, axis: Vector::zeros() };
            }
        });
        for own in self.hull.edges.iter() {
            let (line, into) = (self.edge(&own.line), own.into.map(|way| self.rotation * way));
            let own_ways = Onward::Along(&into);
            other.for_each_edge(|edge, onward| {
                let cross = line.direction.cross(&edge.direction);
                let sin = cross.norm();
                if sin <= PARALLEL {
                    return;
                }
                // Towards the hull, which ends there in the opposite direction, as the other does in this one.
                for normal in [cross / sin, cross / -sin] {
                    if own_ways.most_along(&-normal) > ROUNDING
                        || onward.most_along(&normal) > ROUNDING
                        || normal.dot(&(line.start - edge.start)) <= best.nearest.distance
                    {
                        continue;
                    }
                    // Rounding tilts the normal of edges that are nearly parallel: no further than both reach along it.
                    let lowest = self.corners().map(|corner| normal.dot(&corner));
                    let mut highest = f64::NEG_INFINITY;
                    other.for_each_corner(|corner, _| highest = highest.max(normal.dot(corner)));
                    let distance = lowest.fold(f64::INFINITY, f64::min) - highest;
                    if distance > best.nearest.distance {
                        let offset = line.start - edge.start;
                        let along = -offset.cross(&edge.direction).dot(&cross) / (sin * sin);
                        let point = line.start + line.direction * within(along, line.length);
                        let feature = Feature::Crossing { edge: edge.direction, distance };
                        let nearest = Nearest { distance, normal, point, feature };
                        best = HullContact { nearest, axis: line.direction };
                    }
                }
            });
        }
        best
    }
}

/// What rounding may make of the cosine of a right angle.
const ROUNDING: f64 = 1e-9;

impl Convex for Hull {
    fn nearest(&self, axis: &Probe) -> Nearest {
        Self::nearest(self, axis)
    }

    fn offset(&self, point: &Vector<3>) -> Vector<3> {
        Self::offset(self, point)
    }

    fn farthest(&self, direction: &Vector<3>) -> Vector<3> {
        self.corners[self.farthest_corner(direction)].point
    }

    fn for_each_corner(&self, mut visit: impl FnMut(&Vector<3>, Onward<'_>)) {
        self.corners.iter().for_each(|corner| visit(&corner.point, Onward::Along(&corner.along)));
    }

    fn for_each_edge(&self, mut visit: impl FnMut(&Probe, Onward<'_>)) {
        self.edges.iter().for_each(|edge| visit(&edge.line, Onward::Along(&edge.into)));
    }

    fn for_each_face(&self, mut visit: impl FnMut(&Vector<3>, f64)) {
        self.faces.iter().for_each(|face| visit(&face.normal, face.offset));
    }
}

/// A segment, or a point of length 0.
impl Convex for Probe {
    fn nearest(&self, axis: &Probe) -> Nearest {
        if self.length > 0.0 {
            super::segment::to_segment(axis, self)
        } else {
            super::point::to_point(axis, &self.start)
        }
    }

    fn offset(&self, point: &Vector<3>) -> Vector<3> {
        point - self.clamp(point)
    }

    fn for_each_corner(&self, mut visit: impl FnMut(&Vector<3>, Onward<'_>)) {
        visit(&self.start, Onward::Along(&[]));
        if self.length > 0.0 {
            visit(&self.end(), Onward::Along(&[]));
        }
    }

    fn for_each_edge(&self, mut visit: impl FnMut(&Probe, Onward<'_>)) {
        if self.length > 0.0 {
            visit(self, Onward::Along(&[]));
        }
    }

    fn for_each_face(&self, _visit: impl FnMut(&Vector<3>, f64)) {}
}
