//! URDF text to the explicit description of an arm.
//!
//! [`parse`](parse::parse) makes a [`Tree`] of links and joints out of the text, [`Tree::reduce`] the
//! serial chain from a base to a tip: fixed joints and joints off the chain become rigid, and what
//! they carry becomes part of the link that carries it. Readers of other formats make a [`Tree`] of
//! their own and share the rest.

mod chain;
mod error;
mod index;
mod parse;
mod role;
mod srdf;
mod tree;
mod units;

pub use chain::{LinkGeometry, Options, Reading};
pub use error::{UrdfError, Xml};
pub use parse::parse;
pub use srdf::disabled_pairs;
pub use tree::{Form, Geometry, Kind, Link, Mimic, Tree, TreeJoint};

/// The longest text that is read \[bytes\]; the largest published robots have 200 kB.
pub const MAX_BYTES: usize = 16 << 20;

/// Reads URDF.
///
/// # Errors
/// [`UrdfError`] for text that is no URDF, and for robots that are no arm from base to tip.
pub fn read(text: &str, options: &Options) -> Result<Reading, UrdfError> {
    parse(text)?.reduce(options)
}

#[cfg(test)]
mod tests;
