//! How far a ray goes until it meets an obstacle in space.

use super::cuboid::Cuboid;
use super::volume::{Core, Volume};
use crate::math::{Capsule, Vector};

impl Volume {
    /// From `origin`, relative to the obstacle, along the unit vector `direction`.
    pub(super) fn meet_ray(
        &self,
        origin: &Vector<3>,
        direction: &Vector<3>,
        range: f64,
    ) -> Option<f64> {
        let end = match &self.core {
            Core::Point(point) => ball(&(origin - point), direction, self.radius),
            Core::Segment(segment) => capsule(segment, self.radius, origin, direction),
            Core::Box(cuboid) => cuboid.meet_ray(origin, direction),
            Core::HalfSpace(normal) => {
                let (height, fall) = (normal.dot(origin), -normal.dot(direction));
                match height > 0.0 {
                    false => Some(0.0),
                    true => (fall > 0.0).then(|| height / fall),
                }
            }
        };
        end.filter(|s| *s <= range)
    }
}

/// Where |offset + s · direction| = radius first, from outside; 0 inside.
fn ball(offset: &Vector<3>, direction: &Vector<3>, radius: f64) -> Option<f64> {
    let along = offset.dot(direction);
    // The offset across the ray keeps the digits that along² − offset² would lose far away.
    let across = offset - direction * along;
    let gap = offset.norm_squared() - radius * radius;
    if gap <= 0.0 {
        return Some(0.0);
    }
    let reach = radius * radius - across.norm_squared();
    // The product of both roots is the gap: no difference of nearly equal numbers.
    (along < 0.0 && reach >= 0.0).then(|| gap / (reach.sqrt() - along))
}

/// The first of the cylinder's side and the balls at the ends.
fn capsule(
    core: &Capsule<3>,
    radius: f64,
    origin: &Vector<3>,
    direction: &Vector<3>,
) -> Option<f64> {
    let reject = |v: &Vector<3>| v - core.direction * core.direction.dot(v);
    let offset = origin - core.start;
    let (beside, across) = (reject(&offset), reject(direction));
    let (speed, along) = (across.norm(), core.direction.dot(&offset));
    let is_inside = |along: f64| (0.0..=core.length).contains(&along);
    if beside.norm() <= radius && is_inside(along) {
        return Some(0.0);
    }
    let side = (speed > 0.0).then(|| ball(&beside, &(across / speed), radius)).flatten();
    let side = side
        .map(|s| s / speed)
        .filter(|s| *s > 0.0 && is_inside(along + s * core.direction.dot(direction)));
    let ends = [core.start, core.end()].map(|end| ball(&(origin - end), direction, radius));
    [side, ends[0], ends[1]].into_iter().flatten().reduce(f64::min)
}

impl Cuboid {
    /// The ray is inside between the last side that it enters and the first that it leaves.
    fn meet_ray(&self, origin: &Vector<3>, direction: &Vector<3>) -> Option<f64> {
        let (p, d) = (self.axes.tr_mul(origin), self.axes.tr_mul(direction));
        let (mut enters, mut leaves) = (0f64, f64::INFINITY);
        for k in 0..3 {
            let half = self.half[k];
            if d[k] == 0.0 {
                if p[k].abs() > half {
                    return None;
                }
                continue;
            }
            let (a, b) = ((-half - p[k]) / d[k], (half - p[k]) / d[k]);
            enters = enters.max(a.min(b));
            leaves = leaves.min(a.max(b));
        }
        (enters <= leaves).then_some(enters)
    }
}
