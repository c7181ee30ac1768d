//! Many scenarios on all cores: the same outcomes as one by one, to the bit.
//!
//! Every batch makes a pool of threads of its own: a pool kept for later would hang in a process
//! that was forked from this one, because threads do not survive a fork.

use super::fault::guarded;
use super::prepare::Ready;
use crate::interrupt::{Parts, Watch, on_pool, watched};
use crate::scenario::{Problem, Scenario, ScenarioError};
use crate::simulation::{MAX_BYTES, METRICS, Outcome, Record, Sizes, Snapshot, Status, Value};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};
use toml::Table;

/// What rollouts that are ready before their turn may take together \[bytes\]; the others are prepared anew when it comes.
const READY: f64 = 1e9;
/// How often a rollout checks whether to stop.
const LOOK: Duration = Duration::from_millis(20);

/// Rollouts that are ready to start, and the threads that will do it.
///
/// # Example
/// ```
/// use std::time::Duration;
/// use vff_core::runtime::batch::{Batch, BatchError, Rollout};
/// use vff_core::simulation::Status;
///
/// let document = toml::toml! {
///     duration = 0.05
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
/// };
/// let batch = Batch::new(&[document.clone(), document], false, 2).unwrap();
/// let rollouts: Vec<Rollout> = batch.run(Duration::from_millis(20), |_| true);
/// assert!(rollouts.iter().all(|rollout| rollout.outcome.status == Status::Completed));
/// let refused = Batch::new(&[toml::toml! { duration = 1.0 }], false, 1);
/// assert!(matches!(refused, Err(BatchError::Scenario { index: 0, .. })));
/// ```
#[derive(Debug)]
pub struct Batch {
    pool: ThreadPool,
    rollouts: Vec<Next>,
    recorded: bool,
}

/// A rollout that has not begun.
#[derive(Debug)]
enum Next {
    Ready(Ready),
    /// One that was ready, and can be made so again.
    Sound(Box<Scenario>),
}

/// What one rollout came to.
#[derive(Debug, Clone)]
pub struct Rollout {
    /// How it ended.
    pub outcome: Outcome,
    /// Sentences for the user.
    pub warnings: Vec<String>,
    /// How long it took \[s\].
    pub wall_time: f64,
}

/// Why nothing was started.
#[derive(Debug, thiserror::Error)]
pub enum BatchError {
    /// A scenario that cannot be run.
    #[error("[{index}]: {error}")]
    Scenario {
        /// Where it stands in the list.
        index: usize,
        /// What is wrong with it.
        error: ScenarioError,
    },
    /// The records do not fit into memory together.
    #[error(
        "{count} records take up to {gigabytes:.1} GB together, more than the {:.0} GB allowed: raise \
         simulation.record_every, record nothing but metrics, or run fewer at a time",
        1e-9 * MAX_BYTES as f64
    )]
    TooLarge {
        /// The number of scenarios.
        count: usize,
        /// Memory for all records \[GB\].
        gigabytes: f64,
    },
    /// The system does not give the threads.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// How many were wanted.
        threads: usize,
        /// What the system says.
        reason: String,
    },
}

