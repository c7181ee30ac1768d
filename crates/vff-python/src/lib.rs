//! `vffnull._core`: what Python sees of `vff-core`. Conversions, errors and the GIL; no mathematics.
#![forbid(unsafe_code)]

mod arm;
mod call;
mod controller;
mod convert;
mod distances;
mod drive;
mod errors;
mod exclusive;
mod extended_jacobian;
mod external;
mod live;
mod loading;
mod models;
mod perceiver;
mod planning;
mod real_time;
mod rotations;
mod run;
mod scheduling;
mod shapes;
mod simulated_robot;
mod simulation;
mod terms;
mod vector;
mod virtual_arm;
mod watch;

use pyo3::prelude::*;

/// The compiled core of vffnull.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::arm::{Arm, plant};
    #[pymodule_export]
    use crate::controller::Controller;
    #[pymodule_export]
    use crate::distances::{Distances, distances, surface_distances};
    #[pymodule_export]
    use crate::drive::DriveLoop;
    #[pymodule_export]
    use crate::extended_jacobian::ExtendedJacobian;
    #[pymodule_export]
    use crate::external::{ExternalRun, wrenches};
    #[pymodule_export]
    use crate::live::Live;
    #[pymodule_export]
    use crate::models::{
        arm_model, arm_text, check_arm, overlapping_links, read_urdf, reduce_tree,
    };
    #[pymodule_export]
    use crate::perceiver::Perceiver;
    #[pymodule_export]
    use crate::planning::{joints_at, plan};
    #[pymodule_export]
    use crate::real_time::real_time;
    #[pymodule_export]
    use crate::rotations::{matrices, quaternions};
    #[pymodule_export]
    use crate::run::{
        assess_feasibility, check, format_toml, motion_bounds, parse_toml, parts_of_task, run,
        run_many, schema, schema_json,
    };
    #[pymodule_export]
    use crate::shapes::{hull, rotations};
    #[pymodule_export]
    use crate::simulated_robot::SimulatedRobot;
    #[pymodule_export]
    use crate::simulation::{Simulation, State};
    #[pymodule_export]
    use crate::terms::Terms;
    #[pymodule_export]
    use crate::vector::Episodes;
    #[pymodule_export]
    use crate::virtual_arm::VirtualArm;

    use crate::loading::before_fork;
    use pyo3::prelude::*;
    use pyo3::types::{PyDict, PyTuple};
    use vff_core::control::{energy, limits};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        if let Some(register) = module.py().import("os")?.getattr_opt("register_at_fork")? {
            let keywords = PyDict::new(module.py());
            keywords.set_item("before", wrap_pyfunction!(before_fork, module)?)?;
            register.call((), Some(&keywords))?;
        }
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        let metrics = PyDict::new(module.py());
        for metric in vff_core::simulation::METRICS {
            metrics.set_item(metric.name, (metric.unit, metric.meaning))?;
        }
        module.add("METRICS", metrics)?;
        let names = |names: &[&str]| PyTuple::new(module.py(), names);
        module.add("OBJECTIVES", names(&limits::OBJECTIVES)?)?;
        module.add("ENERGIES", names(&energy::ENERGIES)?)?;
        module.add("PORTS", names(&energy::PORTS)?)?;
        module.add("ARMS", names(&vff_core::robot::models::NAMES)?)
    }
}
