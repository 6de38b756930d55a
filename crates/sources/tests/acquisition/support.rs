//! A ramp to be played, sources by their configuration, and a judge of what came.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_emulate::{Instrument, InstrumentConfig, Open};
use gearwatch_runtime::kinds;
use gearwatch_runtime::stop::Stop;
use gearwatch_sources::{Feed, KINDS, Pull, Push, SourceConfig, SourceContext, SourceError, Speed};
use toml::{Table, Value};

pub const RATE_HZ: f64 = 16_384.0;
/// Samples of a block of the ramp.
const BLOCK: u64 = 256;
/// The ramp begins anew after so many samples: 8 minutes.
const PERIOD: i64 = 1 << 23;
/// Full scale of an emulated channel of unit 1: 10 V range with 1.5 dB of headroom, 1 V per unit.
const FULL_SCALE: f64 = 11.885022274370185;

/// Sample number n of every channel is the count n, so that each sample says where it belongs.
pub fn ramp(sensors: &'static [&'static str]) -> Open {
    Arc::new(move || {
        let (mut block, mut channel) = (0_u64, 0);
        let pull: Pull = Box::new(move || {
            let first = block * BLOCK;
            let count = |n: u64| (n as i64 % PERIOD) as i32;
            let packet = Packet::Vibration(Block {
                sensor: sensors[channel].into(),
                t0: (first as f64 / RATE_HZ * 1e9) as i64,
                sample_rate_hz: RATE_HZ,
                first_sample_index: first,
                unit: "1".into(),
                samples: Samples::Counts {
                    counts: (first..first + BLOCK).map(count).collect(),
                    scale: FULL_SCALE / PERIOD as f64,
                    offset: 0.0,
                },
                quality: Quality::GOOD,
            });
            channel = (channel + 1) % sensors.len();
            block += u64::from(channel == 0);
            Ok(Some(packet))
        });
        Ok(pull)
    })
}

/// The next block of a source.
pub fn block(pull: &mut Pull) -> Block {
    match pull().unwrap() {
        Some(Packet::Vibration(block)) => block,
        other => panic!("{other:?}"),
    }
}

/// Physical values of a block.
pub fn values(block: &Block) -> &[f32] {
    match &block.samples {
        Samples::Physical(values) => values,
        Samples::Counts { .. } => panic!("counts"),
    }
}

pub fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap()
}

/// An instrument that plays the ramp at so many times the real speed.
pub fn instrument(runtime: &tokio::runtime::Runtime, times: f64, config: InstrumentConfig) -> Instrument {
    let config = InstrumentConfig { speed: Speed::Times(times), detection: Duration::from_millis(20), ..config };
    Instrument::start(config, ramp(&["acc_1", "acc_2"]), runtime.handle()).unwrap()
}

/// A source by its keys, and a context whose data deadline is short.
pub struct Opened {
    config: Box<dyn SourceConfig>,
    pub context: SourceContext,
}

pub const DEADLINE: Duration = Duration::from_millis(400);

pub fn source(keys: &str) -> Opened {
    let mut keys: Table = toml::from_str(keys).unwrap();
    let Some(Value::String(kind)) = keys.remove("kind") else { panic!("there is no kind") };
    let (config, _) = kinds::find(KINDS, &kind, "source").unwrap().read(keys).unwrap();
    assert_eq!(config.problems(), Vec::<String>::new());
    let bench = gearwatch_io::bench_file::parse(gearwatch_sim::shipped::DEMO_BENCH, Path::new("demo")).unwrap();
    let context = SourceContext::new(Arc::new(bench), PathBuf::new(), Stop::default());
    Opened { config, context: SourceContext { data_deadline: DEADLINE, ..context } }
}

impl Opened {
    pub fn open(&self) -> Result<Pull, SourceError> {
        match self.config.open(&self.context)? {
            Feed::Pull(pull) => Ok(pull),
            Feed::Push(_) => panic!("this one is pulled"),
        }
    }

    pub fn open_push(&self) -> Result<Push, SourceError> {
        match self.config.open(&self.context)? {
            Feed::Push(push) => Ok(push),
            Feed::Pull(_) => panic!("this one pushes"),
        }
    }

    /// Opens and reads for so long, again after each error, as the service would but without its
    /// pauses; what was wrong each time.
    pub fn read_for(&self, time: Duration, judge: &mut Judge) -> Vec<String> {
        let began = Instant::now();
        let mut errors = Vec::new();
        while began.elapsed() < time {
            let end = self.open().and_then(|mut pull| {
                while began.elapsed() < time {
                    let Some(packet) = pull()? else { break };
                    judge.take(&packet);
                }
                Ok(())
            });
            errors.extend(end.err().map(|e| e.to_string()));
        }
        errors
    }
}

/// Watches that samples follow each other wherever no gap is told.
#[derive(Debug, Default)]
pub struct Judge {
    /// By sensor: index and count of the next sample.
    next: BTreeMap<String, (u64, i64)>,
    pub samples: u64,
    pub gaps: u64,
    /// Samples that are missing according to the indices.
    pub missing: u64,
    /// Samples alone among right ones that are wrong: a flipped bit in a sample, which no checksum
    /// protects.
    pub wrong_alone: u64,
    /// Samples that do not follow, without a gap before them.
    pub desynchronised: u64,
    /// Gaps whose length by index is not that of the ramp.
    pub wrong_length: u64,
    pub qualities: BTreeSet<u32>,
}

impl Judge {
    pub fn take(&mut self, packet: &Packet) {
        let Packet::Vibration(block) = packet else { return };
        // Counts, whatever the scale: what is watched is the order.
        let counts: Vec<i64> = match &block.samples {
            Samples::Counts { counts, .. } => counts.iter().map(|&c| c.into()).collect(),
            Samples::Physical(values) => {
                values.iter().map(|&v| (f64::from(v) * PERIOD as f64 / FULL_SCALE).round() as i64).collect()
            }
        };
        self.qualities.insert(block.quality.0);
        self.samples += counts.len() as u64;
        let first = block.first_sample_index;
        let gap = block.quality.contains(Quality::GAP_BEFORE);
        let next = self.next.get(&*block.sensor).copied();
        let mut expected = counts[0];
        if let Some((index, count)) = next {
            assert!(first >= index, "{}: index {first} after {index}", block.sensor);
            if gap || first > index {
                self.gaps += 1;
                self.missing += first - index;
                self.wrong_length += u64::from((expected - count).rem_euclid(PERIOD) != (first - index) as i64);
            } else {
                expected = count;
            }
        }
        for (i, &count) in counts.iter().enumerate() {
            if count != expected {
                // Alone, if the next one is where it should be.
                let alone = counts.get(i + 1).is_none_or(|&after| after == (expected + 1).rem_euclid(PERIOD));
                self.wrong_alone += u64::from(alone);
                self.desynchronised += u64::from(!alone);
                expected = if alone { expected } else { count };
            }
            expected = (expected + 1).rem_euclid(PERIOD);
        }
        self.next.insert(block.sensor.to_string(), (first + counts.len() as u64, expected));
    }
}

/// Waits until something is so; fails after ten seconds.
pub fn wait_until(what: &str, mut so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !so() {
        assert!(began.elapsed() < Duration::from_secs(10), "{what}: not after ten seconds");
        std::thread::sleep(Duration::from_millis(5));
    }
}
