//! The distances that must be kept so that features may change hands (T98).

use super::contact::{axis_of, contact_of};
use super::geometry::SpatialGeometry;
use super::shape::{ConvexCore, dispatch};
use crate::geometry::axis::{Nearest, Probe, beyond, perpendicular, seen_from, to_edge};
use crate::geometry::{Convex, averted};
use crate::math::Vector;
use crate::world::{Contact, Feature, MotionState, RELIEF, TOUCHING};

impl SpatialGeometry {
    /// Every distance of an end, a corner or an edge that may be the least when features change hands; of a point or of one
    /// of a cloud, or where the axis has got into the core, that of `contact` alone.
    #[inline]
    pub(super) fn visit_barriers(
        &self,
        contact: &Contact<3>,
        link: &Probe,
        state: &MotionState<3>,
        mut visit: impl FnMut(&Contact<3>),
    ) {
        dispatch!(
            &self.core,
            shape => self.barriers_of(shape, contact, link, state, visit),
            _cloud => visit(contact)
        );
    }

    #[inline]
    fn barriers_of(
        &self,
        core: &impl ConvexCore,
        contact: &Contact<3>,
        link: &Probe,
        state: &MotionState<3>,
        mut visit: impl FnMut(&Contact<3>),
    ) {
        let apart = contact.distance + self.radius + link.radius > TOUCHING;
        if core.features().is_none() || !apart {
            return visit(contact);
        }
        let axis = seen_from(link, &state.position);
        let radii = [self.radius, link.radius];
        let mut visit = |nearest: &Nearest, beyond: f64| {
            let found = contact_of(contact.pair(), nearest, &axis_of(link), radii, state);
            visit(&Contact { distance: found.distance + RELIEF * beyond, ..found });
        };
        visit(&core.end(axis.start), 0.0);
        // A ball is one end.
        if axis.length > 0.0 {
            visit(&core.end(axis.end()), 0.0);
            beside(&axis, core, visit);
        }
    }
}

/// An axis with an inside, and every corner and edge.
#[inline]
fn beside(axis: &Probe, core: &impl Convex, mut visit: impl FnMut(&Nearest, f64)) {
    core.for_each_corner(|corner, onward| {
        let (nearest, beyond) = to_corner(axis, corner);
        visit(&nearest, beyond + averted(&nearest, onward));
    });
    core.for_each_edge(|edge, onward| {
        if let Some((nearest, beyond)) = to_edge(axis, edge) {
            visit(&nearest, beyond + averted(&nearest, onward));
        }
    });
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

#[cfg(test)]
mod tests {
    use super::super::oracle::*;
    use super::super::{Shape, World};
    use crate::geometry::Body;
    use crate::math::Capsule;
    use crate::world::{CollisionQuery, Contact, Feature};
    use proptest::prelude::*;

    fn barriers(link: &Capsule<3>, world: &mut World) -> Vec<Contact<3>> {
        let mut found = vec![];
        let body = Body::new(0, *link);
        world.for_each_barrier([body], f64::INFINITY, |barrier| found.push(*barrier));
        found
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(1500))]

        /// The least of the barriers is the distance itself, and among them is the contact's own pair of points; there are
        /// no more than announced, and a sphere has its contact alone.
        #[test]
        fn the_least_barrier_is_the_distance(link in any_link(), obstacle in any_obstacle()) {
            let mut world = World::new(vec![obstacle.clone()]);
            let contact = world.contact(0, &Body::new(0, link), 0);
            let barriers = barriers(&link, &mut world);
            prop_assert!(barriers.len() <= world.barrier_count());
            let least = barriers.iter().min_by(|a, b| a.distance.total_cmp(&b.distance)).unwrap();
            prop_assert!((least.distance - contact.distance).abs() < 1e-12, "{least:?} {contact:?}");
            if matches!(obstacle.shape, Shape::Sphere { .. }) {
                prop_assert_eq!(&barriers, &vec![contact]);
            }
            // Parallel things have several nearest pairs.
            prop_assume!(!matches!(obstacle.shape, Shape::HalfSpace { .. }));
            let near = |b: &Contact<3>| {
                (b.distance - contact.distance).abs() < 1e-9 && (b.normal - contact.normal).norm() < 1e-6
            };
            prop_assert!(barriers.iter().any(near), "{contact:?}");
        }

        /// While a link moves, no barrier that is near the least jumps: neither its distance nor its normal.
        #[test]
        fn barriers_do_not_jump(
            link in any_link(), obstacle in any_obstacle(), along in direction(),
        ) {
            prop_assume!(link.length > 0.0);
            let mut world = World::new(vec![obstacle]);
            let step = 1e-4;
            let [before, after] = [0.0, step].map(|by| {
                let link = translated(&link, &(along * by));
                (contact_of(&link, &world), barriers(&link, &mut world))
            });
            prop_assume!(before.0 > 0.05 + link.radius && after.0 > 0.05 + link.radius);
            prop_assert_eq!(before.1.len(), after.1.len());
            for (a, b) in before.1.iter().zip(&after.1) {
                // Relief grows by 10 m per metre that a foot slides, which it does at 1/sin² at most.
                let oblique = match a.feature {
                    Feature::Crossing { edge, .. } => link.direction.cross(&edge).norm_squared(),
                    _ => 1.0,
                };
                prop_assert!((a.distance - b.distance).abs() < 100.0 * step / oblique, "{a:?} {b:?}");
            }
        }
    }

    fn contact_of(link: &Capsule<3>, world: &World) -> f64 {
        world.contact(0, &Body::new(0, *link), 0).distance
    }

    /// Parallel axes: both ends are held, and a link that turns about either keeps the distance there.
    #[test]
    fn parallel_axes_are_held_at_both_ends() {
        let link = capsule([0.0, 0.0, 1.0], [1.0, 0.0, 1.0], 0.1);
        for shape in [
            Shape::Capsule { a: [-1.0, 0.0, 0.0], b: [2.0, 0.0, 0.0], radius: 0.2 },
            Shape::Box { size: [4.0, 2.0, 0.4] },
            Shape::Convex {
                vertices: vec![
                    [-1.0, -1.0, 0.2],
                    [2.0, 0.0, 0.2],
                    [-1.0, 1.0, 0.2],
                    [0.0, 0.0, -1.0],
                ],
            },
            Shape::HalfSpace { normal: [0.0, 0.0, 1.0] },
        ] {
            let position =
                if let Shape::HalfSpace { .. } = shape { [0.0, 0.0, 0.2] } else { [0.0; 3] };
            let mut world = World::new(vec![fixed(shape, position)]);
            let found = barriers(&link, &mut world);
            for end in [link.start, link.end()] {
                let held = found.iter().any(|b| {
                    (b.point - end).norm() < 1e-12
                        && (b.distance - 0.7).abs() < 1e-12
                        && b.feature == Feature::Face
                });
                assert!(held, "{found:?}");
            }
        }
    }
}
