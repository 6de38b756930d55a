//! Fingerprints of files.

use std::io;
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::text::open_regular;

/// SHA-256 of a file, lower-case hexadecimal.
///
/// # Errors
/// When the file cannot be read; the error does not name it.
pub fn sha256_of_file(path: &Path) -> io::Result<String> {
    let mut hasher = Sha256::new();
    io::copy(&mut open_regular(path)?, &mut hasher)?;
    Ok(hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}
