//! A search for another plan, while the old one is followed.

use super::super::motion::Plan;
use super::braking::Braking;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError};

/// A search under way.
#[derive(Debug)]
pub enum Search {
    /// Done, but as if it lasted until `arrives` \[s\].
    Simulated { found: Option<Found>, arrives: f64 },
    /// In another thread, which gives it up. One that begins where the old plan is at `arrives` \[s\] is not taken before.
    Beside {
        answer: Receiver<Found>,
        found: Option<Found>,
        arrives: f64,
        given_up: Arc<AtomicBool>,
    },
}

impl Search {
    /// What it has come to by the time `t` \[s\], which may be nothing; None where it is not there yet.
    pub fn take(&mut self, t: f64) -> Option<Option<Found>> {
        match self {
            Self::Simulated { arrives, .. } if t < *arrives => None,
            Self::Simulated { found, .. } => Some(found.take()),
            Self::Beside { answer, found, arrives, .. } => {
                if found.is_none() {
                    match answer.try_recv() {
                        Err(TryRecvError::Empty) => return None,
                        answer => *found = answer.ok(),
                    }
                }
                if found.as_ref().is_some_and(|found| found.is_ahead && t < *arrives) {
                    return None;
                }
                Some(found.take())
            }
        }
    }
}

/// A plan, whether it begins farther on along the old one, and how the arm stops there, if it has to.
#[derive(Debug, Clone)]
pub struct Found {
    pub plan: Box<Plan>,
    pub is_ahead: bool,
    pub braking: Option<Braking>,
}

impl Drop for Search {
    fn drop(&mut self) {
        if let Self::Beside { given_up, .. } = self {
            given_up.store(true, Ordering::Relaxed);
        }
    }
}
