//! Recordings of helical and planetary gearboxes, made in time from tooth numbers and nothing else:
//! what meshes where, and which planet is near the sensor. Nothing here knows at which line the
//! program reads a harmonic.

use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

use gearwatch_core::bench::{Bench, Member};
use gearwatch_core::block::{Block, OperatingPoint, Packet, Quality, Samples, TachoBlock};
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};

/// Length of a recording (s).
const DURATION_S: f64 = 16.0;
/// Peak amplitude of 1x to 5x of each mesh before anything is raised (m/s²).
pub const AMPLITUDES: [f64; 5] = [1.0, 0.7, 0.5, 0.6, 0.4];
/// Standard deviation of white noise (m/s²): 6 % of the weakest line.
const NOISE: f64 = 0.025;
/// How much louder the planet at the sensor is than one a quarter and half a turn away, as
/// coefficients of a Fourier series over the carrier's angle.
pub const PASS: [f64; 5] = [1.0, 0.7, 0.35, 0.15, 0.05];
/// Seconds from the epoch.
const START_S: i64 = 1_700_000_000;

/// A mesh harmonic that is louder than normal.
#[derive(Clone, Copy)]
pub struct Raised {
    pub stage: usize,
    /// From 1.
    pub harmonic: usize,
    pub factor: f64,
}

/// SplitMix64 and Box–Muller, by hand: the figures of these tests do not change with a version of a
/// crate.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().max(1e-300).ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

/// One stage as it turns, in turns per turn of the input shaft.
struct Turning {
    first: f64,
    second: f64,
    /// Tooth meshes.
    mesh: f64,
    /// Planets and speed of the carrier, where it moves past the sensor.
    planets: Option<(Vec<f64>, f64, f64)>,
}

/// By the ratios that every book has, not by the program's own kinematics.
fn turning(bench: &Bench) -> Vec<Turning> {
    let mut speed = 1.0;
    let mut out = Vec::new();
    for stage in &bench.stages {
        let (a, b) = (f64::from(stage.pinion.teeth), f64::from(stage.wheel.teeth));
        let one = match &stage.gearing.planetary {
            None => Turning { first: speed, second: speed * a / b, mesh: speed * a, planets: None },
            Some(set) => {
                // Teeth that planets roll over: of the central gear that stands still; speed of the
                // other for one turn of the carrier.
                let rolled = match set.fixed {
                    Member::Ring => Some((b, 1.0 + b / a)),
                    Member::Sun => Some((a, 1.0 + a / b)),
                    Member::Carrier => None,
                };
                let count = f64::from(set.planets);
                let ahead: Vec<f64> = (0..set.planets).map(|i| f64::from(i) / count).collect();
                match rolled {
                    Some((teeth, other)) => {
                        let carrier = if set.input == Member::Carrier { speed } else { speed / other };
                        let second = if set.output == Member::Carrier { carrier } else { carrier * other };
                        Turning { first: speed, second, mesh: teeth * carrier, planets: Some((ahead, carrier, teeth)) }
                    }
                    None => {
                        let (driving, driven) = if set.input == Member::Sun { (a, b) } else { (b, a) };
                        Turning { first: speed, second: speed * driving / driven, mesh: speed * driving, planets: None }
                    }
                }
            }
        };
        speed = one.second;
        out.push(one);
    }
    out
}

