//! The thread sanitizer sees no race in the mailbox, and sees one where its memory orders are weakened.
//!
//! It is built into rustc, but only offered to nightly ones: `RUSTC_BOOTSTRAP` opens it. As the mailbox depends on nothing, it
//! is compiled alone, with a program that exchanges values between threads; the standard library is not instrumented.
#![cfg(all(target_os = "linux", target_arch = "x86_64"))]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// What the sanitizer says of the program with this mailbox; nothing if it is content.
fn races(name: &str, mailbox: &str) -> String {
    let folder =
        PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let source = include_str!("exchange.rs");
    fs::write(folder.join("mailbox.rs"), mailbox).unwrap();
    fs::write(folder.join("main.rs"), source).unwrap();
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let compiled = Command::new(rustc)
        .env("RUSTC_BOOTSTRAP", "1")
        .args(["--edition=2024", "-O", "-g", "-Zsanitizer=thread"])
        .args(["-Cunsafe-allow-abi-mismatch=sanitizer", "--target=x86_64-unknown-linux-gnu", "-o"])
        .args([folder.join("exchange"), folder.join("main.rs")])
        .output()
        .unwrap();
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let done =
        Command::new(folder.join("exchange")).env("TSAN_OPTIONS", "exitcode=66").output().unwrap();
    fs::remove_dir_all(&folder).unwrap();
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    match done.status.code() {
        Some(0) => String::new(),
        Some(66) => said,
        _ => panic!("the program itself failed: {:?}\n{said}", done.status),
    }
}

#[test]
fn exchanges_have_no_race() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/mailbox.rs");
    let mailbox = fs::read_to_string(path).unwrap();
    assert_eq!(races("mailbox", &mailbox), "");
    for (place, weaker) in [
        ("self.sent.swap(node, AcqRel)", "self.sent.swap(node, Relaxed)"),
        (
            "compare_exchange_weak(head, node, Release, Relaxed)",
            "compare_exchange_weak(head, node, Relaxed, Relaxed)",
        ),
    ] {
        assert!(mailbox.contains(place));
        let said = races("weaker", &mailbox.replace(place, weaker));
        assert!(said.contains("data race"), "not seen: {weaker}");
    }
}
