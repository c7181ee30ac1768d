//! How long a control cycle may take: what it has spent so far, and whether there is time for more.
//!
//! In a loop the clock counts. In a simulation the work counts that inner loops [report](crate::interrupt), so that a run
//! repeats bit for bit on every machine. A deadline ends nothing that is needed: distances, the law and the program of `cbf`
//! are bounded by themselves and always come to their end. The look-ahead gets what is left.

use crate::interrupt;
use crate::settings::{Numbers, Ranged};
use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// What stands for no deadline.
pub const UNLIMITED: &str = "unlimited";

/// The share of the period of a loop that a cycle may take where nothing is said.
const SHARE: f64 = 0.3;

/// Work that counts as a microsecond in a simulation: what a core of some 3 GHz reports in that time on the average of
/// look-ahead.
const WORK_PER_MICROSECOND: f64 = 1000.0;

/// How long a control cycle may take, as it is given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Deadline {
    /// As long as it takes.
    Unlimited,
    /// So long \[µs\].
    Micros(f64),
}

impl Ranged for Deadline {
    fn numbers(&self) -> Numbers<'_> {
        match self {
            Self::Unlimited => Numbers::None,
            Self::Micros(micros) => Numbers::One(*micros),
        }
    }
}

impl Serialize for Deadline {
    fn serialize<T: Serializer>(&self, serializer: T) -> Result<T::Ok, T::Error> {
        match self {
            Self::Unlimited => serializer.serialize_str(UNLIMITED),
            Self::Micros(micros) => serializer.serialize_f64(*micros),
        }
    }
}

impl<'de> Deserialize<'de> for Deadline {
    fn deserialize<T: Deserializer<'de>>(deserializer: T) -> Result<Self, T::Error> {
        struct Either;
        impl Visitor<'_> for Either {
            type Value = Deadline;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a number or \"{UNLIMITED}\"")
            }
            fn visit_str<E: Error>(self, given: &str) -> Result<Deadline, E> {
                match given {
                    UNLIMITED => Ok(Deadline::Unlimited),
                    other => Err(E::invalid_value(Unexpected::Str(other), &self)),
                }
            }
            fn visit_f64<E: Error>(self, value: f64) -> Result<Deadline, E> {
                Ok(Deadline::Micros(value))
            }
            #[expect(clippy::cast_precision_loss, reason = "as TOML writes 5 for 5.0")]
            fn visit_i64<E: Error>(self, value: i64) -> Result<Deadline, E> {
                Ok(Deadline::Micros(value as f64))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// By what a cycle is measured.
#[derive(Debug, Clone, Copy)]
pub enum Measure {
    /// Work that was reported on this thread.
    Work,
    /// A clock, which says the time since any instant. One that stalls or steps back measures nothing meanwhile.
    Clock(fn() -> Duration),
}

impl Measure {
    /// The clock of the system, which does not step back.
    pub const SYSTEM: Self = Self::Clock(|| {
        static START: OnceLock<Instant> = OnceLock::new();
        START.get_or_init(Instant::now).elapsed()
    });

    /// Work, or nanoseconds, from an arbitrary start.
    fn read(self) -> u64 {
        match self {
            Self::Work => interrupt::spent() as u64,
            Self::Clock(now) => u64::try_from(now().as_nanos()).unwrap_or(u64::MAX),
        }
    }

    /// What lies between two readings.
    fn between(self, before: u64, after: u64) -> u64 {
        match self {
            Self::Work => after.wrapping_sub(before),
            Self::Clock(_) => after.saturating_sub(before),
        }
    }

    /// Units in a microsecond.
    fn per_microsecond(self) -> f64 {
        match self {
            Self::Work => WORK_PER_MICROSECOND,
            Self::Clock(_) => 1000.0,
        }
    }
}

/// What a run has left out because of a deadline, or of a bound that keeps its cycles short, since it began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeftOut {
    /// Cycles that took longer than the deadline: distances, law and program are always computed.
    pub late: u64,
    /// Cycles in which the look-ahead stopped before what was due, for lack of time.
    pub cut: u64,
    /// Roll-outs that the look-ahead did not make because of that.
    pub rollouts: u64,
    /// Points of clouds that `cbf` took for implied by others because a link has no more than 64.
    pub points: u64,
    /// Programs that ended with constraints left: more than 48 distances were violated at once, or it took too many iterations.
    pub programs: u64,
}

