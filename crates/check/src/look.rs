//! What is looked at of a recording: its first half minute, and what its time stamps say of the
//! rest.

use std::collections::BTreeMap;
use std::sync::Arc;

use gearwatch_core::bench::Bench;
use gearwatch_core::block::{Block, Packet, Quality, UnixNanos};
use gearwatch_core::recording::Recording;
use gearwatch_core::window::Window;

use crate::steady::Run;

/// Most that is kept of each channel (s, samples).
const MOST_S: f64 = 30.0;
const MOST_SAMPLES: usize = 1 << 19;
/// A service keeps so much of so many channels; lines, speed and teeth show in them as in all. Of
/// the others it keeps this many samples.
const MOST_WHOLE: usize = 8;
const SHORT_SAMPLES: usize = 1 << 14;

/// The first seconds of a recording.
#[derive(Clone, Debug, Default)]
pub struct Look {
    /// What was kept, but for the channels.
    pub(crate) recording: Recording,
    /// By sensor name.
    pub(crate) channels: BTreeMap<String, LookChannel>,
    stamps: BTreeMap<String, Stamps>,
    begin: Option<UnixNanos>,
    /// The channels that are kept for the whole time; all where it is `None`.
    whole: Option<Vec<String>>,
}

/// One sensor's part.
#[derive(Clone, Debug)]
pub(crate) struct LookChannel {
    pub(crate) sample_rate_hz: f64,
    pub(crate) unit: Arc<str>,
    /// In time order.
    pub(crate) runs: Vec<LookRun>,
}

/// Samples without a gap, in single precision: the converters of instruments have 24 bits, and a
/// service keeps half a minute of eight channels.
#[derive(Clone, Debug)]
pub(crate) struct LookRun {
    t0: UnixNanos,
    first_sample_index: u64,
    pub(crate) samples: Vec<f32>,
}

impl LookRun {
    fn end(&self) -> u64 {
        self.first_sample_index + self.samples.len() as u64
    }
}

impl Run for LookRun {
    type Sample = f32;

    fn t0(&self) -> UnixNanos {
        self.t0
    }

    fn samples(&self) -> &[f32] {
        &self.samples
    }
}

impl LookChannel {
    fn len(&self) -> usize {
        self.runs.iter().map(|run| run.samples.len()).sum()
    }

    /// Takes in a block of a recording of which `most` samples are kept.
    fn push(&mut self, block: &Block, most: usize) {
        let follows = self.runs.last().is_some_and(|last| last.end() == block.first_sample_index);
        if !follows || block.quality.contains(Quality::GAP_BEFORE) {
            let left = ((MOST_S * self.sample_rate_hz).min(most as f64) as usize).saturating_sub(self.len());
            // All at once: what grows by doubling is twice there for a moment.
            let samples = Vec::with_capacity(left + block.samples.len());
            self.runs.push(LookRun { t0: block.t0, first_sample_index: block.first_sample_index, samples });
        }
        if let Some(last) = self.runs.last_mut() {
            last.samples.extend(block.samples.iter().map(|x| x as f32));
        }
    }
}

/// The first and the last time stamp of a channel.
#[derive(Clone, Copy, Debug)]
struct Stamps {
    first: (UnixNanos, u64),
    last: (UnixNanos, u64),
    stated_hz: f64,
}

/// A rate that the time stamps say.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StampedRate {
    pub(crate) stated_hz: f64,
    pub(crate) stamped_hz: f64,
    /// From the first stamp to the last (s).
    pub(crate) span_s: f64,
}

impl Look {
    /// Nothing yet, of a recording of this name.
    pub fn new(name: &str) -> Self {
        Self { recording: Recording { name: name.to_owned(), ..Recording::default() }, ..Self::default() }
    }

    /// Nothing yet, of a service that watches this bench: of many channels, eight spread over the
    /// sheet are kept whole.
    pub fn of_service(bench: &Bench) -> Self {
        let count = bench.sensors.len();
        let spread = (0..MOST_WHOLE).map(|i| bench.sensors[i * count / MOST_WHOLE].name.clone());
        Self { whole: (count > MOST_WHOLE).then(|| spread.collect()), ..Self::new("") }
    }

    /// Most samples that are kept of a channel.
    fn most_samples(&self, channel: &str) -> usize {
        let whole = self.whole.as_ref().is_none_or(|whole| whole.iter().any(|name| name == channel));
        if whole { MOST_SAMPLES } else { SHORT_SAMPLES }
    }

    /// The recording's name.
    pub fn name(&self) -> &str {
        &self.recording.name
    }

    /// Takes in a packet. What lies beyond the first half minute only leaves its time stamp.
    pub fn push(&mut self, packet: &Packet) {
        let t0 = match packet {
            Packet::Vibration(block) => block.t0,
            Packet::Tacho(block) => block.t0,
            Packet::OperatingPoint(point) => point.t,
        };
        if let Packet::Vibration(block) = packet {
            let now = (block.t0, block.first_sample_index);
            let fresh = Stamps { first: now, last: now, stated_hz: block.sample_rate_hz };
            self.stamps.entry(block.sensor.to_string()).or_insert(fresh).last = now;
        }
        if !self.within(t0) || self.is_full_for(packet) {
            return;
        }
        let Packet::Vibration(block) = packet else { return self.recording.push(packet.clone()) };
        let most = self.most_samples(&block.sensor);
        let fresh = || LookChannel { sample_rate_hz: block.sample_rate_hz, unit: block.unit.clone(), runs: Vec::new() };
        self.channels.entry(block.sensor.to_string()).or_insert_with(fresh).push(block, most);
    }

