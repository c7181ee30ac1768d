//! An obstacle where it is at an instant, and what it is asked there.

use super::{
    Asked, Contact, Description, LOAD, Motion, MotionState, ObstacleGeometry, Outlook, Pair,
    PairMargin, Turn, Turning,
};
use crate::geometry::{Body, PlacedHull};
use crate::math::Vector;

/// Who carries a body: what an obstacle may be told to ignore, or to keep at a margin of its own.
#[derive(Debug, Clone, Copy)]
pub(super) struct Carrier {
    pub(super) link: usize,
    pub(super) is_load: bool,
}

impl Carrier {
    #[inline]
    pub(super) fn of<const D: usize>(body: &Body<'_, D>) -> Self {
        Self { link: body.link, is_load: body.is_load }
    }
}

/// What is said of a carrier in a list of all links, or of the load, which is the last of them.
#[inline(never)] // few are asked
fn said_of<T: Copy + Default>(all: &[T], Carrier { link, is_load }: Carrier) -> T {
    let Some((load, links)) = all.split_last() else { return T::default() };
    if is_load { *load } else { links.get(link).copied().unwrap_or_default() }
}

/// What goes no faster rests, if it does not turn \[m/s\].
const SLOW: f64 = 0.01;

/// An obstacle with what is computed once (`geometry`) and when it is needed (`state`).
#[derive(Debug, Clone)]
pub(super) struct Placed<S: ObstacleGeometry<D>, const D: usize> {
    pub(super) description: S::Obstacle,
    pub(super) geometry: S,
    pub(super) state: MotionState<D>,
    /// The instant that the state belongs to \[s\]; any, if the obstacle is static.
    pub(super) time: f64,
    /// Since when parts of the geometry go on by themselves \[s\].
    pub(super) since: f64,
    /// Whether it neither moves nor turns, nor any part of it.
    pub(super) is_static: bool,
    /// Where later instants are those of its motion: a speed that no point of it exceeds \[m/s\].
    foreseen: Option<f64>,
    /// How it turns, if it does.
    pub(super) turned: Option<Box<Turned<D>>>,
    /// The most contacts and barriers that it will have, where that is more than it has.
    pub(super) room: usize,
    /// Whether nobody finds it.
    pub(super) is_hidden: bool,
    /// Of a possible future, which look-ahead alone finds, how likely it is that this one or one that is no likelier comes true.
    pub(super) likelihood_up_to: Option<f64>,
    /// Which links are not measured against it, and last what the arm carries; empty if none is.
    pub(super) ignored: Vec<bool>,
    /// What these keep from it; empty if all keep what is usual.
    pub(super) margins: Vec<PairMargin>,
}

/// How an obstacle turns, and how it is turned at the instant of its state.
#[derive(Debug, Clone)]
pub(super) struct Turned<const D: usize> {
    pub(super) turning: Turning<D>,
    pub(super) now: Turn<D>,
}

impl<S: ObstacleGeometry<D>, const D: usize> Placed<S, D> {
    pub(super) fn new(description: S::Obstacle) -> Self {
        let turned =
            description.turning().map(|turning| Box::new(Turned { now: turning.at(0.0), turning }));
        let mut this = Self {
            geometry: S::new(&description),
            state: description.motion().at(0.0, description.position()),
            time: 0.0,
            since: 0.0,
            is_static: false,
            foreseen: None,
            turned,
            room: 0,
            is_hidden: description.likelihood().is_some(),
            likelihood_up_to: description.likelihood(),
            ignored: vec![],
            margins: vec![],
            description,
        };
        this.is_static = this.stands_still();
        this.foresee();
        this
    }

    /// Whether it is a possible future, which is hidden from all but look-ahead.
    pub(super) fn is_future(&self) -> bool {
        self.likelihood_up_to.is_some()
    }

    /// Whether what `carrier` carries is not measured against it.
    #[inline]
    pub(super) fn is_ignored_by(&self, carrier: Carrier) -> bool {
        !self.ignored.is_empty() && said_of(&self.ignored, carrier)
    }

    /// What `carrier` keeps from it.
    #[inline]
    pub(super) fn margin_of(&self, carrier: Carrier) -> PairMargin {
        if self.margins.is_empty() { PairMargin::USUAL } else { said_of(&self.margins, carrier) }
    }

    /// A body of the robot, by its number, and this obstacle, by its own.
    #[inline]
    pub(super) fn pair(&self, body: usize, carrier: Carrier, obstacle: usize) -> Pair {
        Pair { body, link: carrier.link, obstacle, margin: self.margin_of(carrier) }
    }

