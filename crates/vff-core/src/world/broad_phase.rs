//! Many obstacles: which of them may be near, from a hierarchy of bounding boxes.
//!
//! What is found is what asking every obstacle would find, to the last bit. A box only ever says
//! that its obstacles are too far to matter, with a margin above all rounding; the others are
//! measured as always, in their order.
//!
//! The box of a moving obstacle holds it for a span of time, so that most updates do nothing. The
//! span finds its own length: wide boxes are measured in vain, narrow ones are renewed often, and
//! the two should cost about the same.

use super::{Carrier, Description, Hierarchy, ObstacleGeometry, Placed};
use crate::interrupt;
use crate::math::Vector;

/// The obstacles of a world, sorted by where they are.
#[derive(Debug, Clone)]
pub(super) struct BroadPhase<S: ObstacleGeometry<D>, const D: usize> {
    fixed: Tree<S::Hierarchy>,
    moving: Tree<S::Hierarchy>,
    /// When the boxes of the moving obstacles are valid \[s\].
    valid: [f64; 2],
    /// The length of that time \[s\].
    span: f64,
    /// Moving obstacles measured in vain since then.
    in_vain: usize,
    /// How often the boxes have been renewed.
    renewals: usize,
    /// An obstacle that is likely to be near the next link: the one nearest to the last.
    likely: usize,
    /// Room for what is near one link: as long as there are obstacles.
    met: Vec<usize>,
}

/// From so many obstacles on, asking the hierarchy is faster than asking all.
pub(super) const LEAST: usize = 20;

/// Bounds of the span \[s\]: what no run will notice, and what it can still recover from.
const SPAN: [f64; 2] = [1e-6, 1e6];

/// The obstacles drift apart; after so many renewals those that are neighbours now are grouped anew.
pub(super) const REGROUP: usize = 16;

impl<S: ObstacleGeometry<D>, const D: usize> BroadPhase<S, D> {
    pub(super) fn new(obstacles: &[Placed<S, D>]) -> Self {
        let span = 1e-2;
        let valid = [0.0, span];
        let [fixed, moving] = [true, false].map(|is_static| {
            let of_this_kind = |&j: &usize| obstacles[j].is_static == is_static;
            Tree::new((0..obstacles.len()).filter(of_this_kind).collect(), obstacles, valid)
        });
        Self {
            fixed,
            moving,
            valid,
            span,
            in_vain: 0,
            renewals: 0,
            likely: 0,
            met: vec![0; obstacles.len()],
        }
    }

    /// Makes the boxes hold their obstacles at `now` \[s\], which comes after `before`.
    pub(super) fn update(&mut self, obstacles: &[Placed<S, D>], before: f64, now: f64) {
        let [first, last] = self.valid;
        if self.moving.members.is_empty() || first <= now && now <= last {
            return;
        }
        let count = self.moving.members.len();
        if self.in_vain > count {
            self.span *= 0.5;
        } else if self.in_vain < count / 2 {
            self.span *= 2.0;
        }
        self.span = self.span.clamp(SPAN[0], SPAN[1]);
        // Ahead, in the direction that time goes in.
        self.valid = if now < before { [now - self.span, now] } else { [now, now + self.span] };
        self.in_vain = 0;
        self.renewals += 1;
        let regroup = self.renewals.is_multiple_of(REGROUP);
        self.moving.renew(obstacles, self.valid, regroup);
    }

    /// Makes the boxes hold their obstacles, whatever these have become.
    pub(super) fn renew(&mut self, obstacles: &[Placed<S, D>]) {
        for tree in [&mut self.fixed, &mut self.moving] {
            tree.renew(obstacles, self.valid, false);
        }
    }

