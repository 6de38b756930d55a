//! Carries letters to a JetStream stream.

use std::convert::Infallible;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use futures_util::StreamExt;
use futures_util::stream::FuturesOrdered;

use super::Nats;
use crate::fleet::nats::{Address, Confirmation, Connection, JetStream, NatsError, Wanted};
use crate::fleet::{self, Access, DUPLICATE_WINDOW};
use crate::sink::broker::{Carrier, Delivery, Outbox, Outgoing, Position, WINDOW, broker_error};
use crate::sink::{Drain, SinkContext, SinkError};

/// What is wrong with the address of a server.
pub(super) fn address_problem(server: &str) -> Option<String> {
    let parsed = server.parse::<Address>();
    parsed.err().map(|e| format!("servers: {server:?} is no address such as nats://127.0.0.1:4222: {e}"))
}

/// Opens the sink.
pub(super) fn open(config: &Nats, context: &SinkContext) -> Result<Drain, SinkError> {
    let access = Access {
        user: config.user.clone(),
        secret: config.common().secret(&context.folder)?,
        ca_file: config.ca_file.as_ref().map(|file| context.folder.join(file)),
    };
    Ok(config.common().open(context, Courier { config: config.clone(), access, next: AtomicUsize::new(0) }))
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
            let failed = |error: NatsError| broker_error(server, error);
            let connection = Connection::open(server, &self.access).await.map_err(failed)?;
            let jetstream = JetStream::writing(connection);
            jetstream.find_or_make(&self.wanted()).await.map_err(failed)?;
            outbox.connected();
            forward(&jetstream, &self.config.prefix, outbox).await.map_err(failed)
        })
    }
}

impl Courier {
    fn wanted(&self) -> Wanted<'_> {
        Wanted {
            name: &self.config.stream,
            subjects: format!("{}.>", self.config.prefix),
            keep: Duration::from_secs_f64(self.config.keep_hours * 3600.0),
            duplicate_window: DUPLICATE_WINDOW,
        }
    }
}

type Flight = std::pin::Pin<Box<dyn Future<Output = Result<Position, NatsError>> + Send>>;

/// Sends and confirms in order, some letters ahead of the confirmations.
async fn forward(jetstream: &JetStream, prefix: &str, outbox: &Outbox) -> Result<Infallible, NatsError> {
    let mut flying: FuturesOrdered<Flight> = FuturesOrdered::new();
    let gone = jetstream.gone();
    tokio::pin!(gone);
    loop {
        tokio::select! {
            biased;
            reason = &mut gone => return Err(reason),
            Some(confirmed) = flying.next(), if !flying.is_empty() => outbox.confirm(confirmed?),
            outgoing = outbox.next(), if flying.len() < WINDOW => {
                let confirmation = send(jetstream, prefix, &outgoing).await?;
                let position = outgoing.position;
                flying.push_back(Box::pin(async move { confirmation.come().await.map(|()| position) }));
            }
        }
    }
}

async fn send(jetstream: &JetStream, prefix: &str, outgoing: &Outgoing) -> Result<Confirmation, NatsError> {
    // The server knows a letter again by the first of them.
    let headers = [("Nats-Msg-Id", outgoing.letter.id.as_str()), (fleet::RESENT_HEADER, "true")];
    let headers = if outgoing.resent { &headers[..] } else { &headers[..1] };
    let subject = format!("{prefix}.{}", outgoing.letter.topic.replace('/', "."));
    jetstream.publish(&subject, headers, outgoing.payload().as_ref()).await
}
