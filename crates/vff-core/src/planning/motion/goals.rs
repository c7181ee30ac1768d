//! The configurations in which a pose is reached.

use super::pointing::AT_GOAL;
use super::*;

/// Configurations from which inverse kinematics is tried, where one is free by then, and at most; and free ones that
/// are enough.
const SEEDS: [usize; 2] = [64, 512];
const GOALS: usize = 8;
/// How often a configuration that reaches a position is righted.
const RIGHTINGS: usize = 50;
/// Configurations nearer than this are one goal \[rad\].
const SAME: f64 = 0.1;

#[inline(never)]
fn sort_around(start: &[f64], all: &mut [Vec<f64>]) {
    all.sort_by(|a, b| tree::distance(a, start).total_cmp(&tree::distance(b, start)));
}

impl<S: SpaceTypes<D>, const D: usize> Planner<'_, S, D>
where
    S::State: Jointed<D>,
{
    /// Free or not, configurations that put the end effector at `pose`, each with its joints as near to the start as
    /// full turns bring them. If there are none: how far it stays away \[m\].
    pub(super) fn configurations<const M: usize>(
        &mut self,
        pose: &<S as System<D, M>>::Pose,
        limits: &Limits,
    ) -> Result<Vec<Vec<f64>>, f64>
    where
        S: System<D, M>,
    {
        let n = self.start.len();
        let length = self.arm.characteristic_length();
        let mut solver = Solver::<M>::new(n, length);
        let (mut found, mut free): (Vec<Vec<f64>>, usize) = (vec![], 0);
        let mut missed: Vec<(f64, (Residual, Vec<f64>))> = vec![];
        for k in 0..SEEDS[1] {
            // What was not reached from so many is out of reach, or hard to reach.
            if k >= SEEDS[0] && (free > 0 || found.is_empty()) {
                break;
            }
            let mut q = self.start.clone();
            if k > 0 {
                for (i, q) in q.iter_mut().enumerate() {
                    let [lower, upper] = ranges_of(limits, i);
                    let [lower, upper] = [lower.max(*q - PI), upper.min(*q + PI)];
                    *q = lower + (upper - lower) * self.noise.share();
                }
            }
            let mut residual = solver.solve(self.space.robot(), &mut q, pose);
            if residual.is_reached() {
                residual = self.solve_upright(&mut solver, &mut q, pose, residual);
            }
            if !residual.is_reached() {
                missed.push((residual.size(length), (residual, q)));
                continue;
            }
            self.unwind(&mut q, limits);
            if found.iter().any(|known| tree::distance(known, &q) < SAME) {
                continue;
            }
            free += usize::from(self.is_free_and_upright(&q));
            found.push(q);
            if free == GOALS {
                break;
            }
        }
        if found.is_empty() {
            sort_by_first(&mut missed);
            let mut nearest = f64::INFINITY;
            for (_, (residual, mut q)) in missed.into_iter().take(GOALS) {
                let mut left = solver.solve_nearby(self.space.robot(), &mut q, pose, residual);
                if left.is_reached() {
                    left = self.solve_upright(&mut solver, &mut q, pose, left);
                }
                nearest = nearest.min(left.size(length));
                self.unwind(&mut q, limits);
                if left.is_reached() && found.iter().all(|known| tree::distance(known, &q) >= SAME)
                {
                    found.push(q);
                }
            }
            if found.is_empty() {
                return Err(nearest);
            }
        }
        sort_around(&self.start, &mut found);
        Ok(found)
    }

    /// From a configuration with this `residual` to one near it with the end effector upright, or looking at what it has to, where the pose
    /// leaves that open: steps that right it and steps to the pose take turns.
    fn solve_upright<const M: usize>(
        &mut self,
        solver: &mut Solver<M>,
        q: &mut Vec<f64>,
        pose: &<S as System<D, M>>::Pose,
        mut residual: Residual,
    ) -> Residual
    where
        S: System<D, M>,
    {
        for _ in 0..RIGHTINGS {
            let before = self.space.off_at(q);
            if before <= AT_GOAL {
                break;
            }
            let mut next = q.clone();
            self.space.level(&mut next);
            let there = solver.solve(self.space.robot(), &mut next, pose);
            if !there.is_reached() || self.space.off_at(&next) >= before {
                break;
            }
            (*q, residual) = (next, there);
        }
        residual
    }

    /// Whether the arm at `q` touches nothing, and the end effector points where it has to at a goal.
    fn is_free_and_upright(&mut self, q: &[f64]) -> bool {
        self.space.touches_nothing_between(q, q) && self.space.off_at(q) <= AT_GOAL
    }

    /// Those goals where the end effector points where it has to.
    ///
    /// # Errors
    /// If there are none, in a sentence.
    pub(super) fn level(&mut self, goals: Vec<Vec<f64>>) -> Result<Vec<Vec<f64>>, String> {
        let off: Vec<f64> = goals.iter().map(|q| self.space.off_at(q)).collect();
        if off.iter().all(|off| *off > AT_GOAL) {
            let nearest = off.iter().zip(&goals).min_by(|a, b| a.0.total_cmp(b.0));
            return Err(nearest.map_or_else(String::new, |(_, q)| self.space.why_off(q)));
        }
        Ok(goals.into_iter().zip(off).filter(|(_, off)| *off <= AT_GOAL).map(|(q, _)| q).collect())
    }

    /// Begins a search with what may be off at its ends.
    pub(super) fn search_pointings(&mut self, goals: &[Vec<f64>]) {
        self.space.search_between(&self.start, goals);
    }

    /// Turns joints without limits by full turns until they are as near to the start as that brings them.
    fn unwind(&self, q: &mut [f64], limits: &Limits) {
        for (i, q) in q.iter_mut().enumerate() {
            if ranges_of(limits, i) == [f64::NEG_INFINITY, f64::INFINITY] {
                *q -= whole_turns(*q - self.start[i]);
            }
        }
    }
}
