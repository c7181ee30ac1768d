//! Requirements on numbers and lists, and what is said where they do not hold.

use super::error::{Problem, ScenarioError};
use crate::math::ScalarOrVec;
use crate::settings::{FINITE, Numbers, Requirement, Table};

/// No number is larger than this.
const LARGEST: f64 = 1e100;

/// Validates a number.
pub(crate) fn number(
    path: &str,
    value: f64,
    requirement: &Requirement,
) -> Result<(), ScenarioError> {
    match (requirement.holds)(value) {
        true => Ok(()),
        false => Err(ScenarioError::out_of_range(path, requirement.words, value)),
    }
}

/// Validates that a number is finite, and not so large that products of such numbers are not.
pub(crate) fn bounded(path: &str, value: f64) -> Result<(), ScenarioError> {
    number(path, value, &FINITE)?;
    if value.abs() > LARGEST {
        let requirement = format!("at most {LARGEST:e}");
        return Err(ScenarioError::out_of_range(path, &requirement, value));
    }
    Ok(())
}

/// Validates a count.
#[expect(clippy::cast_precision_loss, reason = "no requirement is about numbers that large")]
pub(crate) fn count(
    path: &str,
    value: usize,
    requirement: &Requirement,
) -> Result<(), ScenarioError> {
    match (requirement.holds)(value as f64) {
        true => Ok(()),
        false => Err(ScenarioError::out_of_range(path, requirement.words, value)),
    }
}

/// Validates the numbers of a table, those of a list as many as `length_of` its key, where that is known.
pub(crate) fn table(
    settings: &impl Table,
    length_of: impl Fn(&str) -> Option<usize>,
) -> Result<(), ScenarioError> {
    settings.check(|key, numbers, requirement| match numbers {
        Numbers::None => Ok(()),
        Numbers::One(value) => number(key, value, requirement),
        Numbers::Whole(value) => count(key, value, requirement),
        Numbers::Each(given) => {
            each(key, given, length_of(key).unwrap_or(given.values().len()), requirement)
        }
    })
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
    requirement: &Requirement,
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
