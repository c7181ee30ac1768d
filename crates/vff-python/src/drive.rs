//! `DriveLoop`: a controller in the loop of a robot, on a thread of its own.

use crate::call::{new_points, read_obstacles, read_pose, sequence};
use crate::controller::Controller;
use crate::convert::{
    self, array1, array2, copy_vector, count, number, read_vector, vector, wrong_type,
};
use crate::errors::{self, InputError};
use crate::loading::load_numpy;
use crate::real_time::put_times;
use crate::run::{prepared, replans};
use crate::scheduling::{core_id, request_scheduling};
use crate::simulated_robot::{Simulated, SimulatedRobot, lock, rate_of};
use crate::virtual_arm::each;
use crate::watch::SIGNALS;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};
use std::process;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
use vff_core::control::{CommandSettings, Gravity};
use vff_core::runtime::drive::{
    CommandKind, DriveError, Driver, Ending, Exchange, Loop, Options, Report,
};
use vff_core::runtime::{AnyController, AnyObstacles, SetPointLimits, Target};

/// A robot in Python. It has the GIL for a whole period, so that it waits for it once.
struct InPython {
    robot: Py<PyAny>,
    kind: CommandKind,
    paces: bool,
    /// The first exception that it has raised.
    cause: Arc<Mutex<Option<PyErr>>>,
}

impl InPython {
    /// Does something with it; an exception becomes a sentence.
    fn with<T>(
        &self,
        work: impl FnOnce(Python<'_>, &Bound<'_, PyAny>) -> PyResult<T>,
    ) -> Result<T, String> {
        let done = Python::try_attach(|py| {
            work(py, self.robot.bind(py)).map_err(|error| {
                let name = error
                    .get_type(py)
                    .name()
                    .map_or("an exception".into(), |name| name.to_string());
                let text = match error.value(py).to_string() {
                    text if text.is_empty() => name,
                    text => format!("{name}: {text}"),
                };
                lock(&self.cause).get_or_insert(error);
                text
            })
        });
        done.unwrap_or_else(|| Err("Python is shutting down".into()))
    }

    /// Calls a method that it may have.
    fn call(&self, name: &str) -> Result<(), String> {
        self.with(|_, robot| match robot.getattr_opt(name)? {
            Some(method) => method.call0().map(drop),
            None => Ok(()),
        })
    }
}

impl Driver for InPython {
    fn kind(&self) -> CommandKind {
        self.kind
    }

    fn paces(&self) -> bool {
        self.paces
    }

    fn begin(&mut self) -> Result<(), String> {
        self.call("begin")
    }

    fn read(&mut self, q: &mut [f64], dq: &mut [f64]) -> Result<f64, String> {
        self.with(|_, robot| {
            let state = robot.call_method0("read")?;
            let sentence = "read(): expected a tuple of time, q and dq";
            let three = sequence_of_three(&state).ok_or_else(|| match state.len() {
                Ok(items) => InputError::new_err(format!("{sentence}, got {items} items")),
                Err(_) => wrong_type(sentence, &state),
            })?;
            let [t, given_q, given_dq] = three;
            copy_vector("q", &given_q, q)?;
            copy_vector("dq", &given_dq, dq)?;
            number("t", &t)
        })
    }

    fn torque(&mut self, tau: &mut [f64]) -> Result<bool, String> {
        self.with(|_, robot| match robot.getattr_opt("torque")? {
            Some(method) => {
                let given = method.call0()?;
                if given.is_none() {
                    return Ok(false);
                }
                copy_vector("torque()", &given, tau)?; // one that is not finite is not believed
                Ok(true)
            }
            None => Ok(false),
        })
    }

    fn external_torque(&mut self, tau: &mut [f64]) -> Result<bool, String> {
        self.with(|_, robot| match robot.getattr_opt("external_torque")? {
            Some(method) => {
                copy_vector("external_torque()", &method.call0()?, tau)?;
                Ok(true)
            }
            None => Ok(false),
        })
    }

    fn write(&mut self, command: &[f64]) -> Result<(), String> {
        self.with(|py, robot| robot.call_method1("write", (array1(py, command),)).map(drop))
    }

    fn end(&mut self) -> Result<(), String> {
        self.call("end")
    }

