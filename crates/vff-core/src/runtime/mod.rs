//! Scenarios that run: one or many, against the clock, while people interact with them, or step by step for an
//! agent that learns.

pub mod any;
pub mod batch;
pub mod episode;
pub mod live;
pub mod real_time;
pub mod vector;

pub use any::{AnyRun, Ready};
