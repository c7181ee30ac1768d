//! What a serde type may be read from, found out by reading it.
//!
//! Notes answer whatever a type asks for. One pass sees one variant of every enum and finds out of one key at most
//! whether it may be missing; [`trace`] makes as many passes as that takes.

use crate::scenario::document;
use crate::scenario::error::{Problem, ScenarioError};
use crate::scenario::notes::{Kind, Note};
use serde::de::{DeserializeOwned, Error};
use std::cell::Cell;

/// More passes than any type needs.
const MAX_PASSES: usize = 100_000;

/// What a `T` may be read from.
///
/// # Errors
/// If the type cannot be traced.
pub fn trace<T: DeserializeOwned>() -> Result<Kind, ScenarioError> {
    let mut kind = Kind::Unknown;
    for _ in 0..MAX_PASSES {
        let untested = Cell::new(true);
        let missing = match document::ask::<T>(Note::of(&mut kind, &untested)) {
            Ok(_) => false,
            Err(ScenarioError { problem: Problem::MissingKey(_), .. }) => true,
            Err(other) => return Err(other),
        };
        if !kind.conclude(missing) {
            return Ok(kind);
        }
    }
    Err(Error::custom("more variants than expected"))
}
