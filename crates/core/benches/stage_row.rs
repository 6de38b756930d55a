//! The whole stage row beside the bare real transforms of the same windows:
//! `cargo bench -p gearwatch-core`.
//!
//! Two stages, 16 384-sample windows, one channel, one core. Items are new samples: at 90 % overlap
//! each is looked at ten times. `row_*` is packets to verdicts; `transform_*` is `realfft` in f64
//! on the same windows and nothing else. Before them the share of each stage is printed, in bare
//! transforms of a window: the fastest of many rounds for each.

#![allow(clippy::print_stdout, reason = "the shares are what the benchmark is run for")]

use std::hint::black_box;
use std::time::Instant;

use divan::counter::ItemsCount;
use gearwatch_core::analysis::{StageAnalysis, WindowAnalysis};
use gearwatch_core::bench::Bench;
use gearwatch_core::block::{Block, Packet, Quality, Samples, TachoBlock};
use gearwatch_core::health::instrument_state;
use gearwatch_core::indicators::Indicators;
use gearwatch_core::indicators::plan::{IndicatorState, Known};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::spectral::angle::AngleTrack;
use gearwatch_core::spectral::harmonics::KnownAngle;
use gearwatch_core::spectral::plan::RatePlan;
use gearwatch_core::verdict::InstrumentState;
use gearwatch_core::window::Window;
use realfft::RealFftPlanner;

const RATE_HZ: f64 = 16_384.0;
const WINDOW: usize = 16_384;
const SECONDS: usize = 8;
const MESH_ORDERS: [f64; 2] = [29.0, 10.44];

/// Rounds of which the fastest counts, for the shares.
const ROUNDS: usize = 60;

fn main() {
    let measuring = std::env::args().any(|a| a == "--bench") && std::env::args().len() == 2;
    if measuring {
        print_shares();
    }
    divan::main();
}

/// The windows of the signal at 50 % overlap.
fn windows(pipeline: &Pipeline) -> Vec<Window> {
    let (mut assembler, mut out) = (pipeline.assembler(), Vec::new());
    for packet in packets(false) {
        assembler.push(&packet, &mut |w| out.push(w));
    }
    out
}

/// Fastest of many rounds over all windows (s a window).
fn fastest(count: usize, mut round: impl FnMut()) -> f64 {
    let once = |round: &mut dyn FnMut()| {
        let start = Instant::now();
        round();
        start.elapsed().as_secs_f64()
    };
    (0..ROUNDS).map(|_| once(&mut round)).fold(f64::INFINITY, f64::min) / count as f64
}

