//! Campaigns against the real binary: killed, stopped, without space, without power. The normal run
//! does a few rounds of each; `just campaign` does them all (`GEARWATCH_ROUNDS` sets how many), and
//! `docs/reliability-evidence.md` holds the last figures.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "tests tell figures, and what was skipped")]

#[path = "../service/fixture.rs"]
#[expect(dead_code, reason = "shared with the tests of the service, which use all of it")]
mod fixture;
#[path = "../brokers/server.rs"]
#[expect(dead_code, reason = "shared with the tests of brokers, which use all of it")]
mod server;

mod disk_full;
mod failures;
mod hour;
mod kills;
mod memory;
mod month;
mod overload;
mod power_cut;
mod reader;
mod sensor_faults;
mod service;
mod signing;
mod soak;
mod sound_card;
mod stops;
mod time;
mod unit;
mod week;
