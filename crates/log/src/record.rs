//! What can be put into the log.

use std::collections::BTreeMap;
use std::sync::Arc;

use gearwatch_alarm::{Acknowledgement, Alarm};
use gearwatch_core::block::{Packet, UnixNanos};
use gearwatch_core::verdict::Verdict;
use serde::{Deserialize, Serialize};

use crate::spectrum::SpectrumFrame;

/// One thing to be logged.
#[derive(Clone, Debug)]
pub enum Record {
    /// A verdict, on `/gear/<stage>/rank`, or `/gear/<bench>/<stage>/rank` where several benches
    /// share the log.
    Verdict {
        /// Name of the bench, where several share the log.
        bench: Option<Arc<str>>,
        /// The verdict.
        verdict: Arc<Verdict>,
        /// The JSON object that is the line on stdout too, byte for byte; where several benches
        /// share a log it names the bench.
        line: Arc<str>,
    },
    /// Raw data as the source gave them, on `/vib/…`, `/tacho/…` and `/operating_point`; kept or
    /// not by [`super::RawPolicy`].
    Raw(Arc<Packet>),
    /// Something is missing, on `/gap`.
    Gap(Gap),
    /// An order spectrum, on `/spectrum/<channel>`, or `/spectrum/<bench>/<channel>` where several
    /// benches share the log.
    Spectrum(Arc<SpectrumFrame>),
    /// How the clocks stand, on `/clock`.
    Clock(Clock),
    /// A sentence for people, on `/log`.
    Note(Note),
    /// An alarm came, went, grew worse or was acknowledged, on `/alarm`.
    Alarm(Arc<AlarmRecord>),
    /// Configuration, baseline and calibration from now on. A new file begins with them.
    Context(Arc<Context>),
}

/// What a gap record says of a record that found no room.
pub(crate) struct Lost {
    pub channel: String,
    pub cause: Cause,
    pub first: u64,
    pub last: u64,
    pub count: u64,
}

impl Record {
    /// What is lost with it, where it is the record of this number that finds no room. What a gap
    /// record says is said by the one that takes its place.
    pub(crate) fn lost(&self, number: u64) -> Lost {
        let one = |channel: &str| (channel.to_owned(), number, number, 1);
        let (channel, first, last, count) = match self {
            Self::Verdict { verdict: v, .. } => (format!("{}/{}", v.channel, v.stage), v.window, v.window, 1),
            Self::Raw(packet) => match &**packet {
                Packet::Vibration(b) => {
                    let count = b.samples.len() as u64;
                    let last = b.first_sample_index.saturating_add(count.saturating_sub(1));
                    (b.sensor.to_string(), b.first_sample_index, last, count)
                }
                Packet::Tacho(b) => (format!("tacho/{}", b.shaft), number, number, b.pulse_times.len() as u64),
                Packet::OperatingPoint(_) => one("operating_point"),
            },
            Self::Gap(gap) => {
                let Gap { channel, first, last, count, cause, .. } = gap.clone();
                return Lost { channel, cause, first, last, count };
            }
            Self::Clock(_) => one("clock"),
            Self::Spectrum(_) => one("spectrum"),
            Self::Note(_) => one("log_note"),
            Self::Alarm(_) => one("alarm"),
            Self::Context(_) => one("context"),
        };
        Lost { channel, cause: Cause::LogQueueFull, first, last, count }
    }
}

/// A discontinuity: what is missing, and why. `first` and `last` count what `channel` counts:
/// samples of a sensor, windows of a sensor and stage, sequence numbers of the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gap {
    /// `<sensor>`, `<sensor>/<stage>`, or [`Gap::LOG`].
    pub channel: String,
    /// First missing number.
    pub first: u64,
    /// Last missing number.
    pub last: u64,
    /// How many are missing; of what was cut off by a crash, at most so many.
    pub count: u64,
    /// Why.
    pub cause: Cause,
    /// When it was noticed (ns since the epoch).
    pub t_ns: UnixNanos,
}

impl Gap {
    /// Channel name of gaps in the log's own sequence numbers.
    pub const LOG: &str = "log";
    /// Channel name of the time in which nothing was watched because the configuration was read
    /// again. It counts milliseconds since the epoch.
    pub const RELOAD: &str = "reload";

