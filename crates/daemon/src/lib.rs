//! The service: sources, workers, sinks, log and health on tokio.

pub mod log;
pub mod web;
