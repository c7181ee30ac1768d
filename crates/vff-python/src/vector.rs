//! `Episodes`: many episodes of one scenario, stepped together.

use crate::convert::{self, array2, cut, document, read_matrix};
use crate::errors::{self, InputError};
use crate::exclusive::Exclusive;
use crate::run::prepared;
use crate::watch::interruptible;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use vff_core::runtime::episode::{INFO, Task};
use vff_core::runtime::vector::{self, Autoreset, Slot};
use vff_core::scenario::ScenarioError;

type Array1<'py, T> = Bound<'py, PyArray1<T>>;
type Array2<'py> = Bound<'py, PyArray2<f64>>;
/// Observations, rewards, terminations, truncations and information, a row per episode.
type Steps<'py> =
    (Array2<'py>, Array1<'py, f64>, Array1<'py, bool>, Array1<'py, bool>, Array2<'py>);

/// Episodes of one scenario side by side: what the environments of `vffnull.engines.gym` are made of.
///
/// Parameters
/// ----------
/// scenario : Scenario, dict, str or path
///     What happens in an episode.
/// settings : Mapping
///     ``action``, ``period``, ``torque``, ``start_noise``, ``obstacle_noise``, ``margin``, ``weights``; see
///     `vffnull.engines.gym.ReachEnv`.
/// count : int
///     How many episodes.
/// threads : int
///     How many threads step them.
/// seed : int
///     Episode i has the seed ``seed + i``.
/// autoreset : {"next_step", "same_step", "disabled"}, optional
///     When an episode that has ended begins anew.
#[pyclass(frozen, module = "vffnull")]
pub struct Episodes {
    inner: Exclusive<Inner>,
    autoreset: Autoreset,
}

struct Inner {
    episodes: vector::Episodes,
    /// Whether a step was broken off midway.
    broken: bool,
}

impl Inner {
    fn slots(&self) -> &[Slot] {
        self.episodes.slots()
    }

    /// A row of numbers of every episode.
    fn rows<'py>(&self, py: Python<'py>, row: impl Fn(&Slot) -> &[f64]) -> PyResult<Array2<'py>> {
        let slots = self.slots();
        let values: Vec<f64> = slots.iter().flat_map(row).copied().collect();
        let width = values.len() / slots.len();
        array2(py, values, [slots.len(), width])
    }

    fn list<'py, T: numpy::Element>(
        &self,
        py: Python<'py>,
        value: impl Fn(&Slot) -> T,
    ) -> Array1<'py, T> {
        PyArray1::from_iter(py, self.slots().iter().map(value))
    }

    /// Does something with the episodes, the GIL released.
    fn each(
        &mut self,
        py: Python<'_>,
        act: impl FnOnce(&mut vector::Episodes) -> Result<(), ScenarioError> + Send,
    ) -> PyResult<()> {
        self.broken = true;
        interruptible(py, || act(&mut self.episodes))?.map_err(|error| errors::scenario(&error))?;
        self.broken = false;
        Ok(())
    }
}

#[pymethods]
impl Episodes {
    #[new]
    #[pyo3(signature = (scenario, settings, count, threads, seed, autoreset="next_step"))]
    fn new(
        scenario: &Bound<'_, PyAny>,
        settings: &Bound<'_, PyAny>,
        count: &Bound<'_, PyAny>,
        threads: &Bound<'_, PyAny>,
        seed: &Bound<'_, PyAny>,
        autoreset: &str,
    ) -> PyResult<Self> {
        let py = scenario.py();
        let autoreset = match autoreset {
            "next_step" => Autoreset::NextStep,
            "same_step" => Autoreset::SameStep,
            "disabled" => Autoreset::Disabled,
            other => {
                let sentence = "autoreset: expected next_step, same_step or disabled";
                return Err(InputError::new_err(format!("{sentence}, got {}", cut(other))));
            }
        };
        let at_least_one = |name: &str, value: &Bound<'_, PyAny>| match convert::count(name, value)?
        {
            0 => Err(InputError::new_err(format!("{name}: must be 1 or more, got 0"))),
            count => Ok(usize::try_from(count).unwrap_or(usize::MAX)),
        };
        let (count, threads) = (at_least_one("count", count)?, at_least_one("threads", threads)?);
        let seed = convert::count("seed", seed)?;
        let (scenario, settings) = (convert::scenario(scenario)?, document(settings)?);
        let episodes = prepared(py, &scenario, |scenario| {
            let task = Task::new(scenario, &settings)?;
            vector::Episodes::new(task, count, threads, seed)
        })?;
        let inner = Inner { episodes, broken: false };
        Ok(Self { inner: Exclusive::new("episodes", inner), autoreset })
    }

