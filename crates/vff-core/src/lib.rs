//! Torque-level obstacle avoidance for redundant robot arms.
//!
//! Virtual force fields push every link away from moving obstacles; the push acts through a
//! dynamically consistent null-space projection, so the end effector feels nothing of it.
//!
//! From arm, world and controller to torque:
//!
//! ```
//! use std::sync::Arc;
//! use vff_core::control::{Controller, Gains, Settings};
//! use vff_core::field::{Field, FieldKind};
//! use vff_core::math::Vector;
//! use vff_core::robot::{Model, PlanarArm, planar::Link};
//! use vff_core::trajectory::Sample;
//! use vff_core::world::{Motion, plane::{Obstacle, Shape, World}};
//!
//! let arm = Arc::new(PlanarArm::new(vec![Link::rod(0.5, 2.0); 4], Vector::<2>::new(0.0, -9.81)));
//! let field = Field { kind: FieldKind::Khatib, gain: 0.1, influence: 0.4, ..Field::OFF };
//! let gains = Gains::new(&Settings { field, ..Settings::default() });
//! let mut controller = Controller::<_, 2, 2>::new(arm.state(), gains);
//!
//! let shape = Shape::Circle { radius: 0.1 };
//! let motion = Motion::Linear { velocity: [-0.2, 0.0] };
//! let mut world = World::new(vec![Obstacle { position: [0.9, 0.6], motion, ..Obstacle::of(shape) }]);
//!
//! // Once in every control period, with the time, the state (q, q̇) and the reference:
//! world.update(0.001);
//! controller.observe(&[0.4, 0.5, -0.6, 0.3], &[0.0; 4], &mut world);
//! let hold = Sample::at_rest(controller.pose());
//! let torque = &controller.command(&hold).total;
//! assert!(torque.len() == 4 && torque.iter().all(|tau| tau.is_finite()));
//! ```
//!
//! The same with an arm in space is the example of [`control::Controller`].
//!
//! The closed loop of such a controller and a simulated plant is [`simulation::ClosedLoop`]. A scenario describes one
//! as text:
//!
//! ```
//! # #[cfg(feature = "scenario")]
//! # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
//! use vff_core::{scenario::Scenario, simulation::Status};
//!
//! let scenario = Scenario::from_toml(
//!     r#"
//!     duration = 0.5
//!     q0 = [0.4, 0.5, -0.6]
//!     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
//!     reference = { kind = "setpoint", point = [1.2, 0.5] }
//!     "#,
//! )?;
//! let mut run = scenario.prepare()?.run;
//! while run.step() {}
//! let outcome = run.outcome();
//! assert_eq!(outcome.status, Status::Completed);
//! assert_eq!(outcome.record.q.len(), 3 * outcome.record.rows);
//! # Ok(())
//! # }
//! # #[cfg(not(feature = "scenario"))]
//! # fn main() {}
//! ```
//!
//! # Features
//!
//! All are on by default. A controller on a robot needs none of them: with `default-features = false` what remains is
//! arms, worlds, fields, trajectories, controllers and the closed loop in simulated time. The settings can be read by
//! serde from any format in either case, but nothing validates them without `scenario`.
//!
//! | feature | modules | dependencies |
//! |---|---|---|
//! | `scenario` | `scenario`, `runtime`, `planning` | toml, strsim, serde_json |
//! | `parallel` | `runtime::batch`, `runtime::vector` | rayon |
//! | `models` | `robot::models`, `robot::urdf` | roxmltree, strsim, toml |
//! | `realtime` | `runtime::{drive, live, real_time}`, `simulation::pace` | hdrhistogram |
//!
//! Arrows run one way: `runtime → planning → scenario → simulation → control → {field, robot, world, trajectory} → geometry → {math, settings}`.
#![forbid(unsafe_code)]

#[cfg(test)]
#[macro_use]
mod properties; // before what uses its macro

pub mod control;
pub mod field;
pub mod geometry;
pub mod interrupt;
pub mod inverse_kinematics;
pub mod math;
pub mod perception;
pub mod planned_reference;
#[cfg(feature = "scenario")]
pub mod planning;
pub mod robot;
#[cfg(feature = "scenario")]
pub mod runtime;
#[cfg(feature = "scenario")]
pub mod scenario;
pub mod settings;
pub mod simulation;
#[cfg(test)]
extern crate self as vff_core; // what the tests beside `src` call it
#[cfg(all(test, feature = "realtime"))]
#[path = "../tests/all.rs"]
mod outside;
#[cfg(test)]
mod testing;
#[cfg(all(test, feature = "scenario"))]
mod tests;
pub mod trajectory;
pub mod world;