    /// Takes in a window of a running service: its samples that were not in the one before; its
    /// pulses are those of this shaft.
    pub fn push_window(&mut self, window: &Window, tacho_shaft: Option<&str>) {
        use gearwatch_core::block::{Samples, TachoBlock};
        let known = self.channels.get(&*window.sensor).and_then(|channel| channel.runs.last());
        let next = known.map_or(0, LookRun::end);
        let skip = usize::try_from(next.saturating_sub(window.first_sample_index)).unwrap_or(usize::MAX);
        let Some(new) = window.samples.get(skip.min(window.samples.len())..).filter(|new| !new.is_empty()) else {
            return;
        };
        let at = |samples: usize| (samples as f64 / window.sample_rate_hz * 1e9).round() as i64;
        let t0 = window.t0.saturating_add(at(skip));
        let end = window.t0.saturating_add(at(window.samples.len()));
        if self.channels.keys().next().is_none_or(|first| **first == *window.sensor) {
            self.push(&Packet::OperatingPoint(window.operating_point));
            let pulses = window.pulses.times_s.iter().map(|t| window.t0.saturating_add((t * 1e9).round() as i64));
            let pulse_times: Vec<UnixNanos> = pulses.filter(|t| (t0..end).contains(t)).collect();
            if let (Some(shaft), false) = (tacho_shaft, pulse_times.is_empty()) {
                self.push(&Packet::Tacho(TachoBlock {
                    shaft: shaft.into(),
                    t0,
                    pulses_per_rev: window.pulses.pulses_per_rev,
                    pulse_times,
                    quality: Quality::GOOD,
                }));
            }
        }
        self.push(&Packet::Vibration(Block {
            sensor: window.sensor.clone(),
            t0,
            sample_rate_hz: window.sample_rate_hz,
            first_sample_index: window.first_sample_index + skip as u64,
            unit: window.unit.clone(),
            samples: Samples::Physical(new.iter().map(|x| *x as f32).collect()),
            quality: window.quality,
        }));
    }

    /// Nothing more of what comes will be kept, but for time stamps.
    pub fn is_full(&self) -> bool {
        let mut channels = self.channels.iter().peekable();
        channels.peek().is_some()
            && channels
                .all(|(name, c)| c.len() as f64 / c.sample_rate_hz >= MOST_S || c.len() >= self.most_samples(name))
    }

    fn within(&mut self, t: UnixNanos) -> bool {
        let begin = *self.begin.get_or_insert(t);
        (t.saturating_sub(begin)) as f64 * 1e-9 < MOST_S
    }

    fn is_full_for(&self, packet: &Packet) -> bool {
        let Packet::Vibration(block) = packet else { return false };
        self.channels.get(&*block.sensor).is_some_and(|channel| channel.len() >= self.most_samples(&block.sensor))
    }

    /// Stated and stamped rates, by sensor, where there are stamps over a second or more.
    pub(crate) fn stamped_rates(&self) -> impl Iterator<Item = (&str, StampedRate)> {
        self.stamps.iter().filter_map(|(sensor, stamps)| {
            let span_s = stamps.last.0.saturating_sub(stamps.first.0) as f64 * 1e-9;
            let samples = stamps.last.1.saturating_sub(stamps.first.1) as f64;
            let known = span_s >= 1.0 && samples > 0.0;
            known.then(|| {
                (sensor.as_str(), StampedRate { stated_hz: stamps.stated_hz, stamped_hz: samples / span_s, span_s })
            })
        })
    }

    /// Torques at the brake that are stated (N m).
    pub(crate) fn torques(&self) -> impl Iterator<Item = f64> {
        self.recording.operating_points.iter().map(|point| point.brake_torque_nm).filter(|torque| torque.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use gearwatch_core::bench::Bench;
    use gearwatch_core::block::{Block, Packet, Quality, Samples};

    use super::{Look, MOST_WHOLE, SHORT_SAMPLES};

    const RATE: f64 = 16_384.0;
    const SECONDS: usize = 31;

    fn bench(channels: usize) -> Bench {
        let mut bench = gearwatch_sim::shipped::bench("paper-rig").expect("a shipped bench");
        let like = bench.sensors[0].clone();
        bench.sensors = (0..channels)
            .map(|i| {
                let mut sensor = like.clone();
                sensor.name = format!("acc_{i:02}");
                sensor
            })
            .collect();
        bench
    }

    /// Samples that are kept of each channel of a running bench.
    fn kept(channels: usize) -> Vec<usize> {
        let bench = bench(channels);
        let mut look = Look::of_service(&bench);
        for second in 0..SECONDS {
            assert_eq!(look.is_full(), second == SECONDS - 1, "second {second}");
            for sensor in &bench.sensors {
                look.push(&Packet::Vibration(Block {
                    sensor: sensor.name.as_str().into(),
                    t0: second as i64 * 1_000_000_000,
                    sample_rate_hz: RATE,
                    first_sample_index: (second * RATE as usize) as u64,
                    unit: "m/s^2".into(),
                    samples: Samples::Physical(vec![1.0; RATE as usize]),
                    quality: Quality::GOOD,
                }));
            }
        }
        assert_eq!(look.stamps.len(), channels);
        look.channels.values().map(|channel| channel.len()).collect()
    }

    /// 64 channels took 250 MB: all samples of half a minute.
    #[test]
    fn regress_a_running_bench_of_many_channels_is_looked_at_in_bounded_memory() {
        let whole = 30 * RATE as usize;
        assert_eq!(kept(MOST_WHOLE), vec![whole; MOST_WHOLE]);
        let of_many = kept(64);
        assert_eq!(of_many.iter().filter(|n| **n == whole).count(), MOST_WHOLE);
        // A block that reaches over the limit is kept whole.
        assert_eq!(of_many.iter().filter(|n| **n <= 2 * SHORT_SAMPLES).count(), 64 - MOST_WHOLE);
    }
}
