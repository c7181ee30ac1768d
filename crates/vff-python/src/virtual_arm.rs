//! `VirtualArm`: set points for robots that take positions or velocities.

use crate::call::{Reference, finite_time};
use crate::controller::Controller;
use crate::convert::{any_vector, array1, number, vector, wrong_type};
use crate::errors::InputError;
use crate::exclusive::Exclusive;
use numpy::PyArray1;
use pyo3::prelude::*;
use vff_core::math::ScalarOrVec;
use vff_core::runtime::{self, AnyController, Course, CycleError, SetPointLimits, VirtualArmError};

type Array1<'py> = Bound<'py, PyArray1<f64>>;

/// The closed loop run on the model, whose state is the set point of a robot that takes positions.
///
/// Once per cycle, `step` moves the model by one period under the torque of the controller, within limits of
/// speed, acceleration and jerk, and within the arm's joint limits. The law sees what these limits make of
/// its torque, and the barriers of ``cbf`` act as early as they need. Where a joint of the robot and its set
/// point part by more than `threshold`, the model comes to the robot, within the same limits, until they are
/// within a quarter of that.
///
/// From now on the controller is that of set points: a loop of torques that it has begun is over, as are
/// these once it begins another one, or forgets them by `Controller.reset` after they have finished.
///
/// Parameters
/// ----------
/// controller : Controller
///     The law, with its arm and settings. `gravity`, `torque_rate` and friction of `command` mean nothing
///     here.
/// q : (n,) array_like
///     Joint angles [rad] of the robot, which is at rest.
/// period : float
///     Control period [s].
/// acceleration, jerk : float or (n,) array_like
///     Largest acceleration [rad/s²] and jerk [rad/s³] of the joints.
/// speed : float or (n,) array_like, optional
///     Largest speed [rad/s]; the arm's velocity limits by default.
/// threshold : float, optional
///     How far a joint may be from its set point [rad]. A robot lags behind by its delay times its speed:
///     allow more than that.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     If a number is not positive, an array has the wrong length, no speed is known, a gain is unstable at
///     this period, or a joint is more than 0.2 rad (0.05 m) beyond its stop.
///
/// Examples
/// --------
/// >>> arm = Arm.named("panda")
/// >>> ready = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
/// >>> virtual = VirtualArm(Controller(arm), ready, period=0.001, acceleration=7.5, jerk=3750.0)
/// >>> q, dq, ddq, course = virtual.step(0.0, x_ref=[0.5, 0.0, 0.5], q=ready, dq=[0.0] * 7)
/// >>> course
/// 'following'
#[pyclass(frozen, module = "vffnull")]
pub struct VirtualArm {
    controller: Py<Controller>,
    n: usize,
    inner: Exclusive<runtime::VirtualArm>,
}

/// One number for all joints, or one each.
pub fn each(name: &str, given: &Bound<'_, PyAny>, n: usize) -> PyResult<ScalarOrVec> {
    match given.len() {
        Ok(_) => Ok(ScalarOrVec::Each(any_vector(name, given, n)?)),
        Err(_) => Ok(ScalarOrVec::Uniform(number(name, given)?)),
    }
}

fn refused(error: &VirtualArmError) -> PyErr {
    InputError::new_err(error.to_string())
}

