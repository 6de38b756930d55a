//! Known changes, and how they are put into recordings.
//!
//! The changes are made by plain operations on samples; no code of the finder takes part, but for
//! the shaft angle, without which no machine change can follow a shaft.

use std::f64::consts::TAU;

use gearwatch_core::bench::Bench;
use gearwatch_core::recording::Recording;
use gearwatch_core::train::Train;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::name::gear::gears_on;

/// A kind of change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Nothing is changed.
    Nothing,
    /// One channel louder (dB).
    Gain,
    /// All channels louder (dB).
    GainOfAll,
    /// Two channels exchanged.
    Swap,
    /// One channel at rest, but for a millionth of its noise.
    Dead,
    /// One channel turned round.
    Polarity,
    /// One channel limited: so much of its samples (%) lie at the limit.
    Clipping,
    /// 50 and 100 Hz on one channel (amplitude over the channel's standard deviation, %).
    Mains,
    /// One channel with so many bits over its range.
    Steps,
    /// Samples cut out of the middle.
    Lost,
    /// A block of samples written twice.
    Repeated,
    /// The sample clock fast (ppm).
    Clock,
    /// A resonance in the path of one channel (its share of the response).
    Resonance,
    /// All channels modulated once a turn of a shaft (%).
    Modulation,
    /// A pulse once a turn of a gear (peak over the standard deviation, %).
    Tooth,
    /// Pulses of a rolling bearing, which slip (peak over the standard deviation, %).
    Bearing,
    /// A line at an order between the mesh harmonics (amplitude over the standard deviation, %).
    Ghost,
    /// One tooth more in the sheet.
    Sheet,
}

impl Kind {
    /// Those of sensors, cables, converters and clocks.
    pub const INSTRUMENT: [Self; 11] = [
        Self::Gain,
        Self::GainOfAll,
        Self::Swap,
        Self::Dead,
        Self::Polarity,
        Self::Clipping,
        Self::Mains,
        Self::Steps,
        Self::Lost,
        Self::Repeated,
        Self::Clock,
    ];
    /// Those of the machine and its sheet.
    pub const MACHINE: [Self; 6] =
        [Self::Resonance, Self::Modulation, Self::Tooth, Self::Bearing, Self::Ghost, Self::Sheet];

    /// Sizes that are tried, ascending, and their unit.
    pub const fn sizes(self) -> (&'static [f64], &'static str) {
        match self {
            Self::Nothing | Self::Swap | Self::Dead | Self::Polarity | Self::Sheet => (&[1.0], ""),
            Self::Gain | Self::GainOfAll => (&[1.0, 3.0, 6.0], "dB"),
            Self::Clipping => (&[0.1, 1.0, 10.0], "% of samples"),
            Self::Mains => (&[1.0, 3.0, 10.0], "% of rms"),
            Self::Steps => (&[-10.0, -8.0, -6.0], "bits"),
            Self::Lost => (&[30.0, 300.0, 512.0, 3000.0], "samples"),
            Self::Repeated => (&[64.0, 512.0], "samples"),
            Self::Clock => (&[300.0, 1000.0, 3000.0, 5000.0], "ppm"),
            Self::Resonance => (&[0.1, 0.3, 1.0], "of the response"),
            Self::Modulation => (&[2.0, 5.0, 10.0, 20.0], "%"),
            Self::Tooth | Self::Bearing => (&[50.0, 100.0, 300.0], "% of rms"),
            Self::Ghost => (&[3.0, 10.0, 30.0], "% of rms"),
        }
    }

