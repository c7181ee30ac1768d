//! How far two bodies of an arm were apart where they were looked at last: until the joints can have carried one to the other there is
//! nothing to look at.

use super::levers::Levers;
use crate::robot::Robot;

/// Pairs are looked at anew everywhere where so many numbers would have to be remembered.
const MOST_REMEMBERED: usize = 1 << 20;

/// Two bodies of an arm, the still ones counted behind the others.
#[derive(Debug, Clone)]
pub struct OwnRoom {
    /// Their numbers.
    pub pair: [usize; 2],
    /// The link of the one that moves as the other sees it, and that of the other.
    link: usize,
    from: Option<usize>,
    /// Where the joints were \[rad or m\], if that is remembered, and how far the two were apart then at least \[m\].
    at: Vec<f64>,
    apart: f64,
}

/// The one of two bodies that moves as the other sees it, and the link that carries the other.
pub fn moving<R: Robot<D>, const D: usize>(
    robot: &R,
    [a, b]: [usize; 2],
) -> (usize, Option<usize>) {
    let link = |i: usize| (i < robot.body_count()).then(|| robot.body(i).link);
    // The base, None, is before all links.
    if link(a) < link(b) { (b, link(a)) } else { (a, link(b)) }
}

impl OwnRoom {
    /// Of all pairs that must not touch, of which nothing is known yet.
    pub fn of_all<R: Robot<D>, const D: usize>(robot: &R) -> Vec<Self> {
        let pairs: Vec<[usize; 2]> = robot.body_pairs().collect();
        let n = if pairs.len() * robot.dof() <= MOST_REMEMBERED { robot.dof() } else { 0 };
        let unknown = |pair: [usize; 2]| {
            let (body, from) = moving(robot, pair);
            let (link, at) = (robot.body(body).link, vec![0.0; n]);
            Self { pair, link, from, at, apart: f64::NEG_INFINITY }
        };
        pairs.into_iter().map(unknown).collect()
    }

    /// How far one goes at most as the other sees it in a motion between two `ends` \[m\].
    pub fn way(&self, reach: &Levers, ends: [&[f64]; 2]) -> f64 {
        reach.way(ends, self.from, self.link)
    }

    /// Whether they are certain to be so far apart at `q` \[m\]: they have come no nearer than one has gone since then.
    pub fn is_apart(&self, reach: &Levers, q: &[f64], least: f64) -> bool {
        self.apart >= least && self.apart - self.way(reach, [&self.at, q]) >= least
    }

    /// Takes in that they are so far apart at `q` at least \[m\].
    pub fn remember(&mut self, q: &[f64], apart: f64) {
        if !self.at.is_empty() {
            self.at.copy_from_slice(q);
            self.apart = apart;
        }
    }
}
