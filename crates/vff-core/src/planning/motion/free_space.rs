//! Where an arm touches nothing, and whether a straight motion stays there.

mod certificate;

pub use certificate::SHORTEST;

use certificate::{Near, Two};

use super::around::{Around, Course, Window};
use super::bundle::Bundle;
use super::levers::{Jointed, Levers, Twist};
use super::margins::{APART, Margins};
use super::own_room::OwnRoom;
use super::pointing::Pointing;
use super::why::Obstruction;
use crate::control::distance::OwnPair;
use crate::geometry::Body;
use crate::interrupt;
use crate::math::Vector;
use crate::world::{CollisionQuery, ObstacleGeometry, PairMargin, World};
use foldhash::fast::FixedState;
use std::collections::HashMap;

/// A part of a motion in which nothing goes farther than this is free for a link if its middle is: a share of its margin, from
/// so much to so much \[m\]. That much less than the margin is certain.
const RESOLUTION: f64 = 0.2;
const FINEST: f64 = 2e-5;
const COARSEST: f64 = 5e-3;
/// At least so fine for an arm of less than 10 cm, as a share of its size: a small one is not to pass through what it touches.
const FINEST_SHARE: f64 = 2e-4;
/// How often the end effector is turned to where it has to point, where it has to in two ways.
const LEVELLINGS: usize = 4;
/// Where margins of their own are compared with what is asked for, this is asked for at least \[m\].
const LEAST_ASKED: f64 = 1e-6;

/// What stands in the way of an arm, and the arm.
#[derive(Debug, Clone)]
pub struct FreeSpace<R, S: ObstacleGeometry<D>, const D: usize> {
    robot: R,
    /// What stands still; then what moves, at the instants at which it is looked for.
    worlds: Vec<Around<S, D>>,
    /// What moves where that counts in time: none of it is in the worlds then that was not asked for.
    course: Option<Course<S, D>>,
    reach: Levers,
    /// How fine motions are looked at, at most \[m\].
    finest: f64,
    /// Whether bodies of the arm must not touch each other.
    keeps_apart: bool,
    /// What every link keeps from everything, and bodies of the arm from each other.
    pub margins: Margins,
    /// The margin that is asked for \[m\], with which margins of pairs of their own are compared.
    pub asked: f64,
    /// The largest of those in parts of it, 1 or more; and whether there are any.
    pub most_share: f64,
    has_own_margins: bool,
    /// Where the end effector has to point.
    pub pointings: Vec<Pointing>,
    /// From where on it does not matter how far a link is \[m\].
    limits: Vec<f64>,
    /// Signed distance of each link from what is nearest of that from which it keeps the usual margin \[m\], ∞ from its limit on.
    clearance: Vec<f64>,
    bodies: Vec<Body<'static, D>>,
    /// Bodies of one link that are looked at together, and the numbers of those and of the others: they count behind all bodies.
    bundles: Vec<Bundle<D>>,
    heads: Vec<usize>,
    middle: Vec<f64>,
    /// How the links move there.
    twists: Vec<Twist>,
    /// What may be near in the parts of a motion that is certified.
    near: Vec<Near>,
    /// What kept the last motions from being free that were not: likely to block the next one, too.
    blockers: Vec<Two>,
    /// The normals of the planes that told hulls apart last.
    planes: HashMap<Two, Vector<D>, FixedState>,
    /// How far the pairs of its own bodies were apart where they were looked at last.
    own: Vec<OwnRoom>,
}

