//! What a serde type asks for while it is read: notes of whoever answers in place of a document.

use crate::control::deadline::UNLIMITED;
use std::cell::Cell;
use std::slice;

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
    /// A table of numbers by names that somebody gives, as those of links.
    NumbersByName,
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
    pub fn conclude(&mut self, missing: bool) -> bool {
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

/// Where the answer to a question is noted.
pub struct Note<'a> {
    kind: &'a mut Kind,
    /// Whether no key has been left out in this pass.
    untested: &'a Cell<bool>,
    /// Whether it is inside of a list of numbers or lists: such a list may be as deep as it likes.
    listed: bool,
}

/// What to answer where a type takes any value and only says in words what it expects.
pub enum Answer<'a> {
    /// A table without entries.
    Nothing,
    /// A sphere: a table whose keys are told in words only.
    Sphere,
    /// A number.
    Number,
    /// A list.
    List(Repeated<'a>),
}

const TWO_WAYS: &str = "one type, read in two ways";

impl<'a> Note<'a> {
    /// In the place of a value that is not inside of a list.
    pub fn of(kind: &'a mut Kind, untested: &'a Cell<bool>) -> Self {
        Self { kind, untested, listed: false }
    }

    /// The value is this one, or the variant has no keys.
    pub fn write(self, kind: Kind) {
        *self.kind = kind;
    }

    /// The value is what this describes.
    ///
    /// # Errors
    /// If nobody knows what that is.
    pub fn any(self, expected: &str) -> Result<Answer<'a>, String> {
        if expected == "struct PlacedShape" {
            self.write(Kind::AnyTable);
            return Ok(Answer::Sphere);
        }
        if expected == "a map" {
            self.write(Kind::NumbersByName);
            return Ok(Answer::Nothing);
        }
        if expected == format!("a number or \"{UNLIMITED}\"") {
            self.write(Kind::Number);
            return Ok(Answer::Number);
        }
        if expected != "a number or a list of numbers" {
            return Err(format!("a type that reads {expected}"));
        }
        if self.listed {
            self.write(Kind::NumberOrList(Box::new(Kind::Number)));
            return Ok(Answer::Number);
        }
        Ok(Answer::List(Repeated { listed: true, ..self.inside(Kind::NumberOrList, 1) }))
    }

    /// The value is a list of `length` values, or of any number of them.
    pub fn list(self, length: Option<usize>) -> Repeated<'a> {
        let make = |inner| match length {
            Some(length) => Kind::Tuple(length, inner),
            None => Kind::List(inner),
        };
        self.inside(make, length.unwrap_or(1))
    }

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

    /// The value is a table with these keys.
    ///
    /// # Errors
    /// If it was something else before.
    pub fn table(self, fields: &[&'static str]) -> Result<Keys<'a>, &'static str> {
        let Self { kind, untested, .. } = self;
        if *kind == Kind::Unknown {
            let key = |name| Key { name, kind: Kind::Unknown, required: Required::Unknown };
            *kind = Kind::Table(fields.iter().copied().map(key).collect());
        }
        let Kind::Table(keys) = kind else { return Err(TWO_WAYS) };
        Ok(Keys { keys: keys.iter_mut(), value: None, untested })
    }

    /// The value is one of these variants: the one of this pass.
    ///
    /// # Errors
    /// As [`table`](Self::table).
    pub fn choose(self, names: &[&'static str]) -> Result<(&'static str, Self), &'static str> {
        let Self { kind, untested, .. } = self;
        if *kind == Kind::Unknown {
            let variants = names.iter().map(|name| (*name, Kind::Unknown)).collect();
            *kind = Kind::Choice { variants, next: 0 };
        }
        let Kind::Choice { variants, next } = kind else { return Err(TWO_WAYS) };
        let chosen = *next;
        *next = (chosen + 1) % variants.len();
        let (name, kind) = &mut variants[chosen];
        Ok((name, Self::of(kind, untested)))
    }
}

/// The same value so many times.
pub struct Repeated<'a> {
    kind: &'a mut Kind,
    untested: &'a Cell<bool>,
    left: usize,
    listed: bool,
}

impl Repeated<'_> {
    /// The next one.
    pub fn next_value(&mut self) -> Option<Note<'_>> {
        self.left = self.left.checked_sub(1)?;
        Some(Note { kind: self.kind, untested: self.untested, listed: self.listed })
    }
}

/// The keys of a table, one of them left out if none has been yet.
pub struct Keys<'a> {
    keys: slice::IterMut<'a, Key>,
    value: Option<(&'static str, &'a mut Kind)>,
    untested: &'a Cell<bool>,
}

impl<'a> Keys<'a> {
    /// The next one.
    pub fn next_key(&mut self) -> Option<&'static str> {
        for key in self.keys.by_ref() {
            // A value that is not known yet has to be seen first.
            let seen = key.kind != Kind::Unknown;
            if seen && key.required == Required::Unknown && self.untested.replace(false) {
                key.required = Required::Tested;
                continue;
            }
            self.value = Some((key.name, &mut key.kind));
            return Some(key.name);
        }
        None
    }

    /// Its name, and the place of its value.
    pub fn value(&mut self) -> Option<(&'static str, Note<'a>)> {
        let (name, kind) = self.value.take()?;
        Some((name, Note::of(kind, self.untested)))
    }
}
