//! What an obstacle says of links: which may touch it, and what they keep from it.

use super::error::{Problem, ScenarioError};
use super::numbers::number;
use crate::settings::POSITIVE;
use crate::world::{Description, LOAD};

/// The numbers among it.
///
/// # Errors
/// If a margin is not positive, or a link has one that may touch the obstacle.
pub fn margins<const D: usize>(obstacle: &impl Description<D>) -> Result<(), ScenarioError> {
    if let Some(margin) = obstacle.margin() {
        number("margin", margin, &POSITIVE)?;
    }
    for (link, margin) in obstacle.margins() {
        let path = format!("margins.{link}");
        number(&path, *margin, &POSITIVE)?;
        if obstacle.ignored().contains(link) {
            let problem = "this link is to `ignore` the obstacle, and keeps nothing from it";
            return Err(ScenarioError::new(path, Problem::Other(problem.into())));
        }
    }
    Ok(())
}

/// The names among it, which are to be those of `links` of an arm.
///
/// # Errors
/// If there is no such link.
pub fn known_links<const D: usize>(
    obstacle: &impl Description<D>,
    links: &[String],
) -> Result<(), ScenarioError> {
    let allowed = || links.iter().map(String::as_str).chain([LOAD]);
    let ignored = obstacle.ignored().iter().enumerate();
    let ignored = ignored.map(|(k, given)| (format!("ignore[{k}]"), given));
    let kept = obstacle.margins().keys().map(|given| (format!("margins.{given}"), given));
    let unknown = ignored.chain(kept).find(|(_, given)| !allowed().any(|name| name == *given));
    let Some((path, given)) = unknown else { return Ok(()) };
    let (given, allowed) = (given.clone(), allowed().map(String::from).collect());
    Err(ScenarioError::new(path, Problem::UnknownChoice { given, allowed }))
}
