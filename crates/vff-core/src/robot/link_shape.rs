//! What a link of an arm in space looks like to obstacles and to other links.

use super::description_error::{DescriptionError, DescriptionProblem, fault, finite, unit};
use super::frame::Frame;
use super::inertia::Body;
use super::solid;
use crate::geometry::{Hull, Shape, ShapeFault, WithKind, faces_of_hull};
use crate::math::{Capsule, Vector, upright};
use crate::settings::POSITIVE;
use nalgebra::{Isometry3, Point3, Translation3};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// A shape on a link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkShape {
    /// Name of the link, or of the base.
    pub link: String,
    /// What is there.
    pub shape: PlacedShape,
    /// Whether it is of something that the link carries: what the arm is to `ignore` does not count for it.
    #[serde(default, skip_serializing_if = "is_own")]
    pub carried: bool,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde asks")]
fn is_own(carried: &bool) -> bool {
    !carried
}

impl LinkShape {
    /// A shape of a link itself.
    pub fn of(link: impl Into<String>, shape: impl Into<PlacedShape>) -> Self {
        Self { link: link.into(), shape: shape.into(), carried: false }
    }
}

/// A shape in the frame of a link, which has the ends of a capsule and the points of a hull; a sphere and a box say
/// where they are.
///
/// A link carries spheres, capsules, boxes and hulls, no half-spaces and no clouds.
///
/// # Example
/// ```
/// use vff_core::geometry::Shape;
/// use vff_core::robot::description::PlacedShape;
///
/// let ball = PlacedShape { center: Some([0.0, 0.0, 0.1]), ..Shape::Sphere { radius: 0.05 }.into() };
/// assert_eq!(ball.orientation, None);
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlacedShape {
    /// In its own frame.
    #[serde(flatten, with = "WithKind")]
    pub shape: Shape,
    /// Of a sphere or a box \[m\]. Default: the origin of the link's frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub center: Option<[f64; 3]>,
    /// Of the edges of a box: a quaternion `[w, x, y, z]`. Default: along the axes of the link's frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation: Option<[f64; 4]>,
}

/// At the origin of the link's frame, along its axes.
impl From<Shape> for PlacedShape {
    fn from(shape: Shape) -> Self {
        Self { shape, center: None, orientation: None }
    }
}

impl PlacedShape {
    /// Checks it, and says in full where a sphere or a box is.
    ///
    /// # Errors
    /// With the first value that is wrong, below `path`.
    pub(super) fn check(&mut self, path: &str) -> Result<(), DescriptionError> {
        let at = |key: &str| format!("{path}.{key}");
        if let Shape::Capsule { a, b, radius } = self.shape
            && ShapeFault::of_ends(&a, &b).is_err()
        {
            self.center.get_or_insert(a);
            self.shape = Shape::Sphere { radius };
        }
        let given =
            [("center", self.center.is_some()), ("orientation", self.orientation.is_some())];
        let own = match &self.shape {
            Shape::Sphere { .. } => 1,
            Shape::Box { .. } => 2,
            _ => 0,
        };
        if let Some((key, _)) = given[own..].iter().find(|(_, given)| *given) {
            let sentence =
                ShapeFault::stated(key, "left out: it is part of another kind of shape".into());
            return Err(refused(path, sentence));
        }
        if own > 0 {
            finite(&at("center"), self.center.get_or_insert_default())?;
        }
        if own > 1 {
            let orientation = self.orientation.get_or_insert_with(upright);
            unit(orientation).map_err(|problem| fault(at("orientation"), problem))?;
        }
        if let Shape::Capsule { radius, .. } = self.shape {
            ShapeFault::of_radius(radius, &POSITIVE).map_err(|error| refused(path, error))?;
        }
        self.shape.check().map_err(|error| refused(path, error))
    }

    /// Checks it below `path`, and what of it is solid, as a body of 1 kg/m³.
    ///
    /// # Errors
    /// As of the shape of a link.
    pub fn checked_solid(&mut self, path: &str) -> Result<Body, DescriptionError> {
        self.check(path)?;
        let Some((key, corners)) = self.corners() else {
            return Ok(solid::capsule(&self.solid(path, |point| point)?.0));
        };
        let faces = faces_of_hull(&corners)
            .map_err(|error| refused(path, ShapeFault::stated(key, error.to_string())))?;
        Ok(solid::polyhedron(&corners, &faces))
    }