    /// The configuration was read again: nothing was watched between these times (ns since the
    /// epoch).
    pub fn reload(from_ns: UnixNanos, to_ns: UnixNanos) -> Self {
        let ms = |ns: UnixNanos| u64::try_from(ns / 1_000_000).unwrap_or(0);
        let (first, last) = (ms(from_ns), ms(to_ns.max(from_ns)));
        let channel = Self::RELOAD.to_owned();
        Self { channel, first, last, count: last - first, cause: Cause::Configuration, t_ns: to_ns }
    }
}

/// An alarm, as it is after what happened at `t_ns`. A file begins with those that stand, so that a
/// start knows them from the newest file alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlarmRecord {
    /// Name of the bench.
    pub bench: String,
    /// How it is now.
    #[serde(flatten)]
    pub alarm: Alarm,
    /// What happened: `raised`, `ended` or `acknowledged`.
    pub event: String,
    /// Who acknowledged it; empty otherwise.
    pub who: String,
    /// Why; empty otherwise.
    pub why: String,
    /// Where the request came from; empty otherwise.
    pub from: String,
    /// When somebody acknowledged it (ns since the epoch); 0 otherwise.
    pub acknowledged_ns: UnixNanos,
}

impl AlarmRecord {
    /// Of what happened to an alarm.
    pub fn new(bench: &str, alarm: &Alarm, seen: Option<&Acknowledgement>) -> Self {
        let event = match seen {
            Some(_) => "acknowledged",
            None if alarm.active => "raised",
            None => "ended",
        };
        let Acknowledgement { who, why, from, t_ns, .. } = seen.cloned().unwrap_or_default();
        let (bench, event) = (bench.to_owned(), event.to_owned());
        Self { bench, alarm: alarm.clone(), event, who, why, from, acknowledged_ns: t_ns }
    }

    /// Names the alarm within the log.
    pub(crate) fn key(&self) -> (String, String) {
        (self.bench.clone(), self.alarm.id.clone())
    }
}

/// Why something is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The log's queue was full: the disk is full, or too slow.
    LogQueueFull,
    /// The service ended without closing the log; what was not yet durable is lost.
    UncleanEnd,
    /// Bytes on the disk are not what was written.
    Damage,
    /// The source lost the connection or the device.
    Reconnect,
    /// The instrument says that it lost samples.
    Overrun,
    /// The data do not follow each other, and nobody said why.
    Discontinuity,
    /// A worker could not keep up.
    Overload,
    /// A worker failed at it.
    Failure,
    /// The clock was set.
    ClockStep,
    /// The configuration changed.
    Configuration,
    /// The spool in front of a broker was full.
    SpoolFull,
}

/// Both clocks at one moment.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Clock {
    /// Wall clock (ns since the epoch).
    pub wall_ns: UnixNanos,
    /// Monotonic clock (ns since an arbitrary start).
    pub mono_ns: u64,
    /// Counts the steps of the wall clock since the service started.
    pub clock_epoch: u64,
    /// How far the wall clock was set, in this step (ns).
    pub step_ns: i64,
    /// Which start of the machine the monotonic clock belongs to.
    pub boot_id: String,
}

/// How much a [`Note`] matters; numbers are those of `foxglove.Log`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Level {
    /// For developers.
    Debug = 1,
    /// Good to know.
    Info = 2,
    /// Look at it when there is time.
    Warning = 3,
    /// Something does not work.
    Error = 4,
}

/// A sentence for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// When (ns since the epoch).
    pub t_ns: UnixNanos,
    /// How much it matters.
    pub level: Level,
    /// Which part of the service speaks.
    pub name: String,
    /// The sentence.
    pub message: String,
}

/// What a reader needs to understand the verdicts of a file; stands at the head of each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Context {
    /// Whole files: configuration, bench, baseline, calibration.
    pub attachments: Vec<Attachment>,
    /// Short facts: versions, identities, hashes.
    pub facts: BTreeMap<String, String>,
}

/// A file inside the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// File name; a label, never a path to write to.
    pub name: String,
    /// For instance `application/toml`.
    pub media_type: String,
    /// Its content.
    pub data: Vec<u8>,
}
