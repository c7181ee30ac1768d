//! An arm at joint positions that Python gives: one, or many at once.

use super::Arm;
use crate::convert::{finite, float_array, misshapen, vector};
use crate::errors::InputError;
use crate::watch::interruptible;
use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use vff_core::interrupt;
use vff_core::math::memory;
use vff_core::runtime::AnyState;

impl Arm {
    pub(super) fn at(&self, q: &Bound<'_, PyAny>) -> PyResult<AnyState> {
        let n = self.n();
        Ok(self.arm.at(&vector("q", q, n)?, &vec![0.0; n]))
    }

    pub(super) fn moving(&self, q: &Bound<'_, PyAny>, dq: &Bound<'_, PyAny>) -> PyResult<AnyState> {
        let n = self.n();
        Ok(self.arm.at(&vector("q", q, n)?, &vector("dq", dq, n)?))
    }

    /// What follows from joint positions, (n,) or (T, n), one array of this `shape` or T of them.
    pub(super) fn at_each<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        shape: &[usize],
        append: impl Fn(&AnyState, &mut Vec<f64>) + Sync,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (py, n) = (q.py(), self.n());
        let array = float_array("q", q)?;
        let rows = match *array.shape() {
            [last] if last == n => None,
            [rows, last] if last == n => Some(rows),
            _ => return Err(misshapen("q", array.shape(), &format!("({n},) or (T, {n})"))),
        };
        let angles = array.readonly().as_slice()?.to_vec();
        for (k, row) in angles.chunks_exact(n).enumerate() {
            let name = || rows.map_or("q".into(), |_| format!("q[{k}]"));
            if row.iter().any(|angle| !angle.is_finite()) {
                finite(&name(), row)?;
            }
        }
        let size = shape.iter().product::<usize>();
        memory::fits(size.saturating_mul(rows.unwrap_or(1)))
            .map_err(|error| InputError::new_err(format!("q: {error}")))?;
        let found = interruptible(py, || {
            let (mut state, mut found) = (self.arm.state(), Vec::new());
            for row in angles.chunks_exact(n) {
                interrupt::checkpoint(32 * n);
                state.update_positions(row);
                append(&state, &mut found);
            }
            found
        })?;
        let shape: Vec<usize> = rows.into_iter().chain(shape.iter().copied()).collect();
        Ok(PyArray1::from_vec(py, found).reshape(shape)?.into_any())
    }

    /// What is made of dense matrices, with the GIL released; some of the `count` that it takes of this size.
    pub(super) fn dense<T: Send>(
        &self,
        py: Python<'_>,
        count: usize,
        make: impl FnOnce() -> T + Send,
    ) -> PyResult<T> {
        let n = self.n();
        memory::fits(count.saturating_mul(n).saturating_mul(n))
            .map_err(|error| InputError::new_err(format!("matrices of {n} joints: {error}")))?;
        interruptible(py, make)
    }
}