impl Batch {
    /// Reads, validates and prepares every scenario, on `threads` threads.
    ///
    /// # Errors
    /// With the first scenario that cannot be run, or if all records together are too large.
    pub fn new(documents: &[Table], recorded: bool, threads: usize) -> Result<Self, BatchError> {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads.min(documents.len()).max(1))
            .thread_name(|i| format!("vff-{i}"))
            .build()
            .map_err(|error| BatchError::Threads { threads, reason: error.to_string() })?;
        let rollouts = on_pool(&pool, |parts| {
            let read = |document| parts.within(|| sound(|| Scenario::from_document(document)));
            let scenarios: Vec<_> = documents.par_iter().map(read).collect();
            if recorded {
                fit(scenarios.iter().flatten())?;
            }
            prepare(scenarios, recorded, parts)
        })?;
        Ok(Self { pool, rollouts, recorded })
    }

    /// Runs all of them and returns the outcomes in the order of the scenarios.
    ///
    /// `watch(finished)` is called about every `interval` on the calling thread; when it returns
    /// false, what is not finished is left as it is, as [`Status::Interrupted`].
    pub fn run(self, interval: Duration, mut watch: impl FnMut(usize) -> bool) -> Vec<Rollout> {
        let Self { pool, rollouts, recorded } = self;
        let (stop, finished) = (Arc::new(AtomicBool::new(false)), AtomicUsize::new(0));
        let (over, is_over) = mpsc::channel::<()>();
        let mut done = Vec::with_capacity(rollouts.len());
        pool.in_place_scope(|scope| {
            scope.spawn(|_| {
                let one = |next| {
                    let rollout = roll(next, recorded, &stop);
                    finished.fetch_add(1, Ordering::Relaxed);
                    rollout
                };
                // One at a time: they may differ in length by orders of magnitude.
                done.par_extend(rollouts.into_par_iter().with_max_len(1).map(one));
                drop(over);
            });
            while is_over.recv_timeout(interval) == Err(mpsc::RecvTimeoutError::Timeout) {
                if !watch(finished.load(Ordering::Relaxed)) {
                    stop.store(true, Ordering::Relaxed);
                }
            }
        });
        done
    }
}

/// Makes every scenario ready, or names the first that has a fault, be it an earlier one; those that do not fit into [`READY`] stay
/// scenarios.
fn prepare(
    scenarios: Vec<Result<Scenario, ScenarioError>>,
    recorded: bool,
    parts: &Parts,
) -> Result<Vec<Next>, BatchError> {
    let prepare = |(scenario, stays): (Result<Scenario, _>, bool)| {
        let scenario = scenario?;
        let ready = parts.within(|| sound(|| scenario.prepare_recorded(recorded)))?;
        Ok(if stays { Next::Ready(ready) } else { Next::Sound(Box::new(scenario)) })
    };
    let mut taken = 0.0;
    let stays = |scenario: &Result<Scenario, _>| {
        let numbers = scenario.as_ref().map_or(0.0, Scenario::run_numbers);
        taken += numbers * size_of::<f64>() as f64;
        taken <= READY
    };
    let stay: Vec<_> = scenarios.iter().map(stays).collect();
    let ready: Vec<_> = scenarios.into_par_iter().zip(stay).map(prepare).collect();
    let place = |(index, ready): (usize, Result<_, _>)| {
        ready.map_err(|error| BatchError::Scenario { index, error })
    };
    ready.into_iter().enumerate().map(place).collect()
}

/// The records of all have to fit together.
fn fit<'a>(scenarios: impl Iterator<Item = &'a Scenario>) -> Result<(), BatchError> {
    let sizes = scenarios.map(Scenario::record_bytes);
    let (count, bytes) = sizes.fold((0, 0.0), |(count, sum), size| (count + 1, sum + size));
    // One record alone is validated, with a better message, where it is made.
    if count > 1 && bytes > MAX_BYTES as f64 {
        return Err(BatchError::TooLarge { count, gigabytes: 1e-9 * bytes });
    }
    Ok(())
}

