//! The whole stage row beside the bare real transforms of the same windows: `cargo bench -p gearwatch-core`.
//!
//! Two stages, 16 384-sample windows, one channel, one core. Items are new samples: at 90 % overlap each is looked at ten times.
//! `row_*` is packets to verdicts; `transform_*` is `realfft` in f64 on the same windows and nothing else.

use std::hint::black_box;

use divan::counter::ItemsCount;
use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::bench::Bench;
use gearwatch_core::block::{Block, Packet, Quality, Samples, TachoBlock};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use realfft::RealFftPlanner;

const RATE_HZ: f64 = 16_384.0;
const WINDOW: usize = 16_384;
const SECONDS: usize = 8;
const MESH_ORDERS: [f64; 2] = [29.0, 10.44];

fn main() {
    divan::main();
}

fn bench(tacho: bool) -> Bench {
    let gear = |teeth: u32| serde_json::json!({ "teeth": teeth });
    let mut text = serde_json::json!({
        "format": "gearwatch-bench/1", "name": "bench", "motor": { "speed_hz": 25.0 },
        "shaft": [{ "name": "input" }, { "name": "middle" }, { "name": "output" }],
        "stage": [
            { "name": "stage1", "pinion": gear(29), "wheel": gear(100) },
            { "name": "stage2", "pinion": gear(36), "wheel": gear(90) },
        ],
    });
    if tacho {
        text["tacho"] = serde_json::json!({ "shaft": "input", "pulses_per_rev": 1.0 });
    }
    serde_json::from_value(text).expect("a bench")
}

/// Mesh lines of both stages in noise; the noise is the fractional part of a large multiple, which is as good as white here.
fn signal() -> Vec<f32> {
    let value = |i: usize| {
        let t = i as f64 / RATE_HZ;
        let tone = |order: f64| (std::f64::consts::TAU * order * 25.013 * t).cos();
        let lines: f64 = MESH_ORDERS.iter().flat_map(|m| (1..=5).map(move |h| m * f64::from(h))).map(tone).sum();
        let noise = ((i as f64 * 0.754_877_666_2 + 0.1).sin() * 43_758.545_3).fract();
        (lines + 0.3 * noise) as f32
    };
    (0..SECONDS * WINDOW).map(value).collect()
}

fn packets(tacho: bool) -> Vec<Packet> {
    let signal = signal();
    let mut out = Vec::new();
    if tacho {
        let pulses = (-2..SECONDS as i64 * 26).map(|i| (i as f64 / 25.013 * 1e9) as i64);
        out.push(Packet::Tacho(TachoBlock {
            shaft: "input".into(),
            t0: 0,
            pulses_per_rev: 1.0,
            pulse_times: pulses.collect(),
            quality: Quality::GOOD,
        }));
    }
    out.extend(signal.chunks(1638).enumerate().map(|(i, chunk)| {
        Packet::Vibration(Block {
            sensor: "a".into(),
            t0: ((i * 1638) as f64 / RATE_HZ * 1e9).round() as i64,
            sample_rate_hz: RATE_HZ,
            first_sample_index: (i * 1638) as u64,
            unit: "m/s^2".into(),
            samples: Samples::Physical(chunk.to_vec()),
            quality: Quality::GOOD,
        })
    }));
    out
}

fn row(bencher: divan::Bencher<'_, '_>, hop_s: f64, tacho: bool) {
    let mut config = PipelineConfig::default();
    config.window.hop_s = hop_s;
    let pipeline = Pipeline::new(&bench(tacho), &config, None).expect("a pipeline");
    let packets = packets(tacho);
    let mut worker = pipeline.worker();
    let mut analysis = WindowAnalysis::empty();
    let mut verdicts = Vec::new();
    let mut ready = Vec::new();
    bencher.counter(ItemsCount::new(SECONDS * WINDOW)).bench_local(|| {
        let mut assembler = pipeline.assembler();
        for packet in &packets {
            assembler.push(packet, &mut |w| ready.push(w));
            for window in ready.drain(..) {
                pipeline.analyse(&mut worker, &window, &mut analysis);
                pipeline.judge(&analysis, &mut verdicts);
                black_box(&verdicts);
                assembler.recycle(window);
            }
        }
    });
}

fn transform(bencher: divan::Bencher<'_, '_>, hop: usize) {
    let plan = RealFftPlanner::<f64>::new().plan_fft_forward(WINDOW);
    let signal: Vec<f64> = signal().into_iter().map(f64::from).collect();
    let mut input = plan.make_input_vec();
    let mut output = plan.make_output_vec();
    let mut scratch = plan.make_scratch_vec();
    bencher.counter(ItemsCount::new(SECONDS * WINDOW)).bench_local(|| {
        let mut at = 0;
        while at + WINDOW <= signal.len() {
            input.copy_from_slice(&signal[at..at + WINDOW]);
            plan.process_with_scratch(&mut input, &mut output, &mut scratch).expect("lengths fit");
            black_box(&output);
            at += hop;
        }
    });
}

#[divan::bench]
fn row_50_percent_mesh_lines(bencher: divan::Bencher<'_, '_>) {
    row(bencher, 0.5, false);
}

#[divan::bench]
fn row_50_percent_tacho(bencher: divan::Bencher<'_, '_>) {
    row(bencher, 0.5, true);
}

#[divan::bench]
fn row_90_percent_mesh_lines(bencher: divan::Bencher<'_, '_>) {
    row(bencher, 0.1, false);
}

#[divan::bench]
fn transform_50_percent(bencher: divan::Bencher<'_, '_>) {
    transform(bencher, WINDOW / 2);
}

#[divan::bench]
fn transform_90_percent(bencher: divan::Bencher<'_, '_>) {
    transform(bencher, 1638);
}