    /// The obstacles nearer than `reach` to a link at time `t`, in their order; if
    /// there are none, the nearest one, unless all ignore it. They have been moved to `t`. All of them for a link that is
    /// nowhere.
    #[inline(never)]
    pub(super) fn near(
        &mut self,
        obstacles: &mut [Placed<S, D>],
        t: f64,
        carrier: Carrier,
        link: &S::Probe,
        reach: f64,
    ) -> &[usize] {
        let Self { fixed, moving, in_vain, likely, met, .. } = self;
        let Some(region) = S::Hierarchy::region(link) else {
            for (j, (obstacle, met)) in obstacles.iter_mut().zip(&mut *met).enumerate() {
                obstacle.move_to(t);
                *met = j;
            }
            return met;
        };
        obstacles[*likely].move_to(t);
        let mut least = f64::INFINITY;
        if !obstacles[*likely].is_ignored_by(carrier) {
            least = least.min(obstacles[*likely].distance(link));
        }
        let mut count = 0;
        for tree in [&*fixed, &*moving] {
            let mut useful = 0;
            let measured = tree.hierarchy.for_each_within(&region, least.max(reach), |leaf| {
                let j = tree.members[leaf];
                let obstacle = &mut obstacles[j];
                if obstacle.is_ignored_by(carrier) {
                    return least.max(reach);
                }
                obstacle.move_to(t);
                let surface = obstacle.distance(link);
                if surface < reach {
                    met[count] = j;
                    count += 1;
                    useful += 1;
                }
                if surface < least {
                    (least, *likely) = (surface, j);
                    useful += 1;
                }
                least.max(reach)
            });
            if std::ptr::eq(tree, moving) {
                *in_vain += usize::saturating_sub(measured, useful);
            }
        }
        if count == 0 {
            (met[0], count) = (*likely, 1);
        }
        let met = &mut met[..count];
        met.sort_unstable();
        met
    }
}

/// Coordinates beyond this \[m\] are cut off, so that nothing that is made of boxes overflows, their volume in space
/// included. A box that is cut off comes no further away from what lies within; that of a half-space is as far as
/// there is.
pub const HORIZON: f64 = 1e100;

/// What a box is widened by, relative to its coordinates and to 1 m: far above all rounding, far
/// below all that matters.
pub(super) const MARGIN: f64 = 1e-9;

/// The box around an obstacle from `t0` to `t1` \[s\].
pub(super) fn box_of<S: ObstacleGeometry<D>, const D: usize>(
    obstacle: &Placed<S, D>,
    [t0, t1]: [f64; 2],
) -> [Vector<D>; 2] {
    let description = &obstacle.description;
    let [low, high] = description.motion().extent(t0, t1, description.position());
    let [rear, front] = obstacle.extent([t0, t1]);
    let (low, high) = (low + rear, high + front);
    let one = Vector::repeat(1.0);
    let size = [low, high, rear, front].iter().fold(one, |a, b| a + b.abs());
    widened([low, high], size.sum())
}

/// A box that allows for the rounding of numbers that add up to `size`, within the horizon.
pub(super) fn widened<const D: usize>([low, high]: [Vector<D>; 2], size: f64) -> [Vector<D>; 2] {
    let margin = MARGIN * size;
    // What is not a number is everywhere.
    let cut = |x: f64, or: f64| if x.is_nan() { or } else { x.clamp(-HORIZON, HORIZON) };
    [low.map(|x| cut(x - margin, -HORIZON)), high.map(|x| cut(x + margin, HORIZON))]
}

/// Some of the obstacles, in a hierarchy of boxes.
#[derive(Debug, Clone)]
struct Tree<H> {
    /// Which obstacles: the boxes of the hierarchy are numbered by their place in here.
    members: Vec<usize>,
    hierarchy: H,
}

impl<H> Tree<H> {
    fn new<S: ObstacleGeometry<D, Hierarchy = H>, const D: usize>(
        members: Vec<usize>,
        obstacles: &[Placed<S, D>],
        time: [f64; 2],
    ) -> Self
    where
        H: Hierarchy<S::Probe, D>,
    {
        let work = 256 * members.len();
        let boxes: Vec<_> = members.iter().map(|&j| box_of(&obstacles[j], time)).collect();
        interrupt::checkpoint(work);
        let mut tree = Self { members, hierarchy: H::new(&boxes) };
        // Twice, and the hierarchy has all the room that it will ever need.
        for _ in 0..2 {
            interrupt::checkpoint(work);
            tree.renew(obstacles, time, true);
        }
        tree
    }

