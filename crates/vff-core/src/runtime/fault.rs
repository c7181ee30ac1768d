//! A panic is a fault of the program, and a sentence for whoever waits for the result.

use crate::interrupt::Interrupted;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// The result of `f`, or what it said when it panicked.
pub(super) fn guarded<T>(f: impl FnOnce() -> T) -> Result<T, String> {
    let text = |panic: Box<dyn Any + Send>| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
        format!("a fault of vffnull itself, please report it: {text}")
    };
    catch_unwind(AssertUnwindSafe(f)).map_err(|panic| match panic.is::<Interrupted>() {
        true => resume_unwind(panic),
        false => text(panic),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With or without formatted text.
    #[test]
    fn panics_are_told() {
        let fault = guarded(|| assert_eq!(1, 2, "{}", "numbers")).unwrap_err();
        assert!(fault.contains("report it") && fault.contains("numbers"), "{fault}");
        assert!(guarded(|| panic!("plain")).unwrap_err().ends_with("plain"));
    }
}
