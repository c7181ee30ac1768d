//! The search for one motion.

use super::straight::{Short, Way};
use super::why::Place;
use super::*;
use crate::world::PairMargin;

/// Where the random numbers of planning come from.
pub(super) const STREAM: u64 = 7;
/// Shortcuts that are tried on each path.
const SHORTCUTS: usize = 200;
/// What is kept of the margin of the path where corners are rounded, and of what bodies of the arm keep from each other.
const ROUNDED: [f64; 2] = [0.5, 0.8];
/// Of the samples, a search that a lower margin may follow gets one in so many; and after so many both trees have to have
/// grown.
const TRIAL: usize = 32;
const PATIENCE: usize = 50;
/// How often another path is searched where no smooth motion was found near the last ones.
const AGAIN: usize = 4;
/// In parts in which a joint goes no farther \[rad or m\], and in so many at most, a piece is looked at for what it keeps.
const PART: f64 = 0.045;
const MOST_PARTS: f64 = 2.0;
/// More than this is not said to be kept \[m\].
const MOST_KEPT: f64 = 0.3;

/// A search under way. Whatever the task, it is compiled once for each space: which configurations have a pose is asked of whoever knows.
pub(super) struct Planner<'a, S: SpaceTypes<D>, const D: usize> {
    pub arm: Arc<S::Arm>,
    pub space: FreeSpace<S::State, S::Geometry, D>,
    pub settings: &'a PlanSettings,
    pub start: Vec<f64>,
    /// What the law that will follow sends to the robot.
    pub command: &'a CommandSettings,
    /// The shares of the largest speeds of joints and of the tip that it keeps.
    pub kept: [f64; 2],
    pub noise: Noise,
}

/// Finds configurations within limits for a planner, or how far the end effector stays away from where it is to go \[m\].
pub(super) type Configurations<'g, P> =
    dyn FnMut(&mut P, &Limits) -> Result<Vec<Vec<f64>>, f64> + 'g;

/// Where a motion has to end.
pub(super) enum Aim<'g, P> {
    /// At a configuration.
    At(&'g [f64]),
    /// At one of those that are found; whether they have an orientation in common.
    Found { find: &'g mut Configurations<'g, P>, is_turned: bool },
}

/// A motion, and what each link is certain to keep at its knots \[m\], and of margins of their own.
pub(super) type Certified = (JointSpline, [Vec<Vec<f64>>; 2]);

/// How far a link is from what has a margin of its own \[m\].
type Room = (usize, PairMargin, f64);

/// The range of joint `i`, infinite where it has no limits.
pub(in crate::planning) fn ranges_of(limits: &Limits, i: usize) -> [f64; 2] {
    limits.joint.get(i).copied().unwrap_or([f64::NEG_INFINITY, f64::INFINITY])
}

/// Why a motion is of no use that is as deep in something as `clearance` says, negative \[m\].
fn touching(clearance: f64) -> (PlanStatus, String) {
    let depth = length(-clearance);
    let why = format!(
        "there is a motion, and it goes {depth} into something; a margin that is not 0, or another seed, may help"
    );
    (PlanStatus::NotFound, why)
}