    /// In words.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Nothing => "nothing (halves of one file)",
            Self::Gain => "gain of one channel",
            Self::GainOfAll => "gain of all channels",
            Self::Swap => "two channels swapped",
            Self::Dead => "dead channel",
            Self::Polarity => "polarity reversed",
            Self::Clipping => "clipping",
            Self::Mains => "mains, 50 and 100 Hz",
            Self::Steps => "coarse steps",
            Self::Lost => "samples lost",
            Self::Repeated => "block repeated",
            Self::Clock => "sample clock",
            Self::Resonance => "resonance of a path",
            Self::Modulation => "modulation by a shaft",
            Self::Tooth => "pulse of one tooth",
            Self::Bearing => "bearing",
            Self::Ghost => "ghost",
            Self::Sheet => "one tooth more in the sheet",
        }
    }

    /// Changes of this kind on a bench, by place: what they are called in an explanation.
    pub fn places(self, bench: &Bench) -> Vec<Vec<Truth>> {
        let sensors: Vec<&str> = bench.sensors.iter().map(|s| s.name.as_str()).collect();
        let each = |effects: &[&'static str]| -> Vec<Vec<Truth>> {
            sensors.iter().map(|s| effects.iter().map(|e| Truth::new(e, *s)).collect()).collect()
        };
        let shafts = bench.shafts.iter();
        match self {
            Self::Nothing => vec![Vec::new()],
            Self::Gain => each(&["scaling"]),
            Self::GainOfAll => vec![sensors.iter().map(|s| Truth::new("scaling", *s)).collect()],
            Self::Swap => (0..sensors.len())
                .flat_map(|i| (i + 1..sensors.len()).map(move |j| (i, j)))
                .map(|(i, j)| vec![Truth::new("channels_swapped", format!("{}+{}", sensors[i], sensors[j]))])
                .collect(),
            Self::Dead => each(&["channel_dead"]),
            // Of two channels nobody can tell which was turned, and of one that it was.
            Self::Polarity if sensors.len() < 2 => Vec::new(),
            Self::Polarity if sensors.len() == 2 => {
                vec![sensors.iter().map(|s| Truth::new("polarity_reversed", *s)).collect(); 2]
            }
            Self::Polarity => each(&["polarity_reversed"]),
            Self::Clipping => each(&["clipping"]),
            Self::Mains => each(&["electrical_pickup"]),
            Self::Steps => each(&["quantisation_coarse"]),
            Self::Lost => vec![vec![Truth::new("samples_lost", "acquisition")]],
            Self::Repeated => vec![vec![Truth::new("samples_repeated", "acquisition")]],
            Self::Clock => vec![vec![Truth::new("clock_offset", "acquisition")]],
            Self::Resonance => each(&["structural_resonance", "sensor_mounting"]),
            Self::Modulation => shafts
                .enumerate()
                .map(|(k, s)| {
                    let gears = gears_on(bench, k);
                    let of_gears = gears.iter().flat_map(|g| ["eccentricity", "pitch_error"].map(|e| Truth::new(e, g)));
                    of_gears
                        .chain(
                            ["speed_fluctuation", "torque_ripple", "bearing_compliance"]
                                .map(|e| Truth::new(e, &s.name)),
                        )
                        .collect()
                })
                .collect(),
            Self::Tooth => gears(bench)
                .into_iter()
                .map(|g| ["tooth_breakage", "root_crack", "pitting"].map(|e| Truth::new(e, &g)).into())
                .collect(),
            Self::Bearing => shafts.map(|s| vec![Truth::new("bearing_defect", &s.name)]).collect(),
            Self::Ghost => bench
                .stages
                .iter()
                .map(|s| ["pinion", "wheel"].map(|g| Truth::new("ghost_component", format!("{}.{g}", s.name))).into())
                .collect(),
            Self::Sheet => gears(bench).into_iter().map(|g| vec![Truth::new("wrong_tooth_count", g)]).collect(),
        }
    }
}

/// What a change is called in an explanation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Truth {
    /// Effect id.
    pub effect: &'static str,
    /// Place.
    pub place: String,
}

impl Truth {
    fn new(effect: &'static str, place: impl Into<String>) -> Self {
        Self { effect, place: place.into() }
    }
}

fn gears(bench: &Bench) -> Vec<String> {
    bench.stages.iter().flat_map(|s| ["pinion", "wheel"].map(|g| format!("{}.{g}", s.name))).collect()
}

/// Damping of the resonance that is put into a path, and its frequency (share of the sample rate).
const DAMPING: f64 = 0.05;
const RESONANCE: f64 = 0.08;
/// Ringing of a pulse: frequency (share of the sample rate) and decay (s).
const RINGING: f64 = 0.15;
const DECAY_S: f64 = 1e-3;
/// Passages of a bearing's defect per turn of its shaft, and their slip.
const PASSAGES: f64 = 3.57;
const SLIP: f64 = 0.01;
/// Part of a tooth's turn at which its pulse comes, so that no shaft's own lines meet it in phase.
const PHASE: f64 = 0.3;

/// A change at a place and of a size.
#[derive(Clone, Copy, Debug)]
pub struct Change {
    /// Which.
    pub kind: Kind,
    /// Position among the places of its kind.
    pub place: usize,
    /// In the unit of its kind.
    pub size: f64,
}

