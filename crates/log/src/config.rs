//! What a user may set of the log.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// The log: where, how often durable, how long kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LogConfig {
    /// Folder of the log files; one service owns it.
    pub folder: PathBuf,
    /// Longest time that a record waits to be made durable (ms, 1–10000).
    pub group_ms: u64,
    /// Bytes of results that are made durable at once at the latest (1–16 MiB).
    pub group_bytes: usize,
    /// Bytes of raw data that are made durable at once at the latest (1–32 MiB).
    pub raw_group_bytes: usize,
    /// A new file begins when one has grown to this (bytes, 4 KiB–1 GiB).
    pub rotate_bytes: u64,
    /// A new file begins when one is this old (s).
    pub rotate_secs: u64,
    /// Oldest files are removed when all together take more than this (bytes).
    pub keep_bytes: u64,
    /// Files since whose beginning the log has been written for longer than this are removed (s).
    /// What counts is the time in which the service ran, not the date: a clock that is set wrong
    /// for a moment removes nothing.
    pub keep_secs: u64,
    /// Results that may wait for the disk; beyond it they are shed and counted.
    pub queue_records: usize,
    /// Raw data that may wait for the disk (bytes); beyond it they are shed and counted.
    pub raw_queue_bytes: usize,
    /// Compression of the files.
    pub compression: Compression,
    /// Which raw data are kept.
    pub raw: RawPolicy,
    /// An order spectrum of each channel is kept so often (s of the data's time, 1–86400); 0:
    /// never.
    pub spectra_secs: f64,
}

impl Default for LogConfig {
    fn default() -> Self {
        Self {
            folder: PathBuf::from("gearwatch-log"),
            group_ms: 200,
            group_bytes: 64 << 10,
            raw_group_bytes: 4 << 20,
            rotate_bytes: 64 << 20,
            rotate_secs: 3600,
            keep_bytes: 20 << 30,
            keep_secs: 400 * 86_400,
            queue_records: 16_384,
            raw_queue_bytes: 64 << 20,
            compression: Compression::Zstd,
            raw: RawPolicy::Off,
            spectra_secs: 60.0,
        }
    }
}

/// How chunks are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Compression {
    /// Not at all.
    None,
    /// Zstandard, level 1: a fifth of the size for results, nine tenths for raw data.
    Zstd,
}

/// Which raw data are kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case", tag = "keep", deny_unknown_fields)]
pub enum RawPolicy {
    /// None.
    Off,
    /// All.
    All,
    /// Those around a deviation.
    AroundDeviations {
        /// Rank from which on a harmonic counts as a deviation (1–5 for I–V).
        level: i8,
        /// How much before the window is kept (s).
        before_secs: f64,
        /// How much after the window is kept (s).
        after_secs: f64,
        /// Memory for what may still be wanted (bytes).
        buffer_bytes: usize,
    },
}

/// A setting that cannot be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("log.{key}: {found} is not {expected}")]
pub struct ConfigError {
    /// Which setting.
    pub key: &'static str,
    /// What stands there.
    pub found: String,
    /// What may stand there.
    pub expected: &'static str,
}

impl LogConfig {
    /// Checks all limits.
    ///
    /// # Errors
    /// Names the first setting that is out of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let bad = |key, found: &dyn ToString, expected| Err(ConfigError { key, found: found.to_string(), expected });
        if !(1..=10_000).contains(&self.group_ms) {
            return bad("group_ms", &self.group_ms, "between 1 and 10000 ms");
        }
        if !(1..=16 << 20).contains(&self.group_bytes) {
            return bad("group_bytes", &self.group_bytes, "between 1 B and 16 MiB");
        }
        if !(1..=32 << 20).contains(&self.raw_group_bytes) {
            return bad("raw_group_bytes", &self.raw_group_bytes, "between 1 B and 32 MiB");
        }
        if !(4 << 10..=1 << 30).contains(&self.rotate_bytes) {
            return bad("rotate_bytes", &self.rotate_bytes, "between 4 KiB and 1 GiB");
        }
        if !(1..=31 * 86_400).contains(&self.rotate_secs) {
            return bad("rotate_secs", &self.rotate_secs, "between 1 s and 31 days");
        }
        if self.keep_bytes < self.rotate_bytes {
            return bad("keep_bytes", &self.keep_bytes, "at least rotate_bytes");
        }
        if self.keep_secs < self.rotate_secs {
            return bad("keep_secs", &self.keep_secs, "at least rotate_secs");
        }
        if !(1..=1 << 20).contains(&self.queue_records) {
            return bad("queue_records", &self.queue_records, "between 1 and 1048576");
        }
        if !(1 << 16..=1 << 32).contains(&self.raw_queue_bytes) {
            return bad("raw_queue_bytes", &self.raw_queue_bytes, "between 64 KiB and 4 GiB");
        }
        if self.spectra_secs != 0.0 && !(1.0..=86_400.0).contains(&self.spectra_secs) {
            return bad("spectra_secs", &self.spectra_secs, "0 or between 1 and 86400 s");
        }
        if let RawPolicy::AroundDeviations { level, before_secs, after_secs, buffer_bytes } = &self.raw {
            if !(1..=5).contains(level) {
                return bad("raw.level", level, "between 1 and 5");
            }
            for (key, value) in [("raw.before_secs", before_secs), ("raw.after_secs", after_secs)] {
                if !(0.0..=3600.0).contains(value) {
                    return bad(key, value, "between 0 and 3600 s");
                }
            }
            if !(1 << 16..=1 << 32).contains(buffer_bytes) {
                return bad("raw.buffer_bytes", buffer_bytes, "between 64 KiB and 4 GiB");
            }
        }
        Ok(())
    }
}
