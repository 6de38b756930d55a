//! Shared fixtures.

pub mod benches;
pub mod tones;
