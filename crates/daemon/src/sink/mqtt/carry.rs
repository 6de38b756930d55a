//! Carries letters to an MQTT broker.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use gearwatch_runtime::secret::Secret;
use gearwatch_runtime::tls::{Trust, TrustError};
use rumqttc::{AsyncClient, Event, EventLoop, Incoming, LastWill, MqttOptions, Outgoing, PublishOptions, QoS};
use tokio::sync::Notify;

use super::Mqtt;
use crate::sink::broker::{Carrier, Delivery, LetterKind, Outbox, Position, WINDOW, broker_error};
use crate::sink::{Drain, SinkContext, SinkError};

/// Opens the sink.
pub(super) fn open(config: &Mqtt, context: &SinkContext) -> Result<Drain, SinkError> {
    let secret = config.common().secret(&context.folder)?;
    let place = format!("{}:{}", config.host, config.port);
    let trusted = |file: Option<PathBuf>| Trust::read(file.as_deref()).map_err(|e| broker_error(&place, e));
    let ca_file = config.ca_file.as_ref().map(|file| context.folder.join(file));
    let trust = if config.tls { Some(trusted(ca_file)?) } else { None };
    let made_up = || format!("gearwatch-{:016x}", rand::random::<u64>());
    let client_id = config.client_id.clone().unwrap_or_else(made_up);
    Ok(config.common().open(context, Courier { config: config.clone(), client_id, secret, trust }))
}

/// Carries letters to the broker.
struct Courier {
    config: Mqtt,
    client_id: String,
    secret: Option<Secret>,
    trust: Option<Trust>,
}

impl Carrier for Courier {
    fn deliver<'a>(&'a self, outbox: &'a Outbox) -> Delivery<'a> {
        Box::pin(async move {
            let place = format!("{}:{}", self.config.host, self.config.port);
            // One client a connection: what was under way when it broke is handed out again by the
            // outbox, in order.
            let failed = |error: String| broker_error(&place, error);
            let builder = AsyncClient::builder(self.options().map_err(|e| failed(e.to_string()))?).capacity(2 * WINDOW);
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

    fn options(&self) -> Result<MqttOptions, TrustError> {
        let mut options = MqttOptions::new(&self.client_id, (self.config.host.as_str(), self.config.port));
        options.set_keep_alive(self.config.keep_alive_secs);
        options.set_clean_session(true);
        options.set_inflight(WINDOW as u16);
        options.set_last_will(LastWill::new(self.service_topic(), "{\"online\":false}", QoS::AtLeastOnce, true));
        if let (Some(user), Some(secret)) = (&self.config.user, &self.secret) {
            options.set_credentials(user, secret.expose().to_owned());
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
