//! The distances that must be kept so that features may change hands (T97).

use super::axis::{Nearest, PARALLEL, Probe, across, across_normal, perpendicular, seen_from};
use super::cuboid::Cuboid;
use super::volume::{Core, Volume};
use crate::math::Vector;
use crate::world::{Contact, Feature, MotionState, RELIEF, TOUCHING};

impl Volume {
    /// Every distance of an end, a corner or an edge that may be the least when features change hands; of a point, or where
    /// the axis has got into the core, that of `contact` alone.
    #[inline]
    pub(super) fn visit_barriers(
        &self,
        contact: &Contact<3>,
        link: &Probe,
        state: &MotionState<3>,
        mut visit: impl FnMut(&Contact<3>),
    ) {
        let apart = contact.distance + self.radius + link.radius > TOUCHING;
        if matches!(self.core, Core::Point(_)) || !apart {
            return visit(contact);
        }
        let axis = seen_from(link, &state.position);
        let mut visit = |nearest: &Nearest, beyond: f64| {
            let found = self.contact_of(contact.pair(), nearest, link.radius, state);
            visit(&Contact { distance: found.distance + RELIEF * beyond, ..found });
        };
        visit(&self.end(axis.start), 0.0);
        // A ball is one end.
        if axis.length <= 0.0 {
            return;
        }
        visit(&self.end(axis.end()), 0.0);
        match &self.core {
            Core::Segment(segment) => {
                for corner in [segment.start, segment.end()] {
                    let (nearest, beyond) = to_corner(&axis, &corner);
                    visit(&nearest, beyond);
                }
                if let Some((nearest, beyond)) = to_edge(&axis, segment) {
                    visit(&nearest, beyond);
                }
            }
            Core::Box(cuboid) => {
                for outward in cuboid.corners() {
                    let (nearest, beyond) = to_corner(&axis, &cuboid.at(&outward));
                    visit(&nearest, beyond + cuboid.averted(&nearest, &outward));
                }
                for (k, outward) in cuboid.edges() {
                    let mut start = outward;
                    start[k] = -1.0;
                    let length = 2.0 * cuboid.half[k];
                    let direction = cuboid.axis(k);
                    let edge = Probe { start: cuboid.at(&start), direction, length, radius: 0.0 };
                    if let Some((nearest, beyond)) = to_edge(&axis, &edge) {
                        visit(&nearest, beyond + cuboid.averted(&nearest, &outward));
                    }
                }
            }
            Core::Point(_) | Core::HalfSpace(_) => {}
        }
    }

    /// An end of a link outside of the core. It counts as opposite a face everywhere: that the normal turns about an edge or a
    /// corner is left out, which is the safe side (T77).
    fn end(&self, end: Vector<3>) -> Nearest {
        let offset = match &self.core {
            Core::Point(point) => end - point,
            Core::Segment(segment) => end - segment.clamp(&end),
            Core::Box(cuboid) => cuboid.axes * cuboid.excess(&cuboid.axes.tr_mul(&end)),
            Core::HalfSpace(normal) => {
                let distance = normal.dot(&end);
                return Nearest { distance, normal: *normal, point: end, feature: Feature::Face };
            }
        };
        let distance = offset.norm();
        Nearest { distance, normal: offset / distance, point: end, feature: Feature::Face }
    }
}

/// The line through an axis beside a corner, and how far beyond the ends of the axis that is.
fn to_corner(axis: &Probe, corner: &Vector<3>) -> (Nearest, f64) {
    let along = axis.direction.dot(&(corner - axis.start));
    let point = axis.start + axis.direction * along;
    let between = point - corner;
    let distance = between.norm();
    let (normal, feature) = if distance > TOUCHING {
        (between / distance, Feature::Side { distance })
    } else {
        (perpendicular(&axis.direction), Feature::Face)
    };
    (Nearest { distance, normal, point, feature }, beyond(along, axis.length))
}

/// The lines through an axis and an edge, and how far beyond the ends of both they come nearest; none if they are parallel.
fn to_edge(axis: &Probe, edge: &Probe) -> Option<(Nearest, f64)> {
    let offset = axis.start - edge.start;
    let cross = axis.direction.cross(&edge.direction);
    let sin_squared = cross.norm_squared();
    if sin_squared <= PARALLEL * PARALLEL {
        return None;
    }
    let cos = axis.direction.dot(&edge.direction);
    let s = -offset.cross(&edge.direction).dot(&cross) / sin_squared;
    let t = edge.direction.dot(&offset) + s * cos;
    let point = axis.start + axis.direction * s;
    let between = offset + axis.direction * s - edge.direction * t;
    let distance = across(&cross, &between);
    let feature = Feature::Crossing { edge: edge.direction, distance };
    let nearest = Nearest { distance, normal: across_normal(&cross, &between), point, feature };
    Some((nearest, beyond(s, axis.length) + beyond(t, edge.length)))
}

fn beyond(along: f64, length: f64) -> f64 {
    (-along).max(along - length).max(0.0)
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

    /// How far the box comes towards the axis beside a corner or an edge that is turned away from it: 0 where it is the
    /// nearest.
    fn averted(&self, nearest: &Nearest, outward: &Vector<3>) -> f64 {
        let most = self.axes.tr_mul(&nearest.normal).component_mul(outward).min();
        nearest.distance * (-most).max(0.0)
    }
}
