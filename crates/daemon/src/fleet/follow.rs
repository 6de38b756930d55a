//! Reads the stream, from some point on, for ever: after an outage it goes on behind the last
//! letter that was heard.

use std::convert::Infallible;
use std::time::{Duration, Instant, SystemTime};

use super::nats::{Connection, JetStream, NatsError, Start};
use super::{Access, Heard};
use gearwatch_runtime::backoff::Backoff;

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
    Lost(NatsError),
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
) -> Result<Infallible, NatsError> {
    let jetstream = JetStream::reading(Connection::open(server, access).await?);
    let state = jetstream.state(name).await?;
    if next.is_some_and(|next| state.last + 1 < next) {
        // The stream was made anew, and counts from the beginning.
        *next = Some(state.first.max(1));
    }
    let start = match (*next, from) {
        (Some(number), _) => Start::Number(number),
        (None, From::Beginning) => Start::Oldest,
        (None, From::Now) => Start::New,
        (None, From::Ago(ago)) => Start::Since(SystemTime::now().checked_sub(ago).unwrap_or(SystemTime::UNIX_EPOCH)),
    };
    let mut reader = jetstream.read(name, start).await?;
    tell(Notice::Connected);
    let mut caught_up = reader.waiting_at_start() == 0;
    if caught_up {
        tell(Notice::CaughtUp);
    }
    loop {
        let stored = reader.next().await?;
        *next = Some(stored.number + 1);
        if let Some(heard) = Heard::read(stored.stored_ns, &stored.payload) {
            tell(Notice::Letter(Box::new(heard)));
        }
        if stored.pending == 0 && !caught_up {
            caught_up = true;
            tell(Notice::CaughtUp);
        }
    }
}
