//! The connection to a server. A message that claims to be longer than this client has asked for
//! ends it: the client's library would wait for the rest, and keep what came until then.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use opcua_client::transport::{
    Connector, RequestRecv, SecureChannelState, StreamConnection, StreamConnector, StreamTransport,
    TransportConfiguration,
};
use opcua_core::comms::tcp_codec::TcpCodec;
use opcua_types::{DecodingOptions, EndpointDescription, Error, StatusCode};
use tokio::io::{AsyncRead, ReadBuf, ReadHalf, WriteHalf};
use tokio::net::TcpStream;
use tokio_util::codec::FramedRead;

/// Longest part of a message that this client asks for (bytes).
pub(super) const LONGEST_CHUNK: usize = 65_535;
/// Type and length stand before each part of a message (bytes; OPC 10000-6, 7.1.2.2).
const HEAD: usize = 8;

/// Opens connections to one server.
#[derive(Clone, Debug)]
pub(super) struct Dialler {
    /// Host and port.
    pub(super) address: String,
    /// The endpoint that the server is asked for.
    pub(super) url: String,
}

impl Connector for Dialler {
    type Transport = StreamTransport<Capped<ReadHalf<TcpStream>>, WriteHalf<TcpStream>>;

    async fn connect(
        &self,
        channel: Arc<SecureChannelState>,
        requests: RequestRecv,
        config: TransportConfiguration,
    ) -> Result<Self::Transport, Error> {
        let call = |url: String, options: DecodingOptions| {
            let address = self.address.clone();
            async move {
                let socket = TcpStream::connect(&address)
                    .await
                    .map_err(|e| Error::new(StatusCode::BadNotConnected, format!("no connection to {address}: {e}")))?;
                let (read, write) = tokio::io::split(socket);
                let reader = FramedRead::new(Capped::new(read), TcpCodec::new(options));
                Ok(StreamConnection::new(reader, write, url))
            }
        };
        StreamConnector::new(call, self.url.clone()).connect(channel, requests, config).await
    }

    fn default_endpoint(&self) -> EndpointDescription {
        self.url.as_str().into()
    }
}

/// Reads what `R` reads, and fails at a part of a message that is too long or too short.
pub(super) struct Capped<R> {
    from: R,
    head: [u8; HEAD],
    /// Bytes of the head that have come.
    known: usize,
    /// Bytes of the part that are to come.
    rest: usize,
}

impl<R> Capped<R> {
    fn new(from: R) -> Self {
        Self { from, head: [0; HEAD], known: 0, rest: 0 }
    }

    /// Follows the parts of messages through bytes that have come.
    fn follow(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            if self.rest > 0 {
                let passed = self.rest.min(bytes.len());
                self.rest -= passed;
                bytes = bytes.get(passed..).unwrap_or_default();
                continue;
            }
            if let (Some(place), Some((first, others))) = (self.head.get_mut(self.known), bytes.split_first()) {
                *place = *first;
                self.known += 1;
                bytes = others;
            }
            if self.known == HEAD {
                let [.., a, b, c, d] = self.head;
                let length = u32::from_le_bytes([a, b, c, d]) as usize;
                if !(HEAD + 1..=LONGEST_CHUNK).contains(&length) {
                    return Err(io::Error::new(
                        io::ErrorKind::InvalidData,
                        format!("expected a message of {} to {LONGEST_CHUNK} bytes, found {length}", HEAD + 1),
                    ));
                }
                (self.rest, self.known) = (length - HEAD, 0);
            }
        }
        Ok(())
    }
}

impl<R: AsyncRead + Unpin> AsyncRead for Capped<R> {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let before = buffer.filled().len();
        std::task::ready!(Pin::new(&mut this.from).poll_read(cx, buffer))?;
        Poll::Ready(this.follow(buffer.filled().get(before..).unwrap_or_default()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A part of a message of this length, by its head.
    fn part(length: u32) -> Vec<u8> {
        let mut bytes = b"MSGF".to_vec();
        bytes.extend(length.to_le_bytes());
        bytes.resize((length as usize).clamp(HEAD, 1 << 17), 7);
        bytes
    }

    /// However the bytes are cut, two good parts pass and one that is too long does not.
    #[test]
    fn conform_messages_that_are_too_long_or_short_end_the_connection() {
        for step in [1, 3, 7, 8, 9, 4096] {
            let follow = |bytes: &[u8]| {
                let mut reader = Capped::new(());
                bytes.chunks(step).try_for_each(|bytes| reader.follow(bytes))
            };
            assert!(follow(&[part(9), part(LONGEST_CHUNK as u32), part(20)].concat()).is_ok());
            for wrong in [0, 7, 8, LONGEST_CHUNK as u32 + 1, u32::MAX] {
                let error = follow(&[part(9), part(wrong)].concat()).unwrap_err();
                assert!(error.to_string().contains(&format!("found {wrong}")), "{error}");
            }
        }
    }
}
