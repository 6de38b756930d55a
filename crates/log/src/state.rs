//! How the log stands, for the service's health.

use std::io;

use serde::Serialize;

/// Whether records become durable.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "log", content = "why")]
pub enum Condition {
    /// They do.
    #[default]
    Ok,
    /// `LOG_FULL`: the disk is full. Ranks go on, the log goes on by itself when there is space
    /// again, what is lost meanwhile is counted.
    Full,
    /// The disk fails otherwise; it is tried again twice a second.
    Failed(String),
    /// The log has been closed.
    Stopped,
}

impl Condition {
    pub(crate) fn of(error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => Self::Full,
            _ => Self::Failed(error.to_string()),
        }
    }
}

/// How the log stands.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LogState {
    /// Whether records become durable.
    #[serde(flatten)]
    pub condition: Condition,
    /// Everything up to this sequence number survives a power cut.
    pub durable_seq: u64,
    /// Records of any kind that were shed since the start.
    pub unlogged_records: u64,
    /// Verdicts among them.
    pub unlogged_windows: u64,
    /// Raw packets that were shed, had no room in the buffer before a deviation, or cannot be put
    /// into a recording.
    pub unlogged_raw: u64,
    /// The file that is being written; empty where there is none.
    pub file: String,
    /// Its durable length (bytes).
    pub file_bytes: u64,
    /// Files removed since the start because they were too old or too much.
    pub files_removed: u64,
    /// Writes that failed since the start: groups that could not be made durable at the first try.
    pub write_failures: u64,
    /// Files that somebody removed, replaced or cut while they were written; what was acknowledged
    /// in them is a gap.
    pub files_lost: u64,
}