fn print_shares() {
    let config = PipelineConfig::default();
    let pipeline = Pipeline::new(&bench(false), &config, None).expect("a pipeline");
    let windows = windows(&pipeline);
    let count = windows.len();
    let packets = packets(false);
    let train = pipeline.train();
    let plan = RatePlan::new(train, &config.speed, WINDOW, RATE_HZ);
    let mut state = plan.state();
    let (start, highest_bin) = (train.nominal_input_hz * WINDOW as f64 / RATE_HZ, config.usable_band * WINDOW as f64);

    let real = RealFftPlanner::<f64>::new().plan_fft_forward(WINDOW);
    let (mut output, mut scratch) = (real.make_output_vec(), real.make_scratch_vec());
    let mut input = real.make_input_vec();
    let bare = fastest(count, || {
        for window in &windows {
            input.copy_from_slice(&window.samples);
            real.process_with_scratch(&mut input, &mut output, &mut scratch).expect("lengths fit");
            black_box(&output);
        }
    });
    let mut shares: Vec<(&str, f64)> = Vec::new();
    let assemble = fastest(count, || {
        let mut assembler = pipeline.assembler();
        let mut ready = None;
        for packet in &packets {
            assembler.push(packet, &mut |w| ready = Some(w));
            if let Some(window) = ready.take() {
                assembler.recycle(black_box(window));
            }
        }
    });
    shares.push(("assemble", assemble));
    shares.push((
        "health",
        fastest(count, || {
            windows.iter().for_each(|w| assert_ne!(instrument_state(w, 10.0), InstrumentState::NotFinite))
        }),
    ));
    shares.push((
        "weigh and transform",
        fastest(count, || windows.iter().for_each(|w| plan.transform(&w.samples, &mut state))),
    ));
    let speed = fastest(count, || {
        for window in &windows {
            black_box(plan.mesh_speed(&mut state, &window.samples, start, highest_bin));
        }
    });
    shares.push(("speed from mesh lines", speed));
    let mut track = AngleTrack::default();
    let mesh = plan.mesh_speed(&mut state, &windows[0].samples, start, highest_bin).expect("a speed");
    track.set_polynomial(&mesh.coefficients);
    let mut stages = vec![StageAnalysis::UNKNOWN; train.stages.len()];
    let lines = fastest(count, || {
        for _ in &windows {
            let angle = KnownAngle { track: &track, variance: mesh.angle_variance };
            plan.lines(&mut state, train, angle, highest_bin, &mut stages);
            black_box(&stages);
        }
    });
    shares.push(("lines", lines));
    let mut indicators = IndicatorState::default();
    let mut found = Indicators::unknown(train.stages.len());
    plan.transform(&windows[0].samples, &mut state);
    let of_channel = fastest(count, || {
        for window in &windows {
            let known = Known { unit: "m/s^2", spectrum: plan.weighted(&state), usable_band: config.usable_band };
            indicators.channel(&window.samples, &known, &mut found);
            black_box(&found);
        }
    });
    shares.push(("indicators of the channel", of_channel));
    let of_gears = fastest(count, || {
        for window in &windows {
            indicators.gears(train, &window.samples, &track, &mut found);
            black_box(&found);
        }
    });
    shares.push(("indicators of the gears", of_gears));
    let mut worker = pipeline.worker();
    let mut analysis = WindowAnalysis::empty();
    pipeline.analyse(&mut worker, &windows[0], &mut analysis);
    let mut verdicts = Vec::new();
    shares.push(("judge", fastest(count, || windows.iter().for_each(|_| pipeline.judge(&analysis, &mut verdicts)))));
    println!("stage                      µs a window   bare transforms");
    for (name, seconds) in
        shares.iter().copied().chain([("sum", shares.iter().map(|s| s.1).sum()), ("bare transform", bare)])
    {
        println!("{name:26} {:11.1} {:17.2}", 1e6 * seconds, seconds / bare);
    }
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

/// Mesh lines of both stages in noise; the noise is the fractional part of a large multiple, which
/// is as good as white here.
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

fn row(bencher: divan::Bencher<'_, '_>, hop_s: f64, tacho: bool, indicators: bool) {
    let mut config = PipelineConfig { indicators, ..PipelineConfig::default() };
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
    row(bencher, 0.5, false, false);
}

#[divan::bench]
fn row_50_percent_tacho(bencher: divan::Bencher<'_, '_>) {
    row(bencher, 0.5, true, false);
}

#[divan::bench]
fn row_90_percent_mesh_lines(bencher: divan::Bencher<'_, '_>) {
    row(bencher, 0.1, false, false);
}

#[divan::bench]
fn row_50_percent_mesh_lines_with_indicators(bencher: divan::Bencher<'_, '_>) {
    row(bencher, 0.5, false, true);
}

#[divan::bench]
fn row_50_percent_tacho_with_indicators(bencher: divan::Bencher<'_, '_>) {
    row(bencher, 0.5, true, true);
}

#[divan::bench]
fn transform_50_percent(bencher: divan::Bencher<'_, '_>) {
    transform(bencher, WINDOW / 2);
}

#[divan::bench]
fn transform_90_percent(bencher: divan::Bencher<'_, '_>) {
    transform(bencher, 1638);
}
