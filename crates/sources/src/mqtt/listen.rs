//! Listens to a broker.

use std::time::Duration;

use gearwatch_core::block::Packet;
use gearwatch_runtime::tls::Trust;
use rumqttc::{
    AsyncClient, ClientBuildError, ClientError, ConnectionError, Event, Incoming, MqttOptions, QoS, SubscribeFilter,
    SubscribeReasonCode,
};
use tokio::sync::mpsc;
use tokio::time::Instant;

use super::{Mqtt, Topic, split};
use crate::readings::Readings;
use crate::{Feed, Sender, SourceContext, SourceError};
use gearwatch_runtime::clock::now_unix_ns;

/// Messages that wait to be read.
const WAITING: usize = 256;
/// No message with a number is longer.
const LONGEST_MESSAGE: usize = 64 * 1024;
/// A broker that does not answer for so long is gone.
const KEEP_ALIVE_SECS: u16 = 10;

/// Opens the source.
pub(super) fn open(config: &Mqtt, context: &SourceContext) -> Result<Feed, SourceError> {
    let error = |message: String| SourceError::Peer { peer: config.broker.clone(), message };
    let (host, port) = split(&config.broker).ok_or_else(|| error("expected host:port".to_owned()))?;
    let id = config.client_id.clone().unwrap_or_else(|| format!("gearwatch-in-{}", context.bench.name));
    let mut options = MqttOptions::new(id, (host, port));
    if config.tls {
        let ca_file = config.ca_file.as_ref().map(|file| context.resolve(file));
        Trust::read(ca_file.as_deref())
            .and_then(|trust| trust.carry(&mut options))
            .map_err(|e| error(e.to_string()))?;
    }
    options.set_keep_alive(KEEP_ALIVE_SECS).set_max_packet_size(LONGEST_MESSAGE, LONGEST_MESSAGE);
    if let Some(username) = &config.username {
        let password = match &config.password_file {
            None => String::new(),
            Some(path) => {
                let path = context.resolve(path);
                gearwatch_io::text::read_text(&path).map_err(|source| SourceError::Io { path, source })?
            }
        };
        options.set_credentials(username, password.trim_end().to_owned());
    }
    let (config, readings) = (config.clone(), context.readings.clone());
    let stale = config.stale_after_secs.map_or(context.data_deadline, Duration::from_secs_f64);
    Ok(Feed::Push(Box::new(move |sender| {
        Box::pin(async move {
            let result = config.listen(options, &readings, &sender, stale).await;
            // Whatever ended it: what it said holds no longer.
            readings.forget(config.topics.iter().map(|topic| topic.quantity));
            let _ = sender.send(Packet::OperatingPoint(readings.point(now_unix_ns()))).await;
            result.map_err(|e| SourceError::Peer { peer: config.broker, message: e.to_string() })
        })
    })))
}

