//! Which pairs of links an SRDF switches off.

use super::parse::{document, robot};
use super::{UrdfError, Xml};

/// The `<disable_collisions>` of an SRDF.
///
/// # Errors
/// [`UrdfError`] for text that is no SRDF.
pub fn disabled_pairs(text: &str) -> Result<Vec<[String; 2]>, UrdfError> {
    let document = document(Xml::Srdf, text)?;
    let robot = robot(&document)?;
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
