//! Benches for the unit tests of this crate, written as a bench file is: what it leaves out has the
//! file's own defaults.

use gearwatch_core::bench::Bench;

/// Driven directly: 34 / 73 teeth.
const SINGLE_STAGE: &str = include_str!("test_bench/single-stage.toml");

/// Behind a belt: 34 / 73 and 36 / 90 teeth.
const TWO_STAGES: &str = include_str!("test_bench/two-stages.toml");

pub(crate) fn single_stage() -> Bench {
    Bench::from_toml(SINGLE_STAGE).expect("a bench")
}

pub(crate) fn two_stages() -> Bench {
    Bench::from_toml(TWO_STAGES).expect("a bench")
}
