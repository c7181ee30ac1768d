//! Bodies of one link that are looked at together first: what is far from a box around them is far from each.

use crate::geometry::{Body, Form, Hull, PlacedHull};
use crate::math::{Capsule, Vector};
use crate::robot::{Robot, SpatialState};
use nalgebra::{Matrix3, SymmetricEigen};

/// By how much the box is larger than what it holds, relative to its size, for what rounding makes of it.
const ROUNDING: f64 = 1e-12;

/// Hulls that a link carries, and a box around them in their common frame.
#[derive(Debug, Clone)]
pub struct Bundle<const D: usize> {
    /// The numbers of the bodies.
    pub members: Vec<usize>,
    hull: Hull<D>,
    around: Capsule<D>,
}

impl<const D: usize> Bundle<D> {
    /// The box as a body of `robot`, where that is.
    pub fn body<'a, R: Robot<D>>(&'a self, robot: &'a R) -> Body<'a, D> {
        let member = robot.body(self.members[0]);
        let PlacedHull { rotation, position, .. } = member.hull.expect("they are hulls");
        let Capsule { start, direction, length, radius } = self.around;
        let (start, direction) = (position + rotation * start, rotation * direction);
        let hull = Some(PlacedHull { hull: &self.hull, rotation, position });
        Body { shape: Capsule { start, direction, length, radius }, hull, ..member }
    }
}

impl Bundle<3> {
    /// All of an arm.
    pub fn of_all(robot: &SpatialState) -> Vec<Self> {
        let mut bundled: Vec<(usize, bool, Vec<usize>)> = vec![];
        for (i, body) in robot.bodies().enumerate().filter(|(_, body)| body.hull.is_some()) {
            let (link, is_load) = (body.link, body.is_load);
            match bundled.iter_mut().find(|it| (it.0, it.1) == (link, is_load)) {
                Some((.., members)) => members.push(i),
                None => bundled.push((link, is_load, vec![i])),
            }
        }
        let several = bundled.into_iter().map(|it| it.2).filter(|members| members.len() > 1);
        several.filter_map(|members| Self::of(robot, members)).collect()
    }

    /// None where they lie in one plane.
    fn of(robot: &SpatialState, members: Vec<usize>) -> Option<Self> {
        let hulls = members.iter().filter_map(|i| robot.body(*i).hull);
        let points: Vec<Vector<3>> =
            hulls.flat_map(|it| it.hull.corners.iter().map(|corner| corner.point)).collect();
        let (hull, around) = Hull::with_capsule(&box_around(&points)).ok()?;
        Some(Self { members, hull, around })
    }
}

/// A bundle by its number, which counts behind the bodies and the still ones.
pub fn bundle_of<'a, R: Robot<D>, const D: usize>(
    robot: &R,
    bundles: &'a [Bundle<D>],
    i: usize,
) -> Option<&'a Bundle<D>> {
    bundles.get(i.wrapping_sub(robot.body_count() + robot.still_bodies().len()))
}

/// A body that a link carries, or a bundle of them.
#[inline]
pub fn body_of<'a, R: Robot<D>, const D: usize>(
    robot: &'a R,
    bundles: &'a [Bundle<D>],
    i: usize,
) -> Body<'a, D> {
    match bundle_of(robot, bundles, i) {
        Some(bundle) => bundle.body(robot),
        None => robot.body(i),
    }
}

/// The link that carries a body, a still one or a bundle; None is the base.
pub fn link_of<R: Robot<D>, const D: usize>(
    robot: &R,
    bundles: &[Bundle<D>],
    i: usize,
) -> Option<usize> {
    let is_still = (0..robot.still_bodies().len()).contains(&i.wrapping_sub(robot.body_count()));
    (!is_still).then(|| body_of(robot, bundles, i).link)
}

/// The same as what is measured of it.
pub fn form_of<'a, R: Robot<D>, const D: usize>(
    robot: &'a R,
    bundles: &'a [Bundle<D>],
    i: usize,
) -> Form<'a, D> {
    match robot.still_bodies().get(i.wrapping_sub(robot.body_count())) {
        Some(still) => (still.shape, still.placed_hull()),
        None => {
            let body = body_of(robot, bundles, i);
            (body.shape, body.hull)
        }
    }
}

/// The corners of a small box around points: along the axes of their frame, or along those of their distribution.
fn box_around(points: &[Vector<3>]) -> [[f64; 3]; 8] {
    #[expect(clippy::cast_precision_loss, reason = "some hundreds")]
    let mean = points.iter().sum::<Vector<3>>() / points.len() as f64;
    let spread: Matrix3<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    let axes = SymmetricEigen::<f64, nalgebra::Const<3>>::new(spread).eigenvectors;
    let sizes = |axes: &Matrix3<f64>| {
        let seen = || points.iter().map(|p| axes.tr_mul(p));
        let none = Vector::<3>::repeat(f64::INFINITY);
        [seen().fold(none, |low, p| low.inf(&p)), seen().fold(-none, |high, p| high.sup(&p))]
    };
    let volume = |axes: &Matrix3<f64>| {
        let [low, high] = sizes(axes);
        (high - low).product()
    };
    let own = Matrix3::identity();
    let axes = if volume(&axes) < volume(&own) { axes } else { own };
    let [low, high] = sizes(&axes);
    let more = Vector::<3>::repeat(ROUNDING * low.amax().max(high.amax()));
    let ends = [low - more, high + more];
    std::array::from_fn(|k| {
        let corner = Vector::<3>::new(ends[k & 1].x, ends[k >> 1 & 1].y, ends[k >> 2].z);
        (axes * corner).into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    properties! {
        /// All points are in the box, and none of its sides can be moved in.
        #[test]
        fn the_box_holds_all_and_no_more(
            points in prop::collection::vec([-0.5..0.5, -0.1..0.1, -0.2..0.4], 6..40),
            away in [-2.0..2.0, -2.0..2.0, -2.0..2.0],
        ) {
            let points: Vec<Vector<3>> =
                points.iter().map(|p| Vector::from(*p) + Vector::from(away)).collect();
            let hull = Hull::new(&box_around(&points)).unwrap();
            prop_assert_eq!(hull.faces.len(), 6);
            for face in hull.faces.iter() {
                let out = |p: &Vector<3>| face.normal.dot(p) - face.offset;
                let most = points.iter().map(out).fold(f64::NEG_INFINITY, f64::max);
                prop_assert!((-1e-10..=0.0).contains(&most), "{}", most);
            }
        }
    }
}
