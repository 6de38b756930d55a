//! The way of the samples: a sender at the sensor, a network that loses and changes what it
//! carries, and the service's own decoder, numbering, windows and verdicts behind it.
//!
//! Every sample says by its value where it belongs, so that whatever comes out can be judged by the
//! formula alone.

use std::collections::VecDeque;
use std::sync::Arc;

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::assemble::{Assembler, Gap as MissingSamples};
use gearwatch_core::bench::Bench;
use gearwatch_core::block::{Packet, Samples};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig, WorkerState};
use gearwatch_core::verdict::Verdict;
use gearwatch_core::window::{Window, WindowConfig};
use gearwatch_io::frames::{Decoded, Decoder, Frame, Values, encode};
use gearwatch_sources::frames::{Layout, Memory, Reader};

use crate::trouble::Chance;

/// Samples of a second, and of a frame.
const RATE_HZ: u64 = 1024;
const FRAME: u64 = 256;

const BENCH: &str = r#"format = "gearwatch-bench/1"
name = "bench"
[motor]
speed_hz = 3.0
[[shaft]]
name = "input"
[[shaft]]
name = "output"
[[stage]]
name = "stage1"
pinion = { teeth = 29 }
wheel = { teeth = 100 }
[[sensor]]
name = "acc_1"
shaft = "input"
[brake]
torque_nm = 50.0
[acquisition]
sample_rate_hz = 1024.0
"#;

/// The signal: the mesh at 87 Hz, its double, and noise that follows from the number of the sample.
pub fn signal(sample: u64) -> f32 {
    let turns = |hz: u64| ((sample * hz) % RATE_HZ) as f64 / RATE_HZ as f64 * std::f64::consts::TAU;
    let noise = Chance::new(sample).below(1000) as f64 / 1e4 - 0.05;
    (turns(87).sin() + 0.3 * turns(174).cos() + noise) as f32
}

/// What one side of the line told the other, and when it gets there.
struct Carried {
    due_ms: u64,
    bytes: Vec<u8>,
}

/// Sender and network. They outlive the service.
pub struct Line {
    stream: u64,
    sequence: u64,
    sample: u64,
    under_way: VecDeque<Carried>,
    /// The sender sends nothing until then; its samples go on.
    pub silent_until: u64,
    /// The network holds everything back until then.
    pub held_until: u64,
    /// A bit of the next frame is changed.
    pub flip: Option<u64>,
    /// The connection is lost until then, and what was under way with it.
    down_until: u64,
}

impl Line {
    pub fn new(stream: u64) -> Self {
        Self {
            stream,
            sequence: 0,
            sample: 0,
            under_way: VecDeque::new(),
            silent_until: 0,
            held_until: 0,
            flip: None,
            down_until: 0,
        }
    }

    /// A quarter of a second at the sensor. Without a connection the samples are lost, and the
    /// sender goes on counting.
    pub fn sample(&mut self, now_ms: u64, wall_ns: i64, connected: bool) {
        let first_sample = self.sample;
        self.sample += FRAME;
        if now_ms < self.silent_until {
            return;
        }
        let values = Values::Physical((first_sample..self.sample).map(signal).collect());
        let frame = Frame {
            stream: self.stream,
            sequence: self.sequence,
            first_sample,
            t0: wall_ns,
            sample_rate_hz: RATE_HZ as f64,
            channels: 1,
            quality: 0,
            values,
        };
        self.sequence += 1;
        if !connected || now_ms < self.down_until {
            return;
        }
        let mut bytes = Vec::new();
        encode(&frame, &mut bytes);
        if let Some(at) = self.flip.take() {
            let bit = usize::try_from(at).unwrap_or(0) % (bytes.len() * 8);
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        self.under_way.push_back(Carried { due_ms: now_ms.max(self.held_until), bytes });
    }

    /// The connection is lost.
    pub fn cut(&mut self, until_ms: u64) {
        self.down_until = until_ms;
        self.under_way.clear();
    }

    /// What has come through, in pieces of any size.
    pub fn deliver(&mut self, now_ms: u64, chance: &mut Chance) -> Vec<Vec<u8>> {
        let mut pieces = Vec::new();
        while self.under_way.front().is_some_and(|carried| carried.due_ms.max(self.held_until) <= now_ms) {
            let mut rest = self.under_way.pop_front().map(|carried| carried.bytes).unwrap_or_default();
            while !rest.is_empty() {
                let length = 1 + chance.below(rest.len() as u64) as usize;
                let tail = rest.split_off(length);
                pieces.push(std::mem::replace(&mut rest, tail));
            }
        }
        pieces
    }
}

/// What the service's side has to tell.
pub enum Heard {
    Verdicts(Window, Vec<Verdict>),
    Missing(MissingSamples),
}

/// The service's side. It dies with the service.
pub struct Intake {
    pipeline: Arc<Pipeline>,
    decoder: Decoder,
    memory: Memory,
    reader: Reader,
    assembler: Assembler,
    worker: WorkerState,
    /// The sender's number of the sample that is the first one here.
    origin: Option<u64>,
    /// The sample behind the last one that came, as the sender counts.
    end: u64,
    /// The number of the frame behind the last one that came.
    next_frame: Option<u64>,
    /// What this side saw of the network's faults.
    pub seen: Seen,
    pub lies: Vec<String>,
}

/// Faults as the side sees them that did not make them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    /// Times at which the decoder passed over bytes.
    pub damaged: u64,
    /// Times at which frames were missing.
    pub lost: u64,
    /// Times at which samples were missing between two frames that follow each other.
    pub silent: u64,
    /// Times at which more than a second came at once.
    pub bursts: u64,
}

