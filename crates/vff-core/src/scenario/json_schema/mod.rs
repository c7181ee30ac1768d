//! A JSON Schema of scenario files, for editors that complete and check TOML.
//!
//! Keys, types and names come from the serde types themselves ([`trace`]), units, defaults and meanings from
//! `schema.md` ([`text`]): neither is written down a second time.

mod text;
mod trace;

use super::SCHEMA;
use super::error::ScenarioError;
use super::notes::{Key, Kind, Required};
use super::tables::SPATIAL_KEYS;
use super::tables::{CONTACT, Tables, UNREACHABLE, WhereUnreachable};
use crate::control::deadline::UNLIMITED;
use crate::control::settings::OF_THE_ROBOT;
use crate::simulation::{ContactSettings, Plane, Space};
use serde_json::{Map, Value, json};
use text::{Row, Rows, SPACE};
use trace::trace;

/// The JSON Schema (draft 7) of a scenario.
///
/// It knows every key, type, name and simple range. What depends on more than one value is left to
/// [`Scenario::from_toml`](super::Scenario::from_toml). Where a name alone will do, it does not offer the table `{ kind = … }` of the same meaning.
///
/// # Panics
/// Never: a test traces every type.
pub fn json_schema() -> String {
    let schema = schema_of_scenario().expect("types that can be traced, as a test shows");
    format!("{schema:#}")
}

fn schema_of_scenario() -> Result<Value, ScenarioError> {
    let rows = text::rows(SCHEMA);
    let plane = schema(&in_the_plane()?, "", &rows);
    let space = schema(&in_space()?, SPACE, &rows);
    let has = |key: &str| json!({ "required": [key] });
    let spatial = json!({ "anyOf": SPATIAL_KEYS.map(has) });
    Ok(json!({
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "vffnull scenario",
        "description": "Units are SI, angles are in radians.",
        "type": "object",
        "required": ["arm"],
        "if": { "properties": { "arm": spatial } },
        "then": space,
        "else": plane,
    }))
}

/// The keys in the plane. Some types can hold what belongs to space: how an obstacle is turned at way points is an angle
/// here, links have two sides, and there are no cameras.
fn in_the_plane() -> Result<Kind, ScenarioError> {
    let spatial = [
        "orientations",
        "around",
        "cameras",
        "grazing",
        "position_error",
        "orientation_error",
        "clock_error",
        "perceiver",
    ];
    with_shared(spatial.into_iter().fold(trace::<Tables<Plane, 2>>()?, Kind::without))
}

/// The keys in space, where that is an orientation.
fn in_space() -> Result<Kind, ScenarioError> {
    with_shared(trace::<Tables<Space, 3>>()?.without("angles"))
}

/// Adds to every reference, but to a plan, and to every obstacle the key that they share.
fn with_shared(mut scenario: Kind) -> Result<Kind, ScenarioError> {
    let [choice, contact] = [trace::<WhereUnreachable>()?, trace::<ContactSettings>()?];
    let Kind::Table(keys) = &mut scenario else { return Ok(scenario) };
    for key in keys.iter_mut().filter(|key| key.name == "obstacles") {
        if let Kind::List(obstacle) = &mut key.kind
            && let Kind::Table(keys) = &mut **obstacle
        {
            let kind = contact.clone();
            keys.push(Key { name: CONTACT, kind, required: Required::No });
        }
    }
    for key in keys.iter_mut().filter(|key| key.name == "reference") {
        let Kind::Choice { variants, .. } = &mut key.kind else { continue };
        for (_, kind) in variants.iter_mut().filter(|(name, _)| *name != "plan") {
            let Kind::Table(keys) = kind else { continue };
            keys.push(Key { name: UNREACHABLE, kind: choice.clone(), required: Required::No });
        }
    }
    Ok(scenario)
}

