//! What of a picture is the arm itself (T182): its bodies where it was, widened by what its place is not known to.

use crate::geometry::Body;
use crate::math::{Capsule, Vector};
use crate::robot::{Robot, SpatialState};
use crate::world::space::{distance_of_point, perpendicular};

/// The bodies of an arm at one instant, each with what it is widened by.
pub(super) struct SelfFilter<'a> {
    bodies: Vec<(Body<'a, 3>, f64)>,
}

impl<'a> SelfFilter<'a> {
    /// Of the arm in its state, `margin` \[m\] around all of it, and around what moves as far as that goes in `uncertainty` \[s\].
    pub(super) fn new(robot: &'a SpatialState, margin: f64, uncertainty: f64) -> Self {
        let moving = robot.bodies().map(|body| {
            let speed = top_speed(robot, body.link, &body.shape);
            (body, margin + speed * uncertainty)
        });
        let still = robot.still_bodies().iter().map(|still| {
            let body = Body { hull: still.placed_hull(), ..Body::new(0, still.shape) };
            (body, margin)
        });
        Self { bodies: moving.chain(still).collect() }
    }

    /// Of what the arm has taken up, `margin` \[m\] around that, and of the arm itself without one.
    pub(super) fn of_load(robot: &'a SpatialState, margin: f64) -> Self {
        let around = |body: Body<'a, 3>| (body, if body.is_load { margin } else { 0.0 });
        Self { bodies: robot.bodies().map(around).collect() }
    }

    /// How far a point is from all that is cut away \[m\], if that is less than `limit`, or else anything that is not.
    #[inline]
    pub(super) fn clearance(&self, point: &Vector<3>, limit: f64) -> f64 {
        let mut least = limit;
        for (body, margin) in &self.bodies {
            // No hull is nearer than the capsule that holds it.
            let around = (body.shape.clamp(point) - point).norm() - body.shape.radius - margin;
            if around < least {
                least = least.min(distance_of_point(body, point) - margin);
            }
        }
        least
    }
}

/// A speed that no point of a body exceeds \[m/s\]: the highest at the corners of a box around it, because the speed of a rigid
/// body is a convex function of the place.
fn top_speed(robot: &SpatialState, link: usize, shape: &Capsule<3>) -> f64 {
    let along = shape.direction;
    let side = perpendicular(&along) * shape.radius;
    let other = along.cross(&side);
    let ends = [shape.start - along * shape.radius, shape.end() + along * shape.radius];
    let corners = ends.into_iter().flat_map(|end| {
        [side + other, side - other, other - side, -side - other].map(|across| end + across)
    });
    corners.map(|corner| robot.point_velocity(link, &corner).norm()).fold(0.0, f64::max)
}
