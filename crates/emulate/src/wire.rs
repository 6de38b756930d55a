//! The sending end of a connection: bytes wait here, leave in pieces of any size, and may never
//! arrive.

use std::io::Write;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::trouble::Plan;

/// The other side has closed the connection.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gone;

/// A write that makes no progress is tried again after this time.
const PATIENCE: Duration = Duration::from_millis(10);

pub(super) struct Wire {
    socket: TcpStream,
    queue: Vec<u8>,
    /// Writes end anywhere.
    split: Option<ChaCha8Rng>,
}

impl Wire {
    pub(super) fn new(socket: TcpStream, split: Option<u64>) -> Self {
        // Where these fail the writes do too, and say so.
        let _ = socket.set_nodelay(true);
        let _ = socket.set_write_timeout(Some(PATIENCE));
        Self { socket, queue: Vec::new(), split: split.map(ChaCha8Rng::seed_from_u64) }
    }

    /// Bytes that the other side has not taken yet.
    pub(super) fn waiting(&self) -> usize {
        self.queue.len()
    }

    pub(super) fn put(&mut self, bytes: &[u8]) {
        self.queue.extend_from_slice(bytes);
    }

    /// Sends what waits, as far as the other side takes it within the time.
    pub(super) fn send(&mut self, patience: Duration) -> Result<(), Gone> {
        let (began, mut at) = (Instant::now(), 0);
        let mut result = Ok(());
        while at < self.queue.len() {
            let end = match &mut self.split {
                // One byte, a few, or more than a header.
                Some(random) => at + (1 << random.random_range(0..8_u32)).min(self.queue.len() - at),
                None => self.queue.len(),
            };
            match self.socket.write(&self.queue[at..end]) {
                Ok(n) => at += n,
                Err(e) if gearwatch_sources::is_timeout(&e) && began.elapsed() < patience => {}
                Err(e) if gearwatch_sources::is_timeout(&e) => break,
                Err(_) => {
                    result = Err(Gone);
                    break;
                }
            }
        }
        self.queue.drain(..at);
        result
    }

    /// Looks whether the other side is still there, without sending.
    pub(super) fn check(&self) -> Result<(), Gone> {
        let mut byte = [0];
        let _ = self.socket.set_nonblocking(true);
        let seen = self.socket.peek(&mut byte);
        let _ = self.socket.set_nonblocking(false);
        match seen {
            Ok(0) => Err(Gone),
            Err(e) if !gearwatch_sources::is_timeout(&e) => Err(Gone),
            _ => Ok(()),
        }
    }

    /// Sends some of what waits and closes the connection there.
    pub(super) fn reset_inside(&mut self, plan: &mut Plan) {
        // Half a header, so that the reader is left inside a message.
        self.put(b"BK\x14\x00\x01\x00\x00\x00\x00");
        let keep = plan.below(self.queue.len()) + 1;
        self.queue.truncate(keep);
        let _ = self.send(PATIENCE);
        let _ = self.socket.shutdown(std::net::Shutdown::Both);
    }
}
