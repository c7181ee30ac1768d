//! What people can set, each key said once: its default, unit, range and meaning stand at the field that it becomes.
//!
//! `settings!` makes of a list of keys a struct that serde reads, its defaults, and the list itself
//! ([`Table::KEYS`]). `scenario` validates by that list, and `tests/schema.rs` writes the tables of `schema.md` from it.

use crate::math::ScalarOrVec;

/// A sentence in which numbers of more digits than anybody reads stand as powers of ten.
pub(crate) fn readable(text: &str) -> String {
    const DIGITS: usize = 24;
    let is_of_number = |c: char| c.is_ascii_digit() || c == '.';
    let mut said = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(begin) = rest.find(is_of_number) {
        let (before, number) = rest.split_at(begin);
        let end = number.find(|c| !is_of_number(c)).unwrap_or(number.len());
        let (digits, after) = number.split_at(end);
        said += before;
        match digits.parse::<f64>() {
            Ok(value) if digits.len() > DIGITS => said += &format!("{value:e}"),
            _ => said += digits,
        }
        rest = after;
    }
    said + rest
}

/// A range that numbers have to be in.
///
/// # Example
/// ```
/// use vff_core::settings::{Numbers, POSITIVE, Ranged, Requirement};
///
/// let Requirement { words, holds, .. } = &POSITIVE;
/// assert!(holds(0.1) && !holds(0.0) && *words == "greater than 0");
/// assert!(matches!(2.5.numbers(), Numbers::One(x) if x == 2.5));
/// ```
#[derive(Debug)]
pub struct Requirement {
    /// In symbols, as `schema.md` has it.
    pub symbols: &'static str,
    /// In words: what a number must be.
    pub words: &'static str,
    /// Whether a number is.
    pub holds: fn(f64) -> bool,
}

/// Whatever is a number.
pub const FINITE: Requirement =
    Requirement { symbols: "finite", words: "finite", holds: f64::is_finite };
/// Lengths, masses and the like.
pub const POSITIVE: Requirement =
    Requirement { symbols: "> 0", words: "greater than 0", holds: |x| x > 0.0 };
/// Gains, radii and the like.
pub const NOT_NEGATIVE: Requirement =
    Requirement { symbols: "≥ 0", words: "0 or more", holds: |x| x >= 0.0 };
/// Counts.
pub const AT_LEAST_ONE: Requirement =
    Requirement { symbols: "≥ 1", words: "1 or more", holds: |x| x >= 1.0 };
/// Counts of what takes time.
pub const UP_TO_10000: Requirement = Requirement {
    symbols: "1 to 10000",
    words: "from 1 to 10000",
    holds: |x| (1.0..=10_000.0).contains(&x),
};
/// Shares of which something has to be left.
pub const SHARE: Requirement = Requirement {
    symbols: "in (0, 1]",
    words: "greater than 0 and at most 1",
    holds: |x| 0.0 < x && x <= 1.0,
};
/// Shares of which there may be nothing.
pub const FROM_NONE_TO_ALL: Requirement =
    Requirement { symbols: "in [0, 1]", words: "from 0 to 1", holds: |x| (0.0..=1.0).contains(&x) };
/// Shares of which something has to be missing.
pub const PART: Requirement =
    Requirement { symbols: "in [0, 1)", words: "in [0, 1)", holds: |x| (0.0..1.0).contains(&x) };

/// A key of a table.
///
/// # Example
/// ```
/// use vff_core::settings::{Key, Table};
///
/// let named = |name| vff_core::control::Settings::KEYS.iter().find(|key| key.name == name);
/// let Key { each, requirement, .. } = named("stiffness").unwrap();
/// assert!(*each && requirement.is_some());
/// ```
#[derive(Debug)]
pub struct Key {
    /// Its name.
    pub name: &'static str,
    /// Its unit, empty without one; None for a key that a section of its own explains.
    pub unit: Option<&'static str>,
    /// Whether it is one number for all or one each.
    pub each: bool,
    /// Its range, if it is a number.
    pub requirement: Option<&'static Requirement>,
    /// What it means.
    pub meaning: &'static str,
    /// Who uses it, where not all do.
    pub note: &'static str,
}

/// The numbers that stand at a key.
#[derive(Debug, Clone, Copy)]
pub enum Numbers<'a> {
    /// None is given.
    None,
    /// A number.
    One(f64),
    /// A whole number.
    Whole(usize),
    /// One for all, or one each.
    Each(&'a ScalarOrVec),
}

/// A value of numbers that a [`Requirement`] can hold for.
pub trait Ranged {
    /// Whether it is one number for all or one each.
    const EACH: bool = false;

    /// The numbers.
    fn numbers(&self) -> Numbers<'_>;

    /// Puts a number in its place; false where it is not one of this kind.
    fn set(&mut self, _number: f64) -> bool {
        false
    }
}

impl Ranged for f64 {
    fn numbers(&self) -> Numbers<'_> {
        Numbers::One(*self)
    }

    fn set(&mut self, number: f64) -> bool {
        *self = number;
        true
    }
}