/// What may stand at `path`.
fn schema(kind: &Kind, path: &str, rows: &Rows) -> Value {
    match kind {
        Kind::Unknown | Kind::Unit => json!({}),
        Kind::Flag => json!({ "type": "boolean" }),
        Kind::Number => json!({ "type": "number" }),
        Kind::Whole => json!({ "type": "integer", "minimum": 0 }),
        Kind::Text => json!({ "type": "string" }),
        Kind::NumberOrList(inner) => {
            let items = schema(inner, path, rows);
            json!({ "anyOf": [{ "type": "number" }, { "type": "array", "items": items }] })
        }
        Kind::List(inner) => json!({ "type": "array", "items": schema(inner, path, rows) }),
        Kind::Tuple(length, inner) => json!({
            "type": "array",
            "items": schema(inner, path, rows),
            "minItems": length,
            "maxItems": length,
        }),
        Kind::Table(keys) => table(keys, path, rows, None),
        Kind::NumbersByName => {
            json!({ "type": "object", "additionalProperties": { "type": "number" } })
        }
        Kind::AnyTable => json!({ "type": "object", "required": ["kind"] }),
        Kind::Choice { variants, .. } if variants.iter().all(|(_, kind)| *kind == Kind::Unit) => {
            let names: Vec<_> = variants.iter().map(|(name, _)| *name).collect();
            json!({ "type": "string", "enum": names })
        }
        Kind::Choice { variants, .. } => {
            let variant = |(name, kind): &(&str, Kind)| {
                let keys: &[Key] = if let Kind::Table(keys) = kind { keys } else { &[] };
                table(keys, &format!("{path}{name}."), rows, Some(name))
            };
            json!({ "type": "object", "oneOf": variants.iter().map(variant).collect::<Vec<_>>() })
        }
    }
}

/// A table with these keys; with `variant` as its `kind`, if it is one.
fn table(keys: &[Key], path: &str, rows: &Rows, variant: Option<&str>) -> Value {
    let mut properties = Map::new();
    let mut required = vec![];
    if let Some(variant) = variant {
        properties.insert("kind".into(), json!({ "const": variant }));
        required.push("kind");
    }
    for key in keys {
        let here = format!("{path}{}", key.name);
        let mut value = schema(&key.kind, &format!("{here}."), rows);
        if here == "controller.command" {
            let either = json!([{ "const": OF_THE_ROBOT }, value]);
            value = json!({ "description": "what stands before the robot", "anyOf": either });
        }
        if here == "controller.deadline" {
            value = json!({ "anyOf": [{ "const": UNLIMITED }, value] });
        }
        if let Some(row) = row_of(&here, rows) {
            describe(&mut value, row);
        }
        properties.insert(key.name.into(), value);
        if key.required == Required::Yes {
            required.push(key.name);
        }
    }
    json!({
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    })
}

/// The row of a key: in space that of its own, or the same as in the plane. What all references share has one row. A field over the angle to the joint limits has
/// the keys of any field.
fn row_of<'a>(path: &str, rows: &'a Rows) -> Option<&'a Row> {
    if let Some(row) = rows.get(path) {
        return Some(row);
    }
    let path = path.strip_prefix(SPACE).unwrap_or(path);
    rows.get(path).or_else(|| match path.strip_prefix("controller.joint_limit_field.") {
        Some(key) => rows.get(&format!("controller.field.{key}")),
        None if path.starts_with("reference.") && path.ends_with(UNREACHABLE) => {
            rows.get(&format!("reference.{UNREACHABLE}"))
        }
        None => None,
    })
}

/// Adds what people should know of a value, and the range that its meaning begins with.
fn describe(value: &mut Value, row: &Row) {
    let Row { unit, default, meaning, note } = row;
    let mut text = meaning.clone();
    if !note.is_empty() {
        text = format!("{text} ({note})");
    }
    if !unit.is_empty() {
        text = format!("{text} [{unit}]");
    }
    if let Ok(whole) = default.parse::<u64>() {
        value["default"] = whole.into();
    } else if let Ok(default) = default.parse::<f64>() {
        value["default"] = default.into();
    } else if let Ok(default) = default.parse::<bool>() {
        value["default"] = default.into();
    } else if value["enum"].as_array().is_some_and(|names| names.contains(&json!(default))) {
        value["default"] = json!(default);
    } else if !matches!(default.as_str(), "" | "–" | "\"\"") {
        text = format!("{text}; default: {default}");
    }
    value["description"] = text.into();
    for (words, key, bound) in [
        ("> 0", "exclusiveMinimum", json!(0)),
        ("≥ 0", "minimum", json!(0)),
        ("≥ 1", "minimum", json!(1)),
    ] {
        if meaning.strip_prefix("each, ").unwrap_or(meaning).starts_with(words) {
            bounded(value, key, &bound);
        }
    }
}

