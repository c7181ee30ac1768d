//! The closed loop of a scenario against the wall clock.

use super::run::AnyRun;
use crate::scenario::{Problem, Scenario, ScenarioError};
use crate::simulation::pace::{self, Late, Timing};
use crate::simulation::{Control, Options, Status};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// The rates that are accepted \[Hz\].
const RATES: std::ops::RangeInclusive<f64> = 0.1..=1e6;
/// The most periods of one measurement.
const MAX_PERIODS: f64 = 1e12;

/// A closed loop that takes one control period per period of the clock.
///
/// # Example
/// ```
/// use std::sync::atomic::{AtomicBool, AtomicU64};
/// use vff_core::runtime::real_time::{RealTime, Report};
/// use vff_core::scenario::Scenario;
/// use vff_core::simulation::Status;
/// use vff_core::simulation::pace::Timing;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     "#,
/// )?;
/// let loop_ = RealTime::new(&scenario, 1000.0)?;
/// let Report { status, timing, .. } = loop_.run(20, &AtomicBool::new(false), &AtomicU64::new(0));
/// let timing: Timing = timing;
/// assert_eq!((status, timing.work.len() > 0), (Status::Completed, true));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct RealTime {
    run: AnyRun,
    options: Options,
    /// Control periods until the scenario begins again.
    periods: u64,
    rate: f64,
    /// What was changed or is odd, in sentences.
    pub notes: Vec<String>,
}

/// How a measurement ended.
#[derive(Debug, Clone)]
pub struct Report {
    /// Completed, collided, diverged or interrupted.
    pub status: Status,
    /// Times of every period.
    pub timing: Timing,
    /// How often the scenario began again.
    pub restarts: u64,
    /// Smallest surface distance between a link and an obstacle \[m\], +∞ without obstacles.
    pub min_clearance: f64,
}

impl RealTime {
    /// The scenario at `rate` \[Hz\] of control.
    ///
    /// The step of the plant is made smaller where it does not divide the period; a continuous law
    /// is held over the period, as every law on a computer is.
    ///
    /// # Errors
    /// If the scenario cannot be run at this rate.
    pub fn new(scenario: &Scenario, rate: f64) -> Result<Self, ScenarioError> {
        if !RATES.contains(&rate) {
            let requirement = format!("from {} to {:e} Hz", RATES.start(), RATES.end());
            return Err(ScenarioError::out_of_range("rate", &requirement, rate));
        }
        let (scenario, mut notes) = at_rate(scenario, rate);
        let period = 1.0 / rate;
        if scenario.duration < period {
            let requirement = format!("at least one control period of {period} s");
            return Err(ScenarioError::out_of_range("duration", &requirement, scenario.duration));
        }
        scenario.validate()?;
        let options = scenario.simulation.clone();
        let periods = (options.steps(scenario.duration) / options.control_every).max(1) as u64;
        let ready = scenario.prepare_recorded(false)?;
        notes.extend(ready.warnings);
        Ok(Self { run: ready.run, options, periods, rate, notes })
    }

    /// The step of the plant \[s\].
    pub fn dt(&self) -> f64 {
        self.options.dt
    }

    /// The number of control periods in `seconds`.
    ///
    /// # Errors
    /// If there is none, or more than can be counted.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "validated here")]
    pub fn periods(&self, seconds: f64) -> Result<u64, ScenarioError> {
        let count = (seconds * self.rate).round();
        if (1.0..=MAX_PERIODS).contains(&count) {
            return Ok(count as u64);
        }
        let problem = format!(
            "must be from one period of {} s to {MAX_PERIODS:e} of them, got {seconds}",
            1.0 / self.rate
        );
        Err(ScenarioError::new("seconds", Problem::Other(problem)))
    }

    /// Runs `count` control periods, or fewer when `stop` is set; counts them in `done`.
    /// At its end the scenario begins again. Nothing allocates but the histograms, before the start.
    pub fn run(mut self, count: u64, stop: &AtomicBool, done: &AtomicU64) -> Report {
        let mut timing = Timing::default();
        let (mut left, mut restarts, mut sound) = (self.periods, 0, true);
        let mut collided = self.run.snapshot().collides();
        let nearest =
            |run: &AnyRun| run.snapshot().clearance.iter().copied().fold(f64::INFINITY, f64::min);
        let mut min_clearance = nearest(&self.run);
        let period = Duration::from_secs_f64(1.0 / self.rate);
        pace::keep(&mut timing, period, Late::CatchUp, count, stop, done, || {
            if left == 0 {
                self.run.restart();
                left = self.periods;
                restarts += 1;
            }
            left -= 1;
            sound = (0..self.options.control_every).all(|_| self.run.advance(None));
            min_clearance = min_clearance.min(nearest(&self.run));
            collided |= self.run.snapshot().collides();
            sound
        });
        let status = match (sound, done.load(Ordering::Relaxed) == count) {
            (false, _) => Status::Diverged,
            (true, false) => Status::Interrupted,
            (true, true) if collided => Status::Collided,
            (true, true) => Status::Completed,
        };
        Report { status, timing, restarts, min_clearance }
    }
}

