//! What can be wrong with a shape.

use crate::settings::{POSITIVE, Requirement};
use std::fmt;

/// The first value of a shape that is wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ShapeFault {
    /// Its key, with an index if it is one of a list.
    pub key: String,
    /// What it must be.
    pub requirement: String,
    /// What it is; none where the requirement says so.
    pub given: Option<String>,
}

impl ShapeFault {
    /// A value that is not what is required.
    pub(super) fn new(key: &str, requirement: String, given: impl fmt::Debug) -> Self {
        let given = Some(format!("{given:?}").replace("NaN", "nan"));
        Self { key: key.into(), requirement, given }
    }

    /// A value whose fault the requirement tells.
    pub(super) fn told(key: &str, requirement: String) -> Self {
        Self { key: key.into(), requirement, given: None }
    }

    /// None where a number is what is required.
    pub(super) fn unless(key: &str, value: f64, requirement: &Requirement) -> Result<(), Self> {
        match (requirement.holds)(value) {
            true => Ok(()),
            false => Err(Self::new(key, requirement.words.into(), value)),
        }
    }

    /// None where two ends are two.
    pub(super) fn of_ends<const D: usize>(a: &[f64; D], b: &[f64; D]) -> Result<(), Self> {
        if a.iter().zip(b).all(|(a, b)| a - b == 0.0) {
            Err(Self::new("b", "another point than a".into(), b))
        } else {
            Ok(())
        }
    }

    /// None where all edges have a length.
    pub(super) fn of_size<const D: usize>(size: &[f64; D]) -> Result<(), Self> {
        let mut lengths = size.iter().enumerate();
        lengths.try_for_each(|(axis, x)| Self::unless(&format!("size[{axis}]"), *x, &POSITIVE))
    }
}