impl Change {
    /// Makes it, in the longest run of each sensor's channel. `input_hz` is the speed of the input
    /// shaft, `seed` that of what is drawn.
    pub fn make(&self, bench: &mut Bench, recording: &mut Recording, input_hz: f64, seed: u64) {
        let sensors: Vec<String> =
            bench.sensors.iter().map(|s| s.name.clone()).filter(|s| recording.channels.contains_key(s)).collect();
        let train = Train::new(bench);
        let mut draw = ChaCha8Rng::seed_from_u64(seed);
        let size = self.size;
        let one = sensors.get(self.place).cloned();
        let db = 10f64.powf(size / 20.0);
        match self.kind {
            Kind::Nothing => {}
            Kind::Gain => on(recording, one, |x, _| x.iter_mut().for_each(|x| *x *= db)),
            Kind::GainOfAll => {
                for s in sensors {
                    on(recording, Some(s), |x, _| x.iter_mut().for_each(|x| *x *= db));
                }
            }
            Kind::Swap => swap(recording, &sensors, self.place),
            Kind::Dead => on(recording, one, |x, _| x.iter_mut().for_each(|x| *x *= 1e-6)),
            Kind::Polarity => on(recording, one, |x, _| x.iter_mut().for_each(|x| *x = -*x)),
            Kind::Clipping => on(recording, one, |x, _| clip(x, 0.01 * size)),
            Kind::Mains => on(recording, one, |x, rate| {
                let amplitude = 0.01 * size * rms(x);
                for (n, x) in x.iter_mut().enumerate() {
                    let turn = 50.0 * n as f64 / rate;
                    *x += amplitude * ((TAU * turn + 1.0).cos() + 0.5 * (TAU * 2.0 * turn + 2.0).cos());
                }
            }),
            Kind::Steps => on(recording, one, |x, _| {
                let highest = x.iter().fold(0.0f64, |h, x| h.max(x.abs()));
                let step = 2.0 * highest / 2f64.powf(-size);
                x.iter_mut().for_each(|x| *x = (*x / step).round() * step);
            }),
            Kind::Lost => cut_or_copy(recording, &sensors, size as usize, true),
            Kind::Repeated => cut_or_copy(recording, &sensors, size as usize, false),
            // A fast clock takes more samples of the same motion: the file tells the nominal rate.
            Kind::Clock => {
                for s in sensors {
                    on(recording, Some(s), |x, _| *x = resampled(x, 1.0 + 1e-6 * size));
                }
            }
            Kind::Resonance => on(recording, one, |x, rate| {
                let plain = x.clone();
                let mode = ring(&plain, RESONANCE * rate, DAMPING, rate);
                x.iter_mut().zip(mode).for_each(|(x, m)| *x += size * m);
            }),
            Kind::Modulation => {
                let order = train.shafts.get(self.place).map_or(1.0, |s| s.1);
                for s in sensors {
                    on(recording, Some(s), |x, rate| {
                        for (n, x) in x.iter_mut().enumerate() {
                            *x *= 1.0 + 0.01 * size * (TAU * order * input_hz * n as f64 / rate).cos();
                        }
                    });
                }
            }
            Kind::Tooth => {
                let (stage, pinion) = (self.place / 2, self.place.is_multiple_of(2));
                let order =
                    train.stages.get(stage).map_or(1.0, |s| if pinion { s.pinion_order } else { s.wheel_order });
                let period_s = 1.0 / (order * input_hz);
                let times: Vec<f64> = (0..10_000).map(|k| (f64::from(k) + PHASE) * period_s).collect();
                pulses(recording, &sensors, &times, 0.01 * size);
            }
            Kind::Bearing => {
                let order = train.shafts.get(self.place).map_or(1.0, |s| s.1) * PASSAGES;
                let mut t = 0.0;
                let times: Vec<f64> = (0..100_000)
                    .map(|_| {
                        t += (1.0 + SLIP * (draw.random::<f64>() - 0.5) * 12f64.sqrt()) / (order * input_hz);
                        t
                    })
                    .collect();
                pulses(recording, &sensors, &times, 0.01 * size);
            }
            Kind::Ghost => {
                let stage = train.stages.get(self.place);
                // A whole order of the wheel, a third beyond the mesh.
                let order = stage.map_or(1.0, |s| (1.37 * f64::from(s.wheel_teeth)).round() * s.wheel_order);
                for s in sensors {
                    let phase = draw.random::<f64>();
                    on(recording, Some(s), |x, rate| {
                        let amplitude = 0.01 * size * rms(x);
                        for (n, x) in x.iter_mut().enumerate() {
                            *x += amplitude * (TAU * (order * input_hz * n as f64 / rate + phase)).cos();
                        }
                    });
                }
            }
            Kind::Sheet => {
                let (stage, pinion) = (self.place / 2, self.place.is_multiple_of(2));
                if let Some(s) = bench.stages.get_mut(stage) {
                    let gear = if pinion { &mut s.pinion } else { &mut s.wheel };
                    gear.teeth += 1;
                }
            }
        }
    }
}

