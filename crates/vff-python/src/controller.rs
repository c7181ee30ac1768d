//! `Controller`: the torque law in somebody else's loop.

use crate::arm::Arm;
use crate::convert::{
    array1, document, instead, load_numpy, matrix, named_document, number, read_vector, wrong_type,
};
use crate::errors::{self, InputError};
use crate::turns::Turns;
use crate::watch::attended;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::mem::replace;
use vff_core::control::energy::{ENERGIES, PORTS};
use vff_core::control::{self, Avoidance, Gains, ObjectiveScale, Settings, Tank, TaskKind};
use vff_core::math::{Vector, memory};
use vff_core::robot::Model;
use vff_core::scenario;
use vff_core::simulation::{Plane, System};
use vff_core::trajectory::Sample;
use vff_core::world::plane::World;

type Array1<'py> = Bound<'py, PyArray1<f64>>;

/// The torque law alone, for a loop of your own. Threads that share one take turns.
///
/// Parameters
/// ----------
/// arm : Arm
///     The arm's model.
/// settings : ControlSettings or dict, optional
///     Gains, field, and variant of the law; the defaults of a scenario if not given.
/// period : float, optional
///     Control period [s] of your loop: gains that a torque held so long makes unstable are warned of.
///
/// strict : bool, optional
///     Whether `torque` and `terms` raise where the torque is not finite, which states and references beyond
///     all reason (1e154 rad/s) lead to; by default it is returned, and `Terms.finite` is False.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the settings do not suit the arm.
///
/// Notes
/// -----
/// A call that is interrupted, and one whose torque is not finite, leaves the controller as new: an energy
/// tank is as full as at the start.
///
/// Examples
/// --------
/// >>> controller = Controller(Arm.uniform(6), {"stiffness": 16.0, "damping": 8.0})
/// >>> controller.torque([0.1] * 6, [0.0] * 6, x_ref=[4.0, 2.0]).shape
/// (6,)
#[pyclass(frozen, module = "vffnull")]
pub struct Controller {
    law: Law,
    strict: bool,
}

enum Law {
    Position(Shared<Plane, 2>),
    Pose(Shared<Plane, 3>),
}

/// A law of task dimension M for `n` joints.
struct Shared<S: System<2, M>, const M: usize> {
    n: usize,
    settings: Settings,
    inner: Turns<Inner<S, M>>,
}

struct Inner<S: System<2, M>, const M: usize> {
    law: control::Controller<S::State, 2, M>,
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
    fn reference<P: From<Vector<M>>, const M: usize>(&self) -> PyResult<Sample<P, M>> {
        let read = |name, value: Option<&Bound<'_, PyAny>>| -> PyResult<Vector<M>> {
            let mut out = Vector::<M>::zeros();
            value.map_or(Ok(()), |value| read_vector(name, value, out.as_mut_slice()))?;
            Ok(out)
        };
        Ok(Sample {
            x: read("x_ref", Some(self.x))?.into(),
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

/// The obstacles of a call.
pub fn sequence<'py>(obstacles: &Bound<'py, PyAny>) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let sentence = "obstacles: expected a sequence of obstacles";
    let fault = |error| instead(obstacles, error, || wrong_type(sentence, obstacles));
    obstacles.try_iter().map_err(fault)?.collect()
}

impl<S: System<2, M, Pose: From<Vector<M>>>, const M: usize> Shared<S, M> {
    fn new(state: S::State, n: usize, settings: &Settings) -> Self {
        let law = control::Controller::new(state, Gains::new(settings));
        let inner = Inner { law, world: World::new(vec![]), obstacles: vec![], last: None };
        Self { n, settings: settings.clone(), inner: Turns::new("controller", inner) }
    }

