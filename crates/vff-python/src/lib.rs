//! `vffnull._core`: what Python sees of `vff-core`. Conversions, errors and the GIL; no mathematics.

mod arm;
mod controller;
mod convert;
mod distances;
mod errors;
mod run;
mod simulation;

use pyo3::prelude::*;

/// The compiled core of vffnull.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::arm::{Arm, ExtendedJacobian};
    #[pymodule_export]
    use crate::controller::{Controller, Terms};
    #[pymodule_export]
    use crate::distances::{Distances, distances};
    #[pymodule_export]
    use crate::run::{check, format_toml, parse_toml, run, schema};
    #[pymodule_export]
    use crate::simulation::{Simulation, State};

    use pyo3::prelude::*;
    use pyo3::types::PyDict;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        let metrics = PyDict::new(module.py());
        for metric in vff_core::simulation::METRICS {
            metrics.set_item(metric.name, (metric.unit, metric.meaning))?;
        }
        module.add("METRICS", metrics)
    }
}
