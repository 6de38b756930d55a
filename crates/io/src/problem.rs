//! Why a file cannot be read: where, what was expected, what was found, and what to do about it.

use std::path::{Path, PathBuf};

/// What is wrong with the bytes, without the name of the file: parsers are functions over bytes and
/// know no names.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The system could not deliver the bytes.
    #[error("cannot be read: {0}")]
    Io(#[source] std::io::Error),
    /// The bytes contradict the format or their own checksum.
    #[error("damaged at {place}: expected {expected}, found {found}")]
    Damaged {
        /// Byte offset, line, record or channel.
        place: String,
        /// What the format asks for there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The file is whole, but holds something that this program does not read.
    #[error("{what} is not supported; {instead}")]
    Unsupported {
        /// What was met.
        what: String,
        /// What is supported, or how to get on.
        instead: String,
    },
    /// The file does not say something that is needed.
    #[error("{what} is not known from the file; give it with {option}")]
    Missing {
        /// What is needed.
        what: String,
        /// The flag or sidecar key that gives it.
        option: String,
    },
    /// An option does not fit the file.
    #[error("{option}: {message}")]
    Option {
        /// The flag or sidecar key.
        option: String,
        /// What does not fit, and what the file holds.
        message: String,
    },
    /// The file asks for more memory or work than any real recording needs.
    #[error("refused at {place}: {what} is above the limit of {limit}")]
    Limit {
        /// Byte offset, line, record or channel.
        place: String,
        /// What is too large, with its size.
        what: String,
        /// The bound, with its unit.
        limit: String,
    },
    /// The file is whole and holds nothing to read.
    #[error("holds no vibration data: {0}")]
    Empty(String),
}

impl From<std::io::Error> for Problem {
    /// A problem that came through a reader is the problem itself.
    fn from(error: std::io::Error) -> Self {
        error.downcast::<Self>().unwrap_or_else(Self::Io)
    }
}

impl Problem {
    /// Shorthand for [`Problem::Damaged`].
    pub(crate) fn damaged(
        place: impl std::fmt::Display,
        expected: impl std::fmt::Display,
        found: impl std::fmt::Display,
    ) -> Self {
        Self::Damaged { place: place.to_string(), expected: expected.to_string(), found: found.to_string() }
    }

    /// Shorthand for [`Problem::Unsupported`].
    pub(crate) fn unsupported(what: impl std::fmt::Display, instead: impl std::fmt::Display) -> Self {
        Self::Unsupported { what: what.to_string(), instead: instead.to_string() }
    }

    /// Shorthand for [`Problem::Limit`].
    pub(crate) fn limit(
        place: impl std::fmt::Display,
        what: impl std::fmt::Display,
        limit: impl std::fmt::Display,
    ) -> Self {
        Self::Limit { place: place.to_string(), what: what.to_string(), limit: limit.to_string() }
    }

    /// Shorthand for [`Problem::Missing`].
    pub(crate) fn missing(what: impl std::fmt::Display, option: impl std::fmt::Display) -> Self {
        Self::Missing { what: what.to_string(), option: option.to_string() }
    }

    /// Shorthand for [`Problem::Option`].
    pub(crate) fn option(option: impl std::fmt::Display, message: impl std::fmt::Display) -> Self {
        Self::Option { option: option.to_string(), message: message.to_string() }
    }

    /// Names the file.
    pub fn in_file(self, path: &Path) -> ReadError {
        ReadError { path: path.to_owned(), problem: self }
    }
}

/// Why a file cannot be read, with its name.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct ReadError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: Problem,
}
