//! `Simulation`: a scenario one control period at a time.

use crate::call::new_points;
use crate::convert::{self, array1, array2, depth_pictures, self_motion_map, vector};
use crate::errors::{self, InputError};
use crate::exclusive::Exclusive;
use crate::run::prepared;
use crate::watch::{interruptible, is_heard, stepwise};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use vff_core::runtime::AnyRun;
use vff_core::runtime::points::make;
use vff_core::scenario::{Scenario, ScenarioError};
use vff_core::simulation::{Snapshot, Status};
use vff_core::world::Positions;

type Array1<'py> = Bound<'py, PyArray1<f64>>;

/// A scenario, one step at a time, with its own controller or somebody else's.
///
/// Parameters
/// ----------
/// scenario : Scenario, dict, str or path
///     What to simulate; a bundled scenario's name or a file.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the scenario cannot be run.
///
/// Examples
/// --------
/// >>> simulation = Simulation(Scenario.load("sweep-through"))  # doctest: +SKIP
/// >>> while not simulation.done:  # doctest: +SKIP
/// ...     state = simulation.step(my_controller(simulation.state))
#[pyclass(frozen, module = "vffnull")]
pub struct Simulation {
    inner: Exclusive<Inner>,
}

struct Inner {
    scenario: Scenario,
    run: AnyRun,
    steps: usize,
    /// Plant steps that the present control period has left, after it was interrupted.
    left: usize,
    collided: bool,
    diverged: bool,
    /// Whether a step was broken off midway.
    broken: bool,
}

impl Inner {
    fn new(scenario: Scenario) -> Result<Self, ScenarioError> {
        let run = scenario.prepare_recorded(false)?.run;
        let (steps, left) = (0, 0);
        let (collided, diverged, broken) = (false, false, false);
        let mut this = Self { scenario, run, steps, left, collided, diverged, broken };
        this.refresh();
        Ok(this)
    }

    fn refresh(&mut self) {
        self.collided |= self.run.snapshot().collides();
    }

    fn present(&self) -> PyResult<State> {
        match self.broken {
            false => Ok(self.run.snapshot().into()),
            true => Err(InputError::new_err(
                "simulation: was interrupted in the middle of a step; reset() takes it back to its start",
            )),
        }
    }

    /// Goes to the end of the control period, or until a signal handler raises.
    fn advance(&mut self, tau: Option<&[f64]>) {
        if self.left == 0 {
            let Scenario { simulation, duration, .. } = &self.scenario;
            let rest = simulation.steps(*duration).saturating_sub(self.steps);
            self.left = if rest > 0 {
                rest.min(simulation.control_every)
            } else {
                simulation.control_every
            };
        }
        while self.left > 0 && !self.diverged && !is_heard() {
            self.diverged = !self.run.advance(tau);
            self.steps += usize::from(!self.diverged);
            self.left -= 1;
            self.refresh();
        }
        if self.diverged {
            self.left = 0;
        }
    }

    fn is_done(&self) -> bool {
        self.diverged || self.steps >= self.scenario.simulation.steps(self.scenario.duration)
    }

    fn status(&self) -> &'static str {
        match (self.diverged, self.collided) {
            (true, _) => Status::Diverged,
            (false, true) => Status::Collided,
            (false, false) => Status::Completed,
        }
        .name()
    }
}

#[pymethods]
impl Simulation {
    #[new]
    fn new(scenario: &Bound<'_, PyAny>) -> PyResult<Self> {
        let inner = prepared(scenario.py(), &convert::scenario(scenario)?, Inner::new)?;
        Ok(Self { inner: Exclusive::new("simulation", inner) })
    }

    /// Advance by one control period.
    ///
    /// Parameters
    /// ----------
    /// tau : (n,) array_like, optional
    ///     What is sent to the robot [N·m] during the period, without gravity where that adds it, as
    ///     `Controller.torque` has it; the scenario's own law by default.
    ///
    /// Returns
    /// -------
    /// State
    ///     The state after the period.
    #[pyo3(signature = (tau=None))]
    fn step(&self, py: Python<'_>, tau: Option<&Bound<'_, PyAny>>) -> PyResult<State> {
        let n = self.inner.take(py)?.scenario.q0.len();
        let tau = tau.map(|tau| vector("tau", tau, n)).transpose()?;
        let mut inner = self.inner.take(py)?;
        inner.present()?;
        let present = &mut *inner;
        let (done, heard) = stepwise(py, || present.advance(tau.as_deref()));
        inner.broken = done.is_none();
        heard?;
        inner.present()
    }

