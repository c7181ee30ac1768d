//! Whole runs and the validation of documents.
#![expect(clippy::needless_pass_by_value, reason = "Python hands documents over by value")]

use crate::convert::{array2, document, named_document, table_to_dict, wrong_type};
use crate::errors::{self, InputError};
use crate::watch::{PROGRESS, SIGNALS, Watch};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::num::NonZero;
use std::thread::available_parallelism;
use std::time::Instant;
use vff_core::control::energy::{ENERGIES, PORTS};
use vff_core::control::limits::OBJECTIVES;
use vff_core::runtime::batch::{Batch, BatchError, Rollout};
use vff_core::simulation::{Record, Value};
use vff_core::{
    planning::feasibility,
    runtime,
    scenario::{self, Part, Scenario},
};

/// Runs a scenario, the GIL released. Ctrl-C ends it with what there is.
#[pyfunction]
#[pyo3(signature = (document, progress=None))]
pub fn run<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = document)] document: toml::Table,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let scenario = Scenario::from_document(&document).map_err(|error| errors::scenario(&error))?;
    let ready = scenario.prepare().map_err(|error| errors::scenario(&error))?;
    let (mut run, start) = (ready.run, Instant::now());
    let mut told = start;
    loop {
        let over = py.detach(|| run.run_for(SIGNALS));
        let mut heard = py.check_signals();
        if let Some(progress) = progress
            && (over || told.elapsed() >= PROGRESS)
        {
            told = Instant::now();
            let call = || progress.call1((run.snapshot().t, scenario.duration)).map(drop);
            heard = heard.and_then(|()| call());
        }
        match heard {
            Err(error) if error.is_instance_of::<PyKeyboardInterrupt>(py) => break,
            Err(error) => return Err(error),
            Ok(()) if over => break,
            Ok(()) => {}
        }
    }
    let wall_time = start.elapsed().as_secs_f64();
    to_dict(py, Rollout { outcome: run.outcome(), warnings: ready.warnings, wall_time })
}

/// Runs many scenarios on several threads, the GIL released. Ctrl-C ends it with what there is.
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
    let read = |(i, value): (usize, PyResult<Bound<'py, PyAny>>)| {
        named_document(&format!("{name}[{i}]"), &value?)
    };
    let items =
        documents.try_iter().map_err(|_| wrong_type("documents: expected a list", documents))?;
    let documents = items.enumerate().map(read).collect::<PyResult<Vec<_>>>()?;
    let total = documents.len();
    let threads = threads.unwrap_or_else(|| available_parallelism().map_or(1, NonZero::get));
    let batch =
        py.detach(|| Batch::new(&documents, record, threads)).map_err(|error| match error {
            BatchError::Scenario { index, error } => {
                errors::scenario(&error.inside(&format!("{name}[{index}]")))
            }
            other => InputError::new_err(format!("{name}: {other}")),
        })?;
    let mut watch = Watch::new(progress);
    let look = |finished| watch.look(finished as u64, total as u64);
    let rollouts = py.detach(|| batch.run(SIGNALS, look));
    watch.end(py, total as u64, total as u64)?;
    rollouts.into_iter().map(|rollout| to_dict(py, rollout)).collect()
}

/// Whether a scene can be survived, and a motion that does (rows, joints); the GIL released.
#[pyfunction(name = "feasibility")]
pub fn assess_feasibility<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = document)] document: toml::Table,
) -> PyResult<(&'static str, Option<Bound<'py, PyArray2<f64>>>)> {
    let scenario = Scenario::from_document(&document).map_err(|error| errors::scenario(&error))?;
    let (verdict, motion) =
        py.detach(|| feasibility::assess(&scenario)).map_err(|error| errors::scenario(&error))?;
    let shape = |motion: &feasibility::Motion| [motion.len(), scenario.q0.len()];
    let motion = motion.map(|motion| array2(py, motion.concat(), shape(&motion))).transpose()?;
    Ok((verdict.name(), motion))
}

