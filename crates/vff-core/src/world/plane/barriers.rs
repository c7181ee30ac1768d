//! The distances that must be kept so that features may change hands.

use super::axis::{Meets, Nearest, Probe};
use super::face::Face;
use super::geometry::{Core, PlanarGeometry};
use super::{Vec2, to_glam};
use crate::world::{Contact, MotionState, RELIEF, TOUCHING};

impl PlanarGeometry {
    /// The edges; none of a point.
    fn edges(&self) -> &[Face] {
        match &self.core {
            Core::Point(_) => &[],
            Core::Segment(face) => std::slice::from_ref(face),
            Core::Convex(faces) => faces,
        }
    }

    /// Every distance of an end or a corner that may be the least when features change hands (T77);
    /// of a point, or where the axis has got into the core, that of `contact` alone.
    #[inline]
    pub(super) fn visit_barriers(
        &self,
        contact: &Contact<2>,
        link: &Probe,
        state: &MotionState<2>,
        mut visit: impl FnMut(&Contact<2>),
    ) {
        let Probe { axis, radius } = *link;
        let edges = self.edges();
        let apart = contact.distance + self.radius + radius > TOUCHING;
        if edges.is_empty() || !apart {
            return visit(contact);
        }
        let axis = axis.seen_from(to_glam(state.position));
        let mut visit = |nearest: &Nearest, beyond: f64| {
            let found = self.contact_of(contact.pair(), nearest, link, state);
            visit(&Contact { distance: found.distance + RELIEF * beyond, ..found });
        };
        for end in [axis.start, axis.end()] {
            visit(&end_to_edges(end, edges), 0.0);
        }
        let last = matches!(self.core, Core::Segment(_)).then(|| edges[0].end());
        for corner in edges.iter().map(|edge| edge.start).chain(last) {
            let along = axis.forward.dot(corner - axis.start);
            let foot = axis.start + axis.forward * along;
            let beyond = (-along).max(along - axis.length).max(0.0);
            visit(&axis.beside(axis.start - corner, foot), beyond);
        }
    }
}

/// The nearest point of these edges to an end of a link outside of what they enclose. It counts as a face
/// everywhere: that the normal turns about a corner is left out, which is the safe side (T77).
fn end_to_edges(end: Vec2, edges: &[Face]) -> Nearest {
    let mut nearest =
        Nearest { distance: f64::INFINITY, normal: Vec2::ZERO, point: end, meets: Meets::Face };
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

#[cfg(test)]
mod tests {
    use super::super::oracle::*;
    use super::super::{Shape, World};
    use crate::geometry::Body;
    use crate::world::CollisionQuery;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    properties! {
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
            let link = Body::new(0, link);
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
}
