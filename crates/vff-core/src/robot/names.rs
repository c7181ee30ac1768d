//! Names that somebody mistyped.

/// The nearest of the names that exist, if one is near, and all of them.
pub(super) fn hint(given: &str, known: &[String]) -> String {
    let similarity =
        |name: &String| strsim::jaro_winkler(&given.to_lowercase(), &name.to_lowercase());
    let nearest = known.iter().max_by(|a, b| similarity(a).total_cmp(&similarity(b)));
    let all = list(known);
    match nearest.filter(|name| similarity(name) > 0.75) {
        Some(name) => format!(", did you mean `{name}`? There are {all}"),
        None => format!("; there are {all}"),
    }
}

/// "`a`, `b`, `c`".
pub(super) fn list<T: AsRef<str>>(names: &[T]) -> String {
    let quoted: Vec<_> = names.iter().map(|name| format!("`{}`", name.as_ref())).collect();
    quoted.join(", ")
}
