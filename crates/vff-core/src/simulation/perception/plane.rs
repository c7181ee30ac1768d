//! Range sensors along both sides of the links of an arm in the plane.

use super::scans::{Ray, Scans};
use super::{Perceive, PerceptionSettings};
use crate::geometry::Body;
use crate::math::{Vector, cross, perp};
use crate::robot::Robot;
use crate::world::plane::{PlanarGeometry, World};
use crate::world::{CollisionQuery, Contact, Feature, PairMargin, Positions, Spin};

/// A ray relative to the body that it is mounted on.
#[derive(Debug, Clone, Copy)]
struct Mount {
    body: usize,
    /// Where along the body, as a share of its length.
    along: f64,
    /// +1 on the left side of the body, −1 on the right.
    side: f64,
    /// Direction: along the axis and outward.
    direction: [f64; 2],
}

impl Mount {
    fn ray(&self, robot: &impl Robot<2>) -> Ray<2> {
        let body = robot.body(self.body).shape;
        let across = perp(body.direction);
        let origin = body.start
            + body.direction * (self.along * body.length)
            + across * (self.side * body.radius);
        let [forward, outward] = self.direction;
        [origin, body.direction * forward + across * outward]
    }

    /// Where the ray is, and how far it goes until it meets an obstacle.
    fn cast(&self, robot: &impl Robot<2>, world: &World, range: f64) -> (Ray<2>, Option<f64>) {
        let [origin, direction] = self.ray(robot);
        ([origin, direction], world.cast(origin, direction, range))
    }
}

/// Range sensors with what they have seen.
#[derive(Debug, Clone)]
pub struct Perception {
    mounts: Vec<Mount>,
    scans: Scans<2>,
}

impl Perception {
    /// Sensors on every body of `robot` for plant steps of `dt` \[s\]; the same seed gives the same noise.
    #[expect(clippy::cast_precision_loss, reason = "counts of sensors and rays")]
    pub fn new(settings: &PerceptionSettings, seed: u64, robot: &impl Robot<2>, dt: f64) -> Self {
        let bodies = robot.body_count();
        let middle = 0.5 * (settings.rays as f64 - 1.0);
        let mut mounts = Vec::with_capacity(settings.rays_of(bodies, 2));
        for body in 0..bodies {
            for place in 0..settings.sensors {
                let along = (place as f64 + 0.5) / settings.sensors as f64;
                for side in [1.0, -1.0] {
                    for ray in 0..settings.rays {
                        let share = (ray as f64 - middle) / (2.0 * middle).max(1.0);
                        let (sin, cos) = (share * settings.field_of_view).sin_cos();
                        mounts.push(Mount { body, along, side, direction: [sin, cos * side] });
                    }
                }
            }
        }
        Self { scans: Scans::new(settings, seed, mounts.len(), dt), mounts }
    }

    /// What the controller knows \[m\]: one point per ray, NaN where nothing was met.
    pub fn seen(&self) -> &[Vector<2>] {
        self.scans.seen()
    }
}

impl<R: Robot<2>> Perceive<R, PlanarGeometry, 2> for Perception {
    fn start(&mut self, robot: &R, world: &World) {
        let Self { mounts, scans } = self;
        scans.start(|k, range| mounts[k].cast(robot, world, range));
    }

    fn advance(&mut self, robot: &R, world: &World) {
        let Self { mounts, scans } = self;
        scans.advance(|k, range| mounts[k].cast(robot, world, range));
    }

    fn undo(&mut self) {
        self.scans.undo();
    }
}

impl Positions for Perception {
    fn count(&self) -> usize {
        self.scans.count()
    }

    fn append_to(&self, out: &mut Vec<f64>) {
        self.scans.append_to(out);
    }
}

impl CollisionQuery<2> for Perception {
    /// One on either side of a body.
    fn obstacle_count(&self) -> usize {
        2
    }

