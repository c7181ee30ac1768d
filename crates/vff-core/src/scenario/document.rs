//! From a TOML value to serde types, with errors that know where they are.
//!
//! serde's derived code says what is wrong; every container on the way out adds where. Enums are
//! tables with a `kind`, so that a document reads `shape = { kind = "circle", radius = 0.3 }`.
//!
//! Whoever wants to know what a type asks for puts notes in the place of a document. It is the same deserializer because serde's
//! derived code is compiled anew for each.

use super::error::{Problem, ScenarioError};
use super::notes::{Answer, Keys, Kind, Note, Repeated};
use crate::interrupt;
use serde::de::value::{MapDeserializer, StrDeserializer};
use serde::de::{self, DeserializeSeed, Deserializer, Error, Expected, Unexpected};
use serde::forward_to_deserialize_any;
use std::sync::LazyLock;
use std::{fmt, iter, slice};
use toml::{Table, Value};

/// The key that selects the variant of an enum.
const TAG: &str = "kind";
/// What answers for a shape.
static SPHERE: LazyLock<Table> = LazyLock::new(|| {
    let [kind, radius] = [Value::String("sphere".into()), Value::Float(1.0)];
    [(TAG.into(), kind), ("radius".into(), radius)].into_iter().collect()
});

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

/// Reads a `T` from answers, and notes what it has asked for.
///
/// # Errors
/// If the type cannot be answered, or a key is missing that the notes have left out.
pub fn ask<T: de::DeserializeOwned>(note: Note<'_>) -> Result<T, ScenarioError> {
    T::deserialize(Node::Asked(note))
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
        "a map" => "a table".into(),
        other if other.starts_with("struct ") || other.starts_with("struct variant ") => {
            "a table".into()
        }
        other => other.into(),
    }
}

/// A value of the document, all of it, or notes in its place.
enum Node<'de, 'n> {
    Table(&'de Table),
    Other(&'de Value),
    Asked(Note<'n>),
}

impl<'de> From<&'de Value> for Node<'de, '_> {
    fn from(value: &'de Value) -> Self {
        match value {
            Value::Table(table) => Self::Table(table),
            other => Self::Other(other),
        }
    }
}

/// A scalar of one kind: of a document whatever is there, for the visitor to judge.
macro_rules! scalar {
    ($($deserialize:ident, $kind:ident => $visit:ident($value:expr);)*) => {$(
        fn $deserialize<V: de::Visitor<'de>>(self, visitor: V) -> Result<V::Value, ScenarioError> {
            match self {
                Self::Asked(note) => {
                    note.write(Kind::$kind);
                    visitor.$visit($value)
                }
                given => given.deserialize_any(visitor),
            }
        }
    )*};
}

impl<'de> Deserializer<'de> for Node<'de, '_> {
    type Error = ScenarioError;

    fn deserialize_any<V: de::Visitor<'de>>(self, visitor: V) -> Result<V::Value, ScenarioError> {
        let value = match self {
            Self::Table(table) => return visitor.visit_map(Entries::of(table, None)),
            Self::Other(value) => value,
            Self::Asked(note) => {
                let expected = (&visitor as &dyn Expected).to_string();
                return match note.any(&expected).map_err(ScenarioError::custom)? {
                    Answer::Sphere => visitor.visit_map(Entries::of(&SPHERE, None)),
                    Answer::Nothing => {
                        visitor.visit_map(MapDeserializer::new(iter::empty::<(&str, f64)>()))
                    }
                    Answer::Number => visitor.visit_f64(1.0),
                    Answer::List(values) => visitor.visit_seq(&mut Items::Asked(values)),
                };
            }
        };
        match value {
            Value::String(text) => visitor.visit_borrowed_str(text),
            Value::Integer(number) => visitor.visit_i64(*number),
            Value::Float(number) => visitor.visit_f64(*number),
            Value::Boolean(flag) => visitor.visit_bool(*flag),
            Value::Datetime(_) => Err(Error::invalid_type(Unexpected::Other("a date"), &visitor)),
            Value::Array(values) => {
                let mut items = Items::Of(values.iter().enumerate());
                let read = visitor.visit_seq(&mut items)?;
                match items.next_node() {
                    None => Ok(read),
                    Some(_) => Err(Error::custom(format_args!(
                        "expected fewer values, got {}",
                        values.len()
                    ))),
                }
            }
            Value::Table(table) => visitor.visit_map(Entries::of(table, None)),
        }
    }

    scalar! {
        deserialize_bool, Flag => visit_bool(true);
        deserialize_f64, Number => visit_f64(1.0);
        deserialize_u64, Whole => visit_u64(1);
        deserialize_str, Text => visit_borrowed_str("");
        deserialize_string, Text => visit_borrowed_str("");
    }

    fn deserialize_seq<V: de::Visitor<'de>>(self, visitor: V) -> Result<V::Value, ScenarioError> {
        match self {
            Self::Asked(note) => visitor.visit_seq(&mut Items::Asked(note.list(None))),
            given => given.deserialize_any(visitor),
        }
    }

