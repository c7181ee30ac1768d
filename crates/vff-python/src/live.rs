//! `Live`: a scenario that runs against the wall clock on a thread of its own, under people's hands.

use crate::convert::{array1, array2, document, named_document, read_vector};
use crate::errors::{self, InputError};
use crate::run::arrays;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use vff_core::runtime::live::{self, State};
use vff_core::scenario::{self, Scenario};
use vff_core::simulation::RecordTooLarge;

/// A closed loop at 1 kHz that threads may share. The loop itself never needs the GIL.
#[pyclass(frozen, module = "vffnull")]
pub struct Live {
    live: Arc<Mutex<live::Live>>,
    stop: Arc<AtomicBool>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Live {
    fn lock(&self) -> MutexGuard<'_, live::Live> {
        live::lock(&self.live)
    }

    fn thread(&self) -> MutexGuard<'_, Option<JoinHandle<()>>> {
        self.thread.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Live {
    #[new]
    fn new(scenario: &Bound<'_, PyAny>) -> PyResult<Self> {
        let scenario = Scenario::from_document(&document(scenario)?)
            .map_err(|error| errors::scenario(&error))?;
        let live = live::Live::new(&scenario).map_err(|error| errors::scenario(&error))?;
        Ok(Self {
            live: Arc::new(Mutex::new(live)),
            stop: Arc::new(AtomicBool::new(false)),
            thread: Mutex::new(None),
        })
    }

    /// Begins to run, or goes on after a pause.
    fn start(&self) -> PyResult<()> {
        self.lock().pause(false);
        let mut thread = self.thread();
        if thread.is_none() {
            self.stop.store(false, Ordering::Relaxed);
            let (live, stop) = (Arc::clone(&self.live), Arc::clone(&self.stop));
            let serve = move || live::serve(&live, &stop);
            *thread = Some(thread::Builder::new().name("vffnull-live".into()).spawn(serve)?);
        }
        Ok(())
    }

    fn pause(&self) {
        self.lock().pause(true);
    }

    fn reset(&self) -> PyResult<()> {
        self.lock().reset().map_err(|error| errors::scenario(&error))
    }

    /// Ends the thread.
    fn stop(&self, py: Python<'_>) {
        self.stop.store(true, Ordering::Relaxed);
        let thread = self.thread().take();
        py.detach(|| thread.map(JoinHandle::join));
    }

    fn configure(&self, controller: &Bound<'_, PyAny>) -> PyResult<()> {
        let table = named_document("controller", controller)?;
        let mut live = self.lock();
        scenario::read_settings(&table, live.arm())
            .map_err(|error| error.inside("controller"))
            .and_then(|settings| live.configure(settings))
            .map_err(|error| errors::scenario(&error))
    }

    fn carry(&self, obstacle: usize, place: &Bound<'_, PyAny>) -> PyResult<()> {
        let place = point(place)?;
        self.lock().carry(obstacle, place).map_err(|error| errors::scenario(&error))
    }

    fn aim(&self, place: &Bound<'_, PyAny>) -> PyResult<()> {
        let place = point(place)?;
        self.lock().aim(place);
        Ok(())
    }

    fn add(&self, obstacle: &Bound<'_, PyAny>) -> PyResult<()> {
        let table = named_document("obstacle", obstacle)?;
        let obstacle = scenario::read_obstacle(&table)
            .map_err(|error| errors::scenario(&error.inside("obstacle")))?;
        self.lock().add(&obstacle);
        Ok(())
    }

    fn remove(&self, obstacle: usize) -> PyResult<()> {
        self.lock().remove(obstacle).map_err(|error| errors::scenario(&error))
    }

    fn record(&self, on: bool) -> PyResult<()> {
        self.lock().record(on).map_err(too_large)
    }

    /// The rows recorded since the last call, or None, and how many were lost.
    fn take<'py>(&self, py: Python<'py>) -> PyResult<(Option<Bound<'py, PyDict>>, u64)> {
        let (record, dropped) = self.lock().take().map_err(too_large)?;
        Ok((record.map(|record| arrays(py, record)).transpose()?, dropped))
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.lock().notes.clone()
    }

    /// The present instant.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut live = self.lock();
        let (stats, min_clearance) = (live.stats(), live.min_clearance());
        let (status, message) = match live.state() {
            State::Running => ("running", ""),
            State::Paused => ("paused", ""),
            State::Diverged => ("diverged", "the next state would not be finite"),
            State::Failed(fault) => ("failed", fault.as_str()),
        };
        let state = PyDict::new(py);
        state.set_item("status", status)?;
        state.set_item("message", message)?;
        state.set_item("rate", stats.rate)?;
        state.set_item("periods", stats.periods)?;
        state.set_item("missed", stats.missed)?;
        state.set_item("worst", stats.worst)?;
        state.set_item("min_clearance", min_clearance)?;
        state.set_item("recording", live.is_recording())?;
        let pushes = live.pushes();
        let column = |k: usize| -> Vec<f64> {
            pushes.iter().flat_map(|push| [push[k].x, push[k].y]).collect()
        };
        let pairs = |values: Vec<f64>| -> PyResult<Bound<'py, PyArray2<f64>>> {
            let rows = values.len() / 2;
            array2(py, values, [rows, 2])
        };
        state.set_item("points", pairs(column(0))?)?;
        state.set_item("forces", pairs(column(1))?)?;
        let s = live.snapshot();
        state.set_item("obstacles", pairs(s.obstacles().flat_map(|p| [p.x, p.y]).collect())?)?;
        state.set_item("t", s.t)?;
        let arrays = [
            ("q", s.q),
            ("dq", s.dq),
            ("x", s.x),
            ("x_ref", s.x_ref),
            ("error", s.error),
            ("clearance", s.clearance),
            ("tau", &s.torque.total),
            ("tau_vff", s.tau_vff),
            ("power", &s.power.values()),
        ];
        for (name, values) in arrays {
            let values: Bound<'_, PyArray1<f64>> = array1(py, values);
            state.set_item(name, values)?;
        }
        Ok(state)
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        // The thread sees it within a millisecond and needs nothing of Python to end.
        self.stop.store(true, Ordering::Relaxed);
    }
}

fn point(place: &Bound<'_, PyAny>) -> PyResult<[f64; 2]> {
    let mut point = [0.0; 2];
    read_vector("place", place, &mut point)?;
    Ok(point)
}

#[expect(clippy::needless_pass_by_value, reason = "used by map_err")]
fn too_large(error: RecordTooLarge) -> PyErr {
    InputError::new_err(error.to_string())
}