impl Intake {
    pub fn new() -> Self {
        let bench: Bench = toml::from_str(BENCH).expect("the bench of this test is one");
        let config = PipelineConfig {
            window: WindowConfig { length_s: 1.0, hop_s: 1.0, ..WindowConfig::default() },
            ..PipelineConfig::default()
        };
        let pipeline = Arc::new(Pipeline::new(&bench, &config, None).expect("the bench of this test can be watched"));
        let memory = Memory::default();
        Self {
            decoder: Decoder::default(),
            reader: Reader::new(&layout(), &memory),
            memory,
            assembler: pipeline.assembler(),
            worker: pipeline.worker(),
            pipeline,
            origin: None,
            end: 0,
            next_frame: None,
            seen: Seen::default(),
            lies: Vec::new(),
        }
    }

    /// A connection was lost: the next one begins with a frame.
    pub fn connect_again(&mut self) {
        self.decoder = Decoder::default();
        self.reader = Reader::new(&layout(), &self.memory);
    }

    /// Takes what came at once.
    pub fn take(&mut self, pieces: &[Vec<u8>]) -> Vec<Heard> {
        let (mut frames, mut heard) = (Vec::new(), Vec::new());
        for bytes in pieces {
            self.decoder.push(bytes, &mut |decoded| match decoded {
                Decoded::Frame(frame) => frames.push(frame),
                Decoded::Lost(_) => self.seen.damaged += 1,
            });
        }
        self.seen.bursts += u64::from(frames.len() as u64 * FRAME > RATE_HZ);
        for frame in frames {
            self.frame(frame, &mut heard);
        }
        heard
    }

    fn frame(&mut self, frame: Frame, heard: &mut Vec<Heard>) {
        let (first, count) = (frame.first_sample, frame.values.len() as u64);
        match self.next_frame.replace(frame.sequence + 1) {
            Some(next) if next == frame.sequence => self.seen.silent += u64::from(first > self.end),
            Some(_) => self.seen.lost += 1,
            None => {}
        }
        let mut packets = VecDeque::new();
        if let Err(error) = self.reader.take(frame, &mut packets) {
            self.lies.push(error.to_string());
        }
        for packet in packets {
            if let Packet::Vibration(block) = &packet {
                let origin = *self.origin.get_or_insert(first - block.first_sample_index.min(first));
                let right = |(i, value): (usize, &f32)| *value == signal(origin + block.first_sample_index + i as u64);
                let Samples::Physical(values) = &block.samples else { continue };
                if !values.iter().enumerate().all(right) {
                    self.lies.push(format!("sample {} is not where it belongs", block.first_sample_index));
                }
                self.end = first + count;
            }
            let mut windows = Vec::new();
            self.assembler.push(&packet, &mut |window| windows.push(window));
            heard.extend(self.assembler.take_gaps().map(Heard::Missing));
            for window in windows {
                self.window(window, heard);
            }
        }
    }

    fn window(&mut self, window: Window, heard: &mut Vec<Heard>) {
        let origin = self.origin.unwrap_or(0) + window.first_sample_index;
        let right = |(i, value): (usize, &f64)| *value == f64::from(signal(origin + i as u64));
        if !window.samples.iter().enumerate().all(right) {
            self.lies.push(format!("window {} is not what the sensor measured", window.number));
        }
        let (mut analysis, mut verdicts) = (WindowAnalysis::empty(), Vec::new());
        self.pipeline.analyse(&mut self.worker, &window, &mut analysis);
        self.pipeline.judge(&analysis, &mut verdicts);
        heard.push(Heard::Verdicts(window, verdicts));
    }

    /// Every sample since the first one that came is in a window, thrown away, waiting, or missing;
    /// each of them counted once.
    pub fn account(&mut self) {
        let counters = *self.assembler.counters();
        let kept = counters.samples_in_windows + counters.samples_discarded + counters.samples_pending;
        let span = self.origin.map_or(0, |origin| self.end - origin);
        if counters.samples_in != kept || span != counters.samples_in + counters.samples_missing {
            self.lies.push(format!("{span} samples from the first to the last, and {counters:?}"));
        }
    }
}

fn layout() -> Layout {
    toml::from_str("channels = [\"acc_1\"]").expect("a layout")
}
