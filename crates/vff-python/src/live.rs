//! `Live`: a scenario that runs against the wall clock on a thread of its own, under people's hands.

use crate::call::new_points;
use crate::convert::{
    self, array2, depth_pictures, keywords, named_document, read_vector, self_motion_map,
};
use crate::errors::{self, InputError};
use crate::run::{arrays, measured, named, prepared};
use crate::watch::interruptible;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::{mem, process};
use vff_core::math::UnitQuaternion;
use vff_core::runtime::live::{self, LoopStats, State};
use vff_core::runtime::points::make;
use vff_core::runtime::{ActingPull, ActingWrench, PointsError};
use vff_core::scenario::Scenario;
use vff_core::simulation::{Metric, RecordTooLarge, ReplanCounts, Value};

/// A scenario that runs at 1 kHz against the wall clock, on a thread of its own, while people interfere.
///
/// Parameters
/// ----------
/// scenario : Scenario, dict, str or path
///     What to run; its duration is of no meaning.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the scenario cannot be run.
#[pyclass(frozen, module = "vffnull")]
pub struct Live {
    live: Arc<Mutex<live::Live>>,
    server: Mutex<Option<Server>>,
    /// The process that has the thread: a fork of it has none, and may have the locks for ever.
    process: u32,
}

/// The thread of a loop, and what ends it: a flag of its own, which no later start can take back.
struct Server {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Live {
    /// Does something with the loop. Nothing of Python may run meanwhile: it might wait for the lock.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        act: impl FnOnce(&mut live::Live) -> T + Send,
    ) -> PyResult<T> {
        match self.is_here() {
            true => Ok(py.detach(|| act(&mut live::lock(&self.live)))),
            false => Err(InputError::new_err(
                "live: runs in the process that it was made in, of which this one is a fork",
            )),
        }
    }

    fn is_here(&self) -> bool {
        self.process == process::id()
    }

