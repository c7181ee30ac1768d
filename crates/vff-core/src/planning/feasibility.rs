//! Whether a scene can be survived at all, by a planner that knows the future and no controller.
//!
//! **The rule**, fixed before any controller was run on random scenes. A *motion* is a sequence of
//! joint angles from the scene's start, [`STEP`] apart, straight in between, with joint speeds up to
//! [`MAX_SPEED`], whose change from one piece to the next is at most [`MAX_ACCELERATION`] times
//! [`STEP`]. It is *clear* if every link keeps [`CLEARANCE`] or more from every obstacle at all
//! instants 5 ms apart, and it *holds the tip* if the tip is never more than [`TIP`] from its
//! reference. The [`Verdict`] on a scene is what a search with a given budget finds.
//!
//! The search follows the first of [`WIDTHS`] motions at once. Each is continued in four random ways
//! per piece: what the task asks for, a push away from where the obstacles are now or will be soon,
//! and noise, in random shares; with the tip held, every continuation is put back onto the reference
//! by Newton's method. Continuations that come within [`MARGIN`] of an obstacle or break a bound are
//! dropped. Of the rest as many are followed as before: half of them for the room that they have, now
//! and later, half at random. A search that dies out is repeated once, with the second width.
//!
//! What is found is a motion, checked; "none found" is no proof that there is none. Links may cross
//! each other, as they may in the plant. The random numbers are always the same.

use crate::control::TaskKind;
use crate::interrupt;
use crate::math::{Body, Capsule, Vector, cross, memory, perp};
use crate::scenario::{Problem, Scenario, ScenarioError};
use crate::trajectory::Trajectory;
use crate::world::CollisionQuery;
use crate::world::plane::World;
use nalgebra::Matrix2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// Duration of one piece of a motion \[s\].
pub const STEP: f64 = 0.05;
/// Largest joint speed \[rad/s\].
pub const MAX_SPEED: f64 = 3.0;
/// Largest change of a joint's speed from piece to piece, relative to [`STEP`] \[rad/s²\].
pub const MAX_ACCELERATION: f64 = 30.0;
/// What a motion has to keep from every obstacle \[m\].
pub const CLEARANCE: f64 = 1e-3;
/// What the search keeps at the ends and in the middle of its pieces \[m\].
pub const MARGIN: f64 = 1e-2;
/// How far the tip may be from its reference where it is held \[m\].
pub const TIP: f64 = 1e-2;
/// How many motions the first and the second attempt follow.
pub const WIDTHS: [usize; 2] = [64, 256];

/// Continuations of every motion.
const BRANCHES: usize = 4;
/// How far ahead the search looks at the obstacles \[s\].
const AHEAD: [f64; 3] = [0.0, 0.4, 0.8];
/// Instants per piece at which a motion is checked.
const CHECKS: usize = 10;

/// What the search has found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// A clear motion that holds the tip.
    WithTip,
    /// A clear motion, but none that holds the tip.
    WithoutTip,
    /// No clear motion.
    NoneFound,
}

impl Verdict {
    /// Its name in every layer.
    pub fn name(self) -> &'static str {
        match self {
            Self::WithTip => "with tip",
            Self::WithoutTip => "without tip",
            Self::NoneFound => "none found",
        }
    }
}

/// The joint angles of a motion \[rad\], one vector per instant, [`STEP`] apart.
pub type Motion = Vec<Vec<f64>>;

/// Assesses a scene; with the motion that was found.
///
/// # Errors
/// If the arm is not planar, the task not a position, or its reference unusable.
pub fn assess(scenario: &Scenario) -> Result<(Verdict, Option<Motion>), ScenarioError> {
    let scene = Scene::new(scenario)?;
    for (hold, verdict) in [(true, Verdict::WithTip), (false, Verdict::WithoutTip)] {
        for (attempt, &width) in (0..).zip(&WIDTHS) {
            let found = scene.search(hold, width, 2 * attempt + u64::from(hold));
            if found.is_some() {
                return Ok((verdict, found));
            }
        }
    }
    Ok((Verdict::NoneFound, None))
}

