//! Letters: what a broker's readers get. Subject, identity and one flat JSON object;
//! `docs/fleet.md` is the contract.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

use gearwatch_alarm::{Acknowledgement, Alarm};
use gearwatch_core::block::UnixNanos;
use gearwatch_log::{Cause, Gap};
use serde::Serialize;

use crate::event::{BenchState, Event};

/// What a letter is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::sink) enum LetterKind {
    Verdict,
    Alarm,
    State,
    Gap,
}

impl LetterKind {
    /// As it stands in subjects and in the object.
    const fn name(self) -> &'static str {
        match self {
            Self::Verdict => "verdict",
            Self::Alarm => "alarm",
            Self::State => "state",
            Self::Gap => "gap",
        }
    }

    /// Of a topic as [`Letter::topic`] makes it.
    pub fn of_topic(topic: &str) -> Option<Self> {
        let name = topic.split('/').nth(1)?;
        [Self::Verdict, Self::Alarm, Self::State, Self::Gap].into_iter().find(|kind| kind.name() == name)
    }
}

/// One message for a broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::sink) struct Letter {
    /// `<bench>/<kind>[/<stage>/<channel>]`, each part escaped: MQTT as it stands, NATS with dots.
    pub topic: String,
    /// The same for the same letter, however often it is sent; never given to another one.
    pub id: String,
    /// A JSON object without its opening brace: whoever sends it puts the mark of a repetition in
    /// front.
    pub body: String,
}

impl Letter {
    /// As it lies in the spool. JSON on one line, escaped parts and hexadecimal numbers hold no
    /// line end.
    pub fn to_bytes(&self) -> Vec<u8> {
        format!("{}\n{}\n{}", self.topic, self.id, self.body).into_bytes()
    }

    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let mut parts = std::str::from_utf8(bytes).ok()?.splitn(3, '\n').map(str::to_owned);
        Some(Self { topic: parts.next()?, id: parts.next()?, body: parts.next()? })
    }
}

/// A name as one part of a subject: what has a meaning in NATS or MQTT, and all that is not plain
/// ASCII, becomes `%XX`.
pub(in crate::sink) fn escape(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    for &byte in name.as_bytes() {
        if byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_') {
            out.push(char::from(byte));
        } else {
            // Writing to a string cannot fail.
            let _ = write!(out, "%{byte:02X}");
        }
    }
    if out.is_empty() { "%".to_owned() } else { out }
}

/// An alarm, and who has seen it where that is the news.
#[derive(Serialize)]
struct AlarmLetter<'a> {
    #[serde(flatten)]
    alarm: &'a Alarm,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    seen: Option<Seen<'a>>,
}

#[derive(Serialize)]
struct Seen<'a> {
    who: &'a str,
    why: &'a str,
}

impl<'a> Seen<'a> {
    fn of(seen: &'a Acknowledgement) -> Self {
        Self { who: &seen.who, why: &seen.why }
    }
}

/// Numbers letters and writes them.
pub(in crate::sink) struct Secretary {
    run: String,
    numbers: BTreeMap<Arc<str>, u64>,
    heartbeat: Duration,
    states: BTreeMap<Arc<str>, (Arc<BenchState>, Instant)>,
}

impl Secretary {
    pub fn new(heartbeat: Duration, run: String) -> Self {
        Self { run, numbers: BTreeMap::new(), heartbeat, states: BTreeMap::new() }
    }

