//! The C interface: `vffnull.h`.
//!
//! Whatever crosses the interface is checked here: pointers, lengths, numbers, the order of calls. What is behind it is
//! [`vff_core::runtime::AnyController`]. This crate alone has `unsafe` code, and no mathematics.
//!
//! | file | what |
//! |---|---|
//! | `ffi_guard` | every call: no panic leaves, a fault becomes a status and a message |
//! | `status` | what can be wrong |
//! | `robot`, `kinematics`, `controller`, `cycle`, `succession`, `set_points`, `terms`, `obstacles`, `cloud`, `perceiver` | the functions |
//! | `mailbox` | one value handed from one thread to another without a lock |

// Names and documentation are those of the C header.
#![allow(clippy::missing_safety_doc, reason = "said once in the header: pointers as C has them")]

mod cloud;
mod controller;
mod cycle;
mod ffi_guard;
mod kinematics;
mod mailbox;
mod obstacles;
mod perceiver;
mod robot;
mod set_points;
mod status;
mod succession;
mod terms;
mod version;

pub use cloud::*;
pub use controller::*;
pub use cycle::*;
pub use ffi_guard::vff_last_message;
pub use kinematics::*;
pub use obstacles::*;
pub use perceiver::*;
pub use robot::*;
pub use set_points::*;
pub use status::{Status, vff_status_name};
pub use succession::*;
pub use terms::*;
pub use version::*;
