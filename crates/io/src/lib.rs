//! Every byte format that crosses gearwatch's border: recordings, bench files, baselines, logs.

pub mod baseline_file;
pub mod bench_file;
pub mod formats;
pub mod mcap;
pub mod open;
pub mod problem;

pub use open::{OpenOptions, Opened, open, read_recording};
pub use problem::{Problem, ReadError};
