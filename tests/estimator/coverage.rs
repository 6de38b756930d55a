//! The stated sigma against the truth, in white noise.

use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::train::Train;
use gearwatch_core::verdict::{HARMONICS, InstrumentState};
use gearwatch_tests::benches::{bench, with_tacho};
use gearwatch_tests::tones::{Run, Tone, add_noise, block, pulses, samples};

const RATE_HZ: f64 = 8192.0;
const WINDOW: usize = 8192;
const WINDOWS: usize = 2000;

/// Of 2000 windows the sigma covers the truth in 68 ± 3 % and twice the sigma (1.96 σ) in 95 ± 2 %,
/// for every harmonic of two stages, the five of a stage being taken together, with and without
/// tacho. The lines stand 15 to 26 dB above what noise shows beside them: below about 10 dB the
/// amplitude of a phasor in noise is not normal any more (Rice's law).
#[test]
fn analytic_sigma_covers_the_truth() {
    let nominal_hz = 25.0;
    let plain = bench(nominal_hz, &[(29, 100), (36, 90)]);
    let tacho = with_tacho(plain.clone(), "shaft0", 1.0);
    for (bench, per_rev) in [(plain, 0.0), (tacho, 1.0)] {
        let train = Train::new(&bench);
        let mut tones = Vec::new();
        for (s, stage) in train.stages.iter().enumerate() {
            for h in 0..HARMONICS {
                tones.push(Tone {
                    order: stage.mesh_order * (h + 1) as f64,
                    amplitude: [1.0, 0.6, 0.9, 0.5, 0.7][(h + 2 * s) % HARMONICS],
                    phase_rad: 0.0,
                });
            }
        }
        let pipeline = Pipeline::new(&bench, &PipelineConfig::default(), None).expect("a usable bench");
        let mut worker = pipeline.worker();
        let (mut within_1, mut within_2) = ([[0usize; HARMONICS]; 2], [[0usize; HARMONICS]; 2]);
        for window in 0..WINDOWS {
            let run = Run::steady(nominal_hz * (0.99 + 0.02 * (window as f64 + 0.5) / WINDOWS as f64));
            for (i, tone) in tones.iter_mut().enumerate() {
                tone.phase_rad = (window * (i + 3)) as f64 * 0.7;
            }
            let mut signal = samples(run, &tones, RATE_HZ, WINDOW);
            // Noise beside a line is sigma sqrt(4/N) rms: 0.05 · for sigma 2.3.
            add_noise(&mut signal, 2.3, 7000 + window as u64);
            let mut packets = vec![block(&signal, RATE_HZ)];
            if per_rev > 0.0 {
                packets.insert(0, pulses(run, "shaft0", 1.0, per_rev, 1.0));
            }
            let analysis = &super::analyse_with(&pipeline, &mut worker, &packets)[0];
            assert_eq!(analysis.instrument, InstrumentState::Ok, "window {window}");
            for s in 0..2 {
                for h in 0..HARMONICS {
                    let found = analysis.stages[s].harmonics[h].amplitude;
                    let off = (found.value - tones[s * HARMONICS + h].amplitude).abs() / found.sigma;
                    within_1[s][h] += usize::from(off < 1.0);
                    within_2[s][h] += usize::from(off < 1.96);
                }
            }
        }
        let share = |n: usize| 100.0 * n as f64 / WINDOWS as f64;
        for s in 0..2 {
            for h in 0..HARMONICS {
                let (one, two) = (share(within_1[s][h]), share(within_2[s][h]));
                eprintln!("tacho {per_rev}: stage {} {}x: {one:.1} %, {two:.1} %", s + 1, h + 1);
                assert!(
                    (65.0..=71.0).contains(&one) && (93.0..=97.0).contains(&two),
                    "stage {s} {}x: {one} {two}",
                    h + 1
                );
            }
        }
    }
}
