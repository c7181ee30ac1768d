//! Tests of what several layers do together.

mod law_in_space;
mod programs;
mod replanning;
mod tracking;
