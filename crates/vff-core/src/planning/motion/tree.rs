//! RRT-Connect: two trees, one from the start and one from all goals, that grow towards random configurations and
//! towards each other (Kuffner and LaValle, 2000).

use super::free_space::FreeSpace;
use super::levers::Jointed;
use crate::interrupt;
use crate::math::Noise;
use crate::world::ObstacleGeometry;

/// The longest edge \[rad, m\].
const STEP: f64 = 0.8;
/// How often an edge into the open is tried at half its length where it is blocked. Others are not: draws about a node are of any
/// length, and what is left of an edge to the other tree stands before what blocks it, where it is of little use.
const HALVINGS: i32 = 1;
/// Where fewer than one of so many draws makes a tree grow, every other one is made about its nodes; after so many.
const NARROW: usize = 50;
/// How far from a node these are: between the longest edge and that much less, as e to this power.
const FINER: f64 = 3.0;
/// The most configurations of both trees: what is not found with so many is given up.
const MAX_NODES: usize = 1 << 20;
/// Where the end effector is kept upright, an edge has to come nearer to where it leads by so much of what it would come straight.
const LEAST: f64 = 0.1;
/// Shortcuts are given up after so many in a row that led nowhere.
const IN_VAIN: usize = 30;
/// Two configurations nearer than this are one \[rad, m\].
const SAME: f64 = 1e-9;

/// Configurations, each with the one that it was reached from.
#[derive(Debug, Clone)]
struct Tree {
    nodes: Vec<Vec<f64>>,
    parents: Vec<usize>,
}

/// What extending a tree came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Blocked,
    Nearer(usize),
    Reached(usize),
}

/// How far two configurations are from each other.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// The shortest first; compiled once, whatever the task.
#[inline(never)]
pub fn sort_by_length(found: &mut [Found]) {
    found.sort_by(|a, b| length(&a.path).total_cmp(&length(&b.path)));
}

/// How long a path is.
pub fn length(path: &[Vec<f64>]) -> f64 {
    path.windows(2).map(|pair| distance(&pair[0], &pair[1])).sum()
}

impl Tree {
    /// With these roots.
    fn new(roots: &[Vec<f64>]) -> Self {
        Self { nodes: roots.to_vec(), parents: (0..roots.len()).collect() }
    }

    /// The node nearest to `q`.
    fn nearest(&self, q: &[f64]) -> usize {
        interrupt::checkpoint(2 * self.nodes.len() * q.len());
        let mut best = (0, f64::INFINITY);
        for (i, node) in self.nodes.iter().enumerate() {
            let square = node.iter().zip(q).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
            if square < best.1 {
                best = (i, square);
            }
        }
        best.0
    }

    /// Grows from `node` towards `q` by one edge, which is halved up to so often where it is blocked.
    fn grow<R: Jointed<D>, S: ObstacleGeometry<D>, const D: usize>(
        &mut self,
        space: &mut FreeSpace<R, S, D>,
        node: usize,
        q: &[f64],
        halvings: i32,
    ) -> Step {
        let from = self.nodes[node].clone();
        let whole = distance(&from, q);
        if whole < SAME {
            return Step::Reached(node);
        }
        let first = (STEP / whole).min(1.0);
        // From where on no way is free.
        let mut blocked = f64::INFINITY;
        for halving in 0..=halvings {
            let share = first * 0.5_f64.powi(halving);
            if share >= blocked {
                continue;
            }
            let mut to: Vec<f64> = if share < 1.0 {
                from.iter().zip(q).map(|(a, b)| a + share * (b - a)).collect()
            } else {
                q.to_vec()
            };
            let is_moved = space.level(&mut to);
            let is_nearer = !is_moved || distance(&to, q) < whole * (1.0 - LEAST * share);
            if is_nearer {
                let Some(at) = space.blocked_between(&from, &to) else {
                    self.nodes.push(to);
                    self.parents.push(node);
                    let new = self.nodes.len() - 1;
                    let reached = share >= 1.0 && !is_moved;
                    return if reached { Step::Reached(new) } else { Step::Nearer(new) };
                };
                if !is_moved {
                    blocked = at * share;
                }
            }
        }
        Step::Blocked
    }

    /// Grows towards `q` as far as it goes; the node that is nearest then, and whether that is `q`.
    fn connect<R: Jointed<D>, S: ObstacleGeometry<D>, const D: usize>(
        &mut self,
        space: &mut FreeSpace<R, S, D>,
        q: &[f64],
    ) -> (usize, bool) {
        let mut node = self.nearest(q);
        loop {
            match self.grow(space, node, q, 0) {
                Step::Reached(there) => return (there, true),
                Step::Nearer(next) => node = next,
                Step::Blocked => return (node, false),
            }
        }
    }

    /// From a root to `node`.
    fn branch(&self, mut node: usize) -> Vec<Vec<f64>> {
        let mut branch = vec![self.nodes[node].clone()];
        while self.parents[node] != node {
            node = self.parents[node];
            branch.push(self.nodes[node].clone());
        }
        branch.reverse();
        branch
    }
}

/// What a search has come to.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// From the start to a goal; or, if that was not found, to where a goal's tree was nearest.
    pub path: Vec<Vec<f64>>,
    /// What is left between the two trees \[rad, m\]: 0 if the path reaches a goal.
    pub gap: f64,
    /// How many random configurations were drawn.
    pub samples: usize,
    /// How many configurations both trees have.
    pub nodes: usize,
}

