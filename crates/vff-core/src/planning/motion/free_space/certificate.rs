//! Whether a straight motion of an arm is free: certified, not sampled.
//!
//! At its middle every link is as far from everything as it is measured to be, and no point of it can go farther in half of the motion
//! than its joints carry it. Where that is less, the whole half is free; otherwise it is halved again (T119). What is kept may depend
//! on where the arm is (T150).

use super::super::around::Around;
use super::super::bundle::{body_of, bundle_of};
use super::super::levers::{Jointed, Twist};
use super::super::own_room::{OwnRoom, apart_at_least, moving};
use super::{FreeSpace, RESOLUTION};
use crate::interrupt;
use crate::math::Vector;
use crate::world::ObstacleGeometry;
use std::collections::VecDeque;

/// A motion that needs shorter parts than this share of it counts as blocked.
pub const SHORTEST: f64 = 1.0 / (1u32 << 20) as f64;
/// How many of what blocked the last motions are asked first.
const BLOCKERS: usize = 8;

/// Two that must not come too near to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Two {
    /// A body of the arm or a bundle and an obstacle, each by its number, with the number of the world.
    Obstacle { body: usize, world: usize, obstacle: usize },
    /// Two bodies of the arm, the still ones counted behind the others and bundles behind those.
    Own([usize; 2]),
}