    /// Evaluates the law; `take` reads what it came to. With it, whether the torque is finite.
    fn evaluate<T>(
        &self,
        py: Python<'_>,
        call: &Call<'_, '_>,
        take: impl FnOnce(&control::Controller<S::State, 2, M>) -> T,
    ) -> PyResult<(T, bool)> {
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
            let finite = law.torque().total.iter().all(|tau| tau.is_finite());
            let taken = take(law);
            if !finite {
                inner.law_anew();
            }
            (taken, finite)
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
        act: impl FnOnce(&mut Inner<S, M>) -> T,
    ) -> PyResult<T> {
        let given = obstacles.map_or(Ok(vec![]), sequence)?;
        let mut inner = self.inner.take(py)?;
        let mut old = vec![];
        if !inner.knows(py, &given) {
            drop(inner);
            let world = read_world(&given)?;
            let barriers = (0..world.len()).map(|j| world.obstacle(j).shape.barriers()).sum();
            scenario::validate_size(&self.settings, self.n, barriers)
                .map_err(|error| errors::scenario(&error))?;
            inner = self.inner.take(py)?;
            inner.world = world;
            old = replace(&mut inner.obstacles, given.into_iter().map(Bound::unbind).collect());
        }
        let done = attended(|| {
            inner.world.update(t);
            act(&mut inner)
        });
        if done.is_err() {
            old = inner.begin_anew();
        }
        drop(inner);
        drop(old); // which may run Python code, too
        done
    }
}

impl<S: System<2, M>, const M: usize> Inner<S, M> {
    /// Forgets everything, after a call that was broken off midway. Returns what has to be dropped later.
    fn begin_anew(&mut self) -> Vec<Py<PyAny>> {
        self.law_anew();
        self.world = World::new(vec![]);
        std::mem::take(&mut self.obstacles)
    }

    fn law_anew(&mut self) {
        self.law = control::Controller::new(self.law.robot().clone(), self.law.gains().clone());
        self.last = None;
    }

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
        if j % 256 == 255 {
            obstacle.py().check_signals()?;
        }
        let name = format!("obstacles[{j}]");
        scenario::read_obstacle::<Plane, 2>(&named_document(&name, obstacle)?)
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
    #[pyo3(signature = (arm, settings=None, period=None, strict=false))]
    fn new(
        arm: &Bound<'_, PyAny>,
        settings: Option<&Bound<'_, PyAny>>,
        period: Option<&Bound<'_, PyAny>>,
        strict: bool,
    ) -> PyResult<Self> {
        let py = arm.py();
        load_numpy(py)?;
        let arm = arm.cast::<Arm>().map_err(|_| wrong_type("arm: expected an Arm", arm))?.get();
        let n = arm.arm.dof();
        let settings = settings.map(document).transpose()?.unwrap_or_default();
        let settings = scenario::read_settings(&settings, arm.arm.limits(), [arm.arm.dof(), 2])
            .map_err(|error| errors::scenario(&error))?;
        if let Some(period) = period {
            let period = number("period", period)?;
            if !(period.is_finite() && period > 0.0) {
                let message = format!("period must be finite and greater than 0, got {period}");
                return Err(InputError::new_err(message));
            }
            for warning in scenario::sampling_bounds(
                &settings,
                settings.task.dimension(2).unwrap_or_default(),
                period,
            ) {
                errors::warn(py, &warning)?;
            }
        }
        let state = arm.arm.state();
        let law = match settings.task {
            TaskKind::Position => Law::Position(Shared::new(state, n, &settings)),
            TaskKind::Pose => Law::Pose(Shared::new(state, n, &settings)),
            TaskKind::Pointing => unreachable!("validated: no task of the plane"),
        };
        Ok(Self { law, strict })
    }

    /// Joint torque at a state.
    ///
    /// Parameters
    /// ----------
    /// q, dq : (n,) array_like
    ///     Joint angles [rad] and velocities [rad/s].
    /// x_ref, dx_ref, ddx_ref : (m,) array_like
    ///     Reference of the end effector [m], its velocity [m/s] and acceleration [m/s²]; the last two are 0
    ///     if not given. For the task ``"pose"``, m is 3 and an orientation [rad] comes last. It is taken as
    ///     it is: the settings' `governor` acts in simulations alone.
    /// obstacles : sequence of Obstacle or dict, optional
    ///     What to keep away from; nothing by default.
    /// t : float, optional
    ///     Time [s] at which the obstacles' motions are taken.
    ///
    /// Returns
    /// -------
    /// (n,) ndarray
    ///     Joint torque [N·m].
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If an array has the wrong shape or is not finite.
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
        let done = either!(&self.law, shared => {
            shared.evaluate(py, &call, |law| law.torque().total.clone())
        });
        Ok(array1(py, &self.judged(done?)?))
    }

