//! Noise-free tones: the estimator's own error.

use gearwatch_core::bench::Bench;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::train::Train;
use gearwatch_core::verdict::{HARMONICS, InstrumentState};
use gearwatch_tests::benches::{bench, with_tacho};
use gearwatch_tests::tones::{Run, Tone, add_noise, block, pulses, samples};

const RATE_HZ: f64 = 16_384.0;
const WINDOW: usize = 16_384;

/// Amplitudes of 1x–5x as uneven as real ones; the phases are arbitrary.
const AMPLITUDES: [f64; HARMONICS] = [1.0, 0.5, 0.8, 0.3, 0.45];

fn mesh_tones(bench: &Bench) -> Vec<Tone> {
    let train = Train::new(bench);
    let stages = train.stages.iter().enumerate();
    let tones = stages.flat_map(|(s, stage)| {
        let tone = move |h: usize| Tone {
            order: stage.mesh_order * (h + 1) as f64,
            amplitude: AMPLITUDES[(h + 2 * s) % HARMONICS],
            phase_rad: 0.7 + 1.9 * h as f64 + 2.3 * s as f64,
        };
        (0..HARMONICS).map(tone)
    });
    tones.collect()
}

/// Worst relative amplitude error of 1x–5x over the runs, the tones being mesh lines first.
fn worst_error(
    bench: &Bench,
    runs: impl Iterator<Item = Run>,
    others: &[Tone],
    tacho: Option<(&str, f64, f64)>,
) -> f64 {
    let mut tones = mesh_tones(bench);
    let mesh = tones.clone();
    tones.extend_from_slice(others);
    let pipeline = Pipeline::new(bench, &PipelineConfig::default(), None).expect("a usable bench");
    let mut worker = pipeline.worker();
    let mut worst: f64 = 0.0;
    for run in runs {
        let mut packets = Vec::new();
        if let Some((shaft, order, per_rev)) = tacho {
            packets.push(pulses(run, shaft, order, per_rev, 1.0));
        }
        packets.push(block(&samples(run, &tones, RATE_HZ, WINDOW), RATE_HZ));
        let analyses = super::analyse_with(&pipeline, &mut worker, &packets);
        assert_eq!(analyses.len(), 1);
        assert_eq!(analyses[0].instrument, InstrumentState::Ok, "{run:?} {:?}", analyses[0].input_speed_hz);
        let found = analyses[0].stages.iter().flat_map(|s| &s.harmonics);
        for (h, (line, truth)) in found.zip(&mesh).enumerate() {
            let error = (line.amplitude.value / truth.amplitude - 1.0).abs();
            assert!(error < 0.5, "{run:?}: line {h} is {} instead of {}", line.amplitude.value, truth.amplitude);
            worst = worst.max(error);
        }
    }
    worst
}

/// 200 speeds, none of them on a bin: steps of 0.37 % of a bin's worth over ±2 % of nominal.
fn off_bin(nominal_hz: f64) -> impl Iterator<Item = Run> {
    (0..200).map(move |i| Run::steady(nominal_hz * (0.98 + 0.04 * (f64::from(i) + 0.37) / 200.0)))
}

#[test]
fn analytic_single_stage_200_off_bin_speeds() {
    let worst = worst_error(&bench(25.0, &[(29, 100)]), off_bin(25.0), &[], None);
    assert!(worst <= 5e-4, "{worst:e}");
    eprintln!("single stage: {worst:e}");
}

#[test]
fn analytic_two_stages_200_off_bin_speeds() {
    let worst = worst_error(&bench(25.0, &[(29, 100), (36, 90)]), off_bin(25.0), &[], None);
    assert!(worst <= 5e-4, "{worst:e}");
    eprintln!("two stages: {worst:e}");
}