/// Two that may be near to each other in a part of a motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct Near {
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
    /// Whether the arm keeps its margins on the straight motion from `a` to `b`, is apart from itself, and its end effector points
    /// where it has to.
    pub fn is_free_between(&mut self, a: &[f64], b: &[f64]) -> bool {
        self.blocked_between(a, b).is_none()
    }

    /// Where on that motion it was seen not to, as a share of it: somewhere up to there, at least. None where it is free.
    pub fn blocked_between(&mut self, a: &[f64], b: &[f64]) -> Option<f64> {
        let Self { pointings, robot, reach, .. } = self;
        match pointings.iter().all(|pointing| pointing.is_kept(robot, reach, [a, b])) {
            true => self.touched_between(a, b),
            false => Some(1.0),
        }
    }

    /// The same, wherever the end effector points.
    pub fn touches_nothing_between(&mut self, a: &[f64], b: &[f64]) -> bool {
        self.touched_between(a, b).is_none()
    }

    /// Where on the straight motion from `a` to `b` the arm was seen to be too near to something, as a share of the motion; it may be
    /// so before, too.
    #[inline(never)]
    fn touched_between(&mut self, a: &[f64], b: &[f64]) -> Option<f64> {
        let mut near = std::mem::take(&mut self.near);
        near.clear();
        let found = self.blocker_of([a, b], &mut near);
        self.near = near;
        if let Some((blocker, _)) = found {
            self.blockers.retain(|two| *two != blocker);
            self.blockers.truncate(BLOCKERS - 1);
            self.blockers.insert(0, blocker);
        }
        found.map(|(_, at)| at)
    }

    /// What keeps the motion between two `ends` from being free. Halves of halves are asked, the large ones first: what is hit is hit
    /// soon. Of each, those two alone are asked that are not certain to keep apart in what it is a half of. `near` is an empty
    /// workspace.
    fn blocker_of(&mut self, ends: Ends<'_>, near: &mut Vec<Near>) -> Option<(Two, f64)> {
        self.move_to(ends, 0.5);
        if let Some(blocked) = self.first_look(ends, near) {
            return Some((blocked, 0.5));
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
                if let Some(blocked) = self.ask(near[k], half, ends, near) {
                    return Some((blocked, at));
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

    /// Which two block the part of a motion that goes so much before and after where the arm is. Those that only may, in a part of that,
    /// are put into `near`. What is too near to a bundle is looked at body by body.
    #[inline(never)]
    fn ask(&mut self, two: Near, half: f64, ends: Ends<'_>, near: &mut Vec<Near>) -> Option<Two> {
        match self.look(two, half).0 {
            Look::Apart => return None,
            Look::Near if half >= SHORTEST => {
                near.push(two);
                return None;
            }
            Look::Near | Look::Blocked => {}
        }
        let Some(members) = self.members(two.two) else { return Some(two.two) };
        members.into_iter().find_map(|member| {
            let member = self.near(member, ends);
            self.ask(member, half, ends, near)
        })
    }

    /// What two of which one is a bundle stand for.
    fn members(&self, two: Two) -> Option<Vec<Two>> {
        match two {
            Two::Obstacle { body, world, obstacle } => {
                let bundle = bundle_of(&self.robot, &self.bundles, body)?;
                let of = |body: &usize| Two::Obstacle { body: *body, world, obstacle };
                Some(bundle.members.iter().map(of).collect())
            }
            Two::Own(pair) => {
                let room = self.own.iter().find(|room| room.pair == pair)?;
                let members = room.members.iter().map(|member| Two::Own(member.pair));
                Some(members.collect()).filter(|members: &Vec<_>| !members.is_empty())
            }
        }
    }

    /// Whether two keep apart in the part of a motion that goes so much before and after where the arm is, and how far they are apart there
    /// at least \[m\].
    fn look(&mut self, near: Near, half: f64) -> (Look, f64) {
        let Near { two, body, from, way, bend, drift, share } = near;
        let Self { robot, bundles, worlds, margins, reach, middle, planes, twists, .. } = self;
        let body = body_of(robot, bundles, body);
        let drift = drift * half;
        let (keeps, slack, stands) = match two {
            Two::Obstacle { world, .. } => {
                let slack = worlds[world].slack;
                let keeps = share * margins.at(middle, reach, body.link);
                (keeps + margins.beyond(body.link), slack, slack == 0.0)
            }
            Two::Own(_) => (margins.apart_at(middle, reach, from, body.link), 0.0, true),
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
            Two::Own(pair) => apart_at_least(robot, bundles, pair, limit, plane),
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
            for &body in &self.heads {
                let placed = body_of(&self.robot, &self.bundles, body);
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
            let blocked = self.ask(self.near(two, ends), 0.5, ends, near);
            if blocked.is_some() {
                return blocked;
            }
        }
        let mut own = std::mem::take(&mut self.own);
        let found = own.iter_mut().find_map(|room| self.ask_own(room, ends, near));
        self.own = own;
        found
    }

    /// Which two of the arm's own bodies block the motion where the arm is, in its middle; those that may, somewhere in it, are put into
    /// `near`.
    fn ask_own(&mut self, room: &mut OwnRoom, ends: Ends<'_>, near: &mut Vec<Near>) -> Option<Two> {
        let half = 0.5 * room.way(&self.reach, ends);
        let keeps = room.keeps(&self.margins, &self.reach, &self.middle);
        let drift = self.margins.apart_slope() * half;
        if room.is_apart(&self.reach, &self.middle, keeps + drift + half) {
            return None;
        }
        let two = Two::Own(room.pair);
        let seen = self.near(two, ends);
        let (look, apart) = self.look(seen, 0.5);
        room.remember(&self.middle, apart);
        match look {
            Look::Apart => None,
            Look::Near => {
                near.push(seen);
                None
            }
            Look::Blocked if room.members.is_empty() => Some(two),
            Look::Blocked => {
                room.members.iter_mut().find_map(|member| self.ask_own(member, ends, near))
            }
        }
    }

    /// Two, and how far one of them goes in a motion.
    #[inline(never)]
    fn near(&self, two: Two, ends: Ends<'_>) -> Near {
        let (body, from) = match two {
            Two::Obstacle { body, .. } => (body, None),
            Two::Own(pair) => moving(&self.robot, &self.bundles, pair),
        };
        let moves = body_of(&self.robot, &self.bundles, body);
        let to = moves.link;
        let (way, bend) = (self.reach.way(ends, from, to), self.reach.bend(ends, from, to));
        let (drift, share) = match two {
            Two::Obstacle { world, obstacle, .. } => {
                let margin = self.worlds[world].world.margin_of(obstacle, &moves);
                let share = margin.share(self.asked);
                (share * self.margins.slope() * way, share)
            }
            Two::Own(_) => (self.margins.apart_slope() * way, 1.0),
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