    /// For every body the nearest of the points to its left and of those to its right, each at rest
    /// (T81); `obstacle` counts the sides.
    fn for_each_contact<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, 2>>,
        reach: f64,
        mut distance: impl FnMut(usize, f64),
        mut visit: impl FnMut(&Contact<2>),
    ) {
        if self.scans.met().is_empty() {
            return;
        }
        for (index, body) in bodies.into_iter().enumerate() {
            let capsule = &body.shape;
            let mut nearest = [(f64::INFINITY, Vector::zeros()); 2];
            for point in self.scans.met() {
                let side = usize::from(cross(capsule.direction, point - capsule.start) < 0.0);
                let gap = (capsule.clamp(point) - point).norm();
                if gap < nearest[side].0 {
                    nearest[side] = (gap, *point);
                }
            }
            distance(body.link, nearest[0].0.min(nearest[1].0) - capsule.radius);
            for (side, (gap, witness)) in nearest.into_iter().enumerate() {
                if gap - capsule.radius >= reach || gap.is_infinite() {
                    continue;
                }
                visit(&touch(index, &body, side, witness));
            }
        }
    }

    /// The nearest of all points, on whichever side it comes to lie; they stay where they are.
    fn contact_after(
        &self,
        index: usize,
        body: &Body<'_, 2>,
        obstacle: usize,
        _: f64,
    ) -> Contact<2> {
        let capsule = &body.shape;
        let gap = |point: &Vector<2>| (capsule.clamp(point) - point).norm_squared();
        let nearest = self.scans.met().iter().copied().min_by(|a, b| gap(a).total_cmp(&gap(b)));
        touch(index, body, obstacle, nearest.unwrap_or_else(|| Vector::repeat(f64::INFINITY)))
    }
}

/// The contact of a body with a point at rest on one side of it.
fn touch(index: usize, body: &Body<'_, 2>, side: usize, witness: Vector<2>) -> Contact<2> {
    let capsule = &body.shape;
    let point = capsule.clamp(&witness);
    let gap = (point - witness).norm();
    let along = capsule.direction.dot(&(witness - capsule.start));
    let inside = 0.0 < along && along < capsule.length;
    let aside = perp(capsule.direction) * if side == 0 { -1.0 } else { 1.0 };
    Contact {
        body: index,
        link: body.link,
        obstacle: side,
        margin: PairMargin::USUAL,
        distance: gap - capsule.radius,
        normal: if gap > 0.0 { (point - witness) / gap } else { aside },
        point,
        axis: capsule.direction,
        witness,
        velocity: Vector::zeros(),
        acceleration: Vector::zeros(),
        spin: Spin::NONE,
        feature: if inside {
            Feature::Side { distance: gap }
        } else {
            Feature::End { distance: gap }
        },
    }
}

#[cfg(test)]
mod tests {
    use super::super::Kind;
    use super::*;
    use crate::robot::{Model, PlanarArm, PlanarState, planar::Link};
    use crate::world::Motion;
    use crate::world::plane::{Obstacle, Shape};
    use std::sync::Arc;

    fn settings() -> PerceptionSettings {
        PerceptionSettings {
            kind: Kind::Range,
            rays: 1,
            range: 5.0,
            ..PerceptionSettings::default()
        }
    }

    /// A wall above the x axis, moving up.
    fn wall(speed: f64) -> World {
        World::new(vec![Obstacle {
            position: [0.0, 2.5],
            motion: Motion::Linear { velocity: [0.0, speed] },
            ..Obstacle::of(Shape::Box { size: [10.0, 1.0] })
        }])
    }

    /// One link along the x axis.
    fn robot() -> PlanarState {
        let link = Link { radius: 0.1, ..Link::rod(1.0, 1.0) };
        Arc::new(PlanarArm::new(vec![link], Vector::<2>::zeros())).state()
    }

    fn started(settings: &PerceptionSettings, world: &World) -> Perception {
        let mut perception = Perception::new(settings, 7, &robot(), 1e-3);
        perception.start(&robot(), world);
        perception
    }

    /// Readings of the upper side over many scans of the wall at 2 m, from the surface at 0.1 m.
    fn readings(settings: &PerceptionSettings) -> Vec<f64> {
        let world = wall(0.0);
        let (mut perception, robot) = (started(settings, &world), robot());
        let mut found = vec![];
        for _ in 0..5000 {
            perception.advance(&robot, &world);
            found.extend(perception.seen().iter().step_by(2).map(|point| point.y - 0.1));
        }
        found
    }

