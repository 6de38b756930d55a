//! The service: sources, workers, sinks, log and health on tokio.

pub mod bench;
pub mod checking;
pub mod config;
pub mod emulate;
pub mod engine;
pub mod event;
pub mod fail;
pub mod fleet;
pub mod health;
pub mod history;
pub mod kinds;
pub mod log;
pub mod oneshot;
pub mod queue;
pub mod secret;
pub mod selftest;
pub mod service;
pub mod sink;
pub mod snapshot;
pub mod source;
pub mod status;
pub mod stop;
#[cfg(feature = "tls")]
pub mod tls;
pub mod web;
