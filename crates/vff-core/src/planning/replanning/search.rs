//! A search for another plan, while the old one is followed.

use super::super::motion::Plan;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;

/// A search under way.
#[derive(Debug)]
pub enum Search {
    /// Done, but as if it lasted until `arrives` \[s\].
    Simulated { found: Option<Box<Plan>>, arrives: f64 },
    /// In another thread, which gives it up. One that begins where the old plan is at `arrives` \[s\] is not taken before.
    Beside {
        answer: Receiver<Found>,
        found: Option<Found>,
        arrives: f64,
        given_up: Arc<AtomicBool>,
    },
}

/// A plan, and whether it begins farther on along the old one.
#[derive(Debug, Clone)]
pub struct Found {
    pub plan: Box<Plan>,
    pub is_ahead: bool,
}

impl Drop for Search {
    fn drop(&mut self) {
        if let Self::Beside { given_up, .. } = self {
            given_up.store(true, Ordering::Relaxed);
        }
    }
}