/// What the search sees of a scenario.
struct Scene {
    lengths: Vec<f64>,
    radii: Vec<f64>,
    start: Vec<f64>,
    pieces: usize,
    trajectory: Trajectory<Vector<2>, 2>,
    world: World,
}

/// One of the motions that are followed: where it stands, and where it came from.
#[derive(Clone)]
struct Node {
    q: Vec<f64>,
    dq: Vec<f64>,
    score: f64,
    parent: usize,
}

impl Scene {
    fn new(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let Some(planar) = scenario.scene.plane() else {
            let problem = Problem::Other("can be assessed in the plane only".into());
            return Err(ScenarioError::new("arm", problem));
        };
        if scenario.controller.task != TaskKind::Position {
            let problem = Problem::Other("can be assessed for the task position only".into());
            return Err(ScenarioError::new("controller.task", problem));
        }
        let arm = planar.arm.build().map_err(|error| error.inside("arm"))?;
        let mut scene = Self {
            lengths: arm.links().iter().map(|link| link.length).collect(),
            radii: arm.links().iter().map(|link| link.radius).collect(),
            start: scenario.q0.clone(),
            pieces: 0,
            trajectory: Trajectory::new(&planar.reference, &Vector::zeros())
                .map_err(|error| unusable(&error))?,
            world: World::new(planar.obstacles.clone()),
        };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "validated: positive and at most 1e12 steps"
        )]
        let pieces = (scenario.duration / STEP - 1e-9).ceil() as usize;
        let numbers = (2 * scene.start.len() + 8).saturating_mul(WIDTHS[1]);
        memory::fits(pieces.saturating_mul(numbers)).map_err(|error| {
            let problem =
                format!("the motions that are followed over {pieces} pieces take {error}");
            ScenarioError::new("duration", Problem::Other(problem))
        })?;
        scene.pieces = pieces;
        let tip = *scene.joints(&scene.start).last().expect("an arm has a tip");
        scene.trajectory =
            Trajectory::new(&planar.reference, &tip).map_err(|error| unusable(&error))?;
        Ok(scene)
    }

    fn search(&self, hold: bool, width: usize, seed: u64) -> Option<Motion> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let n = self.start.len();
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
                let joints = self.joints(&node.q);
                let pushes = ahead.each_mut().map(|world| self.push(world, &joints));
                let target = self.trajectory.at(next).x;
                for _ in 0..branches {
                    interrupt::spend(64 * n);
                    let way = self.continuation(&mut random, node, &joints, &pushes, target, hold);
                    wanted.push((parent, way));
                }
            }
            ahead.iter_mut().zip(AHEAD).for_each(|(world, later)| world.update(next + later));
            let mut found: Vec<Node> = wanted
                .into_iter()
                .filter_map(|(parent, way)| {
                    let node = &layer[parent];
                    interrupt::spend(64 * n * (4 + self.world.len()));
                    let target = self.trajectory.at(next).x;
                    let (q, dq) = self.advanced(node, way, target, hold)?;
                    let middle: Vec<f64> = q
                        .iter()
                        .zip(&node.q)
                        .map(|(after, before)| 0.5 * (after + before))
                        .collect();
                    if self.clearance(&mut half, &self.joints(&middle)) < MARGIN {
                        return None;
                    }
                    let joints = self.joints(&q);
                    let room = self.room(&mut ahead, &joints)?;
                    let speed: f64 = dq.iter().map(|dq| dq * dq).sum();
                    let astray = if hold { 0.0 } else { (joints[n] - target).norm() };
                    let score = 0.9 * node.score + room - 0.02 * speed - 0.2 * astray;
                    Some(Node { q, dq, score, parent })
                })
                .collect();
            if found.is_empty() {
                return None;
            }
            select(&mut found, width, &mut random);
            layers.push(found);
        }
        let mut ends: Vec<usize> = (0..layers[self.pieces].len()).collect();
        ends.sort_by(|&a, &b| {
            layers[self.pieces][b].score.total_cmp(&layers[self.pieces][a].score)
        });
        ends.into_iter()
            .take(8)
            .map(|end| trace(&layers, end))
            .find(|motion| self.is_clear(motion, hold))
    }

    /// Joint speeds to try next \[rad/s\].
    fn continuation(
        &self,
        random: &mut ChaCha8Rng,
        node: &Node,
        joints: &[Vector<2>],
        pushes: &[Vec<f64>; AHEAD.len()],
        target: Vector<2>,
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
        let task = pull(joints, (target - joints[joints.len() - 1]) / STEP);
        if hold {
            let seen = (0..free.len()).map(|i| column(joints, i) * free[i]).sum::<Vector<2>>();
            let seen = pull(joints, seen);
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
        node: &Node,
        mut dq: Vec<f64>,
        target: Vector<2>,
        hold: bool,
    ) -> Option<(Vec<f64>, Vec<f64>)> {
        let bound = MAX_ACCELERATION * STEP;
        for (dq, before) in dq.iter_mut().zip(&node.dq) {
            *dq = dq.clamp(before - bound, before + bound).clamp(-MAX_SPEED, MAX_SPEED);
        }
        let mut q: Vec<f64> = node.q.iter().zip(&dq).map(|(q, dq)| q + STEP * dq).collect();
        if hold {
            for _ in 0..3 {
                let joints = self.joints(&q);
                let back = pull(&joints, target - joints[q.len()]);
                q.iter_mut().zip(back).for_each(|(q, back)| *q += back);
            }
            if (self.joints(&q)[q.len()] - target).norm() > 0.1 * TIP {
                return None;
            }
            for (i, dq) in dq.iter_mut().enumerate() {
                *dq = (q[i] - node.q[i]) / STEP;
                if dq.abs() > MAX_SPEED || (*dq - node.dq[i]).abs() > bound {
                    return None;
                }
            }
        }
        Some((q, dq))
    }

    /// Whether a motion is clear, and holds the tip if it has to.
    fn is_clear(&self, motion: &[Vec<f64>], hold: bool) -> bool {
        let mut world = self.world.clone();
        (0..=CHECKS * self.pieces).all(|k| {
            interrupt::spend(64 * self.start.len() * (1 + self.world.len()));
            let (piece, part) = ((k / CHECKS).min(self.pieces - 1), k);
            #[expect(clippy::cast_precision_loss, reason = "a handful")]
            let share = (part - CHECKS * piece) as f64 / CHECKS as f64;
            let between =
                motion[piece].iter().zip(&motion[piece + 1]).map(|(a, b)| a + share * (b - a));
            let joints = self.joints(&between.collect::<Vec<_>>());
            let t = time(k, CHECKS);
            world.update(t);
            let astray = (joints[joints.len() - 1] - self.trajectory.at(t).x).norm();
            (!hold || astray <= TIP) && self.clearance(&mut world, &joints) >= CLEARANCE
        })
    }

    /// Positions of the joints and the tip \[m\].
    fn joints(&self, q: &[f64]) -> Vec<Vector<2>> {
        let mut joints = Vec::with_capacity(q.len() + 1);
        let (mut angle, mut place) = (0.0, Vector::<2>::zeros());
        joints.push(place);
        for (q, length) in q.iter().zip(&self.lengths) {
            angle += q;
            place += Vector::<2>::new(angle.cos(), angle.sin()) * *length;
            joints.push(place);
        }
        joints
    }

    fn bodies(&self, joints: &[Vector<2>]) -> impl Iterator<Item = Body<2>> {
        let capsules =
            joints.windows(2).zip(&self.radii).map(|(ends, &r)| Capsule::new(ends[0], ends[1], r));
        capsules.enumerate().map(|(link, shape)| Body::new(link, shape))
    }

    /// Smallest distance of a link to an obstacle \[m\].
    fn clearance(&self, world: &mut World, joints: &[Vector<2>]) -> f64 {
        let mut least = f64::INFINITY;
        world.for_each_contact(self.bodies(joints), 0.0, |_, d| least = least.min(d), |_| {});
        least
    }

    /// How much room the arm has now and will have where it stands, 0 is plenty; none if it is hit.
    fn room(&self, ahead: &mut [World; AHEAD.len()], joints: &[Vector<2>]) -> Option<f64> {
        let mut cost = 0.0;
        for (world, (later, weight)) in ahead.iter_mut().zip(AHEAD.into_iter().zip([1.0, 0.7, 0.4]))
        {
            let mut least = f64::INFINITY;
            let narrow = |_: usize, d: f64| {
                least = least.min(d);
                cost += weight * (1.0 / (d.clamp(0.0, 0.5) + 0.05) - 1.0 / 0.55);
            };
            world.for_each_contact(self.bodies(joints), 0.0, narrow, |_| {});
            if later <= 0.0 && least < MARGIN {
                return None;
            }
        }
        Some(-0.1 * cost)
    }

    /// Joint speeds that lead away from the obstacles, none larger than 1 rad/s.
    fn push(&self, world: &mut World, joints: &[Vector<2>]) -> Vec<f64> {
        let mut torque = vec![0.0; self.start.len()];
        world.for_each_contact(
            self.bodies(joints),
            0.6,
            |_, _| {},
            |contact| {
                let force = contact.normal * (1.0 / contact.distance.max(0.05) - 1.0 / 0.6);
                for (torque, joint) in torque.iter_mut().zip(joints).take(contact.link + 1) {
                    *torque += cross(contact.point - joint, force);
                }
            },
        );
        let largest = torque.iter().fold(1.0, |most: f64, torque| most.max(torque.abs()));
        torque.iter_mut().for_each(|torque| *torque /= largest);
        torque
    }
}

