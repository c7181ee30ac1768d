//! `Controller`: the torque law in somebody else's loop.

use crate::arm::Arm;
use crate::convert::{array1, document, matrix, named_document, number, read_vector, wrong_type};
use crate::errors::{self, InputError};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::PyDict;
use std::mem::replace;
use std::sync::{Mutex, MutexGuard, PoisonError};
use vff_core::control::energy::{ENERGIES, PORTS};
use vff_core::control::{self, Gains, ObjectiveScale, Settings, Tank, TaskKind};
use vff_core::math::Vector;
use vff_core::robot::PlanarState;
use vff_core::scenario;
use vff_core::trajectory::Sample;
use vff_core::world::World;

type Array1<'py> = Bound<'py, PyArray1<f64>>;

/// The torque law alone. Threads that share one take turns.
#[pyclass(frozen, module = "vffnull")]
pub struct Controller {
    law: Law,
}

enum Law {
    Position(Shared<2>),
    Pose(Shared<3>),
}

/// A law of task dimension M for `n` joints.
struct Shared<const M: usize> {
    n: usize,
    inner: Mutex<Inner<M>>,
}

struct Inner<const M: usize> {
    law: control::Controller<PlanarState, 2, M>,
    world: World,
    /// The obstacles of `world`, as they were given: the same again need not be read again.
    obstacles: Vec<Py<PyAny>>,
    /// The instant of the last call [s]: an energy tank fills and empties from one to the next.
    last: Option<f64>,
}

/// One call as it is given.
struct Call<'a, 'py> {
    q: &'a Bound<'py, PyAny>,
    dq: &'a Bound<'py, PyAny>,
    x: &'a Bound<'py, PyAny>,
    dx: Option<&'a Bound<'py, PyAny>>,
    ddx: Option<&'a Bound<'py, PyAny>>,
    obstacles: Option<&'a Bound<'py, PyAny>>,
    t: Option<&'a Bound<'py, PyAny>>,
}

impl Call<'_, '_> {
    fn reference<const M: usize>(&self) -> PyResult<Sample<M>> {
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

/// The time of a call [s], 0 if none is given.
fn time(t: Option<&Bound<'_, PyAny>>) -> PyResult<f64> {
    let t = t.map_or(Ok(0.0), |t| number("t", t))?;
    match t.is_finite() {
        true => Ok(t),
        false => Err(InputError::new_err(format!("t must be finite, got {t}"))),
    }
}

fn sequence<'py>(obstacles: &Bound<'py, PyAny>) -> PyResult<Vec<Bound<'py, PyAny>>> {
    obstacles
        .try_iter()
        .map_err(|_| wrong_type("obstacles: expected a sequence of obstacles", obstacles))?
        .collect()
}

impl<const M: usize> Shared<M> {
    fn new(state: PlanarState, n: usize, settings: &Settings) -> Self {
        let law = control::Controller::new(state, Gains::new(settings));
        let inner = Inner { law, world: World::new(vec![]), obstacles: vec![], last: None };
        Self { n, inner: Mutex::new(inner) }
    }

    /// Evaluates the law; `take` reads what it came to.
    fn evaluate<T>(
        &self,
        py: Python<'_>,
        call: &Call<'_, '_>,
        take: impl FnOnce(&control::Controller<PlanarState, 2, M>) -> T,
    ) -> PyResult<T> {
        let t = time(call.t)?;
        let mut state = vec![0.0; 2 * self.n];
        let (q, dq) = state.split_at_mut(self.n);
        read_vector("q", call.q, q)?;
        read_vector("dq", call.dq, dq)?;
        let reference = call.reference()?;
        self.among(py, call.obstacles, t, |inner| {
            let elapsed = inner.last.replace(t).map_or(0.0, |last| (t - last).max(0.0));
            let Inner { law, world, .. } = inner;
            law.elapse(elapsed);
            law.observe(q, dq, world);
            law.look_ahead(world, |ahead| reference.carried_on(ahead));
            law.command(&reference);
            take(law)
        })
    }

    /// Does something with the law among these obstacles at time `t`.
    ///
    /// Whatever may run Python code (arrays, obstacles) is read while the lock is not held: that
    /// code may call this very controller.
    fn among<T>(
        &self,
        py: Python<'_>,
        obstacles: Option<&Bound<'_, PyAny>>,
        t: f64,
        act: impl FnOnce(&mut Inner<M>) -> T,
    ) -> PyResult<T> {
        let given = obstacles.map_or(Ok(vec![]), sequence)?;
        let mut inner = self.lock(py);
        let mut old = vec![];
        if !inner.knows(py, &given) {
            drop(inner);
            let world = read_world(&given)?;
            inner = self.lock(py);
            inner.world = world;
            old = replace(&mut inner.obstacles, given.into_iter().map(Bound::unbind).collect());
        }
        inner.world.update(t);
        let done = act(&mut inner);
        drop(inner);
        drop(old); // which may run Python code, too
        Ok(done)
    }

    /// Waits for its turn without holding the GIL. What a panic may leave behind is overwritten by
    /// the next evaluation.
    fn lock(&self, py: Python<'_>) -> MutexGuard<'_, Inner<M>> {
        self.inner.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
    }
}

impl<const M: usize> Inner<M> {
    /// Whether these are the very obstacles of the last call. Only `Obstacle` is known not to
    /// change; a dict is read every time.
    fn knows(&self, py: Python<'_>, given: &[Bound<'_, PyAny>]) -> bool {
        given.len() == self.obstacles.len()
            && given.iter().zip(&self.obstacles).all(|(new, old)| new.is(old.bind(py)))
            && !given.iter().any(|o| o.is_instance_of::<PyDict>())
    }
}