    /// Takes in what the links of the arm are called.
    pub(super) fn know_links(&mut self, links: &[String]) {
        let Self { description, ignored, margins, .. } = self;
        ignored.clear();
        margins.clear();
        let all = || links.iter().map(String::as_str).chain([LOAD]);
        if !description.ignored().is_empty() {
            ignored.extend(all().map(|link| description.ignored().iter().any(|it| it == link)));
        }
        if description.margin().is_some() || !description.margins().is_empty() {
            margins.extend(all().map(|link| description.margin_of(link)));
        }
    }

    /// Whether it neither moves nor turns, nor any part of it.
    pub(super) fn stands_still(&self) -> bool {
        self.description.motion().is_static()
            && self.turned.is_none()
            && self.geometry.speed() == 0.0
    }

    /// Whether it rests at time `t` \[s\], whatever it does before and after: what is slower than [`SLOW`] does.
    pub(super) fn rests_at(&self, t: f64) -> bool {
        self.is_static
            || self.geometry.speed() == 0.0
                && self.state_at(t).velocity.norm() <= SLOW
                && self.turn_at(t).is_none_or(|turn| turn.spin.is_none())
    }

    /// Whether the state is that at time `t` \[s\]. Compared as bits: only the very same instant is.
    #[inline]
    pub(super) fn is_at(&self, t: f64) -> bool {
        self.time.to_bits() == t.to_bits() || self.is_static
    }

    /// The state at time `t` \[s\].
    #[inline]
    pub(super) fn state_at(&self, t: f64) -> MotionState<D> {
        if self.is_at(t) { self.state } else { self.moved_to(t) }
    }

    /// Lets it move otherwise.
    pub(super) fn set_motion(&mut self, motion: Motion<D>) {
        self.description.set_motion(motion);
        self.foresee();
    }

    /// Takes in whether its motion is foreseen, and how fast that is at most.
    fn foresee(&mut self) {
        let is_foreseen = self.description.motion().is_foreseen() || self.is_future();
        self.foreseen = is_foreseen.then(|| self.any_speed());
    }

    /// A speed that no point of it exceeds \[m/s\], where the state after a while is that of its motion, not one that goes on as it is, or
    /// its points move by themselves.
    #[inline]
    pub(super) fn speed_bound(&self) -> Option<f64> {
        let of_points = self.geometry.speed();
        self.foreseen.or_else(|| match &self.turned {
            _ if of_points <= 0.0 => None,
            Some(_) => Some(f64::INFINITY),
            None => Some(self.state.velocity.norm() + of_points),
        })
    }

    /// Forgets how fast it is at most: it turns otherwise from now on, or parts of it move otherwise.
    pub(super) fn may_be_faster(&mut self) {
        self.foreseen = self.foreseen.map(|_| f64::INFINITY);
    }

    /// A speed that no point of its surface ever exceeds \[m/s\].
    fn any_speed(&self) -> f64 {
        let turns_without_end = self.turned.is_some() && !self.geometry.reach().is_finite();
        if turns_without_end || self.geometry.speed() > 0.0 {
            return f64::INFINITY;
        }
        self.top_speed([f64::NEG_INFINITY, f64::INFINITY], None)
    }

    /// The state at time `t` \[s\], carried on for `after` \[s\]: at its velocity, or as it is foreseen. Without a copy between,
    /// which processors wait for.
    #[inline(always)]
    pub(super) fn state_after(&self, t: f64, after: f64) -> MotionState<D> {
        if self.foreseen.is_some() {
            return self.moved_to(t + after);
        }
        if self.is_at(t) { self.state.after(after) } else { self.moved_to(t).after(after) }
    }

    /// Keeps the state at time `t` \[s\].
    #[inline]
    pub(super) fn move_to(&mut self, t: f64) {
        if !self.is_at(t) {
            (self.state, self.time) = (self.moved_to(t), t);
            if let Some(turned) = &mut self.turned {
                turned.now = turned.turning.at(t);
            }
        }
    }

    /// How it is turned at time `t` \[s\]; none if it does not turn.
    #[inline]
    pub(super) fn turn_at(&self, t: f64) -> Option<Turn<D>> {
        let turned = self.turned.as_ref()?;
        Some(if self.is_at(t) { turned.now } else { turned.turning.at(t) })
    }

    /// How it is turned at time `t` \[s\], carried on for `after` \[s\] likewise.
    #[inline]
    pub(super) fn turn_after(&self, t: f64, after: f64) -> Option<Turn<D>> {
        if self.foreseen.is_some() {
            return self.turned.as_ref().map(|turned| turned.turning.at(t + after));
        }
        self.turn_at(t).map(|turn| turn.after(after))
    }

    /// How it is turned at the instant of its state.
    #[inline]
    pub(super) fn turn(&self) -> Option<&Turn<D>> {
        self.turned.as_ref().map(|turned| &turned.now)
    }

