//! The door of a page: so many connections and no more, few from one address, and none that only
//! sits there.
//!
//! One rule ends all that dawdle: a connection on which the server has written nothing for
//! [`PATIENCE`] is closed. It covers a slow handshake, a request whose head does not come, one that
//! is kept open for later, and a reader that does not read. Pages that listen are written to every
//! two seconds.

use std::collections::HashMap;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::{Instant, Sleep};

#[cfg(feature = "tls")]
use super::tls::Secured;

/// Connections at once.
const MOST: usize = 64;
/// Connections at once from one address of another machine. On the machine itself everybody has the
/// same address, and some room is kept for others.
const MOST_FROM_AFAR: usize = 8;
const MOST_FROM_HERE: usize = 48;
/// A connection on which nothing was written for so long is closed.
const PATIENCE: Duration = Duration::from_secs(10);

/// Who is at the other end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Peer(pub SocketAddr);

impl Connected<IncomingStream<'_, Gate>> for Peer {
    fn connect_info(stream: IncomingStream<'_, Gate>) -> Self {
        Self(*stream.remote_addr())
    }
}

#[cfg(feature = "tls")]
impl Connected<IncomingStream<'_, Secured>> for Peer {
    fn connect_info(stream: IncomingStream<'_, Secured>) -> Self {
        Self(*stream.remote_addr())
    }
}

/// Connections that are open, by address.
#[derive(Debug, Default)]
struct Guests {
    by_address: HashMap<IpAddr, usize>,
    total: usize,
}

/// Accepts connections as long as there are not too many.
pub struct Gate {
    tcp: TcpListener,
    guests: Arc<Mutex<Guests>>,
    patience: Duration,
}

impl Gate {
    /// On a bound listener.
    pub fn new(tcp: TcpListener) -> Self {
        Self { tcp, guests: Arc::default(), patience: PATIENCE }
    }

    fn admit(&self, address: IpAddr) -> Option<Seat> {
        let most = if address.is_loopback() { MOST_FROM_HERE } else { MOST_FROM_AFAR };
        let mut guests = self.guests.lock().unwrap_or_else(PoisonError::into_inner);
        let from_there = guests.by_address.get(&address).copied().unwrap_or(0);
        if guests.total >= MOST || from_there >= most {
            return None;
        }
        guests.total += 1;
        guests.by_address.insert(address, from_there + 1);
        Some(Seat { guests: self.guests.clone(), address })
    }
}

/// One place; free again when the connection is gone.
#[derive(Debug)]
struct Seat {
    guests: Arc<Mutex<Guests>>,
    address: IpAddr,
}

impl Drop for Seat {
    fn drop(&mut self) {
        let mut guests = self.guests.lock().unwrap_or_else(PoisonError::into_inner);
        guests.total -= 1;
        match guests.by_address.get_mut(&self.address) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(guests.by_address.remove(&self.address)),
        }
    }
}

impl Listener for Gate {
    type Io = Guest;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Self::Io, Self::Addr) {
        loop {
            match self.tcp.accept().await {
                Ok((stream, address)) => match self.admit(address.ip()) {
                    Some(seat) => return (Guest::new(stream, seat, self.patience), address),
                    None => tracing::warn!("{}: too many connections, one more is refused", address.ip()),
                },
                // Out of descriptors: others must have time to give some back.
                Err(_) => tokio::time::sleep(Duration::from_millis(100)).await,
            }
        }
    }

    fn local_addr(&self) -> io::Result<Self::Addr> {
        self.tcp.local_addr()
    }
}

/// A connection with its place and its deadline.
pub struct Guest {
    stream: TcpStream,
    patience: Duration,
    deadline: Pin<Box<Sleep>>,
    _seat: Seat,
}

impl Guest {
    fn new(stream: TcpStream, seat: Seat, patience: Duration) -> Self {
        Self { stream, patience, deadline: Box::pin(tokio::time::sleep(patience)), _seat: seat }
    }

    fn check(&mut self, context: &mut Context<'_>) -> io::Result<()> {
        match self.deadline.as_mut().poll(context) {
            Poll::Ready(()) => Err(io::ErrorKind::TimedOut.into()),
            Poll::Pending => Ok(()),
        }
    }

    fn after_write(&mut self, context: &mut Context<'_>, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        if matches!(written, Poll::Ready(Ok(1..))) {
            let end = Instant::now() + self.patience;
            self.deadline.as_mut().reset(end);
        }
        self.check(context)?;
        written
    }
}

impl AsyncRead for Guest {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.check(context)?;
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Guest {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.after_write(context, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, parts);
        self.after_write(context, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.check(context)?;
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::AsyncReadExt;

    /// Eighty connections that say nothing: 48 get in, the others are hung up on at once; after the
    /// deadline the place is free again.
    #[tokio::test]
    async fn regress_connections_that_sit_there_are_few_and_go() {
        let tcp = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = tcp.local_addr().unwrap();
        let mut gate = Gate { patience: Duration::from_millis(300), ..Gate::new(tcp) };
        let guests = gate.guests.clone();
        let mut held = Vec::new();
        for _ in 0..MOST_FROM_HERE {
            let client = TcpStream::connect(address).await.unwrap();
            held.push((client, gate.accept().await.0));
        }
        let mut refused = TcpStream::connect(address).await.unwrap();
        let mut byte = [0; 1];
        let hung_up = tokio::select! {
            _ = gate.accept() => panic!("one too many was admitted"),
            read = refused.read(&mut byte) => read,
        };
        assert!(matches!(hung_up, Ok(0) | Err(_)), "{hung_up:?}");
        assert_eq!(guests.lock().unwrap().total, MOST_FROM_HERE);
        // Nobody writes: the deadline ends the wait for a request.
        let (client, mut guest) = held.pop().unwrap();
        let error = guest.read(&mut [0; 1]).await.unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        drop((client, guest, held));
        assert_eq!(guests.lock().unwrap().total, 0);
    }
}
