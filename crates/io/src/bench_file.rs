//! Bench files: TOML text to [`Bench`], with errors that name file, line and what would be right.

use std::path::{Path, PathBuf};

use gearwatch_core::bench::Bench;

/// Why a bench file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BenchFileError {
    /// The file cannot be read.
    #[error("{path}: cannot be read: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not TOML, or has an unknown, missing or mistyped key.
    #[error("{path}: {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What was expected and found, with line and column.
        message: String,
    },
    /// The values contradict physics or each other.
    #[error("{path}: {}", problems.join("; "))]
    Values {
        /// The file.
        path: PathBuf,
        /// One sentence each.
        problems: Vec<String>,
    },
}

/// Reads and checks a bench file.
///
/// # Errors
/// When it cannot be read, is not in the format, or its values cannot be right.
pub fn read(path: &Path) -> Result<Bench, BenchFileError> {
    let text =
        std::fs::read_to_string(path).map_err(|source| BenchFileError::Read { path: path.to_owned(), source })?;
    parse(&text, path)
}

/// Parses and checks the text of a bench file; `path` is named in errors.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, path: &Path) -> Result<Bench, BenchFileError> {
    let bench: Bench = toml::from_str(text)
        .map_err(|e| BenchFileError::Syntax { path: path.to_owned(), message: e.to_string().trim_end().to_owned() })?;
    let problems = bench.problems();
    if problems.is_empty() { Ok(bench) } else { Err(BenchFileError::Values { path: path.to_owned(), problems }) }
}
