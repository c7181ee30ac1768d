//! The obstacles at later instants, as far as look-ahead asks for them.

use crate::geometry::Body;
use crate::interrupt;
use crate::math::Vector;
use crate::world::{CollisionQuery, Contact, Outlook, PairMargin};

/// A pair that is near, as far as the velocity of a roll-out depends on it.
#[derive(Debug, Clone, Copy)]
pub struct Near<const D: usize> {
    /// Index of the link.
    pub link: usize,
    /// Point of its axis nearest to the obstacle \[m\].
    pub point: Vector<D>,
    /// Unit vector from the obstacle towards the link.
    pub normal: Vector<D>,
    /// Signed distance, and what is kept of it \[m\].
    pub distance: f64,
    pub margin: PairMargin,
    /// How fast the obstacle comes along the normal \[m/s\].
    pub comes: f64,
}

impl<const D: usize> Near<D> {
    #[inline(always)]
    fn new(contact: &Contact<D>) -> Self {
        let Contact { link, point, normal, distance, margin, velocity, .. } = *contact;
        Self { link, point, normal, distance, margin, comes: normal.dot(&velocity) }
    }
}

/// How near a body and an obstacle are.
#[derive(Debug, Clone, Copy)]
pub struct Approach<const D: usize> {
    /// Signed distance, and what is kept of it \[m\].
    distance: f64,
    margin: PairMargin,
    /// Velocity of the obstacle at its nearest point \[m/s\], and whether it turns.
    velocity: Vector<D>,
    turns: bool,
    /// The speed that none of its points exceeds, where the nearest does not tell \[m/s\].
    bound: Option<f64>,
}

impl<const D: usize> Approach<D> {
    #[inline(always)]
    fn new(contact: &Contact<D>, bound: Option<f64>) -> Self {
        let Contact { distance, margin, velocity, spin, .. } = *contact;
        Self { distance, margin, velocity, turns: !spin.is_none(), bound }
    }

    /// The signed distance \[m\] as one of a pair that keeps the `usual` margin: see [`PairMargin::as_usual`].
    #[inline]
    pub fn distance(&self, usual: f64) -> f64 {
        self.margin.as_usual(self.distance, usual)
    }

    /// A speed that no point of the obstacle exceeds, now or later \[m/s\]; infinite where it turns and no more is known, as
    /// other points may come faster than the nearest does.
    pub fn speed(&self) -> f64 {
        match self.bound {
            Some(speed) => speed,
            None if self.turns => f64::INFINITY,
            None => self.velocity.norm(),
        }
    }
}

/// What look-ahead asks of the surroundings. Unlike a [`CollisionQuery`] it can be a trait object, so that
/// look-ahead is compiled once, not once for each kind of surroundings.
pub trait Prediction<const D: usize> {
    /// How many obstacles there are.
    fn count(&self) -> usize;

    /// The most contacts that one body can have with them.
    fn most_contacts(&self) -> usize;

    /// The largest margin of its own that a pair has \[m\]; 0 if none has one.
    fn largest_margin(&self) -> f64;

    /// Adds to `found` the obstacles nearer than `reach` \[m\] to a body, each once, and possible futures but for unlikely ones: that one of
    /// these comes true has a probability of `chance` at most (T204).
    fn obstacles_near(
        &mut self,
        bodies: &[Body<'_, D>],
        reach: f64,
        chance: f64,
        found: &mut Vec<usize>,
    );

    /// Whether an obstacle is a possible future, which nobody meets before it comes true.
    fn may_come(&self, obstacle: usize) -> bool;

    /// The contact of body number `index` with `obstacle`, predicted for `after` \[s\] from now at its present velocity, or as it
    /// is foreseen: the nearest of theirs. Calls `visit` with those nearer than `reach` \[m\].
    fn predict(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        visit: &mut dyn FnMut(&Contact<D>),
    ) -> Contact<D>;

    /// Calls `visit` with those of their contacts nearer than `reach` \[m\] that a program of this `outlook` needs.
    #[expect(clippy::too_many_arguments, reason = "a question, and what is wanted of the answer")]
    fn predict_needed(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        outlook: &Outlook<'_, D>,
        visit: &mut dyn FnMut(&Contact<D>),
    );

    /// The same, as far as a roll-out needs it; adds contacts nearer than `reach` to `found`.
    fn approach(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        found: &mut Vec<Near<D>>,
    ) -> Approach<D>;
}

impl<S: CollisionQuery<D>, const D: usize> Prediction<D> for S {
    fn count(&self) -> usize {
        self.obstacle_count()
    }

