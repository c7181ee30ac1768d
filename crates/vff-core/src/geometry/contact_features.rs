//! Two bodies of one arm, of which one or both are hulls.

use super::{Convex, HullContact, KSmallest, MAX_FEATURES, PlacedHull, Probe};
use crate::math::{Capsule, Feature, Nearest, TOUCHING, Vector};

/// The parts of two bodies that come nearest: an edge of a hull counts as a capsule without a radius.
///
/// # Example
/// ```
/// use nalgebra::Matrix3;
/// use vff_core::geometry::{PlacedHull, ContactFeature, Hull, contact_features};
/// use vff_core::math::{Capsule, Vector};
///
/// let hull = Hull::new(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]).unwrap();
/// let rotation = Matrix3::identity();
/// let carried = PlacedHull { hull: &hull, rotation: &rotation, position: Vector::<3>::zeros() };
/// let [a, b] = [0.2, 0.4].map(|x| Vector::<3>::new(x, 0.1, 0.5));
/// let above = (Capsule::new(a, b, 0.1), None);
/// let mut distances = vec![];
/// let mut visit = |found: &ContactFeature<3>| distances.push(found.nearest.distance);
/// contact_features([&(hull.enclosing(), Some(carried)), &above], None, &mut visit);
/// assert!((distances[0] - 0.4).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactFeature<const D: usize> {
    /// These parts; of a corner or a face only its place.
    pub shapes: [Capsule<D>; 2],
    /// Where they come nearest.
    pub nearest: Nearest<D>,
}

/// A body: a capsule, or a hull and the capsule around it.
pub(crate) type Form<'a, const D: usize = 3> = (Capsule<D>, Option<PlacedHull<'a, D>>);

/// Calls `visit` with the nearest parts of two bodies, or with all those `features` nearer than this \[m\] that may be the nearest
/// when these change hands, the nearest 32. Nothing for two capsules.
pub fn contact_features(
    [a, b]: [&Form<'_>; 2],
    features: Option<f64>,
    visit: &mut dyn FnMut(&ContactFeature<3>),
) {
    match (&a.1, &b.1) {
        (None, None) => {}
        (Some(hull), None) => {
            let told = |contact: &HullContact, distance: f64| told(contact, distance, b.0.radius);
            let features = features.map(|reach| reach + b.0.radius);
            ask(hull, &Probe { radius: 0.0, ..b.0 }, features, told, visit);
        }
        (None, Some(_)) => {
            contact_features([b, a], features, &mut |found| visit(&found.seen_from_the_other()));
        }
        (Some(hull), Some(other)) => {
            let rotation = other.rotation.tr_mul(hull.rotation);
            let position = other.seen(&hull.position);
            let seen = PlacedHull { hull: hull.hull, rotation: &rotation, position };
            let told =
                |contact: &HullContact, distance: f64| told(&placed(contact, other), distance, 0.0);
            ask(&seen, other.hull, features, told, visit);
        }
    }
}

fn ask(
    hull: &PlacedHull<'_, 3>,
    other: &impl Convex,
    features: Option<f64>,
    told: impl Fn(&HullContact, f64) -> ContactFeature<3>,
    visit: &mut dyn FnMut(&ContactFeature<3>),
) {
    let contact = hull.meet(other);
    let distance = contact.nearest.distance;
    let Some(reach) = features.filter(|_| distance > TOUCHING) else {
        return visit(&told(&contact, distance));
    };
    let mut rows = KSmallest::<_, MAX_FEATURES>::new((contact, distance));
    hull.for_each_row(other, &contact.nearest, reach, |contact, distance| {
        rows.add(distance, (*contact, distance));
    });
    rows.for_each(|(contact, distance)| visit(&told(contact, *distance)));
}

/// What was found in the frame of a hull, in the world.
fn placed(contact: &HullContact, frame: &PlacedHull<'_, 3>) -> HullContact {
    let turned = |v: &Vector<3>| frame.rotation * v;
    let mut found = *contact;
    found.axis = turned(&contact.axis);
    found.nearest.normal = turned(&contact.nearest.normal);
    found.nearest.point = frame.placed(&contact.nearest.point);
    if let Feature::Edge { edge, .. } | Feature::Crossing { edge, .. } = &mut found.nearest.feature
    {
        *edge = turned(edge);
    }
    found
}

/// A contact of a hull, the first, with something of this radius; `of_cores` is its distance with relief \[m\], by which the
/// other counts as thinner.
fn told(contact: &HullContact, of_cores: f64, radius: f64) -> ContactFeature<3> {
    let super::axis::Nearest { distance, normal, point, feature } = contact.nearest;
    let part = |start, direction, radius| Capsule { start, direction, length: 0.0, radius };
    let (edge, slides, flat) = match feature {
        Feature::Side { .. } => (Vector::zeros(), [true, false], [false; 2]),
        Feature::End { .. } => (Vector::zeros(), [false; 2], [false; 2]),
        Feature::Face => (Vector::zeros(), [false; 2], [false, true]),
        Feature::LinkFace { .. } => (Vector::zeros(), [false; 2], [true, false]),
        Feature::Edge { edge, .. } => (edge, [false, true], [false; 2]),
        Feature::Crossing { edge, .. } => (edge, [true; 2], [false; 2]),
    };
    let points = [point, point - normal * distance];
    ContactFeature {
        shapes: [
            part(point, contact.axis, 0.0),
            part(points[1], edge, radius - (of_cores - distance)),
        ],
        nearest: Nearest { points, normal, distance: of_cores - radius, slides, flat },
    }
}

impl ContactFeature<3> {
    fn seen_from_the_other(&self) -> Self {
        let Self { shapes: [a, b], nearest } = *self;
        let Nearest { points: [p, q], normal, distance, slides: [s, t], flat: [f, g] } = nearest;
        let nearest =
            Nearest { points: [q, p], normal: -normal, distance, slides: [t, s], flat: [g, f] };
        Self { shapes: [b, a], nearest }
    }
}
