//! Where an arm touches nothing, and whether a straight motion stays there.
//!
//! A motion between two configurations is *certified*, not sampled: at its middle every link is as far from everything
//! as it is measured to be, and no point of it can go farther in half of the motion than its joints carry it. Where that
//! is less, the whole half is free; otherwise it is halved again (T119). What is kept may depend on where the arm is (T150).

use super::around::{Around, Window};
use super::levers::{Jointed, Levers, Twist};
use super::margins::{APART, Margins};
use super::own_room::{OwnRoom, moving};
use super::pointing::Pointing;
use super::why::Obstruction;
use crate::control::distance::OwnPair;
use crate::geometry::Body;
use crate::interrupt;
use crate::math::Vector;
use crate::world::{CollisionQuery, ObstacleGeometry, PairMargin, World};
use foldhash::fast::FixedState;
use std::collections::{HashMap, VecDeque};

/// A part of a motion in which nothing goes farther than this is free for a link if its middle is: a share of its margin, from
/// so much to so much \[m\]. That much less than the margin is certain.
const RESOLUTION: f64 = 0.2;
const FINEST: f64 = 2e-5;
const COARSEST: f64 = 5e-3;
/// At least so fine for an arm of less than 10 cm, as a share of its size: a small one is not to pass through what it touches.
const FINEST_SHARE: f64 = 2e-4;
/// A motion that needs shorter parts than this share of it counts as blocked.
pub const SHORTEST: f64 = 1.0 / (1u32 << 20) as f64;
/// How many of what blocked the last motions are asked first.
const BLOCKERS: usize = 8;
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
    reach: Levers,
    /// How fine motions are looked at, at most \[m\].
    finest: f64,
    /// Whether bodies of the arm must not touch each other.
    keeps_apart: bool,
    /// What every link keeps from everything, and bodies of the arm from each other.
    pub margins: Margins,
    /// The margin that is asked for \[m\], with which margins of pairs of their own are compared.
    pub asked: f64,
    /// The largest of those in parts of it, 1 or more.
    pub most_share: f64,
    /// Where the end effector has to point.
    pub pointings: Vec<Pointing>,
    /// From where on it does not matter how far a link is \[m\].
    limits: Vec<f64>,
    /// Signed distance of each link from what is nearest of that from which it keeps the usual margin \[m\], ∞ from its limit on.
    clearance: Vec<f64>,
    bodies: Vec<Body<'static, D>>,
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

/// Two that must not come too near to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Two {
    /// A body of the arm and an obstacle, each by its number, with the number of the world.
    Obstacle { body: usize, world: usize, obstacle: usize },
    /// Two bodies of the arm, the still ones counted behind the others.
    Own([usize; 2]),
}

/// Two that may be near to each other in a part of a motion.
#[derive(Debug, Clone, Copy)]
struct Near {
    two: Two,
    /// The body of the arm that moves as the other sees it, and the link that carries that if it is one of the arm, too.
    body: usize,
    from: Option<usize>,
    /// How far it goes at most in the whole motion as the other sees it \[m\], and how much it is accelerated if that takes unit
    /// time.
    way: f64,
    bend: f64,
    /// By how much what they have to keep changes at most in the whole motion \[m\].
    drift: f64,
    /// What they keep, in parts of what the link does.
    share: f64,
}

