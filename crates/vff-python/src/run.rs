//! Whole runs and the validation of documents.
#![expect(clippy::needless_pass_by_value, reason = "Python hands documents over by value")]

use crate::convert::{self, array2, document, instead, named_document, table_to_dict, wrong_type};
use crate::errors::{self, InputError};
use crate::loading::load_numpy;
use crate::watch::{PROGRESS, SIGNALS, Watch, abandonable, interruptible, stepwise};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use std::num::NonZero;
use std::thread::available_parallelism;
use std::time::Instant;
use vff_core::runtime::batch::{Batch, BatchError, Rollout};
use vff_core::simulation::{Array, Metric, Record, Replanned, Status, Value};
use vff_core::{
    control::settings,
    interrupt,
    planning::feasibility,
    runtime,
    scenario::{self, Part, Scenario, ScenarioError},
};

/// A scenario of a document, made by `prepare`; both may be interrupted.
pub fn prepared<T: Send>(
    py: Python<'_>,
    document: &toml::Table,
    prepare: impl FnOnce(Scenario) -> Result<T, ScenarioError> + Send,
) -> PyResult<T> {
    load_numpy(py)?;
    let done = interruptible(py, || Scenario::from_document(document).and_then(prepare))?;
    done.map_err(|error| errors::scenario(&error))
}

/// Run a scenario document from start to end, with the GIL released.
///
/// Parameters
/// ----------
/// document : Mapping
///     The scenario.
/// progress : callable, optional
///     Gets the simulated time and the duration [s] about every 100 ms.
///
/// Returns
/// -------
/// dict
///     ``status``, ``message``, ``end_time`` [s], ``wall_time`` [s], ``warnings``, ``metrics``, ``replans``,
///     ``record``.
///     After Ctrl-C the status is ``"interrupted"`` and the record holds what was computed until then.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the scenario cannot be run.
#[pyfunction]
#[pyo3(signature = (document, progress=None))]
pub fn run<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = document)] document: toml::Table,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (ready, duration) =
        prepared(py, &document, |scenario| Ok((scenario.prepare()?, scenario.duration)))?;
    let (mut run, start) = (ready.run, Instant::now());
    let mut told = start;
    loop {
        let (over, mut heard) = stepwise(py, || run.run_for(SIGNALS));
        // A step that was broken off is not part of the result.
        let over = over.is_some_and(|over| over);
        heard = heard.and_then(|()| py.check_signals());
        if let Some(progress) = progress
            && (over || told.elapsed() >= PROGRESS)
        {
            told = Instant::now();
            let call = || progress.call1((run.snapshot().t, duration)).map(drop);
            heard = heard.and_then(|()| call());
        }
        match heard {
            // What there is then is the result; of a run that is over nothing else would tell of it.
            Err(error) if error.is_instance_of::<PyKeyboardInterrupt>(py) && !over => break,
            Err(error) => return Err(error),
            Ok(()) if over => break,
            Ok(()) => {}
        }
    }
    let wall_time = start.elapsed().as_secs_f64();
    let (mut outcome, mut warnings) = (run.outcome(), ready.warnings);
    warnings.append(&mut outcome.warnings);
    to_dict(py, Rollout { outcome, warnings, wall_time })
}

