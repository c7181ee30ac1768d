//! Faults of the core as the exceptions of `vffnull.errors`.

use pyo3::import_exception;
use pyo3::prelude::*;
use vff_core::scenario::ScenarioError;

import_exception!(vffnull.errors, InputError);
import_exception!(vffnull.errors, InputTypeError);

mod python {
    pyo3::import_exception!(vffnull.errors, ScenarioError);
    pyo3::import_exception!(vffnull.errors, ScenarioWarning);
}

/// Tells of something odd that is allowed.
pub fn warn(py: Python<'_>, message: &str) -> PyResult<()> {
    let message = std::ffi::CString::new(message)?;
    PyErr::warn(py, &py.get_type::<python::ScenarioWarning>(), &message, 1)
}

/// A fault of a scenario.
pub fn scenario(error: &ScenarioError) -> PyErr {
    python::ScenarioError::new_err((error.to_string(), error.path.clone()))
}

/// A fault of the arguments of an arm.
pub fn arm(error: &ScenarioError) -> PyErr {
    InputError::new_err(error.to_string())
}
