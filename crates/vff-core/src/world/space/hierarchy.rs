//! Which of many boxes are near a link: parry's hierarchy of bounding boxes.

use crate::geometry::Probe;
use crate::math::Vector;
use crate::world::HORIZON;
use crate::world::broad_phase::MARGIN;
use parry3d_f64::math::Vector as Vec3;

crate::world::hierarchy::boxes!(parry3d_f64, 3, Probe, Region, to_glam);

/// Where a link is, and how far around it rounding may reach.
pub struct Region {
    low: Vec3,
    high: Vec3,
    start: Vec3,
    /// Unit vectors across the axis and each coordinate axis; 0 if these are parallel.
    across: [Vec3; 3],
    /// Its radius and the margin \[m\].
    radius: f64,
}

impl Region {
    /// None for a link that is nowhere, or beyond the horizon.
    pub(super) fn of_link(link: &Probe) -> Option<Self> {
        let (start, end, direction) = (link.start, link.end(), to_glam(link.direction));
        let size = 1.0 + start.abs().sum() + link.length;
        // False for NaN.
        let finite = end.iter().all(|x| x.is_finite());
        let inside = size <= HORIZON && finite && link.radius <= HORIZON;
        inside.then(|| Self {
            low: to_glam(start.inf(&end)),
            high: to_glam(start.sup(&end)),
            start: to_glam(start),
            across: [Vec3::X, Vec3::Y, Vec3::Z].map(|k| direction.cross(k).normalize_or_zero()),
            radius: link.radius + MARGIN * size,
        })
    }

    /// Whether every obstacle in the box of `node` is further away than `distance` \[m\].
    #[inline]
    fn is_beyond(&self, node: &BvhNode, distance: f64) -> bool {
        // Where the axis and the box overlap, the bodies may do so by any depth.
        let distance = (distance + self.radius).max(0.0);
        let (low, high) = (node.mins(), node.maxs());
        let gap = (low - self.high).max(self.low - high).max(Vec3::ZERO);
        if gap.length_squared() > distance * distance {
            return true;
        }
        // An oblique axis leaves much of its own box empty. (Measured from corner to corner: the
        // middle of a box with one far side would have lost its last digits.)
        let (low, high) = (low - self.start, high - self.start);
        self.across.iter().any(|across| {
            let (a, b) = (*across * low, *across * high);
            let (lowest, highest) = (a.min(b).element_sum(), a.max(b).element_sum());
            lowest > distance || -highest > distance
        })
    }
}

fn to_glam(v: Vector<3>) -> Vec3 {
    Vec3::new(v.x, v.y, v.z)
}

#[cfg(test)]
mod tests {
    use super::super::oracle::*;
    use super::super::shape::cloud::tests::any_points;
    use super::super::{Obstacle, Shape, SpatialGeometry, World};
    use crate::geometry::Body;
    use crate::math::Capsule;
    use crate::world::broad_phase::REGROUP;
    use crate::world::broad_phase::tests::{check, motion, point, rate, reach, scale, times};
    use crate::world::{CollisionQuery, Motion};
    use proptest::prelude::*;

    fn obstacle() -> impl Strategy<Value = Obstacle> {
        let cloud = (any_points(), 0.0..0.3, any_orientation()).prop_map(
            |(points, radius, orientation)| Obstacle {
                orientation,
                ..fixed(Shape::Points { points, radius }, [0.0; 3])
            },
        );
        let any = prop_oneof![9 => any_obstacle(), 1 => cloud];
        (any, point(5.0), motion(), direction(), rate()).prop_map(
            |(obstacle, position, motion, axis, rate)| {
                let angular_velocity = (axis * rate).into();
                Obstacle { position, motion, angular_velocity, ..obstacle }
            },
        )
    }

    fn link() -> impl Strategy<Value = Capsule<3>> {
        (any_link(), scale())
            .prop_map(|(link, scale)| Capsule { length: link.length * scale, ..link })
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(192))]

        /// Half-spaces, which reach as far as there is, among them.
        #[test]
        fn nothing_is_lost_in_a_crowd(
            mut obstacles in prop::collection::vec(obstacle(), 1..60),
            links in prop::collection::vec(link(), 1..5),
            reach in reach(),
            times in times(),
            twice in 0usize..60,
        ) {
            // Coincident obstacles are met in their order too.
            obstacles.extend(obstacles.get(..twice).unwrap_or_default().to_vec());
            check::<SpatialGeometry, 3>(&obstacles, |_| links.clone(), reach, times);
        }
    }

    /// A crowd above a floor and beside a wall that moves, while its boxes are renewed and regrouped.
    #[test]
    fn a_crowd_on_a_floor() {
        let still = |shape, position| fixed(shape, position);
        let mut obstacles: Vec<_> = (0..300u32)
            .map(|j| {
                let [x, y, z] = [j % 10, j / 10 % 10, j / 100].map(f64::from);
                let motion = match j % 3 {
                    0 => Motion::default(),
                    1 => Motion::Linear { velocity: [0.1 * (y - 5.0), 0.1 * (5.0 - x), 0.0] },
                    _ => Motion::Sinusoid {
                        amplitude: [0.0, 0.3, x],
                        angular_frequency: y,
                        phase: x,
                        foreseen: false,
                    },
                };
                let sphere = Shape::Sphere { radius: 0.1 };
                Obstacle { motion, ..still(sphere, [x - 5.0, y - 5.0, z]) }
            })
            .collect();
        obstacles.push(still(Shape::HalfSpace { normal: [0.0, 0.0, 1.0] }, [0.0, 0.0, -1.0]));
        let wall = still(Shape::HalfSpace { normal: [0.6, 0.8, 0.0] }, [-6.0, 0.0, 0.0]);
        obstacles.push(Obstacle { motion: Motion::Linear { velocity: [0.5, 0.0, 0.0] }, ..wall });
        let links = |t: f64| {
            let end = vec3(3.0 * t.cos(), 3.0 * t.sin(), 1.0 - t);
            vec![Capsule::new(Vec3::zeros(), end, 0.05), Capsule::new(end, end * 1.3, 0.0)]
        };
        for reach in [0.0, 0.6] {
            let times = (0..1500).map(|step| 0.002 * f64::from(step));
            let renewals = check::<SpatialGeometry, 3>(&obstacles, links, reach, times);
            assert!(renewals > REGROUP && renewals < 1000, "{renewals}");
        }
    }

    /// The floor is the nearest of a crowd where nothing else is near, however far.
    #[test]
    fn a_floor_is_found_from_afar() {
        let sphere = |j: u32| fixed(Shape::Sphere { radius: 0.1 }, [1e4 + f64::from(j), 0.0, 5e3]);
        let mut obstacles: Vec<_> = (0..50).map(sphere).collect();
        obstacles.push(fixed(Shape::HalfSpace { normal: [0.0, 0.0, 1.0] }, [0.0, 0.0, -2.0]));
        let mut world = World::new(obstacles);
        let body = Body::new(0, capsule([0.0; 3], [1.0, 0.0, 0.5], 0.1));
        let mut found = vec![];
        world.for_each_contact([body], 0.0, |_, distance| found.push(distance), |_| {});
        assert_eq!(found, [2.0 - 0.1]);
    }
}
