//! Requirements on numbers and lists, and what is said where they do not hold.

use super::error::{Problem, ScenarioError};
use crate::math::ScalarOrVec;

/// A requirement on a number, in words and as a test.
pub(crate) type Requirement = (&'static str, fn(f64) -> bool);

/// Lengths, masses and the like.
#[expect(non_upper_case_globals, reason = "reads as a word where it is used")]
pub(crate) const positive: Requirement = ("greater than 0", |x| x > 0.0);
/// Gains, radii and the like.
#[expect(non_upper_case_globals, reason = "reads as a word where it is used")]
pub(crate) const not_negative: Requirement = ("0 or more", |x| x >= 0.0);

/// Validates a number.
pub(crate) fn number(
    path: &str,
    value: f64,
    (words, test): Requirement,
) -> Result<(), ScenarioError> {
    if test(value) { Ok(()) } else { Err(ScenarioError::out_of_range(path, words, value)) }
}

/// Validates the length of a list.
pub(crate) fn length(path: &str, given: usize, expected: usize) -> Result<(), ScenarioError> {
    if given == expected {
        return Ok(());
    }
    Err(ScenarioError::new(path, Problem::WrongLength { expected, given }))
}

/// Validates one number for all, or `n` of them.
pub(crate) fn each(
    path: &str,
    given: &ScalarOrVec,
    n: usize,
    requirement: Requirement,
) -> Result<(), ScenarioError> {
    match given {
        ScalarOrVec::Uniform(value) => number(path, *value, requirement),
        ScalarOrVec::Each(values) => {
            length(path, values.len(), n)?;
            values
                .iter()
                .enumerate()
                .try_for_each(|(i, value)| number(&format!("{path}[{i}]"), *value, requirement))
        }
    }
}
