//! One number for all, or one each.

use serde::de::{Deserializer, Error, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};
use std::fmt;

/// A setting per axis, joint or link that may be given once for all of them.
///
/// # Example
/// ```
/// use vff_core::math::ScalarOrVec;
///
/// assert_eq!(ScalarOrVec::Uniform(2.0).get(5), 2.0);
/// assert_eq!(ScalarOrVec::Each(vec![1.0, 3.0]).get(1), 3.0);
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ScalarOrVec {
    /// The same everywhere.
    Uniform(f64),
    /// One each.
    Each(Vec<f64>),
}

impl ScalarOrVec {
    /// The numbers as they were given.
    pub fn values(&self) -> &[f64] {
        match self {
            Self::Uniform(value) => std::slice::from_ref(value),
            Self::Each(values) => values,
        }
    }

    /// The `i`-th number.
    pub fn get(&self, i: usize) -> f64 {
        match self {
            Self::Uniform(value) => *value,
            Self::Each(values) => values[i],
        }
    }
}

impl<'de> Deserialize<'de> for ScalarOrVec {
    fn deserialize<T: Deserializer<'de>>(deserializer: T) -> Result<Self, T::Error> {
        struct Numbers;
        impl<'de> Visitor<'de> for Numbers {
            type Value = ScalarOrVec;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number or a list of numbers")
            }
            fn visit_f64<E: Error>(self, value: f64) -> Result<ScalarOrVec, E> {
                Ok(ScalarOrVec::Uniform(value))
            }
            #[expect(clippy::cast_precision_loss, reason = "as TOML writes 5 for 5.0")]
            fn visit_i64<E: Error>(self, value: i64) -> Result<ScalarOrVec, E> {
                Ok(ScalarOrVec::Uniform(value as f64))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<ScalarOrVec, A::Error> {
                let mut values = Vec::new();
                while let Some(value) = seq.next_element()? {
                    values.push(value);
                }
                Ok(ScalarOrVec::Each(values))
            }
        }
        deserializer.deserialize_any(Numbers)
    }
}
