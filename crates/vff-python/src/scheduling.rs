//! What a thread that keeps a clock asks of the system: a core of its own, and to go before others.

use crate::errors::InputError;
use pyo3::prelude::*;

/// The core of that number, if this process may use it.
pub fn core_id(number: usize) -> PyResult<core_affinity::CoreId> {
    let cores = core_affinity::get_core_ids().unwrap_or_default();
    cores.iter().find(|core| core.id == number).copied().ok_or_else(|| {
        let numbers: Vec<_> = cores.iter().map(|core| core.id.to_string()).collect();
        let there = numbers.join(", ");
        InputError::new_err(format!("core: {number} is not one of this machine's, {there}"))
    })
}

/// Pins the calling thread and raises its priority; says what the system refused.
pub fn request_scheduling(
    priority: Option<u8>,
    core: Option<core_affinity::CoreId>,
) -> Vec<String> {
    let mut refused = vec![];
    if let Some(core) = core
        && !core_affinity::set_for_current(core)
    {
        refused.push(format!("core: the system did not pin the thread to core {}", core.id));
    }
    if let Some(priority) = priority
        && let Err(reason) = first_in_first_out(priority)
    {
        refused.push(format!("priority: the system refused {priority} ({reason})"));
    }
    refused
}

/// Real-time scheduling of the calling thread.
#[cfg(unix)]
fn first_in_first_out(priority: u8) -> Result<(), String> {
    use thread_priority::{
        Error, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue,
        ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
    };
    let value = ThreadPriority::Crossplatform(ThreadPriorityValue::try_from(priority)?);
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), value, policy).map_err(|error| match error {
        Error::OS(code) => std::io::Error::from_raw_os_error(code).to_string(),
        other => other.to_string(),
    })
}

/// Real-time scheduling of the calling thread.
#[cfg(not(unix))]
fn first_in_first_out(_: u8) -> Result<(), String> {
    Err("this system has no SCHED_FIFO".into())
}