/// Run many scenario documents on several threads, with the GIL released.
///
/// Parameters
/// ----------
/// documents : iterable of Mapping
///     The scenarios.
/// name : str
///     What error messages call the list.
/// threads : int, optional
///     How many threads; as many as there are cores by default.
/// record : bool
///     Whether to record, or to keep nothing but the metrics.
/// progress : callable, optional
///     Gets the number of finished scenarios and the number of all about every 100 ms.
///
/// Returns
/// -------
/// list of dict
///     What `run` returns, in the order of the documents.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If a scenario cannot be run; nothing has been computed then.
/// vffnull.errors.InputError
///     If all records together are too large, or the threads cannot be started.
#[pyfunction]
#[pyo3(signature = (documents, name="scenarios", threads=None, record=true, progress=None))]
pub fn run_many<'py>(
    py: Python<'py>,
    documents: &Bound<'py, PyAny>,
    name: &str,
    threads: Option<usize>,
    record: bool,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    load_numpy(py)?;
    let read = |(i, value): (usize, PyResult<Bound<'py, PyAny>>)| {
        named_document(&format!("{name}[{i}]"), &value?)
    };
    let items = documents.try_iter().map_err(|error| {
        instead(documents, error, || wrong_type("documents: expected a list", documents))
    })?;
    let documents = items.enumerate().map(read).collect::<PyResult<Vec<_>>>()?;
    let total = documents.len();
    let threads = threads.unwrap_or_else(|| available_parallelism().map_or(1, NonZero::get));
    let batch = interruptible(py, || Batch::new(&documents, record, threads))?.map_err(
        |error| match error {
            BatchError::Scenario { index, error } => {
                errors::scenario(&error.inside(&format!("{name}[{index}]")))
            }
            other => InputError::new_err(format!("{name}: {other}")),
        },
    )?;
    let mut watch = Watch::new(progress);
    let go_on = |finished| watch.is_wanted(finished as u64, total as u64);
    let rollouts = py.detach(|| batch.run(SIGNALS, go_on));
    let is_over = |rollout: &&Rollout| rollout.outcome.status != Status::Interrupted;
    let done = rollouts.iter().filter(is_over).count();
    watch.end(py, done as u64, total as u64)?;
    rollouts.into_iter().map(|rollout| to_dict(py, rollout)).collect()
}

/// Find by a planner whether a collision-free motion exists, with the GIL released.
///
/// Parameters
/// ----------
/// document : Mapping
///     The scenario, in the plane or in space.
///
/// Returns
/// -------
/// str
///     ``"with tip"``, ``"without tip"`` or ``"none found"``.
/// (k, n) ndarray or None
///     The motion that was found: joint angles every 50 ms [rad].
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the scenario cannot be read, or its reference does not fit its task.
#[pyfunction(name = "feasibility")]
pub fn assess_feasibility<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = document)] document: toml::Table,
) -> PyResult<(&'static str, Option<Bound<'py, PyArray2<f64>>>)> {
    let assess = |scenario: Scenario| Ok((feasibility::assess(&scenario)?, scenario.q0.len()));
    let ((verdict, motion), n) = prepared(py, &document, assess)?;
    let shape = |motion: &feasibility::Motion| [motion.len(), n];
    let motion = motion.map(|motion| array2(py, motion.concat(), shape(&motion))).transpose()?;
    Ok((verdict.name(), motion))
}

/// An outcome as Python values.
pub fn to_dict(py: Python<'_>, rollout: Rollout) -> PyResult<Bound<'_, PyDict>> {
    let Rollout { outcome, warnings, wall_time } = rollout;
    let result = PyDict::new(py);
    result.set_item("status", outcome.status.name())?;
    result.set_item("message", outcome.message)?;
    result.set_item("end_time", outcome.end_time)?;
    result.set_item("wall_time", wall_time)?;
    result.set_item("warnings", warnings)?;
    result.set_item("metrics", measured(py, &outcome.metrics)?)?;
    result.set_item("replans", replans(py, &outcome.replans)?)?;
    result.set_item("record", arrays(py, outcome.record)?)?;
    Ok(result)
}

/// Metrics as Python values, by name.
pub fn measured<'py>(
    py: Python<'py>,
    metrics: &[(&'static Metric, Value)],
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (metric, value) in metrics {
        match value {
            Value::Number(number) => dict.set_item(metric.name, number)?,
            Value::Count(count) => dict.set_item(metric.name, count)?,
            Value::None => dict.set_item(metric.name, py.None())?,
        }
    }
    Ok(dict)
}

/// Searches for another plan, as Python values.
pub fn replans<'py>(py: Python<'py>, searches: &[Replanned]) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let entry = |search: &Replanned| {
        let entry = PyDict::new(py);
        entry.set_item("asked", search.asked)?;
        entry.set_item("reason", search.reason.name())?;
        entry.set_item("status", search.status)?;
        entry.set_item("taken", search.taken)?;
        Ok(entry)
    };
    searches.iter().map(entry).collect()
}

