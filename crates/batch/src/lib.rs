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
//!
//! Each process takes every Nth item of the sorted list, so that the parts are disjoint and
//! together whole:
//!
//! ```
//! use gearwatch_batch::shard::Shard;
//!
//! let shards: Vec<Shard> = (1..=3).map(|index| Shard::new(index, 3)).collect::<Result<_, _>>()?;
//! for position in 0..10 {
//!     assert_eq!(shards.iter().filter(|shard| shard.holds(position)).count(), 1);
//! }
//! assert_eq!(Shard::count_of_part(&shards[0].part_name()), Some(3));
//! # Ok::<(), gearwatch_batch::shard::ShardError>(())
//! ```

pub mod explaining;
pub mod judging;
pub mod part;
pub mod rows;
pub mod run;
pub mod samples;
pub mod shard;
pub mod sweep;
pub mod worklist;
