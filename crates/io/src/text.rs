//! Files with text that people or this program wrote: bench files, sidecars, baselines. Regular
//! files only, of bounded size.

use std::fs::File;
use std::io::{Error, ErrorKind, Read};
use std::path::Path;

use crate::output::other_than_a_file;

/// Largest text file that is read (bytes).
pub const LARGEST_TEXT: u64 = 64 << 20;

/// Opens a regular file. A pipe or a device is refused before it is opened: opening one may wait
/// for ever.
///
/// # Errors
/// When there is none, it is no regular file, or it may not be read.
pub fn open_regular(path: &Path) -> std::io::Result<File> {
    let check = |there: std::fs::Metadata| match other_than_a_file(&there) {
        Some(what) => Err(Error::new(ErrorKind::InvalidInput, format!("it is {what}, not a regular file"))),
        None => Ok(()),
    };
    check(std::fs::metadata(path)?)?;
    let file = File::open(path)?;
    // Another file may have taken the name in the meantime.
    check(file.metadata()?)?;
    Ok(file)
}

/// The text of a regular file of at most [`LARGEST_TEXT`] bytes.
///
/// # Errors
/// When it cannot be read, is no regular file, is larger, or is not UTF-8.
pub fn read_text(path: &Path) -> std::io::Result<String> {
    let mut text = String::new();
    open_regular(path)?.take(LARGEST_TEXT + 1).read_to_string(&mut text)?;
    if text.len() as u64 > LARGEST_TEXT {
        let limit = LARGEST_TEXT >> 20;
        return Err(Error::new(
            ErrorKind::FileTooLarge,
            format!("it is above the limit of {limit} MiB for a text file"),
        ));
    }
    Ok(text)
}
