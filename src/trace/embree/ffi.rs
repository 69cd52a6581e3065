//! Functions that return or receive a value that the library chooses, declared with integers:
//! a Rust enum that met a number it does not know would be undefined behaviour.

use std::cell::RefCell;
use std::ffi::{CStr, c_char, c_void};

use embree4_sys as sys;

use crate::trace::error::Code;

/// `RTCErrorFunction`, the code as an integer.
type ErrorFunction = unsafe extern "C" fn(*mut c_void, u32, *const c_char);

unsafe extern "C" {
    /// The first error of this thread on this device since the last call; a null device asks for
    /// the error of a failed `rtcNewDevice`.
    pub(super) fn rtcGetDeviceError(device: sys::RTCDevice) -> u32;

    /// The function is called by the thread in which the error happens.
    pub(super) fn rtcSetDeviceErrorFunction(
        device: sys::RTCDevice,
        function: Option<ErrorFunction>,
        user: *mut c_void,
    );
}

thread_local! {
    /// The first error of this thread that nobody has taken yet.
    static ERROR: RefCell<Option<(Code, String)>> = const { RefCell::new(None) };
}

/// Keeps the first error of the calling thread for [`take_error`].
///
/// # Safety
/// Called by Embree with a message that is null or ends with a NUL.
pub(super) unsafe extern "C" fn keep_error(_: *mut c_void, code: u32, message: *const c_char) {
    let message = if message.is_null() {
        String::new()
    } else {
        // SAFETY: not null, and Embree passes `std::string::c_str()` that outlives this call.
        unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned()
    };
    // A thread that is ending has no slot any more; then there is nobody to tell.
    let _ = ERROR.try_with(|slot| {
        if let Ok(mut slot) = slot.try_borrow_mut() {
            slot.get_or_insert((Code(code), message));
        }
    });
}

/// The first error of this thread since the last call.
pub(super) fn take_error() -> Option<(Code, String)> {
    ERROR.with(RefCell::take)
}
