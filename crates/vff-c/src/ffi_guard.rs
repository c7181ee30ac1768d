//! Every call: no panic leaves, and a fault becomes a status and a message.

use crate::status::{Fault, Status};
use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, c_char};
use std::fmt::{self, Write};
use std::marker::PhantomData;
use std::mem::MaybeUninit;
use std::panic::{self, AssertUnwindSafe};
use std::slice;

/// The longest message \[bytes\], with its end.
const LONGEST: usize = 1024;

/// A sentence that ends with 0. It has its place from the beginning: telling a fault does not allocate.
struct Message {
    bytes: [u8; LONGEST],
    length: usize,
}

thread_local! {
    static MESSAGE: RefCell<Message> = const { RefCell::new(Message { bytes: [0; LONGEST], length: 0 }) };
}

impl Write for Message {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let room = LONGEST - 1 - self.length;
        let end = (0..=text.len().min(room)).rev().find(|end| text.is_char_boundary(*end));
        // A 0 within, which file names and TOML may hold, would end it.
        for byte in text[..end.unwrap_or(0)].bytes().filter(|byte| *byte != 0) {
            self.bytes[self.length] = byte;
            self.length += 1;
        }
        self.bytes[self.length] = 0;
        Ok(())
    }
}

/// The sentence of the last fault of the calling thread; empty if there was none. It is valid until the next one.
#[unsafe(no_mangle)]
pub extern "C" fn vff_last_message() -> *const c_char {
    MESSAGE.with_borrow(|message| message.bytes.as_ptr().cast())
}

fn tell(fault: &Fault) {
    MESSAGE.with_borrow_mut(|message| {
        message.length = 0;
        let _ = write!(message, "{fault}");
    });
}

fn said(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(ToString::to_string);
    text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default()
}

/// Does the work of one call.
pub(crate) fn guarded(work: impl FnOnce() -> Result<(), Fault>) -> Status {
    // What a panic leaves behind is not used again: see `Controller::with`. Other objects do not change.
    let done = panic::catch_unwind(AssertUnwindSafe(work));
    match done.unwrap_or_else(|payload| Err(Fault::Panic(said(&*payload)))) {
        Ok(()) => Status::Ok,
        Err(fault) => {
            tell(&fault);
            fault.status()
        }
    }
}

/// What a pointer points to.
///
/// # Safety
/// It is NULL or points to a `T` that lives as long as the call and is not changed meanwhile.
pub(crate) unsafe fn object<'a, T>(name: &'static str, object: *const T) -> Result<&'a T, Fault> {
    // SAFETY: as the caller promises.
    unsafe { object.as_ref() }.ok_or(Fault::Null(name))
}

/// Where a result is to be written.
///
/// # Safety
/// It is NULL or points to room for a `T` that nobody else uses meanwhile.
pub(crate) unsafe fn place<'a, T>(
    name: &'static str,
    place: *mut T,
) -> Result<&'a mut MaybeUninit<T>, Fault> {
    // SAFETY: as the caller promises; what is there may be unwritten.
    unsafe { place.cast::<MaybeUninit<T>>().as_mut() }.ok_or(Fault::Null(name))
}

/// Takes an object back that was handed out by `Box::into_raw`, and drops it.
///
/// # Safety
/// It is NULL or was handed out so, and is not used again.
pub(crate) unsafe fn free<T>(object: *mut T) {
    guarded(|| {
        if !object.is_null() {
            // SAFETY: as the caller promises.
            drop(unsafe { Box::from_raw(object) });
        }
        Ok(())
    });
}

/// So many numbers, all of them finite.
///
/// # Safety
/// As [`any_numbers`].
pub(crate) unsafe fn numbers<'a>(
    name: &'static str,
    data: *const f64,
    given: usize,
    expected: usize,
) -> Result<&'a [f64], Fault> {
    // SAFETY: as the caller promises.
    let values = unsafe { any_numbers(name, data, given, expected) }?;
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(Fault::NotFinite { name, index, value: values[index] }),
        None => Ok(values),
    }
}

/// So many numbers, finite or not.
///
/// # Safety
/// It is NULL or points to `given` numbers that live as long as the call and are not changed meanwhile.
pub(crate) unsafe fn any_numbers<'a>(
    name: &'static str,
    data: *const f64,
    given: usize,
    expected: usize,
) -> Result<&'a [f64], Fault> {
    if data.is_null() {
        return Err(Fault::Null(name));
    }
    if given != expected {
        return Err(Fault::Length { name, expected, given });
    }
    // SAFETY: as the caller promises; NULL was refused.
    Ok(unsafe { slice::from_raw_parts(data, given) })
}

/// Room for so many numbers.
///
/// # Safety
/// It is NULL or points to room for `given` numbers that nobody else uses meanwhile.
pub(crate) unsafe fn room<'a>(
    name: &'static str,
    data: *mut f64,
    given: usize,
    expected: usize,
) -> Result<Room<'a>, Fault> {
    if data.is_null() {
        return Err(Fault::Null(name));
    }
    if given != expected {
        return Err(Fault::Length { name, expected, given });
    }
    Ok(Room { data, length: given, lives: PhantomData })
}

/// Room for numbers that may hold none yet.
pub(crate) struct Room<'a> {
    data: *mut f64,
    length: usize,
    lives: PhantomData<&'a mut [f64]>,
}

impl<'a> Room<'a> {
    /// The numbers themselves, all 0 at first.
    pub(crate) fn zeroed(self) -> &'a mut [f64] {
        let Self { data, length, .. } = self;
        (0..length).for_each(|i| {
            // SAFETY: there is room for `length` numbers that nobody else uses.
            unsafe { data.add(i).write(0.0) }
        });
        // SAFETY: they are written, and nobody else uses them.
        unsafe { slice::from_raw_parts_mut(data, length) }
    }

    /// Writes as many numbers as there is room for.
    pub(crate) fn fill(self, values: &[f64]) {
        assert_eq!(values.len(), self.length);
        // SAFETY: there is room for so many, which nobody else uses, so that they do not overlap.
        unsafe { self.data.copy_from_nonoverlapping(values.as_ptr(), self.length) };
    }

    /// Writes the same number everywhere.
    pub(crate) fn fill_with(self, value: f64) {
        for i in 0..self.length {
            // SAFETY: there is room for `length` numbers that nobody else uses.
            unsafe { self.data.add(i).write(value) };
        }
    }
}

/// A text.
///
/// # Safety
/// It is NULL or points to bytes that end with 0, live as long as the call and are not changed meanwhile.
pub(crate) unsafe fn text<'a>(name: &'static str, text: *const c_char) -> Result<&'a str, Fault> {
    if text.is_null() {
        return Err(Fault::Null(name));
    }
    // SAFETY: as the caller promises; NULL was refused.
    unsafe { CStr::from_ptr(text) }.to_str().map_err(|_| Fault::NotText { name })
}
