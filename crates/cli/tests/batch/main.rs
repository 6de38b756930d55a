//! `gearwatch batch` as a user runs it: alone, in shards, under Slurm, and read by what exists.

#![expect(clippy::print_stderr, reason = "tests tell what was skipped, and campaigns tell figures")]

#[path = "../service/fixture.rs"]
#[expect(dead_code, reason = "shared with the tests of the service, which use all of it")]
mod fixture;

mod archive;
mod bad_input;
mod cases;
mod long;
mod memory;
mod python;
mod shards;
mod slurm;
mod throughput;
