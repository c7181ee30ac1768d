//! What each link keeps from everything, and bodies of the arm from each other, depending on where the arm is: less near the ends of
//! a motion, as much as those need (T150).

use super::levers::Levers;

/// What a margin grows by per length that the joints may have carried a link away from where it has less: to begin with,
/// and where that leads nowhere.
const SLOPES: [f64; 2] = [0.2, 0.05];

/// What is kept of the room at an end.
pub const SHARE: f64 = 0.9;

/// What bodies of the arm keep from each other \[m\].
pub const APART: f64 = 2e-3;

/// An end of a motion: the configuration, and what is kept there \[m\].
#[derive(Debug, Clone, PartialEq)]
pub struct End {
    pub q: Vec<f64>,
    /// How far the arm is from everything outside.
    pub clearance: f64,
    /// By each link: see [`Margins`].
    kept: Vec<f64>,
    /// What bodies of the arm keep from each other; 0 or less where they touch.
    pub apart: f64,
}

impl End {
    /// Of a configuration, the room of each link, the distance from everything and the least of bodies of the arm \[m\].
    pub fn new(q: &[f64], room: &[f64], clearance: f64, apart: f64) -> Self {
        let kept = room.iter().map(|room| SHARE * room).collect();
        Self { q: q.to_vec(), clearance, kept, apart: SHARE * apart }
    }

    /// What all links keep.
    pub fn least(&self) -> f64 {
        self.kept.iter().copied().fold(f64::INFINITY, f64::min)
    }
}

/// What each link keeps from everything, and bodies of the arm from each other. Pairs with a margin of their own keep the
/// [share](crate::world::PairMargin::share) of that which theirs is of what is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Margins {
    /// By each link, far from all ends \[m\].
    pub far: Vec<f64>,
    /// By bodies of the arm from each other, far from all ends \[m\].
    pub apart: f64,
    ends: Vec<End>,
    slope: f64,
    /// Of what links keep, and of what bodies of the arm do, so much.
    pub shares: [f64; 2],
    /// Whether links keep `far` at the ends as well.
    is_even: bool,
    /// What each link keeps beyond that, whatever it keeps, and bodies of the arm from each other \[m\]; nothing where the first is empty.
    beyond: Vec<f64>,
    apart_beyond: f64,
}

impl Margins {
    /// The same everywhere.
    pub fn constant(far: Vec<f64>, apart: f64) -> Self {
        let (ends, shares, beyond) = (vec![], [1.0; 2], vec![]);
        Self { far, apart, ends, slope: 0.0, shares, is_even: true, beyond, apart_beyond: 0.0 }
    }

    /// What bodies of the arm keep from each other, and each link the same everywhere: all so much more than these, for each link \[m\].
    #[must_use]
    pub fn evened(&self, far: Vec<f64>, beyond: Vec<f64>) -> Self {
        let apart_beyond = beyond.iter().copied().fold(0.0, f64::max);
        let shares = [1.0, self.shares[1]];
        Self { far, beyond, apart_beyond, shares, is_even: true, ..self.clone() }
    }

    /// What `link` keeps beyond its margin \[m\].
    pub fn beyond(&self, link: usize) -> f64 {
        self.beyond.get(link).copied().unwrap_or(0.0)
    }

    /// For motions from `start` to one of `goals`, from which a path may be hard to find: the first are to be tried first.
    /// As asked for wherever the arm is away from ends that have less, first close to these; then, links that have less at the start and
    /// at every goal keep no more than there all the way, as a shoulder above its table does; then all keep no more. Bodies of the arm
    /// do so from each other in the same way.
    /// A margin of a pair's own, which keeps up to `most_share` of these, grows no faster than the others would alone: no distance grows
    /// faster than its link goes.
    pub fn ladder(asked: f64, most_share: f64, start: &End, goals: &[End]) -> Vec<Self> {
        let links = 0..start.kept.len();
        let at_goals = |link: usize| goals.iter().map(|end| end.kept[link]).fold(0.0, f64::max);
        let least: Vec<f64> =
            links.clone().map(|i| asked.min(start.kept[i]).min(at_goals(i))).collect();
        let always = |i: usize| start.kept[i] < asked && at_goals(i) < asked;
        let own = [start.apart, goals.iter().map(|end| end.apart).fold(0.0, f64::max)];
        let least_apart = own.into_iter().fold(APART, f64::min);
        let usual = if own.iter().all(|apart| *apart < APART) { least_apart } else { APART };
        let shoulders = links.map(|i| if always(i) { least[i] } else { asked }).collect();
        let ends = || -> Vec<End> {
            let all = std::iter::once(start).chain(goals);
            let has_less =
                |end: &&End| end.apart < APART || end.kept.iter().any(|kept| *kept < asked);
            all.filter(has_less).cloned().collect()
        };
        let mut steps: Vec<Self> = vec![];
        let all = vec![asked; least.len()];
        let [steep, slow] = SLOPES.map(|slope| slope / most_share);
        if ends().is_empty() {
            return vec![Self::constant(all, APART)];
        }
        let first = [(all.clone(), APART, steep), (all, APART, slow)];
        let then = [(shoulders, usual, slow), (least, least_apart, slow)];
        for (far, apart, slope) in first.into_iter().chain(then) {
            let even = Self::constant(far, apart);
            let step = Self { ends: ends(), slope, is_even: false, ..even };
            if steps.last() != Some(&step) {
                steps.push(step);
            }
        }
        steps
    }

    /// What `link` keeps at `q` \[m\].
    pub fn at(&self, q: &[f64], reach: &Levers, link: usize) -> f64 {
        let near = |end: &End| end.kept[link] + self.slope * reach.way([&end.q, q], None, link);
        let ends = if self.is_even { &[][..] } else { &self.ends };
        self.shares[0] * ends.iter().map(near).fold(self.far[link], f64::min)
    }

    /// By how much that changes at most where `link` goes so far \[m\].
    pub fn slope(&self) -> f64 {
        if self.is_even { 0.0 } else { self.shares[0] * self.slope }
    }

    /// What a body that `link` carries keeps at `q` from one that `from` does \[m\]: what moves both alike changes nothing.
    pub fn apart_at(&self, q: &[f64], reach: &Levers, from: Option<usize>, link: usize) -> f64 {
        let near = |end: &End| end.apart + self.slope * reach.way([&end.q, q], from, link);
        let lower = self.ends.iter().filter(|end| end.apart < self.apart);
        self.shares[1] * lower.map(near).fold(self.apart, f64::min) + self.apart_beyond
    }

    /// By how much that changes at most where one goes so far as the other sees it \[m\].
    pub fn apart_slope(&self) -> f64 {
        let is_lower = self.ends.iter().any(|end| end.apart < self.apart);
        if is_lower { self.shares[1] * self.slope } else { 0.0 }
    }

    /// The least that a link keeps at the end `q` \[m\], where that is less than elsewhere.
    pub fn lowered_at(&self, q: &[f64]) -> Option<f64> {
        let end = self.ends.iter().find(|end| end.q == q)?;
        let lower = end.kept.iter().zip(&self.far).filter(|(kept, far)| kept < far);
        lower.map(|(kept, _)| *kept).min_by(f64::total_cmp)
    }

    /// What bodies of the arm keep from each other at the end `q` \[m\], where that is less than elsewhere.
    pub fn apart_lowered_at(&self, q: &[f64]) -> Option<f64> {
        let end = self.ends.iter().find(|end| end.q == q)?;
        (end.apart < self.apart).then_some(end.apart)
    }
}
