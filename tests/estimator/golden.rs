//! Against SciPy: `tests/golden/order_amplitudes.json`, made by the script beside it.

use gearwatch_core::pipeline::PipelineConfig;
use gearwatch_core::verdict::{HARMONICS, InstrumentState};
use gearwatch_tests::benches::bench;
use gearwatch_tests::tones::{Run, Tone, block, samples};
use serde_json::Value;

/// Mesh harmonics of two stages with sidebands of their shafts and unannounced lines, at constant
/// speed and in ramps, without tacho: the amplitudes agree within 0.05 %.
#[test]
fn oracle_scipy_order_amplitudes() {
    let golden: Value = serde_json::from_str(include_str!("../golden/order_amplitudes.json")).expect("JSON");
    let number = |v: &Value| v.as_f64().expect("a number");
    let rate_hz = number(&golden["sample_rate_hz"]);
    let count = number(&golden["samples"]) as usize;
    let bench = bench(25.0, &[(29, 100), (36, 90)]);
    let mut worst: f64 = 0.0;
    for case in golden["cases"].as_array().expect("cases") {
        let run = Run { f0_hz: number(&case["f0_hz"]), ramp_hz_per_s: number(&case["ramp_hz_per_s"]) };
        let tone = |t: &Value| Tone { order: number(&t[0]), amplitude: number(&t[1]), phase_rad: number(&t[2]) };
        let tones: Vec<Tone> = case["tones"].as_array().expect("tones").iter().map(tone).collect();
        let x = samples(run, &tones, rate_hz, count);
        let analysis = &super::analyse(&bench, &PipelineConfig::default(), &[block(&x, rate_hz)])[0];
        assert_eq!(analysis.instrument, InstrumentState::Ok, "{run:?}");
        for (i, golden) in case["amplitudes"].as_array().expect("amplitudes").iter().enumerate() {
            let found = analysis.stages[i / HARMONICS].harmonics[i % HARMONICS].amplitude.value;
            let error = (found / number(golden) - 1.0).abs();
            worst = worst.max(error);
            assert!(error < 5e-4, "{run:?}, line {i}: {found} and {golden}");
        }
    }
    eprintln!("against SciPy: {worst:e}");
}
