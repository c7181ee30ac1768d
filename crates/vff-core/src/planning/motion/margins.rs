//! What each link keeps from everything, depending on where the arm is: less near the ends of a motion, as much as those
//! need (T150).

use super::levers::Levers;

/// What a margin grows by per length that the joints may have carried a link away from where it has less: to begin with,
/// and where that leads nowhere.
const SLOPES: [f64; 2] = [0.2, 0.05];

/// What is kept of the room at an end.
pub const SHARE: f64 = 0.9;

/// An end of a motion: the configuration, and what each link keeps there \[m\].
#[derive(Debug, Clone, PartialEq)]
pub struct End {
    q: Vec<f64>,
    kept: Vec<f64>,
}

impl End {
    /// Of a configuration and the distance of each link from everything \[m\].
    pub fn new(q: &[f64], room: &[f64]) -> Self {
        Self { q: q.to_vec(), kept: room.iter().map(|room| SHARE * room).collect() }
    }
}

/// What each link keeps from everything.
#[derive(Debug, Clone, PartialEq)]
pub struct Margins {
    /// Far from all ends \[m\].
    pub far: Vec<f64>,
    ends: Vec<End>,
    slope: f64,
    /// Of all that, so much.
    pub share: f64,
}

impl Margins {
    /// The same everywhere.
    pub fn constant(far: Vec<f64>) -> Self {
        Self { far, ends: vec![], slope: 0.0, share: 1.0 }
    }

    /// For motions from `start` to one of `goals`, from which a path may be hard to find: the first are to be tried first.
    /// As asked for wherever the arm is away from ends that have less, first close to these; then, links that have less at the start and
    /// at every goal keep no more than there all the way, as a shoulder above its table does; then all keep no more.
    pub fn ladder(asked: f64, start: &End, goals: &[End]) -> Vec<Self> {
        let links = 0..start.kept.len();
        let at_goals = |link: usize| goals.iter().map(|end| end.kept[link]).fold(0.0, f64::max);
        let least: Vec<f64> =
            links.clone().map(|i| asked.min(start.kept[i]).min(at_goals(i))).collect();
        let always = |i: usize| start.kept[i] < asked && at_goals(i) < asked;
        let shoulders = links.map(|i| if always(i) { least[i] } else { asked }).collect();
        let ends = || -> Vec<End> {
            let all = std::iter::once(start).chain(goals);
            all.filter(|end| end.kept.iter().any(|kept| *kept < asked)).cloned().collect()
        };
        let mut steps: Vec<Self> = vec![];
        let (all, [steep, slow]) = (vec![asked; least.len()], SLOPES);
        if ends().is_empty() {
            return vec![Self::constant(all)];
        }
        for (far, slope) in [(all.clone(), steep), (all, slow), (shoulders, slow), (least, slow)] {
            let step = Self { far, ends: ends(), slope, share: 1.0 };
            if steps.last() != Some(&step) {
                steps.push(step);
            }
        }
        steps
    }

    /// What `link` keeps at `q` \[m\].
    pub fn at(&self, q: &[f64], reach: &Levers, link: usize) -> f64 {
        let near = |end: &End| end.kept[link] + self.slope * reach.way([&end.q, q], None, link);
        self.share * self.ends.iter().map(near).fold(self.far[link], f64::min)
    }

    /// By how much that changes at most where `link` goes so far \[m\].
    pub fn slope(&self) -> f64 {
        if self.ends.is_empty() { 0.0 } else { self.share * self.slope }
    }

    /// The least that a link keeps at the end `q` \[m\], where that is less than elsewhere.
    pub fn lowered_at(&self, q: &[f64]) -> Option<f64> {
        let end = self.ends.iter().find(|end| end.q == q)?;
        let lower = end.kept.iter().zip(&self.far).filter(|(kept, far)| kept < far);
        lower.map(|(kept, _)| *kept).min_by(f64::total_cmp)
    }
}