impl Ranged for usize {
    fn numbers(&self) -> Numbers<'_> {
        Numbers::Whole(*self)
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "whole, and bounded"
    )]
    fn set(&mut self, number: f64) -> bool {
        let is_whole = (0.0..1e15).contains(&number) && number.fract() == 0.0;
        if is_whole {
            *self = number as usize;
        }
        is_whole
    }
}

impl Ranged for ScalarOrVec {
    const EACH: bool = true;

    fn numbers(&self) -> Numbers<'_> {
        Numbers::Each(self)
    }
}

impl<T: Ranged> Ranged for Option<T> {
    const EACH: bool = T::EACH;

    fn numbers(&self) -> Numbers<'_> {
        self.as_ref().map_or(Numbers::None, T::numbers)
    }
}

/// A table of a document: settings that know what each of them is.
///
/// ```
/// use vff_core::control::Yielding;
/// use vff_core::settings::Table;
///
/// let margin = Yielding::KEYS.iter().find(|key| key.name == "margin").unwrap();
/// assert_eq!(margin.unit, Some("m"));
/// assert!(!(margin.requirement.unwrap().holds)(0.0));
/// ```
pub trait Table {
    /// Its keys, in the order in which they are explained.
    const KEYS: &'static [Key];
    /// The names of those that have a unit or "".
    const NAMES: &'static [&'static str];

    /// Hands the name, the numbers and the range of every key that has one to `check`, up to the first error.
    ///
    /// # Errors
    /// That of `check`.
    fn check<E>(
        &self,
        check: impl FnMut(&'static str, Numbers<'_>, &'static Requirement) -> Result<(), E>,
    ) -> Result<(), E>;

    /// Puts a number at a key that has a range; false where there is none, or it is not one of this kind.
    ///
    /// ```
    /// use vff_core::perception::PerceiverSettings;
    /// use vff_core::settings::Table;
    ///
    /// let mut settings = PerceiverSettings::default();
    /// assert!(settings.set("voxel", 0.03) && settings.voxel == 0.03);
    /// assert!(!settings.set("stride", 0.5) && !settings.set("room", 1.0) && !settings.set("voxels", 1.0));
    /// ```
    fn set(&mut self, key: &str, number: f64) -> bool;
}

/// Makes a table of settings of a list of its keys:
///
/// ```text
/// /// Meaning.
/// key: Type = default, "unit", RANGE, "who uses it";
/// ```
///
/// What follows the unit may be left out, where the type or everybody says it. A key without a unit, not even "", has a section
/// of its own in `schema.md`, or none at all.
macro_rules! settings {
    (@unit "") => { "" };
    (@unit $unit:tt) => { concat!("Unit: ", $unit, ".") };
    (
        $(#[$meta:meta])*
        pub struct $table:ident {
            $(
                $(#[doc = $meaning:literal])+
                $(#[serde($($serde:tt)*)])?
                $key:ident: $type:ty = $default:expr
                $(, $unit:tt $(, $range:ident)? $(, $note:literal)?)?;
            )+
        }
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, serde::Deserialize, serde::Serialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $table {
            $(
                $(#[doc = $meaning])+
                ///
                #[doc = concat!("Default: `", stringify!($default), "`.")]
                $(#[doc = $crate::settings::settings!(@unit $unit)])?
                $($(#[doc = concat!("Range: [`", stringify!($range), "`](crate::settings::", stringify!($range), ").")])?)?
                $(#[serde($($serde)*)])?
                pub $key: $type,
            )+
        }

        impl Default for $table {
            fn default() -> Self {
                Self { $($key: $default,)+ }
            }
        }

        impl $crate::settings::Table for $table {
            const KEYS: &'static [$crate::settings::Key] = &[$(
                $crate::settings::Key {
                    name: stringify!($key),
                    unit: [$(Some($unit),)? None][0],
                    each: [$($({
                        let _ = &$crate::settings::$range;
                        <$type as $crate::settings::Ranged>::EACH
                    },)?)? false][0],
                    requirement: [$($(Some(&$crate::settings::$range),)?)? None][0],
                    meaning: concat!($($meaning),+),
                    note: [$($($note,)?)? ""][0],
                },
            )+];

            const NAMES: &'static [&'static str] = &[$($({
                let _: &str = $unit;
                stringify!($key)
            },)?)+];

            fn check<E>(
                &self,
                mut check: impl FnMut(
                    &'static str,
                    $crate::settings::Numbers<'_>,
                    &'static $crate::settings::Requirement,
                ) -> Result<(), E>,
            ) -> Result<(), E> {
                $($($(
                    let numbers = $crate::settings::Ranged::numbers(&self.$key);
                    check(stringify!($key), numbers, &$crate::settings::$range)?;
                )?)?)+
                let _ = &mut check; // a table may be without numbers
                Ok(())
            }

            fn set(&mut self, key: &str, number: f64) -> bool {
                $($($(
                    if key == stringify!($key) {
                        let _ = &$crate::settings::$range;
                        return $crate::settings::Ranged::set(&mut self.$key, number);
                    }
                )?)?)+
                let _ = (key, number); // a table may be without numbers
                false
            }
        }
    };
}
pub(crate) use settings;
