//! Every byte format that crosses gearwatch's border: recordings, bench files, baselines, logs.

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
pub mod problem;
pub mod save;
mod sealed;
pub mod signature_file;
pub mod summary;
pub mod tdms;
pub mod text;
mod timing;
pub mod uff;
pub mod units;

pub use open::{Opened, open, open_bytes, read_recording};
pub use options::{ChannelOption, OpenOptions, sidecar_path};
pub use problem::{Problem, ReadError};
