//! A perceiver that a document describes.

use super::AnyArm;
use crate::perception::{DepthCamera, Perceiver, PerceiverSettings, PerceptionError};
use crate::scenario::{self, Problem, ScenarioError};
use crate::simulation::Space;
use serde::Deserialize;
use toml::Table;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Described {
    cameras: Vec<DepthCamera>,
    #[serde(default)]
    settings: PerceiverSettings,
    #[serde(default)]
    known: Vec<Table>,
}

/// The perceiver around an arm in space that a document describes: its `cameras`, `settings`, and obstacles that are `known`.
///
/// # Errors
/// With the dotted path of the first fault.
///
/// # Example
/// ```
/// use vff_core::runtime::{AnyArm, read_perceiver};
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let arm = AnyArm::read(&toml::toml! { model = "panda" })?;
/// let document = toml::toml! {
///     [[cameras]]
///     columns = 80
///     rows = 60
///     focal = [75.0, 75.0]
///     centre = [39.5, 29.5]
///     position = [0.6, 0.0, 1.5]
///     orientation = [0.0, 1.0, 0.0, 0.0]
///
///     [settings]
///     stride = 1
/// };
/// assert_eq!(read_perceiver(&arm, &document)?.size(0), Some([60, 80]));
/// # Ok(())
/// # }
/// ```
pub fn read_perceiver(arm: &AnyArm, document: &Table) -> Result<Perceiver, ScenarioError> {
    let other = |sentence: String| ScenarioError::new("", Problem::Other(sentence));
    let AnyArm::Space(arm) = arm else {
        return Err(other("cameras look at arms in space, and this one is in the plane".into()));
    };
    let Described { cameras, settings, known } = scenario::read(document)?;
    let read = |(index, each): (usize, &Table)| {
        let found = scenario::read_felt_obstacle::<Space, 3>(each);
        found.map(|found| found.0).map_err(|error| error.inside(&format!("known[{index}]")))
    };
    let known = known.iter().enumerate().map(read).collect::<Result<_, _>>()?;
    Perceiver::new(arm, cameras, settings, known)
        .map_err(|error: PerceptionError| other(error.to_string()))
}
