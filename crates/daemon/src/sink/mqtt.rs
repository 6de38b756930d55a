//! Publishes to an MQTT 3.1.1 broker with QoS 1: every letter is confirmed by the broker.
//!
//! The state of a bench is retained, so that who subscribes knows at once how it is; a last will says when the service is gone.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rumqttc::{AsyncClient, Event, EventLoop, Incoming, LastWill, MqttOptions, Outgoing, PublishOptions, QoS};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::sync::Notify;

use super::broker::{
    self, Carrier, Delivery, Kind as LetterKind, Outbox, Position, SpoolPlace, WINDOW, broker_error, secret,
};
use super::{Drain, SinkConfig, SinkContext, SinkError, kind};
use crate::fleet;
use crate::kinds::Kind;
use crate::tls::Trust;

pub(super) const KIND: Kind<dyn SinkConfig> = kind::<Mqtt>(
    "mqtt",
    "verdicts, alarms and states to an MQTT 3.1.1 broker (QoS 1), spooled on disk while it is away",
    r#"
host = "127.0.0.1"
port = 1883
prefix = "gearwatch"
spool = "/var/lib/gearwatch/spool-mqtt"
"#,
);

/// Keys of the MQTT sink.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Mqtt {
    /// Name or address of the broker.
    host: String,
    /// Its port.
    port: u16,
    /// First part of all topics.
    prefix: String,
    /// Names this service to the broker, which keeps one connection a name; made up where left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    client_id: Option<String>,
    /// Folder of the letters that wait; one sink owns it.
    spool: PathBuf,
    /// Letters that wait take at most so much (bytes); beyond it the oldest go, and are counted.
    spool_bytes: u64,
    /// A bench says so often that it is there, also when nothing changes (s).
    heartbeat_secs: f64,
    /// The broker is gone when it does not answer for about twice as long (s, 5–600).
    keep_alive_secs: u16,
    /// The broker is spoken to over TLS, and must prove its name.
    tls: bool,
    /// Certificate of the authority that signed the broker's, where the system does not know it (PEM).
    #[serde(skip_serializing_if = "Option::is_none")]
    ca_file: Option<PathBuf>,
    /// User name; none where left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    user: Option<String>,
    /// File whose first line is the password.
    #[serde(skip_serializing_if = "Option::is_none")]
    secret_file: Option<PathBuf>,
}

impl Default for Mqtt {
    fn default() -> Self {
        Self {
            host: "127.0.0.1".to_owned(),
            port: 1883,
            prefix: fleet::PREFIX.to_owned(),
            client_id: None,
            spool: PathBuf::from(broker::SPOOL_FOLDER).join("mqtt"),
            spool_bytes: broker::SPOOL_BYTES,
            heartbeat_secs: fleet::HEARTBEAT.as_secs_f64(),
            keep_alive_secs: 10,
            tls: false,
            ca_file: None,
            user: None,
            secret_file: None,
        }
    }
}

impl SinkConfig for Mqtt {
    fn problems(&self) -> Vec<String> {
        let mut out = broker::spool_problems(self.spool_bytes, self.heartbeat_secs);
        if self.host.is_empty() {
            out.push("host is empty".to_owned());
        }
        out.extend(fleet::name_problems("-", &self.prefix));
        if !(5..=600).contains(&self.keep_alive_secs) {
            out.push(format!("keep_alive_secs is {}; expected 5 to 600", self.keep_alive_secs));
        }
        if self.user.is_some() != self.secret_file.is_some() {
            out.push("user and secret_file belong together".to_owned());
        }
        if self.ca_file.is_some() && !self.tls {
            out.push("ca_file goes with tls = true".to_owned());
        }
        out
    }

    fn wants_states(&self) -> bool {
        true
    }

    fn open(&self, context: &SinkContext) -> Result<Drain, SinkError> {
        let secret = self.secret_file.as_ref().map(|file| secret(&context.folder, file)).transpose()?;
        let place = format!("{}:{}", self.host, self.port);
        let trusted = |file: Option<PathBuf>| Trust::read(file.as_deref()).map_err(|e| broker_error(&place, e));
        let ca_file = self.ca_file.as_ref().map(|file| context.folder.join(file));
        let trust = if self.tls { Some(trusted(ca_file)?) } else { None };
        let made_up = || format!("gearwatch-{:016x}", rand::random::<u64>());
        let client_id = self.client_id.clone().unwrap_or_else(made_up);
        let place = SpoolPlace {
            folder: context.folder.join(&self.spool),
            most_bytes: self.spool_bytes,
            heartbeat: Duration::from_secs_f64(self.heartbeat_secs),
        };
        let carrier = Arc::new(Courier { config: self.clone(), client_id, secret, trust });
        let context = context.clone();
        Ok(Drain::Task(Box::new(move |events| Box::pin(broker::run(events, context, place, carrier)))))
    }
}

