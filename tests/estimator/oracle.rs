//! The estimator against a slow one: least squares of all lines on the samples themselves, at the
//! exact angle.

use gearwatch_core::pipeline::PipelineConfig;
use gearwatch_core::train::Train;
use gearwatch_core::verdict::HARMONICS;
use gearwatch_tests::benches::{self, bench, with_tacho};
use gearwatch_tests::tones::{Run, Tone, add_noise, block, pulses, samples};

const RATE_HZ: f64 = 4096.0;
const WINDOW: usize = 4096;

/// Solves the normal equations of `x = Σ a cos + b sin` by conjugate gradients; amplitudes by
/// order.
fn least_squares(x: &[f64], run: Run, orders: &[f64]) -> Vec<f64> {
    let columns: Vec<Vec<f64>> = orders
        .iter()
        .flat_map(|&order| {
            let phase = move |i: usize| std::f64::consts::TAU * order * run.angle(i as f64 / RATE_HZ);
            [(0..x.len()).map(|i| phase(i).cos()).collect(), (0..x.len()).map(|i| phase(i).sin()).collect()]
        })
        .collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let apply = |v: &[f64]| -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        for (c, v) in columns.iter().zip(v) {
            y.iter_mut().zip(c).for_each(|(y, c)| *y += v * c);
        }
        columns.iter().map(|c| dot(c, &y)).collect()
    };
    let mut solution = vec![0.0; columns.len()];
    let mut residual: Vec<f64> = columns.iter().map(|c| dot(c, x)).collect();
    let mut direction = residual.clone();
    let mut square = dot(&residual, &residual);
    let start = square;
    while square > 1e-26 * start {
        let image = apply(&direction);
        let alpha = square / dot(&direction, &image);
        solution.iter_mut().zip(&direction).for_each(|(s, d)| *s += alpha * d);
        residual.iter_mut().zip(&image).for_each(|(r, i)| *r -= alpha * i);
        let next = dot(&residual, &residual);
        let beta = next / square;
        direction.iter_mut().zip(&residual).for_each(|(d, r)| *d = r + beta * *d);
        square = next;
    }
    solution.chunks(2).map(|ab| ab[0].hypot(ab[1])).collect()
}

/// Mesh lines, sidebands of both shafts and noise, in a ramp, with a tacho. Both estimators see the
/// same noise; least squares without weighting is the best linear one, so that they differ by a
/// fraction of the stated sigma: the efficient window lets 14 % more noise power in, which makes
/// the difference 0.37 σ rms. A line for which the guard is taken (0.7 % of the time) may differ by
/// σ more. Without noise they agree to 1e-4.
#[test]
fn oracle_least_squares_on_the_samples() {
    let bench = with_tacho(bench(25.0, &[(13, 29)]), "shaft0", 1.0);
    let train = Train::new(&bench);
    let stage = &train.stages[0];
    let mut tones = Vec::new();
    for h in 0..HARMONICS {
        let order = stage.mesh_order * (h + 1) as f64;
        tones.push(Tone { order, amplitude: 1.0 / (h + 1) as f64, phase_rad: h as f64 });
        for (k, shaft) in [stage.pinion_order, stage.wheel_order].into_iter().enumerate() {
            for times in [-3.0, -2.0, -1.0, 1.0, 2.0, 3.0] {
                let phase_rad = 0.3 + times + 2.0 * k as f64 + h as f64;
                tones.push(Tone { order: order + times * shaft, amplitude: 0.3 / (h + 1) as f64, phase_rad });
            }
        }
    }
    let orders: Vec<f64> = tones.iter().map(|t| t.order).collect();
    for (noise, percent) in [(0.0, 0.0), (0.0, 1.0), (0.2, 0.0), (0.2, -1.5)] {
        let run = Run::ramp(25.07, percent, 1.0);
        let mut x = samples(run, &tones, RATE_HZ, WINDOW);
        add_noise(&mut x, noise, 99);
        let slow = least_squares(&x, run, &orders);
        let packets = [pulses(run, "shaft0", 1.0, 1.0, 1.0), block(&x, RATE_HZ)];
        let analysis = &super::analyse(&bench, &PipelineConfig::default(), &packets)[0];
        for h in 0..HARMONICS {
            let line = analysis.stages[0].harmonics[h];
            let (found, exact) = (line.amplitude, slow[13 * h]);
            let allowed = 1e-4 * exact + if noise > 0.0 { 1.2 * found.sigma } else { 0.0 };
            eprintln!(
                "noise {noise}, ramp {percent} %, {}x: {} and {exact}, sigma {}",
                h + 1,
                found.value,
                found.sigma
            );
            assert!((found.value - exact).abs() < allowed, "noise {noise}, ramp {percent} %, {}x", h + 1);
        }
    }
}

/// The phase is that at the window's first sample, in ramps that the refinement follows from a
/// steady start and in those it does not.
#[test]
fn analytic_phase_at_the_first_sample() {
    let bench = benches::bench(25.0, &[(29, 100)]);
    let tone = |i: u32| Tone { order: 29.0 * f64::from(i + 1), amplitude: 1.0, phase_rad: 0.4 * f64::from(i) - 0.9 };
    let tones: Vec<Tone> = (0..5).map(tone).collect();
    for percent in [0.0, 0.1, 0.3, 0.7, 1.2] {
        let x = samples(Run::ramp(24.9, percent, 1.0), &tones, 16_384.0, 16_384);
        let analysis = &super::analyse(&bench, &PipelineConfig::default(), &[block(&x, 16_384.0)])[0];
        for (line, tone) in analysis.stages[0].harmonics.iter().zip(&tones) {
            // The search among ramps works on interpolated copies and leaves up to 2e-5 rev at the
            // ends of the window, 0.02 rad at order 145; a speed that is off by the 5e-5 that ranks
            // can bear would leave 6e-4 rev.
            assert!(
                (line.phase_rad - tone.phase_rad).abs() < 0.03,
                "{percent} %: {} {}",
                line.phase_rad,
                tone.phase_rad
            );
            assert!((line.amplitude.value - 1.0).abs() < 1e-3, "{percent} %: {}", line.amplitude.value);
        }
    }
}