    /// The letter of an event; none where nobody has to know of it.
    pub fn write(&mut self, event: &Event, now: Instant) -> Option<Letter> {
        match event {
            Event::Verdict { bench, verdict, .. } => {
                let place = [verdict.stage.as_str(), verdict.channel.as_str()];
                Some(self.letter(bench, LetterKind::Verdict, &place, &**verdict))
            }
            Event::Alarm { bench, alarm, seen } => {
                let place = [alarm.stage.as_str(), alarm.channel.as_str()];
                let seen = seen.as_deref().map(Seen::of);
                Some(self.letter(bench, LetterKind::Alarm, &place, &AlarmLetter { alarm, seen }))
            }
            Event::Gap { bench, gap } => Some(self.letter(bench, LetterKind::Gap, &[], gap)),
            Event::State { bench, state } => {
                let told = self.states.get(bench);
                let due = told.is_none_or(|(before, when)| {
                    before.differs_from(state) || now.saturating_duration_since(*when) >= self.heartbeat
                });
                if !due {
                    return None;
                }
                self.states.insert(bench.clone(), (state.clone(), now));
                Some(self.letter(bench, LetterKind::State, &[], &**state))
            }
            Event::Clock(_) | Event::Raw(_) | Event::Spectrum(_) => None,
        }
    }

    /// Says that letters were lost because the spool was full; to the bench of the event that had
    /// to have room.
    pub fn write_lost(&mut self, event: &Event, count: u64, t_ns: UnixNanos) -> Letter {
        let bench: Arc<str> = match event {
            Event::Verdict { bench, .. }
            | Event::Alarm { bench, .. }
            | Event::Gap { bench, .. }
            | Event::State { bench, .. } => bench.clone(),
            Event::Clock(_) | Event::Raw(_) | Event::Spectrum(_) => "".into(),
        };
        let gap = Gap { channel: "spool".to_owned(), first: 0, last: 0, count, cause: Cause::SpoolFull, t_ns };
        self.letter(&bench, LetterKind::Gap, &[], &gap)
    }

    fn letter(&mut self, bench: &Arc<str>, kind: LetterKind, place: &[&str], content: &impl Serialize) -> Letter {
        let number = self.numbers.entry(bench.clone()).or_default();
        *number += 1;
        let name = escape(bench);
        let mut topic = format!("{name}/{}", kind.name());
        for part in place {
            topic.push('/');
            topic.push_str(&escape(part));
        }
        // Plain data always have a JSON form, and it is an object.
        let content = serde_json::to_string(content).unwrap_or_else(|_| "{}".to_owned());
        let body = format!(
            "\"kind\":\"{}\",\"bench\":{},\"run\":\"{}\",\"seq\":{number},{}",
            kind.name(),
            serde_json::json!(&**bench),
            self.run,
            content.strip_prefix('{').unwrap_or("}"),
        );
        Letter { topic, id: format!("{}-{name}-{number}", self.run), body }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_no_name_can_break_a_subject() {
        assert_eq!(escape("bench-3_a"), "bench-3_a");
        assert_eq!(escape("a.b/c d+#*>"), "a%2Eb%2Fc%20d%2B%23%2A%3E");
        assert_eq!(escape("Prüfstand"), "Pr%C3%BCfstand");
        assert_eq!(escape(""), "%");
    }

    #[test]
    fn conform_letters_are_numbered_by_bench_and_read_back() {
        let mut secretary = Secretary::new(Duration::from_secs(10), "run".into());
        let gap = Gap { channel: "acc".into(), first: 1, last: 2, count: 2, cause: Cause::Overload, t_ns: 5 };
        let mut numbers = Vec::new();
        for bench in ["a", "b", "a"] {
            let event = Event::Gap { bench: bench.into(), gap: gap.clone() };
            let letter = secretary.write(&event, Instant::now()).unwrap();
            assert_eq!(Letter::from_bytes(&letter.to_bytes()), Some(letter.clone()));
            assert_eq!(LetterKind::of_topic(&letter.topic), Some(LetterKind::Gap));
            let object: serde_json::Value = serde_json::from_str(&format!("{{{}", letter.body)).unwrap();
            assert_eq!(
                (&object["kind"], &object["bench"], &object["count"]),
                (&"gap".into(), &bench.into(), &2.into())
            );
            numbers.push(object["seq"].as_u64().unwrap());
        }
        assert_eq!(numbers, [1, 1, 2]);
    }
}
