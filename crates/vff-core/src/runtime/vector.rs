//! Many episodes of one scenario, a step of all of them at a time on all cores.
//!
//! Every episode has random numbers of its own: what it does depends neither on the others nor on the
//! number of threads.

use super::episode::{Episode, INFO, Step, Task};
use crate::interrupt::{self, on_pool};
use crate::math::memory;
use crate::scenario::{Problem, ScenarioError};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::Arc;

/// When an episode that has ended begins anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Autoreset {
    /// With the step after its last, whose action is not looked at.
    NextStep,
    /// Within its last step, which then shows the start of the next.
    SameStep,
    /// When it is told to.
    Disabled,
}

/// One of the episodes with what came of its last step.
#[derive(Debug)]
pub struct Slot {
    episode: Episode,
    /// What it shows now.
    pub observation: Vec<f64>,
    /// What came of the last step.
    pub step: Step,
    /// Where the last episode ended, if that was within the last step ([`Autoreset::SameStep`]).
    pub ended: bool,
    /// The observation there.
    pub last_observation: Vec<f64>,
    /// [`INFO`] there.
    pub last_info: [f64; INFO.len()],
}

impl Slot {
    fn new(task: &Arc<Task>, seed: u64) -> Result<Self, ScenarioError> {
        let mut slot = Self {
            episode: Episode::new(task, seed)?,
            observation: Vec::with_capacity(task.width()),
            step: Step::default(),
            ended: false,
            last_observation: vec![0.0; task.width()],
            last_info: [0.0; INFO.len()],
        };
        slot.show();
        Ok(slot)
    }

    fn show(&mut self) {
        self.episode.observe(&mut self.observation);
    }

    fn reset(&mut self, seed: Option<u64>) -> Result<(), ScenarioError> {
        self.episode.reset(seed)?;
        self.step = Step { info: self.episode.info(), ..Step::default() };
        self.ended = false;
        self.show();
        Ok(())
    }

    fn step(&mut self, action: &[f64], autoreset: Autoreset) -> Result<(), ScenarioError> {
        self.ended = false;
        if self.step.is_last() && autoreset == Autoreset::NextStep {
            return self.reset(None);
        }
        self.step = self.episode.step(action);
        self.show();
        if self.step.is_last() && autoreset == Autoreset::SameStep {
            let last = self.step;
            self.last_observation.copy_from_slice(&self.observation);
            self.last_info = last.info;
            self.reset(None)?;
            self.step = Step { info: self.step.info, ..last };
            self.ended = true;
        }
        Ok(())
    }
}

/// Episodes side by side.
///
/// # Example
/// ```
/// use vff_core::runtime::episode::Task;
/// use vff_core::runtime::vector::{Autoreset, Episodes, Slot};
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 0.05
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     "#,
/// )?;
/// let task = Task::new(scenario, &toml::toml! { action = "null_space" })?;
/// let mut episodes = Episodes::new(task, 2, 1, 7)?;
/// episodes.reset(&[Some(None), Some(None)])?;
/// episodes.step(&[0.0; 6], Autoreset::NextStep)?;
/// let slots: &[Slot] = episodes.slots();
/// assert!(slots.iter().all(|slot| !slot.ended));
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Episodes {
    task: Arc<Task>,
    slots: Vec<Slot>,
    pool: Option<ThreadPool>,
    /// The process that has the threads of the pool: a fork of it has none.
    process: u32,
}

