//! The first load of NumPy, which happens where an array is first needed: `import vffnull` stays quick.
//!
//! NumPy clears exceptions in places while it loads, and its bindings panic where they cannot load it: what a signal
//! handler raises meanwhile would be lost. So both are loaded by a thread of their own, where no signal handler
//! runs, while the caller waits and answers signals. It is a thread of Python's, which Python waits for at its end.

use crate::errors::InputError;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyDict};
use std::panic;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;

/// How long a waiting caller sleeps between two looks for signals and for the end of the load.
const LOOK_EVERY: Duration = Duration::from_millis(1);

static LOADED: AtomicBool = AtomicBool::new(false);
static LOADER: Mutex<Option<Loader>> = Mutex::new(None);

/// How it ended, when it has.
type End = Arc<OnceLock<PyResult<()>>>;

/// The thread that loads.
struct Loader {
    thread: Py<PyAny>,
    end: End,
}

/// Loads what arrays need. To be called before the first of them is made.
pub fn load_numpy(py: Python<'_>) -> PyResult<()> {
    if LOADED.load(Ordering::Acquire) {
        return Ok(());
    }
    let end = match at_work(py)? {
        Some(end) => end,
        None => match start(py) {
            // Python starts no thread while it ends.
            Err(error) if error.is_instance_of::<PyRuntimeError>(py) => return load(py),
            started => started?,
        },
    };
    loop {
        if let Some(end) = end.get() {
            return end.as_ref().copied().map_err(|error| error.clone_ref(py));
        }
        py.check_signals()?;
        py.detach(|| thread::sleep(LOOK_EVERY));
    }
}

/// To be called before a fork: a child would wait for ever for what a thread that it does not have is loading.
#[pyfunction]
pub fn before_fork(py: Python<'_>) -> PyResult<()> {
    if at_work(py)?.is_some() { load_numpy(py) } else { Ok(()) }
}

fn loader() -> MutexGuard<'static, Option<Loader>> {
    LOADER.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The end that a thread is at work on. One that a signal kept from starting is not at work.
fn at_work(py: Python<'_>) -> PyResult<Option<End>> {
    let found = loader().as_ref().map(|it| (it.thread.clone_ref(py), it.end.clone()));
    let Some((thread, end)) = found.filter(|(_, end)| end.get().is_none()) else { return Ok(None) };
    Ok(thread.bind(py).call_method0("is_alive")?.extract::<bool>()?.then_some(end))
}

fn start(py: Python<'_>) -> PyResult<End> {
    let end = End::default();
    let ended = end.clone();
    let work = PyCFunction::new_closure(py, None, None, move |arguments, _| {
        // Only this thread sets it.
        let _ = ended.set(load(arguments.py()));
    })?;
    let keywords = PyDict::new(py);
    keywords.set_item("target", work)?;
    keywords.set_item("name", "vffnull loads NumPy")?;
    keywords.set_item("daemon", false)?;
    let thread = py.import("threading")?.getattr("Thread")?.call((), Some(&keywords))?;
    *loader() = Some(Loader { thread: thread.clone().unbind(), end: end.clone() });
    thread.call_method0("start")?;
    Ok(end)
}

/// NumPy, and what its bindings load where they are first used.
fn load(py: Python<'_>) -> PyResult<()> {
    py.import("numpy")?;
    panic::catch_unwind(|| drop(PyArray1::from_slice(py, &[0.0]).readonly()))
        .map_err(|_| InputError::new_err("NumPy cannot be loaded"))?;
    LOADED.store(true, Ordering::Release);
    Ok(())
}
