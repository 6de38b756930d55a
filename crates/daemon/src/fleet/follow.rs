//! Reads the stream, from some point on, for ever: after an outage it goes on behind the last letter that was heard.

use std::convert::Infallible;
use std::time::{Duration, Instant};

use async_nats::jetstream::{self, consumer::DeliverPolicy, consumer::pull::OrderedConfig};
use futures_util::StreamExt;

use super::{Access, Heard, PATIENCE, connect};
use crate::service::Backoff;

/// No wait for the next try is longer: somebody looks on.
const LONGEST_WAIT: Duration = Duration::from_secs(3);

/// Where reading begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum From {
    /// At the oldest letter that the stream still has.
    Beginning,
    /// So long ago.
    Ago(Duration),
    /// With what comes now.
    Now,
}

/// What a reader of the stream learns.
#[derive(Clone, Debug)]
pub enum Notice {
    /// The stream answers.
    Connected,
    /// A letter.
    Letter(Box<Heard>),
    /// All that was in the stream has been told; what comes now is live.
    CaughtUp,
    /// The server is away, or there is no such stream; it is tried again.
    Lost(String),
}

/// Reads for ever.
pub async fn follow(
    server: &str,
    access: &Access,
    stream: &str,
    from: From,
    mut tell: impl FnMut(Notice),
) -> Infallible {
    let mut backoff = Backoff::default();
    // The number of the letter that comes next, once one was heard.
    let mut next: Option<u64> = None;
    loop {
        let began = Instant::now();
        let Err(error) = session(server, access, stream, from, &mut next, &mut tell).await;
        tell(Notice::Lost(error));
        tokio::time::sleep(backoff.next_wait(began).min(LONGEST_WAIT)).await;
    }
}

async fn session(
    server: &str,
    access: &Access,
    name: &str,
    from: From,
    next: &mut Option<u64>,
    tell: &mut impl FnMut(Notice),
) -> Result<Infallible, String> {
    let (client, lost) = connect(server, access).await?;
    let jetstream = jetstream::new(client);
    let late = |_| format!("no answer about stream {name:?}");
    let stream = tokio::time::timeout(PATIENCE, jetstream.get_stream(name)).await.map_err(late)?;
    let stream = stream.map_err(|e| format!("stream {name:?}: {e}"))?;
    let state = stream.cached_info().state.clone();
    if next.is_some_and(|next| state.last_sequence + 1 < next) {
        // The stream was made anew, and counts from the beginning.
        *next = Some(state.first_sequence.max(1));
    }
    let deliver_policy = match (*next, from) {
        (Some(start_sequence), _) => DeliverPolicy::ByStartSequence { start_sequence },
        (None, From::Beginning) => DeliverPolicy::All,
        (None, From::Now) => DeliverPolicy::New,
        (None, From::Ago(ago)) => {
            let start = std::time::SystemTime::now().checked_sub(ago).unwrap_or(std::time::UNIX_EPOCH);
            DeliverPolicy::ByStartTime { start_time: start.into() }
        }
    };
    let config = OrderedConfig { deliver_policy, ..OrderedConfig::default() };
    let consumer = tokio::time::timeout(PATIENCE, stream.create_consumer(config)).await.map_err(late)?;
    let mut consumer = consumer.map_err(|e| e.to_string())?;
    let nothing_waits = consumer.info().await.map_err(|e| e.to_string())?.num_pending == 0;
    let mut messages = consumer.messages().await.map_err(|e| e.to_string())?;
    tell(Notice::Connected);
    if nothing_waits {
        tell(Notice::CaughtUp);
    }
    let mut caught_up = nothing_waits;
    loop {
        let message = tokio::select! {
            () = lost.notified() => return Err("the connection is gone".to_owned()),
            message = messages.next() => message.ok_or("the stream has ended")?.map_err(|e| e.to_string())?,
        };
        let info = message.info().map_err(|e| e.to_string())?;
        *next = Some(info.stream_sequence + 1);
        let stored_ns = i64::try_from(info.published.unix_timestamp_nanos()).unwrap_or(0);
        let pending = info.pending;
        if let Some(heard) = Heard::read(stored_ns, &message.payload) {
            tell(Notice::Letter(Box::new(heard)));
        }
        if pending == 0 && !caught_up {
            caught_up = true;
            tell(Notice::CaughtUp);
        }
    }
}
