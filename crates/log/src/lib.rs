//! The log: MCAP files that survive `kill -9`, a power cut and a full disk.
//!
//! ```text
//!  send(Record) ─► bounded queue ─► owner thread: group of ≤ 200 ms or 64 KiB ─► chunk with CRC ─► append ─► fdatasync ─► durable_seq
//!  (never waits;                         │
//!   sheds, counts)                       └ rotates, closes, prunes, recovers: nobody else touches the folder
//! ```
//!
//! - A record is *acknowledged* when [`LogHandle::durable_seq`] has reached its sequence number.
//!   What is acknowledged survives a power cut.
//! - Every chunk begins with a [`Group`] record that says what the chunk must hold; groups are
//!   numbered without a hole.
//! - A file without footer is the normal case after a crash. The next start closes it, and records
//!   the tail that was never acknowledged as a gap.
//! - No sequence number is given out twice, not even one that was lost.
//!
//! ```
//! use gearwatch_log::LogConfig;
//!
//! let config = LogConfig { group_ms: 0, ..LogConfig::default() };
//! assert!(config.check().is_err());
//! assert!(LogConfig::default().check().is_ok());
//! ```

mod codec;
mod config;
mod content;
mod disk;
mod doctor;
mod examine;
mod flaw;
mod format;
mod handle;
mod keeper;
mod message;
mod names;
mod now;
mod owner;
mod queue;
mod raw;
mod record;
mod recover;
mod salvage;
#[cfg(any(test, feature = "testkit"))]
pub mod simulated;
mod spectrum;
mod standing;
mod state;
mod stepper;
mod storage;
mod walk;
mod watch;

pub use config::{Compression, ConfigError, LogConfig, RawPolicy};
pub use disk::Disk;
pub use doctor::{FileHealth, Health, RecoverError, doctor, recover_file};
pub use examine::{Damage, Ending};
pub use flaw::Flaw;
pub use handle::{LogError, LogHandle, spawn};
pub use message::{
    ALARM_TOPIC, CLOCK_TOPIC, GAP_TOPIC, GROUP_TOPIC, Group, Message, NOTE_TOPIC, Schema, encode, verdict_schema,
};
pub use names::{started_s, utc};
pub use now::Now;
pub use queue::Sent;
pub use record::{AlarmRecord, Attachment, Cause, Clock, Context, Gap, Level, Note, Record};
pub use recover::Recovery;
pub use salvage::{Missing, Salvaged, salvage};
pub use spectrum::{SpectrumFrame, SpectrumLine};
pub use state::{Condition, LogState};
pub use stepper::{Sender, Stepper};
pub use storage::{Marker, Storage, StorageFile};
pub use watch::{DURABLE_WITHIN, Judgement, Watch};
