//! The service: sources, workers, sinks, log and health on tokio.
