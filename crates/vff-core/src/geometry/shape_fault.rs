//! What can be wrong with a shape.

use crate::settings::{FINITE, POSITIVE, Requirement};
use std::fmt;

/// The first value of a shape that is wrong.
///
/// # Example
/// ```
/// use vff_core::geometry::{Shape, ShapeFault};
///
/// let ShapeFault { key, requirement, given } = Shape::Sphere { radius: 0.0 }.check().unwrap_err();
/// assert_eq!((key.as_str(), requirement.as_str()), ("radius", "greater than 0"));
/// assert_eq!(given.as_deref(), Some("0.0"));
/// ```
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
    pub(crate) fn new(key: &str, requirement: String, given: impl fmt::Debug) -> Self {
        let given = Some(format!("{given:?}").replace("NaN", "nan"));
        Self { key: key.into(), requirement, given }
    }

    /// A value whose fault the requirement tells.
    pub(crate) fn stated(key: &str, requirement: String) -> Self {
        Self { key: key.into(), requirement, given: None }
    }

    /// None where a number is finite and what is required.
    fn unless(key: &str, value: f64, requirement: &Requirement) -> Result<(), Self> {
        match [requirement, &FINITE].into_iter().find(|needed| !(needed.holds)(value)) {
            None => Ok(()),
            Some(missed) => Err(Self::new(key, missed.words.into(), value)),
        }
    }

    /// None where all numbers are finite.
    pub(crate) fn of_numbers(key: &str, values: &[f64]) -> Result<(), Self> {
        values.iter().try_for_each(|value| Self::unless(key, *value, &FINITE))
    }

    /// None where a radius is what is required.
    pub(crate) fn of_radius(radius: f64, requirement: &Requirement) -> Result<(), Self> {
        Self::unless("radius", radius, requirement)
    }

    /// None where two ends are two.
    pub(crate) fn of_ends<const D: usize>(a: &[f64; D], b: &[f64; D]) -> Result<(), Self> {
        if a.iter().zip(b).all(|(a, b)| a - b == 0.0) {
            Err(Self::new("b", "another point than a".into(), b))
        } else {
            Ok(())
        }
    }

    /// None where all edges have a length.
    pub(crate) fn of_size<const D: usize>(size: &[f64; D]) -> Result<(), Self> {
        let mut lengths = size.iter().enumerate();
        lengths.try_for_each(|(axis, x)| Self::unless(&format!("size[{axis}]"), *x, &POSITIVE))
    }
}
