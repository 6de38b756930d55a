//! Every byte format that crosses gearwatch's border: recordings, bench files, baselines, logs.
//!
//! ```text
//! bytes ─► formats (by content, not by name) ─► a Source of packets ─► pipeline
//!            │ MCAP, CSV, WAV, UFF, MATLAB, TDMS     with a place in every error
//!            └ options, sidecar file: what a file leaves unsaid
//! ```
//!
//! Nothing here trusts a length: memory is bounded by the size of the file ([`budget`]), and what
//! does not fit is an error that names the place, what was expected, what was found and what to do
//! ([`Problem`]).
//!
//! ```
//! use gearwatch_core::source::Source;
//! use gearwatch_io::{OpenOptions, open_bytes};
//!
//! let csv = std::io::Cursor::new(format!("acc_1\n{}", "0.5\n-0.5\n0.25\n".repeat(100)));
//! let unsaid = OpenOptions { sample_rate_hz: Some(1000.0), unit: Some("g".into()), ..OpenOptions::default() };
//! let mut recording = open_bytes("a.csv".as_ref(), Box::new(csv), &unsaid)?;
//! assert!(recording.next_packet()?.is_some());
//! # Ok::<(), gearwatch_io::ReadError>(())
//! ```

pub mod baseline_file;
pub mod bench_file;
mod blocks;
pub mod budget;
mod columns;
pub mod digest;
pub mod formats;
mod forward;
pub mod frames;
pub mod lanxi;
pub mod mat;
pub mod mcap;
pub mod open;
pub mod options;
pub mod output;
mod positioned;
pub mod problem;
pub mod save;
mod sealed;
pub mod signature_file;
mod store;
pub mod summary;
pub mod tdms;
pub mod text;
mod timing;
pub mod uff;
pub mod units;

pub use open::{Opened, open, open_bytes, read_recording};
pub use options::{ChannelOption, ChannelOptionError, OpenOptions, sidecar_path};
pub use problem::{Problem, ReadError};
