//! `Arm`: the planar arm and its matrices.

use crate::convert::{
    array1, array2, as_float_array, finite, matrix, number, table_to_dict, to_toml, vector,
    whole_number, wrong_shape,
};
use crate::errors::{self, InputError};
use nalgebra::DMatrix;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;
use toml::{Table, Value};
use vff_core::control::extended_jacobian;
use vff_core::robot::planar::Link;
use vff_core::robot::{Matrices, Model, PlanarArm, PlanarState, Robot};
use vff_core::scenario::{self, Scenario};

type Array1<'py> = Bound<'py, PyArray1<f64>>;
type Array2<'py> = Bound<'py, PyArray2<f64>>;

/// A planar arm of n revolute links.
#[pyclass(frozen, module = "vffnull")]
pub struct Arm {
    pub arm: Arc<PlanarArm>,
    document: Table,
}

impl Arm {
    /// Reads an arm from its part of a scenario.
    fn read(document: Table) -> PyResult<Self> {
        let arm = scenario::read_arm(&document).map_err(|error| errors::arm(&error))?;
        Ok(Self { arm: Arc::new(arm), document })
    }

    fn n(&self) -> usize {
        self.arm.dof()
    }

    fn at(&self, q: &Bound<'_, PyAny>) -> PyResult<PlanarState> {
        let mut state = self.arm.state();
        state.update(&vector("q", q, self.n())?, &vec![0.0; self.n()]);
        Ok(state)
    }

    fn moving(&self, q: &Bound<'_, PyAny>, dq: &Bound<'_, PyAny>) -> PyResult<PlanarState> {
        let mut state = self.arm.state();
        state.update(&vector("q", q, self.n())?, &vector("dq", dq, self.n())?);
        Ok(state)
    }

    fn per_link<'py>(&self, py: Python<'py>, value: impl Fn(&Link) -> f64) -> Array1<'py> {
        PyArray1::from_iter(py, self.arm.links().iter().map(value))
    }
}

/// The physical arm of a scenario, payload included.
#[pyfunction]
pub fn plant(document: &Bound<'_, PyAny>) -> PyResult<Arm> {
    let document = crate::convert::document(document)?;
    let arm = Scenario::from_document(&document)
        .and_then(|scenario| scenario.plant_arm())
        .map_err(|error| errors::scenario(&error))?;
    let list = |values: &mut dyn Iterator<Item = Value>| Value::Array(values.collect());
    let pair = |v: nalgebra::Vector2<f64>| Value::Array(vec![Value::Float(v.x), Value::Float(v.y)]);
    let links = || arm.links().iter();
    let mut given = document["arm"].as_table().cloned().unwrap_or_default();
    given.insert("masses".into(), list(&mut links().map(|link| Value::Float(link.mass))));
    given.insert("com".into(), list(&mut links().map(|link| pair(link.com))));
    given.insert("inertias".into(), list(&mut links().map(|link| Value::Float(link.inertia))));
    given.insert("gravity".into(), pair(arm.gravity()));
    Ok(Arm { arm, document: given })
}

#[pymethods]
impl Arm {
    #[new]
    #[pyo3(signature = (lengths, masses, com=None, inertias=None, radius=None, gravity=None, joint_limits=None, torque_limits=None, velocity_limits=None))]
    #[expect(clippy::too_many_arguments, reason = "the parameters of an arm")]
    fn new(
        lengths: &Bound<'_, PyAny>,
        masses: &Bound<'_, PyAny>,
        com: Option<&Bound<'_, PyAny>>,
        inertias: Option<&Bound<'_, PyAny>>,
        radius: Option<&Bound<'_, PyAny>>,
        gravity: Option<&Bound<'_, PyAny>>,
        joint_limits: Option<&Bound<'_, PyAny>>,
        torque_limits: Option<&Bound<'_, PyAny>>,
        velocity_limits: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let given = [
            ("lengths", Some(lengths)),
            ("masses", Some(masses)),
            ("com", com),
            ("inertias", inertias),
            ("radius", radius),
            ("gravity", gravity),
            ("joint_limits", joint_limits),
            ("torque_limits", torque_limits),
            ("velocity_limits", velocity_limits),
        ];
        let mut document = Table::new();
        for (name, value) in given {
            if let Some(value) = value {
                document.insert(name.into(), to_toml(value, name)?);
            }
        }
        Self::read(document)
    }