impl<R: Jointed<D>, S: ObstacleGeometry<D>, const D: usize> FreeSpace<R, S, D> {
    /// Of `robot` in `world`; what moves blocks every place that it passes within `window`; without one it is not there.
    pub fn new(
        mut robot: R,
        world: &World<S, D>,
        window: Option<Window>,
        keeps_apart: bool,
        margin: f64,
    ) -> Self {
        let (standing, mut others): (Vec<_>, Vec<_>) =
            (0..world.len()).partition(|j| world.stands_still(*j));
        let [start, duration] =
            window.map_or([0.0; 2], |it| [it.start, it.duration.unwrap_or(0.0)]);
        others.retain(|j| match window {
            Some(Window { duration: Some(_), .. }) => true,
            Some(_) => world.rests_at(*j, start),
            None => false,
        });
        let reach = Levers::new(&mut robot);
        let ball @ (_, radius) = reach.ball();
        let still = Around::new(world.only(standing.iter().copied()), &standing, 0.0);
        let (course, passing) = if window.is_some_and(|it| it.in_time) {
            (Some(Course::new(world, &others, [start, duration], ball)), vec![])
        } else {
            (None, Around::passing(world, &others, [start, start + duration], ball))
        };
        let n = robot.dof();
        let bundles = robot.bundles();
        let own = if keeps_apart { OwnRoom::of_all(&robot, &bundles) } else { vec![] };
        let is_alone = |i: &usize| !bundles.iter().any(|bundle| bundle.members.contains(i));
        let count = robot.body_count() + robot.still_bodies().len();
        let alone = (0..robot.body_count()).filter(is_alone);
        let heads = alone.chain(count..count + bundles.len()).collect();
        let most_own = world.most_margin();
        let asked = if most_own > 0.0 { margin.max(LEAST_ASKED) } else { margin };
        Self {
            most_share: if most_own > 0.0 { (most_own / asked).max(1.0) } else { 1.0 },
            has_own_margins: most_own > 0.0,
            course,
            asked,
            pointings: vec![],
            finest: FINEST.min(FINEST_SHARE * radius),
            reach,
            robot,
            worlds: std::iter::once(still).chain(passing).collect(),
            keeps_apart,
            margins: Margins::constant(vec![margin; n], APART),
            limits: vec![f64::INFINITY; n],
            clearance: vec![f64::INFINITY; n],
            bodies: vec![],
            bundles,
            heads,
            middle: vec![0.0; n],
            twists: vec![],
            near: vec![],
            blockers: vec![],
            planes: HashMap::default(),
            own,
        }
    }

    /// The arm, wherever it was moved last.
    pub fn robot(&mut self) -> &mut R {
        &mut self.robot
    }

    /// Measures links at `q`, each where it is nearer than its limit; ∞ says that it is not. Pairs with a margin of their own are told
    /// by themselves, each with its link and its distance \[m\].
    fn measure(&mut self, q: &[f64], mut own: impl FnMut(usize, PairMargin, f64)) {
        let Self { robot, worlds, limits, clearance, .. } = self;
        robot.update_positions(q);
        clearance.fill(f64::INFINITY);
        for Around { world, boxes, slack, .. } in worlds {
            let slack = *slack;
            interrupt::checkpoint((32 + world.len()) * robot.body_count());
            for body in robot.bodies() {
                let link = body.link;
                let least = &mut clearance[link];
                let limit = least.min(limits[link]) + slack;
                let distance = if world.most_margin() > 0.0 {
                    world.for_each_own_margin(&body, |margin, d| own(link, margin, d - slack));
                    world.usual_distance_within(boxes, &body, limit)
                } else {
                    world.distance_within(boxes, &body, limit)
                };
                *least = least.min(distance - slack);
            }
        }
    }

    /// How far the arm at `q` is from everything outside, and from itself where it must not touch that \[m\].
    #[cfg(test)]
    pub fn distances(&mut self, q: &[f64]) -> [f64; 2] {
        [self.clearance(q), self.own_room(q, f64::INFINITY)]
    }

    /// How far the arm at `q` is from everything outside \[m\].
    pub fn clearance(&mut self, q: &[f64]) -> f64 {
        self.clearance_within(q, f64::INFINITY)
    }

    /// The same where it is less than `limit` \[m\]; otherwise ∞.
    pub fn clearance_within(&mut self, q: &[f64], limit: f64) -> f64 {
        let mut least = limit;
        self.limits.fill(limit);
        self.measure(q, |_, _, distance| least = least.min(distance));
        let least = if least < limit { least } else { f64::INFINITY };
        self.clearance.iter().copied().fold(least, f64::min)
    }

    /// How far each link of the arm at `q` is from everything outside \[m\], a pair with a margin of its own in the share of that; and how
    /// far the nearest is.
    pub fn room(&mut self, q: &[f64]) -> (Vec<f64>, f64) {
        let (mut own, asked) = (vec![], self.asked);
        self.limits.fill(f64::INFINITY);
        self.measure(q, |link, margin, distance| own.push((link, margin.share(asked), distance)));
        let mut room = self.clearance.clone();
        let mut clearance = room.iter().copied().fold(f64::INFINITY, f64::min);
        for (link, share, distance) in own {
            clearance = clearance.min(distance);
            room[link] = room[link].min(distance / share);
        }
        (room, clearance)
    }

