//! Work at a fixed rate against the wall clock, and how well it was kept.

use hdrhistogram::Histogram;
use std::hint;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// The last part of every wait is spent spinning: a sleep ends late by about that much.
const SPIN: Duration = Duration::from_micros(150);
/// A longer wait is made of several of this length, so that it can be ended.
const SLEEP: Duration = Duration::from_millis(50);
/// Longer than this is counted as this.
const LONGEST: Duration = Duration::from_secs(100);

/// Times of every period, in histograms of three digits.
#[derive(Debug, Clone)]
pub struct Timing {
    /// From the instant at which a period should begin to when it did \[ns\].
    pub latency: Histogram<u64>,
    /// How long the work took \[ns\].
    pub work: Histogram<u64>,
    /// From the instant at which a period should begin to the end of its work \[ns\].
    pub response: Histogram<u64>,
    /// How far the time between two beginnings was off the period \[ns\].
    pub jitter: Histogram<u64>,
    /// Periods whose work did not end before the next one should begin.
    pub missed: u64,
    /// Periods that were left out, because they were over before they could begin.
    pub skipped: u64,
}

impl Default for Timing {
    fn default() -> Self {
        let longest = nanoseconds(LONGEST);
        let histogram =
            || Histogram::new_with_bounds(1, longest, 3).expect("bounds that a histogram can have");
        let (latency, work) = (histogram(), histogram());
        Self { latency, work, response: histogram(), jitter: histogram(), missed: 0, skipped: 0 }
    }
}

/// What becomes of periods that are over before they could begin.
///
/// # Example
/// ```
/// use std::sync::atomic::{AtomicBool, AtomicU64};
/// use std::time::Duration;
/// use vff_core::simulation::pace::{Late, Timing, keep};
///
/// let (mut timing, mut count) = (Timing::default(), 0);
/// let work = || {
///     count += 1;
///     true
/// };
/// let (stop, done) = (AtomicBool::new(false), AtomicU64::new(0));
/// keep(&mut timing, Duration::from_micros(100), Late::CatchUp, 5, &stop, &done, work);
/// assert_eq!(count, 5);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Late {
    /// They are done at once, until the clock is caught up with: nothing is left out of what is computed.
    CatchUp,
    /// They are left out: a robot has only its present state to tell.
    Skip,
}

/// Does `work` once per `period`, `count` times, until it returns false or `stop` is set, and
/// counts in `done`.
///
/// The deadlines are absolute, so that delays do not add up. Nothing allocates.
pub fn keep(
    timing: &mut Timing,
    period: Duration,
    late: Late,
    count: u64,
    stop: &AtomicBool,
    done: &AtomicU64,
    mut work: impl FnMut() -> bool,
) {
    let mut deadline = Instant::now() + period;
    let mut last_begin = None;
    for k in 0..count {
        let Some(begin) = wait_until(deadline, stop) else { return };
        let goes_on = work();
        let end = Instant::now();
        timing.latency.saturating_record(nanoseconds(begin - deadline));
        timing.work.saturating_record(nanoseconds(end - begin));
        timing.response.saturating_record(nanoseconds(end - deadline));
        if let Some(last) = last_begin.replace(begin) {
            timing.jitter.saturating_record(nanoseconds((begin - last).abs_diff(period)));
        }
        deadline += period;
        timing.missed += u64::from(end > deadline);
        if late == Late::Skip && end > deadline {
            let behind = (end - deadline).as_nanos() / period.as_nanos().max(1);
            let left_out = u32::try_from(behind).unwrap_or(u32::MAX).saturating_add(1);
            deadline += period * left_out;
            timing.skipped += u64::from(left_out);
        }
        done.store(k + 1, Ordering::Relaxed);
        if !goes_on {
            return;
        }
    }
}

/// Does `work` `count` times, until it returns false, where the clock is somebody else's: `work` waits for it, and tells when
/// that has come. Nothing allocates.
///
/// There is no instant at which a period should begin, and hence no latency; a response takes as long as the work.
pub fn accompany(
    timing: &mut Timing,
    period: Duration,
    count: u64,
    done: &AtomicU64,
    mut work: impl FnMut() -> (Instant, bool),
) {
    let mut last_begin = None;
    for k in 0..count {
        let (begin, goes_on) = work();
        let took = begin.elapsed();
        timing.work.saturating_record(nanoseconds(took));
        timing.response.saturating_record(nanoseconds(took));
        if let Some(last) = last_begin.replace(begin) {
            timing.jitter.saturating_record(nanoseconds((begin - last).abs_diff(period)));
        }
        timing.missed += u64::from(took > period);
        done.store(k + 1, Ordering::Relaxed);
        if !goes_on {
            return;
        }
    }
}

