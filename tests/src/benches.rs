//! Benches that several tests use, written as a bench file is: what it leaves out has the file's
//! own defaults.

use std::fmt::Write;

use gearwatch_core::bench::{Bench, Tacho};

/// A bench whose motor drives the input shaft directly, with the teeth of each stage; shafts are
/// named `shaft0`, `shaft1` …, stages `stage1` ….
pub fn bench(motor_hz: f64, teeth: &[(u32, u32)]) -> Bench {
    let mut text = String::from("format = \"gearwatch-bench/1\"\nname = \"test bench\"\n");
    // Writing into a string does not fail.
    let _ = writeln!(text, "motor = {{ speed_hz = {motor_hz:?} }}");
    for i in 0..=teeth.len() {
        let _ = writeln!(text, "[[shaft]]\nname = \"shaft{i}\"");
    }
    for (i, (pinion, wheel)) in teeth.iter().enumerate() {
        let _ = writeln!(text, "[[stage]]\nname = \"stage{}\"", i + 1);
        let _ = writeln!(text, "pinion = {{ teeth = {pinion} }}\nwheel = {{ teeth = {wheel} }}");
    }
    text.push_str("[[sensor]]\nname = \"acc_1\"\nshaft = \"shaft0\"\n");
    Bench::from_toml(&text).expect("a bench")
}

/// The same with a tacho.
pub fn with_tacho(mut bench: Bench, shaft: &str, pulses_per_rev: f64) -> Bench {
    bench.tacho = Some(Tacho { shaft: shaft.into(), pulses_per_rev });
    bench
}