/// Carries letters to the broker.
struct Courier {
    config: Mqtt,
    client_id: String,
    secret: Option<String>,
    trust: Option<Trust>,
}

impl Carrier for Courier {
    fn deliver<'a>(&'a self, outbox: &'a Outbox) -> Delivery<'a> {
        Box::pin(async move {
            let place = format!("{}:{}", self.config.host, self.config.port);
            // One client a connection: what was under way when it broke is handed out again by the outbox, in order.
            let failed = |error: String| broker_error(&place, error);
            let builder = AsyncClient::builder(self.options().map_err(failed)?).capacity(2 * WINDOW);
            let (client, events) = builder.try_build().map_err(|e| failed(e.to_string()))?;
            let flight = Flight::default();
            tokio::select! {
                error = receive(events, &flight, outbox) => Err(broker_error(&place, error)),
                error = self.send(&client, &flight, outbox) => Err(broker_error(&place, error)),
            }
        })
    }
}

impl Courier {
    fn service_topic(&self) -> String {
        format!("{}/_service/{}", self.config.prefix, self.client_id)
    }

    fn options(&self) -> Result<MqttOptions, String> {
        let mut options = MqttOptions::new(&self.client_id, (self.config.host.as_str(), self.config.port));
        options.set_keep_alive(self.config.keep_alive_secs);
        options.set_clean_session(true);
        options.set_inflight(WINDOW as u16);
        options.set_last_will(LastWill::new(self.service_topic(), "{\"online\":false}", QoS::AtLeastOnce, true));
        if let (Some(user), Some(secret)) = (&self.config.user, &self.secret) {
            options.set_credentials(user, secret.clone());
        }
        if let Some(trust) = &self.trust {
            trust.carry(&mut options)?;
        }
        Ok(options)
    }

    /// Sends until the client takes nothing more; gives what went wrong.
    async fn send(&self, client: &AsyncClient, flight: &Flight, outbox: &Outbox) -> String {
        flight.connected.notified().await;
        flight.lock().push_back(Under { packet: 0, position: None, confirmed: false });
        let kept = PublishOptions::new(QoS::AtLeastOnce).retained();
        let online = client.publish(self.service_topic(), "{\"online\":true}", kept).await;
        if let Err(error) = online {
            return error.to_string();
        }
        loop {
            while flight.lock().len() >= WINDOW {
                flight.room.notified().await;
            }
            let outgoing = outbox.next().await;
            let retain = LetterKind::of_topic(&outgoing.letter.topic) == Some(LetterKind::State);
            let topic = format!("{}/{}", self.config.prefix, outgoing.letter.topic);
            flight.lock().push_back(Under { packet: 0, position: Some(outgoing.position), confirmed: false });
            let options = PublishOptions::new(QoS::AtLeastOnce).retain(retain);
            if let Err(error) = client.publish(topic, outgoing.payload(), options).await {
                return error.to_string();
            }
        }
    }
}

/// A letter under way.
struct Under {
    /// Number that the protocol gave it, 0 before it has one.
    packet: u16,
    /// `None`: not from the outbox.
    position: Option<Position>,
    confirmed: bool,
}

/// Letters under way, in the order in which they were handed out.
#[derive(Default)]
struct Flight {
    under: Mutex<VecDeque<Under>>,
    connected: Notify,
    room: Notify,
}

impl Flight {
    fn lock(&self) -> MutexGuard<'_, VecDeque<Under>> {
        self.under.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Drives the connection until it breaks; gives what went wrong.
async fn receive(mut events: EventLoop, flight: &Flight, outbox: &Outbox) -> String {
    loop {
        match events.poll().await {
            Ok(Event::Incoming(Incoming::ConnAck(_))) => {
                outbox.connected();
                flight.connected.notify_one();
            }
            Ok(Event::Outgoing(Outgoing::Publish(packet))) => {
                if let Some(under) = flight.lock().iter_mut().find(|under| under.packet == 0) {
                    under.packet = packet;
                }
            }
            Ok(Event::Incoming(Incoming::PubAck(ack))) => {
                let mut under = flight.lock();
                if let Some(one) = under.iter_mut().find(|one| one.packet == ack.pkid && !one.confirmed) {
                    one.confirmed = true;
                }
                while under.front().is_some_and(|first| first.confirmed) {
                    if let Some(position) = under.pop_front().and_then(|first| first.position) {
                        outbox.confirm(position);
                    }
                }
                flight.room.notify_one();
            }
            Ok(_) => {}
            Err(error) => return error.to_string(),
        }
    }
}
