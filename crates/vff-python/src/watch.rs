//! Signals and progress while the core works.
//!
//! Two ways: [`interruptible`] for work on the calling thread, which asks for signals itself, and [`Watch`] for work on
//! other threads, which the calling thread waits for.

use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use std::cell::{Cell, RefCell};
use std::sync::{Mutex, PoisonError, mpsc};
use std::thread;
use std::time::{Duration, Instant};
use vff_core::interrupt::{self, Interrupted};

/// How often signals are looked at.
pub const SIGNALS: Duration = Duration::from_millis(50);
/// How often progress is told.
pub const PROGRESS: Duration = Duration::from_millis(100);
/// How long a step may go on after a signal, so that what it changes is left whole.
const PATIENCE: Duration = Duration::from_millis(100);

thread_local! {
    /// What a signal handler has raised, and when.
    static FAULT: RefCell<Option<PyErr>> = const { RefCell::new(None) };
    static SINCE: Cell<Option<Instant>> = const { Cell::new(None) };
}

/// Runs the handlers of signals that have come; false if one has raised.
fn heard() -> bool {
    if FAULT.with_borrow(Option::is_some) {
        return false;
    }
    let raised = Python::attach(|py| py.check_signals()).err();
    let quiet = raised.is_none();
    if !quiet {
        SINCE.set(Some(Instant::now()));
        FAULT.set(raised);
    }
    quiet
}

/// The same, but a step has [`PATIENCE`] to come to its end.
fn heard_patiently() -> bool {
    heard() || SINCE.get().is_none_or(|since| since.elapsed() < PATIENCE)
}

/// Whether a signal handler has raised; for loops that end between two steps.
pub fn is_heard() -> bool {
    FAULT.with_borrow(Option::is_some)
}

/// What was raised meanwhile, or else the result.
fn outcome<T>(done: Result<T, Interrupted>) -> PyResult<T> {
    match (FAULT.take(), done) {
        (None, Ok(done)) => Ok(done),
        (Some(fault), _) => Err(fault),
        (None, Err(Interrupted)) => Err(PyKeyboardInterrupt::new_err(())),
    }
}

/// Work with the GIL released that ends with what a signal handler raises.
pub fn interruptible<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    outcome(py.detach(|| interrupt::watched(interrupt::Watch::Ask(heard), work)))
}

/// The same, with the GIL: for work that is short as a rule.
pub fn attended<T>(work: impl FnOnce() -> T) -> PyResult<T> {
    outcome(interrupt::watched(interrupt::Watch::Ask(heard), work))
}

/// Steps with the GIL released that are only broken off if one takes long; else the loop is to look at [`is_heard`].
/// Returns what they came to, if they were not broken off, and what was raised.
pub fn stepwise<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> T + Send,
) -> (Option<T>, PyResult<()>) {
    let done = py.detach(|| interrupt::watched(interrupt::Watch::Ask(heard_patiently), work));
    match done {
        Ok(done) => (Some(done), outcome(Ok(()))),
        Err(Interrupted) => (None, outcome(Err(Interrupted))),
    }
}

/// Work of a library that cannot be ended, on so many bytes: if they are many, another thread does it and, if a signal
/// handler raises meanwhile, is left to finish for nobody.
pub fn abandonable<T: Send + 'static>(
    py: Python<'_>,
    bytes: usize,
    work: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    const MANY: usize = 1 << 20;
    if bytes < MANY {
        return Ok(py.detach(work));
    }
    let (send, receive) = mpsc::sync_channel(1);
    thread::Builder::new().spawn(move || drop(send.send(work())))?;
    let receive = Mutex::new(receive); // which may then be shared with the closure below
    loop {
        let wait = || receive.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(SIGNALS);
        match py.detach(wait) {
            Ok(done) => return Ok(done),
            Err(mpsc::RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(mpsc::RecvTimeoutError::Disconnected) => {
                let sentence = "a fault of vffnull itself, please report it";
                return Err(PyRuntimeError::new_err(sentence));
            }
        }
    }
}

/// Watches for the calling thread, which has released the GIL.
pub struct Watch {
    progress: Option<Py<PyAny>>,
    told: Instant,
    fault: Option<PyErr>,
}

impl Watch {
    /// A watch that tells `progress` what is done and the total.
    pub fn new(progress: Option<&Bound<'_, PyAny>>) -> Self {
        let progress = progress.map(|progress| progress.clone().unbind());
        Self { progress, told: Instant::now(), fault: None }
    }

    /// Whether the work must go on.
    pub fn is_wanted(&mut self, done: u64, total: u64) -> bool {
        if self.fault.is_none() {
            let heard = Python::attach(|py| {
                py.check_signals()?;
                if self.told.elapsed() >= PROGRESS {
                    self.tell(py, done, total)?;
                }
                Ok(())
            });
            self.fault = heard.err();
        }
        self.fault.is_none()
    }

    /// Tells the last of it. Ctrl-C that has ended the work is no fault, for what there is then is the result; but if
    /// all was done all the same, nothing else would show it.
    pub fn end(mut self, py: Python<'_>, done: u64, total: u64) -> PyResult<()> {
        match self.fault.take() {
            Some(fault) if fault.is_instance_of::<PyKeyboardInterrupt>(py) && done < total => {
                Ok(())
            }
            Some(fault) => Err(fault),
            None => self.tell(py, done, total),
        }
    }

    fn tell(&mut self, py: Python<'_>, done: u64, total: u64) -> PyResult<()> {
        self.told = Instant::now();
        self.progress
            .as_ref()
            .map_or(Ok(()), |progress| progress.call1(py, (done, total)).map(drop))
    }
}
