//! What `schema.md` says of settings is what the core has: their tables are written of the settings themselves.
//! `UPDATE_SCHEMA=1` writes them.

use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Value, to_value};
use std::fmt::Write;
use std::fs;
use std::path::Path;
use vff_core::control::avoidance::{barrier, priority};
use vff_core::control::detection::DetectionSettings;
use vff_core::control::force::ForceSettings;
use vff_core::control::observer::{ObserverSettings, Touch};
use vff_core::control::reaction::ReactionSettings;
use vff_core::control::tank::TankSettings;
use vff_core::control::{CommandSettings, PreviewSettings, SelfMotionSettings, Settings, Yielding};
use vff_core::field::Field;
use vff_core::perception::PerceiverSettings;
use vff_core::scenario::SCHEMA;
use vff_core::settings::{Key, Table};
use vff_core::simulation::{
    ActuatorSettings, ContactSettings, MeasurementSettings, Options, PerceptionSettings,
    ReplanSettings,
};
use vff_core::trajectory::GovernorSettings;

/// Letters of a line of `schema.md`.
const WIDTH: usize = 100;
/// Letters that a meaning has at least.
const NARROWEST: usize = 48;
/// The heading of the column of [`Key::note`].
const NOTE: &str = "avoidance";

/// A default as people write it.
fn written(default: &Value) -> String {
    match default {
        Value::Null => "none".into(),
        Value::String(name) => name.clone(),
        Value::Number(x) => format!("{}", x.as_f64().unwrap()),
        other => other.to_string(),
    }
}

/// Range and meaning, as a phrase.
fn meaning(key: &Key) -> String {
    let text = key.meaning.replace('\\', "");
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let text = text.trim_end_matches('.');
    let is_word = text.starts_with("A ") || text.chars().nth(1).is_some_and(char::is_lowercase);
    let first = text.chars().next().unwrap();
    let text = match is_word {
        true => format!("{}{}", first.to_lowercase(), &text[first.len_utf8()..]),
        false => text.to_string(),
    };
    let each = if key.each { "each, " } else { "" };
    match key.requirement {
        Some(range) => format!("{each}{}: {text}", range.symbols),
        None => text,
    }
}

/// `text` in lines of at most `width` letters.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last_mut().unwrap();
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= width {
            write!(line, " {word}").unwrap();
        } else {
            lines.push(word.into());
        }
    }
    lines
}

/// The table of a section.
fn table<T: Table + Default + Serialize>() -> String {
    let defaults = to_value(T::default()).unwrap();
    let rows: Vec<[String; 5]> = T::KEYS
        .iter()
        .filter_map(|key| {
            let default = written(&defaults[key.name]);
            let [name, unit, note] = [key.name, key.unit?, key.note].map(String::from);
            Some([name, unit, default, meaning(key), note])
        })
        .collect();
    let headings = ["key", "unit", "default", "meaning", NOTE].map(String::from);
    let width = |column: usize| {
        let cells = rows.iter().chain([&headings]).map(|row| row[column].chars().count());
        cells.max().unwrap()
    };
    let has_notes = rows.iter().any(|row| !row[4].is_empty());
    let [before, after] = [4 + (0..3).map(|k| width(k) + 2).sum::<usize>(), width(4) + 2];
    let room = WIDTH - before - if has_notes { after } else { 0 };
    let room = room.max(NARROWEST);
    let mut text = String::new();
    let mut line = |cells: [&str; 5]| {
        let mut line = "    ".to_string();
        for (column, cell) in cells.iter().enumerate().take(if has_notes { 5 } else { 4 }) {
            let width = if column == 3 { room } else { width(column) };
            write!(line, "{cell:width$}  ").unwrap();
        }
        writeln!(text, "{}", line.trim_end()).unwrap();
    };
    let dashes: [String; 5] = [0, 1, 2, 3, 4].map(|column| match column {
        3 => "-".repeat("meaning".len()),
        _ => "-".repeat(width(column)),
    });
    line(headings.each_ref().map(String::as_str));
    line(dashes.each_ref().map(String::as_str));
    for [key, unit, default, meaning, note] in &rows {
        for (index, part) in wrapped(meaning, room).iter().enumerate() {
            match index {
                0 => line([key, unit, default, part, note]),
                _ => line(["", "", "", part, ""]),
            }
        }
    }
    text
}

/// Puts a table of settings into its section, in place of the first one there.
fn put<T: Table + Default + Serialize>(text: &mut String, section: &str) {
    let headings = ["", " in space"].map(|place| format!("\n## [{section}]{place}\n"));
    let begin = headings.iter().find_map(|heading| Some(text.find(heading)? + heading.len()));
    let begin = begin.unwrap_or_else(|| panic!("no section {section}"));
    let begin = begin + text[begin..].find("\n    key ").unwrap() + 1;
    let end = begin + text[begin..].find("\n\n").unwrap() + 1;
    text.replace_range(begin..end, &table::<T>());
}

