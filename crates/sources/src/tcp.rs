//! Frames over TCP: from a sender that is called, or from one that calls.

use std::collections::VecDeque;
use std::io::Read;
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use gearwatch_core::block::Packet;
use gearwatch_io::frames::{Damage, Decoded, Decoder};
use gearwatch_runtime::kinds::Kind;
use gearwatch_runtime::stop::Stop;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::frames::{FrameError, Layout, Memory, Reader};
use crate::socket::{self, POLL, READ_BYTES, is_timeout};
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<Tcp>(
    "tcp",
    "frames of samples over TCP, in gearwatch's own format (try it with `gearwatch emulate tcp`)",
    r#"
connect = "192.168.1.7:5511"        # or listen = "0.0.0.0:5511" with from = "192.168.1.7"
frames = { channels = ["acc_1", "acc_2"], unit = "m/s^2" }
"#,
);

/// Keys of a TCP source.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Tcp {
    /// Host and port of the sender.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    connect: Option<String>,
    /// Address at which senders call; one is heard at a time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    listen: Option<SocketAddr>,
    /// With `listen`: the only machine that is heard.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    from: Option<IpAddr>,
    /// What the frames hold.
    frames: Layout,
    #[serde(skip)]
    memory: Memory,
}

/// A sender answers within this time, or is not there.
const CONNECT: Duration = Duration::from_secs(3);

impl SourceConfig for Tcp {
    fn problems(&self) -> Vec<String> {
        let mut out = self.frames.problems();
        match (&self.connect, &self.listen) {
            (Some(_), Some(_)) | (None, None) => out.push("give either connect or listen".to_owned()),
            (Some(peer), None) if !peer.contains(':') => {
                out.push(format!("connect is {peer:?}; expected host:port"));
            }
            _ => {}
        }
        if self.from.is_some() && self.listen.is_none() {
            out.push("from goes with listen".to_owned());
        }
        out
    }

    fn is_live(&self) -> bool {
        true
    }

    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        let name = self.connect.clone().or(self.listen.map(|a| a.to_string())).unwrap_or_default();
        let failed = |e: std::io::Error| SourceError::Peer { peer: name.clone(), message: e.to_string() };
        let (mut listener, mut client) = (None, None);
        if let Some(address) = self.listen {
            let bound = TcpListener::bind(address).map_err(failed)?;
            bound.set_nonblocking(true).map_err(failed)?;
            listener = Some(bound);
        } else {
            let all = name.to_socket_addrs().map_err(failed)?;
            let mut last = std::io::ErrorKind::NotFound.into();
            for address in all {
                match TcpStream::connect_timeout(&address, CONNECT) {
                    Ok(socket) => {
                        client =
                            Some(Client::new(socket, address, POLL.min(context.data_deadline / 4)).map_err(failed)?);
                        break;
                    }
                    Err(e) => last = e,
                }
            }
            if client.is_none() {
                return Err(failed(last));
            }
        }
        let mut reading = Reading {
            listener,
            client,
            from: self.from,
            reader: Reader::new(&self.frames, &self.memory),
            buffer: vec![0; READ_BYTES],
            deadline: context.data_deadline,
            stop: context.stop.clone(),
            name,
        };
        Ok(socket::feed(context.stop.clone(), move |ready| reading.read(ready)))
    }
}

/// Why a sender is given up.
#[derive(Debug, thiserror::Error)]
enum ClientError {
    #[error("the connection was closed")]
    Closed,
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    Frame(#[from] FrameError),
    #[error("no frame for {:.1} s{}", deadline.as_secs_f64(), damage.map_or_else(String::new, |it| format!(" ({it})")))]
    Silent { deadline: Duration, damage: Option<Damage> },
}

struct Client {
    socket: TcpStream,
    peer: SocketAddr,
    decoder: Decoder,
    /// When its last whole frame came.
    heard: Instant,
}

impl Client {
    fn new(socket: TcpStream, peer: SocketAddr, poll: Duration) -> std::io::Result<Self> {
        socket.set_nonblocking(false)?;
        socket.set_read_timeout(Some(poll.max(Duration::from_millis(1))))?;
        Ok(Self { socket, peer, decoder: Decoder::default(), heard: Instant::now() })
    }
}

struct Reading {
    listener: Option<TcpListener>,
    client: Option<Client>,
    from: Option<IpAddr>,
    reader: Reader,
    buffer: Vec<u8>,
    deadline: Duration,
    stop: Stop,
    name: String,
}

impl Reading {
    fn read(&mut self, ready: &mut VecDeque<Packet>) -> Result<(), SourceError> {
        let Some(client) = &mut self.client else { return self.accept() };
        let peer = client.peer;
        if let Err(why) = client.read(&mut self.reader, &mut self.buffer, ready, self.deadline) {
            if self.listener.is_none() {
                return Err(SourceError::Peer { peer: self.name.clone(), message: why.to_string() });
            }
            // The next sender may call; what is missing meanwhile shows in the source's silence.
            tracing::warn!("{peer}: {why}; listening at {}", self.name);
            self.client = None;
        }
        Ok(())
    }

    /// Waits a while for a sender.
    fn accept(&mut self) -> Result<(), SourceError> {
        let Some(listener) = &self.listener else { return Ok(()) };
        let poll = POLL.min(self.deadline / 4);
        match listener.accept() {
            Ok((socket, peer)) if self.from.is_none_or(|from| from == peer.ip().to_canonical()) => {
                tracing::info!("{peer} sends to {}", self.name);
                self.client = Client::new(socket, peer, poll).ok();
            }
            Ok((_, peer)) => tracing::warn!("{peer} called at {} and was not heard", self.name),
            Err(e) if is_timeout(&e) => {
                self.stop.sleep(poll);
            }
            Err(e) => return Err(SourceError::Peer { peer: self.name.clone(), message: e.to_string() }),
        }
        Ok(())
    }
}

impl Client {
    fn read(
        &mut self,
        reader: &mut Reader,
        buffer: &mut [u8],
        ready: &mut VecDeque<Packet>,
        deadline: Duration,
    ) -> Result<(), ClientError> {
        match self.socket.read(buffer) {
            Ok(0) => return Err(ClientError::Closed),
            Ok(n) => {
                let mut result = Ok(());
                let (peer, heard) = (self.peer, &mut self.heard);
                self.decoder.push(buffer.get(..n).unwrap_or_default(), &mut |decoded| match decoded {
                    Decoded::Frame(frame) if result.is_ok() => {
                        *heard = Instant::now();
                        result = reader.take(frame, ready);
                    }
                    Decoded::Frame(_) => {}
                    Decoded::Lost(lost) => tracing::warn!(%peer, bytes = lost.bytes, "not readable: {}", lost.damage),
                });
                result?;
            }
            Err(e) if is_timeout(&e) => {}
            Err(e) => return Err(e.into()),
        }
        if self.heard.elapsed() > deadline {
            return Err(ClientError::Silent { deadline, damage: self.decoder.lost().map(|lost| lost.damage) });
        }
        Ok(())
    }
}
