//! The parts of a task, by their names.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde::Deserialize;
use serde::de::IntoDeserializer;
use serde::de::value::Error;
use vff_core::control::settings::{Part, TaskKind, Yielding};

/// The parts of a task, what gives way first before what gives way last (T193).
///
/// Parameters
/// ----------
/// order : sequence of str
///     `controller.yielding.order`.
/// task : str
///     `controller.task`.
/// dimension : int
///     Of the space, 2 or 3.
///
/// Returns
/// -------
/// list of str or None
///     None is what `order` does not name.
///
/// Raises
/// ------
/// ValueError
///     If there is no such part or task.
#[pyfunction]
pub fn parts_of_task(
    order: Vec<String>,
    task: &str,
    dimension: usize,
) -> PyResult<Vec<Option<&'static str>>> {
    let read = |error: Error| PyValueError::new_err(error.to_string());
    let part = |name: String| Part::deserialize(name.into_deserializer());
    let order = order.into_iter().map(part).collect::<Result<_, _>>().map_err(read)?;
    let task = TaskKind::deserialize(task.into_deserializer()).map_err(read)?;
    let yielding = Yielding { order: Some(order), ..Yielding::default() };
    Ok(named(&yielding.parts(dimension, task)))
}

/// Parts of a task by what a scenario calls them.
pub fn named(parts: &[Option<Part>]) -> Vec<Option<&'static str>> {
    parts.iter().map(|part| part.map(Part::name)).collect()
}
