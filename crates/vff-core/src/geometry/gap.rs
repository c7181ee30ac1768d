//! How far two convex bodies are apart at least (T194): what a certificate needs of a hull, for far less work than where it comes
//! nearest.
//!
//! parry's GJK looks for a plane between them, and the plane is the proof, whoever found it: all of one lies on one side, all of the
//! other so far on the other side. Where a plane tells that they are farther apart than is asked, the search ends; and the plane that
//! told it last is asked before there is a search.

use super::{Convex, Form, PlacedHull, Probe};
use crate::math::Vector;
use parry3d_f64::math::{Pose, Vector as Vec3};
use parry3d_f64::query::gjk::{CsoPoint, GJKResult, VoronoiSimplex, closest_points};
use parry3d_f64::shape::SupportMap;

/// A hull, and something convex in whose frame it is, as parry asks for them.
struct Own<'a>(&'a PlacedHull<'a, 3>);
struct Other<'a, C>(&'a C);

impl SupportMap for Own<'_> {
    fn local_support_point(&self, direction: Vec3) -> Vec3 {
        let direction = self.0.rotation.tr_mul(&Vector::from(direction.to_array()));
        let farthest = self.0.hull.farthest_corner(&direction);
        Vec3::from_array(self.0.placed(&self.0.hull.corners[farthest].point).into())
    }
}

impl<C: Convex> SupportMap for Other<'_, C> {
    fn local_support_point(&self, direction: Vec3) -> Vec3 {
        Vec3::from_array(self.0.farthest(&Vector::from(direction.to_array())).into())
    }

    /// It is where it is.
    fn support_point(&self, _: &Pose, direction: Vec3) -> Vec3 {
        self.local_support_point(direction)
    }
}

impl PlacedHull<'_, 3> {
    /// The distance from something convex of this `radius` \[m\], in whose frame it is: never more than that, and less by
    /// rounding alone. From `limit` on, anything that is not below; where the cores overlap, −∞; NaN where something is undefined.
    /// The `plane` that was between them, by its normal, is asked first, and becomes the one that was found; 0 where none is known.
    pub(crate) fn gap(
        &self,
        other: &impl Convex,
        radius: f64,
        limit: f64,
        plane: &mut Vector<3>,
    ) -> f64 {
        let (own, others) = (Own(self), Other(other));
        let seen =
            |direction: Vec3| CsoPoint::from_shapes(&Pose::IDENTITY, &own, &others, direction);
        let is_known = plane.norm_squared() > 0.0;
        let first = Vec3::from_array(if is_known { *plane } else { -self.position }.into());
        let begin = seen(first);
        if !(begin.point.length() + self.rotation.sum()).is_finite() {
            return f64::NAN;
        }
        if is_known {
            let known = -first.dot(begin.point) - radius;
            if known >= limit {
                return known;
            }
        }
        let most = (limit + radius).max(0.0);
        let mut simplex = VoronoiSimplex::new();
        simplex.reset(begin);
        match closest_points(&Pose::IDENTITY, &own, &others, most, true, &mut simplex) {
            // A search that gives up names any plane.
            GJKResult::ClosestPoints(.., normal) | GJKResult::NoIntersection(normal) => {
                *plane = normal.to_array().into();
                -normal.dot(seen(normal).point) - radius
            }
            _ => f64::NEG_INFINITY,
        }
    }

    /// [`gap`](Self::gap) from a capsule, about the start of its axis for what rounding makes of a long way.
    fn gap_to_capsule(&self, capsule: &Probe, limit: f64, plane: &mut Vector<3>) -> f64 {
        let axis = Probe { start: Vector::zeros(), ..*capsule };
        let position = self.position - capsule.start;
        Self { position, ..*self }.gap(&axis, capsule.radius, limit, plane)
    }

    /// The same with the `plane` as the capsule sees it: the hull is beyond.
    pub(crate) fn gap_from_capsule(
        &self,
        capsule: &Probe,
        limit: f64,
        plane: &mut Vector<3>,
    ) -> f64 {
        plane.neg_mut();
        let gap = self.gap_to_capsule(capsule, limit, plane);
        plane.neg_mut();
        gap
    }
}

/// [`PlacedHull::gap`] of two bodies, of which one is a hull at least, with the `plane` as the world sees it; of two capsules ∞.
pub(crate) fn gap_between([a, b]: [&Form<'_>; 2], limit: f64, plane: &mut Vector<3>) -> f64 {
    match (&a.1, &b.1) {
        (None, None) => f64::INFINITY,
        (Some(hull), None) => hull.gap_to_capsule(&b.0, limit, plane),
        (None, Some(hull)) => hull.gap_from_capsule(&a.0, limit, plane),
        (Some(hull), Some(other)) => {
            let rotation = other.rotation.tr_mul(hull.rotation);
            let position = other.seen(&hull.position);
            *plane = other.rotation.tr_mul(plane);
            let gap = PlacedHull { hull: hull.hull, rotation: &rotation, position }
                .gap(other.hull, 0.0, limit, plane);
            *plane = other.rotation * *plane;
            gap
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

    properties! {
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
            let gap = |plane: [f64; 3]| {
                let mut planes = [Vector::<3>::from(plane); 2];
                let [one, two] = &mut planes;
                let found = [placed.gap(&other, 0.0, limit, one), placed.gap(&axis, radius, limit, two)];
                (found, planes)
            };
            // Without a plane that is known, with the one that was found, and with any.
            let (first, found) = gap([0.0; 3]);
            let again = [0, 1].map(|k| gap(found[k].into()).0[k]);
            let unit = Vector::<3>::from(turn).normalize();
            let exact = [
                (placed.meet(&other).nearest.distance, 0.0),
                (placed.meet(&axis).nearest.distance, radius),
            ];
            let all = [first, again, gap(unit.into()).0];
            for (bounded, (exact, radius)) in all.iter().flat_map(|bounded| bounded.iter().zip(exact)) {
                let (bounded, distance) = (*bounded, exact - radius);
                if exact <= 1e-9 {
                    // Cores that touch.
                    prop_assert!(bounded <= distance.max(-radius) + 1e-9, "{bounded} {distance}");
                } else {
                    prop_assert!(bounded >= distance.min(limit) - 1e-9, "{bounded} of {distance} is below {limit}");
                    prop_assert!(bounded <= distance + 1e-12, "{bounded} is more than {distance}");
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
            assert!(placed.gap(&hull, 0.0, 1.0, &mut Vector::zeros()).is_nan());
        }
    }
}
