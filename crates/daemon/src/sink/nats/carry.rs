//! Carries letters to a JetStream stream.

use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use async_nats::HeaderMap;
use async_nats::jetstream::{self, context::PublishAckFuture, stream};
use futures_util::StreamExt;
use futures_util::stream::FuturesOrdered;
use tokio::sync::Notify;

use super::Nats;
use crate::fleet::{self, Access, DUPLICATE_WINDOW, PATIENCE, connect};
use crate::sink::broker::{
    self, Carrier, Delivery, Outbox, Outgoing, Position, SpoolPlace, WINDOW, broker_error, secret,
};
use crate::sink::{Drain, SinkContext, SinkError};

/// What is wrong with the address of a server.
pub(super) fn address_problem(server: &str) -> Option<String> {
    let parsed = server.parse::<async_nats::ServerAddr>();
    parsed.err().map(|e| format!("servers: {server:?} is no address such as nats://127.0.0.1:4222: {e}"))
}

/// Opens the sink.
pub(super) fn open(config: &Nats, context: &SinkContext) -> Result<Drain, SinkError> {
    let secret = config.secret_file.as_ref().map(|file| secret(&context.folder, file)).transpose()?;
    let access = Access {
        user: config.user.clone(),
        secret,
        ca_file: config.ca_file.as_ref().map(|file| context.folder.join(file)),
    };
    let place = SpoolPlace {
        folder: context.folder.join(&config.spool),
        most_bytes: config.spool_bytes,
        heartbeat: Duration::from_secs_f64(config.heartbeat_secs),
    };
    let carrier = Arc::new(Courier { config: config.clone(), access, next: AtomicUsize::new(0) });
    let context = context.clone();
    Ok(Drain::Task(Box::new(move |events| Box::pin(broker::run(events, context, place, carrier)))))
}

/// Carries letters to the stream.
struct Courier {
    config: Nats,
    access: Access,
    /// The server whose turn it is.
    next: AtomicUsize,
}

impl Carrier for Courier {
    fn deliver<'a>(&'a self, outbox: &'a Outbox) -> Delivery<'a> {
        let servers = &self.config.servers;
        let server = &servers[self.next.fetch_add(1, Ordering::Relaxed) % servers.len()];
        Box::pin(async move {
            let failed = |error: String| broker_error(server, error);
            let (client, lost) = connect(server, &self.access).await.map_err(failed)?;
            let jetstream = jetstream::new(client);
            self.stream(&jetstream).await.map_err(failed)?;
            outbox.connected();
            forward(&jetstream, &self.config.prefix, outbox, &lost).await.map_err(failed)
        })
    }
}

impl Courier {
    /// Makes the stream where there is none. That it answers means that the server has read back what it had stored.
    async fn stream(&self, jetstream: &jetstream::Context) -> Result<(), String> {
        let config = stream::Config {
            name: self.config.stream.clone(),
            subjects: vec![format!("{}.>", self.config.prefix)],
            max_age: Duration::from_secs_f64(self.config.keep_hours * 3600.0),
            duplicate_window: DUPLICATE_WINDOW,
            ..stream::Config::default()
        };
        let made = tokio::time::timeout(PATIENCE, jetstream.get_or_create_stream(config)).await;
        made.map_err(|_| "no answer about the stream".to_owned())?.map(drop).map_err(|e| e.to_string())
    }
}

type Flight = std::pin::Pin<Box<dyn Future<Output = Result<Position, String>> + Send>>;

/// Sends and confirms in order, some letters ahead of the confirmations.
async fn forward(
    jetstream: &jetstream::Context,
    prefix: &str,
    outbox: &Outbox,
    lost: &Notify,
) -> Result<Infallible, String> {
    let mut flying: FuturesOrdered<Flight> = FuturesOrdered::new();
    loop {
        tokio::select! {
            biased;
            () = lost.notified() => return Err("the connection is gone".to_owned()),
            Some(confirmed) = flying.next(), if !flying.is_empty() => outbox.confirm(confirmed?),
            outgoing = outbox.next(), if flying.len() < WINDOW => {
                let sent = tokio::time::timeout(PATIENCE, send(jetstream, prefix, &outgoing)).await;
                let ack = sent.map_err(|_| "the connection takes nothing".to_owned())??;
                let position = outgoing.position;
                flying.push_back(Box::pin(async move {
                    let ack = tokio::time::timeout(PATIENCE, ack.into_future()).await;
                    ack.map_err(|_| "no confirmation".to_owned())?.map_err(|e| e.to_string())?;
                    Ok(position)
                }));
            }
        }
    }
}

async fn send(jetstream: &jetstream::Context, prefix: &str, outgoing: &Outgoing) -> Result<PublishAckFuture, String> {
    let mut headers = HeaderMap::new();
    headers.insert(async_nats::header::NATS_MESSAGE_ID, outgoing.letter.id.as_str());
    if outgoing.resent {
        headers.insert(fleet::RESENT_HEADER, "true");
    }
    let subject = format!("{prefix}.{}", outgoing.letter.topic.replace('/', "."));
    let sent = jetstream.publish_with_headers(subject, headers, outgoing.payload().into()).await;
    sent.map_err(|e| e.to_string())
}
