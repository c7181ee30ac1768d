//! `vffnull.h` is what cbindgen makes of the sources. `UPDATE_HEADER=1` writes it.

use std::fs;
use std::path::Path;

#[test]
fn the_header_is_that_of_the_sources() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(root.join("cbindgen.toml")).unwrap();
    let mut sources = cbindgen::Builder::new().with_config(config);
    for name in [
        "version",
        "status",
        "ffi_guard",
        "robot",
        "kinematics",
        "controller",
        "cycle",
        "succession",
        "set_points",
        "terms",
        "obstacles",
        "cloud",
        "perceiver",
    ] {
        sources = sources.with_src(root.join("src").join(name).with_extension("rs"));
    }
    let mut made = vec![];
    sources.generate().unwrap().write(&mut made);
    let (path, made) = (root.join("include/vffnull.h"), String::from_utf8(made).unwrap());
    if std::env::var_os("UPDATE_HEADER").is_some() {
        fs::write(&path, &made).unwrap();
    }
    let committed = fs::read_to_string(&path).unwrap();
    assert!(
        committed == made,
        "include/vffnull.h is not that of the sources: UPDATE_HEADER=1 cargo test -p vff-c --release --test header"
    );
}
