//! The core as its users see it, in one program: each program compiles the core's generic code anew. What counts allocations
//! is another one, for it has an allocator of its own.

mod another_robot;
mod architecture;
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
