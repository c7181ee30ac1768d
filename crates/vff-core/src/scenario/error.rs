//! What can be wrong with a scenario, and how it is said.

use crate::geometry::ShapeFault;
use crate::robot::description::DescriptionError;
use crate::settings::readable;
use crate::world::{plane, space};
use serde::Deserialize;
use serde::de::IntoDeserializer;
use serde::de::value::StrDeserializer;
use std::borrow::Cow;
use std::fmt;

/// One fault of a scenario: where, and what.
///
/// # Example
/// ```
/// use vff_core::scenario::{Problem, Scenario};
///
/// let error = Scenario::from_toml("duration = 1.0\nq0 = [0.4]\narm = { lengths = [-1.0], masses = 1.0 }\nreference = { kind = \"setpoint\", point = [0.5, 0.0] }")
///     .unwrap_err();
/// assert_eq!(error.path, "arm.lengths[0]");
/// assert!(matches!(error.problem, Problem::OutOfRange { .. }));
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{}{}", prefix(&cut(.path)), readable(&problem.to_string()))]
pub struct ScenarioError {
    /// Dotted path of the value, e.g. `obstacles[1].shape.radius`; empty for the whole document.
    pub path: String,
    /// What is wrong there.
    pub problem: Problem,
}

/// The beginning of what a user has written, where it is long.
fn cut(text: &str) -> Cow<'_, str> {
    const QUOTED: usize = 120;
    match text.char_indices().nth(QUOTED) {
        Some((end, _)) => format!("{}…", &text[..end]).into(),
        None => text.into(),
    }
}

fn prefix(path: &str) -> String {
    if path.is_empty() { String::new() } else { format!("{path}: ") }
}

/// What is wrong with a value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Problem {
    /// The text is not TOML; the message shows line and column.
    #[error("not valid TOML\n{0}")]
    Syntax(String),
    /// A key that does not exist.
    #[error("unknown key `{}`{}", cut(.key), hint(key, allowed))]
    UnknownKey {
        /// The key.
        key: String,
        /// The keys that exist here.
        allowed: Vec<String>,
    },
    /// A key that has to be there.
    #[error("missing key `{0}`")]
    MissingKey(String),
    /// A name that is not among the choices.
    #[error("unknown value `{}`{}{}", cut(.given), hint(given, allowed), elsewhere(given, allowed))]
    UnknownChoice {
        /// The name.
        given: String,
        /// The choices.
        allowed: Vec<String>,
    },
    /// A value of another type.
    #[error("expected {expected}, got {}", cut(.given))]
    WrongType {
        /// What would be right.
        expected: String,
        /// What was given.
        given: String,
    },
    /// A list of another length.
    #[error("expected {expected} {}, got {given}", if *.expected == 1 { "value" } else { "values" })]
    WrongLength {
        /// How many there should be.
        expected: usize,
        /// How many there are.
        given: usize,
    },
    /// A number or list out of its range.
    #[error("must be {requirement}, got {}", cut(.given))]
    OutOfRange {
        /// What would be right.
        requirement: String,
        /// What was given.
        given: String,
    },
    /// The reference leaves what the arm can reach.
    #[error(
        "leaves the reach of the arm at t = {time:.4} s: the point ({x:.4}, {y:.4}) m is {distance:.4} m \
         from the base, reachable is {inner:.4} to {outer:.4} m (`unreachable`: \"refuse\" or \"warn\")"
    )]
    Unreachable {
        /// The first time at which it does \[s\].
        time: f64,
        /// The point to be reached \[m\].
        x: f64,
        /// The point to be reached \[m\].
        y: f64,
        /// Its distance from the base \[m\].
        distance: f64,
        /// The smallest distance that can be reached \[m\].
        inner: f64,
        /// The largest distance that can be reached \[m\].
        outer: f64,
    },
    /// The arm cannot follow the reference.
    #[error(
        "cannot be reached from t = {time:.4} s on: within its joint limits the arm then stays as far as \
         {position:.4} m{} away (`unreachable`: \"refuse\" or \"warn\")",
        .angle.map_or_else(String::new, |angle| format!(" and {angle:.4} rad"))
    )]
    OutOfReach {
        /// The first time at which it does not \[s\].
        time: f64,
        /// The largest distance that is left \[m\].
        position: f64,
        /// The angle that is left there \[rad\], if the task has one.
        angle: Option<f64>,
    },
    /// Anything else, in a sentence.
    #[error("{0}")]
    Other(String),
}

