//! Which library this is.

use std::ffi::c_char;

/// Number of the binary interface. It changes when a program has to be compiled again.
pub const VFF_ABI_VERSION: u32 = 1;

/// `VFF_ABI_VERSION` of the library that is loaded: compare it with that of the header.
#[unsafe(no_mangle)]
pub extern "C" fn vff_abi_version() -> u32 {
    VFF_ABI_VERSION
}

/// The version of vffnull, such as "0.1.0".
#[unsafe(no_mangle)]
pub extern "C" fn vff_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}
