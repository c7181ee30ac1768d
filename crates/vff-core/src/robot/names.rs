//! Names that somebody mistyped.

/// The nearest of the names that exist, if one is near, and all of them.
pub(super) fn hint(given: &str, known: &[String]) -> String {
    let nearest = nearest(given, known);
    let all = list(known);
    match nearest {
        Some(name) => format!(", did you mean `{name}`? There are {all}"),
        None => format!("; there are {all}"),
    }
}

#[cfg(feature = "models")]
fn nearest<'a>(given: &str, known: &'a [String]) -> Option<&'a String> {
    let similarity =
        |name: &String| strsim::jaro_winkler(&given.to_lowercase(), &name.to_lowercase());
    let nearest = known.iter().max_by(|a, b| similarity(a).total_cmp(&similarity(b)));
    nearest.filter(|name| similarity(name) > 0.75)
}

/// Without a measure of similarity only capitals are forgiven.
#[cfg(not(feature = "models"))]
fn nearest<'a>(given: &str, known: &'a [String]) -> Option<&'a String> {
    known.iter().find(|name| name.to_lowercase() == given.to_lowercase())
}

/// "`a`, `b`, `c`".
pub(super) fn list<T: AsRef<str>>(names: &[T]) -> String {
    let quoted: Vec<_> = names.iter().map(|name| format!("`{}`", name.as_ref())).collect();
    quoted.join(", ")
}
