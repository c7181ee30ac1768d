//! Faults of the core as the exceptions of `vffnull.errors`.

use pyo3::import_exception;
use pyo3::prelude::*;
use vff_core::scenario::ScenarioError;

import_exception!(vffnull.errors, InputError);
import_exception!(vffnull.errors, InputTypeError);

mod python {
    pyo3::import_exception!(vffnull.errors, ScenarioError);
}

/// A fault of a scenario.
pub fn scenario(error: &ScenarioError) -> PyErr {
    python::ScenarioError::new_err((error.to_string(), error.path.clone()))
}

/// A fault of the arguments of an arm.
pub fn arm(error: &ScenarioError) -> PyErr {
    InputError::new_err(error.to_string())
}
