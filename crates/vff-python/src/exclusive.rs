//! Exclusive access to what threads of Python share.

use crate::errors::InputError;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The number of the thread that has it; 0 if nobody has.
const NOBODY: u64 = 0;

static NEXT: AtomicU64 = AtomicU64::new(NOBODY + 1);

thread_local! {
    /// The number of this thread.
    static ME: u64 = NEXT.fetch_add(1, Ordering::Relaxed);
}

/// A value that one thread uses at a time. Threads wait without the GIL, so that whoever has the value may need it.
pub struct Exclusive<T> {
    value: Mutex<T>,
    owner: AtomicU64,
    /// What messages call it.
    name: &'static str,
}

impl<T> Exclusive<T> {
    /// Access to `value`, which messages call `name`.
    pub fn new(name: &'static str, value: T) -> Self {
        Self { value: Mutex::new(value), owner: AtomicU64::new(NOBODY), name }
    }

    /// Waits until the calling thread has it alone. What a panic may have left behind is for the caller to check.
    ///
    /// # Errors
    /// If it has it already: a signal handler interrupts what the thread is doing, and would wait for ever.
    pub fn take(&self, py: Python<'_>) -> PyResult<Access<'_, T>> {
        let me = ME.with(|me| *me);
        if self.owner.load(Ordering::Relaxed) == me {
            let name = self.name;
            let sentence =
                format!("{name}: in use by the very call that was interrupted by this one");
            return Err(InputError::new_err(sentence));
        }
        let value = self.value.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        self.owner.store(me, Ordering::Relaxed);
        Ok(Access { value, owner: &self.owner })
    }
}

/// Exclusive access, until it is dropped.
pub struct Access<'a, T> {
    value: MutexGuard<'a, T>,
    owner: &'a AtomicU64,
}

impl<T> Deref for Access<'_, T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.value
    }
}

impl<T> DerefMut for Access<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.value
    }
}

impl<T> Drop for Access<'_, T> {
    fn drop(&mut self) {
        self.owner.store(NOBODY, Ordering::Relaxed);
    }
}
