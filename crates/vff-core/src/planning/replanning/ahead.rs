//! What lies ahead on a plan: how much room its rest has among what is known by now.

use crate::interrupt;
use crate::robot::Robot;
use crate::simulation::{Moment, ReplanSettings, System};
use crate::trajectory::Pace;
use crate::world::{CollisionQuery, PairMargin, World};

/// Time between two places of a plan that are looked at \[s\].
const STEP: f64 = 0.04;
/// What is left of what a plan says that it keeps, and a little less.
const CERTAIN: f64 = 0.9;

/// The rest of a plan, looked through again and again, a little in every period.
#[derive(Debug, Clone)]
pub struct Ahead<S: System<D, M>, const D: usize, const M: usize> {
    pub robot: S::State,
    /// What stands still and what moves, as they were known when this look through the plan began.
    worlds: [World<S::Geometry, D>; 2],
    /// From now on \[s\]; none before the first look.
    next: Option<f64>,
    /// When the last look was \[s\].
    last: f64,
    q: [Vec<f64>; 3],
    /// What each link is to keep there \[m\], and of margins of their own.
    margins: Vec<[f64; 3]>,
}

impl<S: System<D, M>, const D: usize, const M: usize> Ahead<S, D, M> {
    pub fn new(robot: S::State, world: &World<S::Geometry, D>) -> Self {
        let n = robot.dof();
        let q = [0; 3].map(|_| vec![0.0; n]);
        let margins = vec![[0.0; 3]; 2 * n];
        Self { robot, worlds: world.parted(), next: None, last: 0.0, q, margins }
    }

    /// Begins with another plan.
    pub fn begin_anew(&mut self) {
        self.next = None;
    }

    /// How far the arm at `q` will be from everything at `t` \[s\], a margin of a pair's own in the share that it is of what is kept
    /// `usually` \[m\].
    pub fn least(&mut self, q: &[f64], t: f64, usually: f64) -> f64 {
        self.room(q, t, |_, margin, d| d / margin.share(usually))
    }

    /// The least that `room` makes of a link, the margin and the distance \[m\] of every pair where the arm is at `q` and things at `t`
    /// \[s\].
    fn room(&mut self, q: &[f64], t: f64, room: impl Fn(usize, PairMargin, f64) -> f64) -> f64 {
        let Self { robot, worlds, .. } = self;
        robot.update_positions(q);
        let mut least = f64::INFINITY;
        for world in worlds.iter_mut().filter(|world| !world.is_empty()) {
            world.update(t);
            if world.most_margin() > 0.0 {
                world.for_each_pair(robot.bodies(), |pair| {
                    least = least.min(room(pair.link, pair.margin, pair.distance));
                });
            } else {
                let nearest =
                    |link: usize, d: f64| least = least.min(room(link, PairMargin::USUAL, d));
                world.for_each_contact(robot.bodies(), f64::NEG_INFINITY, nearest, |_| {});
            }
        }
        least
    }

    /// The least distance at the next places of the plan beyond what it says that it keeps, or where it says nothing, `kept`
    /// \[m\]. Beyond the horizon, what moves is not known.
    pub fn look(
        &mut self,
        moment: &Moment<'_, S, D, M>,
        settings: &ReplanSettings,
        kept: f64,
    ) -> f64 {
        let since = moment.t - self.last;
        self.last = moment.t;
        let Some(joints) = moment.reference.joints() else { return f64::INFINITY };
        let rest = joints.span()[1] - moment.pace.time;
        if rest <= 0.0 {
            return f64::INFINITY;
        }
        // As much of it as of the time between two looks through all of it has passed; at least one place, at most all.
        let mut left = (rest * since / settings.every).min(rest).max(STEP);
        let mut least = f64::INFINITY;
        while left > 0.0 {
            let ahead = self.next.filter(|ahead| *ahead <= rest).unwrap_or_else(|| {
                self.worlds = moment.world.parted();
                0.0
            });
            self.next = Some(ahead + STEP);
            left -= STEP;
            interrupt::checkpoint(64 * moment.q.len());
            let mut state = std::mem::take(&mut self.q);
            let then = moment.pace.time + ahead;
            joints.at(then, state.each_mut().map(Vec::as_mut_slice));
            if ahead > settings.horizon && !self.worlds[1].is_empty() {
                self.worlds[1] = World::new(vec![]);
            }
            let mut margins = std::mem::take(&mut self.margins);
            let n = moment.q.len();
            margins[..n].fill([kept / CERTAIN, 0.0, 0.0]);
            margins[n..].fill([1.0, 0.0, 0.0]);
            if let Some(said) = joints.margins() {
                said.known_at(&Pace::of_time(then), kept / CERTAIN, &mut margins);
            }
            // Of a margin of its own a pair keeps as much of what the plan says as others do.
            let (of_links, of_own) = margins.split_at(n);
            let share = kept / settings.margin;
            let room = self.room(&state[0], moment.since + ahead, |link, margin, d| {
                d - match margin.of_its_own() {
                    None => CERTAIN * of_links[link][0],
                    Some(own) => own * (CERTAIN * of_own[link][0]).min(share),
                }
            });
            least = least.min(room);
            (self.q, self.margins) = (state, margins);
        }
        least
    }
}
