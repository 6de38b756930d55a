//! Streams: made, written to with confirmations, and read in order
//! (<https://docs.nats.io/reference/reference-protocols/nats_api_reference>).

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use gearwatch_log::utc;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::{mpsc, oneshot};

use super::wire::{Message, publish};
use super::{Connection, NatsError, PATIENCE};

/// What the server says where there is no such stream.
const NO_STREAM: u64 = 10059;
/// Messages that are asked for at once, and for how long the server keeps that in mind.
const BATCH: u32 = 200;
const EXPIRES: Duration = Duration::from_secs(30);
/// The server shows so often that it is still there while it has no message.
const HEARTBEAT: Duration = Duration::from_secs(10);
/// So long the server keeps a reader that does not ask.
const FORGOTTEN: Duration = Duration::from_secs(300);

/// Streams of a server.
pub(crate) struct JetStream(Connection);

/// A stream as it is to be where there is none.
pub(crate) struct Wanted<'a> {
    pub name: &'a str,
    pub subjects: String,
    pub keep: Duration,
    pub duplicate_window: Duration,
}

/// How far a stream goes.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
pub(crate) struct State {
    #[serde(rename = "first_seq")]
    pub first: u64,
    #[serde(rename = "last_seq")]
    pub last: u64,
}

/// What the server says, without what is an error.
fn read(answer: &Message) -> Result<Value, Refused> {
    let value: Value = serde_json::from_slice(&answer.payload)
        .map_err(|e| Refused { code: 0, why: format!("the server's answer is not readable: {e}") })?;
    match value.get("error") {
        None => Ok(value),
        Some(error) => {
            let code = error["err_code"].as_u64().unwrap_or_default();
            let why = error["description"].as_str().unwrap_or("no reason given");
            Err(Refused { code, why: why.chars().take(200).collect() })
        }
    }
}

#[derive(Debug)]
struct Refused {
    code: u64,
    why: String,
}

impl Refused {
    fn of(self, stream: &str) -> NatsError {
        NatsError::Refused { stream: stream.to_owned(), why: self.why }
    }
}

impl JetStream {
    /// For those who write.
    pub(crate) fn writing(connection: Connection) -> Self {
        Self(connection.without_messages())
    }

    /// For those who read.
    pub(crate) fn reading(connection: Connection) -> Self {
        Self(connection)
    }

    /// Waits for the end of the connection, and says why.
    pub(crate) async fn gone(&self) -> NatsError {
        self.0.gone().await
    }

    /// How far a stream goes.
    ///
    /// # Errors
    /// Where there is none, or the server does not say.
    pub(crate) async fn state(&self, name: &str) -> Result<State, NatsError> {
        self.find(name).await?.map_err(|refused| refused.of(name))
    }

    async fn find(&self, name: &str) -> Result<Result<State, Refused>, NatsError> {
        let answer = self.0.request(&format!("$JS.API.STREAM.INFO.{name}"), b"").await?;
        let state = |value: Value| serde_json::from_value(value["state"].clone()).unwrap_or_default();
        Ok(read(&answer).map(state))
    }

    /// Makes a stream where there is none. That it answers means that the server has read back what
    /// it had stored.
    ///
    /// # Errors
    /// Where the server refuses, or does not say.
    pub(crate) async fn find_or_make(&self, wanted: &Wanted<'_>) -> Result<(), NatsError> {
        let refused = match self.find(wanted.name).await? {
            Ok(_) => return Ok(()),
            Err(refused) => refused,
        };
        if refused.code != NO_STREAM {
            return Err(refused.of(wanted.name));
        }
        let config = json!({
            "name": wanted.name,
            "subjects": [wanted.subjects],
            "retention": "limits",
            "max_consumers": -1,
            "max_msgs": -1,
            "max_bytes": -1,
            "max_age": nanos(wanted.keep),
            "discard": "old",
            "storage": "file",
            "num_replicas": 1,
            "duplicate_window": nanos(wanted.duplicate_window),
        });
        let subject = format!("$JS.API.STREAM.CREATE.{}", wanted.name);
        let made = self.0.request(&subject, config.to_string().as_bytes()).await?;
        read(&made).map(drop).map_err(|refused| refused.of(wanted.name))
    }