/// Sleeps, then spins. Returns the instant of waking up, or none when `stop` is set.
pub(crate) fn wait_until(deadline: Instant, stop: &AtomicBool) -> Option<Instant> {
    loop {
        if stop.load(Ordering::Relaxed) {
            return None;
        }
        let left = deadline.saturating_duration_since(Instant::now()).saturating_sub(SPIN);
        if left.is_zero() {
            break;
        }
        thread::sleep(left.min(SLEEP));
    }
    loop {
        let now = Instant::now();
        if now >= deadline {
            return Some(now);
        }
        hint::spin_loop();
    }
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keep_for(count: u64, work: impl FnMut() -> bool) -> (Timing, u64) {
        let (mut timing, done) = (Timing::default(), AtomicU64::new(0));
        let (period, never) = (Duration::from_millis(2), AtomicBool::new(false));
        keep(&mut timing, period, Late::CatchUp, count, &never, &done, work);
        (timing, done.into_inner())
    }

    /// Fifty periods of 2 ms take 100 ms, never less, and each is counted once.
    #[test]
    fn the_clock_is_kept() {
        let start = Instant::now();
        let (timing, done) = keep_for(50, || true);
        assert!(start.elapsed() >= Duration::from_millis(100));
        assert_eq!((done, timing.latency.len(), timing.work.len()), (50, 50, 50));
        assert_eq!(timing.jitter.len(), 49);
    }

    /// Work of 5 ms in periods of 2 ms: every deadline is missed, by more and more; it is caught up
    /// with at once, without waiting.
    #[test]
    fn too_much_work() {
        let work = Duration::from_millis(5);
        let (timing, _) = keep_for(10, || {
            thread::sleep(work);
            true
        });
        assert_eq!(timing.missed, 10);
        let last = Duration::from_nanos(timing.response.max());
        assert!(last >= 10 * work - 9 * Duration::from_millis(2), "{last:?}");
    }

    /// Where the clock is another's, work counts from the instant at which that has come.
    #[test]
    fn the_clock_of_another() {
        let (mut timing, done) = (Timing::default(), AtomicU64::new(0));
        let period = Duration::from_millis(2);
        let mut left = 5;
        accompany(&mut timing, period, 50, &done, || {
            thread::sleep(Duration::from_millis(1));
            let begin = Instant::now();
            left -= 1;
            if left == 2 {
                thread::sleep(2 * period);
            }
            (begin, left > 0)
        });
        assert_eq!((done.into_inner(), timing.work.len(), timing.jitter.len()), (5, 5, 4));
        assert_eq!((timing.latency.len(), timing.response.len()), (0, 5));
        assert!(timing.missed >= 1 && timing.work.max() >= nanoseconds(2 * period));
    }

    /// Work of 5 ms in periods of 2 ms, whose next deadlines are those of the clock: two of three are left out, and
    /// counted.
    #[test]
    fn what_is_late_is_left_out() {
        let (mut timing, done) = (Timing::default(), AtomicU64::new(0));
        let (period, never) = (Duration::from_millis(2), AtomicBool::new(false));
        let mut begins = vec![];
        keep(&mut timing, period, Late::Skip, 10, &never, &done, || {
            begins.push(Instant::now());
            thread::sleep(Duration::from_millis(5));
            true
        });
        assert_eq!(done.into_inner(), 10);
        assert!(timing.missed == 10 && timing.skipped >= 20, "{}", timing.skipped);
        assert!(begins.windows(2).all(|pair| pair[1] - pair[0] >= Duration::from_millis(5)));
        // From one deadline to the next are whole periods, whatever the work takes.
        let first = Duration::from_nanos(timing.latency.max()); // no less than that of the first
        let took = begins[9] - begins[0] + first;
        assert!(took >= 9 * 3 * period - period / 2, "{took:?}");
    }

    /// It ends when the work says so, and before it begins when stopped.
    #[test]
    fn it_can_be_ended() {
        let mut left = 7;
        let (_, done) = keep_for(50, || {
            left -= 1;
            left > 0
        });
        assert_eq!(done, 7);
        let (mut timing, done) = (Timing::default(), AtomicU64::new(0));
        let stop = AtomicBool::new(true);
        keep(&mut timing, Duration::from_secs(1000), Late::Skip, 5, &stop, &done, || true);
        assert_eq!((done.into_inner(), timing.work.len()), (0, 0));
    }

    /// A wait of 1000 s ends when it is told to from another thread.
    #[test]
    fn a_long_wait_can_be_ended() {
        let (stop, done) = (AtomicBool::new(false), AtomicU64::new(0));
        thread::scope(|scope| {
            scope.spawn(|| {
                thread::sleep(Duration::from_millis(20));
                stop.store(true, Ordering::Relaxed);
            });
            let (timing, period) = (&mut Timing::default(), Duration::from_secs(1000));
            keep(timing, period, Late::Skip, 5, &stop, &done, || true);
        });
        assert_eq!(done.into_inner(), 0);
    }
}
