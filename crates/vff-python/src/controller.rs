//! `Controller`: the torque law in somebody else's loop.

mod around;

use crate::arm::Arm;
use crate::call::{Reference, finite_time, new_points};
use crate::convert::{any_vector, array1, document, number, vector, wrong_type};
use crate::errors::{self, InputError};
use crate::exclusive::Exclusive;
use crate::loading::load_numpy;
use crate::terms::Terms;
use crate::watch::interruptible;
use around::Around;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};
use std::sync::atomic::{AtomicBool, Ordering};
use vff_core::control::output::Phase;
use vff_core::math::memory;
use vff_core::math::rotation::NotARotation;
use vff_core::runtime::points::make;
use vff_core::runtime::{AnyController, AnyObstacles, CycleError, Reading};

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
    /// The number of joints.
    n: usize,
    /// How many numbers a pose, its velocity and its acceleration have.
    widths: [usize; 3],
    /// No obstacle, where the arm is.
    nothing: AnyObstacles,
    summary: String,
    strict: bool,
    /// Whether the law remembers, and whether the last torque was asked for without a time.
    remembers: bool,
    untimed: AtomicBool,
    inner: Exclusive<Inner>,
}

struct Inner {
    controller: AnyController,
    around: Around,
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

impl Controller {
    /// No obstacle, where the arm is.
    pub fn nothing(&self) -> AnyObstacles {
        self.nothing.clone()
    }

    /// Evaluates the law; `take` reads what it came to.
    fn evaluate<T>(
        &self,
        py: Python<'_>,
        call: &Call<'_, '_>,
        take: impl FnOnce(&[f64], &AnyController) -> T,
    ) -> PyResult<T> {
        let t = finite_time(call.t)?;
        let (q, dq) = (vector("q", call.q, self.n)?, vector("dq", call.dq, self.n)?);
        let reference = Reference::read(self.widths, Some(call.x), call.dx, call.ddx)?;
        let target = reference.numbers();
        let accepts = |law: &AnyController| reference.suits(law);
        let done = self.asked_among(py, call.obstacles, accepts, |controller| {
            let tau = controller.torque(&q, &dq, &target, t)?.to_vec();
            let finite = tau.iter().all(|tau| tau.is_finite());
            Ok((take(&tau, controller), finite))
        })?;
        match done.map_err(|fault: NotARotation| InputError::new_err(fault.to_string()))? {
            (_, false) if self.strict => Err(InputError::new_err(
                "the torque at this state and reference is not finite: they are beyond what numbers can hold",
            )),
            (taken, _) => Ok(taken),
        }
    }

    /// The number of joints.
    pub fn joints(&self) -> usize {
        self.n
    }

    /// How many numbers a pose, its velocity and its acceleration have.
    pub fn widths(&self) -> [usize; 3] {
        self.widths
    }
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
        let settings = settings.map(document).transpose()?.unwrap_or_default();
        let controller =
            AnyController::new(&arm.arm, &settings).map_err(|error| errors::scenario(&error))?;
        if let Some(period) = period {
            let period = number("period", period)?;
            if !(period.is_finite() && period > 0.0) {
                let message = format!("period must be finite and greater than 0, got {period}");
                return Err(InputError::new_err(message));
            }
            for warning in controller.sampling_bounds(period) {
                errors::warn(py, &warning)?;
            }
        }
        Ok(Self {
            n: controller.dof(),
            remembers: controller.remembers(),
            untimed: AtomicBool::new(false),
            widths: controller.widths(),
            nothing: arm.arm.no_obstacles(),
            summary: controller.summary(),
            strict,
            inner: Exclusive::new("controller", Inner { controller, around: Around::default() }),
        })
    }

