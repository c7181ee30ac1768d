//! `ExternalRun`: the closed loop of a scenario around a plant elsewhere.

use crate::convert::{self, array1, array2, copy_vector, number};
use crate::errors::InputError;
use crate::exclusive::{Access, Exclusive};
use crate::run::{prepared, to_dict};
use crate::simulation::State;
use crate::watch::{attended, stepwise};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::time::Instant;
use vff_core::runtime::Ready;
use vff_core::runtime::batch::Rollout;
use vff_core::runtime::{ActingWrench, AnyRun, wrenches_along};
use vff_core::scenario::Scenario;
use vff_core::simulation::Control;

/// A run whose plant is elsewhere: the controller with its reference, sensors and drives, the obstacles,
/// the record and the metrics, but not what moves the arm.
///
/// In every plant step the plant asks for the torque, by `drive` or, if control is continuous, by `torque`,
/// and hands its new state to `arrive`.
///
/// Parameters
/// ----------
/// document : Mapping or object with to_dict()
///     The scenario.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the scenario cannot be run.
///
/// Examples
/// --------
/// >>> run = ExternalRun(document)  # doctest: +SKIP
/// >>> while not run.done:  # doctest: +SKIP
/// ...     run.arrive(*my_plant.step(run.drive()))
/// >>> run.outcome()["status"]  # doctest: +SKIP
#[pyclass(frozen, module = "vffnull")]
pub struct ExternalRun {
    inner: Exclusive<Inner>,
    joints: usize,
    continuous: bool,
}

struct Inner {
    /// None once its outcome is taken.
    run: Option<AnyRun>,
    warnings: Vec<String>,
    begun: Instant,
    /// The torque of the drives in the present step, once it was asked for.
    driven: Option<Vec<f64>>,
    /// Whether an evaluation was broken off midway.
    broken: bool,
}

impl Inner {
    fn run(&mut self) -> PyResult<&mut AnyRun> {
        self.run.as_mut().ok_or_else(taken)
    }

    /// The run, if it can go on.
    fn whole(&mut self) -> PyResult<&mut AnyRun> {
        if self.broken {
            let sentence = "run: was interrupted in the middle of a step; only its outcome is left";
            return Err(InputError::new_err(sentence));
        }
        self.run()
    }

    /// The torque of the drives, which are asked once per step.
    fn drive(&mut self) -> PyResult<&[f64]> {
        let driven = match self.driven.take() {
            Some(driven) => driven,
            None => self.whole()?.drive().to_vec(),
        };
        Ok(self.driven.insert(driven))
    }
}

impl ExternalRun {
    /// A state of the plant, finite or not.
    fn state_of(&self, q: &Bound<'_, PyAny>, dq: &Bound<'_, PyAny>) -> PyResult<[Vec<f64>; 2]> {
        let mut state = [vec![0.0; self.joints], vec![0.0; self.joints]];
        let [angles, velocities] = &mut state;
        copy_vector("q", q, angles)?;
        copy_vector("dq", dq, velocities)?;
        Ok(state)
    }

    fn take(&self, py: Python<'_>) -> PyResult<Access<'_, Inner>> {
        self.inner.take(py)
    }
}

#[pymethods]
impl ExternalRun {
    #[new]
    fn new(document: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (py, document) = (document.py(), convert::document(document)?);
        let (Ready { run, warnings }, continuous) = prepared(py, &document, |scenario| {
            Ok((scenario.prepare()?, scenario.simulation.control == Control::Continuous))
        })?;
        let joints = run.snapshot().q.len();
        let mut run = run;
        run.listen();
        let begun = Instant::now();
        let inner = Inner { run: Some(run), warnings, begun, driven: None, broken: false };
        Ok(Self { inner: Exclusive::new("run", inner), joints, continuous })
    }

    /// The present instant.
    #[getter]
    fn state(&self, py: Python<'_>) -> PyResult<State> {
        Ok(self.take(py)?.whole()?.snapshot().into())
    }

    /// Time [s].
    #[getter]
    fn t(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.take(py)?.whole()?.snapshot().t)
    }