    /// The same shape in a frame in which its own has this pose.
    #[must_use]
    pub fn moved(&self, pose: &Isometry3<f64>) -> Self {
        let placed = |p: [f64; 3]| <[f64; 3]>::from((pose * Point3::from(p)).coords);
        let shape = match &self.shape {
            Shape::Capsule { a, b, radius } => {
                Shape::Capsule { a: placed(*a), b: placed(*b), radius: *radius }
            }
            Shape::Convex { vertices } => {
                Shape::Convex { vertices: vertices.iter().map(|p| placed(*p)).collect() }
            }
            other => other.clone(),
        };
        let Self { center, orientation, .. } = *self;
        let turned = |orientation: [f64; 4]| {
            let own = Isometry3::from(Frame { orientation, ..Frame::default() });
            Frame::from(Isometry3::from_parts(Translation3::identity(), pose.rotation) * own)
                .orientation
        };
        Self { shape, center: center.map(placed), orientation: orientation.map(turned) }
    }

    /// The capsule that it is, or the hull and a capsule that holds it, in a frame in which its points are `placed`.
    ///
    /// # Errors
    /// If it is nothing that links carry, below `path`.
    pub(super) fn solid(
        &self,
        path: &str,
        placed: impl Fn(Vector<3>) -> Vector<3>,
    ) -> Result<(Capsule<3>, Option<Hull>), DescriptionError> {
        let round = |[a, b]: [[f64; 3]; 2], radius: f64| {
            (swept(placed(a.into()), placed(b.into()), radius), None)
        };
        if let Some((key, points)) = self.corners() {
            let points: Vec<[f64; 3]> =
                points.iter().map(|point| placed((*point).into()).into()).collect();
            let (hull, around) = Hull::with_capsule(&points)
                .map_err(|error| refused(path, ShapeFault::stated(key, error.to_string())))?;
            return Ok((around, Some(hull)));
        }
        match &self.shape {
            Shape::Sphere { radius } => Ok(round([self.center.unwrap_or_default(); 2], *radius)),
            Shape::Capsule { a, b, radius } => Ok(round([*a, *b], *radius)),
            _ => {
                let carried = "sphere, capsule, box or convex: a link carries nothing else";
                Err(refused(path, ShapeFault::stated("kind", carried.into())))
            }
        }
    }

    /// The points of a shape with corners, and the key that says them.
    fn corners(&self) -> Option<(&'static str, Cow<'_, [[f64; 3]]>)> {
        match &self.shape {
            Shape::Box { size: [x, y, z] } => {
                let frame = Isometry3::from(Frame {
                    position: self.center.unwrap_or_default(),
                    orientation: self.orientation.unwrap_or_else(upright),
                });
                let corner = |bits: u8| {
                    let sign = |k: u8| if bits >> k & 1 == 0 { -0.5 } else { 0.5 };
                    let corner = Point3::new(sign(0) * x, sign(1) * y, sign(2) * z);
                    frame.transform_point(&corner).coords.into()
                };
                Some(("size", (0..8u8).map(corner).collect()))
            }
            Shape::Convex { vertices } => Some(("vertices", vertices.into())),
            _ => None,
        }
    }
}

fn refused(path: &str, ShapeFault { key, requirement, given }: ShapeFault) -> DescriptionError {
    fault(format!("{path}.{key}"), DescriptionProblem::Shape { requirement, given })
}