/// The two ends of a motion that is certified.
type Ends<'a> = [&'a [f64]; 2];

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
        let passing = Around::passing(world, &others, [start, start + duration], ball);
        let n = robot.dof();
        let own = if keeps_apart { OwnRoom::of_all(&robot) } else { vec![] };
        let most_own = world.most_margin();
        let asked = if most_own > 0.0 { margin.max(LEAST_ASKED) } else { margin };
        Self {
            most_share: if most_own > 0.0 { (most_own / asked).max(1.0) } else { 1.0 },
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
        self.worlds.iter().any(|around| around.world.most_margin() > 0.0)
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

    /// What bodies of the arm at `q` keep from each other \[m\].
    pub fn apart_at(&self, q: &[f64]) -> f64 {
        self.margins.apart_at(q, &self.reach)
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

    /// Whether it is and does on the straight motion from `a` to `b`, and the end effector points where it has to.
    pub fn is_free_between(&mut self, a: &[f64], b: &[f64]) -> bool {
        let Self { pointings, robot, reach, .. } = self;
        pointings.iter().all(|pointing| pointing.is_kept(robot, reach, [a, b]))
            && self.touches_nothing_between(a, b)
    }

    /// The same, wherever the end effector points.
    pub fn touches_nothing_between(&mut self, a: &[f64], b: &[f64]) -> bool {
        let mut near = std::mem::take(&mut self.near);
        near.clear();
        let blocker = self.blocker_of([a, b], &mut near);
        self.near = near;
        if let Some(blocker) = blocker {
            self.blockers.retain(|two| *two != blocker);
            self.blockers.truncate(BLOCKERS - 1);
            self.blockers.insert(0, blocker);
        }
        blocker.is_none()
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

    /// What keeps the motion between two `ends` from being free. Halves of halves are asked, the large ones first: what is hit is hit
    /// soon. Of each, those two alone are asked that are not certain to keep apart in what it is a half of. `near` is an empty
    /// workspace.
    fn blocker_of(&mut self, ends: Ends<'_>, near: &mut Vec<Near>) -> Option<Two> {
        self.move_to(ends, 0.5);
        if let Some(blocked) = self.first_look(ends, near) {
            return Some(blocked);
        }
        let mut parts = VecDeque::new();
        let halves = |at: f64, half: f64, of: std::ops::Range<usize>| {
            let quarter = 0.5 * half;
            [(at - quarter, quarter, of.clone()), (at + quarter, quarter, of)]
        };
        if !near.is_empty() {
            parts.extend(halves(0.5, 0.5, 0..near.len()));
        }
        while let Some((at, half, asked)) = parts.pop_front() {
            self.move_to(ends, at);
            let first = near.len();
            for k in asked {
                match self.look(near[k], half).0 {
                    Look::Blocked => return Some(near[k].two),
                    Look::Near if half < SHORTEST => return Some(near[k].two),
                    Look::Near => near.push(near[k]),
                    Look::Apart => {}
                }
            }
            if near.len() > first {
                parts.extend(halves(at, half, first..near.len()));
            }
        }
        None
    }

    /// Puts the arm where it is `at` this share of a motion.
    fn move_to(&mut self, [a, b]: Ends<'_>, at: f64) {
        for (m, (a, b)) in self.middle.iter_mut().zip(a.iter().zip(b)) {
            *m = a + at * (b - a);
        }
        interrupt::checkpoint(16 * a.len());
        self.robot.update_positions(&self.middle);
        Twist::of_links(&self.robot, [a, b], &mut self.twists);
    }

    /// Whether two keep apart in the part of a motion that goes so much before and after where the arm is, and how far they are apart there
    /// at least \[m\].
    fn look(&mut self, near: Near, half: f64) -> (Look, f64) {
        let Near { two, body, from, way, bend, drift, share } = near;
        let Self { robot, worlds, margins, reach, middle, planes, twists, .. } = self;
        let body = robot.body(body);
        let drift = drift * half;
        let (keeps, slack, stands) = match two {
            Two::Obstacle { world, .. } => {
                let slack = worlds[world].slack;
                let keeps = share * margins.at(middle, reach, body.link);
                (keeps + margins.beyond(body.link), slack, slack == 0.0)
            }
            Two::Own(_) => (margins.apart_at(middle, reach), 0.0, true),
        };
        let twist = twists[body.link].beside(from.map(|link| twists[link]));
        let plane = planes.entry(two).or_insert_with(Vector::zeros);
        // That they are not too near here is enough where a plane between them is known, which tells more as a rule.
        let is_known = plane.norm_squared() > 0.0;
        let limit = keeps + slack + if is_known { 0.0 } else { drift + way * half };
        let distance = match two {
            Two::Obstacle { world, obstacle, .. } => {
                interrupt::checkpoint(32);
                worlds[world].world.at_least(obstacle, &body, limit, plane)
            }
            Two::Own(pair) => OwnPair::at_least(robot, pair, limit, plane),
        };
        let room = distance - slack - keeps;
        let is_clear = room >= 0.0; // false for NaN
        if !is_clear {
            return (Look::Blocked, distance);
        }
        // Along the normal of the plane they come no nearer than that (T195), and anyhow no nearer than they go (T119).
        let straight = if stands && plane.norm_squared() > 0.0 {
            half * twist.along(plane, &body.shape) + 0.5 * bend * half * half
        } else {
            f64::INFINITY
        };
        let change = drift + straight.min(way * half);
        if room >= change || change + RESOLUTION * drift <= self.resolution(keeps) {
            (Look::Apart, distance)
        } else {
            (Look::Near, distance)
        }
    }

    /// What blocks a motion where the arm is, in its middle; otherwise all that may be near in it are put into `near`. What blocked the
    /// last ones is asked first.
    fn first_look(&mut self, ends: Ends<'_>, near: &mut Vec<Near>) -> Option<Two> {
        for k in 0..self.blockers.len() {
            let two = self.blockers[k];
            if self.look(self.near(two, ends), 0.5).0 == Look::Blocked {
                return Some(two);
            }
        }
        // How far each link looks around, in every world.
        let most = self.most_share;
        let steepness = 1.0 + most * self.margins.slope();
        let around: Vec<f64> = (0..self.middle.len())
            .map(|link| {
                let keeps = most * self.margin(&self.middle, link) + self.margins.beyond(link);
                keeps + 0.5 * steepness * self.way(ends, link)
            })
            .collect();
        let mut worlds = std::mem::take(&mut self.worlds);
        let mut candidates: Vec<Two> = vec![];
        for (number, Around { world, boxes, slack, .. }) in worlds.iter_mut().enumerate() {
            for body in 0..self.robot.body_count() {
                let placed = self.robot.body(body);
                let limit = around[placed.link] + *slack;
                interrupt::checkpoint(32 + world.len());
                world.for_each_within(boxes, &placed, limit, |_, obstacle| {
                    candidates.push(Two::Obstacle { body, world: number, obstacle });
                    limit
                });
            }
        }
        self.worlds = worlds;
        for two in candidates {
            let seen = self.near(two, ends);
            match self.look(seen, 0.5).0 {
                Look::Blocked => return Some(two),
                Look::Near => near.push(seen),
                Look::Apart => {}
            }
        }
        let keeps = self.apart_at(&self.middle);
        let drift = 0.5 * self.margins.apart_change(ends, &self.reach);
        for k in 0..self.own.len() {
            let half = 0.5 * self.own[k].way(&self.reach, ends);
            if self.own[k].is_apart(&self.reach, &self.middle, keeps + drift + half) {
                continue;
            }
            let two = Two::Own(self.own[k].pair);
            let seen = self.near(two, ends);
            let (look, apart) = self.look(seen, 0.5);
            self.own[k].remember(&self.middle, apart);
            match look {
                Look::Blocked => return Some(two),
                Look::Near => near.push(seen),
                Look::Apart => {}
            }
        }
        None
    }

    /// Two, and how far one of them goes in a motion.
    fn near(&self, two: Two, ends: Ends<'_>) -> Near {
        let (body, from) = match two {
            Two::Obstacle { body, .. } => (body, None),
            Two::Own(pair) => moving(&self.robot, pair),
        };
        let to = self.robot.body(body).link;
        let (way, bend) = (self.reach.way(ends, from, to), self.reach.bend(ends, from, to));
        let (drift, share) = match two {
            Two::Obstacle { world, obstacle, .. } => {
                let margin = self.worlds[world].world.margin_of(obstacle, &self.robot.body(body));
                let share = margin.share(self.asked);
                (share * self.margins.slope() * way, share)
            }
            Two::Own(_) => (self.margins.apart_change(ends, &self.reach), 1.0),
        };
        Near { two, body, from, way, bend, drift, share }
    }
}

/// What is seen of two in a part of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Look {
    /// They are too near to each other.
    Blocked,
    /// They may be, somewhere in it.
    Near,
    /// They are not.
    Apart,
}