    /// Whether no step is left to take: the duration is over, or the run has diverged.
    #[getter]
    fn done(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.take(py)?.run()?.is_over())
    }

    /// Positions of the obstacles at a time.
    ///
    /// Parameters
    /// ----------
    /// t : float
    ///     Time [s].
    ///
    /// Returns
    /// -------
    /// (k, 2) or (k, 3) ndarray
    ///     A row per obstacle [m].
    fn obstacles<'py>(
        &self,
        py: Python<'py>,
        t: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let t = number("t", t)?;
        let mut inner = self.take(py)?;
        let run = inner.run()?;
        let (values, dimension) = (run.obstacles_at(t), run.snapshot().dimension);
        let count = values.len() / dimension;
        array2(py, values, [count, dimension])
    }

    /// What pushes the arm over the plant step from a time on.
    ///
    /// Parameters
    /// ----------
    /// t : float
    ///     Time [s].
    /// q : (n,) array_like
    ///     Joint angles then [rad].
    ///
    /// Returns
    /// -------
    /// links : list of int
    ///     Index of the link that each wrench acts on.
    /// points, forces, torques : (k, 3) ndarray
    ///     Where the force acts [m], the force [N], and the torque beside its own [N·m], in the world;
    ///     in the plane with a third coordinate.
    fn wrenches<'py>(
        &self,
        py: Python<'py>,
        t: &Bound<'py, PyAny>,
        q: &Bound<'py, PyAny>,
    ) -> PyResult<WrenchArrays<'py>> {
        let t = number("t", t)?;
        let mut angles = vec![0.0; self.joints];
        copy_vector("q", q, &mut angles)?;
        let acting = self.take(py)?.run()?.wrenches_at(t, &angles);
        wrench_arrays(py, &acting)
    }

    /// The torque to hold over the next plant step, after the drives; the same until `arrive`.
    ///
    /// Returns
    /// -------
    /// (n,) ndarray
    ///     Joint torque [N·m].
    fn drive<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(array1(py, self.take(py)?.drive()?))
    }

    /// The law at an instant of the next plant step, for continuous control.
    ///
    /// Parameters
    /// ----------
    /// t : float
    ///     Time [s].
    /// q, dq : (n,) array_like
    ///     Joint angles [rad] and velocities [rad/s].
    ///
    /// Returns
    /// -------
    /// (n,) ndarray
    ///     Joint torque [N·m], not finite if the state is not.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If control is not continuous.
    fn torque<'py>(
        &self,
        py: Python<'py>,
        t: &Bound<'py, PyAny>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        if !self.continuous {
            let sentence = "torque: control is sampled; ask for drive(), or set simulation.control = \
                            \"continuous\"";
            return Err(InputError::new_err(sentence));
        }
        let t = number("t", t)?;
        let [q, dq] = self.state_of(q, dq)?;
        let mut inner = self.take(py)?;
        let run = inner.whole()?;
        let done = attended(|| array1(py, run.torque_at(t, &q, &dq)));
        inner.broken = done.is_err();
        done
    }

    /// Tell what touches what over the plant step that is about to end; without contacts, too.
    ///
    /// Parameters
    /// ----------
    /// obstacles, links : (k,) list of int
    ///     The obstacle and the link of each contact.
    /// points, forces : (k, 3) list
    ///     Where they touch [m], and the force on the link [N], in the world; in the plane the third
    ///     coordinate does not count.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If the lists are not of one length, or an obstacle or a link does not exist.
    #[expect(clippy::needless_pass_by_value, reason = "Python hands them over by value")]
    fn tell(
        &self,
        py: Python<'_>,
        obstacles: Vec<usize>,
        links: Vec<usize>,
        points: Vec<[f64; 3]>,
        forces: Vec<[f64; 3]>,
    ) -> PyResult<()> {
        let mut inner = self.take(py)?;
        let run = inner.whole()?;
        let (dimension, count) = (run.snapshot().dimension, run.snapshot().obstacles.count());
        let is_there =
            obstacles.iter().all(|j| *j < count) && links.iter().all(|i| *i < self.joints);
        if !is_there || [links.len(), points.len(), forces.len()] != [obstacles.len(); 3] {
            let sentence =
                "tell: expected an obstacle, a link, a point and a force of each contact";
            return Err(InputError::new_err(sentence));
        }
        let touch = |k: usize| {
            let [point, force] = [points[k], forces[k]].map(|v| v[..dimension].to_vec());
            (obstacles[k], ActingWrench { link: links[k], point, force, torque: [0.0; 3] })
        };
        run.tell(&(0..obstacles.len()).map(touch).collect::<Vec<_>>());
        Ok(())
    }

    /// Take over the state to which the plant has come within one plant step.
    ///
    /// Parameters
    /// ----------
    /// q, dq : (n,) array_like
    ///     Joint angles [rad] and velocities [rad/s]. If they are not finite, or too fast, the run has
    ///     diverged and ends before them.
    ///
    /// Returns
    /// -------
    /// bool
    ///     Whether the run has come there: False if it diverged, or was over before.
    fn arrive(
        &self,
        py: Python<'_>,
        q: &Bound<'_, PyAny>,
        dq: &Bound<'_, PyAny>,
    ) -> PyResult<bool> {
        let [q, dq] = self.state_of(q, dq)?;
        let mut inner = self.take(py)?;
        if inner.whole()?.is_over() {
            return Ok(false);
        }
        inner.drive()?; // the drives go on, whether or not the plant has asked
        inner.driven = None;
        let run = inner.whole()?;
        let before = run.snapshot().t;
        let (done, heard) = stepwise(py, || {
            run.arrive_at(&q, &dq);
            run.snapshot().t
        });
        inner.broken = done.is_none();
        heard?;
        Ok(done.is_some_and(|t| t > before))
    }

    /// How the run ended, once: the record is handed over.
    ///
    /// Returns
    /// -------
    /// dict
    ///     As `run` returns it; ``"interrupted"`` if the run is not over.
    fn outcome<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut inner = self.take(py)?;
        let run = inner.run.take().ok_or_else(taken)?;
        let warnings = inner.warnings.clone();
        let wall_time = inner.begun.elapsed().as_secs_f64();
        to_dict(py, Rollout { outcome: run.outcome(), warnings, wall_time })
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let mut inner = self.take(py)?;
        let stands = match &mut inner.run {
            Some(run) => format!("t = {} s", run.snapshot().t),
            None => "its outcome has been taken".into(),
        };
        Ok(format!("<ExternalRun: {} joints, {stands}>", self.joints))
    }
}