    /// Nobody who has this lock waits for Python.
    fn server(&self) -> MutexGuard<'_, Option<Server>> {
        self.server.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a snapshot shows, copied.
struct Shown {
    state: State,
    stats: LoopStats,
    min_clearance: f64,
    metrics: Vec<(&'static Metric, Value)>,
    recording: bool,
    /// Coordinates of a point.
    dimension: usize,
    points: Vec<f64>,
    forces: Vec<f64>,
    /// Where wrenches push, and with which forces.
    pushed: [Vec<f64>; 2],
    /// What a link is pulled with, if it is.
    pulled: Option<ActingPull>,
    obstacles: Vec<f64>,
    /// What sensors have measured, without what they have not.
    sensed: Vec<f64>,
    turns: Vec<f64>,
    t: f64,
    q_plan: Option<Vec<f64>>,
    replans: ReplanCounts,
    search: Option<&'static str>,
    has_plans: bool,
    released: Option<Vec<Option<&'static str>>>,
    /// What obstacles that are felt press the arm with, all of them \[N\].
    pressed: Option<f64>,
    arrays: [(&'static str, Vec<f64>); 9],
}

impl Shown {
    fn new(live: &mut live::Live) -> Self {
        let ([points, forces], turns) = (live.pushes(), live.turns());
        let released = live.released().as_deref().map(named);
        let wrenches = live.wrenches();
        let all = |of: fn(&ActingWrench) -> &[f64]| wrenches.iter().flat_map(of).copied().collect();
        let pushed = [all(|wrench| &wrench.point), all(|wrench| &wrench.force)];
        let s = live.snapshot();
        let mut obstacles = vec![];
        s.obstacles.append_to(&mut obstacles);
        let mut sensed = vec![];
        if let Some(readings) = s.sensed {
            readings.append_to(&mut sensed);
            sensed.retain(|coordinate| !coordinate.is_nan());
            sensed.shrink_to_fit(); // the page keeps half a minute of it
        }
        Self {
            state: live.state().clone(),
            stats: live.stats(),
            min_clearance: live.min_clearance(),
            metrics: live.metrics(),
            recording: live.is_recording(),
            dimension: s.dimension,
            points,
            forces,
            pushed,
            pulled: live.pulled(),
            obstacles,
            sensed,
            turns,
            t: s.t,
            q_plan: s.q_plan.map(<[f64]>::to_vec),
            replans: s.replans.unwrap_or_default(),
            search: live.last_search(),
            has_plans: s.has_plans(),
            released,
            pressed: s.contact_force.map(|force| {
                let along = |axis: usize| force.iter().skip(axis).step_by(s.dimension).sum::<f64>();
                (0..s.dimension).map(|axis| along(axis).powi(2)).sum::<f64>().sqrt()
            }),
            arrays: [
                ("q", s.q.to_vec()),
                ("dq", s.dq.to_vec()),
                ("x", s.x.to_vec()),
                ("x_ref", s.x_ref.to_vec()),
                ("error", s.error.to_vec()),
                ("clearance", s.room().collect()),
                ("tau", s.torque.total.clone()),
                ("tau_vff", s.tau_vff.to_vec()),
                ("power", s.power.values().to_vec()),
            ],
        }
    }

    fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let (status, message) = match &self.state {
            State::Running => ("running", ""),
            State::Paused => ("paused", ""),
            State::Diverged => ("diverged", "the next state would not be finite"),
            State::Failed(fault) => ("failed", fault.as_str()),
        };
        let dict = PyDict::new(py);
        dict.set_item("status", status)?;
        dict.set_item("message", message)?;
        dict.set_item("rate", self.stats.rate)?;
        dict.set_item("periods", self.stats.periods)?;
        dict.set_item("missed", self.stats.missed)?;
        dict.set_item("worst", self.stats.worst)?;
        dict.set_item("min_clearance", self.min_clearance)?;
        dict.set_item("metrics", measured(py, &self.metrics)?)?;
        dict.set_item("recording", self.recording)?;
        dict.set_item("t", self.t)?;
        dict.set_item("q_plan", self.q_plan.map(|q| PyArray1::from_vec(py, q)))?;
        dict.set_item("replans", self.replans.taken)?;
        dict.set_item("times_stuck", self.replans.stuck)?;
        dict.set_item("search", self.search)?;
        dict.set_item("has_plans", self.has_plans)?;
        dict.set_item("released", self.released)?;
        dict.set_item("pressed", self.pressed)?;
        let [at, with] = self.pushed;
        let pulled = self.pulled.map(|pull| [pull.wrench.point, pull.wrench.force, pull.anchor]);
        let [pulled_at, pulled_with, anchor] = pulled.unwrap_or_default();
        let tables = [
            ("points", self.points),
            ("forces", self.forces),
            ("wrench_points", at),
            ("wrench_forces", with),
            ("pull_point", pulled_at),
            ("pull_force", pulled_with),
            ("pull_anchor", anchor),
            ("obstacles", self.obstacles),
            ("sensed", self.sensed),
        ];
        for (name, values) in tables {
            let shape = [values.len() / self.dimension, self.dimension];
            dict.set_item(name, array2(py, values, shape)?)?;
        }
        let d = self.dimension;
        let shape = [self.turns.len() / (d * d), d, d];
        dict.set_item("turns", PyArray1::from_vec(py, self.turns).reshape(shape)?)?;
        for (name, values) in self.arrays {
            dict.set_item(name, PyArray1::from_vec(py, values))?;
        }
        Ok(dict)
    }
}

#[pymethods]
impl Live {
    #[new]
    fn new(scenario: &Bound<'_, PyAny>) -> PyResult<Self> {
        let prepare = |scenario: Scenario| live::Live::new(&scenario);
        let live = prepared(scenario.py(), &convert::scenario(scenario)?, prepare)?;
        Ok(Self {
            live: Arc::new(Mutex::new(live)),
            server: Mutex::new(None),
            process: process::id(),
        })
    }

    /// Begin, or go on after a pause.
    fn start(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |live| live.pause(false))?;
        let mut server = self.server();
        if server.is_none() {
            let stop = Arc::new(AtomicBool::new(false));
            let serve = {
                let (live, stop) = (Arc::clone(&self.live), Arc::clone(&stop));
                move || live::serve(&live, &stop)
            };
            let thread = thread::Builder::new().name("vffnull-live".into()).spawn(serve)?;
            *server = Some(Server { stop, thread });
        }
        Ok(())
    }

    /// Stand still until `start`.
    fn pause(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |live| live.pause(true))
    }