    #[staticmethod]
    #[pyo3(
        signature = (n, length=None, mass=None, radius=None, gravity=None),
        text_signature = "(n, length=1.0, mass=1.0, radius=0.0, gravity=0.0)"
    )]
    fn uniform(
        n: &Bound<'_, PyAny>,
        length: Option<&Bound<'_, PyAny>>,
        mass: Option<&Bound<'_, PyAny>>,
        radius: Option<&Bound<'_, PyAny>>,
        gravity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let n = whole_number("n", n)?;
        let Some(count) = usize::try_from(n).ok().filter(|n| (1..=100_000).contains(n)) else {
            return Err(InputError::new_err(format!("n: must be from 1 to 100000, got {n}")));
        };
        let read = |name, value: Option<&Bound<'_, PyAny>>, default| {
            value.map_or(Ok(default), |value| number(name, value)).map(Value::Float)
        };
        let mut document = Table::new();
        document.insert("lengths".into(), Value::Array(vec![read("length", length, 1.0)?; count]));
        document.insert("masses".into(), read("mass", mass, 1.0)?);
        document.insert("radius".into(), read("radius", radius, 0.0)?);
        document.insert("gravity".into(), read("gravity", gravity, 0.0)?);
        Self::read(document)
    }

    #[getter(n)]
    fn py_n(&self) -> usize {
        self.n()
    }

    #[getter]
    fn lengths<'py>(&self, py: Python<'py>) -> Array1<'py> {
        self.per_link(py, |link| link.length)
    }

    #[getter]
    fn masses<'py>(&self, py: Python<'py>) -> Array1<'py> {
        self.per_link(py, |link| link.mass)
    }

    #[getter]
    fn com<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        let values = self.arm.links().iter().flat_map(|link| [link.com.x, link.com.y]);
        array2(py, values.collect(), [self.n(), 2])
    }

    #[getter]
    fn inertias<'py>(&self, py: Python<'py>) -> Array1<'py> {
        self.per_link(py, |link| link.inertia)
    }

    #[getter]
    fn radius<'py>(&self, py: Python<'py>) -> Array1<'py> {
        self.per_link(py, |link| link.radius)
    }

    #[getter]
    fn gravity<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, self.arm.gravity().as_slice())
    }

    fn forward_kinematics<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let (py, n) = (q.py(), self.n());
        let array = as_float_array("q", q)?;
        let joints = |state: &PlanarState, out: &mut Vec<f64>| {
            (0..=n).for_each(|i| out.extend_from_slice(state.joint_position(i).as_slice()));
        };
        let mut positions = Vec::new();
        let Ok(rows) = array.extract::<PyReadonlyArray2<'_, f64>>() else {
            joints(&self.at(&array)?, &mut positions);
            return Ok(array2(py, positions, [n + 1, 2])?.into_any());
        };
        let rows = rows.as_array();
        if rows.ncols() != n {
            return Err(wrong_shape("q", q, &format!("({n},) or (T, {n})")));
        }
        let (mut state, still) = (self.arm.state(), vec![0.0; n]);
        for (k, row) in rows.rows().into_iter().enumerate() {
            let row = row.to_vec();
            finite(&format!("q[{k}]"), &row)?;
            state.update(&row, &still);
            joints(&state, &mut positions);
        }
        Ok(PyArray1::from_vec(py, positions).reshape([rows.nrows(), n + 1, 2])?.into_any())
    }

    fn jacobian<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<Array2<'py>> {
        let m: Matrices<2> = self.at(q)?.matrices();
        task_matrix(q.py(), &m.jacobian)
    }

    fn jacobian_dot<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
    ) -> PyResult<Array2<'py>> {
        let m: Matrices<2> = self.moving(q, dq)?.matrices();
        task_matrix(q.py(), &m.jacobian_dot)
    }

    fn mass_matrix<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<Array2<'py>> {
        matrix(q.py(), &self.at(q)?.matrices::<2>().mass)
    }

    fn coriolis_matrix<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
    ) -> PyResult<Array2<'py>> {
        matrix(q.py(), &self.moving(q, dq)?.matrices::<2>().coriolis)
    }

    fn gravity_torque<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<Array1<'py>> {
        let mut out = vec![0.0; self.n()];
        self.at(q)?.gravity_torque(&mut out);
        Ok(array1(q.py(), &out))
    }

    fn inverse_dynamics<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
    ) -> PyResult<Array1<'py>> {
        let state = self.moving(q, dq)?;
        let (mut scratch, mut out) = (vec![0.0; self.n()], vec![0.0; self.n()]);
        state.inverse_dynamics(&vector("ddq", ddq, self.n())?, &mut scratch, &mut out);
        Ok(array1(q.py(), &out))
    }

    fn forward_dynamics<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
    ) -> PyResult<Array1<'py>> {
        let state = self.moving(q, dq)?;
        let (mut scratch, mut out) = (vec![0.0; self.n()], vec![0.0; self.n()]);
        state.forward_dynamics(&vector("tau", tau, self.n())?, &mut scratch, &mut out);
        Ok(array1(q.py(), &out))
    }

    fn kinetic_energy(&self, q: &Bound<'_, PyAny>, dq: &Bound<'_, PyAny>) -> PyResult<f64> {
        let state = self.moving(q, dq)?;
        let mut momentum = vec![0.0; self.n()];
        state.mass_mul(state.velocity(), &mut momentum);
        Ok(0.5 * state.velocity().iter().zip(&momentum).map(|(v, p)| v * p).sum::<f64>())
    }

    fn potential_energy(&self, q: &Bound<'_, PyAny>) -> PyResult<f64> {
        Ok(self.at(q)?.potential_energy())
    }

    fn extended_jacobian(
        &self,
        q: &Bound<'_, PyAny>,
        dq: &Bound<'_, PyAny>,
    ) -> PyResult<ExtendedJacobian> {
        let m: Matrices<2> = self.moving(q, dq)?.matrices();
        extended_jacobian::ExtendedJacobian::new(&m)
            .map(|inner| ExtendedJacobian { inner })
            .ok_or_else(|| {
                InputError::new_err(
                    "q: the extended Jacobian does not exist here: it needs at least 2 joints and \
                     a configuration that is not singular (links not all on one line with the tip)",
                )
            })
    }

    #[pyo3(signature = (name="arm"))]
    fn to_mjcf(slf: &Bound<'_, Self>, name: &str) -> PyResult<String> {
        let export = slf.py().import("vffnull.export")?;
        export.call_method1("to_mjcf", (slf, name))?.extract()
    }

    #[pyo3(signature = (name="arm"))]
    fn to_urdf(slf: &Bound<'_, Self>, name: &str) -> PyResult<String> {
        let export = slf.py().import("vffnull.export")?;
        export.call_method1("to_urdf", (slf, name))?.extract()
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> PyResult<String> {
        let notebook = slf.py().import("vffnull.notebook")?;
        notebook.call_method1("arm", (slf,))?.extract()
    }

    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        table_to_dict(py, &self.document)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.document == other.document
    }

    fn __hash__(&self) -> u64 {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        self.document.to_string().hash(&mut hasher);
        hasher.finish()
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyDict>,))> {
        let rebuild = py.get_type::<Self>().getattr("_from_dict")?;
        Ok((rebuild, (self.to_dict(py)?,)))
    }

    #[staticmethod]
    fn _from_dict(document: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::read(crate::convert::document(document)?)
    }

    fn __repr__(&self) -> String {
        let reach = self.arm.reach();
        let links = if self.n() == 1 { "link" } else { "links" };
        format!("<Arm: {} {links}, reach {reach} m>", self.n())
    }
}

fn task_matrix<'py>(
    py: Python<'py>,
    m: &vff_core::robot::dense::TaskMatrix<2>,
) -> PyResult<Array2<'py>> {
    matrix(py, &DMatrix::from_fn(2, m.ncols(), |i, k| m[(i, k)]))
}

/// Task and null space of an arm at one state.
#[pyclass(frozen, module = "vffnull")]
pub struct ExtendedJacobian {
    inner: extended_jacobian::ExtendedJacobian,
}

#[pymethods]
#[expect(non_snake_case, reason = "the names of the paper")]
impl ExtendedJacobian {
    #[getter]
    fn Z<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.z)
    }

    #[getter]
    fn N_M<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.n_m)
    }

    #[getter]
    fn J_e<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.j_e)
    }

    #[getter]
    fn J_e_inv<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.j_e_inv)
    }

    #[getter]
    fn E_e<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.e_e)
    }

    #[getter]
    fn mu<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.mu)
    }

    #[getter]
    fn Lambda_x<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.lambda_x)
    }

    #[getter]
    fn Lambda_n<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.lambda_n)
    }

    #[getter]
    fn N<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        matrix(py, &self.inner.null_projector())
    }
}