#[pymethods]
impl VirtualArm {
    #[new]
    #[pyo3(
        signature = (controller, q, period, acceleration, jerk, speed=None, threshold=None),
        text_signature = "(controller, q, period, acceleration, jerk, speed=None, threshold=0.1)"
    )]
    fn new(
        controller: &Bound<'_, PyAny>,
        q: &Bound<'_, PyAny>,
        period: &Bound<'_, PyAny>,
        acceleration: &Bound<'_, PyAny>,
        jerk: &Bound<'_, PyAny>,
        speed: Option<&Bound<'_, PyAny>>,
        threshold: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let py = controller.py();
        let sentence = "controller: expected a Controller";
        let bound =
            controller.cast::<Controller>().map_err(|_| wrong_type(sentence, controller))?;
        let law = bound.get();
        let n = law.joints();
        let limits = SetPointLimits {
            speed: speed.map(|given| each("speed", given, n)).transpose()?,
            acceleration: each("acceleration", acceleration, n)?,
            jerk: each("jerk", jerk, n)?,
            threshold: threshold.map_or(Ok(0.1), |given| number("threshold", given))?,
        };
        let (period, q) = (number("period", period)?, vector("q", q, n)?);
        let made =
            law.with(py, |controller| runtime::VirtualArm::new(controller, &limits, period, &q))?;
        let inner = Exclusive::new("virtual arm", made.map_err(|error| refused(&error))?);
        Ok(Self { controller: bound.clone().unbind(), n, inner })
    }

    /// One cycle: the set point for the next instant, from that for the time `t`.
    ///
    /// Parameters
    /// ----------
    /// t : float
    ///     Time [s] at which the obstacles' motions are taken.
    /// x_ref, dx_ref, ddx_ref : array_like, optional
    ///     Reference of the end effector, as in `Controller.torque`. Without `x_ref` its motion is damped.
    /// obstacles : sequence of Obstacle or dict, optional
    ///     What to keep away from; nothing by default.
    /// q, dq : (n,) array_like, optional
    ///     Measured joint angles [rad] and velocities [rad/s]. Without them, or where one is not finite, the
    ///     robot has not been heard of; for 20 cycles in a row, once it has been, and the model stops.
    ///
    /// Returns
    /// -------
    /// q, dq, ddq : (n,) ndarray
    ///     Joint angles [rad], velocities [rad/s] and accelerations [rad/s²] of the set point.
    /// course : str
    ///     ``"following"`` the law, ``"rejoining"`` the robot, ``"waiting"`` for it, or, after `stop`,
    ///     ``"stopping"`` and in the end ``"finished"``.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If an array has the wrong shape, or time or reference are not finite.
    #[pyo3(
        signature = (t, x_ref=None, dx_ref=None, ddx_ref=None, obstacles=None, q=None, dq=None),
        text_signature = "($self, t, x_ref=None, dx_ref=None, ddx_ref=None, obstacles=(), q=None, dq=None)"
    )]
    #[expect(clippy::too_many_arguments, reason = "state and reference")]
    fn step<'py>(
        &self,
        py: Python<'py>,
        t: &Bound<'py, PyAny>,
        x_ref: Option<&Bound<'py, PyAny>>,
        dx_ref: Option<&Bound<'py, PyAny>>,
        ddx_ref: Option<&Bound<'py, PyAny>>,
        obstacles: Option<&Bound<'py, PyAny>>,
        q: Option<&Bound<'py, PyAny>>,
        dq: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Array1<'py>, Array1<'py>, Array1<'py>, &'static str)> {
        let law = self.controller.get();
        let t = finite_time(Some(t))?;
        let reference = Reference::read(law.widths(), x_ref, dx_ref, ddx_ref)?;
        let q = q.map(|q| any_vector("q", q, self.n)).transpose()?;
        let dq = dq.map(|dq| any_vector("dq", dq, self.n)).transpose()?;
        let measured = q.as_deref().zip(dq.as_deref()).map(|(q, dq)| [q, dq]);
        let accepts = |law: &AnyController| law.sets_points() && reference.suits(law);
        let done: PyResult<([Vec<f64>; 3], Course)> = law.among(py, obstacles, accepts, |controller| {
            let mut inner = self.inner.take(py)?;
            let fault = |fault: CycleError| match fault {
                CycleError::NotBegun => InputError::new_err(
                    "its set points are over: the controller has begun another loop, or has been reset",
                ),
                fault => InputError::new_err(fault.to_string()),
            };
            let course = inner.step(controller, t, reference.target().as_ref(), measured);
            Ok((inner.set_point().map(<[f64]>::to_vec), course.map_err(fault)?))
        })?;
        let ([q, dq, ddq], course) = done?;
        Ok((array1(py, &q), array1(py, &dq), array1(py, &ddq), course.name()))
    }

    /// Begin anew at rest at `q` [rad], where the robot is. The controller forgets the past.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If it has the wrong shape, is not finite, or is more than 0.2 rad (0.05 m) beyond a stop.
    fn begin(&self, py: Python<'_>, q: &Bound<'_, PyAny>) -> PyResult<()> {
        let q = vector("q", q, self.n)?;
        let begun: PyResult<_> = self
            .controller
            .get()
            .with(py, |controller| Ok(self.inner.take(py)?.begin(controller, &q)))?;
        begun?.map_err(|error| refused(&error))
    }

    /// Stop the model from the next cycle on, within its limits.
    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        self.inner.take(py)?.stop();
        Ok(())
    }

    /// What the last set point comes from, as `step` names it.
    #[getter]
    fn course(&self, py: Python<'_>) -> PyResult<&'static str> {
        Ok(self.inner.take(py)?.course().name())
    }

    fn __repr__(&self) -> String {
        format!("<VirtualArm: {} joints>", self.n)
    }
}