/// The world of these obstacles.
pub fn read_world(given: &[Bound<'_, PyAny>]) -> PyResult<World> {
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
    #[pyo3(signature = (arm, settings=None, period=None))]
    fn new(
        arm: &Bound<'_, PyAny>,
        settings: Option<&Bound<'_, PyAny>>,
        period: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let py = arm.py();
        let arm = arm.cast::<Arm>().map_err(|_| wrong_type("arm: expected an Arm", arm))?.get();
        let n = arm.arm.dof();
        let settings = settings.map_or_else(|| Ok(toml::Table::new()), document)?;
        let settings = scenario::read_settings(&settings, &arm.arm)
            .map_err(|error| errors::scenario(&error))?;
        if let Some(period) = period {
            let period = number("period", period)?;
            if !(period.is_finite() && period > 0.0) {
                let message = format!("period must be finite and greater than 0, got {period}");
                return Err(InputError::new_err(message));
            }
            for warning in scenario::sampling_bounds(&settings, period) {
                errors::warn(py, &warning)?;
            }
        }
        let state = arm.arm.state();
        let law = match settings.task {
            TaskKind::Position => Law::Position(Shared::new(state, n, &settings)),
            TaskKind::Pose => Law::Pose(Shared::new(state, n, &settings)),
        };
        Ok(Self { law })
    }

    #[pyo3(
        signature = (q, dq, x_ref, dx_ref=None, ddx_ref=None, obstacles=None, t=None),
        text_signature = "($self, q, dq, x_ref, dx_ref=None, ddx_ref=None, obstacles=(), t=0.0)"
    )]
    #[expect(clippy::too_many_arguments, reason = "state and reference")]
    fn torque<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        x_ref: &Bound<'py, PyAny>,
        dx_ref: Option<&Bound<'py, PyAny>>,
        ddx_ref: Option<&Bound<'py, PyAny>>,
        obstacles: Option<&Bound<'py, PyAny>>,
        t: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Array1<'py>> {
        let call = Call { q, dq, x: x_ref, dx: dx_ref, ddx: ddx_ref, obstacles, t };
        let tau = either!(&self.law, shared => {
            shared.evaluate(py, &call, |law| law.torque().total.clone())
        });
        Ok(array1(py, &tau?))
    }

    #[pyo3(
        signature = (q, dq, x_ref, dx_ref=None, ddx_ref=None, obstacles=None, t=None),
        text_signature = "($self, q, dq, x_ref, dx_ref=None, ddx_ref=None, obstacles=(), t=0.0)"
    )]
    #[expect(clippy::too_many_arguments, reason = "state and reference")]
    fn terms<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        x_ref: &Bound<'py, PyAny>,
        dx_ref: Option<&Bound<'py, PyAny>>,
        ddx_ref: Option<&Bound<'py, PyAny>>,
        obstacles: Option<&Bound<'py, PyAny>>,
        t: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Terms> {
        let call = Call { q, dq, x: x_ref, dx: dx_ref, ddx: ddx_ref, obstacles, t };
        either!(&self.law, shared => shared.evaluate(py, &call, |law| Terms {
            tau: law.torque().total.clone(),
            tau_task: law.torque().task.clone(),
            tau_null: law.torque().null.clone(),
            tau_vff: law.forces().torque().to_vec(),
            force: law.forces().magnitude().to_vec(),
            clearance: law.forces().clearance().to_vec(),
            slack: law.slack(),
            projector: law.null_projector(),
            energy: law.energy().values(),
            power: law.power(&law.torque().total).values(),
            objective_scale: *law.objective_scale(),
            tank: law.tank().map(Tank::level),
            self_clearance: law.forces().self_clearance(),
            manipulability: law.manipulability(),
            singular: law.space().singular,
            null_acceleration: law.null_acceleration(),
        }))
    }

    #[pyo3(
        signature = (q, obstacles=None, t=None),
        text_signature = "($self, q, obstacles=(), t=0.0)"
    )]
    fn stable_period(
        &self,
        py: Python<'_>,
        q: &Bound<'_, PyAny>,
        obstacles: Option<&Bound<'_, PyAny>>,
        t: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(f64, f64, f64)> {
        let t = time(t)?;
        let found = either!(&self.law, shared => {
            let mut state = vec![0.0; 2 * shared.n];
            let (angles, rates) = state.split_at_mut(shared.n);
            read_vector("q", q, angles)?;
            shared.among(py, obstacles, t, |Inner { law, world, .. }| {
                law.observe(angles, rates, world);
                law.stable_period(world)
            })
        })?;
        Ok((found.period, found.stiffness, found.clearance))
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
    slack: Option<f64>,
    projector: nalgebra::DMatrix<f64>,
    energy: [f64; ENERGIES.len()],
    power: [f64; PORTS.len()],
    objective_scale: ObjectiveScale,
    tank: Option<f64>,
    self_clearance: f64,
    manipulability: f64,
    singular: bool,
    null_acceleration: f64,
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
    fn energy<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.energy)
    }

    #[getter]
    fn power<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.power)
    }

    #[getter]
    fn objective_scale<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.objective_scale)
    }

    #[getter]
    fn tank(&self) -> Option<f64> {
        self.tank
    }

    #[getter]
    fn self_clearance(&self) -> f64 {
        self.self_clearance
    }

    #[getter]
    fn manipulability(&self) -> f64 {
        self.manipulability
    }

    #[getter]
    fn singular(&self) -> bool {
        self.singular
    }

    #[getter]
    fn null_acceleration(&self) -> f64 {
        self.null_acceleration
    }

    #[getter]
    #[expect(non_snake_case, reason = "the name of the paper")]
    fn N<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.projector)
    }
}