/// Draws a configuration near `node`, any direction and any order of magnitude of the distance as likely.
fn draw_about(node: &[f64], ranges: &[[f64; 2]], noise: &mut Noise, drawn: &mut [f64]) {
    drawn.fill_with(|| noise.draw());
    let length = drawn.iter().map(|x| x * x).sum::<f64>().sqrt();
    let size = STEP * (-FINER * noise.share()).exp() / length;
    for ((to, from), [lower, upper]) in drawn.iter_mut().zip(node).zip(ranges) {
        *to = (from + *to * size).clamp(*lower, *upper);
    }
}

/// Searches a path from `start` to one of `goals`, all of which are free, with up to `samples` random configurations
/// within `ranges`; given up where a tree has not grown after `patience` of them.
pub fn search<R: Jointed<D>, S: ObstacleGeometry<D>, const D: usize>(
    space: &mut FreeSpace<R, S, D>,
    start: &[f64],
    goals: &[Vec<f64>],
    ranges: &[[f64; 2]],
    [samples, patience]: [usize; 2],
    noise: &mut Noise,
) -> Found {
    let mut trees = [Tree::new(&[start.to_vec()]), Tree::new(goals)];
    for goal in goals {
        if space.is_free_between(start, goal) {
            let path = vec![start.to_vec(), goal.clone()];
            return Found { path, gap: 0.0, samples: 0, nodes: 1 + goals.len() };
        }
    }
    // The nearest that the trees have come to each other, and the node of the first where they did.
    let apart = |trees: &[Tree; 2], node: usize| {
        let q = &trees[0].nodes[node];
        distance(q, &trees[1].nodes[trees[1].nearest(q)])
    };
    let mut nearest = (0, apart(&trees, 0));
    let mut drawn = vec![0.0; start.len()];
    // How many were drawn from the whole range, and how many of these made a tree grow.
    let (mut wide, mut grown) = (0, 0);
    let mut tried = 0;
    for k in 0..samples {
        let [of_start, of_goals] = trees.each_ref().map(|tree| tree.nodes.len());
        let is_trapped = of_start == 1 || of_goals == goals.len();
        if of_start + of_goals > MAX_NODES || (k >= patience && is_trapped) {
            break;
        }
        tried = k + 1;
        for (q, [lower, upper]) in drawn.iter_mut().zip(ranges) {
            *q = lower + (upper - lower) * noise.share();
        }
        // The smaller tree grows: one in a corner stays as large as one in the open.
        let [one, other] = &mut trees;
        let first = of_start <= of_goals;
        let (one, other) = if first { (one, other) } else { (other, one) };
        let node = one.nearest(&drawn);
        // In a narrow place hardly any straight way leads out: the node that reaches out most towards the draw looks about.
        let is_about = k % 2 == 1 && wide >= NARROW && grown * NARROW < wide;
        if is_about {
            draw_about(&one.nodes[node], ranges, noise, &mut drawn);
        }
        wide += usize::from(!is_about);
        let halvings = if is_about { 0 } else { HALVINGS };
        let (Step::Nearer(new) | Step::Reached(new)) = one.grow(space, node, &drawn, halvings)
        else {
            continue;
        };
        grown += usize::from(!is_about);
        let target = one.nodes[new].clone();
        let (met, reached) = other.connect(space, &target);
        let [a, b] = if first { [new, met] } else { [met, new] };
        if reached {
            let mut path = trees[0].branch(a);
            path.extend(trees[1].branch(b).into_iter().rev().skip(1));
            let nodes = trees[0].nodes.len() + trees[1].nodes.len();
            return Found { path, gap: 0.0, samples: tried, nodes };
        }
        let gap = distance(&trees[0].nodes[a], &trees[1].nodes[b]);
        if gap < nearest.1 {
            nearest = (a, gap);
        }
    }
    let nodes = trees[0].nodes.len() + trees[1].nodes.len();
    Found { path: trees[0].branch(nearest.0), gap: nearest.1, samples: tried, nodes }
}

/// Shortens `path` by up to `tries` random straight ways from one point of it to another.
pub fn shorten<R: Jointed<D>, S: ObstacleGeometry<D>, const D: usize>(
    space: &mut FreeSpace<R, S, D>,
    path: &mut Vec<Vec<f64>>,
    tries: usize,
    noise: &mut Noise,
) {
    let mut in_vain = 0;
    for _ in 0..tries {
        if path.len() < 3 || in_vain == IN_VAIN {
            return;
        }
        in_vain += 1;
        let ends: Vec<f64> = std::iter::once(0.0)
            .chain(path.windows(2).scan(0.0, |sum, pair| {
                *sum += distance(&pair[0], &pair[1]);
                Some(*sum)
            }))
            .collect();
        let whole = ends[ends.len() - 1];
        let mut at = [0; 2].map(|_| whole * noise.share());
        at.sort_by(f64::total_cmp);
        let place = |along: f64| {
            let piece = ends[1..ends.len() - 1].partition_point(|end| *end <= along);
            let share = (along - ends[piece]) / (ends[piece + 1] - ends[piece]);
            let pair = [&path[piece], &path[piece + 1]];
            let q = pair[0].iter().zip(pair[1]).map(|(a, b)| a + share * (b - a));
            (piece, q.collect::<Vec<f64>>())
        };
        let [(first, a), (last, b)] = at.map(place);
        if first == last || distance(&a, &b) > 0.999 * (at[1] - at[0]) {
            continue;
        }
        if space.is_free_between(&a, &b) {
            path.splice(first + 1..=last, [a, b]);
            in_vain = 0;
            continue;
        }
        // Where the end effector is kept upright, hardly any way is straight.
        let mut middle: Vec<f64> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
        if space.level(&mut middle)
            && distance(&a, &middle) + distance(&middle, &b) < 0.99 * (at[1] - at[0])
            && space.is_free_between(&a, &middle)
            && space.is_free_between(&middle, &b)
        {
            path.splice(first + 1..=last, [a, middle, b]);
            in_vain = 0;
        }
    }
}
