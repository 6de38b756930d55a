//! Sends material as frames over TCP or UDP: what a small acquisition program would do.

use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::time::Duration;

use gearwatch_core::block::{Block, Packet, UnixNanos};
use gearwatch_io::frames::{CHECKSUM, Frame, HEADER, Values, encode};
use gearwatch_runtime::stop::Stop;

use crate::material::Material;
use crate::trouble::{Incident, Plan, TroubleConfig};
use crate::wire::Wire;
use gearwatch_runtime::clock::now_unix_ns;
use gearwatch_sources::{SourceError, time_of};

/// A datagram of this size needs no fragments on any network.
const DATAGRAM: usize = 1472;
/// Samples of a channel in a frame over TCP.
const RUN: usize = 1024;
/// How often a listener looks for a client, and a write for room.
const PATIENCE: Duration = Duration::from_millis(20);

/// Why sending ended.
#[derive(Debug, thiserror::Error)]
pub enum SendError {
    /// The material.
    #[error(transparent)]
    Material(#[from] SourceError),
    /// The network.
    #[error("{peer}: {source}")]
    Network {
        /// The other side.
        peer: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
}

/// Turns material into frames. One number for each channel in turn; channels wait for each other.
pub struct FrameSender {
    material: Material,
    stop: Stop,
    /// Values of each channel that are not sent yet.
    waiting: Vec<Vec<f32>>,
    stream: u64,
    sequence: u64,
    first_sample: u64,
    t0_ns: UnixNanos,
    trouble: TroubleConfig,
    connections: u64,
}

impl FrameSender {
    /// A new stream.
    pub fn new(material: Material, trouble: TroubleConfig, stop: Stop) -> Self {
        let t0_ns = now_unix_ns();
        let waiting = vec![Vec::new(); material.channels().len()];
        let stream = t0_ns.cast_unsigned();
        Self { material, stop, waiting, stream, sequence: 0, first_sample: 0, t0_ns, trouble, connections: 0 }
    }

    /// What is played.
    pub fn material(&self) -> &Material {
        &self.material
    }

    /// Frames made so far.
    pub fn frames(&self) -> u64 {
        self.sequence
    }

    /// Sends to whoever connects, one after another, until asked to stop. While nobody is there,
    /// frames are made and lost.
    ///
    /// # Errors
    /// When the material ends with an error or the listener fails.
    pub fn serve(&mut self, listener: &TcpListener) -> Result<(), SendError> {
        let peer = listener.local_addr().unwrap_or(SocketAddr::from(([0, 0, 0, 0], 0)));
        let failed = |source| SendError::Network { peer, source };
        listener.set_nonblocking(true).map_err(failed)?;
        let mut client: Option<Connection> = None;
        while let Some(bytes) = self.next_frame(RUN)? {
            match listener.accept() {
                Ok((socket, from)) => {
                    tracing::info!("{from} is connected");
                    client = self.connection(socket).ok();
                }
                Err(e) if gearwatch_sources::is_timeout(&e) => {}
                Err(e) => return Err(failed(e)),
            }
            client = client.and_then(|client| self.put(client, bytes));
        }
        Ok(())
    }

    /// Connects and sends until asked to stop; connects again when the connection is lost.
    ///
    /// # Errors
    /// When the material ends with an error.
    pub fn connect(&mut self, peer: SocketAddr) -> Result<(), SendError> {
        let mut client: Option<Connection> = None;
        while let Some(bytes) = self.next_frame(RUN)? {
            if client.is_none() {
                client =
                    TcpStream::connect_timeout(&peer, PATIENCE).ok().and_then(|socket| self.connection(socket).ok());
            }
            client = client.and_then(|client| self.put(client, bytes));
        }
        Ok(())
    }

    /// Sends datagrams until asked to stop. One that cannot be sent is lost, as on any network.
    ///
    /// # Errors
    /// When the material ends with an error, the system gives no socket, or a sample instant does
    /// not fit a datagram.
    pub fn datagrams(&mut self, peer: SocketAddr) -> Result<(), SendError> {
        let failed = |source| SendError::Network { peer, source };
        let any: SocketAddr = if peer.is_ipv4() { ([0, 0, 0, 0], 0).into() } else { ([0_u16; 8], 0).into() };
        let socket = UdpSocket::bind(any).map_err(failed)?;
        let run = (DATAGRAM - HEADER - CHECKSUM) / (4 * self.waiting.len());
        let mut plan = Plan::new(&self.trouble, 0);
        while let Some(mut bytes) = self.next_frame(run.max(1))? {
            let incidents = plan.due(self.first_sample as f64 / self.material.rate_hz());
            if incidents.iter().any(|i| matches!(i, Incident::Drop | Incident::Overrun(_) | Incident::Mute)) {
                continue;
            }
            if incidents.contains(&Incident::Flip) {
                let at = plan.below(bytes.len());
                bytes[at] ^= 1 << plan.below(8);
            }
            match socket.send_to(&bytes, peer) {
                // Nobody listens yet, or any more.
                Err(e) if e.kind() != std::io::ErrorKind::ConnectionRefused => tracing::debug!("{peer}: {e}"),
                _ => {}
            }
        }
        Ok(())
    }

    fn connection(&mut self, socket: TcpStream) -> std::io::Result<Connection> {
        socket.set_nonblocking(false)?;
        let number = self.connections;
        self.connections += 1;
        let split = self.trouble.split.then_some(self.trouble.seed ^ number);
        Ok(Connection {
            wire: Wire::new(socket, split),
            plan: Plan::new(&self.trouble, number),
            began: self.first_sample,
        })
    }

    /// Sends a frame, unless something goes wrong; hands the connection back if it goes on.
    fn put(&self, mut client: Connection, mut bytes: Vec<u8>) -> Option<Connection> {
        let secs = (self.first_sample - client.began) as f64 / self.material.rate_hz();
        for incident in client.plan.due(secs) {
            match incident {
                Incident::Flip => {
                    let at = client.plan.below(bytes.len());
                    bytes[at] ^= 1 << client.plan.below(8);
                }
                Incident::Stall(secs) | Incident::Delay(secs) => {
                    self.stop.sleep(Duration::from_secs_f64(secs));
                }
                Incident::Overrun(_) | Incident::Mute => return client.wire.check().ok().map(|()| client),
                Incident::Drop => {
                    client.wire.reset_inside(&mut client.plan);
                    return None;
                }
                Incident::Clip(_) => {}
            }
        }
        client.wire.put(&bytes);
        client.wire.send(PATIENCE).ok().map(|()| client)
    }

    /// The next frame when it is due.
    fn next_frame(&mut self, run: usize) -> Result<Option<Vec<u8>>, SourceError> {
        loop {
            if self.waiting.iter().all(|channel| channel.len() >= run) {
                return Ok(Some(self.frame(run)));
            }
            match self.material.next_packet()? {
                Some(Packet::Vibration(block)) => self.take(&block),
                Some(_) => {}
                None => return Ok(None),
            }
        }
    }

    fn take(&mut self, block: &Block) {
        let at = self.material.channels().iter().position(|channel| channel.sensor == *block.sensor);
        if let Some(waiting) = at.and_then(|at| self.waiting.get_mut(at)) {
            waiting.extend(block.samples.iter().map(|value| value as f32));
        }
    }

    fn frame(&mut self, run: usize) -> Vec<u8> {
        let mut values = Vec::with_capacity(run * self.waiting.len());
        for i in 0..run {
            values.extend(self.waiting.iter().filter_map(|channel| channel.get(i)));
        }
        self.waiting.iter_mut().for_each(|channel| drop(channel.drain(..run)));
        let rate_hz = self.material.rate_hz();
        let frame = Frame {
            stream: self.stream,
            sequence: self.sequence,
            first_sample: self.first_sample,
            t0: time_of(self.t0_ns, self.first_sample, rate_hz),
            sample_rate_hz: rate_hz,
            channels: u16::try_from(self.waiting.len()).unwrap_or(u16::MAX),
            quality: 0,
            values: Values::Physical(values),
        };
        self.sequence += 1;
        self.first_sample += run as u64;
        let mut bytes = Vec::new();
        encode(&frame, &mut bytes);
        bytes
    }
}

struct Connection {
    wire: Wire,
    plan: Plan,
    /// Sample at which it began.
    began: u64,
}