/// Puts a bound on every number inside.
fn bounded(value: &mut Value, key: &str, bound: &Value) {
    match value["type"].as_str() {
        Some("number" | "integer") => value[key] = bound.clone(),
        Some("array") => bounded(&mut value["items"], key, bound),
        _ => {
            if let Some(kinds) = value.get_mut("anyOf").and_then(Value::as_array_mut) {
                kinds.iter_mut().for_each(|kind| bounded(kind, key, bound));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// The paths of all keys, those of variants with their names.
    fn paths(kind: &Kind, path: &str, found: &mut BTreeSet<String>) {
        match kind {
            Kind::Table(keys) => {
                for key in keys {
                    found.insert(format!("{path}{}", key.name));
                    paths(&key.kind, &format!("{path}{}.", key.name), found);
                }
            }
            Kind::List(inner) => paths(inner, path, found),
            Kind::Choice { variants, .. } => {
                variants
                    .iter()
                    .for_each(|(name, kind)| paths(kind, &format!("{path}{name}."), found));
            }
            _ => {}
        }
    }

    /// `schema.md` explains the keys that the types have, all of them, and no others.
    #[test]
    fn every_key_is_explained() {
        let (rows, mut found) = (text::rows(SCHEMA), BTreeSet::new());
        paths(&in_the_plane().unwrap(), "", &mut found);
        paths(&in_space().unwrap(), SPACE, &mut found);
        // Tables have sections of their own.
        let is_table =
            |path: &str| found.iter().any(|other| other.starts_with(&format!("{path}.")));
        let explained = |path: &str| row_of(path, &rows).is_some() || is_table(path);
        let silent: Vec<_> = found.iter().filter(|path| !explained(path)).collect();
        assert!(silent.is_empty(), "not in schema.md: {silent:?}");
        let read: Vec<_> = found.iter().filter_map(|path| row_of(path, &rows)).collect();
        let is_read = |row: &Row| read.iter().any(|other| std::ptr::eq(*other, row));
        let unknown: Vec<_> =
            rows.iter().filter(|(_, row)| !is_read(row)).map(|(path, _)| path).collect();
        assert!(unknown.is_empty(), "only in schema.md: {unknown:?}");
    }

    /// A key without a default must be given, and only such a key, in the text as in the types.
    #[test]
    fn required_keys_are_those_without_a_default() {
        fn compare(kind: &Kind, path: &str, rows: &Rows) {
            match kind {
                Kind::Table(keys) => {
                    for key in keys {
                        let here = format!("{path}{}", key.name);
                        if let Some(row) = row_of(&here, rows) {
                            let required = row.default == "–";
                            assert_eq!(required, key.required == Required::Yes, "{here}");
                        }
                        compare(&key.kind, &format!("{here}."), rows);
                    }
                }
                Kind::List(inner) => compare(inner, path, rows),
                Kind::Choice { variants, .. } => variants
                    .iter()
                    .for_each(|(name, kind)| compare(kind, &format!("{path}{name}."), rows)),
                _ => {}
            }
        }
        compare(&in_the_plane().unwrap(), "", &text::rows(SCHEMA));
        compare(&in_space().unwrap(), SPACE, &text::rows(SCHEMA));
    }

    #[test]
    fn types_ranges_defaults_and_units_arrive() {
        let schema = schema_of_scenario().unwrap()["else"].clone();
        let controller = &schema["properties"]["controller"]["properties"];
        let margin = &controller["yielding"]["properties"]["margin"];
        assert_eq!(margin["type"], "number");
        assert_eq!(margin["exclusiveMinimum"], 0);
        assert_eq!(margin["default"], 0.02);
        assert!(margin["description"].as_str().unwrap().ends_with("[m]"), "{margin}");
        assert_eq!(controller["task"]["enum"], json!(["position", "pose", "pointing"]));
        assert_eq!(controller["task"]["default"], "position");
        let com = &schema["properties"]["arm"]["properties"]["com"];
        assert_eq!(com["anyOf"][1]["items"]["anyOf"][1]["items"]["type"], "number");
        assert_eq!(schema["required"], json!(["duration", "q0", "arm", "reference"]));
        let line = schema["properties"]["reference"]["oneOf"][2].clone();
        assert_eq!(line["properties"]["kind"]["const"], "line");
        assert_eq!(line["required"], json!(["kind", "end", "duration"]));
    }
}