fn unusable(error: &crate::trajectory::TrajectoryError) -> ScenarioError {
    ScenarioError::new(format!("reference.{}", error.field()), Problem::Other(error.to_string()))
}

/// The instant after `k` of `parts` parts of a piece each \[s\].
#[expect(clippy::cast_precision_loss, reason = "counts of pieces")]
fn time(k: usize, parts: usize) -> f64 {
    STEP * k as f64 / parts as f64
}

/// Column `i` of the tip's Jacobian.
fn column(joints: &[Vector<2>], i: usize) -> Vector<2> {
    perp(joints[joints.len() - 1] - joints[i])
}

/// The smallest joint speeds that give the tip a velocity, damped in singularities.
fn pull(joints: &[Vector<2>], velocity: Vector<2>) -> Vec<f64> {
    let n = joints.len() - 1;
    let mut mobility = Matrix2::identity() * 1e-9;
    for i in 0..n {
        let column = column(joints, i);
        mobility += column * column.transpose();
    }
    let force = mobility.try_inverse().map_or_else(Vector::zeros, |inverse| inverse * velocity);
    (0..n).map(|i| column(joints, i).dot(&force)).collect()
}

fn index(random: &mut ChaCha8Rng, count: usize) -> usize {
    random.next_u32() as usize % count
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

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(obstacle: &str) -> Verdict {
        let text = format!(
            "duration = 4.0\nq0 = [1.2, -0.6, -0.6, -0.5, 0.3, 0.4]\n\
             arm = {{ lengths = [1, 1, 1, 1, 1, 1], masses = 1.0 }}\n\
             reference = {{ kind = \"setpoint\", point = [5.025409086959208, 1.0172560207580585] }}\n{obstacle}"
        );
        assess(&Scenario::from_toml(&text).unwrap()).unwrap().0
    }

    /// Nothing in the way; a disc that pushes into the links; one that goes over the tip's place;
    /// one that goes over the base, from which no joint can take the first link away.
    #[test]
    fn scenes_whose_answer_is_known() {
        let disc = |position: &str, velocity: &str| {
            verdict(&format!(
                "[[obstacles]]\nshape = {{ kind = \"circle\", radius = 0.15 }}\nposition = {position}\n\
                 motion = {{ kind = \"linear\", velocity = {velocity} }}"
            ))
        };
        assert_eq!(verdict(""), Verdict::WithTip);
        assert_eq!(disc("[1.6, 2.9]", "[0.0, -0.35]"), Verdict::WithTip);
        assert_eq!(disc("[5.0, 3.0]", "[0.0, -0.6]"), Verdict::WithoutTip);
        assert_eq!(disc("[-1.0, 0.0]", "[0.5, 0.0]"), Verdict::NoneFound);
    }
}