/// The samples of the longest run of a channel, and its rate.
fn on(recording: &mut Recording, name: Option<String>, change: impl FnOnce(&mut Vec<f64>, f64)) {
    let Some(channel) = name.and_then(|n| recording.channels.get_mut(&n)) else { return };
    let rate = channel.sample_rate_hz;
    if let Some(segment) = channel.segments.iter_mut().max_by_key(|s| s.samples.len()) {
        change(&mut segment.samples, rate);
    }
}

/// Exchanges the channels of the pair of sensors at a position among all pairs.
fn swap(recording: &mut Recording, sensors: &[String], pair: usize) {
    let mut pairs = (0..sensors.len()).flat_map(|i| (i + 1..sensors.len()).map(move |j| (i, j)));
    if let Some((i, j)) = pairs.nth(pair)
        && let (Some(a), Some(b)) = (recording.channels.remove(&sensors[i]), recording.channels.remove(&sensors[j]))
    {
        recording.channels.insert(sensors[i].clone(), b);
        recording.channels.insert(sensors[j].clone(), a);
    }
}

/// Clips the share of the samples that is largest.
fn clip(x: &mut [f64], share: f64) {
    let mut sizes: Vec<f64> = x.iter().map(|x| x.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let at = ((1.0 - share) * sizes.len() as f64) as usize;
    let limit = sizes[at.min(sizes.len() - 1)];
    x.iter_mut().for_each(|x| *x = x.clamp(-limit, limit));
}

fn rms(x: &[f64]) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len().max(1) as f64;
    (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / x.len().max(1) as f64).sqrt()
}

/// Takes samples out of the middle of all channels, or writes them twice.
fn cut_or_copy(recording: &mut Recording, sensors: &[String], count: usize, lost: bool) {
    for s in sensors {
        on(recording, Some(s.clone()), |x, _| {
            let at = x.len() * 11 / 20;
            let count = count.min(x.len() - at);
            if lost {
                x.drain(at..at + count);
            } else {
                let block = x[at..at + count].to_vec();
                x.splice(at..at, block);
            }
        });
    }
}

/// Linear phase, cubic interpolation at another rate.
fn resampled(x: &[f64], rate: f64) -> Vec<f64> {
    let count = ((x.len() - 4) as f64 * rate) as usize;
    // Windowed sine over 32 samples: good to −60 dB up to 0.45 of the rate.
    let kernel = |d: f64| {
        if d.abs() < 1e-9 {
            1.0
        } else if d.abs() >= 16.0 {
            0.0
        } else {
            let w = 0.5 + 0.5 * (std::f64::consts::PI * d / 16.0).cos();
            (std::f64::consts::PI * d).sin() / (std::f64::consts::PI * d) * w
        }
    };
    (0..count)
        .map(|n| {
            let t = n as f64 / rate;
            let from = (t as usize).saturating_sub(15);
            (from..(t as usize + 17).min(x.len())).map(|k| x[k] * kernel(t - k as f64)).sum()
        })
        .collect()
}

/// Response of one mode, its peak gain 1/(2ζ) as of an acceleration on a base (recursive filter,
/// bilinear).
fn ring(x: &[f64], hz: f64, damping: f64, rate: f64) -> Vec<f64> {
    let w = (std::f64::consts::PI * hz / rate).tan();
    let norm = 1.0 / (1.0 + 2.0 * damping * w + w * w);
    let (b0, b1, b2) = (w * w * norm, 2.0 * w * w * norm, w * w * norm);
    let (a1, a2) = (2.0 * (w * w - 1.0) * norm, (1.0 - 2.0 * damping * w + w * w) * norm);
    let (mut x1, mut x2, mut y1, mut y2) = (0.0, 0.0, 0.0, 0.0);
    x.iter()
        .map(|&x0| {
            let y = b0 * x0 + b1 * x1 + b2 * x2 - a1 * y1 - a2 * y2;
            (x2, x1, y2, y1) = (x1, x0, y1, y);
            y
        })
        .collect()
}

/// Rings each channel at these times (s), of a peak relative to its standard deviation.
fn pulses(recording: &mut Recording, sensors: &[String], times: &[f64], peak: f64) {
    for s in sensors {
        on(recording, Some(s.clone()), |x, rate| {
            let height = peak * rms(x);
            let tail = (6.0 * DECAY_S * rate) as usize;
            let last = x.len() as f64 / rate;
            for t in times.iter().take_while(|t| **t < last) {
                let first = (t * rate).ceil() as usize;
                for n in first..(first + tail).min(x.len()) {
                    let since = n as f64 / rate - t;
                    x[n] += height * (-since / DECAY_S).exp() * (TAU * RINGING * rate * since).sin();
                }
            }
        });
    }
}
