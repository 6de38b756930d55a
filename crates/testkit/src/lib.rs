//! What only tests use. No shipped crate depends on this one: it appears under `[dev-dependencies]`
//! only.
//!
//! - `files`: a small recording of each format with known samples, written by other crates or by
//!   hand.
//! - `log`: log records with known content, and a reader of logs that is not the log's own.
//! - `report`: what a report would load from elsewhere.
//! - `disk`: a disk that loses power, fills up or fails at any call.

pub mod files;
#[cfg(feature = "service")]
pub mod log;
pub mod report;

/// A disk that fails on command. Its code stays beside the storage trait of the log, whose unit
/// tests use it too.
#[cfg(feature = "service")]
pub use gearwatch_log::simulated as disk;