/// Why a message is not used.
#[derive(Debug, thiserror::Error)]
enum MessageError {
    #[error("expected a number, found {0:?}")]
    NoNumber(String),
    #[error("no JSON: {0}")]
    NoJson(#[from] serde_json::Error),
    #[error("no number at {pointer} in {found:?}")]
    NotThere { pointer: String, found: String },
}

impl Topic {
    /// The physical value of a message.
    fn value(&self, payload: &[u8]) -> Result<f64, MessageError> {
        let text = String::from_utf8_lossy(payload);
        let shown = || text.chars().filter(|c| !c.is_control()).take(60).collect::<String>();
        let number = match &self.pointer {
            None => text.trim().parse().map_err(|_| MessageError::NoNumber(shown()))?,
            Some(pointer) => {
                let json: serde_json::Value = serde_json::from_str(&text)?;
                let number = json.pointer(pointer).and_then(serde_json::Value::as_f64);
                number.ok_or_else(|| MessageError::NotThere { pointer: pointer.clone(), found: shown() })?
            }
        };
        Ok(self.linear().of(number))
    }
}

/// Why a broker is given up.
#[derive(Debug, thiserror::Error)]
enum ListenError {
    #[error(transparent)]
    Options(#[from] ClientBuildError),
    #[error(transparent)]
    Subscribe(#[from] ClientError),
    #[error("the broker refuses a topic")]
    Refused,
    #[error(transparent)]
    Connection(Box<ConnectionError>),
    #[error("the connection has ended")]
    Ended,
}

/// What the connection tells.
enum Heard {
    Message { topic: String, payload: Vec<u8>, retained: bool },
    Lost(ListenError),
}

impl Mqtt {
    /// Listens until the service stops or the broker is lost.
    async fn listen(
        &self,
        options: MqttOptions,
        readings: &Readings,
        sender: &Sender,
        stale: Duration,
    ) -> Result<(), ListenError> {
        let builder = AsyncClient::builder(options).capacity(WAITING);
        let (client, mut connection) = builder.try_build()?;
        let (out, mut heard) = mpsc::channel(WAITING);
        let filters: Vec<_> =
            self.topics.iter().map(|topic| SubscribeFilter::new(topic.topic.clone(), QoS::AtLeastOnce)).collect();
        // The connection is polled by a task of its own, and never given up in the middle of a
        // packet. The set ends it with this future.
        let mut tasks = tokio::task::JoinSet::new();
        tasks.spawn(async move {
            loop {
                let next = match connection.poll().await {
                    Ok(Event::Incoming(Incoming::ConnAck(_))) => {
                        if let Err(e) = client.try_subscribe_many(filters.iter().cloned()) {
                            Heard::Lost(e.into())
                        } else {
                            continue;
                        }
                    }
                    Ok(Event::Incoming(Incoming::SubAck(answer))) => {
                        if answer.return_codes.contains(&SubscribeReasonCode::Failure) {
                            Heard::Lost(ListenError::Refused)
                        } else {
                            continue;
                        }
                    }
                    Ok(Event::Incoming(Incoming::Publish(message))) => Heard::Message {
                        topic: String::from_utf8_lossy(&message.topic).into_owned(),
                        payload: message.payload.to_vec(),
                        retained: message.retain,
                    },
                    Ok(_) => continue,
                    Err(e) => Heard::Lost(ListenError::Connection(Box::new(e))),
                };
                let last = matches!(next, Heard::Lost(_));
                if out.send(next).await.is_err() || last {
                    return;
                }
            }
        });
        let quantities = || self.topics.iter().map(|topic| topic.quantity);
        let mut known = false;
        let mut look = tokio::time::interval_at(Instant::now() + stale / 4, stale / 4);
        look.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
        loop {
            // Both can be given up at any time without losing anything.
            let fresh = tokio::select! {
                next = heard.recv() => match next {
                    Some(Heard::Message { topic, payload, retained }) => {
                        self.take(&topic, &payload, retained, readings, stale)
                    }
                    Some(Heard::Lost(why)) => return Err(why),
                    None => return Err(ListenError::Ended),
                },
                _ = look.tick() => false,
            };
            let all = readings.knows(quantities());
            let changed = all != std::mem::replace(&mut known, all);
            if changed && !all {
                tracing::warn!(broker = self.broker, "no new values for {stale:.1?}; the operating point is unknown");
            }
            if (fresh || changed) && sender.send(Packet::OperatingPoint(readings.point(now_unix_ns()))).await.is_err() {
                return Ok(());
            }
        }
    }

    /// Uses a message; `false` if it told nothing.
    fn take(&self, topic: &str, payload: &[u8], retained: bool, readings: &Readings, stale: Duration) -> bool {
        if retained && !self.accept_retained {
            tracing::info!(topic, "a kept value of unknown age is not used");
            return false;
        }
        let mut told = false;
        for entry in self.topics.iter().filter(|entry| entry.topic == topic) {
            match entry.value(payload) {
                Ok(value) => {
                    readings.set(entry.quantity, value, stale);
                    told = true;
                }
                Err(why) => {
                    tracing::warn!(topic, "{why}");
                    readings.forget([entry.quantity]);
                }
            }
        }
        told
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::readings::Quantity;

    #[test]
    fn conform_messages_are_numbers_or_json() {
        let topic = |pointer: Option<&str>| Topic {
            quantity: Quantity::BrakeTorqueNm,
            topic: "t".into(),
            pointer: pointer.map(str::to_owned),
            scale: 2.0,
            offset: 1.0,
        };
        assert_eq!(topic(None).value(b" 20.5\n").unwrap(), 42.0);
        assert!(topic(None).value(b"NaN").unwrap().is_nan());
        assert!(topic(None).value(b"twenty").unwrap_err().to_string().contains("twenty"));
        assert_eq!(topic(Some("/a/1")).value(br#"{"a": [0, 3]}"#).unwrap(), 7.0);
        assert!(topic(Some("/b")).value(br#"{"a": 1}"#).unwrap_err().to_string().contains("no number at /b"));
        assert!(topic(Some("/b")).value(b"\xff").is_err());
    }
}
