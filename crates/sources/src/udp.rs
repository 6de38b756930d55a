//! Frames over UDP, one a datagram.

use std::collections::VecDeque;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use gearwatch_core::block::Packet;
use gearwatch_io::frames::datagram;
use gearwatch_runtime::kinds::Kind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::frames::{Layout, Memory, Reader};
use crate::socket::{self, POLL, is_timeout};
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<Udp>(
    "udp",
    "frames of samples over UDP, in gearwatch's own format (try it with `gearwatch emulate udp`)",
    r#"
listen = "0.0.0.0:5512"
from = "192.168.1.7"                # the only machine that is heard; leave out for any
frames = { channels = ["acc_1", "acc_2"], unit = "m/s^2" }
"#,
);

/// Keys of a UDP source.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Udp {
    /// Address at which datagrams come.
    listen: SocketAddr,
    /// The only machine that is heard; any where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    from: Option<IpAddr>,
    /// What the frames hold.
    frames: Layout,
    #[serde(skip)]
    memory: Memory,
}

/// The longest datagram.
const LONGEST: usize = 65_536;

impl SourceConfig for Udp {
    fn problems(&self) -> Vec<String> {
        self.frames.problems()
    }

    fn is_live(&self) -> bool {
        true
    }

    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        let failed = |e: std::io::Error| SourceError::Peer { peer: self.listen.to_string(), message: e.to_string() };
        let socket = UdpSocket::bind(self.listen).map_err(failed)?;
        socket.set_read_timeout(Some(POLL)).map_err(failed)?;
        let mut reading = Reading {
            socket,
            name: self.listen,
            from: self.from,
            reader: Reader::new(&self.frames, &self.memory),
            buffer: vec![0; LONGEST],
            unusable: 0,
            foreign: 0,
            sender: None,
            patience: context.data_deadline,
        };
        Ok(socket::feed(context.stop.clone(), move |ready| reading.read(ready)))
    }
}

struct Reading {
    socket: UdpSocket,
    name: SocketAddr,
    from: Option<IpAddr>,
    reader: Reader,
    buffer: Vec<u8>,
    unusable: u64,
    foreign: u64,
    /// Who is heard, and when they were heard last. Somebody else beside them is not, until they
    /// have been silent for the data deadline: two streams at once would make each look full of
    /// holes.
    sender: Option<(SocketAddr, Instant)>,
    patience: Duration,
}

impl Reading {
    fn is_heard(&self, peer: SocketAddr) -> bool {
        let named = self.from.is_none_or(|from| from == peer.ip().to_canonical());
        let other = self.sender.is_some_and(|(sender, heard)| sender != peer && heard.elapsed() < self.patience);
        named && !other
    }

    /// There is no connection that could end; silence shows in the state of the source.
    fn read(&mut self, ready: &mut VecDeque<Packet>) -> Result<(), SourceError> {
        let error = |message: String| SourceError::Peer { peer: self.name.to_string(), message };
        match self.socket.recv_from(&mut self.buffer) {
            Ok((_, peer)) if !self.is_heard(peer) => {
                self.foreign += 1;
                // Told ever more rarely: whoever sends must not be able to fill the log.
                if self.foreign.is_power_of_two() {
                    tracing::warn!(datagrams = self.foreign, "{peer} sends to {} and is not heard", self.name);
                }
            }
            Ok((n, peer)) => match datagram(self.buffer.get(..n).unwrap_or_default()) {
                Ok(frame) => {
                    self.sender = Some((peer, Instant::now()));
                    self.reader.take(frame, ready).map_err(|e| error(e.to_string()))?;
                }
                Err(damage) => {
                    self.unusable += 1;
                    if self.unusable.is_power_of_two() {
                        tracing::warn!(%peer, datagrams = self.unusable, "not readable: {damage}");
                    }
                }
            },
            Err(e) if is_timeout(&e) => {}
            Err(e) => return Err(error(e.to_string())),
        }
        Ok(())
    }
}
