//! Which pairs of links an SRDF switches off.

use super::parse::{robot, with_document};
use super::{UrdfError, Xml};
use roxmltree::Document;

/// The `<disable_collisions>` of an SRDF.
///
/// # Errors
/// [`UrdfError`] for text that is no SRDF.
pub fn disabled_pairs(text: &str) -> Result<Vec<[String; 2]>, UrdfError> {
    with_document(Xml::Srdf, text, pairs_of)
}

fn pairs_of(document: &Document<'_>) -> Result<Vec<[String; 2]>, UrdfError> {
    let robot = robot(document)?;
    if robot.children().any(|n| n.has_tag_name("link")) {
        return Err(UrdfError::NotAnSrdf);
    }
    let pairs = robot.children().filter(|n| n.has_tag_name("disable_collisions"));
    let pair = |(i, node): (usize, roxmltree::Node<'_, '_>)| {
        let link = |key| {
            let place = format!("<disable_collisions> {}", i + 1);
            let what = if key == "link1" { "link1" } else { "link2" };
            node.attribute(key).map(String::from).ok_or(UrdfError::Missing { place, what })
        };
        Ok([link("link1")?, link("link2")?])
    };
    pairs.enumerate().map(pair).collect()
}