fn ramps(nominal_hz: f64) -> impl Iterator<Item = Run> {
    let percents = [0.5, -0.5, 2.0, -2.0];
    (0..40).map(move |i| Run::ramp(nominal_hz * (0.985 + 0.03 * f64::from(i) / 40.0), percents[i as usize % 4], 1.0))
}

#[test]
fn analytic_ramps_without_tacho() {
    for teeth in [&[(29, 100)][..], &[(29, 100), (36, 90)]] {
        let worst = worst_error(&bench(25.0, teeth), ramps(25.0), &[], None);
        eprintln!("ramps without tacho, {} stages: {worst:e}", teeth.len());
        assert!(worst <= 1e-3, "{worst:e}");
    }
}

#[test]
fn analytic_ramps_with_tacho() {
    let teeth = [(29, 100), (36, 90)];
    for (shaft, order, per_rev) in [("shaft0", 1.0, 1.0), ("motor", 1.0, 60.0), ("shaft1", 0.29, 1.0)] {
        let bench = with_tacho(bench(25.0, &teeth), shaft, per_rev);
        let worst = worst_error(&bench, ramps(25.0), &[], Some((shaft, order, per_rev)));
        eprintln!("ramps with tacho on {shaft}: {worst:e}");
        assert!(worst <= 1e-3, "{shaft}: {worst:e}");
    }
}

/// Mesh frequencies are the published speed of the input shaft times their orders, in noise and
/// where the speed changes over the window. They were up to sixteen of the stated sigmas apart; one
/// multiplication leaves no more than rounding, 1e-12.
#[test]
fn regress_mesh_frequencies_are_those_of_the_published_speed() {
    let bench = bench(25.0, &[(29, 100), (36, 90)]);
    let train = Train::new(&bench);
    let pipeline = Pipeline::new(&bench, &PipelineConfig::default(), None).expect("a usable bench");
    let mut worker = pipeline.worker();
    for (seed, run) in ramps(25.0).enumerate().take(8) {
        let mut x = samples(run, &mesh_tones(&bench), RATE_HZ, WINDOW);
        add_noise(&mut x, 0.3, seed as u64);
        let analysis = &super::analyse_with(&pipeline, &mut worker, &[block(&x, RATE_HZ)])[0];
        assert_eq!(analysis.instrument, InstrumentState::Ok, "{run:?}");
        for (found, stage) in analysis.stages.iter().zip(&train.stages) {
            let expected = stage.mesh_order * analysis.input_speed_hz.value;
            assert!((found.mesh_hz / expected - 1.0).abs() < 1e-12, "{run:?}: {} Hz, {expected} Hz", found.mesh_hz);
        }
    }
}

/// Sidebands as large as the carrier at ±0.4 and ±1 orders of the input shaft, of every harmonic.
/// With 29 teeth on 100 the ±0.4 orders are lines that nobody announced; with 32 on 80 they are the
/// wheel's sidebands, which a slow shaft puts into the main lobe (3.4 Hz in a window of 1 s).
#[test]
fn analytic_sidebands_do_not_bias() {
    for (nominal_hz, teeth) in [(25.0, (29, 100)), (29.7, (29, 100)), (29.7, (32, 80)), (8.43, (32, 80))] {
        let bench = bench(nominal_hz, &[teeth]);
        let mut others = Vec::new();
        for (h, tone) in mesh_tones(&bench).iter().enumerate() {
            for (k, offset) in [-1.0, -0.4, 0.4, 1.0].into_iter().enumerate() {
                let phase_rad = 0.3 + 2.1 * k as f64 + 0.9 * h as f64;
                others.push(Tone { order: tone.order + offset, amplitude: tone.amplitude, phase_rad });
            }
        }
        let worst = worst_error(&bench, off_bin(nominal_hz).step_by(8), &others, None);
        eprintln!("sidebands, {teeth:?} at {nominal_hz} Hz: {worst:e}");
        assert!(worst <= 2e-3, "{teeth:?} at {nominal_hz} Hz: {worst:e}");
    }
}