    /// How far each link of the arm at `q` is at least from that outside from which it keeps the usual margin \[m\], less by rounding alone
    /// where it touches nothing; `limit` where that is farther. Of other pairs `own` is told.
    pub fn usual_room_at_least(
        &mut self,
        q: &[f64],
        limit: f64,
        mut own: impl FnMut(usize, PairMargin, f64),
    ) -> Vec<f64> {
        let Self { robot, worlds, planes, .. } = self;
        robot.update_positions(q);
        let mut room = vec![limit; q.len()];
        for (number, Around { world, boxes, slack, .. }) in worlds.iter_mut().enumerate() {
            let slack = *slack;
            interrupt::checkpoint((32 + world.len()) * robot.body_count());
            for (i, body) in robot.bodies().enumerate() {
                let link = body.link;
                let has_own = world.most_margin() > 0.0;
                if has_own {
                    world.for_each_own_margin(&body, |margin, d| own(link, margin, d - slack));
                }
                let mut least = room[link] + slack;
                world.for_each_within(boxes, &body, least, |world, obstacle| {
                    if !(has_own && world.margin_of(obstacle, &body).is_own()) {
                        let two = Two::Obstacle { body: i, world: number, obstacle };
                        let plane = planes.entry(two).or_insert_with(Vector::zeros);
                        least = least.min(world.at_least(obstacle, &body, least, plane));
                    }
                    least
                });
                room[link] = room[link].min(least - slack);
            }
        }
        room
    }

    /// Whether bodies of the arm must not touch each other.
    pub fn keeps_apart(&self) -> bool {
        self.keeps_apart
    }

    /// Whether some pairs have margins of their own.
    pub fn has_own_margins(&self) -> bool {
        self.has_own_margins
    }

    /// How long it is known what moves \[s\]; None where that is in the way of the arm all the time, or there is none.
    pub fn course(&self) -> Option<f64> {
        self.course.as_ref().map(|course| course.duration)
    }

    /// Where what moves counts in time: it is in the way where it is between two times after the beginning \[s\], or nowhere.
    pub fn show(&mut self, times: Option<[f64; 2]>) {
        if let Some(course) = &mut self.course
            && course.take(times, &mut self.worlds)
        {
            self.blockers.clear();
        }
    }

    /// Whether what moves is out of the way of a straight motion between two times \[s\], whatever else is in the way of it.
    pub fn is_passed_between(&mut self, a: &[f64], b: &[f64], times: [f64; 2]) -> bool {
        self.show(Some(times));
        self.blockers.clear(); // the numbers of worlds are others
        let own = std::mem::take(&mut self.own);
        let passing = self.worlds.split_off(1);
        let still = std::mem::replace(&mut self.worlds, passing);
        let is_passed = self.touches_nothing_between(a, b);
        let passing = std::mem::replace(&mut self.worlds, still);
        self.worlds.extend(passing);
        self.own = own;
        self.blockers.clear();
        is_passed
    }

    /// What is certain where a motion was found to keep `margin` \[m\].
    pub fn certain(&self, margin: f64) -> f64 {
        (margin - self.resolution(margin)).max(0.0)
    }

    fn resolution(&self, margin: f64) -> f64 {
        (RESOLUTION * margin).clamp(self.finest, COARSEST)
    }

    /// How far points of `link` go at most while the joints go from `a` to `b` \[m\].
    pub fn way(&self, ends: [&[f64]; 2], link: usize) -> f64 {
        self.reach.way(ends, None, link)
    }

    /// How far the tip of the end effector goes at most \[m\].
    pub fn way_of_tip(&self, ends: [&[f64]; 2]) -> f64 {
        self.reach.of_tip(ends)[0]
    }

    /// What `link` is to keep at `q` \[m\].
    pub fn margin(&self, q: &[f64], link: usize) -> f64 {
        self.margins.at(q, &self.reach, link)
    }

    /// Whether the arm at `q` keeps the margin, and is apart from itself.
    pub fn is_free(&mut self, q: &[f64]) -> bool {
        self.is_free_between(q, q)
    }

    /// How far the arm at `q` is from itself where it must not touch that \[m\], if that is less than `limit`; otherwise ∞.
    pub fn own_room(&mut self, q: &[f64], limit: f64) -> f64 {
        self.robot.update_positions(q);
        let own = self.nearest_of_its_own(limit).filter(|_| self.keeps_apart);
        own.map_or(f64::INFINITY, |own| own.0)
    }

