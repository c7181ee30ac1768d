//! From a TOML value to serde types, with errors that know where they are.
//!
//! serde's derived code says what is wrong; every container on the way out adds where. Enums are
//! tables with a `kind`, so that a document reads `shape = { kind = "circle", radius = 0.3 }`.

use super::error::{Problem, ScenarioError};
use crate::interrupt;
use serde::de::value::StrDeserializer;
use serde::de::{
    self, DeserializeSeed, Deserializer, Error, Expected, IntoDeserializer, Unexpected,
};
use serde::forward_to_deserialize_any;
use std::fmt;
use toml::{Table, Value};

/// The key that selects the variant of an enum.
const TAG: &str = "kind";

/// Reads a `T` from a document.
///
/// # Errors
/// With the dotted path of the first value that does not fit.
pub fn read<'de, T: de::Deserialize<'de>>(document: &'de Table) -> Result<T, ScenarioError> {
    T::deserialize(Node::Table(document))
}

/// Reads a `T` from a value of a document.
///
/// # Errors
/// As [`read`].
pub fn read_value<'de, T: de::Deserialize<'de>>(value: &'de Value) -> Result<T, ScenarioError> {
    T::deserialize(Node::from(value))
}

impl Error for ScenarioError {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::new("", Problem::Other(message.to_string()))
    }

    fn invalid_type(given: Unexpected<'_>, expected: &dyn Expected) -> Self {
        let problem = Problem::WrongType {
            expected: in_words(&expected.to_string()),
            given: given.to_string(),
        };
        Self::new("", problem)
    }

    fn invalid_value(given: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::invalid_type(given, expected)
    }

    fn invalid_length(length: usize, expected: &dyn Expected) -> Self {
        let problem = Problem::WrongType {
            expected: expected.to_string(),
            given: format!("{length} values"),
        };
        Self::new("", problem)
    }

    fn unknown_variant(given: &str, allowed: &'static [&'static str]) -> Self {
        let allowed = allowed.iter().map(ToString::to_string).collect();
        Self::new("", Problem::UnknownChoice { given: given.into(), allowed })
    }

    fn unknown_field(key: &str, allowed: &'static [&'static str]) -> Self {
        let allowed = allowed.iter().map(ToString::to_string).collect();
        Self::new("", Problem::UnknownKey { key: key.into(), allowed })
    }

    fn missing_field(key: &'static str) -> Self {
        Self::new("", Problem::MissingKey(key.into()))
    }
}

/// Rust's type names as a user would say them.
fn in_words(expected: &str) -> String {
    match expected {
        "f64" => "a number".into(),
        "usize" | "u64" => "a whole number, 0 or more".into(),
        "a sequence" => "a list".into(),
        other if other.starts_with("struct ") || other.starts_with("struct variant ") => {
            "a table".into()
        }
        other => other.into(),
    }
}

/// A value of the document, or all of it.
#[derive(Clone, Copy)]
enum Node<'de> {
    Table(&'de Table),
    Other(&'de Value),
}

impl<'de> From<&'de Value> for Node<'de> {
    fn from(value: &'de Value) -> Self {
        match value {
            Value::Table(table) => Self::Table(table),
            other => Self::Other(other),
        }
    }
}

impl<'de> Deserializer<'de> for Node<'de> {
    type Error = ScenarioError;

    fn deserialize_any<V: de::Visitor<'de>>(self, visitor: V) -> Result<V::Value, ScenarioError> {
        let value = match self {
            Self::Table(table) => return visitor.visit_map(Entries::new(table, None)),
            Self::Other(value) => value,
        };
        match value {
            Value::String(text) => visitor.visit_borrowed_str(text),
            Value::Integer(number) => visitor.visit_i64(*number),
            Value::Float(number) => visitor.visit_f64(*number),
            Value::Boolean(flag) => visitor.visit_bool(*flag),
            Value::Datetime(_) => Err(Error::invalid_type(Unexpected::Other("a date"), &visitor)),
            Value::Array(values) => {
                let mut items = Items { values: values.iter().enumerate() };
                let read = visitor.visit_seq(&mut items)?;
                match items.values.len() {
                    0 => Ok(read),
                    _ => Err(Error::custom(format_args!(
                        "expected fewer values, got {}",
                        values.len()
                    ))),
                }
            }
            Value::Table(table) => visitor.visit_map(Entries::new(table, None)),
        }
    }

    fn deserialize_tuple<V: de::Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, ScenarioError> {
        match self {
            Self::Other(Value::Array(values)) if values.len() != length => {
                let problem = Problem::WrongLength { expected: length, given: values.len() };
                Err(ScenarioError::new("", problem))
            }
            Self::Other(Value::Array(_)) => self.deserialize_any(visitor),
            _ => self.deserialize_any(ExpectedValues(length, visitor)),
        }
    }

    /// A list is no table, though serde's derived code would take its values for the fields in turn.
    fn deserialize_struct<V: de::Visitor<'de>>(
        self,
        _name: &'static str,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ScenarioError> {
        match self {
            Self::Other(Value::Array(_)) => {
                Err(Error::invalid_type(Unexpected::Other("a list"), &visitor))
            }
            _ => self.deserialize_any(visitor),
        }
    }

    fn deserialize_option<V: de::Visitor<'de>>(
        self,
        visitor: V,
    ) -> Result<V::Value, ScenarioError> {
        visitor.visit_some(self)
    }

    fn deserialize_enum<V: de::Visitor<'de>>(
        self,
        _name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ScenarioError> {
        match self {
            Self::Other(Value::String(name)) => {
                visitor.visit_enum(name.as_str().into_deserializer())
            }
            Self::Table(table) => match table.get(TAG) {
                Some(Value::String(kind)) => visitor.visit_enum(Variant { kind, table }),
                Some(_) => {
                    let given = Unexpected::Other("another type");
                    Err(ScenarioError::invalid_type(given, &"a name").inside(TAG))
                }
                None => Err(ScenarioError::new(
                    "",
                    Problem::Other(format!("missing key `{TAG}`, one of {}", variants.join(", "))),
                )),
            },
            _ => {
                let expected = format!("one of {}", variants.join(", "));
                self.deserialize_any(ExpectedWords(expected, visitor))
            }
        }
    }

    fn deserialize_newtype_struct<V: de::Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, ScenarioError> {
        visitor.visit_newtype_struct(self)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit
        unit_struct seq tuple_struct map identifier ignored_any
    }
}

