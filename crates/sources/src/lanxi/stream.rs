//! From messages to packets: scale, unit, quality, gaps.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_io::lanxi::{Body, Decoded, Descriptor, FULL_SCALE, INT24, QualityFlags, Signal, Time, Value};
use gearwatch_io::units;

use super::Input;
use crate::numbering::Numbering;

/// The instrument's rate may differ from the wanted one by rounding only.
const RATE_TOLERANCE: f64 = 1e-6;
/// Its scale may differ from range × headroom / sensitivity by so much before that is told.
const SCALE_TOLERANCE: f64 = 0.01;

/// What is known of a signal before its stream begins.
#[derive(Clone, Debug, Default)]
pub(super) struct Expected {
    /// Full scale from range and sensitivity, where both are known.
    pub(super) scale: Option<f64>,
}

/// Turns messages into packets. One for each connection; only the numbering goes on.
pub(super) struct Reader {
    address: String,
    rate_hz: f64,
    signals: Vec<Channel>,
}

struct Channel {
    sensor: Arc<str>,
    expected: Expected,
    meaning: Meaning,
    /// `None` until scale, period and unit are known.
    known: Option<Known>,
    quality: Quality,
    numbering: Numbering,
    heard: Instant,
}

/// What was said of a signal so far.
#[derive(Clone, Debug, Default, PartialEq)]
struct Meaning {
    data_type: Option<u16>,
    scale: Option<f64>,
    offset: f64,
    period: Option<Time>,
    unit: Option<String>,
}

/// What samples mean.
#[derive(Clone, Debug, PartialEq)]
struct Known {
    scale: f64,
    offset: f64,
    unit: Arc<str>,
}

/// What the instrument says of a signal that cannot be read.
#[derive(Debug, PartialEq, thiserror::Error)]
pub(super) enum MeaningError {
    #[error("signal {signal} has data type {found}; only 24-bit integers ({INT24}) can be read")]
    DataType { signal: u16, found: u16 },
    #[error("signal {signal} has scale {scale}")]
    Scale { signal: u16, scale: f64 },
    #[error("signal {signal} has offset {offset}")]
    Offset { signal: u16, offset: f64 },
    #[error("signal {signal} has {found} samples per second; {wanted} were asked for")]
    Rate { signal: u16, found: f64, wanted: f64 },
    #[error("signal {signal} has vectors of {length} values")]
    Vectors { signal: u16, length: u16 },
    #[error("signal {signal} has unit {unit:?}; expected acceleration, velocity, V or 1")]
    Unit { signal: u16, unit: String },
}

impl Reader {
    pub(super) fn new(
        address: &str,
        inputs: &[Input],
        expected: &[Expected],
        rate_hz: f64,
        numberings: Vec<Numbering>,
    ) -> Self {
        let heard = Instant::now();
        let signals = inputs.iter().zip(numberings).enumerate().map(|(i, (input, numbering))| Channel {
            sensor: input.sensor.as_str().into(),
            expected: expected.get(i).cloned().unwrap_or_default(),
            meaning: Meaning::default(),
            known: None,
            quality: Quality::GOOD,
            numbering,
            heard,
        });
        Self { address: address.to_owned(), rate_hz, signals: signals.collect() }
    }

    pub(super) fn numberings(&self) -> Vec<Numbering> {
        self.signals.iter().map(|signal| signal.numbering.clone()).collect()
    }

    /// A signal without samples for longer than the deadline.
    pub(super) fn silent(&self, now: Instant, deadline: Duration) -> Option<String> {
        let silent = self.signals.iter().find(|signal| now.duration_since(signal.heard) > deadline)?;
        Some(format!("no samples of {} for {:.1} s", silent.sensor, deadline.as_secs_f64()))
    }

    /// Takes what came. `status` is what the instrument says of each signal beside the stream.
    pub(super) fn take(
        &mut self,
        decoded: Decoded,
        status: &[Quality],
        out: &mut VecDeque<Packet>,
    ) -> Result<(), MeaningError> {
        let message = match decoded {
            Decoded::Lost(lost) => {
                tracing::warn!(
                    instrument = self.address,
                    bytes = lost.bytes,
                    "lost the thread of the stream: {}",
                    lost.damage
                );
                self.break_all();
                return Ok(());
            }
            Decoded::Message(message) => message,
        };
        match message.body {
            Body::Signals(signals) => {
                // The decoder hands on no time that does not fit.
                let t0 = message.time.nanos().unwrap_or_default();
                signals.into_iter().for_each(|signal| self.samples(signal, t0, status, out));
            }
            Body::Quality(all) => {
                for entry in all {
                    match self.signals.get_mut(usize::from(entry.id).wrapping_sub(1)) {
                        Some(signal) => signal.flags(entry.flags),
                        None => self.break_all(),
                    }
                }
            }
            Body::Interpretation(all) => all.into_iter().try_for_each(|descriptor| self.interpret(descriptor))?,
            Body::Auxiliary => {}
            // Damaged, or of a newer protocol: whatever it said is missing.
            Body::Unknown(number) => {
                tracing::warn!(
                    instrument = self.address,
                    "a message of type {number}, which the protocol does not have"
                );
                self.break_all();
            }
        }
        Ok(())
    }