/// What pushes the arm of a scenario at instants of a run.
///
/// Parameters
/// ----------
/// document : Mapping
///     The scenario.
/// t : (T,) array_like
///     Times [s].
/// q : (T, n) array_like
///     Joint angles then [rad].
///
/// Returns
/// -------
/// points, forces : (T, k, 3) ndarray
///     Where the force of every wrench acts [m], and the force [N], in the world; in the plane with a third
///     coordinate.
///
/// Raises
/// ------
/// vffnull.errors.ScenarioError
///     If the scenario cannot be run.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "Python hands them over by value")]
pub fn wrenches<'py>(
    py: Python<'py>,
    document: &Bound<'py, PyAny>,
    t: Vec<f64>,
    q: Vec<Vec<f64>>,
) -> PyResult<[Bound<'py, PyArray3<f64>>; 2]> {
    let document = convert::document(document)?;
    let along = |scenario: Scenario| {
        let n = scenario.q0.len();
        if q.len() != t.len() || q.iter().any(|q| q.len() != n) {
            return Ok(None);
        }
        wrenches_along(&scenario, &t, &q.concat()).map(|all| Some((all, scenario.wrench_count())))
    };
    let Some((all, count)) = prepared(py, &document, along)? else {
        return Err(InputError::new_err(
            "q: expected as many rows as times, of a number per joint",
        ));
    };
    let array = |of: fn(&ActingWrench) -> &[f64]| {
        let coordinate = |wrench: &ActingWrench, axis| of(wrench).get(axis).copied().unwrap_or(0.0);
        let values: Vec<f64> = all
            .iter()
            .flatten()
            .flat_map(|wrench| [0, 1, 2].map(|axis| coordinate(wrench, axis)))
            .collect();
        PyArray1::from_vec(py, values).reshape([t.len(), count, 3])
    };
    Ok([array(|w| &w.point)?, array(|w| &w.force)?])
}

/// Links, points, forces and torques.
pub type WrenchArrays<'py> =
    (Vec<usize>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Wrenches as arrays of three coordinates each.
pub fn wrench_arrays<'py>(py: Python<'py>, acting: &[ActingWrench]) -> PyResult<WrenchArrays<'py>> {
    let rows = |of: fn(&ActingWrench) -> &[f64]| {
        let mut values = vec![];
        for wrench in acting {
            let given = of(wrench);
            values.extend((0..3).map(|axis| given.get(axis).copied().unwrap_or(0.0)));
        }
        array2(py, values, [acting.len(), 3])
    };
    let links = acting.iter().map(|wrench| wrench.link).collect();
    Ok((links, rows(|w| &w.point)?, rows(|w| &w.force)?, rows(|w| &w.torque)?))
}

fn taken() -> PyErr {
    InputError::new_err("run: its outcome has been taken")
}