/// The scenario with one control period per period of the clock, and what was changed for it.
pub(super) fn at_rate(scenario: &Scenario, rate: f64) -> (Scenario, Vec<String>) {
    let mut scenario = scenario.clone();
    let mut notes = vec![];
    let (given, period) = (scenario.simulation.dt, 1.0 / rate);
    let options = &mut scenario.simulation;
    options.control_every = steps_per_period(period, given);
    #[expect(clippy::cast_precision_loss, reason = "few steps")]
    let dt = period / options.control_every as f64;
    options.dt = dt;
    if (dt - given).abs() > 1e-9 * given {
        notes.push(format!(
            "simulation.dt: the plant takes {} of its steps per control period at {rate} Hz, which are \
             shorter than {given} s",
            options.control_every
        ));
    }
    if options.control == Control::Continuous {
        options.control = Control::Hold;
        notes.push("simulation.control: held over the period instead of continuous".into());
    }
    (scenario, notes)
}

/// The fewest steps of a period that are no longer than `dt`; one of 1.000 000 001 dt is.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a bounded ratio")]
fn steps_per_period(period: f64, dt: f64) -> usize {
    (period / dt * (1.0 - 1e-9)).ceil().clamp(1.0, 1e9) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scenario(simulation: &str) -> Scenario {
        let text = format!(
            "duration = 0.05\n q0 = [0.3, 0.6, -0.4]\n simulation = {{ {simulation} }}\n\
             arm = {{ lengths = [1, 1, 1], masses = 1 }}\n\
             reference = {{ kind = 'setpoint', point = [1.5, 1.2] }}\n\
             obstacles = [{{ shape = {{ kind = 'circle', radius = 0.1 }}, position = [1, 1.2] }}]"
        );
        Scenario::from_toml(&text).unwrap()
    }

    /// The step divides the period and is never longer than the scenario's; a change is said.
    #[test]
    fn the_step_fits_the_period() {
        for (dt, rate, every, notes) in
            [(1e-3, 1000.0, 1, 0), (1e-3, 100.0, 10, 0), (1e-3, 4000.0, 1, 1), (1e-3, 300.0, 4, 1)]
        {
            let real_time = RealTime::new(&scenario(&format!("dt = {dt}")), rate).unwrap();
            assert_eq!(real_time.options.control_every, every, "{dt} s at {rate} Hz");
            assert!((real_time.options.control_period() * rate - 1.0).abs() < 1e-12);
            assert_eq!(real_time.notes.len(), notes, "{:?}", real_time.notes);
        }
    }

    /// 120 periods of 1 ms of a scenario of 50: it begins again twice, and stands where a run of 20
    /// steps stands.
    #[test]
    fn it_starts_over() {
        let (stop, done) = (AtomicBool::new(false), AtomicU64::new(0));
        let real_time = RealTime::new(&scenario("dt = 1e-3"), 1000.0).unwrap();
        let report = real_time.run(120, &stop, &done);
        assert_eq!(
            (report.status, report.restarts, done.into_inner()),
            (Status::Completed, 2, 120)
        );
        assert_eq!(report.timing.work.len(), 120);

        let mut alone = scenario("dt = 1e-3").prepare().unwrap().run;
        let mut again = scenario("dt = 1e-3").prepare().unwrap().run;
        (0..50).for_each(|_| _ = again.advance(None));
        again.restart();
        for _ in 0..20 {
            assert!(alone.advance(None) && again.advance(None));
        }
        assert_eq!(alone.snapshot().q, again.snapshot().q);
        assert_eq!(alone.snapshot().torque.total, again.snapshot().torque.total);
    }

    /// What cannot be: a rate out of range, a scenario shorter than one period, no period at all.
    #[test]
    fn wrong_rates() {
        let fault = |rate| RealTime::new(&scenario("dt = 1e-3"), rate).unwrap_err().to_string();
        assert!(fault(0.0).starts_with("rate: must be from 0.1"), "{}", fault(0.0));
        assert!(fault(f64::NAN).starts_with("rate: "));
        assert!(fault(10.0).starts_with("duration: must be at least one control period of 0.1 s"));
        let real_time = RealTime::new(&scenario("dt = 1e-3"), 1000.0).unwrap();
        for seconds in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(real_time.periods(seconds).is_err());
        }
    }
}
