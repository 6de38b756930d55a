//! Every byte format that crosses gearwatch's border: recordings, bench files, baselines, logs.

pub mod baseline_file;
pub mod bench_file;
mod blocks;
mod columns;
pub mod formats;
pub mod mcap;
pub mod open;
pub mod options;
pub mod problem;
pub mod summary;
mod timing;
pub mod uff;
mod units;

pub use open::{Opened, open, read_recording};
pub use options::{ChannelOption, OpenOptions};
pub use problem::{Problem, ReadError};
