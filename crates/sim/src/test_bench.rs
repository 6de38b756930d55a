//! Benches for the unit tests of this crate, written as a bench file is: what it leaves out has the file's own defaults.

use gearwatch_core::bench::Bench;

/// Driven directly: 34 / 73 teeth.
const SINGLE_STAGE: &str = r#"
format = "gearwatch-bench/1"
name = "single"
motor = { speed_hz = 30.0 }
brake = { torque_nm = 60.0 }
tacho = { shaft = "input" }

[[shaft]]
name = "input"
inertia_kg_m2 = 0.002

[[shaft]]
name = "output"
inertia_kg_m2 = 0.002

[[stage]]
name = "stage1"
pinion = { teeth = 34 }
wheel = { teeth = 73 }

[[sensor]]
name = "acc_1"
shaft = "input"
direction_deg = 90.0

[[sensor]]
name = "acc_2"
shaft = "output"
"#;

/// Behind a belt: 34 / 73 and 36 / 90 teeth.
const TWO_STAGES: &str = r#"
format = "gearwatch-bench/1"
name = "two stages"
motor = { speed_hz = 30.0 }
belt = { ratio = 3.56 }
brake = { torque_nm = 60.0 }
tacho = { shaft = "input" }

[[shaft]]
name = "input"
inertia_kg_m2 = 0.002

[[shaft]]
name = "intermediate"
inertia_kg_m2 = 0.002

[[shaft]]
name = "output"
inertia_kg_m2 = 0.002

[[stage]]
name = "stage1"
pinion = { teeth = 34 }
wheel = { teeth = 73 }

[[stage]]
name = "stage2"
line_of_centres_deg = 30.0
pinion = { teeth = 36 }
wheel = { teeth = 90 }

[[sensor]]
name = "acc_1"
shaft = "input"
direction_deg = 90.0

[[sensor]]
name = "acc_2"
shaft = "output"
"#;

pub(crate) fn single_stage() -> Bench {
    Bench::from_toml(SINGLE_STAGE).expect("a bench")
}

pub(crate) fn two_stages() -> Bench {
    Bench::from_toml(TWO_STAGES).expect("a bench")
}