/// Acceleration at a sensor at the angle `turns` of the input shaft.
fn signal(stages: &[Turning], sensor: usize, raised: Option<Raised>, turns: f64) -> f64 {
    let mut sum = 0.0;
    for (number, stage) in stages.iter().enumerate() {
        // Each sensor hears the stages through a path of its own.
        let path = 1.0 / (1.0 + 0.5 * (number as f64 - sensor as f64).abs());
        // Phases of the harmonics, and how near each planet is to the sensor.
        let lines = (1..=5_u8).zip(AMPLITUDES).map(|(k, amplitude)| {
            let louder = raised.filter(|r| r.stage == number && r.harmonic == usize::from(k)).map_or(1.0, |r| r.factor);
            (
                f64::from(k),
                amplitude * louder * path,
                0.4 * (f64::from(k) * 7.0 + number as f64 * 3.0 + sensor as f64 * 5.0),
            )
        });
        match &stage.planets {
            None => {
                let turned = |order: f64| (TAU * (order * turns).fract()).cos();
                let errors = 1.0 + 0.12 * turned(stage.first) + 0.08 * turned(stage.second);
                let mesh = (stage.mesh * turns).fract();
                sum += errors * lines.map(|(k, a, phase)| a * (TAU * k * mesh + phase).cos()).sum::<f64>();
            }
            Some((ahead, carrier, ring)) => {
                for position in ahead {
                    let angle = (carrier * turns + position).fract();
                    let mesh = (ring * angle).fract();
                    let near: f64 = PASS.iter().zip(0_u8..).map(|(w, n)| w * (TAU * f64::from(n) * angle).cos()).sum();
                    let meshes = lines.clone().map(|(k, a, phase)| a * (TAU * k * mesh + phase).cos());
                    sum += near * meshes.sum::<f64>() / ahead.len() as f64;
                }
            }
        }
    }
    sum
}

/// Writes a recording whose speed hunts by 0.2 % and drifts by 0.3 %.
pub fn record(bench: &Bench, seed: u64, raised: Option<Raised>, path: &Path) {
    let rate = bench.acquisition.sample_rate_hz;
    let input_hz = bench.motor.speed_hz;
    let mut random = Random(seed);
    let (hunt, begin) = (TAU * random.uniform(), random.uniform());
    let (depth, hunting_hz, drift) = (0.002, 0.7, 0.003 * (random.uniform() - 0.5));
    // The speed is `input_hz (1 + depth cos(2π hunting_hz t + hunt) + drift t / duration)`.
    let turns = |t: f64| {
        let hunted = depth * ((TAU * hunting_hz * t + hunt).sin() - hunt.sin()) / (TAU * hunting_hz);
        begin + input_hz * (t + hunted + 0.5 * drift * t * t / DURATION_S)
    };
    let stages = turning(bench);
    let time = |t: f64| START_S * 1_000_000_000 + (t * 1e9).round() as i64;
    let file = std::io::BufWriter::new(std::fs::File::create(path).unwrap());
    let mut writer = McapWriter::new(file, Compression::None, PublishTime::LogTime).unwrap();
    let mut write = |packet: &Packet| writer.write(packet).unwrap();
    write(&Packet::OperatingPoint(OperatingPoint {
        t: time(0.0),
        motor_speed_hz: bench.motor.speed_hz,
        brake_torque_nm: bench.brake.torque_nm,
        temperature_c: f64::NAN,
    }));
    let block = rate as u64;
    for second in 0..DURATION_S as u64 {
        let first = second * block;
        let t0 = first as f64 / rate;
        if let Some(tacho) = &bench.tacho {
            assert_eq!((tacho.shaft.as_str(), tacho.pulses_per_rev), (bench.shafts[0].name.as_str(), 1.0));
            let (from, until) = (turns(t0).ceil() as u64, turns(t0 + 1.0).ceil() as u64);
            let pulses = (from..until).map(|n| {
                // Newton's method on a speed that hardly changes.
                let mut t = (n as f64 - begin) / input_hz;
                for _ in 0..8 {
                    t -= (turns(t) - n as f64) / input_hz;
                }
                time(t)
            });
            write(&Packet::Tacho(TachoBlock {
                shaft: tacho.shaft.as_str().into(),
                t0: time(t0),
                pulses_per_rev: 1.0,
                pulse_times: pulses.collect(),
                quality: Quality::GOOD,
            }));
        }
        for (number, sensor) in bench.sensors.iter().enumerate() {
            let samples = (first..first + block)
                .map(|i| (signal(&stages, number, raised, turns(i as f64 / rate)) + NOISE * random.normal()) as f32);
            write(&Packet::Vibration(Block {
                sensor: Arc::from(sensor.name.as_str()),
                t0: time(t0),
                sample_rate_hz: rate,
                first_sample_index: first,
                unit: Arc::from(sensor.unit.as_str()),
                samples: Samples::Physical(samples.collect()),
                quality: Quality::GOOD,
            }));
        }
    }
    writer.finish().unwrap();
}