    /// Sends a message to a stream.
    ///
    /// # Errors
    /// Where the connection is gone, or takes nothing.
    pub(crate) async fn publish(
        &self,
        subject: &str,
        headers: &[(&str, &str)],
        payload: &[u8],
    ) -> Result<Confirmation, NatsError> {
        self.0.ask(subject, headers, payload).await.map(Confirmation)
    }

    /// Reads a stream from some message on.
    ///
    /// # Errors
    /// Where the server refuses, or does not say.
    pub(crate) async fn read(mut self, stream: &str, start: Start) -> Result<Reader, NatsError> {
        let mut config = json!({
            "ack_policy": "none",
            "replay_policy": "instant",
            "max_deliver": 1,
            "mem_storage": true,
            "num_replicas": 1,
            "inactive_threshold": nanos(FORGOTTEN),
        });
        start.put(&mut config);
        let body = json!({ "stream_name": stream, "config": config }).to_string();
        let made = self.0.request(&format!("$JS.API.CONSUMER.CREATE.{stream}"), body.as_bytes()).await?;
        let made = read(&made).map_err(|refused| refused.of(stream))?;
        let name = made["name"].as_str().filter(|name| is_plain(name)).ok_or(NatsError::Nameless)?;
        let pull = format!("$JS.API.CONSUMER.MSG.NEXT.{stream}.{name}");
        let messages = self.0.messages.take().ok_or(NatsError::Read)?;
        let waiting = made["num_pending"].as_u64().unwrap_or_default();
        Ok(Reader { jetstream: self, messages, pull, asked_for: 0, next: 1, waiting })
    }
}

/// A name that can be put into a subject.
fn is_plain(name: &str) -> bool {
    !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_'))
}

fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// Comes when the stream has stored a message.
pub(crate) struct Confirmation(oneshot::Receiver<Message>);

impl Confirmation {
    /// Waits for it.
    ///
    /// # Errors
    /// Where the stream refuses the message, or nobody says anything.
    pub(crate) async fn come(self) -> Result<(), NatsError> {
        let answer = tokio::time::timeout(PATIENCE, self.0).await.map_err(|_| NatsError::Unconfirmed)?;
        let answer = answer.map_err(|_| NatsError::Gone)?.or_nobody("the stream")?;
        let stored = read(&answer).map_err(|refused| NatsError::NotStored(refused.why))?;
        stored["seq"].is_u64().then_some(()).ok_or(NatsError::Unnumbered)
    }
}

/// The first message that is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Start {
    /// The oldest one.
    Oldest,
    /// The next one that comes.
    New,
    /// The one with this number, or the first after it.
    Number(u64),
    /// The first one that was stored since then.
    Since(SystemTime),
}

impl Start {
    fn put(self, config: &mut Value) {
        match self {
            Self::Oldest => config["deliver_policy"] = "all".into(),
            Self::New => config["deliver_policy"] = "new".into(),
            Self::Number(number) => {
                config["deliver_policy"] = "by_start_sequence".into();
                config["opt_start_seq"] = number.into();
            }
            Self::Since(time) => {
                config["deliver_policy"] = "by_start_time".into();
                config["opt_start_time"] = rfc_3339(time).into();
            }
        }
    }
}

/// Whole seconds, rounded down.
fn rfc_3339(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let t = utc(i64::try_from(seconds).unwrap_or(0));
    let part = |range: std::ops::Range<usize>| t.get(range).unwrap_or("00");
    let (date, clock) =
        ([part(0..4), part(4..6), part(6..8)].join("-"), [part(9..11), part(11..13), part(13..15)].join(":"));
    format!("{date}T{clock}Z")
}

/// A message of a stream.
pub(crate) struct Stored {
    /// Its number in the stream.
    pub number: u64,
    /// When it was stored (ns since the epoch).
    pub stored_ns: i64,
    /// Messages behind it.
    pub pending: u64,
    pub payload: Vec<u8>,
}

/// Reads a stream in order.
pub(crate) struct Reader {
    jetstream: JetStream,
    messages: mpsc::Receiver<Message>,
    /// Subject at which messages are asked for.
    pull: String,
    /// Messages that may still come of those that were asked for.
    asked_for: u32,
    /// Number that the server gives the next message to this reader.
    next: u64,
    waiting: u64,
}

impl Reader {
    /// Messages that were in the stream when reading began.
    pub(crate) fn waiting_at_start(&self) -> u64 {
        self.waiting
    }

