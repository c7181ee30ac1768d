//! `Controller`: the torque law in somebody else's loop.

use crate::arm::Arm;
use crate::convert::{array1, document, matrix, named_document, number, read_vector, wrong_type};
use crate::errors::{self, InputError};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use vff_core::control::{self, Gains, TaskKind};
use vff_core::math::Vector;
use vff_core::robot::PlanarState;
use vff_core::scenario;
use vff_core::trajectory::Sample;
use vff_core::world::World;

type Array1<'py> = Bound<'py, PyArray1<f64>>;

/// The torque law alone.
#[pyclass(module = "vffnull")]
pub struct Controller {
    law: Law,
    world: World,
    /// The obstacles of `world`, as they were given: the same again need not be read again.
    obstacles: Vec<Py<PyAny>>,
    q: Vec<f64>,
    dq: Vec<f64>,
}

enum Law {
    Position(control::Controller<PlanarState, 2, 2>),
    Pose(control::Controller<PlanarState, 2, 3>),
}

/// The reference as it is given to a call.
struct Reference<'a, 'py> {
    x: &'a Bound<'py, PyAny>,
    dx: Option<&'a Bound<'py, PyAny>>,
    ddx: Option<&'a Bound<'py, PyAny>>,
}

impl Reference<'_, '_> {
    fn read<const M: usize>(&self) -> PyResult<Sample<M>> {
        let read = |name, value: Option<&Bound<'_, PyAny>>| -> PyResult<Vector<M>> {
            let mut out = Vector::<M>::zeros();
            value.map_or(Ok(()), |value| read_vector(name, value, out.as_mut_slice()))?;
            Ok(out)
        };
        Ok(Sample {
            x: read("x_ref", Some(self.x))?,
            dx: read("dx_ref", self.dx)?,
            ddx: read("ddx_ref", self.ddx)?,
        })
    }
}

impl Controller {
    fn evaluate(
        &mut self,
        q: &Bound<'_, PyAny>,
        dq: &Bound<'_, PyAny>,
        reference: &Reference<'_, '_>,
        obstacles: &Bound<'_, PyAny>,
        t: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let t = t.map_or(Ok(0.0), |t| number("t", t))?;
        if !t.is_finite() {
            return Err(InputError::new_err(format!("t must be finite, got {t}")));
        }
        read_vector("q", q, &mut self.q)?;
        read_vector("dq", dq, &mut self.dq)?;
        self.look_around(obstacles)?;
        let Self { law, world, q, dq, .. } = self;
        world.update(t);
        match law {
            Law::Position(law) => {
                law.observe(q, dq, world);
                law.command(&reference.read()?);
            }
            Law::Pose(law) => {
                law.observe(q, dq, world);
                law.command(&reference.read()?);
            }
        }
        Ok(())
    }

    /// Takes over the obstacles, unless they are the very objects of the last call. Only `Obstacle`
    /// is known not to change; a dict is read every time.
    fn look_around(&mut self, obstacles: &Bound<'_, PyAny>) -> PyResult<()> {
        let py = obstacles.py();
        let given: Vec<Bound<'_, PyAny>> = obstacles
            .try_iter()
            .map_err(|_| wrong_type("obstacles: expected a sequence of obstacles", obstacles))?
            .collect::<PyResult<_>>()?;
        let same = given.len() == self.obstacles.len()
            && given.iter().zip(&self.obstacles).all(|(new, old)| new.is(old.bind(py)));
        if same && !given.iter().any(|o| o.is_instance_of::<pyo3::types::PyDict>()) {
            return Ok(());
        }
        self.world = read_obstacles(&given)?;
        self.obstacles = given.into_iter().map(Bound::unbind).collect();
        Ok(())
    }
}

