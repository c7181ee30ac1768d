//! Signals and progress while the core works on other threads.

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use std::time::{Duration, Instant};

/// How often signals are looked at.
pub const SIGNALS: Duration = Duration::from_millis(50);
/// How often progress is told.
pub const PROGRESS: Duration = Duration::from_millis(100);

/// Looks on for the calling thread, which has released the GIL.
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

    /// Whether the work shall go on.
    pub fn look(&mut self, done: u64, total: u64) -> bool {
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

    /// Tells the last of it. Ctrl-C is no fault: what there is then is the result.
    pub fn end(mut self, py: Python<'_>, done: u64, total: u64) -> PyResult<()> {
        match self.fault.take() {
            Some(fault) if fault.is_instance_of::<PyKeyboardInterrupt>(py) => Ok(()),
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
