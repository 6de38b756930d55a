//! The stream: material becomes messages, and messages meet with trouble.

use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use gearwatch_core::block::{Block, Packet, Quality};
use gearwatch_io::lanxi::{
    Body, Descriptor, FULL_SCALE, INT24, Message, QualityFlags, Signal, SignalQuality, Time, Value, encode,
};

use super::{Shared, State, count};
use crate::material::Material;
use crate::trouble::{Incident, Plan};
use crate::wire::{Gone, Wire};
use gearwatch_runtime::clock::now_unix_ns;
use gearwatch_sources::time_of;

/// Most values of a signal in one message.
const LONGEST_RUN: usize = 8192;
/// Bytes that the instrument keeps for a slow client; what comes then is lost, and told as overrun.
const MEMORY: usize = 1 << 20;
/// Bytes of a header and of what precedes the first sample.
const HEADER_AND_NUMBERS: usize = 36;
/// Nominal range to full scale: 1.5 dB.
const HEADROOM_DB: f64 = 1.5;
/// Largest and smallest 24-bit count.
const COUNTS: (i32, i32) = (-0x80_0000, 0x7f_ffff);
/// Where an overloaded channel is cut, as a share of its peak.
const CLIP_SHARE: f64 = 0.7;

/// Plays until the measurement ends or the client is gone.
pub(super) fn play(shared: &Arc<Shared>, client: TcpStream, measurement: u64) {
    let material = match Material::new(shared.open.clone(), shared.config.speed, shared.stop.clone()) {
        Ok(material) => material,
        Err(e) => return tracing::error!("nothing to play: {e}"),
    };
    let (signals, offset_ns) = {
        let recorder = shared.recorder();
        (signals(&recorder.setup), recorder.clock_offset_ns)
    };
    let trouble = &shared.config.trouble;
    let player = Player {
        shared: shared.clone(),
        measurement,
        signals,
        plan: Plan::new(trouble, measurement),
        wire: Wire::new(client, trouble.split.then_some(trouble.seed ^ measurement)),
        t0_ns: now_unix_ns().saturating_add(offset_ns),
        rate_hz: shared.rate_hz,
        pending: Vec::new(),
        clip: None,
        skip_until: 0,
        muted: false,
        flip: false,
    };
    if let Err(Gone) = player.run(material)
        && shared.recorder().state == State::Recording
        && shared.recorder().measurement == measurement
        && !shared.stop.is_given()
    {
        count(&shared.stats.closed_in_wrong_order);
    }
}

/// One enabled channel.
struct Played {
    sensor: String,
    /// Position among all channels of the instrument.
    channel: usize,
    /// Physical value of full scale.
    scale: f64,
    unit: String,
    /// Index that the material's next block should have.
    expected: Option<u64>,
    /// Samples since the measurement began, lost ones included.
    position: u64,
    flags: QualityFlags,
    overrun: bool,
}

struct Player {
    shared: Arc<Shared>,
    measurement: u64,
    signals: Vec<Played>,
    plan: Plan,
    wire: Wire,
    t0_ns: i64,
    rate_hz: f64,
    /// Signals of the next message: number, first sample, values.
    pending: Vec<(u16, u64, Vec<i32>)>,
    /// The channel that is overloaded, and until which sample.
    clip: Option<(usize, u64)>,
    /// Samples before this one are dropped.
    skip_until: u64,
    muted: bool,
    flip: bool,
}

/// The enabled channels, as the client set them up.
fn signals(setup: &serde_json::Value) -> Vec<Played> {
    let channels = setup["channels"].as_array().into_iter().flatten().enumerate();
    let enabled = channels.filter(|(_, channel)| channel["enabled"] == true);
    let played = enabled.map(|(i, channel)| {
        let range = channel["range"].as_str().and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
        let sensitivity = channel["transducer"]["sensitivity"].as_f64().unwrap_or(1.0);
        Played {
            sensor: String::new(),
            channel: i,
            scale: range.unwrap_or(10.0) * 10_f64.powf(HEADROOM_DB / 20.0) / sensitivity,
            unit: channel["transducer"]["unit"].as_str().unwrap_or("V").to_owned(),
            expected: None,
            position: 0,
            flags: QualityFlags::default(),
            overrun: false,
        }
    });
    played.collect()
}