    /// Put other points in place of those of a cloud, from now on.
    ///
    /// It keeps its place, its motion and its radius; `reset` gives it back the points of the scenario.
    ///
    /// Parameters
    /// ----------
    /// cloud : (k, 3) array_like
    ///     The points [m], relative to the obstacle's position: at most 50 000, maybe none.
    /// obstacle : int, optional
    ///     Which of the scenario's obstacles it is; the first by default.
    /// velocities : (k, 3) array_like, optional
    ///     At which velocities the points go on by themselves [m/s], in the same frame, until others take
    ///     their place (docs/theory-spatial.md, T180). Without, they rest.
    /// t : float, optional
    ///     When they were there [s], on the clock of the simulation: that of the image. Without, now.
    ///
    /// Returns
    /// -------
    /// State
    ///     The state among them.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If they are not points in space, not finite or too many, if there is not one velocity to each, or
    ///     if the obstacle is no cloud. The points are those of before then.
    #[pyo3(
        signature = (cloud, obstacle=None, velocities=None, t=None),
        text_signature = "($self, cloud, obstacle=0, velocities=None, t=None)"
    )]
    fn update_points(
        &self,
        py: Python<'_>,
        cloud: &Bound<'_, PyAny>,
        obstacle: Option<&Bound<'_, PyAny>>,
        velocities: Option<&Bound<'_, PyAny>>,
        t: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<State> {
        let (given, j) = new_points(cloud, obstacle, velocities, t)?;
        let fault = |error: &dyn ToString| InputError::new_err(error.to_string());
        let inner = self.inner.take(py)?;
        inner.present()?;
        let orientation = inner.run.orientation_of_points(j).map_err(|e| fault(&e))?;
        drop(inner);
        let made = interruptible(py, || make(given, orientation))?.map_err(|e| fault(&e))?;
        let mut inner = self.inner.take(py)?;
        inner.present()?;
        let Inner { run, scenario, .. } = &mut *inner;
        let (done, heard) = stepwise(py, || run.update_points(j, &made, &scenario.controller));
        inner.broken = done.is_none();
        heard?;
        done.map_or(Ok(()), |done| done.map_err(|e| fault(&e)))?;
        inner.refresh();
        inner.present()
    }

    /// Push the arm, from now on, until the wrench is over.
    ///
    /// Parameters
    /// ----------
    /// wrench : Wrench or dict
    ///     Where and how; its `start` counts from now. `reset` takes it away.
    ///
    /// Returns
    /// -------
    /// State
    ///     The state with it.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.ScenarioError
    ///     If the arm has no such link, a number makes no sense, or 1000 push already.
    ///
    /// Examples
    /// --------
    /// >>> simulation = Simulation(Scenario.load("panda-sweep"))  # doctest: +SKIP
    /// >>> push = Wrench("panda_link4", force=[0, 20, 0], duration=0.5)  # doctest: +SKIP
    /// >>> simulation.push(push).tau_ext.shape  # doctest: +SKIP
    /// (7,)
    fn push(&self, py: Python<'_>, wrench: &Bound<'_, PyAny>) -> PyResult<State> {
        let wrench = convert::named_document("wrench", wrench)?;
        let mut inner = self.inner.take(py)?;
        inner.present()?;
        let done = inner.run.push(&wrench);
        done.map_err(|error| errors::scenario(&error.inside("wrench")))?;
        inner.present()
    }

    /// Pull at a point of a link towards a place with a spring and a damper, from now on, or let go.
    ///
    /// A hand that holds the link: K (anchor − p) − D ṗ acts at the point p, evaluated with the dynamics. A
    /// step of the plant is taken in parts where the spring is stiff for it (docs/theory.md, T146, T147). It
    /// is part of `tau_ext`.
    ///
    /// Parameters
    /// ----------
    /// link : str, optional
    ///     The name of the link, or ``"tip"``; by default whoever pulls lets go.
    /// point : (D,) array_like, optional
    ///     The point, in the link's frame [m]; its origin by default.
    /// anchor : (D,) array_like, optional
    ///     The place in the world that it is pulled towards [m]; by default where the point is now.
    /// stiffness : float, optional
    ///     K [N/m]; by default 100 1/s² times the mean mass with which the point resists now, so that the
    ///     link swings at 10 rad/s.
    /// damping : float, optional
    ///     D [N·s/m]; critical by default.
    ///
    /// Returns
    /// -------
    /// State
    ///     The state with it.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.ScenarioError
    ///     If the arm has no such link, or a number makes no sense. Whoever pulled goes on then.
    ///
    /// Examples
    /// --------
    /// >>> simulation = Simulation(Scenario.load("panda-sweep"))  # doctest: +SKIP
    /// >>> simulation.pull("panda_link4", anchor=[0.2, 0.3, 0.7], stiffness=300.0)  # doctest: +SKIP
    /// <State: t = 0 s>
    /// >>> simulation.pull(None)  # doctest: +SKIP
    /// <State: t = 0 s>
    #[pyo3(signature = (link=None, *, point=None, anchor=None, stiffness=None, damping=None))]
    fn pull(
        &self,
        py: Python<'_>,
        link: Option<&Bound<'_, PyAny>>,
        point: Option<&Bound<'_, PyAny>>,
        anchor: Option<&Bound<'_, PyAny>>,
        stiffness: Option<&Bound<'_, PyAny>>,
        damping: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<State> {
        let values = [
            ("link", link),
            ("point", point),
            ("anchor", anchor),
            ("stiffness", stiffness),
            ("damping", damping),
        ];
        let pull = link.map(|_| convert::keywords("pull", py, &values)).transpose()?;
        let mut inner = self.inner.take(py)?;
        inner.present()?;
        let done = inner.run.pull(pull.as_ref());
        done.map_err(|error| errors::scenario(&error.inside("pull")))?;
        inner.present()
    }

    /// Go back to the start.
    fn reset(&self, py: Python<'_>) -> PyResult<State> {
        let mut inner = self.inner.take(py)?;
        let scenario = inner.scenario.clone();
        *inner = interruptible(py, || Inner::new(scenario))?
            .map_err(|error| errors::scenario(&error))?;
        inner.present()
    }

    /// The present state.
    #[getter]
    fn state(&self, py: Python<'_>) -> PyResult<State> {
        self.inner.take(py)?.present()
    }

    /// The pictures of depth cameras that arrived last, (rows, columns) [m] each, 0 where nothing was
    /// measured; none without such cameras.
    #[getter]
    fn pictures<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
        depth_pictures(py, self.inner.take(py)?.run.pictures())
    }

    /// What the search of the self-motion has found last (`yielding.preview.self_motion`); None without
    /// one, and while nothing comes near.
    ///
    /// ``distances`` (places, instants) [m]: the smallest distance of every posture along the self-motion,
    /// that at which the search began in the middle, at every instant from then on; infinite beyond
    /// ``clearance`` [m], NaN where there is no posture or nobody can be that early. ``path``
    /// (instants,): the places along the path that is followed, which keeps ``margin`` [m]; empty where
    /// there is none. ``spacing`` from place to place [rad], ``step`` from instant to instant [s],
    /// ``elapsed`` since the search began [s].
    #[getter]
    fn self_motion_map<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self_motion_map(py, self.inner.take(py)?.run.self_motion_map())
    }

    /// Whether the scenario's duration is over or the run has failed.
    #[getter]
    fn done(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.inner.take(py)?.is_done())
    }

    /// How the run stands: ``"completed"``, ``"collided"`` or ``"diverged"`` up to now.
    #[getter]
    fn status(&self, py: Python<'_>) -> PyResult<&'static str> {
        Ok(self.inner.take(py)?.status())
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let inner = self.inner.take(py)?;
        let (n, t) = (inner.scenario.q0.len(), inner.run.snapshot().t);
        let name = convert::cut(&inner.scenario.name);
        let name = if name.is_empty() { String::new() } else { format!(" {name:?}") };
        let (duration, status) = (inner.scenario.duration, inner.status());
        Ok(format!("<Simulation{name}: {n} joints, t = {t} of {duration} s, {status}>"))
    }
}