    /// Go back to t = 0 of the scenario, with the present settings of the controller; a pause goes on.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, live::Live::reset)?.map_err(|error| errors::scenario(&error))
    }

    /// End the thread. In a fork of the process there is none.
    fn stop(&self, py: Python<'_>) {
        if !self.is_here() {
            return;
        }
        let server = self.server().take();
        if let Some(Server { stop, thread }) = server {
            stop.store(true, Ordering::Relaxed);
            drop(py.detach(|| thread.join()));
        }
    }

    /// Take over other settings of the controller: all of them, as in `[controller]` of a scenario.
    fn configure(&self, py: Python<'_>, controller: &Bound<'_, PyAny>) -> PyResult<()> {
        let table = named_document("controller", controller)?;
        let configured = self.with(py, |live| live.configure_as(&table))?;
        configured.map_err(|error| errors::scenario(&error))
    }

    /// Take an obstacle to a place (D,) [m], smoothly and not faster than half the reach per second.
    fn carry(&self, py: Python<'_>, obstacle: usize, place: &Bound<'_, PyAny>) -> PyResult<()> {
        let place = point(place, self.with(py, |live| live.dimension())?)?;
        self.with(py, |live| live.carry(obstacle, &place))?
            .map_err(|error| errors::scenario(&error))
    }

    /// Take the reference to a place (D,) [m] or as near to it as the arm can reach, smoothly and not
    /// faster than a quarter of the reach per second.
    fn aim(&self, py: Python<'_>, place: &Bound<'_, PyAny>) -> PyResult<()> {
        let place = point(place, self.with(py, |live| live.dimension())?)?;
        self.with(py, |live| live.aim(&place))
    }