/// Where a shape of obstacles is known that is not one here.
fn elsewhere(given: &str, allowed: &[String]) -> &'static str {
    match allowed.iter().any(|name| name == "capsule") {
        true if is_variant::<plane::Shape>(given) => "; that is a shape of obstacles in the plane",
        true if is_variant::<space::Shape>(given) => "; that is a shape of obstacles in space",
        _ => "",
    }
}

/// Whether an enum has a variant of this name.
fn is_variant<'a, T: Deserialize<'a>>(name: &'a str) -> bool {
    let name: StrDeserializer<'a, serde::de::value::Error> = name.into_deserializer();
    T::deserialize(name).err().is_none_or(|error| !error.to_string().starts_with("unknown variant"))
}

/// The nearest allowed name, if one is near, and all of them.
fn hint(given: &str, allowed: &[String]) -> String {
    struct List<'a>(&'a [String]);
    impl fmt::Display for List<'_> {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            for (i, name) in self.0.iter().enumerate() {
                write!(f, "{}`{name}`", if i == 0 { "" } else { ", " })?;
            }
            Ok(())
        }
    }
    let given = &*cut(given); // to compare a book with a name takes its time
    let similarity = |name: &String| strsim::jaro_winkler(&given.to_lowercase(), name);
    let nearest = allowed.iter().max_by(|a, b| similarity(a).total_cmp(&similarity(b)));
    match nearest.filter(|name| similarity(name) > 0.75) {
        Some(name) => format!(", did you mean `{name}`? Allowed: {}", List(allowed)),
        None => format!("; allowed: {}", List(allowed)),
    }
}

impl From<ShapeFault> for ScenarioError {
    /// Inside an obstacle.
    fn from(ShapeFault { key, requirement, given }: ShapeFault) -> Self {
        let problem = match given {
            Some(given) => Problem::OutOfRange { requirement, given },
            None => Problem::Other(format!("expected {requirement}")),
        };
        Self::new(format!("shape.{key}"), problem)
    }
}

impl From<DescriptionError> for ScenarioError {
    fn from(error: DescriptionError) -> Self {
        Self::new(error.path, Problem::Other(error.problem.to_string()))
    }
}

impl ScenarioError {
    /// A fault at `path`.
    pub fn new(path: impl Into<String>, problem: Problem) -> Self {
        Self { path: path.into(), problem }
    }

    /// A value at `path` that is not what is required.
    pub fn out_of_range(
        path: impl Into<String>,
        requirement: &str,
        given: impl fmt::Debug,
    ) -> Self {
        let problem = Problem::OutOfRange {
            requirement: requirement.into(),
            given: format!("{given:?}").replace("NaN", "nan"),
        };
        Self::new(path, problem)
    }

    /// The same fault, seen from the value that contains it under `key` (or `[index]`).
    #[must_use]
    pub fn inside(mut self, key: &str) -> Self {
        let separator = if self.path.is_empty() || self.path.starts_with('[') { "" } else { "." };
        self.path = format!("{key}{separator}{}", self.path);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_hundreds_of_digits_are_powers_of_ten() {
        let (large, small) = (format!("{}", 1e90), format!("{}", 2.5e-300));
        let text = format!("got {large}, at most 0.25, of {small}s");
        assert_eq!(readable(&text), "got 1e90, at most 0.25, of 2.5e-300s");
        assert_eq!(readable("1.2.3 and ... 17"), "1.2.3 and ... 17");
        let error = ScenarioError::out_of_range("a", "at most 1", 1e300);
        assert!(error.to_string().len() < 40, "{error}");
    }
}
