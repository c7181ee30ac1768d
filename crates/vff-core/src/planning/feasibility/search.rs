//! The search: many motions at once, continued piece by piece, see the [module](super).

use super::chain::Chain;
use super::{
    ANGLE, CLEARANCE, MARGIN, MAX_ACCELERATION, MAX_SPEED, Motion, STEP, TIP, Verdict, WIDTHS,
};
use crate::interrupt;
use crate::inverse_kinematics::Residual;
use crate::math::{Pose, Vector, memory};
use crate::scenario::{Problem, ScenarioError};
use crate::trajectory::Trajectory;
use crate::world::{CollisionQuery, ObstacleGeometry, World};
use nalgebra::SMatrix;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// Continuations of every motion.
const BRANCHES: usize = 4;
/// How far ahead the search looks at the obstacles \[s\].
const AHEAD: [f64; 3] = [0.0, 0.4, 0.8];
/// Instants per piece at which a motion is checked.
const CHECKS: usize = 10;
/// From where on a joint is pushed away from its limit \[rad\].
const LIMIT: f64 = 0.3;

/// Distances that count \[m\]: in the plane, where links have 1 m, and in space.
struct Distances {
    /// From here on obstacles push.
    influence: f64,
    /// Nearer than this the push does not grow, and room does not shrink.
    floor: f64,
    /// More room than this is no better.
    plenty: f64,
}

const DISTANCES: [Distances; 2] = [
    Distances { influence: 0.6, floor: 0.05, plenty: 0.5 },
    Distances { influence: 0.3, floor: 0.02, plenty: 0.25 },
];

/// What the search sees of a scenario.
pub struct Search<C: Chain<D, M>, S: ObstacleGeometry<D>, const D: usize, const M: usize> {
    /// The arm.
    pub chain: C,
    /// Joint angles at the start \[rad\].
    pub start: Vec<f64>,
    /// The radius at which an angle of the task counts as its arc \[m\].
    pub length: f64,
    /// How many pieces a motion has.
    pub pieces: usize,
    /// What the tip has to do.
    pub trajectory: Trajectory<C::Pose, M>,
    /// What is in the way.
    pub world: World<S, D>,
}

/// How many pieces a motion of a duration \[s\] has, for `n` joints.
///
/// # Errors
/// If what the search keeps of them does not fit into memory.
pub fn pieces(duration: f64, n: usize) -> Result<usize, ScenarioError> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "validated: positive and at most 1e12 steps"
    )]
    let pieces = (duration / STEP - 1e-9).ceil() as usize;
    let numbers = (2 * n + 8).saturating_mul(WIDTHS[1]);
    memory::fits(pieces.saturating_mul(numbers)).map_err(|error| {
        let problem = format!("the motions that are followed over {pieces} pieces take {error}");
        ScenarioError::new("duration", Problem::Other(problem))
    })?;
    Ok(pieces)
}

/// One of the motions that are followed: where it stands, and where it came from.
#[derive(Clone)]
struct Node {
    q: Vec<f64>,
    dq: Vec<f64>,
    score: f64,
    parent: usize,
}

impl<C: Chain<D, M>, S: ObstacleGeometry<D>, const D: usize, const M: usize> Search<C, S, D, M> {
    const DISTANCES: &Distances = &DISTANCES[D - 2];

    /// What is found, first with the tip held, then without.
    pub fn verdict(&self) -> (Verdict, Option<Motion>) {
        for (hold, verdict) in [(true, Verdict::WithTip), (false, Verdict::WithoutTip)] {
            for (attempt, &width) in (0..).zip(&WIDTHS) {
                let found = self.search(hold, width, 2 * attempt + u64::from(hold));
                if found.is_some() {
                    return (verdict, found);
                }
            }
        }
        (Verdict::NoneFound, None)
    }