/// Lets a scalar where a list of known length belongs be refused in words.
struct ExpectedValues<V>(usize, V);

impl<'de, V: de::Visitor<'de>> de::Visitor<'de> for ExpectedValues<V> {
    type Value = V::Value;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of {} values", self.0)
    }
}

/// Refuses any scalar, saying what was expected.
struct ExpectedWords<V>(String, V);

impl<'de, V: de::Visitor<'de>> de::Visitor<'de> for ExpectedWords<V> {
    type Value = V::Value;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The values of a list.
struct Items<'de> {
    values: std::iter::Enumerate<std::slice::Iter<'de, Value>>,
}

impl<'de> de::SeqAccess<'de> for &mut Items<'de> {
    type Error = ScenarioError;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, ScenarioError> {
        let Some((index, value)) = self.values.next() else { return Ok(None) };
        interrupt::checkpoint(512);
        seed.deserialize(Node::from(value))
            .map(Some)
            .map_err(|error| error.inside(&format!("[{index}]")))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.values.len())
    }
}

/// The entries of a table, without its tag.
struct Entries<'de> {
    entries: toml::map::Iter<'de, String, Value>,
    skip: Option<&'static str>,
    pending: Option<(&'de str, &'de Value)>,
}

impl<'de> Entries<'de> {
    fn new(table: &'de Table, skip: Option<&'static str>) -> Self {
        Self { entries: table.iter(), skip, pending: None }
    }
}

impl<'de> de::MapAccess<'de> for Entries<'de> {
    type Error = ScenarioError;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, ScenarioError> {
        let next = self.entries.find(|(key, _)| Some(key.as_str()) != self.skip);
        let Some((key, value)) = next else { return Ok(None) };
        self.pending = Some((key, value));
        seed.deserialize(StrDeserializer::<ScenarioError>::new(key)).map(Some)
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<T::Value, ScenarioError> {
        let Some((key, value)) = self.pending.take() else {
            return Err(Error::custom("a value was asked for before its key"));
        };
        seed.deserialize(Node::from(value)).map_err(|error| error.inside(key))
    }
}

/// A table whose tag names a variant.
struct Variant<'de> {
    kind: &'de str,
    table: &'de Table,
}

impl<'de> de::EnumAccess<'de> for Variant<'de> {
    type Error = ScenarioError;
    type Variant = Self;

    fn variant_seed<T: DeserializeSeed<'de>>(
        self,
        seed: T,
    ) -> Result<(T::Value, Self), ScenarioError> {
        let name = StrDeserializer::<ScenarioError>::new(self.kind);
        seed.deserialize(name).map(|value| (value, self)).map_err(|error| error.inside(TAG))
    }
}

impl<'de> de::VariantAccess<'de> for Variant<'de> {
    type Error = ScenarioError;

    fn unit_variant(self) -> Result<(), ScenarioError> {
        match self.table.keys().find(|key| *key != TAG) {
            None => Ok(()),
            Some(key) => Err(Error::unknown_field(key, &[])),
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(
        self,
        _seed: T,
    ) -> Result<T::Value, ScenarioError> {
        Err(Error::custom("no variant of a scenario is a bare value"))
    }

    fn tuple_variant<V: de::Visitor<'de>>(
        self,
        _length: usize,
        _visitor: V,
    ) -> Result<V::Value, ScenarioError> {
        Err(Error::custom("no variant of a scenario is a tuple"))
    }

    fn struct_variant<V: de::Visitor<'de>>(
        self,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ScenarioError> {
        visitor.visit_map(Entries::new(self.table, Some(TAG)))
    }
}
