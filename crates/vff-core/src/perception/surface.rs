//! How far points are from the surface of an arm: what a check of a camera's calibration compares (T185).

use crate::geometry::Body;
use crate::interrupt;
use crate::math::Vector;
use crate::robot::{Robot, SpatialState};
use crate::world::space::distance_of_point;

/// How far points are from the nearest body of an arm \[m\], negative within it, and which link that is on: none is the base. Infinite
/// for an arm without bodies.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::perception::surface_distances;
/// use vff_core::robot::{Robot, models};
///
/// let panda = Arc::new(models::named("panda").unwrap().build().unwrap());
/// let mut state = panda.state();
/// state.update_positions(&[0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]);
/// let body = state.bodies().last().unwrap();
/// let beyond = body.shape.end() + body.shape.direction * (body.shape.radius + 0.1);
/// let (distance, link) = surface_distances(&state, &[beyond.into()])[0];
/// assert!(distance <= 0.1 + 1e-12 && link.is_some());
/// ```
pub fn surface_distances(robot: &SpatialState, points: &[[f64; 3]]) -> Vec<(f64, Option<usize>)> {
    let moving = robot.bodies().map(|body| (Some(body.link), body));
    let still = robot
        .still_bodies()
        .iter()
        .map(|still| (None, Body { hull: still.placed_hull(), ..Body::new(0, still.shape) }));
    let bodies: Vec<_> = moving.chain(still).collect();
    let nearest = |point: &[f64; 3]| {
        interrupt::checkpoint(8 * bodies.len());
        let point = Vector::from(*point);
        let mut least = (f64::INFINITY, None);
        for (link, body) in &bodies {
            // No hull is nearer than the capsule that holds it.
            let around = (body.shape.clamp(&point) - point).norm() - body.shape.radius;
            if around < least.0 {
                let distance = distance_of_point(body, &point);
                if distance < least.0 {
                    least = (distance, *link);
                }
            }
        }
        least
    };
    points.iter().map(nearest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::models;
    use std::sync::Arc;

    /// As far as the nearest of all capsules by a formula of its own; on the base there is no link.
    #[test]
    fn the_nearest_of_all_bodies_is_found() {
        let panda = Arc::new(models::named("panda").unwrap().build().unwrap());
        let mut state = panda.state();
        state.update_positions(&[0.3, -0.5, 0.2, -1.8, 0.1, 1.6, 0.4]);
        let segment = |shape: &crate::math::Capsule<3>, p: &Vector<3>| {
            let (a, way) = (shape.start, shape.end() - shape.start);
            let share = ((p - a).dot(&way) / way.norm_squared().max(1e-12)).clamp(0.0, 1.0);
            (p - a - way * share).norm() - shape.radius
        };
        let mut links = std::collections::HashSet::new();
        for k in 0..1000_i32 {
            let spread = |step: f64| (step * f64::from(k)).fract() - 0.5;
            let p = Vector::<3>::new(spread(0.618), spread(0.7549), 0.5 + 1.2 * spread(0.5698));
            let (distance, link) = surface_distances(&state, &[p.into()])[0];
            let moving = state.bodies().map(|body| (segment(&body.shape, &p), Some(body.link)));
            let still = state.still_bodies().iter().map(|still| (segment(&still.shape, &p), None));
            let all: Vec<_> = moving.chain(still).collect();
            let least = all.iter().map(|(distance, _)| *distance).fold(f64::INFINITY, f64::min);
            assert!((distance - least).abs() < 1e-12);
            assert!(all.iter().any(|(d, of)| (d - least).abs() < 1e-12 && *of == link));
            links.insert(link);
        }
        assert!(links.len() > 4 && links.contains(&None), "{links:?}");
    }
}
