//! What can be wrong with a question to the mismatch finder.

use thiserror::Error;

/// Why recordings and bench file cannot be compared at all.
#[derive(Debug, Error)]
pub enum ExplainError {
    /// The values of the bench file contradict each other.
    #[error("the bench file cannot be used: {0}")]
    Bench(String),
    /// The bench has gears that the simulator does not know.
    #[error("{0}")]
    Beyond(String),
    /// There is nothing to judge.
    #[error("there is no recording to explain; name MCAP files or a folder that holds some")]
    NoRecording,
    /// None of the recordings can be judged.
    #[error("none of the {count} recordings can be judged. {reasons}")]
    NothingUsable {
        /// How many were given.
        count: usize,
        /// One sentence each.
        reasons: String,
    },
    /// A reference was given, and none of its recordings can be judged: nothing can be said to be
    /// as before.
    #[error(
        "none of the {count} recordings of the reference can be judged; give others, or leave the reference out. {reasons}"
    )]
    NoReference {
        /// How many were given.
        count: usize,
        /// One sentence each.
        reasons: String,
    },
}

impl ExplainError {
    /// The question was right, and the recordings do not answer it.
    pub fn is_not_judged(&self) -> bool {
        matches!(self, Self::NothingUsable { .. } | Self::NoReference { .. })
    }
}
