//! `Simulation`: a scenario one control period at a time.

use crate::convert::{array1, array2, scenario_document, vector};
use crate::errors;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use vff_core::simulation::{Snapshot, Status};
use vff_core::{runtime::AnyRun, scenario::Scenario};

type Array1<'py> = Bound<'py, PyArray1<f64>>;

/// A scenario under the control of its own law or of somebody else's.
#[pyclass(module = "vffnull")]
pub struct Simulation {
    scenario: Scenario,
    run: AnyRun,
    steps: usize,
    collided: bool,
    diverged: bool,
}

impl Simulation {
    fn prepare(scenario: &Scenario) -> PyResult<AnyRun> {
        Ok(scenario.prepare().map_err(|error| errors::scenario(&error))?.run)
    }

    fn present(&self) -> State {
        self.run.snapshot().into()
    }

    fn look(&mut self) {
        self.collided |= self.run.snapshot().clearance.iter().any(|d| *d < 0.0);
    }
}

#[pymethods]
impl Simulation {
    #[new]
    fn new(scenario: &Bound<'_, PyAny>) -> PyResult<Self> {
        let scenario = Scenario::from_document(&scenario_document(scenario)?)
            .map_err(|error| errors::scenario(&error))?;
        let run = Self::prepare(&scenario)?;
        let mut this = Self { scenario, run, steps: 0, collided: false, diverged: false };
        this.look();
        Ok(this)
    }

    #[pyo3(signature = (tau=None))]
    fn step(&mut self, tau: Option<&Bound<'_, PyAny>>) -> PyResult<State> {
        let n = self.scenario.q0.len();
        let tau = tau.map(|tau| vector("tau", tau, n)).transpose()?;
        for _ in 0..self.scenario.simulation.control_every {
            if self.diverged {
                break;
            }
            self.diverged = !self.run.advance(tau.as_deref());
            self.steps += usize::from(!self.diverged);
            self.look();
        }
        Ok(self.present())
    }

    fn reset(&mut self) -> PyResult<State> {
        self.run = Self::prepare(&self.scenario)?;
        (self.steps, self.collided, self.diverged) = (0, false, false);
        self.look();
        Ok(self.present())
    }

    #[getter]
    fn state(&self) -> State {
        self.present()
    }

    #[getter]
    fn done(&self) -> bool {
        self.diverged || self.steps >= self.scenario.simulation.steps(self.scenario.duration)
    }

    #[getter]
    fn status(&self) -> &'static str {
        match (self.diverged, self.collided) {
            (true, _) => Status::Diverged,
            (false, true) => Status::Collided,
            (false, false) => Status::Completed,
        }
        .name()
    }
}

/// A simulation at one instant.
#[pyclass(frozen, module = "vffnull")]
pub struct State {
    t: f64,
    q: Vec<f64>,
    dq: Vec<f64>,
    x: Vec<f64>,
    dx: Vec<f64>,
    x_ref: Vec<f64>,
    clearance: Vec<f64>,
    tau: Vec<f64>,
    obstacles: Vec<f64>,
    q_measured: Vec<f64>,
    dq_measured: Vec<f64>,
    tau_applied: Vec<f64>,
    sensed: Vec<f64>,
}

impl From<Snapshot<'_>> for State {
    fn from(s: Snapshot<'_>) -> Self {
        Self {
            t: s.t,
            q: s.q.to_vec(),
            dq: s.dq.to_vec(),
            x: s.x.to_vec(),
            dx: s.dx.to_vec(),
            x_ref: s.x_ref.to_vec(),
            clearance: s.clearance.to_vec(),
            tau: s.torque.total.clone(),
            obstacles: s.obstacles().flat_map(|p| [p.x, p.y]).collect(),
            q_measured: s.q_measured.to_vec(),
            dq_measured: s.dq_measured.to_vec(),
            tau_applied: s.tau_applied.to_vec(),
            sensed: s.sensed.iter().flat_map(|p| [p.x, p.y]).collect(),
        }
    }
}

#[pymethods]
impl State {
    #[getter]
    fn t(&self) -> f64 {
        self.t
    }

    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.q)
    }

    #[getter]
    fn dq<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.dq)
    }

    #[getter]
    fn x<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.x)
    }

    #[getter]
    fn dx<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.dx)
    }

    #[getter]
    fn x_ref<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.x_ref)
    }

    #[getter]
    fn clearance<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.clearance)
    }

    #[getter]
    fn tau<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.tau)
    }

    #[getter]
    fn obstacles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.obstacles.clone(), [self.obstacles.len() / 2, 2])
    }

    #[getter]
    fn q_measured<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        given(py, &self.q_measured)
    }

    #[getter]
    fn dq_measured<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        given(py, &self.dq_measured)
    }

    #[getter]
    fn tau_applied<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        given(py, &self.tau_applied)
    }

    #[getter]
    fn sensed<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let points = Some(&self.sensed).filter(|points| !points.is_empty());
        points.map(|points| array2(py, points.clone(), [points.len() / 2, 2])).transpose()
    }

    fn __repr__(&self) -> String {
        format!("<State: t = {} s>", self.t)
    }
}

/// What only a scenario with sensors or drives has.
fn given<'py>(py: Python<'py>, values: &[f64]) -> Option<Array1<'py>> {
    (!values.is_empty()).then(|| array1(py, values))
}