    #[inline(never)]
    pub(super) fn moved_to(&self, t: f64) -> MotionState<D> {
        let state = self.description.motion().at(t, self.description.position());
        MotionState { elapsed: t - self.since, ..state }
    }

    /// The distance between the surfaces of obstacle and link \[m\], bit for bit that of their contact.
    #[inline(always)]
    pub(super) fn distance(&self, link: &S::Probe) -> f64 {
        self.distance_below(link, f64::INFINITY)
    }

    /// The same where it is less than `limit` \[m\]; otherwise anything that is not.
    #[inline(always)]
    pub(super) fn distance_below(&self, link: &S::Probe, limit: f64) -> f64 {
        match self.turn() {
            None => self.geometry.distance_below(link, &self.state, limit),
            Some(turn) => {
                let seen = Self::seen(link, &self.state.position, turn);
                self.geometry.distance_below(&seen, &self.state.own_frame(), limit)
            }
        }
    }

    /// A body as the obstacle sees it that is at this position and turned so.
    #[inline]
    pub(super) fn seen(link: &S::Probe, position: &Vector<D>, turn: &Turn<D>) -> S::Probe {
        S::probe(&turn.see(&S::body(link), position))
    }

    /// Their contact, were the obstacle in this state and turned so.
    #[inline]
    pub(super) fn contact(
        &self,
        pair: Pair,
        link: &S::Probe,
        state: &MotionState<D>,
        turn: Option<&Turn<D>>,
    ) -> Contact<D> {
        let Some(turn) = turn else { return self.geometry.contact(pair, link, state) };
        let seen = Self::seen(link, &state.position, turn);
        let found = self.geometry.contact(pair, &seen, &state.own_frame());
        turn.place(&found, state)
    }

    /// How far a body is at least; see [`ObstacleGeometry::at_least`], but that `plane` has the axes of the world.
    pub(super) fn at_least(
        &self,
        hull: Option<&PlacedHull<'_, D>>,
        around: &S::Probe,
        limit: f64,
        plane: &mut Vector<D>,
    ) -> f64 {
        let state = &self.state;
        let Some(turn) = self.turn() else {
            return self.geometry.at_least(hull, around, state, limit, plane);
        };
        let (around, rest) = (Self::seen(around, &state.position, turn), state.own_frame());
        let rotation = hull.map(|hull| turn.rotation.tr_mul(hull.rotation));
        let hull = hull.zip(rotation.as_ref()).map(|(hull, rotation)| {
            let position = turn.rotation.tr_mul(&(hull.position - state.position));
            PlacedHull { hull: hull.hull, rotation, position }
        });
        *plane = turn.rotation.tr_mul(plane);
        let distance = self.geometry.at_least(hull.as_ref(), &around, &rest, limit, plane);
        *plane = turn.rotation * *plane;
        distance
    }

