//! The loop, the motions and the crowd know nothing of the plane: the least that makes a world of three
//! dimensions, balls, compared with brute force.

use super::{
    CollisionQuery, Contact, Description, Feature, HORIZON, Hierarchy, Motion, MotionState, Pair,
    Solid, World,
};
use crate::math::{Body, Capsule, ThirdOrderFilter, Vector};
use proptest::prelude::*;

#[derive(Debug, Clone)]
struct Ball {
    center: Vector<3>,
    radius: f64,
    motion: Motion<3>,
}

impl Description<3> for Ball {
    fn position(&self) -> Vector<3> {
        self.center
    }

    fn set_position(&mut self, position: Vector<3>) {
        self.center = position;
    }

    fn motion(&self) -> &Motion<3> {
        &self.motion
    }

    fn set_motion(&mut self, motion: Motion<3>) {
        self.motion = motion;
    }
}

#[derive(Debug, Clone)]
struct Round {
    radius: f64,
}

impl Solid<3> for Round {
    type Obstacle = Ball;
    type Probe = Capsule<3>;
    type Hierarchy = Boxes;

    fn new(ball: &Ball) -> Self {
        Self { radius: ball.radius }
    }

    fn probe(link: &Capsule<3>) -> Capsule<3> {
        *link
    }

    fn distance(&self, link: &Capsule<3>, position: &Vector<3>) -> f64 {
        (link.clamp(position) - position).norm() - self.radius - link.radius
    }

    fn contact(
        &self,
        Pair { body, link, obstacle }: Pair,
        capsule: &Capsule<3>,
        state: &MotionState<3>,
    ) -> Contact<3> {
        let point = capsule.clamp(&state.position);
        let offset = point - state.position;
        let distance = offset.norm();
        let normal = offset / distance;
        Contact {
            body,
            link,
            obstacle,
            distance: self.distance(capsule, &state.position),
            normal,
            point,
            witness: state.position + normal * self.radius,
            velocity: state.velocity,
            acceleration: state.acceleration,
            feature: Feature::End { distance },
        }
    }

    fn barriers(&self) -> usize {
        1
    }

    fn for_each_barrier(
        &self,
        contact: &Contact<3>,
        _: &Capsule<3>,
        _: &MotionState<3>,
        mut visit: impl FnMut(&Contact<3>),
    ) {
        visit(contact);
    }

    fn extent(&self) -> [Vector<3>; 2] {
        [-self.radius, self.radius].map(Vector::repeat)
    }

    fn cast(&self, origin: &Vector<3>, direction: &Vector<3>, range: f64) -> Option<f64> {
        let (along, square) = (-origin.dot(direction), origin.norm_squared());
        if square <= self.radius * self.radius {
            return Some(0.0);
        }
        let root = (self.radius * self.radius - (square - along * along)).sqrt();
        Some(along - root).filter(|s| 0.0 <= *s && *s <= range)
    }
}

/// One box after the other.
#[derive(Debug, Clone)]
struct Boxes(Vec<[Vector<3>; 2]>);

impl Hierarchy<Capsule<3>, 3> for Boxes {
    type Region = [Vector<3>; 2];

    fn new(boxes: &[[Vector<3>; 2]]) -> Self {
        Self(boxes.to_vec())
    }

    fn renew(&mut self, boxes: impl Iterator<Item = [Vector<3>; 2]>, _: bool) {
        self.0.iter_mut().zip(boxes).for_each(|(old, new)| *old = new);
    }

    fn region(link: &Capsule<3>) -> Option<[Vector<3>; 2]> {
        let (a, b) = (link.start, link.end());
        let [low, high] = [a.inf(&b).add_scalar(-link.radius), a.sup(&b).add_scalar(link.radius)];
        (low.amax().max(high.amax()) < HORIZON).then_some([low, high])
    }

    fn for_each_within(
        &self,
        [low, high]: &[Vector<3>; 2],
        mut limit: f64,
        mut measure: impl FnMut(usize) -> f64,
    ) -> usize {
        let mut count = 0;
        for (leaf, [from, to]) in self.0.iter().enumerate() {
            let gap = (from - high).sup(&(low - to)).sup(&Vector::zeros()).norm();
            if gap <= limit.max(0.0) {
                limit = measure(leaf);
                count += 1;
            }
        }
        count
    }
}

fn three(range: f64) -> impl Strategy<Value = Vector<3>> {
    [-range..range, -range..range, -range..range].prop_map(Vector::from)
}

fn ball() -> impl Strategy<Value = Ball> {
    let motion = prop_oneof![
        Just(Motion::default()),
        three(1.0).prop_map(|v| Motion::Linear { velocity: v.into() }),
        (three(1.0), -3.0..3.0).prop_map(|(a, omega)| Motion::Sinusoid {
            amplitude: a.into(),
            angular_frequency: omega,
            phase: 0.4
        }),
        [three(3.0), three(3.0)].prop_map(|points| Motion::Waypoints {
            times: vec![0.0, 2.0],
            points: points.map(Into::into).to_vec()
        }),
        (three(3.0), three(3.0)).prop_map(|(from, to)| Motion::Carried(ThirdOrderFilter::new(
            0.5,
            [from, to, from],
            to,
            3.0
        ))),
    ];
    (three(3.0), 0.05..0.4, motion).prop_map(|(center, radius, motion)| Ball {
        center,
        radius,
        motion,
    })
}