impl<S: SpaceTypes<D>, const D: usize> Planner<'_, S, D>
where
    S::State: Jointed<D>,
{
    pub fn plan(&mut self, goal: Aim<'_, Self>) -> Result<Plan, ScenarioError> {
        let start = self.start.clone();
        let limits = self.arm.limits().clone();
        let inside = |q: &[f64]| {
            q.iter().enumerate().all(|(i, q)| {
                let [lower, upper] = ranges_of(&limits, i);
                lower <= *q && *q <= upper
            })
        };
        self.space.show(Some([0.0; 2]));
        let first = self.end(&start);
        self.search_pointings(&[]);
        let nothing = |status, message, gap, margin| Plan {
            status,
            message,
            times: vec![],
            q: start.clone(),
            dq: vec![],
            ddq: vec![],
            tip: vec![],
            clearance: first.clearance,
            margin,
            margins: vec![],
            shares: vec![],
            tilt: None,
            view: None,
            begins: None,
            gap,
            samples: 0,
            nodes: 0,
        };
        let asked = self.space.asked;
        self.keep(asked.min(first.least()), first.apart);
        let has_room = first.clearance > 0.0 && first.apart > 0.0;
        if !has_room || !inside(&start) || !self.space.is_free(&start) {
            let (why, clearance) = self.blocked(&start, &limits, Place::Start);
            let blocked = nothing(PlanStatus::StartBlocked, why, f64::INFINITY, 0.0);
            return Ok(Plan { clearance, ..blocked });
        }
        let retreat = match self.way(Place::Retreat, &start) {
            Ok(way) => way,
            Err(Short { why, .. }) => {
                return Ok(nothing(PlanStatus::StartBlocked, why, f64::INFINITY, asked));
            }
        };
        self.space.show(self.space.course().map(|known| [known; 2]));
        let candidates = match goal {
            Aim::At(q) if !inside(q) => {
                let why = beyond(q, &limits, Place::Goal, |i| self.space.robot().joint_name(i));
                Err((f64::INFINITY, why.unwrap_or_default()))
            }
            Aim::At(q) => Ok(vec![q.to_vec()]),
            Aim::Found { find, is_turned } => {
                find(self, &limits).map_err(|gap| (gap, too_far(gap, is_turned)))
            }
        };
        let candidates = match candidates {
            Ok(candidates) => candidates,
            Err((gap, why)) => {
                return Ok(nothing(PlanStatus::GoalOutOfReach, why, gap, asked));
            }
        };
        let candidates = match self.level(candidates) {
            Ok(candidates) => candidates,
            Err(why) => return Ok(nothing(PlanStatus::GoalBlocked, why, f64::INFINITY, 0.0)),
        };
        self.search_pointings(&candidates);
        let mut goals: Vec<End> = candidates.iter().map(|q| self.end(q)).collect();
        // A candidate that touches the arm itself has no room that counts, however far it is from everything else.
        let roomiest = goals.iter().max_by(|a, b| {
            let is_apart = [a, b].map(|goal| goal.apart > 0.0);
            is_apart[0].cmp(&is_apart[1]).then(a.clearance.total_cmp(&b.clearance))
        });
        let roomiest = roomiest.expect("there is a candidate").clone();
        let margin = asked.min(first.least()).min(roomiest.least());
        goals.retain(|goal| {
            self.keep(margin, goal.apart.min(first.apart));
            roomiest.clearance > 0.0 && goal.apart > 0.0 && self.space.is_free(&goal.q)
        });
        if goals.is_empty() {
            let (why, clearance) = self.blocked(&roomiest.q, &limits, Place::Goal);
            let blocked = nothing(PlanStatus::GoalBlocked, why, f64::INFINITY, 0.0);
            return Ok(Plan { clearance, ..blocked });
        }
        self.space.show(None);
        let mut shortest: Option<Short> = None;
        let mut approaches: Vec<Way> = vec![];
        goals.retain(|goal| match self.way(Place::Approach, &goal.q) {
            Ok(way) => {
                approaches.push(way);
                true
            }
            Err(short) => {
                if shortest.as_ref().is_none_or(|least| short.left < least.left) {
                    shortest = Some(short);
                }
                false
            }
        });
        if let (Some(Short { left, why }), true) = (shortest, goals.is_empty()) {
            return Ok(nothing(PlanStatus::GoalOutOfReach, why, left, asked));
        }
        let ranges: Vec<[f64; 2]> = (0..start.len())
            .map(|i| match ranges_of(&limits, i) {
                [lower, upper] if (upper - lower).is_finite() => {
                    [lower.max(-FARTHEST), upper.min(FARTHEST)]
                }
                [lower, upper] => {
                    [lower.max(start[i] - 1.25 * PI), upper.min(start[i] + 1.25 * PI)]
                }
            })
            .collect();
        let ends: Vec<Vec<f64>> = goals.iter().map(|goal| goal.q.clone()).collect();
        let ladder = Margins::ladder(asked, self.space.most_share, &first, &goals);
        let last = ladder.len() - 1;
        let (mut left, mut all) = (self.settings.samples, 0);
        let mut failed = None;
        for k in 0..=last + AGAIN {
            if k > last && left == 0 {
                break;
            }
            let margins = &ladder[k.min(last)];
            self.space.margins.clone_from(margins);
            self.search_pointings(&ends);
            let margin = margins.far.iter().copied().fold(f64::INFINITY, f64::min);
            let open: Vec<&Way> = approaches.iter().filter(|way| self.is_free_along(way)).collect();
            let blocked = match (self.is_free_along(&retreat), open.is_empty()) {
                (false, _) => Some((PlanStatus::StartBlocked, Place::Retreat, &retreat)),
                (true, true) => Some((PlanStatus::GoalBlocked, Place::Approach, &approaches[0])),
                (true, false) => None,
            };
            if let Some((status, place, way)) = blocked {
                if k >= last {
                    let (why, clearance) = self.crossed(place, way);
                    failed =
                        Some(Plan { clearance, ..nothing(status, why, f64::INFINITY, margin) });
                    break;
                }
                continue;
            }
            let begin = retreat.last().expect("it has an end");
            let roots: Vec<Vec<f64>> = open.iter().map(|way| way[0].clone()).collect();
            let is_trial = k < last;
            let [samples, patience] = if is_trial {
                [self.settings.samples / TRIAL, PATIENCE]
            } else {
                [left, usize::MAX]
            };
            let (found, drawn) = self.search(begin, &roots, &ranges, [samples, patience]);
            let first = found.iter().find(|found| found.gap == 0.0);
            all += drawn;
            left = left.saturating_sub(drawn);
            let Some(first) = first else {
                if k > last {
                    break;
                }
                let found = &found[0];
                let why = format!(
                    "the search came to {:.3} rad from the goal after {all} samples; more samples, another seed{} or a smaller margin \
                     may help",
                    found.gap,
                    self.space.pointings.iter().map(Pointing::more).collect::<String>(),
                );
                failed = Some(Plan {
                    q: found.path.concat(),
                    samples: all,
                    nodes: found.nodes,
                    ..nothing(PlanStatus::NotFound, why, found.gap, margin)
                });
                continue;
            };
            self.space.margins.shares = ROUNDED;
            self.space.pointings.iter_mut().for_each(Pointing::round);
            let (mut status, mut why) = (PlanStatus::NotFound, String::new());
            for found in &found {
                let approach = open.iter().find(|way| found.path.last() == way.first());
                let approach = approach.expect("it leads to one of these");
                match self.timed_in_turn([&retreat, &found.path, approach], &limits)? {
                    Ok((motion, off)) => {
                        let Some((motion, timing)) = self.let_pass(motion) else { continue };
                        let plan = self.finished(motion, timing, [all, found.nodes], margins, off);
                        // What keeps next to nothing may touch within the resolution of its certificate.
                        if plan.clearance > 0.0 {
                            return Ok(plan);
                        }
                        (status, why) = touching(plan.clearance);
                    }
                    Err(error) => (status, why) = error,
                }
            }
            failed = Some(Plan {
                q: first.path.concat(),
                samples: all,
                nodes: first.nodes,
                ..nothing(status, why, 0.0, margin)
            });
            // The straight way would be found again.
            if !is_trial && drawn == 0 {
                break;
            }
        }
        Ok(failed.expect("there is a margin to try"))
    }

    /// What can be kept at `q`.
    fn end(&mut self, q: &[f64]) -> End {
        let apart = self.space.own_room(q, APART / SHARE);
        let (room, clearance) = self.space.room(q);
        End::new(q, &room, clearance, apart)
    }

    /// Keeps the same margin everywhere, and bodies of the arm that far `apart` at most \[m\].
    fn keep(&mut self, margin: f64, apart: f64) {
        let apart = APART.min(apart).max(0.0);
        self.space.margins = Margins::constant(vec![margin; self.start.len()], apart);
    }

    /// Several paths from `start` to `goals`, shortened, the shortest first; or, if the first search finds none, how far it came. And how
    /// many configurations were drawn.
    fn search(
        &mut self,
        start: &[f64],
        goals: &[Vec<f64>],
        ranges: &[[f64; 2]],
        [mut samples, patience]: [usize; 2],
    ) -> (Vec<tree::Found>, usize) {
        let Self { space, noise, settings, .. } = self;
        let (mut all, mut drawn): (Vec<tree::Found>, _) = (vec![], 0);
        for _ in 0..settings.paths {
            let mut found = tree::search(space, start, goals, ranges, [samples, patience], noise);
            drawn += found.samples;
            if found.gap > 0.0 {
                if all.is_empty() {
                    return (vec![found], drawn);
                }
                continue;
            }
            let is_direct = found.samples == 0;
            samples = samples.min(4 * found.samples + 100);
            tree::shorten(space, &mut found.path, SHORTCUTS, noise);
            all.push(found);
            if is_direct {
                break;
            }
        }
        tree::sort_by_length(&mut all);
        (all, drawn)
    }

    /// What blocks the arm at `q`, which is not free, and its distance \[m\].
    fn blocked(&mut self, q: &[f64], limits: &Limits, place: Place) -> (String, f64) {
        if let Some(why) = beyond(q, limits, place, |i| self.space.robot().joint_name(i)) {
            return (why, self.space.clearance(q));
        }
        match self.space.obstruction(q) {
            Some(found) => (found.sentence(place, self.settings.horizon), found.distance()),
            None => (format!("a distance is undefined {}", place.there()), f64::NAN),
        }
    }

    /// How far each link is at least from what it keeps the usual margin of between two instants of `spline`, but for how far that is off its
    /// chords, and from what has margins of their own \[m\]: from what is measured in the middle of each part in which no joint goes
    /// farther than [`PART`]. `work` has three configurations.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "up to 2")]
    fn room_along(
        &mut self,
        spline: &JointSpline,
        [from, to]: [f64; 2],
        work: &mut [[Vec<f64>; 3]; 3],
    ) -> (Vec<f64>, Vec<Room>) {
        let n = self.start.len();
        let [begin, middle, end] = work;
        spline.at(from, begin.each_mut().map(Vec::as_mut_slice));
        spline.at(to, end.each_mut().map(Vec::as_mut_slice));
        let goes = begin[0].iter().zip(&end[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let parts = (goes / PART).ceil().clamp(1.0, MOST_PARTS) as u32;
        let step = (to - from) / f64::from(parts);
        let (mut room, mut own) = (vec![MOST_KEPT; n], vec![]);
        for k in 0..parts {
            let t = from + step * f64::from(k);
            spline.at(t + 0.5 * step, middle.each_mut().map(Vec::as_mut_slice));
            spline.at(t + step, end.each_mut().map(Vec::as_mut_slice));
            let ends = [&begin[0], &end[0]];
            let way = |link: usize| ends.map(|end| self.space.way([&middle[0], end], link));
            let ways: Vec<f64> = (0..n).map(way).map(|[a, b]| a.max(b)).collect();
            let each = self.space.usual_room_at_least(&middle[0], MOST_KEPT, |link, margin, d| {
                own.push((link, margin, d - ways[link]));
            });
            for (room, (each, way)) in room.iter_mut().zip(each.iter().zip(&ways)) {
                *room = room.min(each - way);
            }
            std::mem::swap(begin, end);
        }
        (room, own)
    }

    /// What each link is certain to keep between each knot and the next, the smaller of what is said at both \[m\], one row
    /// for each knot, and which share of margins of their own; none where `spline` is not free. Whether it has to be so `in_time`, where
    /// what moves counts in time.
    pub(super) fn kept_along(
        &mut self,
        spline: &JointSpline,
        in_time: bool,
    ) -> Option<[Vec<Vec<f64>>; 2]> {
        let n = self.start.len();
        let rest = vec![0.0; n];
        let mut states = [[0; 3].map(|_| vec![0.0; n]), [0; 3].map(|_| vec![0.0; n])];
        let mut middle = [0; 3].map(|_| vec![0.0; n]);
        let mut work = [0; 3].map(|_| [0; 3].map(|_| vec![0.0; n]));
        let margins = self.space.margins.clone();
        let mut pieces: [Vec<Vec<f64>>; 2] = [vec![], vec![]];
        let times = spline.times().to_vec();
        spline.at(times[0], states[1].each_mut().map(Vec::as_mut_slice));
        for pair in times.windows(2) {
            states.swap(0, 1);
            let h = pair[1] - pair[0];
            spline.at(pair[1], states[1].each_mut().map(Vec::as_mut_slice));
            spline.at(pair[0] + 0.5 * h, middle.each_mut().map(Vec::as_mut_slice));
            let [[a, _, first], [b, _, second]] = &states;
            self.space.show(in_time.then_some([pair[0], pair[1]]));
            // A cubic is no farther than this from its chord, here one of half of the time; a rest is one.
            let half = if a == b { 0.0 } else { 0.5 * h };
            let bulge: Vec<f64> =
                (0..n).map(|i| first[i].abs().max(second[i].abs()) * half.powi(2) / 8.0).collect();
            let (turns, carried) = (bulge.iter().sum(), self.space.way_of_tip([&rest, &bulge]));
            let bulges: Vec<f64> =
                (0..n).map(|link| self.space.way([&rest, &bulge], link)).collect();
            let kept: Vec<f64> = (0..n)
                .map(|link| [a, b].map(|q| self.space.margin(q, link)))
                .map(|[a, b]| a.min(b))
                .collect();
            self.space.margins = margins.evened(kept.clone(), bulges.clone());
            self.space.pointings.iter_mut().for_each(|it| it.and_beyond(turns, carried));
            let is_free = self.space.is_free_between(a, &middle[0])
                && self.space.is_free_between(&middle[0], b);
            self.space.pointings.iter_mut().for_each(|it| it.and_beyond(0.0, 0.0));
            self.space.margins.clone_from(&margins);
            if !is_free {
                return None;
            }
            // What is measured on the way says more, where there is more room than was asked for.
            let (room, own) = self.room_along(spline, [pair[0], pair[1]], &mut work);
            let space = &self.space;
            let certain = |link: usize, kept: f64, measured: f64| {
                (space.certain(kept + bulges[link]).max(measured) - bulges[link]).max(0.0)
            };
            let usual = (0..n).map(|link| certain(link, kept[link], room[link]));
            pieces[0].push(usual.collect());
            let mut shares = vec![1.0_f64; n];
            for (link, margin, distance) in own {
                let kept = margin.share(space.asked) * kept[link];
                let share = certain(link, kept, distance) / margin.or(f64::INFINITY);
                shares[link] = shares[link].min(share);
            }
            pieces[1].push(shares);
        }
        Some(pieces.map(|pieces| {
            let last = pieces.len();
            let at = |k: usize| {
                let (before, after) = (&pieces[k.saturating_sub(1)], &pieces[k.min(last - 1)]);
                before.iter().zip(after).map(|(a, b)| a.min(*b)).collect()
            };
            (0..=last).map(at).collect()
        }))
    }
}