impl Player {
    fn run(mut self, mut material: Material) -> Result<(), Gone> {
        for signal in &mut self.signals {
            signal.sensor.clone_from(&material.channels()[signal.channel].sensor);
        }
        self.interpret()?;
        while self.is_current() {
            match material.next_packet() {
                Ok(Some(Packet::Vibration(block))) => self.block(&block)?,
                Ok(Some(_)) => {}
                Ok(None) => return Ok(()),
                Err(e) => {
                    tracing::error!("the material cannot be played on: {e}");
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    fn is_current(&self) -> bool {
        let recorder = self.shared.recorder();
        recorder.state == State::Recording && recorder.measurement == self.measurement && !self.shared.stop.is_given()
    }

    /// Says what samples mean, before the first of them.
    fn interpret(&mut self) -> Result<(), Gone> {
        for (i, signal) in self.signals.iter().enumerate() {
            let values = [
                Value::DataType(INT24),
                Value::Scale(signal.scale),
                Value::Offset(0.0),
                Value::Period(Time::period_of(self.rate_hz)),
                Value::Unit(signal.unit.clone()),
                Value::VectorLength(0),
                Value::ChannelType(1),
            ];
            let all = values.map(|value| Descriptor { signal: i as u16 + 1, value });
            let message = Message { time: Time::from_unix_ns(self.t0_ns), body: Body::Interpretation(all.into()) };
            let mut bytes = Vec::new();
            encode(&message, &mut bytes);
            self.wire.put(&bytes);
        }
        self.wire.send(Duration::from_secs(1))
    }

    fn block(&mut self, block: &Block) -> Result<(), Gone> {
        let Some(at) = self.signals.iter().position(|signal| signal.sensor == *block.sensor) else { return Ok(()) };
        let signal = &mut self.signals[at];
        let gap = signal.expected.map_or(0, |expected| block.first_sample_index.saturating_sub(expected));
        if gap > 0 || block.quality.contains(Quality::GAP_BEFORE) {
            signal.position += gap;
            signal.overrun = true;
        }
        signal.expected = Some(block.first_sample_index + block.samples.len() as u64);
        let scale = FULL_SCALE / signal.scale;
        let (mut counts, mut beyond) = (Vec::with_capacity(block.samples.len()), false);
        for value in block.samples.iter() {
            let count = (value * scale).round();
            beyond |= !(f64::from(COUNTS.0)..=f64::from(COUNTS.1)).contains(&count);
            // Casts from float saturate, and NaN becomes 0.
            counts.push((count as i32).clamp(COUNTS.0, COUNTS.1));
        }
        if let Some((channel, _)) = self.clip.filter(|(channel, until)| *channel == at && signal.position < *until) {
            let _ = channel;
            let peak = counts.iter().map(|c| c.abs()).max().unwrap_or(0);
            let limit = (f64::from(peak) * CLIP_SHARE) as i32;
            counts.iter_mut().for_each(|c| *c = (*c).clamp(-limit, limit));
            beyond = true;
        }
        self.quality(at, block.quality, beyond)?;
        for run in counts.chunks(LONGEST_RUN) {
            let position = self.signals[at].position;
            self.signals[at].position += run.len() as u64;
            if at == 0 {
                self.shared.stats.samples.store(self.signals[0].position, Ordering::Relaxed);
            }
            let same = self.pending.first().is_none_or(|first| first.1 == position);
            if !same || self.pending.iter().any(|signal| usize::from(signal.0) == at + 1) {
                self.flush()?;
            }
            self.pending.push((at as u16 + 1, position, run.to_vec()));
            if self.pending.len() == self.signals.len() {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Tells the quality of a signal where it changes.
    fn quality(&mut self, at: usize, quality: Quality, beyond: bool) -> Result<(), Gone> {
        let mut flags = 0;
        for (bit, flag) in [
            (Quality::OVERLOAD, QualityFlags::CLIPPED),
            (Quality::SETTLING, QualityFlags::SETTLING),
            (Quality::INVALID, QualityFlags::INVALID),
            (Quality::SENSOR_FAULT, QualityFlags::INVALID),
        ] {
            flags |= if quality.contains(bit) { flag.0 } else { 0 };
        }
        if beyond {
            flags |= QualityFlags::CLIPPED.0;
        }
        let signal = &mut self.signals[at];
        let overrun = std::mem::take(&mut signal.overrun);
        let changed = signal.flags.0 != flags;
        signal.flags = QualityFlags(flags);
        if !changed && !overrun {
            return Ok(());
        }
        let (channel, position) = (signal.channel, signal.position);
        let told = flags | if overrun { QualityFlags::OVERRUN.0 } else { 0 };
        if changed {
            let state = &mut self.shared.recorder().overload[channel];
            *state = match (flags & QualityFlags::CLIPPED.0 != 0, *state) {
                (true, _) => "curr",
                (false, "none") => "none",
                (false, _) => "prev",
            };
        }
        if changed {
            self.shared.changed();
        }
        if overrun {
            count(&self.shared.stats.overruns);
        }
        // What was before it comes before it.
        self.flush()?;
        let entry = SignalQuality { id: at as u16 + 1, flags: QualityFlags(told) };
        self.put(position, Body::Quality(vec![entry]))
    }

    /// Sends the pending signals as one message, if nothing goes wrong.
    fn flush(&mut self) -> Result<(), Gone> {
        let Some(&(_, position, _)) = self.pending.first() else { return Ok(()) };
        let signals: Vec<_> = self.pending.drain(..).map(|(id, _, counts)| Signal { id, counts }).collect();
        self.trouble(position)?;
        if position < self.skip_until || self.wire.waiting() > MEMORY {
            // The instrument drops what it cannot keep, and says so.
            for signal in &signals {
                if let Some(played) = self.signals.get_mut(usize::from(signal.id) - 1) {
                    played.overrun = true;
                }
            }
            return self.wire.send(Duration::from_millis(1));
        }
        count(&self.shared.stats.messages);
        self.put(position, Body::Signals(signals))
    }

    fn put(&mut self, position: u64, body: Body) -> Result<(), Gone> {
        let time = Time::from_unix_ns(time_of(self.t0_ns, position, self.rate_hz));
        let mut bytes = Vec::new();
        encode(&Message { time, body }, &mut bytes);
        if std::mem::take(&mut self.flip) {
            // Every second one where it hurts: in the header and the first numbers of the payload.
            let end = if self.plan.below(2) == 0 { bytes.len() } else { bytes.len().min(HEADER_AND_NUMBERS) };
            let (at, bit) = (self.plan.below(end), self.plan.below(8));
            bytes[at] ^= 1 << bit;
            count(&self.shared.stats.flips);
        }
        if self.muted {
            return self.wire.check();
        }
        self.wire.put(&bytes);
        self.wire.send(Duration::from_millis(50))
    }

    /// Lets happen what is due.
    fn trouble(&mut self, position: u64) -> Result<(), Gone> {
        let samples = |secs: f64| (secs * self.rate_hz) as u64;
        for incident in self.plan.due(position as f64 / self.rate_hz) {
            match incident {
                Incident::Clip(secs) => {
                    self.clip = Some((self.plan.below(self.signals.len()), position + samples(secs)));
                }
                Incident::Overrun(secs) => self.skip_until = position + samples(secs),
                Incident::Stall(secs) | Incident::Delay(secs) => {
                    self.shared.stop.sleep(Duration::from_secs_f64(secs));
                }
                Incident::Flip => self.flip = true,
                Incident::Mute => self.muted = true,
                Incident::Drop => {
                    count(&self.shared.stats.drops);
                    self.wire.reset_inside(&mut self.plan);
                    return Err(Gone);
                }
            }
        }
        Ok(())
    }
}
