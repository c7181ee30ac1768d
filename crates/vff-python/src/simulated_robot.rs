//! `SimulatedRobot`: the plant of a scenario as a robot.

use crate::arm::Arm;
use crate::convert::{self, array1, number, vector, wrong_type};
use crate::errors::InputError;
use crate::loading::load_numpy;
use crate::run::prepared;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use vff_core::runtime::drive::{self, Driver, RATES};
use vff_core::scenario::Scenario;

pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A rate of the loop [Hz].
pub fn rate_of(rate: Option<&Bound<'_, PyAny>>) -> PyResult<f64> {
    let rate = rate.map_or(Ok(1000.0), |rate| number("rate", rate))?;
    match RATES.contains(&rate) {
        true => Ok(rate),
        false => {
            let (low, high) = (RATES.start(), RATES.end());
            Err(InputError::new_err(format!("rate: must be from {low} to {high} Hz, got {rate}")))
        }
    }
}

/// The plant of a scenario as a robot: `vffnull.robots.simulated` is where users find it.
///
/// It has its friction, joint stops, sensors and drives, but not its controller. It goes on by one period
/// whenever it gets a torque, so that its time does not depend on the clock. `vffnull.drive` drives it
/// without Python in the loop; called as any other robot, it is one in Python.
///
/// Parameters
/// ----------
/// scenario : Scenario, dict, str or path
///     Arm, plant, start, obstacles, sensors.
/// rate : float, optional
///     Torques per second [Hz]: that of the drive.
/// arm : Arm, optional
///     If given, the robot adds the torque against gravity of this arm by itself, as many robots do.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the scenario cannot be run at this rate.
#[pyclass(frozen, module = "vffnull.robots.simulated")]
pub struct SimulatedRobot {
    pub inner: Arc<Mutex<drive::SimulatedRobot>>,
    pub n: usize,
    pub weightless: bool,
    /// Whether a drive has it.
    pub driven: Arc<AtomicBool>,
}

#[pymethods]
impl SimulatedRobot {
    #[new]
    #[pyo3(signature = (scenario, rate=None, arm=None), text_signature = "(scenario, rate=1000.0, arm=None)")]
    fn new(
        scenario: &Bound<'_, PyAny>,
        rate: Option<&Bound<'_, PyAny>>,
        arm: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let rate = rate_of(rate)?;
        let arm = match arm {
            Some(arm) => {
                let fault = |_| wrong_type("arm: expected an Arm", arm);
                Some(arm.cast::<Arm>().map_err(fault)?.get().arm.clone())
            }
            None => None,
        };
        let dof = arm.as_ref().map(|arm| arm.dof());
        let make = |scenario: Scenario| drive::SimulatedRobot::new(&scenario, rate, arm.as_ref());
        let inner = prepared(scenario.py(), &convert::scenario(scenario)?, make)?;
        let (n, weightless) = (inner.dof(), inner.is_weightless());
        if dof.is_some_and(|dof| dof != n) {
            return Err(InputError::new_err(format!(
                "arm: expected one of {n} joints, as in the scenario"
            )));
        }
        let driven = Arc::default();
        Ok(Self { inner: Arc::new(Mutex::new(inner)), n, weightless, driven })
    }

    /// Who adds the torque against gravity: ``"robot"`` with an `arm`, or where the scenario's ``command``
    /// says so, else ``"controller"``.
    #[getter]
    fn gravity(&self) -> &'static str {
        if self.weightless { "robot" } else { "controller" }
    }

    /// Time, and joint positions and velocities as they are measured.
    ///
    /// Returns
    /// -------
    /// tuple
    ///     Time [s], positions (n,) [rad], velocities (n,) [rad/s].
    fn read<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        load_numpy(py)?;
        let [mut q, mut dq] = [(); 2].map(|()| vec![0.0; self.n]);
        let read = py.detach(|| lock(&self.inner).read(&mut q, &mut dq));
        let t = read.map_err(InputError::new_err)?;
        (t, array1(py, &q), array1(py, &dq)).into_pyobject(py)
    }

    /// The torque of the scenario's wrenches, as a sensor measures it, (n,) [N·m].
    fn external_torque<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let mut tau = vec![0.0; self.n];
        let read = py.detach(|| lock(&self.inner).external_torque(&mut tau));
        read.map_err(InputError::new_err)?;
        Ok(array1(py, &tau))
    }

    /// Hold a torque for a period.
    ///
    /// Parameters
    /// ----------
    /// command : (n,) array_like
    ///     Joint torque [N·m].
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If it has the wrong shape or is not finite, or the next state would not be finite.
    fn write(&self, py: Python<'_>, command: &Bound<'_, PyAny>) -> PyResult<()> {
        let command = vector("command", command, self.n)?;
        py.detach(|| lock(&self.inner).write(&command)).map_err(InputError::new_err)
    }
}

/// The shared one, in the loop.
pub struct Simulated {
    pub robot: Arc<Mutex<drive::SimulatedRobot>>,
    /// Whether a drive has it, and whether that is this one.
    pub driven: Arc<AtomicBool>,
    pub is_ours: bool,
}

impl Drop for Simulated {
    fn drop(&mut self) {
        if self.is_ours {
            self.driven.store(false, Ordering::Release);
        }
    }
}

impl Driver for Simulated {
    fn begin(&mut self) -> Result<(), String> {
        if self.driven.swap(true, Ordering::AcqRel) {
            return Err("another drive has this robot; stop that first".into());
        }
        self.is_ours = true;
        Ok(())
    }
    fn read(&mut self, q: &mut [f64], dq: &mut [f64]) -> Result<f64, String> {
        lock(&self.robot).read(q, dq)
    }
    fn external_torque(&mut self, tau: &mut [f64]) -> Result<bool, String> {
        lock(&self.robot).external_torque(tau)
    }
    fn write(&mut self, command: &[f64]) -> Result<(), String> {
        lock(&self.robot).write(command)
    }
}