    /// The same torque with its parts; parameters as in `torque`.
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
        let n = either!(&self.law, shared => shared.n);
        memory::fits(n.saturating_mul(n).saturating_mul(6)).map_err(|error| {
            InputError::new_err(format!("the projector of {n} joints: {error}"))
        })?;
        let done = either!(&self.law, shared => shared.evaluate(py, &call, |law| Terms {
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
        }))?;
        self.judged(done)
    }

    /// The longest time that the torque may be held at a configuration before the null space oscillates.
    ///
    /// Parameters
    /// ----------
    /// q : (n,) array_like
    ///     Joint angles [rad].
    /// obstacles : sequence of Obstacle or dict, optional
    ///     What is near.
    /// t : float, optional
    ///     Time [s] at which the obstacles' motions are taken.
    ///
    /// Returns
    /// -------
    /// period : float
    ///     The largest stable control period [s] (docs/theory.md, T34).
    /// stiffness : float
    ///     Stiffness of the field [N/m] at the contact that sets it; 0 if the null damping does.
    /// clearance : float
    ///     Clearance of that contact [m]; infinite without one.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If an array has the wrong shape or is not finite.
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

    fn __repr__(&self) -> String {
        let (n, settings) = either!(&self.law, shared => (shared.n, &shared.settings));
        let task = match settings.task {
            TaskKind::Position => "position",
            TaskKind::Pose => "pose",
            TaskKind::Pointing => "pointing",
        };
        let avoidance = match settings.avoidance {
            Avoidance::NullSpace => "null_space",
            Avoidance::Relaxed => "relaxed",
            Avoidance::Priority => "priority",
            Avoidance::Cbf => "cbf",
        };
        let joints = if n == 1 { "joint" } else { "joints" };
        format!("<Controller: {n} {joints}, {task} task, avoidance {avoidance}>")
    }
}

impl Controller {
    /// What an evaluation came to, unless it is not finite and that is to be said.
    fn judged<T>(&self, (done, finite): (T, bool)) -> PyResult<T> {
        match finite || !self.strict {
            true => Ok(done),
            false => Err(InputError::new_err(
                "the torque at this state and reference is not finite: they are beyond what numbers can hold",
            )),
        }
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
    /// By how much barriers are broken at most [m/s²]; 0 without ``avoidance="cbf"``.
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
    /// Joint torque, (n,) [N·m].
    #[getter]
    fn tau<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.tau)
    }

    /// What serves the task, and what makes it give way, (n,) [N·m].
    #[getter]
    fn tau_task<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.tau_task)
    }

    /// What acts in the null space, (n,) [N·m].
    #[getter]
    fn tau_null<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.tau_null)
    }

    /// Repulsion Σ JᵢᵀFᵢ before its projection, (n,) [N·m].
    #[getter]
    fn tau_vff<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.tau_vff)
    }

    /// Magnitude of the repulsion on each link, (n,) [N].
    #[getter]
    fn force<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.force)
    }

    /// Signed distance of each link's surface to the nearest obstacle's, (n,) [m].
    #[getter]
    fn clearance<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.clearance)
    }

    /// Energies as named in `ENERGIES`, (3,) [J].
    #[getter]
    fn energy<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.energy)
    }

    /// Powers as named in `PORTS`, (6,) [W].
    #[getter]
    fn power<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.power)
    }

    /// What the limits let through of each of `OBJECTIVES`, (6,), from 0 to 1.
    #[getter]
    fn objective_scale<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.objective_scale)
    }

    /// Energy in the tank [J]; None without one.
    #[getter]
    fn tank(&self) -> Option<f64> {
        self.tank
    }

    /// Signed distance of the nearest two links that share no joint [m]; infinite if not measured.
    #[getter]
    fn self_clearance(&self) -> f64 {
        self.self_clearance
    }

    /// √det(J Jᵀ) [m²], 0 in a singularity.
    #[getter]
    fn manipulability(&self) -> f64 {
        self.manipulability
    }

    /// Whether the task force is damped because of a singularity.
    #[getter]
    fn singular(&self) -> bool {
        self.singular
    }

    /// ‖J M⁻¹ τ_null‖ [m/s²]: what leaks into the task.
    #[getter]
    fn null_acceleration(&self) -> f64 {
        self.null_acceleration
    }

    /// Whether the torque is finite: it is not at states and references beyond what numbers can hold.
    #[getter]
    fn finite(&self) -> bool {
        self.tau.iter().all(|tau| tau.is_finite())
    }

    fn __repr__(&self) -> String {
        let clearance = self.clearance.iter().copied().fold(f64::INFINITY, f64::min);
        let largest = self.tau.iter().fold(0.0, |most: f64, tau| most.max(tau.abs()));
        let torque = match self.finite() {
            true => format!("up to {largest:.4} N·m"),
            false => "torque not finite".into(),
        };
        format!("<Terms: {} joints, {torque}, clearance {clearance:.4} m>", self.tau.len())
    }

    /// Null-space projector, (n, n).
    #[getter]
    #[expect(non_snake_case, reason = "the name of the paper")]
    fn N<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.projector)
    }
}