    fn search(&self, hold: bool, width: usize, seed: u64) -> Option<Motion> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let n = self.start.len();
        let mut chain = self.chain.clone();
        let mut ahead = AHEAD.map(|_| self.world.clone());
        let mut half = self.world.clone();
        let root = Node { q: self.start.clone(), dq: vec![0.0; n], score: 0.0, parent: 0 };
        let mut layers = vec![vec![root]];
        for k in 0..self.pieces {
            let (t, next) = (time(k, 1), time(k + 1, 1));
            half.update(time(2 * k + 1, 2));
            ahead.iter_mut().zip(AHEAD).for_each(|(world, later)| world.update(t + later));
            let layer = &layers[k];
            let mut wanted = Vec::with_capacity(BRANCHES * width);
            let branches = BRANCHES * (width / layer.len()).max(1);
            for (parent, node) in layer.iter().enumerate() {
                chain.move_to(&node.q);
                let pushes = ahead.each_mut().map(|world| self.push(&chain, &node.q, world));
                let target = self.trajectory.at(next).x;
                for _ in 0..branches {
                    interrupt::checkpoint(64 * n);
                    let way = self.continuation(&mut random, node, &chain, &pushes, &target, hold);
                    wanted.push((parent, way));
                }
            }
            ahead.iter_mut().zip(AHEAD).for_each(|(world, later)| world.update(next + later));
            let mut found: Vec<Node> = wanted
                .into_iter()
                .filter_map(|(parent, way)| {
                    let node = &layer[parent];
                    interrupt::checkpoint(64 * n * (4 + self.world.len()));
                    let target = self.trajectory.at(next).x;
                    let (q, dq) = self.advanced(&mut chain, node, way, &target, hold)?;
                    let middle: Vec<f64> = q
                        .iter()
                        .zip(&node.q)
                        .map(|(after, before)| 0.5 * (after + before))
                        .collect();
                    chain.move_to(&middle);
                    if Self::clearance(&mut half, &chain) < MARGIN {
                        return None;
                    }
                    chain.move_to(&q);
                    let room = Self::room(&mut ahead, &chain)?;
                    let speed: f64 = dq.iter().map(|dq| dq * dq).sum();
                    let deviation =
                        if hold { 0.0 } else { Self::off(&chain, &target).size(self.length) };
                    let score = 0.9 * node.score + room - 0.02 * speed - 0.2 * deviation;
                    Some(Node { q, dq, score, parent })
                })
                .collect();
            if found.is_empty() {
                return None;
            }
            select(&mut found, width, &mut random);
            layers.push(found);
        }
        best_first(&layers[self.pieces])
            .into_iter()
            .take(8)
            .map(|end| trace(&layers, end))
            .find(|motion| self.is_clear(motion, hold))
    }

    /// Joint speeds to try next \[rad/s\].
    fn continuation(
        &self,
        random: &mut ChaCha8Rng,
        node: &Node,
        chain: &C,
        pushes: &[Vec<f64>; AHEAD.len()],
        target: &C::Pose,
        hold: bool,
    ) -> Vec<f64> {
        let push = &pushes[index(random, AHEAD.len())];
        let keep = [0.0, 0.7, 1.0][index(random, 3)];
        let away = [0.0, 0.5, 2.0][index(random, 3)];
        let noise = [0.0, 0.2, 1.0][index(random, 3)];
        let mut free: Vec<f64> = node
            .dq
            .iter()
            .zip(push)
            .map(|(dq, push)| {
                let draw: f64 = StandardNormal.sample(random);
                keep * dq + away * push + noise * draw
            })
            .collect();
        let task = self.pull(chain, -chain.pose().error(target) / STEP);
        if hold {
            let seen = (0..free.len()).map(|i| chain.column(i) * free[i]).sum::<Vector<M>>();
            let seen = self.pull(chain, seen);
            free.iter_mut().zip(task).zip(seen).for_each(|((dq, task), seen)| *dq += task - seen);
        } else {
            let follow = [0.0, 0.0, 0.1, 1.0][index(random, 4)];
            free.iter_mut().zip(task).for_each(|(dq, task)| *dq += follow * task.clamp(-1.0, 1.0));
        }
        free
    }

    /// Angles and speeds after a piece at these speeds, as far as the bounds let it; none if they
    /// do not let it hold the tip.
    fn advanced(
        &self,
        chain: &mut C,
        node: &Node,
        mut dq: Vec<f64>,
        target: &C::Pose,
        hold: bool,
    ) -> Option<(Vec<f64>, Vec<f64>)> {
        let bound = MAX_ACCELERATION[D - 2] * STEP;
        for (i, (dq, before)) in dq.iter_mut().zip(&node.dq).enumerate() {
            let [down, up] = self.speeds(i, node.q[i], bound);
            *dq = dq.clamp(down, up).clamp(before - bound, before + bound);
        }
        let mut q: Vec<f64> = node.q.iter().zip(&dq).map(|(q, dq)| q + STEP * dq).collect();
        if hold {
            for _ in 0..3 {
                chain.move_to(&q);
                let back = self.pull(chain, -chain.pose().error(target));
                q.iter_mut().zip(back).for_each(|(q, back)| *q += back);
            }
            chain.move_to(&q);
            if !is_held(&Self::off(chain, target), 0.1) {
                return None;
            }
            for (i, dq) in dq.iter_mut().enumerate() {
                *dq = (q[i] - node.q[i]) / STEP;
                if dq.abs() > self.speed(i) || (*dq - node.dq[i]).abs() > bound {
                    return None;
                }
            }
        }
        let limits = &self.chain.limits().joint;
        let inside = q.iter().zip(limits).all(|(q, [lower, upper])| lower <= q && q <= upper);
        inside.then_some((q, dq))
    }

    /// The largest speed of joint `i` \[rad/s\].
    fn speed(&self, i: usize) -> f64 {
        self.chain.limits().velocity.get(i).copied().unwrap_or(MAX_SPEED)
    }

    /// The speeds of joint `i` at the angle `q` from which it still stops before its limits, if its
    /// speed changes by `bound` from piece to piece \[rad/s\].
    fn speeds(&self, i: usize, q: f64, bound: f64) -> [f64; 2] {
        let speed = self.speed(i);
        let Some([lower, upper]) = self.chain.limits().joint.get(i) else { return [-speed, speed] };
        // k pieces at k, k − 1, … times the bound take k (k + 1) / 2 times its way.
        let stops = |way: f64| {
            let pieces = (0.25 + 2.0 * way.max(0.0) / (bound * STEP)).sqrt() - 0.5;
            (pieces * bound).min(speed)
        };
        [-stops(q - lower), stops(upper - q)]
    }

    /// Whether a motion is clear, and holds the tip if it has to.
    fn is_clear(&self, motion: &[Vec<f64>], hold: bool) -> bool {
        let (mut world, mut chain) = (self.world.clone(), self.chain.clone());
        (0..=CHECKS * self.pieces).all(|k| {
            interrupt::checkpoint(64 * self.start.len() * (1 + self.world.len()));
            let (piece, part) = ((k / CHECKS).min(self.pieces - 1), k);
            #[expect(clippy::cast_precision_loss, reason = "a handful")]
            let share = (part - CHECKS * piece) as f64 / CHECKS as f64;
            let between =
                motion[piece].iter().zip(&motion[piece + 1]).map(|(a, b)| a + share * (b - a));
            chain.move_to(&between.collect::<Vec<_>>());
            let t = time(k, CHECKS);
            world.update(t);
            let held = !hold || is_held(&Self::off(&chain, &self.trajectory.at(t).x), 1.0);
            held && Self::clearance(&mut world, &chain) >= CLEARANCE
        })
    }

    /// How far the tip is from where it has to be.
    fn off(chain: &C, target: &C::Pose) -> Residual {
        Residual::of::<D, M>(&chain.pose().error(target))
    }

    /// The smallest joint speeds that give the tip a velocity, damped in singularities.
    fn pull(&self, chain: &C, velocity: Vector<M>) -> Vec<f64> {
        let n = self.start.len();
        let mut mobility = SMatrix::<f64, M, M>::identity() * 1e-9;
        for i in 0..n {
            let column = chain.column(i);
            mobility += column * column.transpose();
        }
        let force = mobility.try_inverse().map_or_else(Vector::zeros, |inverse| inverse * velocity);
        (0..n).map(|i| chain.column(i).dot(&force)).collect()
    }

    /// Smallest distance of a link to an obstacle \[m\].
    fn clearance(world: &mut World<S, D>, chain: &C) -> f64 {
        let mut least = f64::INFINITY;
        world.for_each_contact(chain.bodies(), 0.0, |_, d| least = least.min(d), |_| {});
        least
    }

    /// How much room the arm has now and will have where it stands, 0 is plenty; none if it is hit.
    fn room(ahead: &mut [World<S, D>; AHEAD.len()], chain: &C) -> Option<f64> {
        let Distances { floor, plenty, .. } = Self::DISTANCES;
        let mut cost = 0.0;
        for (world, (later, weight)) in ahead.iter_mut().zip(AHEAD.into_iter().zip([1.0, 0.7, 0.4]))
        {
            let mut least = f64::INFINITY;
            let narrow = |_: usize, d: f64| {
                least = least.min(d);
                cost += weight * (1.0 / (d.clamp(0.0, *plenty) + floor) - 1.0 / (plenty + floor));
            };
            world.for_each_contact(chain.bodies(), 0.0, narrow, |_| {});
            if later <= 0.0 && least < MARGIN {
                return None;
            }
        }
        Some(-0.1 * cost)
    }

    /// Joint speeds that lead away from the obstacles, none larger than 1 rad/s, and from limits.
    fn push(&self, chain: &C, q: &[f64], world: &mut World<S, D>) -> Vec<f64> {
        let Distances { influence, floor, .. } = Self::DISTANCES;
        let (mut torque, mut part) = (vec![0.0; q.len()], vec![0.0; q.len()]);
        world.for_each_contact(
            chain.bodies(),
            *influence,
            |_, _| {},
            |contact| {
                let size = 1.0 / contact.distance.max(*floor) - 1.0 / influence;
                chain.torque(contact.link, &contact.point, &(contact.normal * size), &mut part);
                torque.iter_mut().zip(&part).for_each(|(torque, part)| *torque += part);
            },
        );
        let largest = torque.iter().fold(1.0, |most: f64, torque| most.max(torque.abs()));
        torque.iter_mut().for_each(|torque| *torque /= largest);
        let near = |way: f64| (1.0 - way / LIMIT).max(0.0);
        for ((push, q), [lower, upper]) in torque.iter_mut().zip(q).zip(&chain.limits().joint) {
            *push += near(q - lower) - near(upper - q);
        }
        torque
    }
}

