//! The service: workers and sinks on tokio, fed by sources. Sources, log, alarms and history are
//! crates of their own.
//!
//! ```text
//! source ─► bounded queue ─► cutting ─► workers (all cores) ─► judging ─► fanout ─┬► stdout
//!   (thread)   drops, counts   (windows)  core::pipeline         (order,          ├► log: one owner, groups, fdatasync
//!                              sheds, counts                      alarms)         ├► brokers, webhooks: spool on disk
//!                                                                                 └► page, metrics, status
//! supervisor: looks at all of them once a second; `ok` only for what is known to be well
//! ```
//!
//! [`config`] becomes [`service`]: every range is checked before anything starts, all problems are
//! reported at once. A part that fails is started again or ends the service; nothing that is
//! unknown is reported as normal. `docs/contributing.md` tells the life of a packet.
//!
//! ```
//! use gearwatch_daemon::config::Config;
//!
//! let config = Config::built_in()?;
//! assert_eq!(config.problems(), Vec::<String>::new());
//! # Ok::<(), gearwatch_daemon::config::ConfigError>(())
//! ```

pub mod bench;
pub mod checking;
pub mod config;
pub mod engine;
pub mod event;
pub mod fleet;
pub mod oneshot;
pub mod selftest;
pub mod service;
pub mod sink;
pub mod snapshot;
pub mod states;
pub mod status;
pub mod web;