/// One rollout until it is over or told to stop.
fn roll(next: Next, recorded: bool, stop: &Arc<AtomicBool>) -> Rollout {
    let prepared = match next {
        Next::Ready(ready) => Ok(ready),
        Next::Sound(_) if stop.load(Ordering::Relaxed) => Err(None),
        Next::Sound(scenario) => {
            let again = || sound(|| scenario.prepare_recorded(recorded));
            let ready = watched(Watch::Flag(Arc::clone(stop)), again);
            ready.map_or(Err(None), |ready| ready.map_err(Some))
        }
    };
    let Ready { mut run, mut warnings } = match prepared {
        Ok(ready) => ready,
        Err(error) => return not_begun(error),
    };
    let start = Instant::now();
    let steps = || while !stop.load(Ordering::Relaxed) && !run.run_for(LOOK) {};
    // A step that is broken off is not part of the outcome.
    let until_over = watched(Watch::Flag(Arc::clone(stop)), || guarded(steps)).unwrap_or(Ok(()));
    let mut outcome = match until_over {
        Ok(()) => run.outcome(),
        Err(fault) => failed(&run.snapshot(), fault),
    };
    warnings.append(&mut outcome.warnings);
    Rollout { outcome, warnings, wall_time: start.elapsed().as_secs_f64() }
}

/// A rollout that was stopped before it began, or could not be prepared again.
fn not_begun(error: Option<ScenarioError>) -> Rollout {
    let outcome = match error {
        Some(error) => nothing(Status::Failed, error.to_string(), 0.0, Record::default()),
        None => {
            let message = "interrupted at t = 0 s".into();
            nothing(Status::Interrupted, message, 0.0, Record::default())
        }
    };
    Rollout { outcome, warnings: vec![], wall_time: 0.0 }
}

/// The outcome of a rollout that ended in a fault of the program.
fn failed(last: &Snapshot<'_>, message: String) -> Outcome {
    let record = Record { sizes: Sizes::of(last), ..Record::default() };
    nothing(Status::Failed, message, last.t, record)
}

/// An outcome without metrics.
fn nothing(status: Status, message: String, end_time: f64, record: Record) -> Outcome {
    let metrics = METRICS.iter().map(|metric| (metric, Value::None)).collect();
    Outcome { status, message, end_time, metrics, record, replans: vec![], warnings: vec![] }
}

