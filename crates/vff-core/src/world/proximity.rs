//! Signed distance between a link and an obstacle: only this file and those below it name parry
//! and glam.
//!
//! A link is queried as its axis and an obstacle as its *core*: what remains when the radius
//! is taken away (circle → point, capsule → segment, box and polygon → themselves). The radii
//! are subtracted afterwards, so the direction survives their overlap until the axis itself
//! meets the core. Beyond that the distance is minus the penetration depth: the shortest
//! translation of the link that frees it.
//!
//! Distances are exact to rounding. In the plane, two convex bodies that do not overlap are
//! nearest at a vertex of one of them; if they overlap, the shortest way out is along a normal
//! of one of them. Both need only projections of points. Points and segments, by far the most
//! frequent, have closed forms. parry's general routines are not used: GJK has no direction at
//! contact, EPA allocates, and segment–segment errs by 3e-8 m on nearly parallel segments. Its
//! hierarchy of boxes ([`crowd`]) finds what is near among many.

mod crowd;
mod rays;

pub(super) use crowd::Crowd;

use super::{Body, CollisionQuery, Contact, Feature, MotionState, Shape, World, shape};
use crate::math::{Capsule, Vector};
use parry2d_f64::math::Vector as Point;

/// Separations up to this [m] count as touching: the difference of two points that near is
/// mostly rounding and has no direction, whereas a separating axis always has one.
const TOUCHING: f64 = 1e-13;

/// What a corner gains in distance per metre that it lies beyond an end of a link (T77).
const RELIEF: f64 = 10.0;

impl World {
    /// The nearest points between `capsule`, which is link number `link`, and obstacle `j`.
    ///
    /// Circle: when the axis passes exactly through the centre, both ways out are equally
    /// short; the normal is then the left one of the axis (its direction turned by +90°).
    /// Likewise, of several nearest pairs (parallel edges) one is taken, always the same.
    ///
    /// # Arguments
    /// * `capsule`: in the world frame, with `start` ≠ `end` [m]. NaN coordinates give a NaN
    ///   distance.
    ///
    /// # Panics
    /// If `j` is not less than [`World::len`].
    #[inline]
    pub fn contact(&self, link: usize, capsule: &Capsule<2>, j: usize) -> Contact<2> {
        let body = &self.bodies[j];
        let moved;
        let state = if body.is_at(self.time) {
            &body.state
        } else {
            moved = body.moved_to(self.time);
            &moved
        };
        let nearest = body.core.nearest(&Axis::new(capsule), to_glam(state.position));
        body.core.contact(link, j, &nearest, capsule.radius, state)
    }

    /// Link by link from the first of `links` on, and for each link in the order of the obstacles.
    ///
    /// See [`World::contact`] for what is expected of a link.
    #[inline(always)] // twice
    fn for_each_near(
        &mut self,
        links: impl IntoIterator<Item = Capsule<2>>,
        reach: f64,
        mut distance: impl FnMut(usize, f64),
        mut visit: impl FnMut(&Contact<2>, &Axis, f64, &Body),
    ) {
        let Self { bodies, crowd, time, .. } = self;
        if bodies.is_empty() {
            return;
        }
        let mut meet = |link: usize, axis: Axis, radius: f64, j: usize, body: &Body| {
            let nearest = body.core.nearest(&axis, to_glam(body.state.position));
            let contact = body.core.contact(link, j, &nearest, radius, &body.state);
            if contact.distance < reach {
                visit(&contact, &axis, radius, body);
            }
        };
        for (link, capsule) in links.into_iter().enumerate() {
            let (axis, radius) = (Axis::new(&capsule), capsule.radius);
            let near = match crowd {
                Some(crowd) => crowd.near(bodies, *time, &axis, radius, reach),
                None => None,
            };
            // The same is done with the few that a crowd names as with all: measured first, and only
            // links with something in reach are looked at again.
            let bodies = &*bodies;
            let least = match near {
                None => least_distance(bodies, &axis, radius),
                Some(near) => least_distance(near.iter().map(|&j| &bodies[j]), &axis, radius),
            };
            distance(link, least);
            if least < reach {
                let mut meet = |j: usize| meet(link, axis, radius, j, &bodies[j]);
                match near {
                    None => (0..bodies.len()).for_each(meet),
                    Some(near) => near.iter().for_each(|&j| meet(j)),
                }
            }
        }
    }
}