impl LeftOut {
    /// What this and another run have left out together.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self {
            late: self.late + other.late,
            cut: self.cut + other.cut,
            rollouts: self.rollouts + other.rollouts,
            points: self.points + other.points,
            programs: self.programs + other.programs,
        }
    }

    /// Name and count of each.
    pub fn named(&self) -> [(&'static str, u64); 5] {
        let Self { late, cut, rollouts, points, programs } = *self;
        [
            ("late", late),
            ("cut", cut),
            ("rollouts", rollouts),
            ("points", points),
            ("programs", programs),
        ]
    }
}

/// The time of one control cycle after the other.
///
/// ```
/// use std::time::Duration;
/// use vff_core::control::deadline::{Budget, Deadline, LeftOut, Measure};
///
/// // In a loop of 1 kHz, where nothing is said.
/// let mut budget = Budget::of_loop(None, Some(1e-3));
/// budget.begin();
/// assert!(budget.is_left());
/// budget.end();
/// assert!(!Budget::of_loop(Some(Deadline::Unlimited), Some(1e-3)).is_limited());
/// // 100 µs by a clock that stands still.
/// let mut budget = Budget::new(Measure::Clock(|| Duration::ZERO), Some(100.0));
/// budget.begin();
/// assert!(budget.is_left());
/// let left_out = LeftOut { late: budget.late(), ..LeftOut::default() };
/// assert_eq!(left_out.named()[0], ("late", 0));
/// ```
#[derive(Debug, Clone)]
pub struct Budget {
    measure: Measure,
    /// What a cycle may take, in the units of the measure; None without a deadline.
    limit: Option<u64>,
    /// How many share it.
    parts: u64,
    /// What this cycle has taken until it was suspended, and the reading at which it went on.
    used: u64,
    since: u64,
    /// What was taken from the last [`reserve`](Self::reserve) on in the last cycle: as much is kept for the same in this one.
    kept: u64,
    mark: u64,
    late: u64,
}

