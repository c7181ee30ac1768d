//! What a serde type may be read from, found out by reading it.
//!
//! A [`Tracer`] answers whatever a type asks for and keeps a note of it. One pass sees one variant of every enum and
//! finds out of one key at most whether it may be missing; [`trace`] makes as many passes as that takes.

use crate::control::deadline::UNLIMITED;
use serde::de::{
    self, DeserializeSeed, Deserializer, Expected, IntoDeserializer, MapAccess, SeqAccess,
    VariantAccess, Visitor, value::StrDeserializer,
};
use serde::forward_to_deserialize_any;
use std::cell::Cell;
use std::fmt;

/// More passes than any type needs.
const MAX_PASSES: usize = 100_000;

/// What a value may be.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// Not seen yet.
    Unknown,
    /// Nothing besides its name: a variant without keys.
    Unit,
    /// `true` or `false`.
    Flag,
    /// A number.
    Number,
    /// A whole number, 0 or more.
    Whole,
    /// Text.
    Text,
    /// A number, or a list of what is inside.
    NumberOrList(Box<Kind>),
    /// A list of any length.
    List(Box<Kind>),
    /// A list of that many values.
    Tuple(usize, Box<Kind>),
    /// A table.
    Table(Vec<Key>),
    /// A table whose `kind` says which keys it has, told in words only.
    AnyTable,
    /// One of these names, with a table of further keys where a variant has some.
    Choice {
        /// The variants.
        variants: Vec<(&'static str, Kind)>,
        /// Which of them the next pass sees.
        next: usize,
    },
}

/// A key of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    /// Its name.
    pub name: &'static str,
    /// What its value may be.
    pub kind: Kind,
    /// Whether it must be there.
    pub required: Required,
}

/// What is known of whether a key must be there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Required {
    /// Nothing yet.
    Unknown,
    /// This pass leaves it out.
    Tested,
    /// It must.
    Yes,
    /// It need not.
    No,
}

/// Why a pass ended early.
#[derive(Debug, PartialEq)]
pub enum Fault {
    /// A key is missing that must be there.
    Missing,
    /// The type cannot be traced.
    Other(String),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing => f.write_str("a key is missing"),
            Self::Other(text) => f.write_str(text),
        }
    }
}

impl std::error::Error for Fault {}

impl de::Error for Fault {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::Other(message.to_string())
    }

    fn missing_field(_: &'static str) -> Self {
        Self::Missing
    }
}

/// What a `T` may be read from.
///
/// # Errors
/// If the type cannot be traced.
pub fn trace<T: de::DeserializeOwned>() -> Result<Kind, Fault> {
    let mut kind = Kind::Unknown;
    for _ in 0..MAX_PASSES {
        let untested = Cell::new(true);
        let missing =
            match T::deserialize(Tracer { kind: &mut kind, untested: &untested, listed: false }) {
                Ok(_) => false,
                Err(Fault::Missing) => true,
                Err(other) => return Err(other),
            };
        if !kind.conclude(missing) {
            return Ok(kind);
        }
    }
    Err(Fault::Other("more variants than expected".into()))
}

impl Kind {
    /// The same without a key of this name, wherever it is.
    #[must_use]
    pub fn without(self, name: &str) -> Self {
        let inside = |kind: Box<Self>| Box::new(kind.without(name));
        match self {
            Self::NumberOrList(kind) => Self::NumberOrList(inside(kind)),
            Self::List(kind) => Self::List(inside(kind)),
            Self::Tuple(length, kind) => Self::Tuple(length, inside(kind)),
            Self::Table(keys) => {
                let kept = keys.into_iter().filter(|key| key.name != name);
                Self::Table(kept.map(|key| Key { kind: key.kind.without(name), ..key }).collect())
            }
            Self::Choice { variants, next } => {
                let variants = variants.into_iter().map(|(each, kind)| (each, kind.without(name)));
                Self::Choice { variants: variants.collect(), next }
            }
            other => other,
        }
    }

    /// Ends a pass: notes what it has found out, and whether anything is left to find out.
    fn conclude(&mut self, missing: bool) -> bool {
        match self {
            Self::Unknown => true,
            Self::NumberOrList(inner) | Self::List(inner) | Self::Tuple(_, inner) => {
                inner.conclude(missing)
            }
            Self::Table(keys) => keys.iter_mut().fold(false, |open, key| {
                if key.required == Required::Tested {
                    key.required = if missing { Required::Yes } else { Required::No };
                }
                (key.required == Required::Unknown) | key.kind.conclude(missing) | open
            }),
            Self::Choice { variants, .. } => {
                variants.iter_mut().fold(false, |open, (_, inside)| inside.conclude(missing) | open)
            }
            _ => false,
        }
    }
}

/// A deserializer that answers what is asked, and notes it in `kind`.
struct Tracer<'a> {
    kind: &'a mut Kind,
    /// Whether no key has been left out in this pass.
    untested: &'a Cell<bool>,
    /// Whether it is inside of a list of numbers or lists: such a list may be as deep as it likes.
    listed: bool,
}