impl CollisionQuery<2> for World {
    fn obstacle_count(&self) -> usize {
        self.len()
    }

    #[inline]
    fn for_each_contact(
        &mut self,
        links: impl IntoIterator<Item = Capsule<2>>,
        reach: f64,
        distance: impl FnMut(usize, f64),
        mut visit: impl FnMut(&Contact<2>),
    ) {
        self.for_each_near(links, reach, distance, |contact, _, _, _| visit(contact));
    }

    fn barrier_count(&self) -> usize {
        self.barriers
    }

    /// One for a circle; for every other obstacle those of (T77).
    #[inline]
    fn for_each_barrier(
        &mut self,
        links: impl IntoIterator<Item = Capsule<2>>,
        reach: f64,
        mut visit: impl FnMut(&Contact<2>),
    ) {
        self.for_each_near(
            links,
            reach,
            |_, _| {},
            |contact, axis, radius, body| {
                body.core.for_each_barrier(contact, axis, radius, &body.state, |barrier| {
                    if barrier.distance < reach {
                        visit(barrier);
                    }
                });
            },
        );
    }

    #[inline]
    fn contact_after(
        &self,
        link: usize,
        capsule: &Capsule<2>,
        obstacle: usize,
        after: f64,
    ) -> Contact<2> {
        let body = &self.bodies[obstacle];
        let mut state = body.state_at(self.time);
        state.position += state.velocity * after;
        let nearest = body.core.nearest(&Axis::new(capsule), to_glam(state.position));
        body.core.contact(link, obstacle, &nearest, capsule.radius, &state)
    }
}

/// The distance between the surfaces of a link and the nearest of these bodies [m]; ∞ if there are none.
#[inline(always)] // discs, by far the most frequent, stay within the loop over the links
fn least_distance<'a>(bodies: impl IntoIterator<Item = &'a Body>, axis: &Axis, radius: f64) -> f64 {
    let distances = bodies.into_iter().map(|body| body.distance(axis, radius));
    let least = distances.fold(f64::INFINITY, |a, b| if b < a { b } else { a });
    // Of 0 and −0 either may have been the first: + 0 makes them one.
    least + 0.0
}

impl Body {
    /// The distance between the surfaces of obstacle and link [m], bit for bit that of their contact.
    #[inline(always)]
    fn distance(&self, axis: &Axis, radius: f64) -> f64 {
        let position = to_glam(self.state.position);
        self.core.distance(axis, position) - self.core.radius - radius
    }
}

/// An obstacle without its radius, relative to its position, turned by its angle: obstacles
/// only translate, so this never changes.
#[derive(Debug, Clone)]
pub(super) struct Core {
    solid: Solid,
    /// To be subtracted from the distance to `solid` [m].
    radius: f64,
}

#[derive(Debug, Clone)]
enum Solid {
    Point(Point),
    /// With the normal to its right.
    Segment(Face),
    /// The edges of a convex polygon, counter-clockwise. Never empty.
    Convex(Vec<Face>),
}

/// One edge of a convex polygon.
#[derive(Debug, Clone, Copy)]
struct Face {
    start: Point,
    /// Unit vector, outward.
    normal: Point,
    /// Length of the edge, positive [m].
    length: f64,
}

impl Core {
    /// The core of `shape` turned by `angle` [rad].
    pub(super) fn new(shape: &Shape, angle: f64) -> Self {
        let turn = Point::from_angle(angle);
        let convex = |vertices: &[[f64; 2]], radius| {
            let vertices: Vec<Point> =
                vertices.iter().map(|&vertex| turn.rotate(vertex.into())).collect();
            let faces = faces(&vertices);
            let solid = match (&faces[..], &vertices[..]) {
                ([], _) => {
                    Solid::Point(vertices.into_iter().find(|v| v.is_finite()).unwrap_or_default())
                }
                ([there, _back], [_, _]) => Solid::Segment(*there),
                _ => Solid::Convex(faces),
            };
            Self { solid, radius }
        };
        match shape {
            Shape::Circle { radius } => Self { solid: Solid::Point(Point::ZERO), radius: *radius },
            Shape::Capsule { a, b, radius } => convex(&[*a, *b], *radius),
            Shape::Box { size: [w, h] } => {
                let (x, y) = (0.5 * w, 0.5 * h);
                convex(&[[-x, -y], [x, -y], [x, y], [-x, y]], 0.0)
            }
            Shape::Polygon { vertices } => convex(&shape::counter_clockwise(vertices), 0.0),
        }
    }