/// The capsule between two points, which may be the same: a sphere has no direction, any will do.
fn swept(start: Vector<3>, end: Vector<3>, radius: f64) -> Capsule<3> {
    let along = end - start;
    let length = along.norm();
    let direction = if length > 0.0 { along / length } else { Vector::<3>::z() };
    Capsule { start, direction, length, radius }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use serde_json::{Value, json};

    fn checked(shape: &Value) -> Result<Value, String> {
        let mut shape: PlacedShape =
            serde_json::from_value(shape.clone()).map_err(|error| error.to_string())?;
        shape.check("shape").map_err(|error| error.to_string())?;
        shape.solid("shape", |point| point).map_err(|error| error.to_string())?;
        Ok(serde_json::to_value(shape).unwrap())
    }

    /// A description is written back with the keys that it was read with.
    #[test]
    fn keys_of_a_description() {
        let vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]].map(|p| p.map(f64::from));
        let turned = [0.6, 0.0, 0.8, 0.0];
        for shape in [
            json!({ "kind": "sphere", "center": [0.0, 0.0, 0.5], "radius": 0.1 }),
            json!({ "kind": "capsule", "a": [0.0, 0.0, 0.0], "b": [0.0, 0.0, 1.0], "radius": 0.1 }),
            json!({ "kind": "box", "center": [0.0, 0.5, 0.0], "size": [1.0, 2.0, 3.0], "orientation": turned }),
            json!({ "kind": "convex", "vertices": vertices }),
        ] {
            assert_eq!(checked(&shape), Ok(shape));
        }
    }

    /// Corners and ends go along, and so does what is solid of it.
    #[test]
    fn a_shape_moves_as_a_body() {
        let pose = Isometry3::new(Vector3::new(0.1, -0.2, 0.3), Vector3::new(0.4, -1.0, 0.7));
        let vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]].map(|p| p.map(f64::from));
        for shape in [
            json!({ "kind": "sphere", "center": [0.0, 0.0, 0.5], "radius": 0.1 }),
            json!({ "kind": "capsule", "a": [0.0, 0.1, 0.0], "b": [0.0, 0.0, 1.0], "radius": 0.1 }),
            json!({ "kind": "box", "center": [0.0, 0.5, 0.0], "size": [1.0, 2.0, 3.0], "orientation": [0.6, 0.0, 0.8, 0.0] }),
            json!({ "kind": "convex", "vertices": vertices }),
        ] {
            let mut here: PlacedShape = serde_json::from_value(shape).unwrap();
            let solid = here.checked_solid("shape").unwrap();
            let mut there = here.moved(&pose);
            let moved = there.checked_solid("shape").unwrap();
            let expected = solid.moved(&pose);
            assert!((moved.mass - solid.mass).abs() < 1e-12 && solid.mass > 0.0);
            assert!((moved.com - expected.com).norm() < 1e-12);
            assert!((moved.inertia - expected.inertia).norm() < 1e-12, "{there:?}");
            let placed = |p: Vector<3>| (pose * Point3::from(p)).coords;
            let ends = |(capsule, _): (Capsule<3>, Option<Hull>)| [capsule.start, capsule.end()];
            let [a, b] = ends(there.solid("shape", |p| p).unwrap());
            let [c, d] = ends(here.solid("shape", placed).unwrap());
            assert!(
                (a - c).norm() + (b - d).norm() < 1e-6 || (a - d).norm() + (b - c).norm() < 1e-6
            );
        }
    }

    #[test]
    fn what_may_be_left_out_is_said_in_full() {
        let cube = checked(&json!({ "kind": "box", "size": [1.0, 1.0, 1.0] })).unwrap();
        assert_eq!(cube["center"], json!([0.0, 0.0, 0.0]));
        assert_eq!(cube["orientation"], json!([1.0, 0.0, 0.0, 0.0]));
        // A capsule whose ends are one point is a ball there.
        let ends =
            json!({ "kind": "capsule", "a": [1.0, 0.0, 0.0], "b": [1.0, 0.0, 0.0], "radius": 0.1 });
        let ball = json!({ "kind": "sphere", "center": [1.0, 0.0, 0.0], "radius": 0.1 });
        assert_eq!(checked(&ends), Ok(ball));
    }

    #[test]
    fn what_a_link_cannot_carry_is_refused() {
        let flat = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]];
        for (shape, fault) in [
            (
                json!({ "kind": "half_space", "normal": [0, 0, 1] }),
                "shape.kind: must be sphere, capsule, box or convex",
            ),
            (
                json!({ "kind": "points", "points": [], "radius": 0.1 }),
                "shape.kind: must be sphere",
            ),
            (json!({ "kind": "cylinder", "radius": 0.1 }), "unknown variant `cylinder`"),
            (json!({ "kind": "sphere", "radius": 0.1, "colour": 1 }), "unknown field `colour`"),
            (
                json!({ "kind": "sphere", "radius": 0.1, "orientation": [1, 0, 0, 0] }),
                "shape.orientation: must be left out",
            ),
            (
                json!({ "kind": "convex", "vertices": flat, "center": [0, 0, 0] }),
                "shape.center: must be left out",
            ),
            (
                json!({ "kind": "convex", "vertices": flat }),
                "shape.vertices: must be points that do not lie",
            ),
            (
                json!({ "kind": "capsule", "a": [0, 0, 0], "b": [0, 0, 1], "radius": 0 }),
                "shape.radius: must be greater than 0, got 0.0",
            ),
            (
                json!({ "kind": "box", "size": [1, 1, 0] }),
                "shape.size[2]: must be greater than 0, got 0.0",
            ),
            (
                json!({ "kind": "box", "size": [1, 1, 1], "orientation": [2, 0, 0, 0] }),
                "shape.orientation: must have length 1",
            ),
        ] {
            let refused = checked(&shape).unwrap_err();
            assert!(refused.starts_with(fault), "{refused}");
        }
    }
}
