//! Attributes of an arm as Python has them.

use super::Arm;
use crate::convert::{array1, from_toml};
use numpy::PyArray1;
use pyo3::exceptions::PyAttributeError;
use pyo3::prelude::*;
use toml::Table;
use vff_core::runtime::AnyArm;

type Array1<'py> = Bound<'py, PyArray1<f64>>;
/// Names of links, and shapes in their frames.
pub(super) type Shapes<'py> = Vec<(Bound<'py, PyAny>, Bound<'py, PyAny>)>;

/// Limits as an array, None where there are none.
pub(super) fn limits<'py>(py: Python<'py>, values: &[f64]) -> Option<Array1<'py>> {
    (!values.is_empty()).then(|| array1(py, values))
}

/// An attribute that only arms in the plane have.
pub(super) fn planar<'py>(
    py: Python<'py>,
    name: &str,
    values: Option<Vec<f64>>,
) -> PyResult<Array1<'py>> {
    values.map(|values| array1(py, &values)).ok_or_else(|| {
        let sentence = format!("an arm in space has no `{name}`: see `link_poses` and `collision`");
        PyAttributeError::new_err(sentence)
    })
}

/// What is measured of links.
pub(super) fn shapes(py: Python<'_>, found: Vec<Table>) -> PyResult<Shapes<'_>> {
    let pair = |item: Table| Ok((from_toml(py, &item["link"])?, from_toml(py, &item["shape"])?));
    found.into_iter().map(pair).collect()
}

/// The arm in a line.
pub(super) fn summary(arm: &AnyArm) -> String {
    let (n, reach) = (arm.dof(), arm.reach());
    let links = if n == 1 { "link" } else { "links" };
    if arm.dimension() == 2 {
        return format!("<Arm: {n} {links}, reach {reach} m>");
    }
    let name = arm.name().map_or(String::new(), |name| format!("{name}, "));
    format!("<Arm: {name}{n} {links} in space, reach at most {reach:.3} m>")
}

/// The arm as a document of another program, as `vffnull.engines.export` writes it.
pub(super) fn exported(arm: &Bound<'_, Arm>, how: &str, name: Option<&str>) -> PyResult<String> {
    let export = arm.py().import("vffnull.engines.export")?;
    export.call_method1(how, (arm, name))?.extract()
}