    /// Calls `visit` with what is `asked` of a hull, which the capsule `around` holds, were the obstacle in this state and
    /// turned so.
    #[expect(
        clippy::too_many_arguments,
        reason = "two things, how they are placed, and a question"
    )]
    #[inline(never)]
    pub(super) fn meet_hull(
        &self,
        pair: Pair,
        hull: &PlacedHull<'_, D>,
        around: &S::Probe,
        state: &MotionState<D>,
        turn: Option<&Turn<D>>,
        asked: Asked,
        visit: &mut dyn FnMut(&Contact<D>),
    ) {
        let Some(turn) = turn else {
            return self.geometry.meet_hull(pair, hull, around, state, asked, visit);
        };
        let rotation = turn.rotation.tr_mul(hull.rotation);
        let position = turn.rotation.tr_mul(&(hull.position - state.position));
        let hull = PlacedHull { hull: hull.hull, rotation: &rotation, position };
        let (around, rest) = (Self::seen(around, &state.position, turn), state.own_frame());
        let visit = &mut |found: &Contact<D>| visit(&turn.place(found, state));
        self.geometry.meet_hull(pair, &hull, &around, &rest, asked, visit);
    }

    /// The contact with a hull that is nearest, the same way.
    pub(super) fn hull_contact(
        &self,
        pair: Pair,
        hull: &PlacedHull<'_, D>,
        around: &S::Probe,
        state: &MotionState<D>,
        turn: Option<&Turn<D>>,
    ) -> Contact<D> {
        let mut nearest = None;
        let visit = &mut |found: &Contact<D>| nearest = Some(*found);
        self.meet_hull(pair, hull, around, state, turn, Asked::Nearest, visit);
        // Every geometry has one.
        nearest.unwrap_or_else(|| self.contact(pair, around, state, turn))
    }

    /// All of their contacts nearer than `reach` \[m\], were the obstacle in this state and turned so.
    #[inline(always)] // with and without turning apart
    pub(super) fn for_each_contact(
        &self,
        pair: Pair,
        link: &S::Probe,
        state: &MotionState<D>,
        turn: Option<&Turn<D>>,
        reach: f64,
        mut visit: impl FnMut(&Contact<D>),
    ) {
        let Some(turn) = turn else {
            return self.geometry.for_each_contact(pair, link, state, reach, visit);
        };
        let seen = Self::seen(link, &state.position, turn);
        let rest = state.own_frame();
        let visit = |found: &Contact<D>| visit(&turn.place(found, state));
        self.geometry.for_each_contact(pair, &seen, &rest, reach, visit);
    }

    /// All distances that must be kept so that every contact nearer than `reach` \[m\] is, at the instant of the state.
    #[inline(always)]
    pub(super) fn for_each_barrier(
        &self,
        pair: Pair,
        link: &S::Probe,
        turn: Option<&Turn<D>>,
        reach: f64,
        mut visit: impl FnMut(&Contact<D>),
    ) {
        let Self { geometry, state, .. } = self;
        let Some(turn) = turn else {
            return geometry.for_each_contact(pair, link, state, reach, |contact| {
                geometry.for_each_barrier(contact, link, state, &mut visit);
            });
        };
        let (seen, rest) = (Self::seen(link, &state.position, turn), state.own_frame());
        let mut visit = |row: &Contact<D>| visit(&turn.place(row, state));
        geometry.for_each_contact(pair, &seen, &rest, reach, |contact| {
            geometry.for_each_barrier(contact, &seen, &rest, &mut visit);
        });
    }

    /// Those of many contacts nearer than `reach` \[m\] that a program of this `outlook` needs, were the obstacle in this state
    /// and turned so (T157).
    #[expect(
        clippy::too_many_arguments,
        reason = "two things, how they are placed, and a question"
    )]
    #[inline(never)]
    pub(super) fn for_each_needed(
        &self,
        pair: Pair,
        link: &S::Probe,
        state: &MotionState<D>,
        turn: Option<&Turn<D>>,
        reach: f64,
        outlook: &Outlook<'_, D>,
        mut visit: impl FnMut(&Contact<D>),
    ) {
        let turning = turn.map_or(0.0, |turn| turn.spin.magnitude() * self.geometry.reach());
        let speed = state.velocity.norm() + self.geometry.speed() + turning;
        let ahead = outlook.ahead(&pair, &S::body(link), (state, turn), speed);
        let Some(turn) = turn else {
            return self.geometry.for_each_needed(pair, link, state, reach, &ahead, visit);
        };
        let seen = Self::seen(link, &state.position, turn);
        let rest = state.own_frame();
        let visit = |found: &Contact<D>| visit(&turn.place(found, state));
        self.geometry.for_each_needed(pair, &seen, &rest, reach, &ahead, visit);
    }

    /// Opposite corners of a box that holds it from `t0` to `t1` \[s\] however it is turned, relative to its position \[m\].
    pub(super) fn extent(&self, [t0, t1]: [f64; 2]) -> [Vector<D>; 2] {
        let speed = self.geometry.speed();
        let longest = (t0 - self.since).abs().max((t1 - self.since).abs());
        let gone = if speed > 0.0 { speed * longest } else { 0.0 };
        if self.turned.is_some() {
            let reach = Vector::repeat(self.geometry.reach() + gone);
            [-reach, reach]
        } else {
            let [low, high] = self.geometry.extent();
            if gone > 0.0 { [low.add_scalar(-gone), high.add_scalar(gone)] } else { [low, high] }
        }
    }

    /// A speed that no point of its surface exceeds between two times \[s\], by the later of which it has moved by itself for that long
    /// \[m/s\]. Of a surface without end, where that comes to a ball, of this centre and radius \[m\], or its position alone.
    pub(super) fn top_speed(
        &self,
        [start, until]: [f64; 2],
        ball: Option<(Vector<D>, f64)>,
    ) -> f64 {
        let own = self.geometry.speed();
        let speed = self.description.motion().top_speed_within([start, until]) + own;
        let Some(turned) = &self.turned else { return speed };
        let grown = if own > 0.0 { own * (until - self.since).max(0.0) } else { 0.0 };
        let reach = self.geometry.reach() + grown;
        let reach = match ball {
            _ if reach.is_finite() => reach,
            None => return speed,
            Some((center, radius)) => {
                let description = &self.description;
                let way = description.motion().extent(0.0, until, description.position());
                let [low, high] = way.map(|corner| (corner - center).abs());
                radius + low.sup(&high).norm()
            }
        };
        speed + turned.turning.top_rate_within([start, until]) * reach
    }
}
