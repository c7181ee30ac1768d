//! Descriptions of spatial arms: readers, validation, and the bundled ones.

use crate::convert::{document, from_toml};
use crate::errors::InputError;
use crate::watch::interruptible;
use pyo3::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fmt::Display;
use std::sync::Arc;
use vff_core::control::distance::OwnPair;
use vff_core::robot::Robot;
use vff_core::robot::models;
use vff_core::robot::urdf::{self, Options, Tree};

fn refused(error: impl Display) -> PyErr {
    InputError::new_err(error.to_string())
}

fn typed<T: DeserializeOwned>(table: toml::Table) -> PyResult<T> {
    T::deserialize(toml::Value::Table(table)).map_err(refused)
}

fn to_python<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    from_toml(py, &toml::Value::try_from(value).map_err(refused)?)
}

/// Read the text of a URDF.
///
/// Parameters
/// ----------
/// text : str
///     The URDF.
/// options : dict
///     ``tip``, ``base``, ``locked``, ``tool``, ``mount``, ``gravity``, ``armature``, ``fix_inertia`` and
///     ``srdf`` (text), each with its default.
///
/// Returns
/// -------
/// dict
///     ``arm``, the explicit description without ``collision``; ``geometry``, what collides on which link;
///     ``locked``, ``merged``, ``warnings``.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     If the text is no URDF, or what is asked for is no arm.
#[pyfunction]
pub fn read_urdf<'py>(
    py: Python<'py>,
    text: &str,
    #[pyo3(from_py_with = document)] options: toml::Table,
) -> PyResult<Bound<'py, PyAny>> {
    let options: Options = typed(options)?;
    let reading = py.detach(|| urdf::read(text, &options)).map_err(refused)?;
    to_python(py, &reading)
}

/// The same as `read_urdf` for links and joints that another reader found.
///
/// Parameters
/// ----------
/// tree : dict
///     ``name``, ``links``, ``joints``, ``warnings``.
/// options : dict
///     As in `read_urdf`.
#[pyfunction]
pub fn reduce_tree<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = document)] tree: toml::Table,
    #[pyo3(from_py_with = document)] options: toml::Table,
) -> PyResult<Bound<'py, PyAny>> {
    let (tree, options): (Tree, Options) = (typed(tree)?, typed(options)?);
    to_python(py, &tree.reduce(&options).map_err(refused)?)
}

/// Validate the explicit description of a spatial arm.
///
/// Parameters
/// ----------
/// arm : dict
///     The description.
///
/// Returns
/// -------
/// dict
///     The same with every key that has a default, axes and quaternions of length 1.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     With the path of the first value that is wrong.
#[pyfunction]
pub fn check_arm<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = document)] arm: toml::Table,
) -> PyResult<Bound<'py, PyAny>> {
    let arm = models::read(arm).map_err(refused)?;
    to_python(py, &arm.checked().map_err(refused)?)
}

/// Which links of an arm overlap that must not touch: no neighbours, and none of those to be ignored.
///
/// Parameters
/// ----------
/// arm : dict
///     The description.
/// postures : sequence of sequence of float
///     Joint positions.
///
/// Returns
/// -------
/// list of list of (str, str)
///     The names of their links at every posture, from the base.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     With the path of the first value that is wrong, or if a posture has another length than the arm
///     has joints.
#[pyfunction]
pub fn overlapping_links(
    py: Python<'_>,
    #[pyo3(from_py_with = document)] arm: toml::Table,
    postures: Vec<Vec<f64>>,
) -> PyResult<Vec<Vec<(String, String)>>> {
    let arm = models::read(arm).map_err(refused)?;
    let arm = Arc::new(arm.build().map_err(refused)?);
    let n = arm.dof();
    if let Some(other) = postures.iter().find(|q| q.len() != n) {
        return Err(refused(format!("postures: expected {n} numbers each, got {}", other.len())));
    }
    let base = arm.description().base.clone();
    let names: Vec<String> = arm.link_names().map(String::from).collect();
    let name = |link: Option<usize>| link.map_or_else(|| base.clone(), |i| names[i].clone());
    interruptible(py, move || {
        let mut state = arm.state();
        let at = |q: Vec<f64>| {
            state.update_positions(&q);
            let links = OwnPair::<3>::overlapping_links(&state);
            links.into_iter().map(|[a, b]| (name(a), name(b))).collect()
        };
        postures.into_iter().map(at).collect()
    })
}

/// The explicit description of a bundled arm.
///
/// Parameters
/// ----------
/// name : str
///     One of `ARMS`.
#[pyfunction]
pub fn arm_model<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    to_python(py, &models::named(name).map_err(refused)?)
}

/// The document of a bundled arm, with the sources of its numbers.
///
/// Parameters
/// ----------
/// name : str
///     One of `ARMS`.
#[pyfunction]
pub fn arm_text(name: &str) -> PyResult<&'static str> {
    models::text(name).map_err(refused)
}