impl Budget {
    /// Of this many \[µs\].
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive, and the cast of what is too large is the largest number"
    )]
    pub fn new(measure: Measure, micros: Option<f64>) -> Self {
        let limit = micros.map(|micros| (micros * measure.per_microsecond()) as u64);
        Self { measure, limit, parts: 1, used: 0, since: 0, kept: 0, mark: 0, late: 0 }
    }

    /// Of a simulation: by its work; unlimited where nothing is said.
    pub fn of_simulation(deadline: Option<Deadline>) -> Self {
        let micros = match deadline {
            Some(Deadline::Micros(micros)) => Some(micros),
            Some(Deadline::Unlimited) | None => None,
        };
        Self::new(Measure::Work, micros)
    }

    /// Of a loop: by the clock; three tenths of its `period` \[s\] where nothing is said, unlimited where that is not known.
    pub fn of_loop(deadline: Option<Deadline>, period: Option<f64>) -> Self {
        let micros = match deadline {
            Some(Deadline::Micros(micros)) => Some(micros),
            Some(Deadline::Unlimited) => None,
            None => period.map(|period| SHARE * 1e6 * period),
        };
        Self::new(Measure::SYSTEM, micros)
    }

    /// Whether there is a deadline.
    pub fn is_limited(&self) -> bool {
        self.limit.is_some()
    }

    /// Cycles that took longer than the deadline.
    pub fn late(&self) -> u64 {
        self.late
    }

    /// So many laws share a cycle from now on, a part each.
    pub fn share(&mut self, parts: u64) {
        self.parts = parts;
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        (self.used, self.kept, self.late) = (0, 0, 0);
    }

    /// A cycle begins.
    #[inline]
    pub fn begin(&mut self) {
        self.used = 0;
        self.go_on();
    }

    /// It is suspended: somebody else has the time from now on.
    #[inline]
    pub fn suspend(&mut self) {
        if self.is_limited() {
            self.used = self.taken();
        }
    }

    /// It goes on.
    #[inline]
    pub fn go_on(&mut self) {
        if self.is_limited() {
            self.since = self.measure.read();
        }
    }

    /// It goes on with what cannot be left out, for which time is kept in the next cycle.
    #[inline]
    pub fn reserve(&mut self) {
        self.go_on();
        self.mark = self.used;
    }

    /// It is over.
    #[inline]
    pub fn end(&mut self) {
        if let Some(limit) = self.limit {
            self.used = self.taken();
            self.kept = self.used - self.mark;
            self.late += u64::from(self.used > limit / self.parts);
        }
    }

    /// Whether there is time left for what can be left out.
    #[inline]
    pub fn is_left(&self) -> bool {
        self.limit.is_none_or(|limit| self.taken().saturating_add(self.kept) < limit / self.parts)
    }

    /// What this cycle has taken until now.
    fn taken(&self) -> u64 {
        self.used.saturating_add(self.measure.between(self.since, self.measure.read()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Time is left until the deadline less what the last cycle took for what cannot be left out; what others do while a cycle
    /// is suspended does not count.
    #[test]
    fn the_rest_of_a_cycle_is_kept() {
        let mut budget = Budget::new(Measure::Work, Some(10.0));
        for (kept, late) in [(0, 0), (3000, 1), (3000, 1)] {
            budget.begin();
            interrupt::checkpoint(2000);
            budget.suspend();
            interrupt::checkpoint(50_000);
            budget.go_on();
            assert!(budget.is_left());
            interrupt::checkpoint(7999 - kept);
            assert!(budget.is_left());
            interrupt::checkpoint(1);
            assert!(!budget.is_left());
            budget.suspend();
            budget.reserve();
            interrupt::checkpoint(3000);
            assert_eq!(budget.late(), late);
            budget.end();
            assert_eq!(budget.kept, 3000);
        }
        assert_eq!(budget.late(), 1);
    }

    /// A clock that stalls or steps back gives time, never takes it, and breaks nothing.
    #[test]
    fn a_clock_may_do_anything() {
        static NOW: AtomicU64 = AtomicU64::new(0);
        let clock = Measure::Clock(|| Duration::from_nanos(NOW.load(Ordering::Relaxed)));
        let mut budget = Budget::new(clock, Some(10.0));
        let set = |micros: u64| NOW.store(1000 * micros, Ordering::Relaxed);
        set(1_000_000);
        budget.begin();
        assert!(budget.is_left()); // it stalls
        set(5); // it is set back
        assert!(budget.is_left());
        budget.suspend();
        budget.reserve();
        set(14);
        assert!(budget.is_left());
        set(15);
        assert!(!budget.is_left());
        set(0);
        budget.end();
        assert_eq!((budget.late(), budget.kept), (0, 0));
        set(0);
        budget.begin();
        set(u64::MAX / 1000); // and far ahead
        assert!(!budget.is_left());
        budget.reserve();
        budget.end();
        budget.begin();
        assert!(budget.is_left());
    }

    #[test]
    fn nothing_is_limited_where_nothing_is_known() {
        let micros = Some(Deadline::Micros(1.0));
        for (budget, limited) in [
            (Budget::of_simulation(None), false),
            (Budget::of_simulation(Some(Deadline::Unlimited)), false),
            (Budget::of_simulation(micros), true),
            (Budget::of_loop(None, None), false),
            (Budget::of_loop(None, Some(1e-3)), true),
            (Budget::of_loop(Some(Deadline::Unlimited), Some(1e-3)), false),
            (Budget::of_loop(micros, None), true),
        ] {
            assert_eq!(budget.is_limited(), limited);
        }
        assert_eq!(Budget::of_loop(None, Some(1e-3)).limit, Some(300_000));
        assert_eq!(Budget::of_simulation(micros).limit, Some(1000));
    }
}
