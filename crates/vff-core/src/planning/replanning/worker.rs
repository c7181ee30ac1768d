//! A thread that searches while a loop goes on. It begins when the watch is set up, not in the loop: a thread that a loop begins would
//! have the loop's priority and its core, and keep it waiting.

use std::sync::mpsc::{Sender, channel};
use std::thread;

type Work = Box<dyn FnOnce() + Send>;

/// Does one piece of work after the other, and ends when it is dropped.
#[derive(Debug, Clone)]
pub(super) struct Worker(Sender<Work>);

impl Worker {
    /// Begins the thread.
    pub fn new() -> Self {
        let (sender, work) = channel::<Work>();
        thread::spawn(move || work.into_iter().for_each(|work| work()));
        Self(sender)
    }

    /// Lets it do this, after what it is at; lost if it is gone.
    pub fn ask(&self, work: impl FnOnce() + Send + 'static) {
        let _ = self.0.send(Box::new(work));
    }
}
