//! No speed is better than a wrong one.

use gearwatch_core::pipeline::PipelineConfig;
use gearwatch_core::verdict::InstrumentState;
use gearwatch_tests::benches::bench;
use gearwatch_tests::tones::{Run, Tone, add_noise, block, samples};

const RATE_HZ: f64 = 16_384.0;
const WINDOW: usize = 16_384;

fn state(tones: &[Tone], hz: f64, noise: f64, seed: u64) -> (InstrumentState, f64) {
    let mut x = samples(Run::steady(hz), tones, RATE_HZ, WINDOW);
    add_noise(&mut x, noise, seed);
    let bench = bench(25.0, &[(29, 100), (36, 90)]);
    let analysis = &super::analyse(&bench, &PipelineConfig::default(), &[block(&x, RATE_HZ)])[0];
    (analysis.instrument, analysis.input_speed_hz.value)
}

#[test]
fn analytic_noise_has_no_speed() {
    for seed in 0..50 {
        assert_eq!(state(&[], 25.0, 1.0, seed).0, InstrumentState::NoSpeed, "seed {seed}");
    }
}

#[test]
fn analytic_one_tone_is_no_gear() {
    let hum = Tone { order: 29.1, amplitude: 10.0, phase_rad: 0.0 };
    for seed in 0..20 {
        assert_eq!(state(&[hum], 25.0, 1.0, seed).0, InstrumentState::NoSpeed, "seed {seed}");
    }
}

/// Lines out of the search range: a motor that runs 6 % slow.
#[test]
fn analytic_speed_out_of_range_is_no_speed() {
    let tones: Vec<Tone> =
        (1..=5).map(|h| Tone { order: 29.0 * f64::from(h), amplitude: 1.0, phase_rad: f64::from(h) }).collect();
    for seed in 0..10 {
        assert_eq!(state(&tones, 23.5, 0.3, seed).0, InstrumentState::NoSpeed, "seed {seed}");
    }
}

#[test]
fn analytic_everything_above_the_band() {
    let x = samples(Run::steady(25.0), &[Tone { order: 1.0, amplitude: 1.0, phase_rad: 0.0 }], 1000.0, 1000);
    let bench = bench(25.0, &[(29, 100), (36, 90)]);
    let config = PipelineConfig { usable_band: 0.2, ..PipelineConfig::default() };
    let analysis = &super::analyse(&bench, &config, &[block(&x, 1000.0)])[0];
    assert_eq!(analysis.instrument, InstrumentState::OutOfBand);
}
