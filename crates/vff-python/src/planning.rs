//! Plans: found by the core, and read at any instant.
#![expect(clippy::needless_pass_by_value, reason = "Python hands documents over by value")]

use crate::convert::{array2, document, float_array, misshapen, values};
use crate::errors::InputError;
use crate::run::prepared;
use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use vff_core::math::ScalarOrVec;
use vff_core::planning::motion::{self, PlanSettings};
use vff_core::trajectory::JointSpline;

/// Plan a motion of a scenario's arm among its obstacles, with the GIL released.
///
/// Parameters
/// ----------
/// document : Mapping
///     The scenario. Without `goal`, the end effector goes to where its reference is at the end of its
///     duration.
/// start, goal : list of float or None
///     Configurations [rad]; the start is the scenario's ``q0`` by default.
/// time : float
///     When the motion starts [s].
/// margin : float
///     What every link keeps from obstacles [m].
/// horizon : float or None
///     For how long the places that obstacles will pass are kept free [s]; None leaves out what moves.
/// tilt : float or None
///     How far the end effector may tilt from how it stands at `upright` [rad]; None: that does not matter.
/// upright : list of float or None
///     The configuration in which it stands upright [rad]; the start by default.
/// view : tuple of list of float and float, or None
///     A point that the end effector keeps in view [m], and how far off its axis that may be [rad].
/// approach, retreat : list of float or None
///     How far the end effector comes straight to the goal and leaves the start [m], as one number, or the
///     vectors along which it does; None: that does not matter.
/// acceleration, jerk : list of float or None
///     What the joints may do [rad/s², m/s²; rad/s³, m/s³]; by default 30 in the plane, 10 in space, and any.
/// speed : float
///     Share of the limits of speed, acceleration and jerk, in (0, 1].
/// samples : int
///     How many random configurations are tried.
/// paths : int
///     How many paths are searched, of which the shortest is taken.
/// seed : int
///     Where the random numbers come from.
///
/// Returns
/// -------
/// dict
///     ``status``, ``message``, ``t``, ``q``, ``dq``, ``ddq``, ``tip``, ``clearance``, ``margin``,
///     ``margins``, ``shares``, ``begins``, ``tilt``, ``view``, ``gap``, ``samples``, ``nodes``.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the scenario cannot be read, or a setting is of no use.
#[pyfunction]
#[pyo3(signature = (document, start, goal, time, margin, horizon, tilt, upright, view, approach, retreat, acceleration, jerk, speed, samples, paths, seed))]
#[expect(clippy::too_many_arguments, reason = "each by its name in Python")]
pub fn plan<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = document)] document: toml::Table,
    start: Option<Vec<f64>>,
    goal: Option<Vec<f64>>,
    time: f64,
    margin: f64,
    horizon: Option<f64>,
    tilt: Option<f64>,
    upright: Option<Vec<f64>>,
    view: Option<(Vec<f64>, f64)>,
    approach: Option<Vec<f64>>,
    retreat: Option<Vec<f64>>,
    acceleration: Option<Vec<f64>>,
    jerk: Option<Vec<f64>>,
    speed: f64,
    samples: usize,
    paths: usize,
    seed: u64,
) -> PyResult<Bound<'py, PyDict>> {
    let straight = |given: Vec<f64>| match given[..] {
        [far] => ScalarOrVec::Uniform(far),
        _ => ScalarOrVec::Each(given),
    };
    let settings = PlanSettings {
        start,
        goal,
        time,
        margin,
        horizon,
        tilt,
        upright,
        view,
        approach: approach.map(straight),
        retreat: retreat.map(straight),
        acceleration: acceleration.map(ScalarOrVec::Each),
        jerk: jerk.map(ScalarOrVec::Each),
        speed,
        samples,
        paths,
        seed,
    };
    let (plan, n, dimension) = prepared(py, &document, |scenario| {
        Ok((motion::plan(&scenario, &settings)?, scenario.q0.len(), scenario.scene.dimension()))
    })?;
    let found = PyDict::new(py);
    found.set_item("status", plan.status.name())?;
    found.set_item("message", plan.message)?;
    found.set_item("t", PyArray1::from_vec(py, plan.times))?;
    let rows = plan.q.len() / n;
    found.set_item("tip", array2(py, plan.tip, [rows, dimension])?)?;
    let arrays = [
        ("q", plan.q),
        ("dq", plan.dq),
        ("ddq", plan.ddq),
        ("margins", plan.margins),
        ("shares", plan.shares),
    ];
    for (name, numbers) in arrays {
        let rows = numbers.len() / n;
        found.set_item(name, array2(py, numbers, [rows, n])?)?;
    }
    found.set_item("clearance", plan.clearance)?;
    found.set_item("margin", plan.margin)?;
    found.set_item("begins", plan.begins)?;
    found.set_item("tilt", plan.tilt)?;
    found.set_item("view", plan.view)?;
    found.set_item("gap", plan.gap)?;
    found.set_item("samples", plan.samples)?;
    found.set_item("nodes", plan.nodes)?;
    Ok(found)
}

/// Positions, velocities and accelerations of joints along a plan, as a scenario that follows it has them.
///
/// Parameters
/// ----------
/// times : (k,) array_like
///     The instants of the plan [s].
/// points : (k, n) array_like
///     Its configurations [rad].
/// t : (m,) array_like
///     Instants [s].
///
/// Returns
/// -------
/// tuple of (m, n) ndarray
///     q, dq and ddq.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     If the arrays do not fit each other, or the times do not increase.
#[pyfunction]
pub fn joints_at<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    points: &Bound<'py, PyAny>,
    t: &Bound<'py, PyAny>,
) -> PyResult<[Bound<'py, PyArray2<f64>>; 3]> {
    let [times, t] = [("times", times), ("t", t)].map(|(name, given)| {
        let array = float_array(name, given)?;
        match array.shape() {
            [_] => values(name, &array),
            shape => Err(misshapen(name, shape, "(k,)")),
        }
    });
    let (times, t) = (times?, t?);
    let array = float_array("points", points)?;
    let [_, n] = array.shape() else {
        return Err(misshapen("points", array.shape(), "(k, n)"));
    };
    let n = *n;
    let points: Vec<Vec<f64>> =
        values("points", &array)?.chunks(n.max(1)).map(<[f64]>::to_vec).collect();
    let spline = JointSpline::new(&times, &points)
        .map_err(|error| InputError::new_err(format!("{}: {error}", error.field())))?;
    let mut found = [0; 3].map(|_| vec![0.0; t.len() * n]);
    for (k, t) in t.iter().enumerate() {
        spline.at(*t, found.each_mut().map(|all| &mut all[k * n..(k + 1) * n]));
    }
    let rows = t.len();
    let [q, dq, ddq] = found.map(|numbers| array2(py, numbers, [rows, n]));
    Ok([q?, dq?, ddq?])
}
