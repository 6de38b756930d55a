//! The command line of gearwatch. The program is [`dispatch`] and an allocator; everything else is
//! in the crates below.
//!
//! ```text
//! arguments ─► dispatch ─► a command (commands/NAME.rs): open files ─► crates below ─► text or JSON ─► standard output
//!                              │                                                          └ CSV, MCAP, pictures ─► files
//!                              └ exit code: 0 done, 1 warning, 2 critical, 3 unknown or wrong input, 70 start anew
//! ```
//!
//! Parts that watching one bench does not need are cargo features. A command that a build has left
//! out stays in the help and says which feature it needs.
//!
//! ```
//! use std::process::ExitCode;
//!
//! let said = gearwatch::dispatch(["gearwatch", "list", "sources"].map(Into::into));
//! assert_eq!(format!("{said:?}"), format!("{:?}", ExitCode::SUCCESS));
//! let wrong = gearwatch::dispatch(["gearwatch", "list", "nothing"].map(Into::into));
//! assert_eq!(format!("{wrong:?}"), format!("{:?}", ExitCode::from(3)));
//! ```

mod commands;
mod exit;
mod format;
mod input;
mod memory;
mod output;
mod page;
mod progress;
mod serve;
mod signals;
mod talk;
mod terminal;

pub use commands::dispatch;
