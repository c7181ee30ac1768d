//! The closed loop against the wall clock, on a thread of its own.
#![expect(clippy::needless_pass_by_value, reason = "Python hands documents over by value")]

use crate::convert::document;
use crate::errors::{self, InputError};
use crate::loading::load_numpy;
use crate::scheduling::{core_id, request_scheduling};
use crate::watch::{SIGNALS, Watch, interruptible};
use numpy::PyArray1;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::{panic, thread};
use vff_core::interrupt;
use vff_core::runtime::real_time::{RealTime, Report};
use vff_core::scenario::{Scenario, ScenarioError};
use vff_core::simulation::pace::Timing;

/// Run a scenario document against the wall clock on a thread of its own, with the GIL released.
///
/// Parameters
/// ----------
/// document : Mapping
///     The scenario.
/// rate : float
///     Control periods per second [Hz].
/// seconds : float
///     How long [s].
/// priority : int, optional
///     Priority of SCHED_FIFO, 1 to 99.
/// core : int, optional
///     The core to stay on.
/// progress : callable, optional
///     Gets the number of periods done and the number of all about every 100 ms.
///
/// Returns
/// -------
/// dict
///     ``status``, ``rate`` [Hz], ``dt`` [s], ``periods``, ``missed``, ``restarts``, ``min_clearance`` [m],
///     ``notes``; ``latency``, ``step``, ``response``, ``jitter``: times [s] and how often each.
#[pyfunction]
#[pyo3(signature = (document, rate, seconds, priority=None, core=None, progress=None))]
pub fn real_time<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = document)] document: toml::Table,
    rate: f64,
    seconds: f64,
    priority: Option<u8>,
    core: Option<usize>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    load_numpy(py)?;
    // The rate and the seconds are no keys of the scenario.
    let fault = |error: ScenarioError| match error.path.as_str() {
        "rate" | "seconds" => InputError::new_err(error.to_string()),
        _ => errors::scenario(&error),
    };
    let prepare =
        || Scenario::from_document(&document).and_then(|scenario| RealTime::new(&scenario, rate));
    let ready = interruptible(py, prepare)?.map_err(fault)?;
    let count = ready.periods(seconds).map_err(fault)?;
    let core = core.map(core_id).transpose()?;
    let dt = ready.dt();
    let mut notes = ready.notes.clone();

    let (stop, done) = (Arc::new(AtomicBool::new(false)), AtomicU64::new(0));
    let mut watch = Watch::new(progress);
    let (report, refused) = py.detach(|| {
        let (over, is_over) = mpsc::channel::<()>();
        let (stop, done) = (&stop, &done);
        thread::scope(|scope| {
            let worker = scope.spawn(move || {
                let refused = request_scheduling(priority, core);
                let flag = interrupt::Watch::Flag(Arc::clone(stop));
                let report = interrupt::watched(flag, || ready.run(count, stop, done));
                drop(over);
                (report, refused)
            });
            while is_over.recv_timeout(SIGNALS) == Err(mpsc::RecvTimeoutError::Timeout) {
                if !watch.is_wanted(done.load(Ordering::Relaxed), count) {
                    stop.store(true, Ordering::Relaxed);
                }
            }
            worker.join().unwrap_or_else(|fault| panic::resume_unwind(fault))
        })
    });
    let done = done.into_inner();
    // Of a period that was broken off there is no report.
    let total = if report.is_ok() { count } else { done };
    watch.end(py, done, total)?;
    let Ok(report) = report else { return Err(PyKeyboardInterrupt::new_err(())) };
    notes.extend(refused);

    let Report { status, timing, restarts, min_clearance } = report;
    let result = PyDict::new(py);
    result.set_item("status", status.name())?;
    result.set_item("rate", rate)?;
    result.set_item("dt", dt)?;
    result.set_item("periods", done)?;
    result.set_item("missed", timing.missed)?;
    result.set_item("restarts", restarts)?;
    result.set_item("min_clearance", min_clearance.is_finite().then_some(min_clearance))?;
    result.set_item("notes", notes)?;
    put_times(py, &result, timing)?;
    Ok(result)
}

/// Puts the histograms of a measurement into a dict: times \[s\] and how often each.
pub fn put_times(py: Python<'_>, result: &Bound<'_, PyDict>, timing: Timing) -> PyResult<()> {
    let histograms = [
        ("latency", timing.latency),
        ("step", timing.work),
        ("response", timing.response),
        ("jitter", timing.jitter),
    ];
    for (name, histogram) in histograms {
        #[expect(clippy::cast_precision_loss, reason = "times of three digits")]
        let seconds = |value: u64| 1e-9 * value as f64;
        let bins = || histogram.iter_recorded();
        let values = PyArray1::from_iter(py, bins().map(|bin| seconds(bin.value_iterated_to())));
        let counts = PyArray1::from_iter(py, bins().map(|bin| bin.count_at_value()));
        result.set_item(name, (values, counts))?;
    }
    Ok(())
}
