//! Every public type is in an example that runs, its own or that of what it belongs to.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { sources(&path) } else { vec![path] }).collect()
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

/// The lines of the examples that run, of a file.
fn examples(text: &str) -> Vec<&str> {
    let (mut found, mut fence) = (vec![], None);
    for line in text.lines().map(str::trim_start) {
        let comment = line.strip_prefix("///").or_else(|| line.strip_prefix("//!"));
        let Some(comment) = comment.map(str::trim_start) else { continue };
        match (comment.strip_prefix("```"), fence) {
            (Some(language), None) => fence = Some(language.is_empty()),
            (Some(_), Some(_)) => fence = None,
            (None, Some(true)) => found.push(comment),
            (None, _) => {}
        }
    }
    assert!(fence.is_none(), "an example without an end");
    found
}

/// The type that a line declares for everybody.
fn declared(line: &str) -> Option<&str> {
    ["struct", "enum", "trait", "type"].iter().find_map(|kind| {
        let rest = line.trim_start().strip_prefix("pub ")?.strip_prefix(kind)?.strip_prefix(' ')?;
        words(rest).next().filter(|_| !rest.starts_with('$')) // a macro's
    })
}

/// Whether everybody can name the modules down to this file.
fn is_open(file: &Path, root: &Path) -> bool {
    let inner = file.strip_prefix(root).unwrap().with_extension("");
    let names: Vec<_> =
        inner.iter().map(|name| name.to_str().unwrap()).filter(|name| *name != "mod").collect();
    (0..names.len()).all(|depth| {
        let above = names[..depth].iter().fold(root.to_path_buf(), |path, name| path.join(name));
        let homes = [above.join("mod.rs"), above.with_extension("rs"), above.join("lib.rs")];
        let declares =
            |text: String| text.lines().any(|l| l == format!("pub mod {};", names[depth]));
        homes.iter().any(|home| fs::read_to_string(home).is_ok_and(declares))
    })
}

#[test]
fn every_public_type_is_in_an_example() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let files: Vec<_> = sources(&root)
        .into_iter()
        .filter(|path| path.extension().is_some_and(|extension| extension == "rs"))
        .map(|path| (fs::read_to_string(&path).unwrap(), path))
        .collect();
    let shown: BTreeSet<&str> =
        files.iter().flat_map(|(text, _)| examples(text)).flat_map(words).collect();
    let exports: Vec<BTreeSet<&str>> = files
        .iter()
        .flat_map(|(text, _)| text.split("\npub use ").skip(1))
        .map(|rest| words(rest.split(';').next().unwrap_or_default()).collect())
        .collect();
    let (mut counted, mut silent) = (0, vec![]);
    for (text, path) in &files {
        let open = is_open(path, &root);
        let module = path.with_extension("");
        let module = if module.ends_with("mod") { module.parent().unwrap() } else { &module };
        let module = module.file_name().unwrap().to_str().unwrap();
        let exported = |name: &str| exports.iter().any(|e| e.contains(name) && e.contains(module));
        let code = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
        for name in code.lines().filter_map(declared).filter(|n| open || exported(n)) {
            counted += 1;
            if !shown.contains(name) {
                silent.push(format!("{}: {name}", path.strip_prefix(&root).unwrap().display()));
            }
        }
    }
    assert!(counted > 250, "only {counted} types were found");
    assert!(
        silent.is_empty(),
        "{} of {counted} in no example:\n{}",
        silent.len(),
        silent.join("\n")
    );
}
