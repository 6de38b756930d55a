//! The command line of gearwatch. The program is [`dispatch`] and an allocator; everything else is in the crates below.
//!
//! Parts that watching one bench does not need are cargo features. A command that a build has left out stays in the help and says which feature
//! it needs.

mod commands;
mod exit;
mod format;
mod input;
mod output;
mod page;
mod progress;
mod serve;
mod signals;
mod talk;
mod terminal;

pub use commands::dispatch;