    /// The nearest points to an axis when the obstacle is at `position` [m], relative to it.
    #[inline]
    fn nearest(&self, axis: &Axis, position: Point) -> Nearest {
        let axis = axis.seen_from(position);
        match &self.solid {
            Solid::Point(point) => axis.to_disc(*point),
            Solid::Segment(face) => axis.to_segment(face),
            Solid::Convex(faces) => axis.to_convex(faces),
        }
    }

    /// Their distance alone, for most links are too far from most obstacles for anything else.
    #[inline(always)] // as above
    fn distance(&self, axis: &Axis, position: Point) -> f64 {
        match &self.solid {
            Solid::Point(point) => axis.seen_from(position).distance_to_disc(*point),
            _ => self.nearest(axis, position).distance,
        }
    }

    /// The contact of link number `link` of this `radius` [m] with this core, which is that of
    /// obstacle `j`.
    #[inline]
    fn contact(
        &self,
        link: usize,
        j: usize,
        nearest: &Nearest,
        radius: f64,
        state: &MotionState,
    ) -> Contact<2> {
        let Nearest { distance, normal, point, meets } = *nearest;
        let point = to_glam(state.position) + point;
        Contact {
            link,
            obstacle: j,
            distance: distance - self.radius - radius,
            normal: from_glam(normal),
            point: from_glam(point),
            witness: from_glam(point - normal * (distance - self.radius)),
            velocity: state.velocity,
            acceleration: state.acceleration,
            feature: match meets {
                Meets::Side => Feature::Side { distance },
                Meets::End => Feature::End { distance },
                Meets::Face => Feature::Face,
            },
        }
    }

    /// The edges; none of a point.
    fn edges(&self) -> &[Face] {
        match &self.solid {
            Solid::Point(_) => &[],
            Solid::Segment(face) => std::slice::from_ref(face),
            Solid::Convex(faces) => faces,
        }
    }

    /// The most barriers that one link can have.
    pub(super) fn barriers(&self) -> usize {
        match &self.solid {
            Solid::Point(_) => 1,
            Solid::Segment(_) => 4,
            Solid::Convex(faces) => 2 + faces.len(),
        }
    }

    /// Every distance of an end or a corner that may be the least when features change hands (T77);
    /// of a point, or where the axis has got into the core, that of `contact` alone.
    #[inline]
    fn for_each_barrier(
        &self,
        contact: &Contact<2>,
        axis: &Axis,
        radius: f64,
        state: &MotionState,
        mut visit: impl FnMut(&Contact<2>),
    ) {
        let edges = self.edges();
        let apart = contact.distance + self.radius + radius > TOUCHING;
        if edges.is_empty() || !apart {
            return visit(contact);
        }
        let axis = axis.seen_from(to_glam(state.position));
        let mut visit = |nearest: &Nearest, beyond: f64| {
            let found = self.contact(contact.link, contact.obstacle, nearest, radius, state);
            visit(&Contact { distance: found.distance + RELIEF * beyond, ..found });
        };
        for end in [axis.start, axis.end()] {
            visit(&end_to_edges(end, edges), 0.0);
        }
        let last = matches!(self.solid, Solid::Segment(_)).then(|| edges[0].end());
        for corner in edges.iter().map(|edge| edge.start).chain(last) {
            let along = axis.forward.dot(corner - axis.start);
            let foot = axis.start + axis.forward * along;
            let beyond = (-along).max(along - axis.length).max(0.0);
            visit(&axis.beside(axis.start - corner, foot), beyond);
        }
    }

