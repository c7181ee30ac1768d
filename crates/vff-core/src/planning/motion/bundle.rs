//! Bodies of one link that are looked at together first: what is far from a box around them is far from each.

use crate::geometry::{Body, Form, Hull, PlacedHull, box_around};
use crate::math::{Capsule, Vector};
use crate::robot::{self, Robot, SpatialState};

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

/// What is measured of a body, a still one or a bundle.
pub fn form_of<'a, R: Robot<D>, const D: usize>(
    robot: &'a R,
    bundles: &'a [Bundle<D>],
    i: usize,
) -> Form<'a, D> {
    match bundle_of(robot, bundles, i) {
        Some(bundle) => bundle.body(robot).form(),
        None => robot::form_of(robot, i),
    }
}