impl Episodes {
    /// `count` episodes on up to `threads` threads; episode i has the seed `seed + i`.
    ///
    /// # Errors
    /// If a start cannot be run, all of them do not fit into memory, or the system does not give the threads.
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a size to compare"
    )]
    pub fn new(task: Task, count: usize, threads: usize, seed: u64) -> Result<Self, ScenarioError> {
        let numbers = count as f64 * (task.run_numbers() + 4.0 * task.width() as f64);
        memory::fits(numbers as usize).map_err(|error| {
            ScenarioError::new("count", Problem::Other(format!("{count} episodes take {error}")))
        })?;
        let task = Arc::new(task);
        let seeds = (0..count as u64).map(|i| seed.wrapping_add(i));
        let new = |seed| {
            interrupt::checkpoint(4096);
            Slot::new(&task, seed)
        };
        let slots = seeds.map(new).collect::<Result<_, _>>()?;
        let threads = threads.min(count);
        let pool = (threads > 1).then(|| {
            ThreadPoolBuilder::new()
                .num_threads(threads)
                .thread_name(|i| format!("vff-{i}"))
                .build()
        });
        let pool = pool.transpose().map_err(|error| {
            let problem = Problem::Other(format!("cannot start {threads} threads: {error}"));
            ScenarioError::new("threads", problem)
        })?;
        Ok(Self { task, slots, pool, process: std::process::id() })
    }

    /// What they have in common.
    pub fn task(&self) -> &Task {
        &self.task
    }

    /// All of them.
    pub fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// Begins those anew that `seeds` has an entry for, with its seed if there is one.
    ///
    /// # Errors
    /// If a start cannot be run.
    pub fn reset(&mut self, seeds: &[Option<Option<u64>>]) -> Result<(), ScenarioError> {
        self.each(seeds, |slot, seed| seed.map_or(Ok(()), |seed| slot.reset(seed)))
    }

    /// A step of all, `actions` row by row.
    ///
    /// # Errors
    /// If a start cannot be run.
    pub fn step(&mut self, actions: &[f64], autoreset: Autoreset) -> Result<(), ScenarioError> {
        let actions: Vec<_> = actions.chunks_exact(self.task.joints()).collect();
        self.each(&actions, |slot, action| slot.step(action, autoreset))
    }

    fn each<T: Copy + Sync>(
        &mut self,
        with: &[T],
        f: impl Fn(&mut Slot, T) -> Result<(), ScenarioError> + Sync,
    ) -> Result<(), ScenarioError> {
        match &self.pool {
            Some(pool) if self.process == std::process::id() => on_pool(pool, |parts| {
                let pairs = self.slots.par_iter_mut().zip(with);
                pairs.try_for_each(|(slot, with)| parts.within(|| f(slot, *with)))
            }),
            _ => self.slots.iter_mut().zip(with).try_for_each(|(slot, with)| f(slot, *with)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    const SCENARIO: &str = "
        duration = 0.3
        q0 = [0.3, 0.6, -0.4]
        arm = { lengths = [1, 1, 1], masses = 1 }
        reference = { kind = 'setpoint', point = [1.5, 1.2] }
        obstacles = [{ shape = { kind = 'circle', radius = 0.1 }, position = [2.2, 0.5] }]";

    fn episodes(count: usize, threads: usize, seed: u64) -> Episodes {
        let settings = "action = 'torque'".parse().unwrap();
        let task = Task::new(Scenario::from_toml(SCENARIO).unwrap(), &settings).unwrap();
        Episodes::new(task, count, threads, seed).unwrap()
    }

    /// What the third of five on three threads does, it does alone.
    #[test]
    fn episodes_do_not_depend_on_each_other() {
        for autoreset in [Autoreset::NextStep, Autoreset::SameStep] {
            let (mut many, mut one) = (episodes(5, 3, 10), episodes(1, 1, 12));
            let mut ends = 0;
            for k in 0..100 {
                let x = 0.3 * f64::from(k).sin();
                let row = [x, -x, 0.5 * x];
                many.step(&row.repeat(5), autoreset).unwrap();
                one.step(&row, autoreset).unwrap();
                let (there, here) = (&many.slots()[2], &one.slots()[0]);
                assert_eq!(there.observation, here.observation);
                assert_eq!((there.step, there.ended), (here.step, here.ended));
                assert_eq!(there.last_observation, here.last_observation);
                ends += usize::from(here.step.is_last());
            }
            assert!(ends > 2);
        }
    }

    /// Only those that are told to begin anew.
    #[test]
    fn reset_of_some() {
        let mut episodes = episodes(3, 2, 0);
        episodes.step(&[0.1; 9], Autoreset::Disabled).unwrap();
        let before: Vec<_> = episodes.slots().iter().map(|slot| slot.observation.clone()).collect();
        episodes.reset(&[None, Some(Some(0)), Some(None)]).unwrap();
        let after: Vec<_> = episodes.slots().iter().map(|slot| slot.observation.clone()).collect();
        assert_eq!(before[0], after[0]);
        assert!(before[1] != after[1] && before[2] != after[2]);
    }
}
