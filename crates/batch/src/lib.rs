//! Many recordings, or many cases, on engines that exist: one process works one shard of a list and
//! leaves one Parquet file.
//!
//! ```text
//! manifest or folders ─► work list (sorted, each item once) ─► shard I of N ─► threads, an item each ─► part-I-of-N.parquet
//!                                                                  done work is known by its content and skipped
//! ```
//!
//! Slurm, `xargs`, a queue or a shell loop starts the processes; DuckDB, DataFusion, Spark or
//! pandas read the parts. Nothing here talks to another process but through files that appear
//! whole, by a rename.

pub mod explaining;
pub mod judging;
pub mod part;
pub mod rows;
pub mod run;
pub mod samples;
pub mod shard;
pub mod sweep;
pub mod worklist;
