//! `Episodes`: many episodes of one scenario, stepped together.

use crate::convert::{array2, document, read_matrix};
use crate::errors::{self, InputError};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use vff_core::runtime::episode::{INFO, Task};
use vff_core::runtime::vector::{self, Autoreset, Slot};
use vff_core::scenario::Scenario;

type Array1<'py, T> = Bound<'py, PyArray1<T>>;
type Array2<'py> = Bound<'py, PyArray2<f64>>;
/// Observations, rewards, terminations, truncations and information, a row per episode.
type Steps<'py> =
    (Array2<'py>, Array1<'py, f64>, Array1<'py, bool>, Array1<'py, bool>, Array2<'py>);

/// Episodes side by side.
#[pyclass(module = "vffnull")]
pub struct Episodes {
    inner: vector::Episodes,
    autoreset: Autoreset,
}

impl Episodes {
    /// A row of numbers of every episode.
    fn rows<'py>(&self, py: Python<'py>, row: impl Fn(&Slot) -> &[f64]) -> PyResult<Array2<'py>> {
        let slots = self.inner.slots();
        let values: Vec<f64> = slots.iter().flat_map(row).copied().collect();
        let width = values.len() / slots.len();
        array2(py, values, [slots.len(), width])
    }

    fn list<'py, T: numpy::Element>(
        &self,
        py: Python<'py>,
        value: impl Fn(&Slot) -> T,
    ) -> Array1<'py, T> {
        PyArray1::from_iter(py, self.inner.slots().iter().map(value))
    }
}

#[pymethods]
impl Episodes {
    #[new]
    #[pyo3(signature = (scenario, settings, count, threads, seed, autoreset="next_step"))]
    fn new(
        scenario: &Bound<'_, PyAny>,
        settings: &Bound<'_, PyAny>,
        count: usize,
        threads: usize,
        seed: u64,
        autoreset: &str,
    ) -> PyResult<Self> {
        let autoreset = match autoreset {
            "next_step" => Autoreset::NextStep,
            "same_step" => Autoreset::SameStep,
            "disabled" => Autoreset::Disabled,
            other => {
                let sentence = "autoreset: expected next_step, same_step or disabled";
                return Err(InputError::new_err(format!("{sentence}, got {other}")));
            }
        };
        if count == 0 {
            return Err(InputError::new_err("count: must be 1 or more, got 0"));
        }
        let (scenario, settings) = (document(scenario)?, document(settings)?);
        let inner = Scenario::from_document(&scenario)
            .and_then(|scenario| Task::new(scenario, &settings))
            .and_then(|task| vector::Episodes::new(task, count, threads, seed))
            .map_err(|error| errors::scenario(&error))?;
        Ok(Self { inner, autoreset })
    }

    /// Begins the episodes of the mask anew, with their seeds where there are any.
    #[pyo3(signature = (seeds, mask=None))]
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        seeds: Vec<Option<u64>>,
        mask: Option<Vec<bool>>,
    ) -> PyResult<(Array2<'py>, Array2<'py>)> {
        let count = self.inner.slots().len();
        let mask = mask.unwrap_or_else(|| vec![true; count]);
        for (name, given) in [("seeds", seeds.len()), ("mask", mask.len())] {
            if given != count {
                let sentence = format!("{name}: expected {count} values, got {given}");
                return Err(InputError::new_err(sentence));
            }
        }
        let meant: Vec<_> =
            seeds.into_iter().zip(mask).map(|(seed, meant)| meant.then_some(seed)).collect();
        let inner = &mut self.inner;
        py.detach(|| inner.reset(&meant)).map_err(|error| errors::scenario(&error))?;
        Ok((self.rows(py, |slot| &slot.observation)?, self.rows(py, |slot| &slot.step.info)?))
    }

    /// Steps all of them, the GIL released.
    fn step<'py>(&mut self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Steps<'py>> {
        let shape = [self.inner.slots().len(), self.inner.task().joints()];
        let actions = read_matrix("action", actions, shape)?;
        let Self { inner, autoreset } = self;
        py.detach(|| inner.step(&actions, *autoreset)).map_err(|error| errors::scenario(&error))?;
        Ok((
            self.rows(py, |slot| &slot.observation)?,
            self.list(py, |slot| slot.step.reward),
            self.list(py, |slot| slot.step.terminated),
            self.list(py, |slot| slot.step.truncated),
            self.rows(py, |slot| &slot.step.info)?,
        ))
    }

    /// Which episodes ended and began anew within the last step, and what they showed at their end.
    fn ended<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Array1<'py, bool>, Array2<'py>, Array2<'py>)> {
        Ok((
            self.list(py, |slot| slot.ended),
            self.rows(py, |slot| &slot.last_observation)?,
            self.rows(py, |slot| &slot.last_info)?,
        ))
    }

    #[getter]
    fn layout(&self) -> Vec<(&'static str, usize, usize, f64)> {
        let parts = self.inner.task().layout().iter();
        parts.map(|part| (part.name, part.shape[0], part.shape[1], part.bound)).collect()
    }

    #[getter]
    fn torque<'py>(&self, py: Python<'py>) -> Array1<'py, f64> {
        PyArray1::from_slice(py, self.inner.task().torque())
    }

    #[getter]
    fn period(&self) -> f64 {
        self.inner.task().period()
    }

    #[classattr]
    #[pyo3(name = "INFO")]
    fn info_names() -> Vec<&'static str> {
        INFO.to_vec()
    }

    fn __len__(&self) -> usize {
        self.inner.slots().len()
    }
}