#[test]
fn tables_are_those_of_the_settings() {
    let mut text = SCHEMA.to_string();
    put::<Settings>(&mut text, "controller");
    put::<ObserverSettings>(&mut text, "controller.observer");
    put::<DetectionSettings>(&mut text, "controller.observer.detection");
    put::<Touch>(&mut text, "controller.touch");
    put::<ForceSettings>(&mut text, "controller.touch.force");
    put::<ReactionSettings>(&mut text, "controller.touch.reaction");
    put::<Yielding>(&mut text, "controller.yielding");
    put::<PreviewSettings>(&mut text, "controller.yielding.preview");
    put::<SelfMotionSettings>(&mut text, "controller.yielding.preview.self_motion");
    put::<GovernorSettings>(&mut text, "controller.governor");
    put::<CommandSettings>(&mut text, "controller.command");
    put::<ReplanSettings>(&mut text, "replan");
    put::<Options>(&mut text, "simulation");
    put::<MeasurementSettings>(&mut text, "measurement");
    put::<ActuatorSettings>(&mut text, "actuator");
    put::<ContactSettings>(&mut text, "obstacles.contact");
    put::<PerceiverSettings>(&mut text, "perception.perceiver");
    if std::env::var_os("UPDATE_SCHEMA").is_some() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/scenario/schema.md");
        fs::write(path, &text).unwrap();
    }
    let changed = text.lines().zip(SCHEMA.lines()).find(|(new, old)| new != old);
    assert!(
        text == SCHEMA,
        "schema.md is not that of the settings: {changed:?}; UPDATE_SCHEMA=1 cargo test -p vff-core --release --test schema"
    );
}

/// Where a default is words, it is said in the meaning; the numbers there are those in force.
#[test]
fn defaults_that_depend_are_those_in_force() {
    fn says(key: &str, plane: f64, space: f64) {
        let key = Yielding::KEYS.iter().find(|each| each.name == key).unwrap();
        let written = |x: f64| if x < 1e4 { format!("{x}") } else { format!("{x:e}") };
        let words = format!("none: {} in the plane, {} in space", written(plane), written(space));
        let meaning = key.meaning.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(meaning.contains(&words), "{}: {words}", key.name);
    }
    let settings = Yielding::default();
    says("activation", barrier::activation::<2>(&settings), barrier::activation::<3>(&settings));
    says("task_weight", barrier::task_weight::<2>(&settings), barrier::task_weight::<3>(&settings));
    says(
        "slack_weight",
        barrier::slack_weight::<2>(&settings),
        barrier::slack_weight::<3>(&settings),
    );
    let rate = Yielding::KEYS.iter().find(|each| each.name == "rate").unwrap().meaning;
    let words = format!("none: {} in priority, {} in cbf", priority::RATE, barrier::RATE);
    assert!(rate.contains(&words), "{words}");
}

/// The defaults that a table has whose required keys alone are given are those that `schema.md` has.
fn compare<T: DeserializeOwned + Serialize>(required: &str, section: &str) {
    let read: T = toml::from_str(required).unwrap();
    let values = to_value(read).unwrap();
    let start = SCHEMA.find(&format!("\n## [{section}]\n")).unwrap() + 1;
    let text = &SCHEMA[start..];
    let text = &text[..text[2..].find("\n#").map_or(text.len(), |end| end + 2)];
    let mut compared = 0;
    for line in text.lines().filter_map(|line| line.strip_prefix("    ")) {
        let mut cells = line.split("  ").map(str::trim).filter(|cell| !cell.is_empty());
        let Some(Value::Number(value)) = cells.next().and_then(|key| values.get(key)) else {
            continue;
        };
        let said: Vec<f64> = cells.take(2).filter_map(|cell| cell.parse().ok()).collect();
        // What is required, and what follows from another key, says no number.
        if let [said] = said[..] {
            assert!((said - value.as_f64().unwrap()).abs() < 1e-15, "{section}: {line}");
            compared += 1;
        }
    }
    assert!(compared > 0, "{section}");
}

#[test]
fn defaults_of_other_tables_are_those_in_force() {
    compare::<TankSettings>("capacity = 1.5", "controller.tank");
    compare::<Field>("kind = \"cubic\"\ngain = 1.5\ninfluence = 2.5", "controller.field");
    compare::<PerceptionSettings>("", "perception");
}
