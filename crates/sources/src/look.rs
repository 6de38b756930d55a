//! What a recording shows, before anything of it is judged.

use std::path::Path;

use gearwatch_check::Look;
use gearwatch_core::source::Source;
use gearwatch_io::{OpenOptions, ReadError};

/// Looks at a recording: its first half minute.
///
/// # Errors
/// As [`gearwatch_io::open()`], and when what is looked at is damaged.
pub fn look(path: &Path, options: &OpenOptions) -> Result<Look, ReadError> {
    let mut look = Look::new(&name_of(path));
    let mut opened = gearwatch_io::open(path, options)?;
    while let Some(packet) = opened.next_packet()? {
        look.push(&packet);
        if look.is_full() {
            break;
        }
    }
    Ok(look)
}

/// The name by which findings speak of a recording.
pub fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
