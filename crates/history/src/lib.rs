//! What the service's logs say over time: windows put together by spans, and what happened.
//!
//! ```text
//! log files ─┬─► History ─► spans, events, hours, alarms ─► `gearwatch history`, weekly report
//!            │      ⇅
//!            ├─► Levels: closed files by 2 min to a day, in one SQLite file beside them
//!            │      ↓
//!            └─► Store: what no level holds is read in the background ─► page
//! ```
//!
//! - The log files stay the truth and are only read. Levels are made from them, and made again
//!   where their file is lost.
//! - A damaged file counts as far as it can be read; what could not be read is told.
//! - What is kept in memory has bounds: rows, events, cells of a page.
//!
//! An answer has as many points as somebody can see:
//!
//! ```
//! use gearwatch_history::{Asked, time};
//!
//! let row = ("bench".to_owned(), "stage1".to_owned(), "acc_1".to_owned());
//! let (from, to) = (time::parse("2026-11-15")?, time::parse("2026-11-22")?);
//! let week = Asked { row, from, to, indicator: String::new() };
//! assert_eq!(week.every(), time::parse_span("10m")?);
//! # Ok::<(), gearwatch_history::time::TimeError>(())
//! ```

use std::io;
use std::path::{Path, PathBuf};

mod collect;
mod extent;
mod glance;
mod keep;
mod levels;
mod raw;
#[cfg(test)]
mod sample;
mod span;
mod spectra;
mod store;
pub mod time;
mod verdict_line;

pub use collect::{Event, History, HistoryError, Key};
pub use keep::{KeepError, Keeping, keep_levels, take_closed};
pub use levels::{Levels, LevelsError};
pub use raw::{Cut, CutError, Waveform};
pub use span::{STATES, Span};
pub use spectra::Spectrum;
pub use store::{Asked, Sight, Store};
pub use verdict_line::indicator_names;

/// The files of a log folder in the order of their names, which is that of their numbers.
///
/// # Errors
/// When the folder cannot be listed.
pub fn files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let is_log = |path: &Path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("gearwatch-") && name.ends_with(".mcap")
    };
    let mut out = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if is_log(&path) {
            out.push(path);
        }
    }
    out.sort();
    Ok(out)
}