/// The world of these obstacles.
pub fn read_obstacles(given: &[Bound<'_, PyAny>]) -> PyResult<World> {
    let read = |(j, obstacle): (usize, &Bound<'_, PyAny>)| {
        let name = format!("obstacles[{j}]");
        scenario::read_obstacle(&named_document(&name, obstacle)?)
            .map_err(|error| errors::scenario(&error.inside(&name)))
    };
    Ok(World::new(given.iter().enumerate().map(read).collect::<PyResult<_>>()?))
}

macro_rules! either {
    ($law:expr, $inner:ident => $body:expr) => {
        match $law {
            Law::Position($inner) => $body,
            Law::Pose($inner) => $body,
        }
    };
}

#[pymethods]
impl Controller {
    #[new]
    fn new(arm: &Bound<'_, PyAny>, settings: &Bound<'_, PyAny>) -> PyResult<Self> {
        let arm = arm.cast::<Arm>().map_err(|_| wrong_type("arm: expected an Arm", arm))?.get();
        let n = arm.arm.dof();
        let settings = scenario::read_settings(&document(settings)?, n)
            .map_err(|error| errors::scenario(&error))?;
        let state = arm.arm.state();
        let law = match settings.task {
            TaskKind::Position => {
                Law::Position(control::Controller::new(state, Gains::new(&settings)))
            }
            TaskKind::Pose => Law::Pose(control::Controller::new(state, Gains::new(&settings))),
        };
        Ok(Self {
            law,
            world: World::new(vec![]),
            obstacles: vec![],
            q: vec![0.0; n],
            dq: vec![0.0; n],
        })
    }

    #[pyo3(
        signature = (q, dq, x_ref, dx_ref=None, ddx_ref=None, obstacles=None, t=None),
        text_signature = "($self, q, dq, x_ref, dx_ref=None, ddx_ref=None, obstacles=(), t=0.0)"
    )]
    #[expect(clippy::too_many_arguments, reason = "state and reference")]
    fn torque<'py>(
        &mut self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        x_ref: &Bound<'py, PyAny>,
        dx_ref: Option<&Bound<'py, PyAny>>,
        ddx_ref: Option<&Bound<'py, PyAny>>,
        obstacles: Option<&Bound<'py, PyAny>>,
        t: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Array1<'py>> {
        let reference = Reference { x: x_ref, dx: dx_ref, ddx: ddx_ref };
        let none = pyo3::types::PyTuple::empty(py).into_any();
        self.evaluate(q, dq, &reference, obstacles.unwrap_or(&none), t)?;
        Ok(array1(py, either!(&self.law, law => &law.torque().total)))
    }

    #[pyo3(
        signature = (q, dq, x_ref, dx_ref=None, ddx_ref=None, obstacles=None, t=None),
        text_signature = "($self, q, dq, x_ref, dx_ref=None, ddx_ref=None, obstacles=(), t=0.0)"
    )]
    #[expect(clippy::too_many_arguments, reason = "state and reference")]
    fn terms<'py>(
        &mut self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        x_ref: &Bound<'py, PyAny>,
        dx_ref: Option<&Bound<'py, PyAny>>,
        ddx_ref: Option<&Bound<'py, PyAny>>,
        obstacles: Option<&Bound<'py, PyAny>>,
        t: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Terms> {
        self.torque(py, q, dq, x_ref, dx_ref, ddx_ref, obstacles, t)?;
        Ok(either!(&self.law, law => Terms {
            tau: law.torque().total.clone(),
            tau_task: law.torque().task.clone(),
            tau_null: law.torque().null.clone(),
            tau_vff: law.forces().torque().to_vec(),
            force: law.forces().magnitude().to_vec(),
            clearance: law.forces().clearance().to_vec(),
            slack: law.slack().unwrap_or(0.0),
            projector: law.null_projector(),
        }))
    }
}

/// The parts of the torque at one state.
#[pyclass(frozen, module = "vffnull")]
pub struct Terms {
    tau: Vec<f64>,
    tau_task: Vec<f64>,
    tau_null: Vec<f64>,
    tau_vff: Vec<f64>,
    force: Vec<f64>,
    clearance: Vec<f64>,
    #[pyo3(get)]
    slack: f64,
    projector: nalgebra::DMatrix<f64>,
}

#[pymethods]
impl Terms {
    #[getter]
    fn tau<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.tau)
    }

    #[getter]
    fn tau_task<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.tau_task)
    }

    #[getter]
    fn tau_null<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.tau_null)
    }

    #[getter]
    fn tau_vff<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.tau_vff)
    }

    #[getter]
    fn force<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.force)
    }

    #[getter]
    fn clearance<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.clearance)
    }

    #[getter]
    #[expect(non_snake_case, reason = "the name of the paper")]
    fn N<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.projector)
    }
}