    fn cycle<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let mut work = Some(work);
        let mut done = None;
        let mut attached = || done = work.take().map(|work| work(self));
        if Python::try_attach(|_| attached()).is_none() {
            attached(); // every call will say that Python is shutting down
        }
        done.expect("one of the two has done it")
    }
}

/// The items of a tuple or list of three.
fn sequence_of_three<'py>(given: &Bound<'py, PyAny>) -> Option<[Bound<'py, PyAny>; 3]> {
    let items: Vec<_> = given.try_iter().ok()?.take(4).collect::<PyResult<_>>().ok()?;
    items.try_into().ok()
}

/// What set points keep to, as `VirtualArm` takes it.
fn set_point_limits(given: &Bound<'_, PyAny>, n: usize) -> PyResult<SetPointLimits> {
    let sentence =
        "limits: expected a dict with acceleration, jerk and, if you like, speed and threshold";
    let given = given.cast::<PyDict>().map_err(|_| wrong_type(sentence, given))?;
    let names = ["speed", "acceleration", "jerk", "threshold"];
    for name in given.keys() {
        if !names.iter().any(|known| name.eq(known).unwrap_or(false)) {
            let known = names.join(", ");
            return Err(InputError::new_err(format!("limits: {name} is none of {known}")));
        }
    }
    let get = |name: &str| given.get_item(name).map(|it| it.filter(|it| !it.is_none()));
    let needed = |name: &str| {
        let missing = || InputError::new_err(format!("limits: {name} is missing"));
        each(name, &get(name)?.ok_or_else(missing)?, n)
    };
    Ok(SetPointLimits {
        speed: get("speed")?.map(|it| each("speed", &it, n)).transpose()?,
        acceleration: needed("acceleration")?,
        jerk: needed("jerk")?,
        threshold: get("threshold")?.map_or(Ok(0.1), |it| number("threshold", &it))?,
    })
}

/// How it ended, once it has.
#[derive(Default)]
struct End {
    report: Mutex<Option<(Report, Vec<String>)>>,
    is_over: Condvar,
}

/// What [`DriveLoop::start`] starts.
type Start = Box<dyn FnOnce() -> (Report, Vec<String>) + Send>;

/// A controller that drives a robot, on a thread of its own. `vffnull.drive` makes it.
///
/// Parameters
/// ----------
/// robot : SimulatedRobot or any object
///     The robot: see `vffnull.robots.Robot`.
/// controller : Controller or Mapping
///     The controller, which is copied, or a scenario, whose controller, obstacles and reference it is.
/// options : Mapping
///     ``rate`` [Hz], ``seconds`` [s] or None, ``patience`` [s], ``record_every``, ``command``, ``paces``,
///     ``priority``, ``core``, ``limits``.
#[pyclass(frozen, module = "vffnull._core")]
pub struct DriveLoop {
    exchange: Arc<Exchange>,
    widths: [usize; 3],
    dimension: usize,
    command: CommandSettings,
    nothing: AnyObstacles,
    start: Mutex<Option<Start>>,
    end: Arc<End>,
    cause: Arc<Mutex<Option<PyErr>>>,
    /// The process that has the thread: a fork of it has none.
    process: u32,
}

impl DriveLoop {
    fn is_here(&self) -> PyResult<()> {
        match self.process == process::id() {
            true => Ok(()),
            false => Err(InputError::new_err(
                "drive: runs in the process that it was made in, of which this one is a fork",
            )),
        }
    }

    /// Rows of numbers as a dict of arrays; without their first dimension if it is one instant.
    fn columns<'py>(
        &self,
        py: Python<'py>,
        values: &[f64],
        one: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let layout = self.exchange.layout();
        let rows = values.len() / layout.width();
        let mut columns: Vec<(&str, Vec<f64>)> = layout
            .0
            .iter()
            .map(|(name, width)| (*name, Vec::with_capacity(width * rows)))
            .collect();
        for row in values.chunks_exact(layout.width()) {
            for ((_, column), (_, values)) in columns.iter_mut().zip(layout.columns(row)) {
                column.extend_from_slice(values);
            }
        }
        let found = PyDict::new(py);
        let first_time = values.first().copied().unwrap_or(f64::NAN);
        for ((name, values), (_, width)) in columns.into_iter().zip(&layout.0) {
            match (name, one) {
                ("t" | "path_time", true) => found.set_item(name, values[0])?,
                ("q_plan", true) if values[0].is_nan() => {}
                // Without an observer; before the first period nobody knows.
                ("tau_ext_estimate", true) if values[0].is_nan() && !first_time.is_nan() => {}
                ("t" | "path_time", false) | (_, true) => {
                    found.set_item(name, PyArray1::from_vec(py, values))?;
                }
                _ => found.set_item(name, array2(py, values, [rows, *width])?)?,
            }
        }
        Ok(found)
    }
}

