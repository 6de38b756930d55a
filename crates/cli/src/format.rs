//! Forms of what commands say.

use clap::ValueEnum;

/// Text for people or JSON for programs.
#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people
    #[default]
    Text,
    /// For programs
    Json,
}