    fn deserialize_tuple<V: de::Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, ScenarioError> {
        match self {
            Self::Asked(note) => visitor.visit_seq(&mut Items::Asked(note.list(Some(length)))),
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
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ScenarioError> {
        match self {
            Self::Other(Value::Array(_)) => {
                Err(Error::invalid_type(Unexpected::Other("a list"), &visitor))
            }
            Self::Asked(note) => visitor
                .visit_map(Entries::Asked(note.table(fields).map_err(ScenarioError::custom)?)),
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
                visitor.visit_enum(Variant { name, keys: VariantKeys::None })
            }
            Self::Table(table) => match table.get(TAG) {
                Some(Value::String(name)) => {
                    visitor.visit_enum(Variant { name, keys: VariantKeys::Of(table) })
                }
                Some(_) => {
                    let given = Unexpected::Other("another type");
                    Err(ScenarioError::invalid_type(given, &"a name").inside(TAG))
                }
                None => Err(ScenarioError::new(
                    "",
                    Problem::Other(format!("missing key `{TAG}`, one of {}", variants.join(", "))),
                )),
            },
            Self::Asked(note) => {
                let (name, note) = note.choose(variants).map_err(ScenarioError::custom)?;
                visitor.visit_enum(Variant { name, keys: VariantKeys::Asked(note) })
            }
            Self::Other(_) => {
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
        i8 i16 i32 i64 i128 u8 u16 u32 u128 f32 char bytes byte_buf unit
        unit_struct tuple_struct map identifier ignored_any
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
enum Items<'de, 'n> {
    Of(iter::Enumerate<slice::Iter<'de, Value>>),
    Asked(Repeated<'n>),
}

impl<'de> Items<'de, '_> {
    /// The next value, with its number.
    fn next_node(&mut self) -> Option<(usize, Node<'de, '_>)> {
        match self {
            Self::Of(values) => values.next().map(|(index, value)| (index, Node::from(value))),
            Self::Asked(values) => values.next_value().map(|note| (0, Node::Asked(note))),
        }
    }
}

impl<'de> de::SeqAccess<'de> for &mut Items<'de, '_> {
    type Error = ScenarioError;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, ScenarioError> {
        let Some((index, node)) = self.next_node() else { return Ok(None) };
        interrupt::checkpoint(512);
        seed.deserialize(node).map(Some).map_err(|error| error.inside(&format!("[{index}]")))
    }

    fn size_hint(&self) -> Option<usize> {
        match self {
            Items::Of(values) => Some(values.len()),
            Items::Asked(_) => None,
        }
    }
}

/// The entries of a table, without its tag.
enum Entries<'de, 'n> {
    Of {
        entries: toml::map::Iter<'de, String, Value>,
        skip: Option<&'static str>,
        pending: Option<(&'de str, &'de Value)>,
    },
    Asked(Keys<'n>),
}

impl<'de> Entries<'de, '_> {
    fn of(table: &'de Table, skip: Option<&'static str>) -> Self {
        Self::Of { entries: table.iter(), skip, pending: None }
    }
}

impl<'de> de::MapAccess<'de> for Entries<'de, '_> {
    type Error = ScenarioError;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, ScenarioError> {
        let key = match self {
            Self::Of { entries, skip, pending } => {
                let next = entries.find(|(key, _)| Some(key.as_str()) != *skip);
                *pending = next.map(|(key, value)| (key.as_str(), value));
                pending.map(|(key, _)| key)
            }
            Self::Asked(keys) => keys.next_key(),
        };
        key.map(|key| seed.deserialize(StrDeserializer::<ScenarioError>::new(key))).transpose()
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<T::Value, ScenarioError> {
        let pending = match self {
            Self::Of { pending, .. } => pending.take().map(|(key, value)| (key, Node::from(value))),
            Self::Asked(keys) => keys.value().map(|(key, note)| (key, Node::Asked(note))),
        };
        let Some((key, node)) = pending else {
            return Err(Error::custom("a value was asked for before its key"));
        };
        seed.deserialize(node).map_err(|error| error.inside(key))
    }
}

/// A variant by its name.
struct Variant<'de, 'n> {
    name: &'de str,
    keys: VariantKeys<'de, 'n>,
}

/// What a variant has beside its name.
enum VariantKeys<'de, 'n> {
    /// Nothing: there is only the name.
    None,
    /// What is in a table beside the tag.
    Of(&'de Table),
    Asked(Note<'n>),
}

impl<'de, 'n> de::EnumAccess<'de> for Variant<'de, 'n> {
    type Error = ScenarioError;
    type Variant = VariantKeys<'de, 'n>;

    fn variant_seed<T: DeserializeSeed<'de>>(
        self,
        seed: T,
    ) -> Result<(T::Value, VariantKeys<'de, 'n>), ScenarioError> {
        let Self { name, keys } = self;
        let tag = if matches!(keys, VariantKeys::Of(_)) { TAG } else { "" };
        let read = seed.deserialize(StrDeserializer::<ScenarioError>::new(name));
        read.map(|value| (value, keys)).map_err(|error| error.inside(tag))
    }
}

impl<'de> de::VariantAccess<'de> for VariantKeys<'de, '_> {
    type Error = ScenarioError;

    fn unit_variant(self) -> Result<(), ScenarioError> {
        match self {
            Self::None => Ok(()),
            Self::Of(table) => match table.keys().find(|key| *key != TAG) {
                None => Ok(()),
                Some(key) => Err(Error::unknown_field(key, &[])),
            },
            Self::Asked(note) => {
                note.write(Kind::Unit);
                Ok(())
            }
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
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ScenarioError> {
        visitor.visit_map(match self {
            Self::None => {
                return Err(Error::invalid_type(Unexpected::UnitVariant, &"struct variant"));
            }
            Self::Of(table) => Entries::of(table, Some(TAG)),
            Self::Asked(note) => Entries::Asked(note.table(fields).map_err(ScenarioError::custom)?),
        })
    }
}
