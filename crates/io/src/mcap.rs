//! MCAP recordings: the contract of gearwatch, written and read, and the foreign schemas that exist
//! in the wild, read.
//!
//! Reading does not use the reader of the `mcap` crate, which panics or takes gigabytes on some
//! damaged files; the walk over the records here bounds every length before it is used and checks a
//! chunk's checksum before any of its messages is handed over.

mod bytes;
pub mod contract;
pub mod definitions;
pub mod fields;
pub mod foreign;
mod packed;
pub mod source;
pub mod walk;
pub mod writer;

pub use source::McapSource;
pub use walk::LARGEST_RECORD;
pub use writer::{Compression, Encoded, McapWriter, PublishTime, WriteError, encode};
