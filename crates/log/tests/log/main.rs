//! The log under kill, power cut, full disk and damage. What it wrote is judged by the reader of
//! the `mcap` crate, which knows nothing of the log's own code.

mod damage;
mod judged;
mod kills;
mod limit;
mod start_and_stop;
