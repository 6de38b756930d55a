//! The service: sources, workers, sinks, log and health on tokio.

pub mod bench;
pub mod config;
pub mod engine;
pub mod event;
pub mod kinds;
pub mod log;
pub mod oneshot;
pub mod queue;
pub mod service;
pub mod sink;
pub mod source;
pub mod stop;
pub mod web;