impl<'a> Tracer<'a> {
    /// What is inside of a list.
    fn inside(self, make: impl FnOnce(Box<Kind>) -> Kind, count: usize) -> Repeated<'a> {
        let Self { kind, untested, .. } = self;
        if *kind == Kind::Unknown {
            *kind = make(Box::new(Kind::Unknown));
        }
        match kind {
            Kind::List(inner) | Kind::Tuple(_, inner) | Kind::NumberOrList(inner) => {
                Repeated { kind: inner, untested, left: count, listed: false }
            }
            other => Repeated { kind: other, untested, left: 0, listed: false },
        }
    }

    fn table<'de, V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        let Self { kind, untested, .. } = self;
        if *kind == Kind::Unknown {
            let key = |name| Key { name, kind: Kind::Unknown, required: Required::Unknown };
            *kind = Kind::Table(fields.iter().copied().map(key).collect());
        }
        let Kind::Table(keys) = kind else {
            return Err(Fault::Other("one type, read in two ways".into()));
        };
        visitor.visit_map(Keys { keys: keys.iter_mut(), value: None, untested })
    }
}

impl<'de> Deserializer<'de> for Tracer<'_> {
    type Error = Fault;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        let expected = (&visitor as &dyn Expected).to_string();
        if expected == "struct PlacedShape" {
            *self.kind = Kind::AnyTable;
            let sphere = serde_json::json!({ "kind": "sphere", "radius": 1 });
            return sphere.deserialize_any(visitor).map_err(de::Error::custom);
        }
        if expected == format!("a number or \"{UNLIMITED}\"") {
            return self.deserialize_f64(visitor);
        }
        if expected != "a number or a list of numbers" {
            return Err(Fault::Other(format!("a type that reads {expected}")));
        }
        if self.listed {
            *self.kind = Kind::NumberOrList(Box::new(Kind::Number));
            return visitor.visit_f64(1.0);
        }
        let element = self.inside(Kind::NumberOrList, 1);
        visitor.visit_seq(Repeated { listed: true, ..element })
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        *self.kind = Kind::Flag;
        visitor.visit_bool(true)
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        *self.kind = Kind::Number;
        visitor.visit_f64(1.0)
    }

    fn deserialize_u64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        *self.kind = Kind::Whole;
        visitor.visit_u64(1)
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        *self.kind = Kind::Text;
        visitor.visit_str("")
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        self.deserialize_str(visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_some(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_seq(self.inside(Kind::List, 1))
    }

    fn deserialize_tuple<V: Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, Fault> {
        visitor.visit_seq(self.inside(|inner| Kind::Tuple(length, inner), length))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        self.table(fields, visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        let Self { kind, untested, .. } = self;
        if *kind == Kind::Unknown {
            let variants = variants.iter().map(|name| (*name, Kind::Unknown)).collect();
            *kind = Kind::Choice { variants, next: 0 };
        }
        let Kind::Choice { variants, next } = kind else {
            return Err(Fault::Other("one type, read in two ways".into()));
        };
        let chosen = *next;
        *next = (chosen + 1) % variants.len();
        let (name, kind) = &mut variants[chosen];
        visitor.visit_enum(Chosen { name, inside: Tracer { kind, untested, listed: false } })
    }

    forward_to_deserialize_any! {
        i8 i16 i32 i64 i128 u8 u16 u32 u128 f32 char bytes byte_buf unit unit_struct
        newtype_struct tuple_struct map identifier ignored_any
    }
}

/// The same value so many times.
struct Repeated<'a> {
    kind: &'a mut Kind,
    untested: &'a Cell<bool>,
    left: usize,
    listed: bool,
}

impl<'de> SeqAccess<'de> for Repeated<'_> {
    type Error = Fault;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, Fault> {
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        seed.deserialize(Tracer { kind: self.kind, untested: self.untested, listed: self.listed })
            .map(Some)
    }
}

/// The keys of a table, one of them left out if none has been yet.
struct Keys<'a> {
    keys: std::slice::IterMut<'a, Key>,
    value: Option<&'a mut Kind>,
    untested: &'a Cell<bool>,
}

impl<'de> MapAccess<'de> for Keys<'_> {
    type Error = Fault;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Fault> {
        for key in self.keys.by_ref() {
            // A value that is not known yet has to be seen first.
            let seen = key.kind != Kind::Unknown;
            if seen && key.required == Required::Unknown && self.untested.replace(false) {
                key.required = Required::Tested;
                continue;
            }
            self.value = Some(&mut key.kind);
            return seed.deserialize(StrDeserializer::<Fault>::new(key.name)).map(Some);
        }
        Ok(None)
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, Fault> {
        let Some(kind) = self.value.take() else {
            return Err(Fault::Other("a value before its key".into()));
        };
        seed.deserialize(Tracer { kind, untested: self.untested, listed: false })
    }
}

/// The variant of this pass.
struct Chosen<'a> {
    name: &'static str,
    inside: Tracer<'a>,
}

impl<'de, 'a> de::EnumAccess<'de> for Chosen<'a> {
    type Error = Fault;
    type Variant = Tracer<'a>;

    fn variant_seed<T: DeserializeSeed<'de>>(
        self,
        seed: T,
    ) -> Result<(T::Value, Tracer<'a>), Fault> {
        let name: StrDeserializer<'_, Fault> = self.name.into_deserializer();
        seed.deserialize(name).map(|value| (value, self.inside))
    }
}

impl<'de> VariantAccess<'de> for Tracer<'_> {
    type Error = Fault;

    fn unit_variant(self) -> Result<(), Fault> {
        *self.kind = Kind::Unit;
        Ok(())
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, _: T) -> Result<T::Value, Fault> {
        Err(Fault::Other("no variant of a scenario is a bare value".into()))
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, _: V) -> Result<V::Value, Fault> {
        Err(Fault::Other("no variant of a scenario is a tuple".into()))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        self.table(fields, visitor)
    }
}