    /// Joint torque at a state.
    ///
    /// Parameters
    /// ----------
    /// q, dq : (n,) array_like
    ///     Joint angles [rad] and velocities [rad/s].
    /// x_ref : (m,) array_like, or a pair of them
    ///     Reference of the end effector. A position [m]; for the task ``"pose"`` in the plane with an angle
    ///     [rad] after it. For ``"pose"`` and ``"pointing"`` in space (7,), the position and a unit
    ///     quaternion (w, x, y, z), or the pair of both. It is taken as it is: the settings' `governor` acts
    ///     in simulations alone.
    /// dx_ref, ddx_ref : (m,) array_like, optional
    ///     Its velocity [m/s] and acceleration [m/s²]; 0 if not given. With an orientation, angular ones
    ///     [rad/s, rad/s²] follow; in space these are (6,), in world axes.
    /// obstacles : sequence of Obstacle or dict, optional
    ///     What to keep away from; nothing by default.
    /// t : float, optional
    ///     Time [s] at which the obstacles' motions are taken, and by which `observer` and `tank` go on: in a
    ///     loop with these it has to be given.
    ///
    /// Returns
    /// -------
    /// (n,) ndarray
    ///     Joint torque [N·m], as the settings' `command` wants it: without gravity for a robot that adds it
    ///     itself, and so on. Its rate is limited by `cycle` alone, which knows the period.
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
        let untimed = self.untimed.swap(t.is_none(), Ordering::Relaxed) && t.is_none();
        if untimed && self.remembers && self.with(py, |law| law.phase().is_none())? {
            errors::warn(
                py,
                "t: stands still from call to call: `observer` and `tank` learn nothing, so give the time",
            )?;
        }
        let call = Call { q, dq, x: x_ref, dx: dx_ref, ddx: ddx_ref, obstacles, t };
        let tau = self.evaluate(py, &call, |tau, _| tau.to_vec())?;
        Ok(array1(py, &tau))
    }

    /// The torque of the law with its parts, whatever `command` makes of it; parameters as in `torque`.
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
        let n = self.n;
        memory::fits(n.saturating_mul(n).saturating_mul(6)).map_err(|error| {
            InputError::new_err(format!("the projector of {n} joints: {error}"))
        })?;
        self.evaluate(py, &call, |_, controller| Terms { inner: controller.terms() })
    }

    /// Begin a loop that is watched over: from now on `cycle` says what is to be sent to the robot.
    ///
    /// The torque is blended in over the time `blend_time` of the settings' `command`, so that nothing jumps.
    /// Set points of a `VirtualArm` with this controller are over then.
    ///
    /// Parameters
    /// ----------
    /// period : float
    ///     Control period [s] of your loop.
    /// tau : (n,) array_like, optional
    ///     The measured torque [N·m] to blend from; with the gravity torque only if the robot does not add
    ///     that itself. It is not believed where it is not finite, beyond the arm's torque limits, or farther
    ///     than half of them from what holds the arm still by the model, which is also what is taken if none
    ///     is given. Until the first state it is sent, or nothing if it is not known.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If the period is not positive, or too long for the settings' gains or their `stop_damping`.
    #[pyo3(signature = (period, tau=None), text_signature = "($self, period, tau=None)")]
    fn begin(
        &self,
        py: Python<'_>,
        period: &Bound<'_, PyAny>,
        tau: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let period = number("period", period)?;
        let tau = tau.map(|tau| any_vector("tau", tau, self.n)).transpose()?;
        let begun = self.inner.take(py)?.controller.begin(period, tau.as_deref());
        begun.map_err(|error| InputError::new_err(error.to_string()))
    }

    /// One cycle of a loop that has begun: what is to be sent to the robot, and what state the loop is in.
    ///
    /// What is sent is finite, within the arm's torque limits, and changes by no more than `torque_rate`.
    /// A state that is missing (None), no newer than the last, not finite, or not to be reached from the last
    /// counts as missing, and is no error: after fewer than `missed_cycles` such
    /// cycles what was sent last is held, then the arm is damped as if it came to rest from its last
    /// velocity, then only gravity is held, if that is ours, and in the end the loop is lost;
    /// docs/tutorials/own-loop.md has the times.
    ///
    /// Parameters
    /// ----------
    /// t : float, optional
    ///     When the state was measured [s]; also the time at which the obstacles' motions are taken.
    /// q, dq : (n,) array_like, optional
    ///     Joint angles [rad] and velocities [rad/s].
    /// x_ref, dx_ref, ddx_ref : array_like, optional
    ///     Reference of the end effector, as in `torque`. Without `x_ref` its motion is damped wherever it
    ///     is.
    /// obstacles : sequence of Obstacle or dict, optional
    ///     What to keep away from; nothing by default.
    ///
    /// Returns
    /// -------
    /// tau : (n,) ndarray
    ///     What is to be sent in this cycle [N·m], whatever the phase is.
    /// phase : str
    ///     ``"starting"``, ``"running"``; ``"holding"``, ``"damping"``, ``"released"`` and in the end
    ///     ``"lost"`` where the state is missing; ``"damping"``, too, where a joint is faster than twice its
    ///     limit; ``"stopping"`` and in the end ``"finished"`` after `stop`.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If no loop has begun, an array has the wrong shape, or a reference is not finite.
    ///
    /// Examples
    /// --------
    /// >>> settings = {"command": {"gravity": "robot", "torque_rate": 1000.0}}
    /// >>> controller = Controller(Arm.named("panda"), settings)
    /// >>> controller.begin(0.001)
    /// >>> q, dq = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0] * 7
    /// >>> tau, phase = controller.cycle(0.0, q, dq, x_ref=[0.5, 0.0, 0.5])
    /// >>> phase
    /// 'starting'
    #[pyo3(
        signature = (t=None, q=None, dq=None, x_ref=None, dx_ref=None, ddx_ref=None, obstacles=None),
        text_signature = "($self, t=None, q=None, dq=None, x_ref=None, dx_ref=None, ddx_ref=None, obstacles=())"
    )]
    #[expect(clippy::too_many_arguments, reason = "state and reference")]
    fn cycle<'py>(
        &self,
        py: Python<'py>,
        t: Option<&Bound<'py, PyAny>>,
        q: Option<&Bound<'py, PyAny>>,
        dq: Option<&Bound<'py, PyAny>>,
        x_ref: Option<&Bound<'py, PyAny>>,
        dx_ref: Option<&Bound<'py, PyAny>>,
        ddx_ref: Option<&Bound<'py, PyAny>>,
        obstacles: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Array1<'py>, &'static str)> {
        let t = t.map(|t| number("t", t)).transpose()?;
        let q = q.map(|q| any_vector("q", q, self.n)).transpose()?;
        let dq = dq.map(|dq| any_vector("dq", dq, self.n)).transpose()?;
        let reference = Reference::read(self.widths, x_ref, dx_ref, ddx_ref)?;
        let reading = match (t, &q, &dq) {
            (Some(t), Some(q), Some(dq)) => Some(Reading { t, q, dq }),
            _ => None,
        };
        let accepts = |law: &AnyController| law.phase().is_some() && reference.suits(law);
        let done = self.among(py, obstacles, accepts, |controller| {
            let phase = controller.cycle(reading, reference.target().as_ref())?;
            Ok((controller.sent().unwrap_or_default().to_vec(), phase))
        })?;
        let (tau, phase) = done.map_err(|fault: CycleError| {
            let call = if fault == CycleError::NotBegun { ": call `begin` first" } else { "" };
            InputError::new_err(format!("{fault}{call}"))
        })?;
        Ok((array1(py, &tau), phase.name()))
    }

    /// Let the law know what the robot measures of the torque from outside, for the states that come.
    ///
    /// It counts with ``observer = {"source": "measured"}`` in the settings, until the next time; `drive`
    /// does this with a robot's ``external_torque``.
    ///
    /// Parameters
    /// ----------
    /// tau_ext : (n,) array_like
    ///     The measured torque [N·m] that the surroundings exert on the joints. A Franka's
    ///     ``tau_ext_hat_filtered`` counts what the robot exerts: its negative belongs here. One that is not
    ///     finite changes nothing.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If it has the wrong shape.
    ///
    /// Examples
    /// --------
    /// >>> arm = Arm.named("panda")
    /// >>> controller = Controller(arm, {"observer": {"source": "measured"}})
    /// >>> controller.sense([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    /// >>> rest = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
    /// >>> tau = controller.torque(rest, [0.0] * 7, arm.pose(rest)[0])
    /// >>> controller.tau_ext_estimate
    /// array([0., 5., 0., 0., 0., 0., 0.])
    fn sense(&self, py: Python<'_>, tau_ext: &Bound<'_, PyAny>) -> PyResult<()> {
        let tau_ext = any_vector("tau_ext", tau_ext, self.n)?;
        self.inner.take(py)?.controller.sense(&tau_ext);
        Ok(())
    }

    /// The torque from outside at the last state, as estimated, (n,) [N·m]; None without an observer.
    #[getter]
    fn tau_ext_estimate<'py>(&self, py: Python<'py>) -> PyResult<Option<Array1<'py>>> {
        Ok(self.inner.take(py)?.controller.external_torque().map(|tau| array1(py, tau)))
    }

    /// The wrench at the end effector that this is, (m,) [N, N·m]; None without an observer.
    #[getter]
    fn wrench_estimate<'py>(&self, py: Python<'py>) -> PyResult<Option<Array1<'py>>> {
        Ok(self.inner.take(py)?.controller.external_wrench().map(|wrench| array1(py, wrench)))
    }

    /// The link on which a contact is felt at the last state, or one beyond it, counted from 0; None while
    /// none is felt, and without ``observer.detection``.
    #[getter]
    fn touched_link(&self, py: Python<'_>) -> PyResult<Option<usize>> {
        Ok(self.inner.take(py)?.controller.touched_link())
    }

    /// What was left out since the loop began: ``late``, cycles that took longer than the
    /// deadline; ``cut``, cycles in which the look-ahead stopped for lack of time; ``rollouts`` that it did
    /// not make because of that; ``points`` of clouds beyond the 64 that ``cbf`` keeps of a link, counted
    /// once a cycle; ``programs`` that ended with constraints left.
    #[getter]
    fn left_out<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.inner.take(py)?.controller.left_out().named().into_py_dict(py)
    }

    /// End the loop safely: from the next cycle on the arm is damped until it stands, and the loop is
    /// finished.
    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        self.inner.take(py)?.controller.stop();
        Ok(())
    }

    /// What the last cycle came to, as `cycle` names it; None if no loop has begun.
    #[getter]
    fn phase(&self, py: Python<'_>) -> PyResult<Option<&'static str>> {
        Ok(self.inner.take(py)?.controller.phase().map(Phase::name))
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
        let t = finite_time(t)?;
        let q = vector("q", q, self.n)?;
        let found = self.asked_among(py, obstacles, |_| true, |law| law.stable_period(&q, t))?;
        Ok((found.period, found.stiffness, found.clearance))
    }

    /// Forget the past, so that the next state may be at any time.
    ///
    /// An energy tank is as full as at the start, an observer knows nothing, a look-ahead follows no
    /// candidate. A loop that is over is left by it, and set points that have finished.
    ///
    /// Examples
    /// --------
    /// A second run whose time begins at 0 again begins with it.
    ///
    /// >>> controller = Controller(Arm.uniform(6), {"tank": {"capacity": 0.1, "initial": 0.02}})
    /// >>> first = controller.torque([0.1] * 6, [0.5] * 6, x_ref=[4.0, 2.0], t=0.0)
    /// >>> controller.reset()
    /// >>> (first == controller.torque([0.1] * 6, [0.5] * 6, x_ref=[4.0, 2.0], t=0.0)).all()
    /// np.True_
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.inner.take(py)?.controller.forget();
        Ok(())
    }

    /// Put other points in place of those of a cloud, one of the obstacles of the last call.
    ///
    /// They stay as long as calls are given the very same obstacles. The cloud keeps its place, its motion
    /// and its radius. Its boxes are built beside the controller, with the GIL released, and swapped in at
    /// once, so that a loop in another thread goes on meanwhile.
    ///
    /// Parameters
    /// ----------
    /// cloud : (k, 3) array_like
    ///     The points [m], relative to the obstacle's position: at most 50 000, maybe none.
    /// obstacle : int, optional
    ///     Which of the obstacles it is; the first by default.
    /// velocities : (k, 3) array_like, optional
    ///     At which velocities the points go on by themselves [m/s], in the same frame, until others take
    ///     their place (docs/theory-spatial.md, T180). Without, they rest.
    /// t : float, optional
    ///     When they were there [s], on the clock of the calls: that of the image. Without, the last call's.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If they are not points in space, not finite or too many, if there is not one velocity to each, or
    ///     if the obstacle is no cloud. The points are those of before then.
    ///
    /// Examples
    /// --------
    /// >>> from vffnull import Arm, Controller, Obstacle
    /// >>> controller, cloud = Controller(Arm.named("panda")), Obstacle.points([[0.4, 0.0, 0.3]], 0.02)
    /// >>> rest, there = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.5, 0.0, 0.5]
    /// >>> far = controller.torque(rest, [0.0] * 7, there, obstacles=[cloud])
    /// >>> controller.update_points([[0.45, 0.0, 0.45], [0.45, 0.1, 0.45]])
    /// >>> near = controller.torque(rest, [0.0] * 7, there, obstacles=[cloud])
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
        let fault = |error: &dyn ToString| InputError::new_err(error.to_string());
        let mut inner = self.inner.take(py)?;
        if !inner.around.is_known(py, j) {
            return Err(InputError::new_err(
                "obstacle: it was given as a dict or the like, which every call reads anew; give an Obstacle",
            ));
        }
        let orientation = inner.controller.orientation_of_points(j).map_err(|e| fault(&e))?;
        drop(inner);
        let mut made = interruptible(py, || make(given, orientation))?.map_err(|e| fault(&e))?;
        let mut inner = self.inner.take(py)?;
        let swapped = inner.controller.swap_points(j, &mut made);
        drop(inner);
        py.detach(|| drop(made));
        swapped.map_err(|e| fault(&e))
    }

    fn __repr__(&self) -> String {
        format!("<Controller: {}>", self.summary)
    }
}