    /// Opposite corners of the box around the obstacle, relative to its position [m].
    fn extent(&self) -> [Point; 2] {
        let [low, high] = match &self.solid {
            Solid::Point(point) => [*point; 2],
            Solid::Segment(face) => {
                let (a, b) = (face.start, face.end());
                [a.min(b), a.max(b)]
            }
            Solid::Convex(faces) => {
                faces.iter().fold([Point::INFINITY, Point::NEG_INFINITY], |[low, high], face| {
                    [low.min(face.start), high.max(face.start)]
                })
            }
        };
        [low - Point::splat(self.radius), high + Point::splat(self.radius)]
    }
}

/// The nearest point of these edges to an end of a link outside of what they enclose. It counts as a face
/// everywhere: that the normal turns about a corner is left out, which is the safe side (T77).
fn end_to_edges(end: Point, edges: &[Face]) -> Nearest {
    let mut nearest =
        Nearest { distance: f64::INFINITY, normal: Point::ZERO, point: end, meets: Meets::Face };
    for edge in edges {
        let along = edge.normal.perp().dot(end - edge.start);
        let height = edge.height(end);
        let beyond = along - along.clamp(0.0, edge.length);
        let distance = height.hypot(beyond);
        if distance < nearest.distance {
            let offset = edge.normal * height + edge.normal.perp() * beyond;
            nearest = Nearest { distance, normal: offset / distance, ..nearest };
        }
    }
    nearest
}

/// The edges of the polygon with these counter-clockwise corners, except those without length.
fn faces(vertices: &[Point]) -> Vec<Face> {
    let next = vertices.iter().cycle().skip(1);
    vertices
        .iter()
        .zip(next)
        .filter_map(|(&start, &end)| {
            let edge = end - start;
            let length = edge.length();
            length.is_normal().then(|| Face { start, normal: -edge.perp() / length, length })
        })
        .collect()
}

impl Face {
    #[inline]
    fn end(&self) -> Point {
        self.start + self.normal.perp() * self.length
    }

    /// Signed distance of `point` from the line through the edge, positive outside.
    #[inline]
    fn height(&self, point: Point) -> f64 {
        self.normal.dot(point - self.start)
    }

    /// Whether the perpendicular from `point` meets the edge between its ends.
    #[inline]
    fn is_below(&self, point: Point) -> bool {
        (0.0..=self.length).contains(&self.normal.perp().dot(point - self.start))
    }
}

/// The axis of a link.
#[derive(Debug, Clone, Copy)]
struct Axis {
    start: Point,
    /// Unit vector from start to end.
    forward: Point,
    length: f64,
}

/// The nearest points of an axis and a core. The one on the core is
/// `point − distance · normal`.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    distance: f64,
    normal: Point,
    point: Point,
    meets: Meets,
}

/// The kinds of [`Feature`].
#[derive(Debug, Clone, Copy)]
enum Meets {
    Side,
    End,
    Face,
}

impl Axis {
    #[inline]
    fn new(capsule: &Capsule<2>) -> Self {
        Self {
            start: to_glam(capsule.start),
            forward: to_glam(capsule.direction),
            length: capsule.length,
        }
    }

    #[inline]
    fn seen_from(&self, position: Point) -> Self {
        Self { start: self.start - position, ..*self }
    }

    #[inline]
    fn end(&self) -> Point {
        self.start + self.forward * self.length
    }

    /// Left normal of the axis.
    #[inline]
    fn left(&self) -> Point {
        self.forward.perp()
    }

