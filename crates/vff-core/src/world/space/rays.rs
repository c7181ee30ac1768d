//! How far a ray goes until it meets a body of a robot.

use super::shape::cast_at_capsule;
use crate::geometry::PlacedHull;
use crate::math::{Capsule, Vector};

/// How far a ray goes from `origin` along the unit vector `direction` until it meets a body, a capsule or the hull that is in
/// it \[m\]; 0 inside it.
pub fn cast_at_body(
    shape: &Capsule<3>,
    hull: Option<&PlacedHull<'_, 3>>,
    origin: &Vector<3>,
    direction: &Vector<3>,
) -> Option<f64> {
    let met = cast_at_capsule(shape, shape.radius, origin, direction)?;
    hull.map_or(Some(met), |hull| cast_at_hull(hull, origin, direction))
}

/// The same for a hull alone.
pub fn cast_at_hull(
    hull: &PlacedHull<'_, 3>,
    origin: &Vector<3>,
    direction: &Vector<3>,
) -> Option<f64> {
    hull.hull.meet_ray(&hull.seen(origin), &hull.rotation.tr_mul(direction))
}

#[cfg(test)]
mod tests {
    use super::super::oracle::*;
    use super::super::{Obstacle, Shape, World};
    use crate::world::Motion;
    use proptest::prelude::*;

    /// Signed only as far as it is needed: how far a point is outside of an obstacle.
    fn height(obstacle: &Obstacle, point: &Vec3) -> f64 {
        distance_to_core(obstacle, point) - core_radius(&obstacle.shape)
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(1500))]

        /// Where a ray ends, the distance to the obstacle is 0, and before it is positive.
        #[test]
        fn a_ray_ends_on_the_surface(
            origin in three(3.0), along in direction(), obstacle in any_obstacle(), range in 0.1..8.0,
        ) {
            let world = World::new(vec![obstacle.clone()]);
            let at = |s: f64| height(&obstacle, &(origin + along * s));
            match world.cast(origin, along, range) {
                Some(0.0) => prop_assert!(at(0.0) < 1e-12),
                Some(end) => {
                    prop_assert!(end <= range && at(end).abs() < 1e-12, "{} at {end}", at(end));
                    prop_assert!((0..200).all(|k| at(end * f64::from(k) / 200.0) > -1e-12));
                }
                None => prop_assert!((0..400).all(|k| at(range * f64::from(k) / 400.0) > -1e-12)),
            }
        }

        /// Along the axes of a box and a capsule, where slopes are 0.
        #[test]
        fn rays_along_the_axes(
            x in -2i8..3, y in -2i8..3, k in 0usize..3, sign in prop::bool::ANY, kind in 0usize..4,
        ) {
            let mut along = Vec3::zeros();
            along[k] = if sign { 1.0 } else { -1.0 };
            let mut origin = along * -5.0;
            (origin[(k + 1) % 3], origin[(k + 2) % 3]) = (0.5 * f64::from(x), 0.5 * f64::from(y));
            let shape = [
                Shape::Box { size: [1.0, 2.0, 3.0] },
                Shape::Capsule { a: [0.0, 0.0, -1.0], b: [0.0, 0.0, 1.0], radius: 0.7 },
                Shape::HalfSpace { normal: [0.0, 0.0, 1.0] },
                Shape::Convex { vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] },
            ][kind].clone();
            let obstacle = fixed(shape, [0.0; 3]);
            let at = |s: f64| height(&obstacle, &(origin + along * s));
            match World::new(vec![obstacle.clone()]).cast(origin, along, 9.0) {
                Some(end) => prop_assert!(at(end).abs() < 1e-12 || end == 0.0),
                None => prop_assert!((0..900).all(|s| at(0.01 * f64::from(s)) > -1e-12)),
            }
        }
    }

    /// The nearest of several, where they are now.
    #[test]
    fn the_first_of_moving_obstacles() {
        let sphere = |x: f64, speed: f64| Obstacle {
            motion: Motion::Linear { velocity: [speed, 0.0, 0.0] },
            ..fixed(Shape::Sphere { radius: 0.5 }, [x, 0.0, 0.0])
        };
        let mut world = World::new(vec![sphere(3.0, 1.0), sphere(6.0, -1.0)]);
        let x = Vec3::x();
        assert_eq!(world.cast(Vec3::zeros(), x, 9.0), Some(2.5));
        world.update(2.5);
        assert_eq!(world.cast(Vec3::zeros(), x, 9.0), Some(3.0));
        assert_eq!(world.cast(Vec3::zeros(), x, 2.9), None);
        assert_eq!(world.cast(Vec3::zeros(), -x, 9.0), None);
    }
}
