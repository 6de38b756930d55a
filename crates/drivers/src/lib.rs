//! C libraries of data acquisition, loaded when a source that needs them is opened: a program that
//! was built without them runs with them, and one that has none of them says which one it misses.
//!
//! ```text
//! gearwatch-sources, kind `nidaqmx` ─► nidaqmx::Acquisition ─► libnidaqmx.so.1, nicaiu.dll   (National Instruments)
//! gearwatch-sources, kind `iio`     ─► iio::Acquisition     ─► libiio.so.0, libiio.dll       (Analog Devices, Debian: libiio0)
//! ```
//!
//! All unsafe code of gearwatch is here. A type owns its handles, passes no pointer on, and frees
//! them when it is dropped; a name with a zero byte never reaches C.
//!
//! A library that is missing is an error that names it and says what to do:
//!
//! ```
//! use gearwatch_drivers::DriverError;
//! use gearwatch_drivers::nidaqmx::Acquisition;
//!
//! let nowhere = std::path::Path::new("/nowhere/libnidaqmx.so.1");
//! let Err(missing) = Acquisition::start(Some(nowhere), &[], 25_600.0) else { unreachable!() };
//! assert!(matches!(missing, DriverError::Load(_)));
//! assert!(missing.to_string().starts_with("NI-DAQmx cannot be used"), "{missing}");
//! ```
#![allow(unsafe_code, reason = "calls into C libraries")]

pub mod iio;
mod library;
pub mod nidaqmx;

pub use library::LoadError;

use std::ffi::{CStr, CString, c_char};

/// What a C library said.
#[derive(Debug, thiserror::Error)]
pub enum DriverError {
    /// The library is not there, or another one.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// A call failed.
    #[error("{call}: {message}")]
    Call {
        /// The function of the library.
        call: &'static str,
        /// The library's own words, with its number.
        message: String,
        /// The library's own number.
        code: i64,
    },
    /// A device, channel or rate that is not there.
    #[error("{0}")]
    Absent(String),
}

fn c_text(text: &str) -> Result<CString, DriverError> {
    CString::new(text).map_err(|_| DriverError::Absent(format!("{text:?} holds a zero byte")))
}

/// The text in a buffer that C has filled, to its zero byte.
fn from_buffer(buffer: &[u8]) -> String {
    CStr::from_bytes_until_nul(buffer).map(|text| text.to_string_lossy().trim().to_owned()).unwrap_or_default()
}

/// A text that belongs to the library; empty where there is none.
///
/// # Safety
/// `text` is null or a text that ends with a zero byte and lives during the call.
unsafe fn from_library(text: *const c_char) -> String {
    if text.is_null() {
        return String::new();
    }
    // SAFETY: not null; the caller vouches for the rest.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}
