//! What `schema.md` says of every key: the same text for people and for their editors.

use std::collections::BTreeMap;

/// A row of a table of `schema.md`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Row {
    /// Unit, if it has one.
    pub unit: String,
    /// Default, or `–` for a key that must be given.
    pub default: String,
    /// Range and meaning.
    pub meaning: String,
    /// What a further column says.
    pub note: String,
}

/// What the paths of rows begin with that hold for arms in space alone: their sections are called so.
pub const SPACE: &str = "space.";

/// Rows by the path of their key, such as `controller.field.gain` or `reference.line.end`.
pub type Rows = BTreeMap<String, Row>;

/// Reads the tables of `schema.md`.
///
/// A table is indented, its columns begin where those of its dashed line do, and a row without a key goes on with the
/// row above.
pub fn rows(text: &str) -> Rows {
    let mut rows = Rows::new();
    let (mut table, mut section) = (String::new(), String::new());
    let (mut columns, mut last): (Vec<usize>, Option<String>) = (vec![], None);
    for line in text.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            let (heading, space) = match heading.strip_suffix(" in space") {
                Some(heading) => (heading, SPACE),
                None => (heading, ""),
            };
            let path = heading.trim_matches(|c| c == '[' || c == ']');
            table =
                if heading.starts_with('[') { format!("{space}{path}.") } else { String::new() };
            section.clone_from(&table);
        } else if let Some(heading) = line.strip_prefix("### ") {
            // `kind = "line"`, or `shape.kind = "circle"`
            let (key, variant) = heading.split_once(" = ").unwrap_or((heading, ""));
            let within = key.strip_suffix("kind").unwrap_or(key);
            section = format!("{table}{within}{}.", variant.trim_matches('"'));
        }
        let Some(row) = line.strip_prefix("    ").filter(|row| !row.trim().is_empty()) else {
            columns.clear();
            continue;
        };
        if row.chars().all(|c| c == '-' || c == ' ') {
            columns = starts(row);
            last = None;
            continue;
        }
        let [key, unit, default, meaning, note @ ..] = &cells(row, &columns)[..] else { continue };
        if !key.is_empty() {
            last = Some(format!("{section}{key}"));
        }
        let Some(path) = &last else { continue };
        let row = rows.entry(path.clone()).or_insert_with(|| Row {
            unit: unit.clone(),
            default: default.clone(),
            ..Row::default()
        });
        join(&mut row.meaning, meaning);
        note.iter().for_each(|note| join(&mut row.note, note));
    }
    rows
}

/// Goes on with `text` after a space.
fn join(text: &mut String, more: &str) {
    if !text.is_empty() && !more.is_empty() {
        text.push(' ');
    }
    text.push_str(more);
}

/// Where the columns of a dashed line begin.
fn starts(dashes: &str) -> Vec<usize> {
    let before = std::iter::once(' ').chain(dashes.chars());
    let begins = |(i, (before, c)): (usize, (char, char))| (before == ' ' && c == '-').then_some(i);
    before.zip(dashes.chars()).enumerate().filter_map(begins).collect()
}

/// The cells of a row; fewer than four columns make none.
fn cells(row: &str, columns: &[usize]) -> Vec<String> {
    if columns.len() < 4 {
        return vec![];
    }
    let letters: Vec<char> = row.chars().collect();
    let cell = |(k, start): (usize, &usize)| {
        let end = columns.get(k + 1).map_or(letters.len(), |end| (*end).min(letters.len()));
        let part = letters.get(*start..end.max(*start)).unwrap_or_default();
        part.iter().collect::<String>().trim().to_string()
    };
    columns.iter().enumerate().map(cell).collect()
}