    /// Plan a motion to where the reference comes to rest, such as where the target is, in a thread of its
    /// own, and follow it when it is found; `search` of a snapshot says what has come of it. Without
    /// `[replan]` others follow only where that is blocked, and a recording ends that has no plans.
    fn plan(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |live| live.plan())?.map_err(|error| errors::scenario(&error))
    }

    /// Take hold of a link at a point (D,) of its frame [m], with a spring that `pull_by` lets pull.
    fn grab(
        &self,
        py: Python<'_>,
        link: &Bound<'_, PyAny>,
        point: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let given = [("link", Some(link)), ("point", Some(point))];
        let document = keywords("grab", py, &given)?;
        self.with(py, |live| live.grab(&document))?
            .map_err(|error| errors::scenario(&error.inside("grab")))
    }

    /// Pull the link towards the place that is so far (D,) [m] from where it was taken hold of.
    fn pull_by(&self, py: Python<'_>, offset: &Bound<'_, PyAny>) -> PyResult<()> {
        let offset = point(offset, self.with(py, |live| live.dimension())?)?;
        self.with(py, |live| live.pull_by(&offset))
    }

    /// Let go of the link.
    fn let_go(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, live::Live::let_go)?.map_err(|error| errors::scenario(&error))
    }

    /// Turn an obstacle in space to an orientation (4,) on the short way, at 4 rad/s.
    fn turn(
        &self,
        py: Python<'_>,
        obstacle: usize,
        orientation: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let orientation = unit(orientation)?;
        self.with(py, |live| live.turn(obstacle, orientation))?
            .map_err(|error| errors::scenario(&error))
    }

    /// Turn the reference to an orientation (4,) on the short way, smoothly, at 1 rad/s at most.
    fn turn_target(&self, py: Python<'_>, orientation: &Bound<'_, PyAny>) -> PyResult<()> {
        let orientation = unit(orientation)?;
        self.with(py, |live| live.turn_target(orientation))?
            .map_err(|error| errors::scenario(&error))
    }

    /// Replace the points (k, 3) of a cloud [m]. They are made ready beside the loop, and taken in between
    /// two of its steps; with `velocities` (k, 3) [m/s] they go on from where they were at time `t` [s].
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
    ) -> PyResult<()> {
        let (given, j) = new_points(cloud, obstacle, velocities, t)?;
        let fault = |error: PointsError| InputError::new_err(error.to_string());
        let orientation = self.with(py, |live| live.orientation_of_points(j))?.map_err(fault)?;
        let made = interruptible(py, || make(given, orientation))?.map_err(fault)?;
        self.with(py, |live| live.update_points(j, &made))?.map_err(fault)
    }

    /// Add an obstacle, the last one from now on. Ends a recording.
    fn add(&self, py: Python<'_>, obstacle: &Bound<'_, PyAny>) -> PyResult<()> {
        let table = named_document("obstacle", obstacle)?;
        self.with(py, |live| live.add(&table))?
            .map_err(|error| errors::scenario(&error.inside("obstacle")))
    }

    /// Take an obstacle away; those behind it move up. Ends a recording.
    fn remove(&self, py: Python<'_>, obstacle: usize) -> PyResult<()> {
        self.with(py, |live| live.remove(obstacle))?.map_err(|error| errors::scenario(&error))
    }

    /// Begin to record a row every 10 ms, or end it.
    fn record(&self, py: Python<'_>, on: bool) -> PyResult<()> {
        self.with(py, |live| live.record(on))?.map_err(too_large)
    }

    /// The rows recorded since the last call, as arrays; None if nothing is recorded. And how many were
    /// lost since the recording began, because nobody took them within ten seconds.
    fn take<'py>(&self, py: Python<'py>) -> PyResult<(Option<Bound<'py, PyDict>>, u64)> {
        let (record, dropped) = self.with(py, live::Live::take)?.map_err(too_large)?;
        Ok((record.map(|record| arrays(py, record)).transpose()?, dropped))
    }

    /// What was changed for the clock or is odd, in sentences.
    #[getter]
    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |live| live.notes.clone())
    }

    /// The pictures of depth cameras that arrived last, (rows, columns) [m] each, 0 where nothing was
    /// measured; none without such cameras.
    fn pictures<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
        depth_pictures(py, self.with(py, |live| live.pictures())?)
    }

    /// What the search of the self-motion has found last; see `Simulation.self_motion_map`.
    fn self_motion_map<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self_motion_map(py, self.with(py, |live| live.self_motion_map())?)
    }

    /// The present instant.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.with(py, Shown::new)?.into_dict(py)
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        let here = self.is_here();
        match self.server.get_mut().unwrap_or_else(PoisonError::into_inner).take() {
            // The thread sees it within a millisecond and needs nothing of Python to end.
            Some(server) if here => server.stop.store(true, Ordering::Relaxed),
            // There is no such thread in a fork.
            server => mem::forget(server),
        }
    }
}

/// An orientation, as a quaternion \[w, x, y, z\].
fn unit(orientation: &Bound<'_, PyAny>) -> PyResult<UnitQuaternion> {
    let mut given = [0.0; 4];
    read_vector("orientation", orientation, &mut given)?;
    UnitQuaternion::new(given).map_err(|error| InputError::new_err(format!("orientation: {error}")))
}

/// A place of `dimension` coordinates.
fn point(place: &Bound<'_, PyAny>, dimension: usize) -> PyResult<Vec<f64>> {
    let mut point = vec![0.0; dimension];
    read_vector("place", place, &mut point)?;
    Ok(point)
}

#[expect(clippy::needless_pass_by_value, reason = "used by map_err")]
fn too_large(error: RecordTooLarge) -> PyErr {
    InputError::new_err(error.to_string())
}