    fn most_contacts(&self) -> usize {
        self.contact_count()
    }

    fn largest_margin(&self) -> f64 {
        self.most_margin()
    }

    fn obstacles_near(
        &mut self,
        bodies: &[Body<'_, D>],
        reach: f64,
        chance: f64,
        found: &mut Vec<usize>,
    ) {
        self.for_each_obstacle_near(bodies.iter().copied(), reach, |obstacle| {
            interrupt::checkpoint(64 + found.len());
            if !found.contains(&obstacle) {
                found.push(obstacle);
            }
        });
        found.retain(|j| self.likelihood_up_to(*j) > chance);
    }

    fn may_come(&self, obstacle: usize) -> bool {
        self.likelihood_up_to(obstacle).is_finite()
    }

    fn predict(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        visit: &mut dyn FnMut(&Contact<D>),
    ) -> Contact<D> {
        self.for_each_contact_after(index, body, obstacle, after, reach, visit, |nearest| *nearest)
    }

    fn approach(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        found: &mut Vec<Near<D>>,
    ) -> Approach<D> {
        let visit = |contact: &Contact<D>| found.push(Near::new(contact));
        let bound = self.speed_bound(obstacle);
        let take = |contact: &Contact<D>| Approach::new(contact, bound);
        self.approach_after(index, body, obstacle, after, reach, visit, take)
    }

    fn predict_needed(
        &self,
        index: usize,
        body: &Body<'_, D>,
        obstacle: usize,
        after: f64,
        reach: f64,
        outlook: &Outlook<'_, D>,
        visit: &mut dyn FnMut(&Contact<D>),
    ) {
        self.for_each_needed_after(index, body, obstacle, after, reach, outlook, visit);
    }
}

/// Some of the obstacles, moved on for a while at their present velocities, or as they are foreseen.
pub struct Later<'a, const D: usize> {
    /// All obstacles at present.
    pub surroundings: &'a dyn Prediction<D>,
    /// Those that are meant.
    pub obstacles: &'a [usize],
    /// How much later \[s\].
    pub after: f64,
    /// What pairs without a margin of their own keep \[m\].
    pub usual: f64,
    /// The smallest distance of a pair that was found, as one of such a pair \[m\].
    pub least: f64,
}

impl<const D: usize> CollisionQuery<D> for Later<'_, D> {
    fn obstacle_count(&self) -> usize {
        self.obstacles.len()
    }

    /// Where one of all obstacles has many contacts, one of these may.
    fn contact_count(&self) -> usize {
        self.obstacles.len() + self.surroundings.most_contacts() - self.surroundings.count()
    }

    fn most_margin(&self) -> f64 {
        self.surroundings.largest_margin()
    }

    fn for_each_contact<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        mut distance: impl FnMut(usize, f64),
        mut visit: impl FnMut(&Contact<D>),
    ) {
        for (i, body) in bodies.into_iter().enumerate() {
            interrupt::checkpoint(64 * self.obstacles.len());
            let mut least = f64::INFINITY;
            for &j in self.obstacles {
                let nearest = self.surroundings.predict(i, &body, j, self.after, reach, &mut visit);
                least = least.min(nearest.distance);
                let as_usual = nearest.margin.as_usual(nearest.distance, self.usual);
                self.least = self.least.min(as_usual);
            }
            distance(body.link, least);
        }
    }

    fn for_each_needed<'a>(
        &mut self,
        bodies: impl IntoIterator<Item = Body<'a, D>>,
        reach: f64,
        outlook: &Outlook<'_, D>,
        mut visit: impl FnMut(&Contact<D>),
    ) {
        let Self { surroundings, obstacles, after, .. } = *self;
        for (i, body) in bodies.into_iter().enumerate() {
            interrupt::checkpoint(64 * obstacles.len());
            for &j in obstacles {
                surroundings.predict_needed(i, &body, j, after, reach, outlook, &mut visit);
            }
        }
    }

    fn contact_after(&self, index: usize, body: &Body<'_, D>, j: usize, after: f64) -> Contact<D> {
        let [after, unreached] = [self.after + after, f64::NEG_INFINITY];
        self.surroundings.predict(index, body, j, after, unreached, &mut |_| {})
    }
}
