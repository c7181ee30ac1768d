//! `ExtendedJacobian`: task and null space of an arm as matrices.

use crate::convert::matrix;
use crate::errors::InputError;
use numpy::PyArray2;
use pyo3::prelude::*;
use vff_core::control::extended_jacobian;

type Array2<'py> = Bound<'py, PyArray2<f64>>;

/// Task and null space of an arm at one state; m rows of `jacobian`, r = n − m.
///
/// The extended velocity (ẋ, ν) = J_e q̇ is made of the tip's velocity and r coordinates of the motion that
/// the tip does not see.
#[pyclass(frozen, module = "vffnull")]
pub struct ExtendedJacobian {
    pub inner: extended_jacobian::ExtendedJacobian,
}

impl ExtendedJacobian {
    /// What was made of a state, where there is one.
    pub fn of(made: Option<extended_jacobian::ExtendedJacobian>) -> PyResult<Self> {
        made.map(|inner| Self { inner }).ok_or_else(|| {
            InputError::new_err(
                "q: the extended Jacobian does not exist here: it needs at least 2 joints and \
                 a configuration that is not singular (links not all on one line with the tip)",
            )
        })
    }
}

#[pymethods]
#[expect(non_snake_case, reason = "the names of the paper")]
impl ExtendedJacobian {
    /// Orthonormal basis of the null space, (n, r): J Z = 0.
    #[getter]
    fn Z<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.z)
    }

    /// Null-space velocity map (ZᵀMZ)⁻¹ZᵀM, (r, n): ν = N_M q̇ (eq. 7, 8).
    #[getter]
    fn N_M<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.n_m)
    }

    /// Extended Jacobian [J; N_M], (n, n) (eq. 9).
    #[getter]
    fn J_e<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.j_e)
    }

    /// Its inverse [J#, Z], (n, n).
    #[getter]
    fn J_e_inv<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.j_e_inv)
    }

    /// Extended inertia J_e⁻ᵀ M J_e⁻¹, (n, n); block diagonal (eq. 13).
    #[getter]
    fn E_e<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.e_e)
    }

    /// Extended Coriolis matrix J_e⁻ᵀ(C − M J_e⁻¹ J̇_e)J_e⁻¹, (n, n) (eq. 13).
    #[getter]
    fn mu<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.mu)
    }

    /// Inertia that the tip shows, (m, m) [kg, and kg·m² of its turns].
    #[getter]
    fn Lambda_x<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.lambda_x)
    }

    /// Inertia in the null space, (r, r) [kg·m²].
    #[getter]
    fn Lambda_n<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.lambda_n)
    }

    /// Dynamically consistent null-space projector I − J#J, (n, n).
    #[getter]
    fn N<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.null_projector())
    }
}
