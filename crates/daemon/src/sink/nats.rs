//! Publishes to NATS JetStream: every letter is confirmed by the stream, and a repetition is recognised there by its `Nats-Msg-Id`.

use std::convert::Infallible;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use async_nats::HeaderMap;
use async_nats::jetstream::{self, context::PublishAckFuture, stream};
use futures_util::StreamExt;
use futures_util::stream::FuturesOrdered;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::sync::Notify;

use super::broker::{self, Carrier, Delivery, Outbox, Outgoing, Position, SpoolPlace, WINDOW, broker_error, secret};
use super::{Drain, SinkConfig, SinkContext, SinkError, kind};
use crate::fleet::{self, Access, DUPLICATE_WINDOW, PATIENCE, connect};
use crate::kinds::Kind;

pub(super) const KIND: Kind<dyn SinkConfig> = kind::<Nats>(
    "nats",
    "verdicts, alarms and states to NATS JetStream, spooled on disk while the server is away",
    r#"
servers = ["nats://127.0.0.1:4222"]
stream = "gearwatch"
prefix = "gearwatch"
spool = "/var/lib/gearwatch/spool-nats"
"#,
);

/// Keys of the NATS sink.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Nats {
    /// Addresses, tried in turn: `nats://host:4222`, or `tls://host:4222`.
    servers: Vec<String>,
    /// Stream that keeps the letters; made if there is none.
    stream: String,
    /// First part of all subjects.
    prefix: String,
    /// Age at which a stream that is made here forgets letters (h).
    keep_hours: f64,
    /// Folder of the letters that wait; one sink owns it.
    spool: PathBuf,
    /// Letters that wait take at most so much (bytes); beyond it the oldest go, and are counted.
    spool_bytes: u64,
    /// A bench says so often that it is there, also when nothing changes (s).
    heartbeat_secs: f64,
    /// User name; none where left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    user: Option<String>,
    /// File whose first line is the password, or without a user the token.
    #[serde(skip_serializing_if = "Option::is_none")]
    secret_file: Option<PathBuf>,
    /// Certificate of the authority that signed the server's, where the system does not know it (PEM).
    #[serde(skip_serializing_if = "Option::is_none")]
    ca_file: Option<PathBuf>,
}

impl Default for Nats {
    fn default() -> Self {
        Self {
            servers: vec!["nats://127.0.0.1:4222".to_owned()],
            stream: fleet::STREAM.to_owned(),
            prefix: fleet::PREFIX.to_owned(),
            keep_hours: 720.0,
            spool: PathBuf::from(broker::SPOOL_FOLDER).join("nats"),
            spool_bytes: broker::SPOOL_BYTES,
            heartbeat_secs: fleet::HEARTBEAT.as_secs_f64(),
            user: None,
            secret_file: None,
            ca_file: None,
        }
    }
}

impl SinkConfig for Nats {
    fn problems(&self) -> Vec<String> {
        let mut out = broker::spool_problems(self.spool_bytes, self.heartbeat_secs);
        if self.servers.is_empty() {
            out.push("servers is empty; expected at least one address".to_owned());
        }
        for server in &self.servers {
            if let Err(e) = server.parse::<async_nats::ServerAddr>() {
                out.push(format!("servers: {server:?} is no address such as nats://127.0.0.1:4222: {e}"));
            }
        }
        out.extend(fleet::name_problems(&self.stream, &self.prefix));
        if !(0.1..=1e6).contains(&self.keep_hours) {
            out.push(format!("keep_hours is {}; expected 0.1 to 1000000", self.keep_hours));
        }
        if self.user.is_some() && self.secret_file.is_none() {
            out.push("user is given without secret_file".to_owned());
        }
        out
    }

    fn wants_states(&self) -> bool {
        true
    }

    fn open(&self, context: &SinkContext) -> Result<Drain, SinkError> {
        let secret = self.secret_file.as_ref().map(|file| secret(&context.folder, file)).transpose()?;
        let access = Access {
            user: self.user.clone(),
            secret,
            ca_file: self.ca_file.as_ref().map(|file| context.folder.join(file)),
        };
        let place = SpoolPlace {
            folder: context.folder.join(&self.spool),
            most_bytes: self.spool_bytes,
            heartbeat: Duration::from_secs_f64(self.heartbeat_secs),
        };
        let carrier = Arc::new(Courier { config: self.clone(), access, next: AtomicUsize::new(0) });
        let context = context.clone();
        Ok(Drain::Task(Box::new(move |events| Box::pin(broker::run(events, context, place, carrier)))))
    }
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
