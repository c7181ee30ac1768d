//! Arms that people own, as explicit descriptions.
//!
//! Where the numbers come from stands at the top of each document; `docs/make_arms.py` makes them.

mod interface;

use super::description::{ArmDescription, DescriptionError};
use super::names::hint;
pub use interface::{Interface, interface, with_interface};
use toml::Table;

/// Text of every bundled arm, by name.
const TEXTS: [(&str, &str); 7] = [
    ("panda", include_str!("panda.toml")),
    ("fr3", include_str!("fr3.toml")),
    ("ur5e", include_str!("ur5e.toml")),
    ("ur10e", include_str!("ur10e.toml")),
    ("iiwa14", include_str!("iiwa14.toml")),
    ("gen3", include_str!("gen3.toml")),
    ("xarm7", include_str!("xarm7.toml")),
];

/// The names of the bundled arms.
pub const NAMES: [&str; TEXTS.len()] = {
    let mut names = [""; TEXTS.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = TEXTS[i].0;
        i += 1;
    }
    names
};

/// Why there is no such arm.
///
/// # Example
/// ```
/// use vff_core::robot::models::{ModelError, named};
///
/// let error = named("pander").unwrap_err();
/// assert!(matches!(error, ModelError::Unknown { .. }));
/// assert!(error.to_string().contains("panda"));
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// A name that no bundled arm has.
    #[error("there is no bundled arm `{name}`{}", hint(name, &NAMES.map(String::from)))]
    Unknown {
        /// The name.
        name: String,
    },
    /// A document that does not hold what it must.
    #[error("{0}")]
    Syntax(String),
    /// A value that makes no sense.
    #[error(transparent)]
    Description(#[from] DescriptionError),
}

/// The document of a bundled arm, with the sources of its numbers in comments.
///
/// # Errors
/// [`ModelError::Unknown`] with the names that exist.
pub fn text(name: &str) -> Result<&'static str, ModelError> {
    let found = TEXTS.iter().find(|(known, _)| *known == name);
    found.map(|(_, text)| *text).ok_or_else(|| ModelError::Unknown { name: name.into() })
}

/// A bundled arm.
///
/// # Errors
/// [`ModelError::Unknown`] with the names that exist.
///
/// ```
/// let arm = vff_core::robot::models::named("panda")?;
/// assert_eq!(arm.dof(), 7);
/// # Ok::<(), vff_core::robot::models::ModelError>(())
/// ```
pub fn named(name: &str) -> Result<ArmDescription, ModelError> {
    let table = text(name)?.parse().map_err(|error: toml::de::Error| syntax(&error))?;
    Ok(read(table)?.checked()?)
}

/// The arm of a document, as it is given.
///
/// # Errors
/// [`ModelError::Syntax`] where it does not hold what it must.
///
/// # Example
/// ```
/// use vff_core::robot::models;
///
/// let table = models::text("panda")?.parse().unwrap();
/// assert_eq!(models::read(table)?.dof(), 7);
/// # Ok::<(), models::ModelError>(())
/// ```
#[inline(never)] // it is large
pub fn read(table: Table) -> Result<ArmDescription, ModelError> {
    table.try_into().map_err(|error| syntax(&error))
}

fn syntax(error: &toml::de::Error) -> ModelError {
    ModelError::Syntax(error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bundled_arm_can_be_read() {
        for name in NAMES {
            let arm = named(name).unwrap_or_else(|fault| panic!("{name}: {fault}"));
            assert_eq!(arm.name.as_deref(), Some(name));
            assert!(arm.payload.is_some() && arm.reach.is_some(), "{name}");
            assert_eq!(arm.joint_limits.len(), arm.dof(), "{name}");
            assert_eq!(arm.velocity_limits.len(), arm.dof(), "{name}");
            assert_eq!(arm.torque_limits.len(), arm.dof(), "{name}");
            assert!(arm.collision.len() > arm.dof(), "{name}");
        }
    }

    #[test]
    fn a_mistyped_name_gets_a_hint() {
        let fault = named("pandas").unwrap_err().to_string();
        assert!(fault.contains("did you mean `panda`?") && fault.contains("`iiwa14`"), "{fault}");
    }
}