    /// Straight up from the surface to the wall, and nothing below.
    #[test]
    fn where_the_points_are() {
        let perception = started(&settings(), &wall(0.0));
        for (k, point) in perception.seen().iter().enumerate() {
            match k % 2 {
                0 => {
                    let x = (k as f64 / 2.0 + 0.5) / 4.0;
                    assert!((point - Vector::<2>::new(x, 2.0)).norm() < 1e-15);
                }
                _ => assert!(point.x.is_nan() && point.y.is_nan()),
            }
        }
    }

    /// Mean and deviation of 20 000 readings are those of N(1.9, σ²), to five deviations of either.
    #[test]
    fn noise_has_its_moments() {
        let sigma = 0.02;
        let found = readings(&PerceptionSettings { noise: sigma, ..settings() });
        let count = found.len() as f64;
        let mean = found.iter().sum::<f64>() / count;
        let variance = found.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
        assert!((mean - 1.9).abs() < 5.0 * sigma / count.sqrt(), "{mean}");
        let spread = variance.sqrt() - sigma;
        assert!(spread.abs() < 5.0 * sigma / (2.0 * count).sqrt(), "{spread}");
    }

    /// The share of readings that are lost is the probability, to five deviations; 1 loses all.
    #[test]
    fn drop_outs_have_their_share() {
        for share in [0.0, 0.3, 1.0] {
            let found = readings(&PerceptionSettings { drop_outs: share, ..settings() });
            let count = found.len() as f64;
            let lost = found.iter().filter(|x| x.is_nan()).count() as f64 / count;
            let deviation = (share * (1.0 - share) / count).sqrt();
            assert!((lost - share).abs() <= 5.0 * deviation, "{lost}");
        }
    }

    /// Multiples of the resolution, the nearest ones.
    #[test]
    fn readings_are_rounded() {
        let found = readings(&PerceptionSettings { resolution: 0.25, ..settings() });
        assert!(found.iter().all(|x| (x - 2.0).abs() < 1e-12));
    }

    /// A wall that moves 1 mm a step is seen where it was at the last scan that has arrived: every 4
    /// steps (250 Hz), 6 steps late. A step taken back shows what was seen before it.
    #[test]
    fn rate_latency_and_undo() {
        let late = PerceptionSettings { rate: Some(250.0), latency: 6e-3, ..settings() };
        let mut world = wall(1.0);
        let (mut perception, robot) = (started(&late, &world), robot());
        for step in 1..40_usize {
            let before = perception.seen()[0].y;
            world.update(1e-3 * step as f64);
            perception.advance(&robot, &world);
            perception.scans.undo();
            assert_eq!(perception.seen()[0].y.to_bits(), before.to_bits());
            perception.advance(&robot, &world);
            let scanned = 4 * (step.saturating_sub(6) / 4);
            let expected = 2.0 + 1e-3 * scanned as f64;
            assert!((perception.seen()[0].y - expected).abs() < 1e-12, "{step}");
        }
    }

    /// Points on either side give one contact each, with the distance from the surface.
    #[test]
    fn contacts_of_both_sides() {
        let disc =
            |y: f64| Obstacle { position: [0.5, y], ..Obstacle::of(Shape::Circle { radius: 0.2 }) };
        let world = World::new(vec![disc(1.0), disc(-0.7)]);
        let odd = PerceptionSettings { sensors: 5, ..settings() };
        let mut perception = started(&odd, &world);
        let (mut found, mut clearance) = (vec![], f64::NAN);
        perception.for_each_contact(
            [robot().body(0)],
            0.75,
            |_, d| clearance = d,
            |c| found.push(*c),
        );
        assert!((clearance - 0.4).abs() < 1e-12);
        let expected = [(0.7, -1.0), (0.4, 1.0)];
        assert_eq!(found.len(), 2);
        for (contact, (distance, up)) in found.iter().zip(expected) {
            assert!((contact.distance - distance).abs() < 1e-12);
            assert!((contact.normal - Vector::<2>::new(0.0, up)).norm() < 1e-12);
            assert_eq!(contact.velocity, Vector::<2>::zeros());
        }
        found.clear();
        perception.for_each_contact([robot().body(0)], 0.5, |_, _| {}, |c| found.push(*c));
        assert_eq!(found.len(), 1);
    }
}
