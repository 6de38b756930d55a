//! The loop of all sources that read from a socket with a time limit: hand on what is ready, look
//! whether to stop, read again.

use std::collections::VecDeque;
use std::time::Duration;

use gearwatch_core::block::Packet;
use gearwatch_runtime::stop::Stop;

use crate::{Feed, SourceError};

/// How often a thread that gets nothing looks whether it should stop.
pub(crate) const POLL: Duration = Duration::from_millis(50);
/// Bytes asked for at once.
pub(crate) const READ_BYTES: usize = 64 * 1024;

/// Reads until the service stops: each call of `read` waits at most for about [`POLL`], and puts
/// the packets that came to the end of the queue.
pub(crate) fn feed(
    stop: Stop,
    mut read: impl FnMut(&mut VecDeque<Packet>) -> Result<(), SourceError> + Send + 'static,
) -> Feed {
    let mut ready = VecDeque::new();
    Feed::Pull(Box::new(move || {
        loop {
            if let Some(packet) = ready.pop_front() {
                return Ok(Some(packet));
            }
            if stop.is_given() {
                return Ok(None);
            }
            read(&mut ready)?;
        }
    }))
}

/// A socket with a time limit has nothing to read.
pub fn is_timeout(e: &std::io::Error) -> bool {
    use std::io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(e.kind(), WouldBlock | TimedOut | Interrupted)
}