/// A simulation at one instant; m is 2 for a position and 3 for a pose.
#[pyclass(frozen, module = "vffnull")]
pub struct State {
    /// Dimension of the space.
    dimension: usize,
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
    tau_ext: Vec<f64>,
    contact_force: Vec<f64>,
    tau_ext_estimate: Vec<f64>,
    wrench_estimate: Vec<f64>,
    touched_link: Option<usize>,
    yielded: Option<f64>,
    released: Option<f64>,
    sensed: Vec<f64>,
}

impl From<Snapshot<'_>> for State {
    fn from(s: Snapshot<'_>) -> Self {
        Self {
            dimension: s.dimension,
            t: s.t,
            q: s.q.to_vec(),
            dq: s.dq.to_vec(),
            x: s.x.to_vec(),
            dx: s.dx.to_vec(),
            x_ref: s.x_ref.to_vec(),
            clearance: s.clearance.to_vec(),
            tau: s.torque.total.clone(),
            obstacles: written(Some(s.obstacles)),
            q_measured: s.q_measured.to_vec(),
            dq_measured: s.dq_measured.to_vec(),
            tau_applied: s.tau_applied.to_vec(),
            tau_ext: s.tau_ext.unwrap_or_default().to_vec(),
            contact_force: s.contact_force.unwrap_or_default().to_vec(),
            tau_ext_estimate: s.tau_ext_estimate.unwrap_or_default().to_vec(),
            wrench_estimate: s.wrench_estimate.unwrap_or_default().to_vec(),
            touched_link: s.touched_link.filter(|link| *link < s.q.len()),
            yielded: s.yielded,
            #[expect(clippy::cast_precision_loss, reason = "few parts")]
            released: s.released.map(|parts| parts as f64),
            sensed: written(s.sensed),
        }
    }
}

