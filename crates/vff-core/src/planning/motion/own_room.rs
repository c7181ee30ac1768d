//! How far two bodies of an arm were apart where they were looked at last: until the joints can have carried one to the other there is
//! nothing to look at.

use super::bundle::{Bundle, form_of, link_of};
use super::levers::{Jointed, Levers};
use super::margins::Margins;
use crate::geometry::Form;
use crate::interrupt;
use crate::math::{Vector, nearest};

/// Pairs are looked at anew everywhere where so many numbers would have to be remembered.
const MOST_REMEMBERED: usize = 1 << 20;

/// Two bodies of an arm, the still ones counted behind the others and bundles behind those.
#[derive(Debug, Clone)]
pub struct OwnRoom {
    /// Their numbers.
    pub pair: [usize; 2],
    /// Of two of which one is a bundle, the pairs of bodies that it stands for.
    pub members: Vec<OwnRoom>,
    /// The link of the one that moves as the other sees it, and that of the other.
    link: usize,
    from: Option<usize>,
    /// Where the joints were \[rad or m\], if that is remembered, and how far the two were apart then at least \[m\].
    at: Vec<f64>,
    apart: f64,
}

/// The one of two bodies that moves as the other sees it, and the link that carries the other.
pub fn moving<R: Jointed<D>, const D: usize>(
    robot: &R,
    bundles: &[Bundle<D>],
    [a, b]: [usize; 2],
) -> (usize, Option<usize>) {
    let link = |i: usize| link_of(robot, bundles, i);
    // The base, None, is before all links.
    if link(a) < link(b) { (b, link(a)) } else { (a, link(b)) }
}

/// How far two bodies are apart at least \[m\]: of capsules the distance, of hulls less by rounding alone. From `limit` on, anything that
/// is not below. `plane` as in [`Jointed::gap`].
pub fn apart_at_least<R: Jointed<D>, const D: usize>(
    robot: &R,
    bundles: &[Bundle<D>],
    pair: [usize; 2],
    limit: f64,
    plane: &mut Vector<D>,
) -> f64 {
    interrupt::checkpoint(32);
    let [a, b]: [Form<'_, D>; 2] = pair.map(|i| form_of(robot, bundles, i));
    let is_hull = a.1.is_some() || b.1.is_some();
    let capsules = (!is_hull || plane.norm_squared() == 0.0).then(|| nearest(&a.0, &b.0));
    if let Some(known) = capsules.filter(|known| !is_hull || known.distance >= limit) {
        *plane = -known.normal;
        return known.distance;
    }
    interrupt::checkpoint(256);
    R::gap([&a, &b], limit, plane)
}

impl OwnRoom {
    /// Of all pairs that must not touch, of which nothing is known yet.
    pub fn of_all<R: Jointed<D>, const D: usize>(robot: &R, bundles: &[Bundle<D>]) -> Vec<Self> {
        let first = robot.body_count() + robot.still_bodies().len();
        let head = |i: usize| {
            let bundle = bundles.iter().position(|bundle| bundle.members.contains(&i));
            bundle.map_or(i, |k| first + k)
        };
        let n = if robot.body_pairs().count() * robot.dof() <= MOST_REMEMBERED {
            robot.dof()
        } else {
            0
        };
        let unknown = |pair: [usize; 2]| {
            let (body, from) = moving(robot, bundles, pair);
            let link = link_of(robot, bundles, body).expect("it moves");
            let at = vec![0.0; n];
            Self { pair, members: vec![], link, from, at, apart: f64::NEG_INFINITY }
        };
        let mut all: Vec<Self> = vec![];
        for pair in robot.body_pairs() {
            let heads = pair.map(head);
            let member = unknown(pair);
            match all.iter_mut().find(|room| room.pair == heads) {
                Some(room) => room.members.push(member),
                None if heads == pair => all.push(member),
                None => all.push(Self { members: vec![member], ..unknown(heads) }),
            }
        }
        all
    }

    /// How far one goes at most as the other sees it in a motion between two `ends` \[m\].
    pub fn way(&self, reach: &Levers, ends: [&[f64]; 2]) -> f64 {
        reach.way(ends, self.from, self.link)
    }

    /// What they keep from each other at `q` \[m\].
    pub fn keeps(&self, margins: &Margins, reach: &Levers, q: &[f64]) -> f64 {
        margins.apart_at(q, reach, self.from, self.link)
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
