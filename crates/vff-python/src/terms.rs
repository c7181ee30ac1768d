//! `Terms`: the parts of a torque.

use crate::convert::{array1, matrix};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use vff_core::runtime::controller;

type Array1<'py> = Bound<'py, PyArray1<f64>>;

/// The parts of the torque at one state.
#[pyclass(frozen, module = "vffnull")]
pub struct Terms {
    pub inner: controller::Terms,
}

#[pymethods]
impl Terms {
    /// Joint torque, (n,) [N·m].
    #[getter]
    fn tau<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.inner.tau)
    }

    /// What serves the task, and what makes it give way, (n,) [N·m].
    #[getter]
    fn tau_task<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.inner.tau_task)
    }

    /// What acts in the null space, (n,) [N·m].
    #[getter]
    fn tau_null<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.inner.tau_null)
    }

    /// Repulsion Σ JᵢᵀFᵢ before its projection, (n,) [N·m].
    #[getter]
    fn tau_vff<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.inner.tau_vff)
    }

    /// Magnitude of the repulsion on each link, (n,) [N].
    #[getter]
    fn force<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.inner.force)
    }

    /// Signed distance of each link's surface to the nearest obstacle's, (n,) [m].
    #[getter]
    fn clearance<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.inner.clearance)
    }

    /// Energies as named in `ENERGIES`, (3,) [J].
    #[getter]
    fn energy<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.inner.scalars.energy)
    }

    /// Powers as named in `PORTS`, (6,) [W].
    #[getter]
    fn power<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.inner.scalars.power)
    }

    /// What the limits let through of each of `OBJECTIVES`, (6,), from 0 to 1.
    #[getter]
    fn objective_scale<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.inner.scalars.objective_scale)
    }

    /// By how much barriers are violated at most [m/s²]; None without ``avoidance="cbf"``.
    #[getter]
    fn slack(&self) -> Option<f64> {
        self.inner.scalars.slack
    }

    /// Energy in the tank [J]; None without one.
    #[getter]
    fn tank(&self) -> Option<f64> {
        self.inner.scalars.tank
    }

    /// Signed distance of the nearest two links that share no joint [m]; infinite if not measured.
    #[getter]
    fn self_clearance(&self) -> f64 {
        self.inner.scalars.self_clearance
    }

    /// √det(J Jᵀ), 0 in a singularity [m², for a task in space m³].
    #[getter]
    fn manipulability(&self) -> f64 {
        self.inner.scalars.manipulability
    }

    /// Whether the task force is damped because of a singularity.
    #[getter]
    fn singular(&self) -> bool {
        self.inner.scalars.singular
    }

    /// ‖J M⁻¹ τ_null‖ [m/s²]: what leaks into the task.
    #[getter]
    fn null_acceleration(&self) -> f64 {
        self.inner.scalars.null_acceleration
    }

    /// Whether the torque is finite: it is not at states and references beyond what numbers can hold.
    #[getter]
    fn finite(&self) -> bool {
        self.inner.tau.iter().all(|tau| tau.is_finite())
    }

    fn __repr__(&self) -> String {
        let clearance = self.inner.clearance.iter().copied().fold(f64::INFINITY, f64::min);
        let largest = self.inner.tau.iter().fold(0.0, |most: f64, tau| most.max(tau.abs()));
        let torque = match self.finite() {
            true => format!("up to {largest:.4} N·m"),
            false => "torque not finite".into(),
        };
        format!("<Terms: {} joints, {torque}, clearance {clearance:.4} m>", self.inner.tau.len())
    }

    /// Null-space projector, (n, n).
    #[getter]
    #[expect(non_snake_case, reason = "the name of the paper")]
    fn N<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.inner.projector)
    }
}