    /// The next message.
    ///
    /// # Errors
    /// Where the connection is gone, a message is missing, or the server says nothing.
    pub(crate) async fn next(&mut self) -> Result<Stored, NatsError> {
        loop {
            if self.asked_for == 0 {
                let body = json!({ "batch": BATCH, "expires": nanos(EXPIRES), "idle_heartbeat": nanos(HEARTBEAT) })
                    .to_string();
                let reply = format!("{}.m", self.jetstream.0.inbox);
                self.jetstream.0.send(publish(&self.pull, &reply, &[], body.as_bytes())).await?;
                self.asked_for = BATCH;
            }
            let heard = tokio::select! {
                biased;
                heard = self.messages.recv() => heard,
                reason = self.jetstream.gone() => return Err(reason),
                () = tokio::time::sleep(2 * HEARTBEAT + PATIENCE) => return Err(NatsError::StreamSilent),
            };
            let message = heard.ok_or(NatsError::Gone)?;
            match message.status {
                None => return self.take(message),
                // A sign of life.
                Some(100) => {}
                // Nothing came, or not all: it is asked for anew.
                Some(404 | 408) => self.asked_for = 0,
                Some(409) if message.description.contains("Batch") => self.asked_for = 0,
                Some(code) => return Err(NatsError::Status { code, description: message.description }),
            }
        }
    }

    fn take(&mut self, message: Message) -> Result<Stored, NatsError> {
        let place = StreamPosition::read(&message.reply).ok_or(NatsError::NoPlace)?;
        if place.delivered != self.next {
            return Err(NatsError::Order { found: place.delivered, expected: self.next });
        }
        self.next += 1;
        self.asked_for = self.asked_for.saturating_sub(1);
        let StreamPosition { number, stored_ns, pending, .. } = place;
        Ok(Stored { number, stored_ns, pending, payload: message.payload })
    }
}

/// What the subject for an acknowledgement says of a message.
#[derive(Debug, PartialEq, Eq)]
struct StreamPosition {
    number: u64,
    delivered: u64,
    stored_ns: i64,
    pending: u64,
}

impl StreamPosition {
    /// `$JS.ACK.<stream>.<reader>.<times>.<number>.<delivered>.<stored>.<pending>`, or the same
    /// with `<domain>.<account>` before the stream and possibly something behind.
    fn read(subject: &str) -> Option<Self> {
        let parts: Vec<&str> = subject.strip_prefix("$JS.ACK.")?.split('.').collect();
        let from = match parts.len() {
            7 => 3,
            9.. => 5,
            _ => return None,
        };
        let number = |at: usize| parts.get(from + at)?.parse::<u64>().ok();
        let stored_ns = i64::try_from(number(2)?).ok()?;
        Some(Self { number: number(0)?, delivered: number(1)?, stored_ns, pending: number(3)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both forms, as the server's description of acknowledgements has them.
    #[test]
    fn literature_the_place_of_a_message_is_read() {
        let place = StreamPosition { number: 42, delivered: 7, stored_ns: 1_700_000_000_123_456_789, pending: 3 };
        let old = "$JS.ACK.gearwatch.reader.1.42.7.1700000000123456789.3";
        let new = "$JS.ACK.hub.AbCdEf.gearwatch.reader.1.42.7.1700000000123456789.3.x7";
        assert_eq!(StreamPosition::read(old), Some(place));
        assert_eq!(StreamPosition::read(new), StreamPosition::read(old));
        for bad in ["", "$JS.ACK.a.b.1.2.3.4", "$JS.ACK.a.b.1.x.3.4.5", "$JS.ACK.a.b.1.2.3.99999999999999999999.5"] {
            assert_eq!(StreamPosition::read(bad), None, "{bad}");
        }
    }

    #[test]
    fn literature_times_are_written_as_rfc_3339_has_them() {
        assert_eq!(rfc_3339(UNIX_EPOCH + Duration::from_millis(1_700_000_000_999)), "2023-11-14T22:13:20Z");
    }

    #[test]
    fn conform_names_of_a_server_cannot_change_a_subject() {
        assert!(is_plain("aB3_-") && !is_plain("") && !is_plain("a.b") && !is_plain("a b") && !is_plain("a\r\nPUB x"));
    }
}
