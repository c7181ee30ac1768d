//! The arrows between the modules of the core run one way, in tests as well; no file is long.

use std::fs;
use std::path::{Path, PathBuf};

/// Modules, from the bottom; those of one row do not know each other.
const FLOORS: &[&[&str]] = &[
    &["interrupt", "properties"],
    &["math"],
    &["settings"],
    &["field", "geometry", "trajectory"],
    &["robot", "testing", "world"],
    &["inverse_kinematics", "perception", "planned_reference"],
    &["control"],
    &["simulation"],
    &["scenario"],
    &["planning"],
    &["runtime"],
    &["tests"],
];
/// Modules of one row of which one serves the other.
const BESIDE: &[[&str; 2]] = &[["robot", "testing"], ["testing", "robot"]];

/// A longer file answers more than one question.
const LONGEST: usize = 600;

fn floor(module: &str) -> Option<usize> {
    FLOORS.iter().position(|row| row.contains(&module))
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { sources(&path) } else { vec![path] }).collect()
}

/// The modules of the core that a line of code names after `crate::`.
fn named(line: &str) -> impl Iterator<Item = &str> {
    let code = line.split("//").next().unwrap_or_default();
    let ends = |c: char| !c.is_alphanumeric() && c != '_';
    code.split("crate::").skip(1).map(move |rest| rest.split(ends).next().unwrap_or_default())
}

#[test]
fn arrows_run_one_way() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let (mut wrong, mut seen) = (vec![], 0);
    for path in sources(&root) {
        let inner = path.strip_prefix(&root).unwrap().with_extension("");
        let from = inner.iter().next().unwrap().to_str().unwrap();
        if from == "lib" || path.extension().is_none_or(|extension| extension != "rs") {
            continue;
        }
        let own = floor(from).unwrap_or_else(|| panic!("{from} is on no floor of this test"));
        for (number, line) in (1..).zip(fs::read_to_string(&path).unwrap().lines()) {
            assert!(!line.contains("crate::{"), "{path:?}:{number}: a `use` of one module a line");
            for to in named(line).filter(|to| *to != from) {
                seen += 1;
                // What is no module is exported by `lib.rs`, which exports nothing.
                let below = floor(to).is_some_and(|floor| floor < own);
                if !below && !BESIDE.contains(&[from, to]) {
                    wrong.push(format!("{}:{number}: {from} → {to}", inner.display()));
                }
            }
        }
    }
    assert!(seen > 500, "only {seen} arrows were found");
    assert!(wrong.is_empty(), "arrows back up:\n{}", wrong.join("\n"));
}

#[test]
fn no_file_is_long() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let every =
        ["vff-core", "vff-python", "vff-c"].map(|name| sources(&crates.join(name).join("src")));
    let mut seen = 0;
    for path in every.iter().flatten().filter(|path| path.extension().is_some_and(|e| e == "rs")) {
        let lines = fs::read_to_string(path).unwrap().lines().count();
        assert!(lines <= LONGEST, "{}: {lines} lines", path.display());
        seen += 1;
    }
    assert!(seen > 200, "only {seen} files were found");
}
