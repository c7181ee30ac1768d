//! The core as its users see it. `cargo test` runs it within the program of the unit tests, as every program compiles the core's
//! generic code anew; clippy compiles it as a program of its own, which sees what is public. What counts allocations is
//! another program, for it has an allocator of its own.

mod another_robot;
mod architecture;
mod clocks;
mod examples;
mod followed;
mod fuzz_scenarios;
mod governor;
mod loops;
mod needed_points;
mod output;
mod perceiver;
mod placed_obstacles;
mod quadratic_program;
mod spatial_scenarios;
