//! A LAN-XI front end that is not there: its web server and its stream.
//!
//! It answers as the Open API's reference says, 403 in the wrong state included, has one transducer
//! a channel that says what it is, and plays its material as 24-bit samples. It counts what a
//! client does wrong.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use gearwatch_runtime::stop::Stop;
use serde_json::{Value, json};
use tokio::runtime::Handle;
use tokio::sync::watch;

use crate::material::{Channel, Material, Open};
use crate::trouble::TroubleConfig;
use gearwatch_sources::Speed;

mod play;
mod rest;

/// How the instrument is made.
#[derive(Clone, Debug)]
pub struct InstrumentConfig {
    /// Its web server; port 0 for any.
    pub listen: SocketAddr,
    /// Serial number.
    pub serial: u64,
    /// How fast its time goes by.
    pub speed: Speed,
    /// How long it looks for transducers.
    pub detection: Duration,
    /// What goes wrong.
    pub trouble: TroubleConfig,
}

impl Default for InstrumentConfig {
    fn default() -> Self {
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 0)),
            serial: 100_001,
            speed: Speed::Times(1.0),
            detection: Duration::from_millis(100),
            trouble: TroubleConfig::default(),
        }
    }
}

/// What happened to it. Counters only grow.
#[derive(Debug, Default)]
pub struct Stats {
    /// Measurements started.
    pub measurements: AtomicU64,
    /// Measurements that were stopped before their socket was closed.
    pub closed_in_order: AtomicU64,
    /// Measurements whose client closed the socket first.
    pub closed_in_wrong_order: AtomicU64,
    /// Calls answered with 403.
    pub refused: AtomicU64,
    /// Messages of samples sent.
    pub messages: AtomicU64,
    /// Samples of each channel sent, in messages or lost by overrun.
    pub samples: AtomicU64,
    /// Overruns told.
    pub overruns: AtomicU64,
    /// Bits flipped.
    pub flips: AtomicU64,
    /// Connections reset by itself.
    pub drops: AtomicU64,
}

fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// A running instrument; ends when dropped.
pub struct Instrument {
    rest: SocketAddr,
    shared: Arc<Shared>,
}

/// State of the recorder, as the instrument names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    Opened,
    Configuring,
    Streaming,
    Recording,
}

impl State {
    const fn name(self) -> &'static str {
        match self {
            Self::Idle => "Idle",
            Self::Opened => "RecorderOpened",
            Self::Configuring => "RecorderConfiguring",
            Self::Streaming => "RecorderStreaming",
            Self::Recording => "RecorderRecording",
        }
    }
}

struct Recorder {
    state: State,
    /// Counts measurements; a player ends when its number is not the current one.
    measurement: u64,
    /// Until then transducers are looked for.
    detecting: Option<Instant>,
    /// As the client set it.
    setup: Value,
    /// Instrument time − time of this machine (ns).
    clock_offset_ns: i64,
    client: Option<TcpStream>,
    /// Overload, by channel: never, now, or earlier in the measurement.
    overload: Vec<&'static str>,
    refuse: u32,
}

struct Shared {
    config: InstrumentConfig,
    open: Open,
    channels: Vec<Channel>,
    rate_hz: f64,
    stream_port: u16,
    recorder: Mutex<Recorder>,
    /// Grows at every change, for `onchange`.
    tag: watch::Sender<u64>,
    stats: Arc<Stats>,
    stop: Stop,
}

impl Shared {
    fn recorder(&self) -> MutexGuard<'_, Recorder> {
        self.recorder.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn changed(&self) {
        self.tag.send_modify(|tag| *tag += 1);
    }

    /// What a client is offered before it wishes anything.
    fn default_setup(&self) -> Value {
        let channels = self.channels.iter().enumerate().map(|(i, _)| {
            json!({
                "channel": i + 1, "enabled": true, "bandwidth": "51.2 kHz", "ccld": false, "polvolt": false,
                "range": "10 Vpeak", "filter": "7.0 Hz", "floating": false, "name": format!("Channel {}", i + 1),
                "destinations": ["sd"],
            })
        });
        json!({ "channels": channels.collect::<Vec<_>>(), "name": "Default setup", "recordingMode": "Single" })
    }

    /// What the transducers say of themselves: sensitivities that suit the unit.
    fn transducers(&self) -> Value {
        let all = self.channels.iter().enumerate().map(|(i, channel)| {
            let sensitivity = match channel.unit.as_str() {
                "m/s^2" | "mm/s" => 0.01,
                "g" => 0.1,
                _ => 1.0,
            };
            json!({
                "type": { "number": "4507", "model": "B", "prefix": "", "variant": "" }, "serialNumber": 3000 + i,
                "sensitivity": sensitivity, "unit": channel.unit, "requiresCcld": true, "requires200V": false,
            })
        });
        Value::Array(all.collect())
    }
}

impl Instrument {
    /// Starts it. The material is opened anew for each measurement.
    ///
    /// # Errors
    /// When the material cannot be played or an address is taken.
    pub fn start(config: InstrumentConfig, open: Open, runtime: &Handle) -> std::io::Result<Self> {
        let stop = Stop::default();
        let material = Material::new(open.clone(), Speed::Max, stop.clone()).map_err(std::io::Error::other)?;
        let rest_listener = TcpListener::bind(config.listen)?;
        let rest = rest_listener.local_addr()?;
        let stream = TcpListener::bind(SocketAddr::new(config.listen.ip(), 0))?;
        let recorder = Recorder {
            state: State::Idle,
            measurement: 0,
            detecting: None,
            setup: Value::Null,
            clock_offset_ns: 0,
            client: None,
            overload: vec!["none"; material.channels().len()],
            refuse: config.trouble.refuse,
        };
        let shared = Arc::new(Shared {
            channels: material.channels().to_vec(),
            rate_hz: material.rate_hz(),
            stream_port: stream.local_addr()?.port(),
            recorder: Mutex::new(recorder),
            tag: watch::Sender::new(1),
            stats: Arc::default(),
            stop,
            config,
            open,
        });
        rest_listener.set_nonblocking(true)?;
        stream.set_nonblocking(true)?;
        let acceptor = shared.clone();
        std::thread::Builder::new().name("emulate-accept".to_owned()).spawn(move || acceptor.accept(&stream))?;
        runtime.spawn(rest::serve(shared.clone(), rest_listener));
        Ok(Self { rest, shared })
    }

    /// Address of the web server.
    pub fn address(&self) -> SocketAddr {
        self.rest
    }

    /// What happened to it.
    pub fn stats(&self) -> &Arc<Stats> {
        &self.shared.stats
    }

    /// Its channels.
    pub fn channels(&self) -> &[Channel] {
        &self.shared.channels
    }

    /// Samples per second of every channel.
    pub fn rate_hz(&self) -> f64 {
        self.shared.rate_hz
    }
}

impl Drop for Instrument {
    /// Pulls its plug.
    fn drop(&mut self) {
        self.shared.stop.now();
        self.shared.changed();
    }
}

/// How often a thread looks for a connection.
const LOOK: Duration = Duration::from_millis(5);

impl Shared {
    /// Keeps the newest connection to the stream's port.
    fn accept(&self, listener: &TcpListener) {
        while self.stop.sleep(LOOK) {
            while let Ok((client, _)) = listener.accept() {
                if client.set_nonblocking(false).is_ok() {
                    self.recorder().client = Some(client);
                }
            }
        }
    }
}