    /// Begin those in the mask anew, each with its seed if there is one.
    ///
    /// Returns
    /// -------
    /// (count, width) ndarray, (count, len(INFO)) ndarray
    ///     Observations and information.
    #[pyo3(signature = (seeds, mask=None))]
    fn reset<'py>(
        &self,
        py: Python<'py>,
        seeds: Vec<Option<Bound<'py, PyAny>>>,
        mask: Option<Vec<bool>>,
    ) -> PyResult<(Array2<'py>, Array2<'py>)> {
        let seed = |(i, seed): (usize, Option<Bound<'py, PyAny>>)| {
            seed.map(|seed| convert::count(&format!("seeds[{i}]"), &seed)).transpose()
        };
        let seeds = seeds.into_iter().enumerate().map(seed).collect::<PyResult<Vec<_>>>()?;
        let mut inner = self.inner.take(py)?;
        let count = inner.slots().len();
        let mask = mask.unwrap_or_else(|| vec![true; count]);
        for (name, given) in [("seeds", seeds.len()), ("mask", mask.len())] {
            if given != count {
                let sentence = format!("{name}: expected {count} values, got {given}");
                return Err(InputError::new_err(sentence));
            }
        }
        if inner.broken && mask.iter().any(|meant| !meant) {
            return Err(broken());
        }
        let meant: Vec<_> =
            seeds.into_iter().zip(mask).map(|(seed, meant)| meant.then_some(seed)).collect();
        inner.each(py, |episodes| episodes.reset(&meant))?;
        Ok((inner.rows(py, |slot| &slot.observation)?, inner.rows(py, |slot| &slot.step.info)?))
    }

    /// Step all of them, the GIL released.
    ///
    /// Parameters
    /// ----------
    /// actions : (count, n) array_like
    ///     From −1 to 1.
    ///
    /// Returns
    /// -------
    /// tuple of ndarray
    ///     Observations (count, width), rewards, terminations and truncations (count,), information.
    fn step<'py>(&self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Steps<'py>> {
        let shape = {
            let inner = self.inner.take(py)?;
            [inner.slots().len(), inner.episodes.task().joints()]
        };
        let actions = read_matrix("action", actions, shape)?;
        let mut inner = self.inner.take(py)?;
        if inner.broken {
            return Err(broken());
        }
        let autoreset = self.autoreset;
        inner.each(py, |episodes| episodes.step(&actions, autoreset))?;
        Ok((
            inner.rows(py, |slot| &slot.observation)?,
            inner.list(py, |slot| slot.step.reward),
            inner.list(py, |slot| slot.step.terminated),
            inner.list(py, |slot| slot.step.truncated),
            inner.rows(py, |slot| &slot.step.info)?,
        ))
    }

    /// Which ones ended and began anew within the last step, their last observation and information.
    fn ended<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Array1<'py, bool>, Array2<'py>, Array2<'py>)> {
        let inner = self.inner.take(py)?;
        Ok((
            inner.list(py, |slot| slot.ended),
            inner.rows(py, |slot| &slot.last_observation)?,
            inner.rows(py, |slot| &slot.last_info)?,
        ))
    }

    /// Name, rows, columns and bound of each part of an observation.
    #[getter]
    fn layout(&self, py: Python<'_>) -> PyResult<Vec<(&'static str, usize, usize, f64)>> {
        let inner = self.inner.take(py)?;
        let parts = inner.episodes.task().layout().iter();
        Ok(parts.map(|part| (part.name, part.shape[0], part.shape[1], part.bound)).collect())
    }

    /// The torque of an action of 1 [N·m], (n,).
    #[getter]
    fn torque<'py>(&self, py: Python<'py>) -> PyResult<Array1<'py, f64>> {
        Ok(PyArray1::from_slice(py, self.inner.take(py)?.episodes.task().torque()))
    }

    /// How long an action lasts [s].
    #[getter]
    fn period(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.inner.take(py)?.episodes.task().period())
    }

    #[classattr]
    #[pyo3(name = "INFO")]
    fn info_names() -> Vec<&'static str> {
        INFO.to_vec()
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.inner.take(py)?.slots().len())
    }
}

fn broken() -> PyErr {
    InputError::new_err("episodes: a step was interrupted; reset() of all of them begins anew")
}