    /// Makes the boxes hold their obstacles over a time \[s\].
    fn renew<S: ObstacleGeometry<D, Hierarchy = H>, const D: usize>(
        &mut self,
        obstacles: &[Placed<S, D>],
        time: [f64; 2],
        regroup: bool,
    ) where
        H: Hierarchy<S::Probe, D>,
    {
        let boxes = self.members.iter().map(|&j| box_of(&obstacles[j], time));
        self.hierarchy.renew(boxes, regroup);
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::Body;
    use crate::math::{Capsule, ThirdOrderFilter};
    use crate::world::plane::{Obstacle, PlanarGeometry, Shape};
    use crate::world::{CollisionQuery, Motion, Named, World};
    use proptest::prelude::*;

    /// The same obstacles, all of them measured for every link.
    fn plain<S: ObstacleGeometry<D>, const D: usize>(obstacles: &[S::Obstacle]) -> World<S, D> {
        let world = World::new(obstacles.to_vec());
        World { named: Named::each(&world.obstacles, vec![]), ..world }
    }

    /// The same obstacles in a hierarchy, however few they are.
    fn crowded<S: ObstacleGeometry<D>, const D: usize>(obstacles: &[S::Obstacle]) -> World<S, D> {
        let world = plain(obstacles);
        World { named: Named::BroadPhase(Box::new(BroadPhase::new(&world.obstacles))), ..world }
    }

    /// Everything that the world tells, to the last bit (the text of a number is unique).
    fn told<S: ObstacleGeometry<D>, const D: usize>(
        world: &mut World<S, D>,
        links: &[Capsule<D>],
        reach: f64,
    ) -> (Vec<String>, Vec<u64>) {
        let (mut contacts, mut distances) = (vec![], vec![]);
        let distance = |link, distance: f64| {
            assert_eq!(link, distances.len(), "one distance per link");
            distances.push(distance.to_bits());
        };
        let visit = |contact: &_| contacts.push(format!("{contact:?}"));
        let bodies = links.iter().enumerate().map(|(link, shape)| Body::new(link, *shape));
        world.for_each_contact(bodies, reach, distance, visit);
        (contacts, distances)
    }

    /// Both ways of asking agree, from time to time. Returns how often the boxes were renewed.
    pub fn check<S: ObstacleGeometry<D>, const D: usize>(
        obstacles: &[S::Obstacle],
        links: impl Fn(f64) -> Vec<Capsule<D>>,
        reach: f64,
        times: impl IntoIterator<Item = f64>,
    ) -> usize {
        let (mut plain, mut crowded) = (plain::<S, D>(obstacles), crowded::<S, D>(obstacles));
        for t in times {
            plain.update(t);
            crowded.update(t);
            let links = links(t);
            assert_eq!(
                told(&mut crowded, &links, reach),
                told(&mut plain, &links, reach),
                "t = {t}"
            );
            for j in 0..plain.len() {
                let text = |w: &World<S, D>| {
                    let turn = w.turn_at(j, t);
                    format!("{} {} {} {turn:?}", w.position(j), w.velocity(j), w.acceleration(j))
                };
                assert_eq!(text(&crowded), text(&plain));
            }
        }
        let Named::BroadPhase(broad_phase) = crowded.named else { panic!("no crowd") };
        broad_phase.renewals
    }

    /// Small steps and great leaps, there and back.
    pub fn times() -> impl Strategy<Value = Vec<f64>> {
        prop::collection::vec((-1.0..2.0, -4i32..2), 8).prop_map(|steps| {
            let mut t = 0.0;
            let leap = |(step, exponent): (f64, i32)| {
                t += step * f64::powi(10.0, exponent);
                t
            };
            steps.into_iter().map(leap).collect()
        })
    }

    /// Mostly human, sometimes what no human would write but the scenario allows.
    pub fn scale() -> impl Strategy<Value = f64> {
        prop_oneof![
            8 => Just(1.0),
            1 => prop::sample::select(vec![0.0, 1e-300, 1e-160, 1e-12, 1e7, 1e16, 1e60, 1e100]),
        ]
    }

    pub fn point<const D: usize>(range: f64) -> impl Strategy<Value = [f64; D]> {
        (prop::array::uniform::<_, D>(-range..range), scale())
            .prop_map(|(v, scale)| v.map(|x| x * scale))
    }

    fn shape() -> impl Strategy<Value = Shape> {
        let radius = || (0.0..0.5, scale()).prop_map(|(radius, scale)| radius * scale);
        prop_oneof![
            radius().prop_map(|radius| Shape::Circle { radius }),
            (point(1.0), point(1.0), radius()).prop_map(|(a, b, radius)| Shape::Capsule {
                a,
                b,
                radius
            }),
            point(1.0).prop_map(|size| Shape::Box { size: size.map(f64::abs) }),
            (3usize..7, -1.0..1.0, 0.05..1.0, scale()).prop_map(|(n, turn, radius, scale)| {
                let corner = |k: usize| {
                    let angle: f64 = turn + std::f64::consts::TAU * k as f64 / n as f64;
                    [angle.cos() * radius * scale, angle.sin() * radius * scale]
                };
                Shape::Polygon { vertices: (0..n).map(corner).collect() }
            }),
        ]
    }

    pub fn motion<const D: usize>() -> impl Strategy<Value = Motion<D>> {
        let vector = || prop::array::uniform::<_, D>(-3.0..3.0).prop_map(Vector::<D>::from);
        prop_oneof![
            Just(Motion::default()),
            point(2.0).prop_map(|velocity| Motion::Linear { velocity }),
            (point(2.0), -9.0..9.0, scale(), -9.0..9.0).prop_map(|(amplitude, omega, s, phase)| {
                Motion::Sinusoid { amplitude, angular_frequency: s * omega, phase, foreseen: false }
            }),
            (prop::collection::vec(point(5.0), 4), any::<bool>()).prop_map(
                |(points, is_smooth)| {
                    let mut motion = Motion::waypoints(vec![-1.0, 0.5, 0.501, 3.0], points);
                    if let Motion::Waypoints { interpolation, .. } = &mut motion
                        && is_smooth
                    {
                        *interpolation = crate::world::Interpolation::Smooth;
                    }
                    motion
                }
            ),
            [vector(), vector()].prop_map(|[from, to]| {
                Motion::Dragged(ThirdOrderFilter::new(0.5, [from, to, from], to, 3.0))
            }),
        ]
    }

    /// Of turning; half of them do not.
    pub fn rate() -> impl Strategy<Value = f64> {
        prop_oneof![Just(0.0), -9.0..9.0]
    }

    fn obstacle() -> impl Strategy<Value = Obstacle> {
        (shape(), point(5.0), [-4.0..4.0, -4.0..4.0], motion(), rate()).prop_map(
            |(shape, position, [angle, other], mut motion, angular_velocity)| {
                if let Motion::Waypoints { angles, .. } = &mut motion
                    && other > 0.0
                {
                    *angles = vec![angle, angle - other, other, angle];
                }
                Obstacle { position, angle, angular_velocity, motion, ..Obstacle::of(shape) }
            },
        )
    }

    fn link() -> impl Strategy<Value = Capsule<2>> {
        (point(4.0), -4.0..4.0, 1e-3..2.0, 0.0..0.2, scale()).prop_map(
            |(start, angle, length, radius, scale)| Capsule {
                start: start.into(),
                direction: Vector::<2>::new(f64::cos(angle), f64::sin(angle)),
                length: length * scale,
                radius,
            },
        )
    }

    pub fn reach() -> impl Strategy<Value = f64> {
        let special = vec![f64::NEG_INFINITY, 0.0, 1e100, f64::INFINITY];
        prop_oneof![3 => 0.0..3.0, 1 => prop::sample::select(special)]
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(256))]

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
            check::<PlanarGeometry, 2>(&obstacles, |_| links.clone(), reach, times);
        }
    }

    #[test]
    fn a_long_run_through_a_moving_crowd() {
        // Discs on a lattice that swing and drift, and a link that turns among them: the boxes are
        // renewed and regrouped many times.
        let obstacles: Vec<_> = (0..400)
            .map(|j| {
                let (x, y) = (f64::from(j % 20), f64::from(j / 20));
                let motion = match j % 3 {
                    0 => Motion::default(),
                    1 => Motion::Linear { velocity: [0.3 * (y - 10.0), 0.2 * (10.0 - x)] },
                    _ => Motion::Sinusoid {
                        amplitude: [1.0, x],
                        angular_frequency: y,
                        phase: x,
                        foreseen: false,
                    },
                };
                let shape = Shape::Circle { radius: 0.1 };
                Obstacle { position: [x - 10.0, y - 10.0], motion, ..Obstacle::of(shape) }
            })
            .collect();
        let links = |t: f64| {
            let end = Vector::<2>::new(3.0 * t.cos(), 3.0 * t.sin());
            vec![Capsule::new(Vector::zeros(), end, 0.05), Capsule::new(end, -end, 0.0)]
        };
        let times = (0..3000).map(|step| 0.002 * f64::from(step));
        let renewals = check::<PlanarGeometry, 2>(&obstacles, links, 0.6, times);
        assert!(renewals > 2 * REGROUP && renewals < 2000, "{renewals}");
    }

    #[test]
    fn links_that_are_nowhere_are_answered_as_ever() {
        let disc = |x| Obstacle {
            position: [x, 0.0],
            motion: Motion::Linear { velocity: [1.0, 0.0] },
            ..Obstacle::of(Shape::Circle { radius: 0.1 })
        };
        let obstacles: Vec<_> = (0..50).map(|j| disc(f64::from(j))).collect();
        for value in [f64::NAN, f64::INFINITY, 1e200, f64::MAX] {
            let start = Vector::<2>::new(value, 0.0);
            for end in [Vector::<2>::zeros(), start] {
                let link = Capsule::new(start, end, 0.1);
                let times = [0.0, 0.5, f64::NAN, 1e300, f64::INFINITY, 0.1];
                check::<PlanarGeometry, 2>(&obstacles, |_| vec![link], 1.0, times);
            }
        }
    }
}