/// The arrays of a record, moved, not copied; what the run does not have is None.
pub fn arrays(py: Python<'_>, record: Record) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    for (name, array) in record.into_arrays() {
        let array =
            array.map(|Array { values, shape }| PyArray1::from_vec(py, values).reshape(shape));
        dict.set_item(name, array.transpose()?)?;
    }
    Ok(dict)
}

/// Validate a scenario document, or a part of one, and return warnings.
///
/// Parameters
/// ----------
/// kind : str
///     Which part: ``"scenario"``, ``"arm"``, ``"obstacle"``, …
/// document : dict
///     The part.
/// dimension : int, optional
///     Of the space, 2 or 3; by default the part itself says which, as far as it does.
/// recorded : bool, optional
///     Whether the record of a whole scenario has to fit into memory.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If it cannot be used; the message names the key, what was given, and what is allowed.
#[pyfunction]
#[pyo3(signature = (kind, document, dimension=None, recorded=false))]
pub fn check(
    py: Python<'_>,
    kind: &str,
    #[pyo3(from_py_with = document)] document: toml::Table,
    dimension: Option<usize>,
    recorded: bool,
) -> PyResult<Vec<String>> {
    let check = |part| runtime::check(part, &document, dimension, recorded);
    let checked = interruptible(py, || Part::named(kind).and_then(check));
    if checked.is_err() {
        interrupt::leave(document);
    }
    checked?.map_err(|error| errors::scenario(&error))
}

/// A speed [m/s] and an acceleration [m/s²] that a motion of an obstacle never exceeds.
///
/// Parameters
/// ----------
/// document : dict
///     The motion.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If it is none.
#[pyfunction]
pub fn motion_bounds(
    #[pyo3(from_py_with = document)] document: toml::Table,
) -> PyResult<(f64, f64)> {
    let bounds = scenario::motion_bounds(&document);
    bounds.map(Into::into).map_err(|error| errors::scenario(&error))
}

/// The parts of a task, what gives way first before what gives way last (T193).
///
/// Parameters
/// ----------
/// document : Mapping
///     The `[controller]` of a scenario.
/// dimension : int
///     Of the space, 2 or 3.
///
/// Returns
/// -------
/// list of str or None
///     None is what `yielding.order` does not name.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If there is no such part or task.
#[pyfunction]
pub fn parts_of_task(
    #[pyo3(from_py_with = document)] document: toml::Table,
    dimension: usize,
) -> PyResult<Vec<Option<&'static str>>> {
    let parts = scenario::parts_of_task(&document, dimension);
    parts.map(|parts| named(&parts)).map_err(|error| errors::scenario(&error))
}

/// Parts of a task by what a scenario calls them.
pub fn named(parts: &[Option<settings::Part>]) -> Vec<Option<&'static str>> {
    parts.iter().map(|part| part.map(settings::Part::name)).collect()
}

/// Read TOML.
///
/// Parameters
/// ----------
/// text : str
///     The text.
/// name : str
///     What the error message calls it.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the text is not TOML; the message shows the line.
#[pyfunction]
pub fn parse_toml<'py>(
    py: Python<'py>,
    text: &Bound<'py, PyString>,
    name: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let text = convert::text(name, text)?;
    let table = abandonable(py, text.len(), move || scenario::parse_toml(&text))?
        .map_err(|error| errors::scenario(&error.inside(name)))?;
    table_to_dict(py, &table)
}

/// Write a document as TOML.
#[pyfunction]
pub fn format_toml(
    py: Python<'_>,
    #[pyo3(from_py_with = document)] document: toml::Table,
) -> PyResult<String> {
    let mut values = 0;
    let document = convert::values_first(document, &mut values);
    abandonable(py, values.saturating_mul(16), move || toml::to_string(&document))?
        .map_err(|error| InputError::new_err(error.to_string()))
}

/// Every key of a scenario with its unit, default and meaning, as text.
#[pyfunction]
pub fn schema() -> &'static str {
    scenario::SCHEMA
}

/// The same as a JSON Schema.
#[pyfunction]
pub fn schema_json() -> String {
    scenario::json_schema()
}