#[pymethods]
impl DriveLoop {
    #[new]
    fn new(
        robot: &Bound<'_, PyAny>,
        controller: &Bound<'_, PyAny>,
        options: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let py = robot.py();
        load_numpy(py)?;
        let (law, nothing) = match controller.cast::<Controller>() {
            Ok(given) => (given.get().with(py, |law| law.clone())?, given.get().nothing()),
            Err(_) => prepared(py, &convert::scenario(controller)?, |scenario| {
                let law = AnyController::replanning(&scenario)?;
                let nothing = match law.dimension() {
                    2 => AnyObstacles::Plane(vec![]),
                    _ => AnyObstacles::Space(vec![]),
                };
                Ok((law, nothing))
            })?,
        };
        for warning in law.warnings() {
            errors::warn(py, warning)?;
        }
        let get = |name: &str| options.get_item(name).map(|found| found.filter(|it| !it.is_none()));
        let settings = Options {
            rate: rate_of(get("rate")?.as_ref())?,
            seconds: get("seconds")?.map(|it| number("seconds", &it)).transpose()?,
            patience: get("patience")?.map_or(Ok(0.1), |it| number("patience", &it))?,
            sight_patience: get("sight_patience")?
                .map(|it| number("sight_patience", &it))
                .transpose()?,
            record_every: get("record_every")?.map_or(Ok(0), |it| count("record_every", &it))?,
            limits: get("limits")?.map(|it| set_point_limits(&it, law.dof())).transpose()?,
        };
        let name: String = get("command")?.map_or(Ok("torque".into()), |it| it.extract())?;
        let kind = CommandKind::named(&name)
            .ok_or_else(|| InputError::new_err(format!("command: {name:?} is none")))?;
        let paces: bool = get("paces")?.map_or(Ok(false), |it| it.extract())?;
        let priority: Option<u8> = get("priority")?.map(|it| it.extract()).transpose()?;
        let core = get("core")?.map(|it| it.extract::<usize>()).transpose()?;
        let core = core.map(core_id).transpose()?;

        let (n, widths, dimension) = (law.dof(), law.widths(), law.dimension());
        let command = law.settings().command.clone();
        let unstable = |error: DriveError| InputError::new_err(error.to_string());
        let cause = Arc::new(Mutex::new(None));
        fn started<D: Driver + Send + 'static>(
            drive: Loop<D>,
            take: impl FnOnce() -> Vec<String> + Send + 'static,
        ) -> Start {
            Box::new(move || {
                let refused = take();
                (drive.run(), refused)
            })
        }
        let take = move || request_scheduling(priority, core);
        let (start, exchange) = match robot.cast::<SimulatedRobot>() {
            Ok(robot) => {
                let robot = robot.get();
                if robot.n != n {
                    let sentence = format!("robot: has {} joints, the controller {n}", robot.n);
                    return Err(InputError::new_err(sentence));
                }
                let driver = Simulated {
                    robot: Arc::clone(&robot.inner),
                    driven: Arc::clone(&robot.driven),
                    is_ours: false,
                };
                let (drive, exchange) = Loop::new(driver, law, settings).map_err(unstable)?;
                (started(drive, take), exchange)
            }
            Err(_) => {
                let robot = robot.clone().unbind();
                let driver = InPython { robot, kind, paces, cause: Arc::clone(&cause) };
                let (drive, exchange) = Loop::new(driver, law, settings).map_err(unstable)?;
                (started(drive, take), exchange)
            }
        };
        Ok(Self {
            exchange,
            widths,
            dimension,
            command,
            nothing,
            start: Mutex::new(Some(start)),
            end: Arc::default(),
            cause,
            process: process::id(),
        })
    }

    /// Begin to drive.
    fn start(&self) -> PyResult<()> {
        self.is_here()?;
        let Some(start) = lock(&self.start).take() else { return Ok(()) };
        let end = Arc::clone(&self.end);
        let work = move || {
            let report = start();
            *lock(&end.report) = Some(report);
            end.is_over.notify_all();
        };
        thread::Builder::new().name("vffnull-drive".into()).spawn(work)?;
        Ok(())
    }

    /// The reference from now on; as `Controller.torque` takes it.
    #[pyo3(signature = (x_ref, dx_ref=None, ddx_ref=None))]
    fn set_target(
        &self,
        x_ref: &Bound<'_, PyAny>,
        dx_ref: Option<&Bound<'_, PyAny>>,
        ddx_ref: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        self.is_here()?;
        let [mut x, mut dx, mut ddx] = self.widths.map(|width| vec![0.0; width]);
        read_pose(x_ref, &mut x)?;
        for (name, given, out) in [("dx_ref", dx_ref, &mut dx), ("ddx_ref", ddx_ref, &mut ddx)] {
            given.map_or(Ok(()), |given| read_vector(name, given, out))?;
        }
        let done = self.exchange.set_target(&Target { x: &x, dx: &dx, ddx: &ddx });
        done.map_err(|error| InputError::new_err(error.to_string()))
    }

    /// Other obstacles from now on, whose motions begin at time `t` of the drive, or now.
    #[pyo3(signature = (obstacles, t=None))]
    fn set_obstacles(
        &self,
        py: Python<'_>,
        obstacles: &Bound<'_, PyAny>,
        t: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        self.is_here()?;
        let t = t.map(|t| number("t", t)).transpose()?;
        if let Some(t) = t.filter(|t| !t.is_finite()) {
            return Err(InputError::new_err(format!("t must be finite, got {t}")));
        }
        let read = read_obstacles(
            self.nothing.clone(),
            &sequence("obstacles", obstacles)?,
            AnyObstacles::read_seen,
        )?;
        let done = py.detach(|| self.exchange.surround(read, t));
        done.map_err(|error| errors::scenario(&error))
    }

    /// Another controller, or that of a scenario, takes over within `blend` [s]; obstacles stay.
    fn set_controller(
        &self,
        py: Python<'_>,
        controller: &Bound<'_, PyAny>,
        blend: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        self.is_here()?;
        let like = match controller.cast::<Controller>() {
            Ok(given) => given.get().with(py, |law| law.clone())?,
            Err(_) => prepared(py, &convert::scenario(controller)?, |scenario| {
                AnyController::replanning(&scenario)
            })?,
        };
        let blend = number("blend", blend)?;
        let exchange = Arc::clone(&self.exchange);
        let done = py.detach(move || exchange.succeed(&like, blend));
        done.map_err(|error| InputError::new_err(format!("controller: {error}")))
    }

    /// Obstacle `obstacle` is at a position (D,) [m] now and goes on at a velocity (D,) [m/s].
    #[pyo3(signature = (obstacle, position, velocity=None))]
    fn move_obstacle(
        &self,
        obstacle: &Bound<'_, PyAny>,
        position: &Bound<'_, PyAny>,
        velocity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        self.is_here()?;
        let j = usize::try_from(count("obstacle", obstacle)?).unwrap_or(usize::MAX);
        let position = vector("position", position, self.dimension)?;
        let velocity = velocity
            .map_or(Ok(vec![0.0; self.dimension]), |it| vector("velocity", it, self.dimension))?;
        let done = self.exchange.place(j, &position, &velocity);
        done.map_err(|error| InputError::new_err(error.to_string()))
    }

    /// Other points in place of those of a cloud, which go on at velocities (k, 3) from time `t`.
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
        self.is_here()?;
        let (given, j) = new_points(cloud, obstacle, velocities, t)?;
        let done = py.detach(|| self.exchange.update_points(j, given));
        done.map_err(|error| InputError::new_err(error.to_string()))
    }

    /// Ask it to end, by a damped stop. In a fork there is nothing to end.
    fn stop(&self) {
        if self.is_here().is_ok() {
            self.exchange.stop();
        }
    }

    /// Wait until it is over.
    ///
    /// Parameters
    /// ----------
    /// seconds : float or None
    ///     How long at most [s].
    /// attentive : bool
    ///     Whether what a signal handler raises ends the drive, by a damped stop, and is raised here.
    ///
    /// Returns
    /// -------
    /// bool
    ///     Whether it is over.
    fn wait(&self, py: Python<'_>, seconds: Option<f64>, attentive: bool) -> PyResult<bool> {
        self.is_here()?;
        let begun = Instant::now();
        loop {
            let left = seconds.map_or(SIGNALS, |seconds| {
                let left = seconds - begun.elapsed().as_secs_f64();
                Duration::try_from_secs_f64(left).unwrap_or(Duration::ZERO).min(SIGNALS)
            });
            let over = py.detach(|| {
                let report = lock(&self.end.report);
                let waited = self.end.is_over.wait_timeout_while(report, left, |it| it.is_none());
                waited.unwrap_or_else(PoisonError::into_inner).0.is_some()
            });
            if attentive && let Err(raised) = py.check_signals() {
                self.exchange.stop();
                return Err(raised);
            }
            if over || left.is_zero() {
                return Ok(over);
            }
        }
    }

    /// Dimension of the space that the arm moves in.
    #[getter]
    fn dimension(&self) -> usize {
        self.dimension
    }

    /// Who adds the torque against gravity: ``"controller"`` or ``"robot"``.
    #[getter]
    fn gravity(&self) -> &'static str {
        match self.command.gravity {
            Gravity::Controller => "controller",
            Gravity::Robot => "robot",
        }
    }

    /// How fast the torque of some joint may change [N·m/s]; None without a limit.
    #[getter]
    fn torque_rate(&self) -> Option<f64> {
        let rates = self.command.torque_rate.as_ref()?;
        rates.values().iter().copied().reduce(f64::max)
    }

    /// What it is doing: a phase of the output stage, or ``"over"``.
    #[getter]
    fn phase(&self) -> &'static str {
        match *lock(&self.end.report) {
            Some(_) => "over",
            None => self.exchange.phase().name(),
        }
    }

    /// Periods so far.
    #[getter]
    fn periods(&self) -> u64 {
        self.exchange.periods()
    }

    /// What was left out so far: name and count of each.
    #[getter]
    fn left_out<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.exchange.left_out().into_py_dict(py)
    }

    /// The last period as arrays; NaN before the first.
    fn latest<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.is_here()?;
        let mut row = vec![f64::NAN; self.exchange.layout().width()];
        py.detach(|| self.exchange.copy_latest(&mut row));
        self.columns(py, &row, true)
    }

    /// The rows that are to be recorded since the last call, as arrays, and how many were lost.
    fn rows<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyDict>, u64)> {
        self.is_here()?;
        let rows = py.detach(|| self.exchange.take_rows());
        Ok((self.columns(py, &rows.values, false)?, rows.lost))
    }

    /// How it went: ``status``, ``reason``, ``periods``, ``replans``, ``left_out``, ``clearance``,
    /// ``missed``, ``skipped``, ``notes``, histograms. None while it runs.
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let over = lock(&self.end.report);
        let Some((report, refused)) = over.clone() else { return Ok(None) };
        drop(over);
        let found = PyDict::new(py);
        found.set_item("status", report.ending.name())?;
        let reason = match &report.ending {
            Ending::Faulted(fault) => fault.to_string(),
            Ending::Completed | Ending::Stopped => String::new(),
        };
        found.set_item("reason", reason)?;
        found.set_item("cause", lock(&self.cause).as_ref().map(|error| error.clone_ref(py)))?;
        found.set_item("periods", report.periods)?;
        found.set_item("replans", replans(py, &report.replans)?)?;
        found.set_item("left_out", report.left_out.named().into_py_dict(py)?)?;
        found.set_item("clearance", report.closest.distance)?;
        found.set_item("missed", report.timing.missed)?;
        found.set_item("skipped", report.timing.skipped)?;
        found.set_item("notes", [report.notes, refused].concat())?;
        put_times(py, &found, report.timing)?;
        Ok(Some(found))
    }
}

impl Drop for DriveLoop {
    fn drop(&mut self) {
        self.exchange.stop();
    }
}