    /// Distance to the centre of a disc, by far the most frequent query, in closed form: never
    /// negative, because only by chance do the two meet.
    #[inline]
    fn to_disc(self, centre: Point) -> Nearest {
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
    fn distance_to_disc(self, centre: Point) -> f64 {
        let offset = self.start - centre;
        let along = -self.forward.dot(offset);
        if along > 0.0 && along < self.length {
            return self.left().dot(offset).abs();
        }
        let end = if along > 0.0 { self.length } else { 0.0 };
        (offset + self.forward * end).length()
    }

    /// The foot `point` of the perpendicular lies between the ends: the normal of the axis is known
    /// exactly, whereas the difference of the two points would lose its direction close to the core.
    /// `offset` leads from the core to the start.
    #[inline]
    fn beside(self, offset: Point, point: Point) -> Nearest {
        let left = self.left();
        let height = left.dot(offset);
        let normal = if height >= 0.0 { left } else { -left };
        Nearest { distance: height.abs(), normal, point, meets: Meets::Side }
    }

    /// Signed distance to a segment: [`to_convex`](Self::to_convex) for a polygon with two edges,
    /// there and back.
    #[inline(never)]
    fn to_segment(self, core: &Face) -> Nearest {
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
        let gap = |first: f64, second: f64, normal: Point, ends: [Point; 2], meets: Meets| {
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

    /// Signed distance to a convex polygon.
    ///
    /// The gap along a direction (how far the axis lies beyond the polygon) never exceeds the
    /// signed distance. Overlapping bodies have the greatest gap, the one nearest to zero,
    /// along a normal of one of them; it is minus the penetration depth.
    #[inline(never)]
    fn to_convex(self, faces: &[Face]) -> Nearest {
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

#[inline]
fn to_glam(v: Vector<2>) -> Point {
    Point::new(v.x, v.y)
}

#[inline]
fn from_glam(v: Point) -> Vector<2> {
    Vector::<2>::new(v.x, v.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::perp;
    use crate::world::{Motion, Obstacle};
    use parry2d_f64::shape::Segment;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

    // An independent oracle: the least distance from the axis to the core by searching along
    // the axis (the distance to a convex body is a convex function of the position on it).

    fn vec2(x: f64, y: f64) -> Vector<2> {
        Vector::<2>::new(x, y)
    }

    fn rotated(v: Vector<2>, angle: f64) -> Vector<2> {
        v * angle.cos() + perp(v) * angle.sin()
    }

    /// Corners of the core in the world frame, counter-clockwise.
    fn corners(obstacle: &Obstacle) -> Vec<Vector<2>> {
        let local = match &obstacle.shape {
            Shape::Circle { .. } => vec![[0.0, 0.0]],
            Shape::Capsule { a, b, .. } => vec![*a, *b],
            Shape::Box { size: [w, h] } => [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
                .map(|[x, y]| [x * w, y * h])
                .to_vec(),
            Shape::Polygon { vertices } => shape::counter_clockwise(vertices),
        };
        local
            .into_iter()
            .map(|v| Vector::from(obstacle.position) + rotated(v.into(), obstacle.angle))
            .collect()
    }

    fn core_radius(shape: &Shape) -> f64 {
        match shape {
            Shape::Circle { radius } | Shape::Capsule { radius, .. } => *radius,
            Shape::Box { .. } | Shape::Polygon { .. } => 0.0,
        }
    }

    /// Distance from `p` to the convex hull of `corners`, zero inside.
    fn distance_to_core(corners: &[Vector<2>], p: Vector<2>) -> f64 {
        let n = corners.len();
        let edges = || (0..n).map(|i| (corners[i], corners[(i + 1) % n]));
        if n > 2 && edges().all(|(a, b)| perp(b - a).dot(&(p - a)) >= 0.0) {
            return 0.0;
        }
        edges()
            .map(|(a, b)| {
                let ab = b - a;
                let s = (p - a).dot(&ab) / ab.norm_squared().max(f64::MIN_POSITIVE);
                (p - a - ab * s.clamp(0.0, 1.0)).norm()
            })
            .fold(f64::INFINITY, f64::min)
    }

    fn searched_distance(link: &Capsule<2>, corners: &[Vector<2>]) -> f64 {
        let at = |s: f64| distance_to_core(corners, link.start + (link.end() - link.start) * s);
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..120 {
            let (a, b) = ((2.0 * low + high) / 3.0, (low + 2.0 * high) / 3.0);
            if at(a) <= at(b) {
                high = b;
            } else {
                low = a;
            }
        }
        at(low).min(at(high)).min(at(0.0)).min(at(1.0))
    }

    fn translated(link: &Capsule<2>, by: Vector<2>) -> Capsule<2> {
        Capsule { start: link.start + by, ..*link }
    }

    fn fixed(shape: Shape, position: [f64; 2], angle: f64) -> Obstacle {
        Obstacle { shape, position, angle, motion: Motion::default() }
    }

    fn contact(link: &Capsule<2>, obstacle: &Obstacle) -> Contact<2> {
        World::new(vec![obstacle.clone()]).contact(0, link, 0)
    }

    fn capsule(start: [f64; 2], end: [f64; 2], radius: f64) -> Capsule<2> {
        Capsule::new(start.into(), end.into(), radius)
    }

    /// The point of an axis nearest to (x, y) as parry has it.
    fn projected(axis: &Axis, x: f64, y: f64) -> Nearest {
        use parry2d_f64::query::PointQuery;
        let centre = Point::new(x, y);
        let segment = Segment::new(axis.start, axis.end());
        let point = segment.project_local_point(centre, true).point;
        let offset = point - centre;
        let distance = offset.length();
        Nearest { distance, normal: offset / distance, point, meets: Meets::End }
    }

    fn any_link() -> impl Strategy<Value = Capsule<2>> {
        (-2.0..2.0, -2.0..2.0, 0.05..3.0, 0.0..TAU, 0.0..0.3).prop_map(
            |(x, y, length, angle, radius)| {
                let end = vec2(x, y) + rotated(vec2(length, 0.0), angle);
                Capsule::new(vec2(x, y), end, radius)
            },
        )
    }

    fn any_polygon() -> impl Strategy<Value = Shape> {
        (prop::collection::vec(0.0..0.9, 3..9), 0.1..1.5, 0.1..1.5, any::<bool>()).prop_map(
            |(jitter, width, height, clockwise)| {
                let n = jitter.len() as f64;
                let mut vertices: Vec<_> = jitter
                    .iter()
                    .enumerate()
                    .map(|(k, jitter)| f64::sin_cos(TAU * (k as f64 + jitter) / n))
                    .map(|(sin, cos)| [0.3 + width * cos, height * sin])
                    .collect();
                if clockwise {
                    vertices.reverse();
                }
                Shape::Polygon { vertices }
            },
        )
    }

    fn any_obstacle() -> impl Strategy<Value = Obstacle> {
        let coordinate = || -1.0..1.0;
        let shape = prop_oneof![
            (0.0..0.5).prop_map(|radius| Shape::Circle { radius }),
            ([coordinate(), coordinate()], [coordinate(), coordinate()], 0.0..0.5)
                .prop_map(|(a, b, radius)| Shape::Capsule { a, b, radius }),
            [0.05..2.0, 0.05..2.0].prop_map(|size| Shape::Box { size }),
            any_polygon(),
        ];
        (shape, [coordinate(), coordinate()], -PI..PI)
            .prop_map(|(shape, position, angle)| fixed(shape, position, angle))
    }

    proptest! {
        #![proptest_config(ProptestConfig { max_global_rejects: 10_000, ..ProptestConfig::with_cases(1000) })]

        /// The closed form for discs and parry's projection, to 1e-12.
        #[test]
        fn disc_agrees_with_parry(link in any_link(), x in -4.0..4.0, y in -4.0..4.0) {
            let axis = Axis::new(&link);
            let (found, expected) = (axis.to_disc(Point::new(x, y)), projected(&axis, x, y));
            prop_assert!((found.distance - expected.distance).abs() < 1e-12);
            prop_assert!((found.point - expected.point).length() < 1e-12);
            prop_assert!((found.normal - expected.normal).length() * found.distance < 1e-12);
        }

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
        fn distance_agrees_with_a_search(link in any_link(), obstacle in any_obstacle()) {
            let corners = corners(&obstacle);
            let found = contact(&link, &obstacle);
            let radii = link.radius + core_radius(&obstacle.shape);
            let expected = searched_distance(&link, &corners);
            let axis_distance = found.distance + radii;
            prop_assert!((axis_distance.max(0.0) - expected).abs() < 1e-12,
                "{axis_distance} is not {expected}");
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14);

            // The two points lie on the axis and on the core's surface, joined by the normal.
            let on_core = found.witness - found.normal * core_radius(&obstacle.shape);
            let joint = found.witness + found.normal * (found.distance + link.radius);
            prop_assert!((found.point - joint).norm() < 1e-14);
            let axis = [link.start, link.end()];
            prop_assert!(distance_to_core(&axis, found.point) < 1e-13);
            prop_assert!(distance_to_core(&corners, on_core) < 1e-13);
        }

        #[test]
        fn penetration_is_the_shortest_way_out(
            link in any_link(), obstacle in any_obstacle(), depth in 0.0..0.5,
        ) {
            // Wherever the link was, push it into the core.
            let before = contact(&link, &obstacle);
            let corners = corners(&obstacle);
            let radii = link.radius + core_radius(&obstacle.shape);
            let way: f64 = before.distance + radii + depth;
            let link = translated(&link, before.normal * -way);
            let found = contact(&link, &obstacle);
            let axis_distance = found.distance + radii;
            prop_assume!(axis_distance < 0.0);

            // Out along the normal, and exactly as far as promised.
            let out = |by: f64| translated(&link, found.normal * (by - axis_distance));
            prop_assert!(searched_distance(&out(0.0), &corners) < 1e-12);
            prop_assert!((searched_distance(&out(0.1), &corners) - 0.1).abs() < 1e-12);

            // No other direction is shorter.
            for k in 0..360 {
                let direction = rotated(vec2(1.0, 0.0), TAU * f64::from(k) / 360.0);
                let rear = link.start.dot(&direction).min(link.end().dot(&direction));
                let front = corners.iter().map(|c| c.dot(&direction)).fold(f64::MIN, f64::max);
                prop_assert!(rear - front <= axis_distance + 1e-13);
            }
        }

        #[test]
        fn normal_is_the_gradient(link in any_link(), obstacle in any_obstacle()) {
            let h = 1e-6;
            let found = contact(&link, &obstacle);
            for axis in [vec2(1.0, 0.0), vec2(0.0, 1.0)] {
                let [before, after] = [-h, h]
                    .map(|step| contact(&translated(&link, axis * step), &obstacle).distance);
                // Not across a change of the nearest features, where the gradient jumps.
                prop_assume!((before + after - 2.0 * found.distance).abs() < 1e-4 * h);
                let slope = (after - before) / (2.0 * h);
                prop_assert!((slope - found.normal.dot(&axis)).abs() < 1e-4,
                    "{slope} along {axis} is not the normal of {found:?}");
            }
        }

        #[test]
        fn distance_is_continuous_through_the_obstacle(
            link in any_link(), obstacle in any_obstacle(), angle in 0.0..TAU,
        ) {
            // A translation by δ cannot change it by more than δ, whatever happens on the way.
            let (length, steps) = (4.0, 200);
            let step = length / f64::from(steps);
            let direction = rotated(vec2(1.0, 0.0), angle);
            let distances = (0..=steps).map(|k| {
                let by = direction * (f64::from(k) * step - 0.5 * length);
                contact(&translated(&link, by), &obstacle).distance
            });
            let distances: Vec<f64> = distances.collect();
            for pair in distances.windows(2) {
                prop_assert!((pair[1] - pair[0]).abs() <= step + 1e-12);
            }
        }

        #[test]
        fn radii_are_subtracted(link in any_link(), a in -1.0..1.0, radius in 0.0..0.5) {
            let ends = |radius| Shape::Capsule { a: [a, 0.0], b: [0.3, 0.5], radius };
            let disc = |radius| Shape::Circle { radius };
            let bare = Capsule { radius: 0.0, ..link };
            for (thin, thick) in [(ends(0.0), ends(radius)), (disc(0.0), disc(radius))] {
                let thin = contact(&bare, &fixed(thin, [0.2, 0.1], 0.4));
                let thick = contact(&link, &fixed(thick, [0.2, 0.1], 0.4));
                let expected = thin.distance - radius - link.radius;
                prop_assert!((thick.distance - expected).abs() < 1e-15);
                prop_assert_eq!(thick.normal, thin.normal);
                prop_assert_eq!(thick.point, thin.point);
                prop_assert!((thick.witness - thin.witness - thin.normal * radius).norm() < 1e-14);
            }
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

        #[test]
        fn lattice_positions_are_exact(
            x in 0i8..7, y in 0i8..7, dx in -3i8..4, dy in -3i8..4, kind in 0usize..4,
        ) {
            // Parallel, collinear, touching, sharing a corner: all that chance avoids.
            prop_assume!((dx, dy) != (0, 0));
            let start = [f64::from(x) - 3.0, f64::from(y) - 3.0];
            let end = [start[0] + f64::from(dx), start[1] + f64::from(dy)];
            let link = capsule(start, end, 0.0);
            let shape = [
                Shape::Circle { radius: 0.0 },
                Shape::Capsule { a: [-1.0, 0.0], b: [1.0, 0.0], radius: 0.0 },
                Shape::Box { size: [2.0, 2.0] },
                Shape::Polygon { vertices: vec![[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]] },
            ][kind].clone();
            let obstacle = fixed(shape, [0.0, 0.0], 0.0);
            let expected = searched_distance(&link, &corners(&obstacle));
            let found = contact(&link, &obstacle);
            prop_assert!((found.distance.max(0.0) - expected).abs() < 1e-12, "{found:?}");
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-14, "{found:?}");
        }

        #[test]
        fn agrees_with_parry(link in any_link(), size in [0.05..2.0, 0.05..2.0], angle in -PI..PI) {
            use parry2d_f64::{math::Pose, query, shape::Cuboid};
            let segment = Segment::new(to_glam(link.start), to_glam(link.end()));
            let cuboid = Cuboid::new(Point::new(0.5 * size[0], 0.5 * size[1]));
            let pose = Pose::new(Point::new(0.3, -0.2), angle);
            let expected = query::distance(&Pose::IDENTITY, &segment, &pose, &cuboid)
                .unwrap()
                .distance;
            let found = contact(&link, &fixed(Shape::Box { size }, [0.3, -0.2], angle));
            prop_assert!(((found.distance + link.radius).max(0.0) - expected).abs() < 1e-10);
        }
    }

    fn assert_near(a: Vector<2>, b: Vector<2>) {
        assert!((a - b).norm() < 1e-14, "{a} is not {b}");
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

    proptest! {
        /// The least of the barriers is the distance itself; there are no more than announced, and a
        /// circle has its contact alone.
        #[test]
        fn the_least_barrier_is_the_distance(
            link in any_link(),
            shape in prop_oneof![
                Just(Shape::Circle { radius: 0.4 }),
                Just(Shape::Box { size: [1.0, 0.4] }),
                Just(Shape::Capsule { a: [-0.5, 0.1], b: [0.5, 0.0], radius: 0.1 }),
                any_polygon(),
            ],
            angle in 0.0..TAU,
        ) {
            let mut world = World::new(vec![fixed(shape.clone(), [0.3, -0.2], angle)]);
            let contact = world.contact(0, &link, 0);
            let mut barriers = vec![];
            world.for_each_barrier([link], f64::INFINITY, |barrier| barriers.push(*barrier));
            prop_assert!(barriers.len() <= world.barrier_count());
            let least = barriers.iter().map(|b| b.distance).fold(f64::INFINITY, f64::min);
            prop_assert!((least - contact.distance).abs() < 1e-12, "{least} {contact:?}");
            if matches!(shape, Shape::Circle { .. }) {
                prop_assert_eq!(barriers, vec![contact]);
            }
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

    #[test]
    fn unusable_values_do_not_panic() {
        let shapes = [
            Shape::Circle { radius: f64::NAN },
            Shape::Capsule { a: [0.0; 2], b: [0.0; 2], radius: 0.1 },
            Shape::Box { size: [0.0, 1.0] },
            Shape::Box { size: [f64::NAN, 1.0] },
            Shape::Polygon { vertices: vec![] },
            Shape::Polygon { vertices: vec![[1.0, 1.0]; 3] },
        ];
        for shape in shapes {
            for value in [0.0, 1e-200, 1e200, f64::INFINITY, f64::NAN] {
                contact(
                    &capsule([value, 0.0], [1.0, value], 0.1),
                    &fixed(shape.clone(), [0.0; 2], 0.0),
                );
                contact(
                    &capsule([0.0, 0.0], [1.0, 1.0], 0.1),
                    &fixed(shape.clone(), [value; 2], value),
                );
            }
        }
    }

    #[test]
    fn undefined_links_have_undefined_distances() {
        let link = capsule([f64::NAN, 0.0], [1.0, f64::NAN], 0.1);
        for shape in [
            Shape::Circle { radius: 0.1 },
            Shape::Capsule { a: [0.0; 2], b: [1.0; 2], radius: 0.1 },
            Shape::Box { size: [1.0; 2] },
        ] {
            assert!(contact(&link, &fixed(shape, [0.0; 2], 0.0)).distance.is_nan());
        }
    }
}