/// Whether the tip is held, to a share of what is allowed.
fn is_held(off: &Residual, share: f64) -> bool {
    off.position <= share * TIP && off.angle <= share * ANGLE
}

/// The instant after `k` of `parts` parts of a piece each \[s\].
#[expect(clippy::cast_precision_loss, reason = "counts of pieces")]
fn time(k: usize, parts: usize) -> f64 {
    STEP * k as f64 / parts as f64
}

fn index(random: &mut ChaCha8Rng, count: usize) -> usize {
    random.next_u32() as usize % count
}

/// Numbers of the motions, the best first; compiled once, whatever the task.
#[inline(never)]
fn best_first(ends: &[Node]) -> Vec<usize> {
    let mut numbers: Vec<usize> = (0..ends.len()).collect();
    numbers.sort_by(|&a, &b| ends[b].score.total_cmp(&ends[a].score));
    numbers
}

/// Keeps `width` of the motions: half the best, half any.
fn select(found: &mut Vec<Node>, width: usize, random: &mut ChaCha8Rng) {
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    for k in width / 2..width.min(found.len()) {
        let any = k + index(random, found.len() - k);
        found.swap(k, any);
    }
    found.truncate(width);
}

/// The motion that ends at place `end` of the last layer.
fn trace(layers: &[Vec<Node>], mut end: usize) -> Motion {
    let mut motion: Motion = layers
        .iter()
        .rev()
        .map(|layer| {
            let node = &layer[end];
            end = node.parent;
            node.q.clone()
        })
        .collect();
    motion.reverse();
    motion
}
