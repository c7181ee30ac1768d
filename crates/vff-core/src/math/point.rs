//! Points as they are written in documents: lists of as many numbers as the space has dimensions.

use serde::de::{Deserialize, Deserializer, Error, SeqAccess, Visitor};
use std::fmt;

/// Coordinates that are read from a list of exactly `D` numbers. serde reads `[f64; 2]`, but not
/// `[f64; D]`.
///
/// # Example
/// ```
/// use serde::{Deserialize, de::value::{Error, SeqDeserializer}};
/// use vff_core::math::Point;
///
/// let Point(coordinates) = Point::<2>::deserialize(SeqDeserializer::<_, Error>::new([1.0, 2.0].into_iter())).unwrap();
/// assert_eq!(coordinates, [1.0, 2.0]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point<const D: usize>(pub [f64; D]);

impl<'de, const D: usize> Deserialize<'de> for Point<D> {
    fn deserialize<T: Deserializer<'de>>(deserializer: T) -> Result<Self, T::Error> {
        struct Coordinates<const D: usize>;
        impl<'de, const D: usize> Visitor<'de> for Coordinates<D> {
            type Value = Point<D>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "an array of length {D}")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Point<D>, A::Error> {
                let mut point = [0.0; D];
                for (i, coordinate) in point.iter_mut().enumerate() {
                    let next = list.next_element()?;
                    *coordinate = next.ok_or_else(|| Error::invalid_length(i, &self))?;
                }
                Ok(Point(point))
            }
        }
        deserializer.deserialize_tuple(D, Coordinates)
    }
}

impl<const D: usize> Point<D> {
    /// For `#[serde(deserialize_with)]` on a field of type `[f64; D]`.
    ///
    /// # Errors
    /// If it is not a list of `D` numbers.
    pub fn read<'de, T: Deserializer<'de>>(deserializer: T) -> Result<[f64; D], T::Error> {
        Self::deserialize(deserializer).map(|point| point.0)
    }

    /// For `#[serde(deserialize_with)]` on a field of type `Vec<[f64; D]>`.
    ///
    /// # Errors
    /// If it is not a list of lists of `D` numbers.
    pub fn read_list<'de, T: Deserializer<'de>>(
        deserializer: T,
    ) -> Result<Vec<[f64; D]>, T::Error> {
        Vec::<Self>::deserialize(deserializer)
            .map(|points| points.into_iter().map(|point| point.0).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use toml::Value;

    fn error<T: serde::de::DeserializeOwned + fmt::Debug>(value: &Value) -> String {
        value.clone().try_into::<T>().unwrap_err().to_string()
    }

    properties! {
        /// What serde reads as an array is read alike, and what it refuses is refused with the same words.
        #[test]
        fn as_serde_reads_arrays(numbers in prop::collection::vec(-1e3..1e3, 0..6)) {
            let list = Value::from(numbers.clone());
            match list.clone().try_into::<[f64; 3]>() {
                Ok(expected) => {
                    let read = list.try_into::<Point<3>>().unwrap().0;
                    prop_assert_eq!(read.map(f64::to_bits), expected.map(f64::to_bits));
                }
                Err(expected) => prop_assert_eq!(error::<Point<3>>(&list), expected.to_string()),
            }
        }
    }

    #[test]
    fn what_is_no_point() {
        let wrong = ["x = 1", "x = 'here'", "x = [1, 'two']", "x = [[1], [2]]", "x = {}"];
        for text in wrong {
            let value = text.parse::<toml::Table>().unwrap()["x"].clone();
            assert_eq!(error::<Point<2>>(&value), error::<[f64; 2]>(&value), "{text}");
        }
    }
}