/// The coordinates of these points, one after the other.
fn written(points: Option<&dyn Positions>) -> Vec<f64> {
    let mut values = vec![];
    if let Some(points) = points {
        points.append_to(&mut values);
    }
    values
}

#[pymethods]
impl State {
    /// Time [s].
    #[getter]
    fn t(&self) -> f64 {
        self.t
    }

    /// Joint angles, (n,) [rad].
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.q)
    }

    /// Joint velocities, (n,) [rad/s].
    #[getter]
    fn dq<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.dq)
    }

    /// End effector, (m,) [m]; in space its position, (3,).
    #[getter]
    fn x<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.x)
    }

    /// Its velocity, (m,) [m/s].
    #[getter]
    fn dx<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.dx)
    }

    /// Its reference, (m,) [m].
    #[getter]
    fn x_ref<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.x_ref)
    }

    /// Signed distance of each link to the nearest obstacle, (n,) [m].
    #[getter]
    fn clearance<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.clearance)
    }

    /// Joint torque, (n,) [N·m].
    #[getter]
    fn tau<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.tau)
    }

    /// Positions of the obstacles, (k, 2) or (k, 3) [m].
    #[getter]
    fn obstacles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.obstacles.clone(), [self.obstacles.len() / self.dimension, self.dimension])
    }

    /// Joint angles as measured, for a controller of your own, (n,) [rad]; None without sensors.
    #[getter]
    fn q_measured<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        given(py, &self.q_measured)
    }

    /// Joint velocities as measured, (n,) [rad/s]; None without sensors.
    #[getter]
    fn dq_measured<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        given(py, &self.dq_measured)
    }

    /// Torque at the joints, (n,) [N·m], with what a robot adds itself; None where it is `tau`.
    #[getter]
    fn tau_applied<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        given(py, &self.tau_applied)
    }

    /// Torque of wrenches and contacts that push the arm from now on, (n,) [N·m]; None without any.
    #[getter]
    fn tau_ext<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        given(py, &self.tau_ext)
    }

    /// Force of each obstacle on the arm, (k, D) [N]; None where none has a `contact`.
    #[getter]
    fn contact_force<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.table(py, &self.contact_force)
    }

    /// Torque that the model does not know, as estimated, (n,) [N·m]; None without an observer.
    #[getter]
    fn tau_ext_estimate<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        given(py, &self.tau_ext_estimate)
    }

    /// The wrench at the end effector that this is, (m,) [N, N·m]; None without an observer.
    #[getter]
    fn wrench_estimate<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        given(py, &self.wrench_estimate)
    }

    /// Link on which a contact is felt, or one beyond it, counted from 0; None while none is felt.
    #[getter]
    fn touched_link(&self) -> Option<usize> {
        self.touched_link
    }

    /// How far the end effector gives way to a push [m]; None where it never does.
    #[getter]
    fn yielded(&self) -> Option<f64> {
        self.yielded
    }

    /// How many parts of its task the look-ahead lets go, in their `order`; None without both.
    #[getter]
    fn released(&self) -> Option<f64> {
        self.released
    }

    /// Points that the range sensors have met, (rays, 2) [m], NaN for none; None without sensors.
    #[getter]
    fn sensed<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.table(py, &self.sensed)
    }

    fn __repr__(&self) -> String {
        format!("<State: t = {} s>", self.t)
    }
}

impl State {
    /// Points or forces (k, D), if there are any.
    fn table<'py>(
        &self,
        py: Python<'py>,
        values: &[f64],
    ) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let shape = [values.len() / self.dimension, self.dimension];
        (!values.is_empty()).then(|| array2(py, values.to_vec(), shape)).transpose()
    }
}

/// What only a scenario with sensors or drives has.
fn given<'py>(py: Python<'py>, values: &[f64]) -> Option<Array1<'py>> {
    (!values.is_empty()).then(|| array1(py, values))
}
