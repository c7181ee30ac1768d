//! How far two convex bodies are apart at least (T194): what a certificate needs of a hull, for far less work than where it comes
//! nearest.
//!
//! parry's GJK looks for a plane between them, and the plane is the proof, whoever found it: all of one lies on one side, all of the
//! other so far on the other side. Where a plane tells that they are farther apart than is asked, the search ends.

use super::{Convex, Form, PlacedHull, Probe};
use crate::math::Vector;
use parry3d_f64::math::{Pose, Vector as Vec3};
use parry3d_f64::query::gjk::{CsoPoint, GJKResult, VoronoiSimplex, closest_points};
use parry3d_f64::shape::SupportMap;

/// What parry asks of something convex.
struct Farthest<F>(F);

impl<F: Fn(&Vector<3>) -> Vector<3>> SupportMap for Farthest<F> {
    fn local_support_point(&self, direction: Vec3) -> Vec3 {
        let [x, y, z] = direction.to_array();
        Vec3::from_array((self.0)(&Vector::<3>::new(x, y, z)).into())
    }
}

impl PlacedHull<'_, 3> {
    /// The distance from something convex of this `radius` \[m\], in whose frame it is: never more than that, and less by
    /// rounding alone. From `limit` \[m\] on, `limit`; where the cores overlap, −∞; NaN where something is undefined.
    pub(crate) fn gap(&self, other: &impl Convex, radius: f64, limit: f64) -> f64 {
        let own = Farthest(|direction: &Vector<3>| {
            let direction = self.rotation.tr_mul(direction);
            let corners = self.hull.corners.iter().map(|corner| &corner.point);
            let ahead = corners.map(|point| (direction.dot(point), point));
            let farthest = ahead.reduce(|best, next| if next.0 > best.0 { next } else { best });
            farthest.map_or(self.position, |(_, point)| self.placed(point))
        });
        let others = Farthest(|direction: &Vector<3>| other.farthest(direction));
        let first = Vec3::from_array((-self.position).into());
        let seen =
            |direction: Vec3| CsoPoint::from_shapes(&Pose::IDENTITY, &own, &others, direction);
        let begin = seen(first);
        if !(begin.point.length() + self.rotation.sum()).is_finite() {
            return f64::NAN;
        }
        let mut simplex = VoronoiSimplex::new();
        simplex.reset(begin);
        let most = limit + radius;
        match closest_points(&Pose::IDENTITY, &own, &others, most.max(0.0), true, &mut simplex) {
            GJKResult::ClosestPoints(.., direction) => {
                let apart = -direction.dot(seen(direction).point);
                (apart - radius).min(limit)
            }
            GJKResult::NoIntersection(_) => limit,
            _ => f64::NEG_INFINITY,
        }
    }
}

/// [`PlacedHull::gap`] of two bodies, of which one is a hull at least; of two capsules ∞.
pub(crate) fn gap_between([a, b]: [&Form<'_>; 2], limit: f64) -> f64 {
    match (&a.1, &b.1) {
        (None, None) => f64::INFINITY,
        (Some(hull), None) => {
            // About the end of the axis, for what rounding makes of a long way.
            let position = hull.position - b.0.start;
            let axis = Probe { start: Vector::zeros(), ..b.0 };
            PlacedHull { position, ..*hull }.gap(&axis, axis.radius, limit)
        }
        (None, Some(_)) => gap_between([b, a], limit),
        (Some(hull), Some(other)) => {
            let rotation = other.rotation.tr_mul(hull.rotation);
            let position = other.seen(&hull.position);
            PlacedHull { hull: hull.hull, rotation: &rotation, position }
                .gap(other.hull, 0.0, limit)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cases::*;
    use super::*;
    use crate::geometry::Hull;
    use nalgebra::{Rotation3, Vector3};
    use proptest::prelude::*;

    fn any_points() -> impl Strategy<Value = Vec<[f64; 3]>> {
        prop::collection::vec([-0.5..0.5, -0.5..0.5, -0.5..0.5], 8..24)
    }

    proptest! {
        /// Never more than the distance that all pairs of features have, and less by rounding alone; a limit ends the search
        /// at no other answer.
        #[test]
        fn is_what_all_features_say(
            points in any_points(), others in any_points(), turn in [-3.0..3.0, -3.0..3.0, -3.0..3.0],
            away in [-2.0..2.0, -2.0..2.0, -2.0..2.0], radius in 0.0..0.2, limit in -0.1..1.0,
        ) {
            let (hull, other) = (Hull::new(&points).unwrap(), Hull::new(&others).unwrap());
            let rotation = *Rotation3::new(Vector3::from(turn)).matrix();
            let placed = PlacedHull { hull: &hull, rotation: &rotation, position: Vector::from(away) };
            let axis = capsule(others[0], others[1], 0.0);
            for (exact, radius, bounded) in [
                (placed.meet(&other).nearest.distance, 0.0, placed.gap(&other, 0.0, limit)),
                (placed.meet(&axis).nearest.distance, radius, placed.gap(&axis, radius, limit)),
            ] {
                let distance = exact - radius;
                if exact <= 1e-9 {
                    // Cores that touch.
                    prop_assert!(bounded <= distance.max(-radius) + 1e-9, "{bounded} {distance}");
                } else {
                    let expected = distance.min(limit);
                    prop_assert!((bounded - expected).abs() <= 1e-9, "{bounded} is not {expected}");
                    prop_assert!(bounded <= expected + 1e-12);
                }
            }
        }
    }

    #[test]
    fn undefined_places_are_undefined() {
        let hull = Hull::new(&corners_of([1.0; 3])).unwrap();
        let rotation = nalgebra::Matrix3::identity();
        for bad in [f64::NAN, f64::INFINITY] {
            let position = Vector::<3>::new(bad, 0.0, 0.0);
            let placed = PlacedHull { hull: &hull, rotation: &rotation, position };
            assert!(placed.gap(&hull, 0.0, 1.0).is_nan());
        }
    }
}