/// An outcome as Python values.
fn to_dict(py: Python<'_>, rollout: Rollout) -> PyResult<Bound<'_, PyDict>> {
    let Rollout { outcome, warnings, wall_time } = rollout;
    let metrics = PyDict::new(py);
    for (metric, value) in &outcome.metrics {
        match value {
            Value::Number(number) => metrics.set_item(metric.name, number)?,
            Value::Count(count) => metrics.set_item(metric.name, count)?,
            Value::None => metrics.set_item(metric.name, py.None())?,
        }
    }
    let result = PyDict::new(py);
    result.set_item("status", outcome.status.name())?;
    result.set_item("message", outcome.message)?;
    result.set_item("end_time", outcome.end_time)?;
    result.set_item("wall_time", wall_time)?;
    result.set_item("warnings", warnings)?;
    result.set_item("metrics", metrics)?;
    result.set_item("record", arrays(py, outcome.record)?)?;
    Ok(result)
}

/// The arrays of a record, moved, not copied.
pub fn arrays(py: Python<'_>, r: Record) -> PyResult<Bound<'_, PyDict>> {
    let (rows, n, m, k, rays) = (r.rows, r.joints, r.task, r.obstacles_count, r.rays);
    let dict = PyDict::new(py);
    dict.set_item("t", PyArray1::from_vec(py, r.t))?;
    let tables = [
        ("q", r.q, n),
        ("dq", r.dq, n),
        ("tau", r.tau, n),
        ("tau_task", r.tau_task, n),
        ("tau_null", r.tau_null, n),
        ("tau_vff", r.tau_vff, n),
        ("x", r.x, m),
        ("dx", r.dx, m),
        ("x_ref", r.x_ref, m),
        ("error", r.error, m),
        ("force", r.force, n),
        ("clearance", r.clearance, n),
    ];
    for (name, values, columns) in tables {
        dict.set_item(name, array2(py, values, [rows, columns])?)?;
    }
    dict.set_item("obstacles", PyArray1::from_vec(py, r.obstacles).reshape([rows, k, 2])?)?;
    dict.set_item("energy", array2(py, r.energy, [rows, ENERGIES.len()])?)?;
    dict.set_item("power", array2(py, r.power, [rows, PORTS.len()])?)?;
    dict.set_item("manipulability", PyArray1::from_vec(py, r.manipulability))?;
    // What the run does not have is None.
    let given = |values: &Vec<f64>| !values.is_empty();
    let optional = [
        ("q_measured", r.q_measured, n),
        ("dq_measured", r.dq_measured, n),
        ("tau_applied", r.tau_applied, n),
        ("objective_scale", r.objective_scale, OBJECTIVES.len()),
    ];
    for (name, values, columns) in optional {
        let values = Some(values).filter(given);
        let table = values.map(|values| array2(py, values, [rows, columns])).transpose()?;
        dict.set_item(name, table)?;
    }
    let sensed = Some(r.sensed).filter(given);
    let sensed = sensed.map(|values| PyArray1::from_vec(py, values).reshape([rows, rays, 2]));
    dict.set_item("sensed", sensed.transpose()?)?;
    let series = [
        ("self_clearance", r.self_clearance),
        ("tank", r.tank),
        ("slack", r.slack),
        ("path_time", r.path_time),
    ];
    for (name, values) in series {
        let values = Some(values).filter(given);
        dict.set_item(name, values.map(|values| PyArray1::from_vec(py, values)))?;
    }
    Ok(dict)
}

/// Judges a document or a part of one; returns warnings.
#[pyfunction]
pub fn check(
    kind: &str,
    #[pyo3(from_py_with = document)] document: toml::Table,
) -> PyResult<Vec<String>> {
    Part::named(kind)
        .and_then(|part| runtime::any::check(part, &document))
        .map_err(|error| errors::scenario(&error))
}

/// Reads TOML.
#[pyfunction]
pub fn parse_toml<'py>(py: Python<'py>, text: &str, name: &str) -> PyResult<Bound<'py, PyDict>> {
    let table =
        scenario::parse_toml(text).map_err(|error| errors::scenario(&error.inside(name)))?;
    table_to_dict(py, &table)
}

/// Writes TOML.
#[pyfunction]
pub fn format_toml(#[pyo3(from_py_with = document)] document: toml::Table) -> PyResult<String> {
    toml::to_string(&document).map_err(|error| InputError::new_err(error.to_string()))
}

/// Every key of a scenario.
#[pyfunction]
pub fn schema() -> &'static str {
    scenario::SCHEMA
}