/// The result of `validate`; a panic is a fault, too.
fn sound<T>(validate: impl FnOnce() -> Result<T, ScenarioError>) -> Result<T, ScenarioError> {
    let fault = |text| Err(ScenarioError::new("", Problem::Other(text)));
    guarded(validate).unwrap_or_else(fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVERY: Duration = Duration::from_millis(1);

    fn document(simulation: &str, x: f64) -> Table {
        let text = format!(
            "duration = 0.4\n q0 = [0.3, 0.6, -0.4]\n simulation = {{ {simulation} }}\n\
             arm = {{ lengths = [1, 1, 1], masses = 1 }}\n\
             reference = {{ kind = 'setpoint', point = [{x}, 1.2] }}\n\
             obstacles = [{{ shape = {{ kind = 'circle', radius = 0.1 }}, position = [1, 1.2] }}]"
        );
        text.parse().unwrap()
    }

    fn documents(count: u32) -> Vec<Table> {
        let x = |i| 1.5 + 0.05 * f64::from(i);
        (0..count).map(|i| document("control = 'hold'", x(i))).collect()
    }

    /// Order and bits are those of runs one by one, whatever the number of threads.
    #[test]
    fn the_same_as_one_by_one() {
        let documents = documents(9);
        for threads in [1, 2, 5] {
            let rollouts = Batch::new(&documents, true, threads).unwrap().run(EVERY, |_| true);
            assert_eq!(rollouts.len(), documents.len());
            for (document, rollout) in documents.iter().zip(&rollouts) {
                let mut run = Scenario::from_document(document).unwrap().prepare().unwrap().run;
                while run.step() {}
                let alone = run.outcome();
                assert_eq!(rollout.outcome.record, alone.record);
                assert_eq!(rollout.outcome.metrics, alone.metrics);
                assert_eq!(rollout.outcome.status, alone.status);
            }
        }
    }

    /// Without a record the metrics are the same.
    #[test]
    fn metrics_need_no_record() {
        let all = Batch::new(&documents(3), true, 2).unwrap().run(EVERY, |_| true);
        let none = Batch::new(&documents(3), false, 2).unwrap().run(EVERY, |_| true);
        for (all, none) in all.iter().zip(&none) {
            assert_eq!(all.outcome.metrics, none.outcome.metrics);
            assert_eq!((all.outcome.record.rows, none.outcome.record.rows), (401, 0));
        }
    }

    /// Stopped at once: every rollout is there, and none is called finished that is not.
    #[test]
    fn stopped() {
        let mut long = document("control = 'hold'", 1.5);
        long.insert("duration".into(), toml::Value::Float(1e6));
        let mut documents = documents(2);
        documents.push(long);
        let mut looks = 0;
        let rollouts = Batch::new(&documents, false, 2).unwrap().run(EVERY, |finished| {
            looks += 1;
            finished < 2
        });
        let end = |rollout: &Rollout| rollout.outcome.status == Status::Interrupted;
        assert_eq!(rollouts.iter().map(end).collect::<Vec<_>>(), [false, false, true]);
        assert!(looks > 0 && rollouts[2].outcome.end_time < 1e6);
    }

    /// The fault of the first wrong scenario, by its index, before anything runs.
    #[test]
    fn wrong_scenarios_are_named() {
        let mut documents = documents(6);
        documents[4] = document("dt = -1", 1.5);
        documents[2] = document("control = 'hold'", 9.0);
        let error = Batch::new(&documents, true, 2).unwrap_err();
        assert!(error.to_string().starts_with("[2]: reference: leaves the reach"), "{error}");
    }

    /// 20 records of up to 1.8 GB each are too much, their metrics are not.
    #[test]
    fn records_are_summed() {
        let mut large = document("control = 'hold', dt = 1e-6", 1.5);
        large.insert("duration".into(), toml::Value::Float(2.7));
        let documents = vec![large; 20];
        let error = Batch::new(&documents, true, 2).unwrap_err();
        assert!(error.to_string().starts_with("20 records take up to 37"), "{error}");
        assert!(Batch::new(&documents, false, 2).is_ok());
        assert!(Batch::new(&documents[..2], true, 2).is_ok());
    }

    /// What is prepared again when its turn comes runs as what was ready before.
    #[test]
    fn prepared_again() {
        let stop = Arc::new(AtomicBool::new(false));
        let scenario = Scenario::from_document(&documents(1)[0]).unwrap();
        let ready = Next::Ready(scenario.prepare().unwrap());
        let [a, b] = [ready, Next::Sound(Box::new(scenario.clone()))]
            .map(|next| roll(next, true, &stop).outcome);
        assert_eq!((a.record, a.metrics, a.status), (b.record, b.metrics, b.status));
        stop.store(true, Ordering::Relaxed);
        let stopped = roll(Next::Sound(Box::new(scenario)), true, &stop).outcome;
        assert_eq!((stopped.status, stopped.end_time), (Status::Interrupted, 0.0));
    }

    /// A panic becomes an outcome that says `failed`.
    #[test]
    fn panics_are_caught() {
        let fault = guarded(|| panic!("plain")).unwrap_err();
        let ready = Scenario::from_document(&documents(1)[0]).unwrap().prepare().unwrap();
        let outcome = failed(&ready.run.snapshot(), fault);
        assert_eq!((outcome.status.name(), outcome.record.sizes.joints), ("failed", 3));
    }

    /// A scenario changed after its validation panics where it is prepared: a fault with its index.
    #[test]
    fn a_panic_in_preparation_is_a_fault() {
        let mut scenario = Scenario::from_document(&documents(1)[0]).unwrap();
        let fine = scenario.clone();
        scenario.q0 = vec![0.1];
        let ready = |parts: &Parts| prepare(vec![Ok(fine), Ok(scenario)], true, parts);
        let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let error = on_pool(&pool, ready).unwrap_err();
        assert!(error.to_string().starts_with("[1]: a fault of vffnull itself"), "{error}");
    }
}