    /// What keeps the arm at `q` from being free: the obstacle that is deepest in it, or the pair of its own bodies that is.
    pub fn obstruction(&mut self, q: &[f64]) -> Option<Obstruction> {
        let Self { robot, worlds, .. } = self;
        robot.update_positions(q);
        let mut worst: Option<(f64, usize, usize, bool)> = None;
        for Around { world, numbers, slack, .. } in worlds {
            let passes = *slack > 0.0; // where the horizon is 0, what moves is taken for standing still
            world.for_each_pair(robot.bodies(), |contact| {
                let distance = contact.distance.min(f64::MAX) - *slack;
                if worst.is_none_or(|(least, ..)| distance < least) {
                    let number = numbers[contact.obstacle];
                    worst = Some((distance, contact.link, number, passes));
                }
            });
        }
        if let Some((distance, link, obstacle, passes)) = worst.filter(|worst| worst.0 <= 0.0) {
            let link = self.robot.link_name(Some(link));
            return Some(Obstruction::Obstacle { link, obstacle, distance, passes });
        }
        if !self.keeps_apart {
            return None;
        }
        let (distance, links) = self.nearest_of_its_own(f64::INFINITY)?;
        let links = links.map(|link| self.robot.link_name(link));
        let hulls = self.robot.bodies().any(|body| body.hull.is_some());
        Some(Obstruction::Own { links, distance, hulls })
    }

    /// The two bodies of the arm that are nearest to each other where they must not touch, and their distance \[m\], if that is
    /// less than `limit`; from where the arm was moved last.
    fn nearest_of_its_own(&mut self, limit: f64) -> Option<(f64, [Option<usize>; 2])> {
        let Self { robot, bodies, .. } = self;
        let mut nearest = (limit, None);
        OwnPair::for_each_within(robot, bodies, limit, |pair| {
            if pair.nearest.distance < nearest.0 {
                nearest = (pair.nearest.distance, Some(pair.links));
            }
            nearest.0
        });
        Some((nearest.0, nearest.1?))
    }

    /// The two bodies of the arm at `q` that are deepest in each other although nobody asked to keep them apart, and the depth
    /// \[m\].
    pub fn passed_through(&mut self, q: &[f64]) -> Option<(f64, [String; 2])> {
        if self.keeps_apart {
            return None;
        }
        self.robot.update_positions(q);
        let (distance, links) = self.nearest_of_its_own(0.0)?;
        Some((-distance, links.map(|link| self.robot.link_name(link))))
    }

    /// Begins a search of motions from `start` to `goals` with what may be off at them.
    pub fn search_between(&mut self, start: &[f64], goals: &[Vec<f64>]) {
        let Self { robot, pointings, .. } = self;
        pointings.iter_mut().for_each(|it| it.search(robot, start, goals));
    }

    /// How far the end effector at `q` is off where it has to point, and may be \[rad\].
    pub fn each_off(&mut self, q: &[f64]) -> Vec<(f64, f64)> {
        let Self { robot, pointings, .. } = self;
        if !pointings.is_empty() {
            robot.update_positions(q);
        }
        pointings.iter().map(|it| (it.of(robot), it.most())).collect()
    }

    /// The largest share of that; 0 where it does not matter where it points.
    pub fn off_at(&mut self, q: &[f64]) -> f64 {
        self.each_off(q).into_iter().map(|(off, most)| off / most).fold(0.0, f64::max)
    }

    /// What of that it is off most at `q`, in a sentence; it has to point somewhere.
    pub fn why_off(&mut self, q: &[f64]) -> String {
        let Self { robot, pointings, .. } = self;
        robot.update_positions(q);
        let share = |it: &&Pointing| it.of(robot) / it.most();
        let worst = pointings.iter().max_by(|a, b| share(a).total_cmp(&share(b)));
        worst.expect("it has to").why(robot)
    }

    /// Moves `q` to where the end effector is off no more than it may; whether it is not where it was.
    pub fn level(&mut self, q: &mut [f64]) -> bool {
        let Self { robot, pointings, .. } = self;
        let mut is_moved = false;
        for _ in 0..LEVELLINGS {
            let moved = pointings.iter().filter(|it| it.level(robot, q)).count();
            is_moved |= moved > 0;
            // What the last one did is undone by nobody.
            if moved == 0 || pointings.len() == 1 {
                break;
            }
        }
        is_moved
    }
}