    fn break_all(&mut self) {
        self.signals.iter_mut().for_each(|signal| signal.numbering.break_here());
    }

    fn samples(&mut self, from: Signal, t0: i64, status: &[Quality], out: &mut VecDeque<Packet>) {
        let at = usize::from(from.id).wrapping_sub(1);
        let Some(signal) = self.signals.get_mut(at) else {
            tracing::warn!(instrument = self.address, "samples of signal {}, which was not asked for", from.id);
            return self.break_all();
        };
        let Some(known) = &signal.known else {
            tracing::warn!(sensor = &*signal.sensor, "samples before it was said what they mean");
            return signal.numbering.break_here();
        };
        if from.counts.is_empty() {
            return;
        }
        signal.heard = Instant::now();
        let (first_sample_index, gap) = signal.numbering.place(t0, from.counts.len(), self.rate_hz);
        out.push_back(Packet::Vibration(Block {
            sensor: signal.sensor.clone(),
            t0,
            sample_rate_hz: self.rate_hz,
            first_sample_index,
            unit: known.unit.clone(),
            samples: Samples::Counts { counts: from.counts, scale: known.scale, offset: known.offset },
            quality: gap | signal.quality | status.get(at).copied().unwrap_or(Quality::GOOD),
        }));
    }

    fn interpret(&mut self, descriptor: Descriptor) -> Result<(), MeaningError> {
        let Descriptor { signal: number, value } = descriptor;
        let rate_hz = self.rate_hz;
        let Some(signal) = self.signals.get_mut(usize::from(number).wrapping_sub(1)) else {
            self.break_all();
            return Ok(());
        };
        let before = signal.meaning.clone();
        match value {
            Value::DataType(INT24) => signal.meaning.data_type = Some(INT24),
            Value::DataType(other) => {
                return Err(MeaningError::DataType { signal: number, found: other });
            }
            Value::Scale(scale) if scale.is_finite() && scale != 0.0 => signal.meaning.scale = Some(scale),
            Value::Scale(scale) => return Err(MeaningError::Scale { signal: number, scale }),
            Value::Offset(offset) if offset.is_finite() => signal.meaning.offset = offset,
            Value::Offset(offset) => return Err(MeaningError::Offset { signal: number, offset }),
            Value::Period(period) => {
                let found = period.rate_hz().unwrap_or(f64::NAN);
                let off = (found / rate_hz - 1.0).abs();
                if off.is_nan() || off > RATE_TOLERANCE {
                    return Err(MeaningError::Rate { signal: number, found, wanted: rate_hz });
                }
                signal.meaning.period = Some(period);
            }
            Value::Unit(unit) => signal.meaning.unit = Some(unit),
            Value::VectorLength(0 | 1) | Value::ChannelType(_) | Value::Other(..) => {}
            Value::VectorLength(length) => return Err(MeaningError::Vectors { signal: number, length }),
        }
        signal.settle(&before, number)
    }
}

impl Channel {
    fn flags(&mut self, flags: QualityFlags) {
        let mut quality = Quality::GOOD;
        for (flag, bit) in [
            (QualityFlags::CLIPPED, Quality::OVERLOAD),
            (QualityFlags::SETTLING, Quality::SETTLING),
            (QualityFlags::INVALID, Quality::INVALID),
            // What is not known to be right is not used.
            (QualityFlags::UNKNOWN, Quality::INVALID),
        ] {
            if flags.contains(flag) {
                quality |= bit;
            }
        }
        self.quality = quality;
        if flags.contains(QualityFlags::OVERRUN) {
            self.numbering.break_here();
        }
    }

    /// Makes use of what was said, when it is complete. Samples before and after a change do not
    /// belong together.
    fn settle(&mut self, before: &Meaning, number: u16) -> Result<(), MeaningError> {
        let Meaning { data_type: Some(_), scale: Some(scale), offset, period: Some(_), unit: Some(unit) } =
            &self.meaning
        else {
            return Ok(());
        };
        let Some((unit, factor)) = units::canonical(unit) else {
            return Err(MeaningError::Unit { signal: number, unit: unit.clone() });
        };
        if self.known.is_some() && self.meaning != *before {
            tracing::warn!(sensor = &*self.sensor, "the meaning of its samples has changed");
            self.numbering.break_here();
        }
        if let Some(expected) = self.expected.scale
            && (scale / expected - 1.0).abs() > SCALE_TOLERANCE
        {
            tracing::warn!(
                sensor = &*self.sensor,
                "full scale is {scale} {unit}; range and sensitivity of the transducer make {expected}"
            );
        }
        self.known = Some(Known { scale: scale * factor / FULL_SCALE, offset: offset * factor, unit: unit.into() });
        Ok(())
    }
}
