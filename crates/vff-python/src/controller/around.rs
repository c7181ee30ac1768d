//! Among which obstacles the law is asked.

use super::{Controller, Inner};
use crate::call::{read_obstacles, sequence};
use crate::errors;
use crate::exclusive::Access;
use crate::watch::attended;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use std::mem::{replace, take};
use vff_core::runtime::controller::Surroundings;
use vff_core::runtime::{AnyController, AnyObstacles};

/// The obstacles of the last call, as they were given: the same again need not be read again.
#[derive(Default)]
pub(super) struct Around(Vec<Py<PyAny>>);

impl Around {
    /// Whether these are the very obstacles of the last call, and none can have changed.
    fn knows(&self, py: Python<'_>, given: &[Bound<'_, PyAny>]) -> bool {
        given.len() == self.0.len()
            && given.iter().zip(&self.0).all(|(new, old)| new.is(old.bind(py)))
            && given.iter().all(stays)
    }

    /// Whether number `j` is not read anew by every call; what is not there is refused later.
    pub fn is_known(&self, py: Python<'_>, j: usize) -> bool {
        self.0.get(j).is_none_or(|given| stays(given.bind(py)))
    }
}

/// Whether this is an `Obstacle`, which does not change: anything else is read every time.
fn stays(given: &Bound<'_, PyAny>) -> bool {
    static OBSTACLE: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let obstacle = OBSTACLE.import(given.py(), "vffnull.model.obstacle", "Obstacle");
    obstacle.is_ok_and(|obstacle| given.get_type().is(obstacle))
}

impl Controller {
    /// Does something with the law among the obstacles of the last call.
    pub fn with<T>(
        &self,
        py: Python<'_>,
        act: impl FnOnce(&mut AnyController) -> T,
    ) -> PyResult<T> {
        Ok(act(&mut self.inner.take(py)?.controller))
    }

    /// Does something with the law among these obstacles. Where it does not accept that, which is then to be refused, they are not
    /// taken in.
    ///
    /// Whatever may run Python code (arrays, obstacles) is read while the lock is not held: that
    /// code may call this very controller.
    pub fn among<T>(
        &self,
        py: Python<'_>,
        obstacles: Option<&Bound<'_, PyAny>>,
        accepts: impl FnOnce(&AnyController) -> bool,
        act: impl FnOnce(&mut AnyController) -> T,
    ) -> PyResult<T> {
        self.among_those(
            py,
            obstacles.map_or(Ok(vec![]), |given| sequence("obstacles", given))?,
            accepts,
            act,
        )
    }

    fn among_those<T>(
        &self,
        py: Python<'_>,
        given: Vec<Bound<'_, PyAny>>,
        accepts: impl FnOnce(&AnyController) -> bool,
        act: impl FnOnce(&mut AnyController) -> T,
    ) -> PyResult<T> {
        let mut inner = self.inner.take(py)?;
        let (mut old, mut left) = (vec![], None);
        if !inner.around.knows(py, &given) && accepts(&inner.controller) {
            drop(inner);
            let around;
            (inner, around) = self.read_around(py, &given)?;
            let around = left.insert(around);
            inner.controller.exchange(around, 0.0);
            old = replace(&mut inner.around.0, given.into_iter().map(Bound::unbind).collect());
        }
        let done = attended(|| act(&mut inner.controller));
        if done.is_err() {
            inner.controller.begin_anew();
            old = take(&mut inner.around.0);
        }
        drop(inner);
        drop(left);
        drop(old); // which may run Python code, too
        done
    }

    /// What the law would be among with these obstacles around, and access to it.
    fn read_around(
        &self,
        py: Python<'_>,
        given: &[Bound<'_, PyAny>],
    ) -> PyResult<(Access<'_, Inner>, Surroundings)> {
        let read = read_obstacles(self.nothing.clone(), given, AnyObstacles::read_seen)?;
        let inner = self.inner.take(py)?;
        let around = attended(|| inner.controller.surroundings_of(read))?;
        Ok((inner, around.map_err(|error| errors::scenario(&error))?))
    }

    /// The same for what is no cycle of a loop that is watched over or sets points: that goes on among its own obstacles, and what
    /// has been seen of them.
    pub(super) fn asked_among<T>(
        &self,
        py: Python<'_>,
        obstacles: Option<&Bound<'_, PyAny>>,
        accepts: impl FnOnce(&AnyController) -> bool,
        act: impl FnOnce(&mut AnyController) -> T,
    ) -> PyResult<T> {
        let given = obstacles.map_or(Ok(vec![]), |given| sequence("obstacles", given))?;
        let inner = self.inner.take(py)?;
        let is_own = inner.controller.phase().is_none() && !inner.controller.sets_points();
        if is_own || inner.around.knows(py, &given) {
            drop(inner);
            return self.among_those(py, given, accepts, act);
        }
        drop(inner);
        let (mut inner, mut around) = self.read_around(py, &given)?;
        inner.controller.lend(&mut around);
        let done = attended(|| act(&mut inner.controller));
        inner.controller.lend(&mut around);
        done
    }
}
