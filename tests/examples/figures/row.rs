//! From packets to verdicts, beside bare real transforms of the same windows.

use std::hint::black_box;
use std::sync::Arc;

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::bench::Bench;
use gearwatch_core::block::{Block, Packet, Quality, Samples, TachoBlock};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use realfft::RealFftPlanner;
use serde_json::{Value, json};

use crate::{Failure, seconds};

/// Of the motor (Hz); a little off the 25 Hz of the bench file, so that the speed must be found.
const SPEED_HZ: f64 = 25.013;
/// Teeth of pinions and wheels, from the first stage on.
const TEETH: [(u32, u32); 4] = [(29, 100), (36, 90), (31, 70), (25, 60)];
/// Rounds within one run of the program.
const ROUNDS: usize = 7;

/// What is analysed.
#[derive(Clone, Copy)]
struct Case {
    channels: usize,
    rate_hz: f64,
    window_s: f64,
    hop_s: f64,
    stages: usize,
    tacho: bool,
    seconds: f64,
}

const USUAL: Case =
    Case { channels: 1, rate_hz: 16_384.0, window_s: 1.0, hop_s: 0.5, stages: 2, tacho: false, seconds: 8.0 };

/// Seconds for the whole row at 50 and 90 % overlap, and for transforms of the windows at 50 %.
pub(crate) fn figures() -> Result<Value, Failure> {
    let length = (USUAL.rate_hz * USUAL.window_s) as usize;
    let windows = ((USUAL.seconds - USUAL.window_s) / USUAL.hop_s) as usize + 1;
    let plan = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let (mut input, mut output, mut scratch) = (plan.make_input_vec(), plan.make_output_vec(), plan.make_scratch_vec());
    let signal: Vec<f64> = signal(&USUAL).into_iter().map(f64::from).collect();
    let bare = seconds(ROUNDS, || {
        for at in (0..windows).map(|k| k * length / 2) {
            input.copy_from_slice(&signal[at..at + length]);
            plan.process_with_scratch(&mut input, &mut output, &mut scratch)?;
            black_box(&output);
        }
        Ok(())
    })?;
    Ok(json!({
        "bare": bare,
        "transform": bare / windows as f64,
        "mesh lines": row(USUAL)?,
        "tacho": row(Case { tacho: true, ..USUAL })?,
        "90 %": row(Case { hop_s: 0.1, ..USUAL })?,
    }))
}

/// Seconds for a second of signals of one size.
pub(crate) fn scaling(kind: &str, size: f64) -> Result<Value, Failure> {
    let case = Case { seconds: 4.0, ..USUAL };
    let case = match kind {
        "channels" => Case { channels: size as usize, ..case },
        "rate" => Case { rate_hz: size, ..case },
        "overlap" => Case { hop_s: 1.0 / size, ..case },
        "window" => Case { window_s: size, hop_s: size / 2.0, seconds: 4.0 * size, ..case },
        "stages" => Case { stages: size as usize, ..case },
        other => return Err(format!("expected channels, rate, overlap, window or stages, found {other}").into()),
    };
    Ok(json!({ "seconds": row(case)? / case.seconds }))
}

fn row(case: Case) -> Result<f64, Failure> {
    let mut config = PipelineConfig { indicators: false, ..PipelineConfig::default() };
    config.window.length_s = case.window_s;
    config.window.hop_s = case.hop_s;
    let pipeline = Pipeline::new(&bench(&case)?, &config, None)?;
    let packets = packets(&case);
    let mut worker = pipeline.worker();
    let mut analysis = WindowAnalysis::empty();
    let (mut verdicts, mut ready) = (Vec::new(), Vec::new());
    seconds(ROUNDS, || {
        let mut assembler = pipeline.assembler();
        for packet in &packets {
            assembler.push(packet, &mut |window| ready.push(window));
            for window in ready.drain(..) {
                pipeline.analyse(&mut worker, &window, &mut analysis);
                pipeline.judge(&analysis, &mut verdicts);
                black_box(&verdicts);
                assembler.recycle(window);
            }
        }
        Ok(())
    })
}

fn bench(case: &Case) -> Result<Bench, Failure> {
    let shafts: Vec<Value> = (0..=case.stages).map(|k| json!({ "name": format!("shaft{k}") })).collect();
    let stage = |(k, &(pinion, wheel)): (usize, &(u32, u32))| json!({ "name": format!("stage{}", k + 1), "pinion": { "teeth": pinion }, "wheel": { "teeth": wheel } });
    let stages: Vec<Value> = TEETH.iter().take(case.stages).enumerate().map(stage).collect();
    let mut text = json!({
        "format": "gearwatch-bench/1", "name": "bench", "motor": { "speed_hz": 25.0 }, "shaft": shafts, "stage": stages,
    });
    if case.tacho {
        text["tacho"] = json!({ "shaft": "shaft0", "pulses_per_rev": 1.0 });
    }
    Ok(serde_json::from_value(text)?)
}

/// Five mesh lines of each stage, as far as the rate holds them, in noise: the fractional part of a
/// large multiple, which is as good as white here.
fn signal(case: &Case) -> Vec<f32> {
    let mut frequency_hz = SPEED_HZ;
    let mut lines = Vec::new();
    for &(pinion, wheel) in TEETH.iter().take(case.stages) {
        let mesh_hz = frequency_hz * f64::from(pinion);
        lines.extend((1..=5).map(|h| mesh_hz * f64::from(h)).filter(|&line| line < 0.45 * case.rate_hz));
        frequency_hz *= f64::from(pinion) / f64::from(wheel);
    }
    let value = |i: usize| {
        let t = i as f64 / case.rate_hz;
        let tones: f64 = lines.iter().map(|line| (std::f64::consts::TAU * line * t).cos()).sum();
        let noise = ((i as f64 * 0.754_877_666_2 + 0.1).sin() * 43_758.545_3).fract();
        (tones + 0.3 * noise) as f32
    };
    (0..(case.seconds * case.rate_hz) as usize).map(value).collect()
}

/// Blocks of a tenth of a second, all channels side by side with the same samples.
fn packets(case: &Case) -> Vec<Packet> {
    let signal = signal(case);
    let sensors: Vec<Arc<str>> = (0..case.channels).map(|k| format!("acc_{k}").into()).collect();
    let mut out = Vec::new();
    if case.tacho {
        let pulses = (-2..(case.seconds * 26.0) as i64).map(|i| (i as f64 / SPEED_HZ * 1e9) as i64);
        out.push(Packet::Tacho(TachoBlock {
            shaft: "shaft0".into(),
            t0: 0,
            pulses_per_rev: 1.0,
            pulse_times: pulses.collect(),
            quality: Quality::GOOD,
        }));
    }
    let length = (case.rate_hz / 10.0) as usize;
    for (i, chunk) in signal.chunks(length).enumerate() {
        out.extend(sensors.iter().map(|sensor| {
            Packet::Vibration(Block {
                sensor: sensor.clone(),
                t0: ((i * length) as f64 / case.rate_hz * 1e9).round() as i64,
                sample_rate_hz: case.rate_hz,
                first_sample_index: (i * length) as u64,
                unit: "m/s^2".into(),
                samples: Samples::Physical(chunk.to_vec()),
                quality: Quality::GOOD,
            })
        }));
    }
    out
}