fn link() -> impl Strategy<Value = Capsule<3>> {
    (three(2.0), three(2.0), 0.0..0.2).prop_map(|(a, b, radius)| Capsule::new(a, b, radius))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    /// Few balls, asked one by one, and many, found in their boxes: what is told is what a sampled axis
    /// tells, in the order of links and obstacles, and the normal is the gradient.
    #[test]
    fn balls_are_met_as_brute_force_meets_them(
        balls in prop::collection::vec(ball(), 1..60), links in [link(), link()],
        times in prop::collection::vec(0.0..3.0, 4), reach in 0.0..2.0,
    ) {
        let mut world = World::<Round, 3>::new(balls.clone());
        for t in times {
            world.update(t);
            let (mut told, mut nearest) = (vec![], vec![]);
            world.for_each_contact(
                links.iter().enumerate().map(|(i, link)| Body::new(i + 7, *link)), reach, |link, d| nearest.push((link, d)), |contact| told.push(*contact),
            );
            let places = balls.iter().map(|ball| ball.motion.at(t, ball.center)).collect::<Vec<_>>();
            let gap = |link: &Capsule<3>, j: usize| {
                let at = |k: u32| link.start + (link.end() - link.start) * (f64::from(k) / 2000.0);
                let axis = (0..=2000).map(|k| (at(k) - places[j].position).norm());
                axis.fold(f64::INFINITY, f64::min) - link.radius - balls[j].radius
            };
            let mut met = told.iter();
            for (i, link) in links.iter().enumerate() {
                let gaps: Vec<f64> = (0..balls.len()).map(|j| gap(link, j)).collect();
                let least = gaps.iter().copied().fold(f64::INFINITY, f64::min);
                prop_assert!(nearest[i].0 == i + 7 && (nearest[i].1 - least).abs() < 2e-3);
                for (j, gap) in gaps.into_iter().enumerate() {
                    let contact = world.contact(i, &Body::new(i + 7, *link), j);
                    if contact.distance < reach {
                        prop_assert_eq!(Some(&contact), met.next());
                    }
                    prop_assert!((contact.distance - gap).abs() < 2e-3);
                    prop_assert_eq!(contact.velocity, places[j].velocity);
                    let shift = Vector::<3>::new(3e-7, -2e-7, 5e-7);
                    let moved = Capsule { start: link.start + shift, ..*link };
                    let change = world.contact(i, &Body::new(0, moved), j).distance - contact.distance;
                    prop_assert!((change - contact.normal.dot(&shift)).abs() < 1e-10);
                }
            }
            prop_assert_eq!(met.next(), None);
        }
    }

    /// A ray ends where its point is on a ball, and no earlier.
    #[test]
    fn rays_end_on_balls(balls in prop::collection::vec(ball(), 1..9), to in three(1.0), t in 0.0..3.0) {
        prop_assume!(to.norm() > 0.1);
        let mut world = World::<Round, 3>::new(balls.clone());
        world.update(t);
        let direction = to.normalize();
        let height = |s: f64| {
            let gap = |(j, ball): (usize, &Ball)| {
                (direction * s - world.position(j)).norm() - ball.radius
            };
            balls.iter().enumerate().map(gap).fold(f64::INFINITY, f64::min)
        };
        let range = 6.0;
        let hit = world.cast(Vector::zeros(), direction, range);
        prop_assert!((0..500).map(|k| hit.unwrap_or(range) * f64::from(k) / 500.0)
            .all(|s| height(s) > -1e-9 || hit == Some(0.0)));
        if let Some(s) = hit {
            prop_assert!(height(s).abs() < 1e-9 || s == 0.0 && height(0.0) <= 0.0);
        }
    }
}

/// A ball is carried, added and taken away as a disc is.
#[test]
fn balls_are_carried() {
    let ball = |x: f64| Ball {
        center: Vector::<3>::new(x, 0.0, 0.0),
        radius: 0.1,
        motion: Motion::Linear { velocity: [0.0, 1.0, -1.0] },
    };
    let mut world = World::<Round, 3>::new((0..30).map(|j| ball(f64::from(j))).collect());
    world.update(1.0);
    assert_eq!(world.position(3), Vector::<3>::new(3.0, 1.0, -1.0));
    let goal = Vector::<3>::new(1.0, 2.0, 3.0);
    world.carry(3, goal, 10.0);
    assert!((world.velocity(3) - Vector::<3>::new(0.0, 1.0, -1.0)).norm() < 1e-12);
    world.update(8.0);
    assert!((world.position(3) - goal).norm() < 1e-9);
    world.remove(0);
    world.add(ball(50.0));
    assert_eq!(world.len(), 30);
    assert!((world.position(2) - goal).norm() < 1e-9);
}
