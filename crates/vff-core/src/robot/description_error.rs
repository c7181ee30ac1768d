//! What can be wrong with the description of an arm.

use super::inertia::Impossible;
use super::names;
use crate::math::rotation::UNIT_TOLERANCE;

/// One fault of a description: where, and what.
///
/// # Example
/// ```
/// use vff_core::robot::description::{ArmDescription, DescriptionError};
///
/// let DescriptionError { path, problem } = ArmDescription::default().build().unwrap_err();
/// assert_eq!(path, "joints");
/// assert_eq!(problem.to_string(), "must be at least one joint, got none");
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{path}: {problem}")]
pub struct DescriptionError {
    /// Dotted path of the value, e.g. `joints[2].axis`.
    pub path: String,
    /// What is wrong there.
    pub problem: DescriptionProblem,
}

/// What is wrong with a value of a description.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DescriptionProblem {
    /// An axis or quaternion of another length than 1.
    #[error("must have length 1 (within {UNIT_TOLERANCE}), has {0}")]
    NotUnit(f64),
    /// Infinite or not a number.
    #[error("must be finite, got {0}")]
    NotFinite(f64),
    /// A number out of its range.
    #[error("must be {requirement}, got {given}")]
    OutOfRange {
        /// What would be right.
        requirement: &'static str,
        /// What was given.
        given: String,
    },
    /// A list of another length.
    #[error("expected {expected} values, one per joint, got {given}")]
    WrongLength {
        /// How many there should be.
        expected: usize,
        /// How many there are.
        given: usize,
    },
    /// Two joints or links of the same name.
    #[error("`{0}` is there twice")]
    Twice(String),
    /// A link that does not exist.
    #[error("there is no link `{given}`{}", names::hint(given, known))]
    UnknownLink {
        /// The name.
        given: String,
        /// The names that exist.
        known: Vec<String>,
    },
    /// A continuous joint with an end.
    #[error("`{0}` is continuous and has no limits: a joint with limits is revolute")]
    ContinuousLimit(String),
    /// A value of a shape.
    #[error("must be {requirement}{}", .given.as_ref().map_or_else(String::new, |given| format!(", got {given}")))]
    Shape {
        /// What would be right.
        requirement: String,
        /// What was given; none where the requirement says so.
        given: Option<String>,
    },
    /// An inertia tensor that no mass distribution has.
    #[error("{0}")]
    Inertia(Impossible),
    /// The last link cannot be accelerated by its joint alone.
    #[error(
        "`{0}`, the last link, has no inertia about its joint: give it a moment of inertia, an \
         armature, or a centre of mass off the axis"
    )]
    NoInertia(String),
}

pub(super) type Checked = Result<(), DescriptionError>;

pub(super) fn fault(path: impl Into<String>, problem: DescriptionProblem) -> DescriptionError {
    DescriptionError { path: path.into(), problem }
}

pub(super) fn finite(path: &str, values: &[f64]) -> Checked {
    match values.iter().find(|x| !x.is_finite()) {
        Some(&x) => Err(fault(path, DescriptionProblem::NotFinite(x))),
        None => Ok(()),
    }
}

pub(super) fn require(path: &str, value: f64, requirement: &'static str, holds: bool) -> Checked {
    if holds {
        return Ok(());
    }
    let given = format!("{value:?}").replace("NaN", "nan");
    Err(fault(path, DescriptionProblem::OutOfRange { requirement, given }))
}

/// Normalises what is nearly of length 1.
pub(super) fn unit<const N: usize>(values: &mut [f64; N]) -> Result<(), DescriptionProblem> {
    if let Some(&x) = values.iter().find(|x| !x.is_finite()) {
        return Err(DescriptionProblem::NotFinite(x));
    }
    let norm = values.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > UNIT_TOLERANCE {
        return Err(DescriptionProblem::NotUnit(norm));
    }
    if (norm - 1.0).abs() > 4.0 * f64::EPSILON {
        values.iter_mut().for_each(|x| *x /= norm);
    }
    Ok(())
}
