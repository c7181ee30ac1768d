//! The name by which programs find the shared library: it has the number of the binary interface.

use std::env;

fn main() {
    println!("cargo::rerun-if-changed=src/version.rs");
    let version = include_str!("src/version.rs");
    let (_, after) =
        version.split_once("VFF_ABI_VERSION: u32 = ").expect("src/version.rs names it");
    let abi = after.split(';').next().unwrap_or_default();
    match env::var("CARGO_CFG_TARGET_OS").as_deref() {
        Ok("macos") => {
            println!(
                "cargo::rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libvffnull.{abi}.dylib"
            );
        }
        Ok("linux") => println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libvffnull.so.{abi}"),
        _ => {}
    }
}
