//! Sources: where packets come from. One file a kind, one line in [`KINDS`].
//!
//! ```text
//!                        ┌► Pull: called again and again on a thread ─► packet
//! KINDS ─► SourceConfig ─┤    files, pipes, simulator, LAN-XI, TCP, UDP, C libraries
//! name      keys    open │
//!                        └► Push: a future with a socket of its own ─► Sender ─► queue
//!                             MQTT, Modbus, OPC UA                     └ tells of each packet first
//! ```
//!
//! - A source knows its bench, a folder and a stop signal ([`SourceContext`]), and nothing of who
//!   reads it: a service, a test, an emulated instrument that plays it.
//! - Whoever reads it counts its packets, and opens a live one again after an error.
//!
//! A kind is found by its name, and reads its keys:
//!
//! ```
//! use std::path::{Path, PathBuf};
//! use std::sync::Arc;
//!
//! use gearwatch_runtime::kinds;
//! use gearwatch_runtime::stop::Stop;
//! use gearwatch_sources::{Feed, KINDS, SourceContext};
//!
//! let bench = gearwatch_io::bench_file::parse(gearwatch_sim::shipped::DEMO_BENCH, Path::new("demo"))?;
//! let context = SourceContext::new(Arc::new(bench), PathBuf::new(), Stop::default());
//! let kind = kinds::find(KINDS, "test_signal", "source")?;
//! let (source, _) = kind.read(toml::from_str("speed = \"max\"")?)?;
//! let Feed::Pull(mut pull) = source.open(&context)? else { panic!("a test signal is pulled") };
//! assert!(pull()?.is_some());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Adding a source
//! 1. A file `NAME.rs` with a struct for its TOML keys (`Deserialize`, `JsonSchema`,
//!    `deny_unknown_fields`) that implements [`SourceConfig`], and a `pub(crate) const KIND`.
//! 2. One line in [`KINDS`].
//!
//! Parsing, `gearwatch list`, the schema, supervision, reconnects, counters and the conformance
//! tests follow from the table. A source that is pulled (a file, the simulator, a socket that is
//! read with a time limit) returns [`Feed::Pull`] and gets a thread of its own. One whose protocol
//! is spoken by tokio returns [`Feed::Push`]: a future that owns its socket and puts packets into
//! the outlet. Either ends with an error when the connection is lost, and is opened again after a
//! while; it checks then that it meets the same device as before. Whatever is missing is told by a
//! jump of `first_sample_index` or by
//! [`Quality::GAP_BEFORE`](gearwatch_core::block::Quality::GAP_BEFORE), never silently closed up.

use std::future::Future;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use gearwatch_check::Look;
use gearwatch_core::bench::Bench;
use gearwatch_core::block::Packet;
use gearwatch_runtime::kinds::{Kind, read_keys};
use gearwatch_runtime::queue::{Closed, Outlet};
use gearwatch_runtime::stop::Stop;

use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;

mod file;
pub mod frames;
mod framing;
mod growing_file;
mod iio;
mod inputs;
mod lanxi;
mod look;
mod modbus;
mod mqtt;
mod nidaqmx;
mod numbering;
mod opcua;
mod pace;
mod pipe;
mod readings;
mod simulator;
mod socket;
mod sound_card;
mod tcp;
mod test_signal;
mod udp;

pub use framing::time_of;
pub use look::{look, name_of};
pub use pace::{Pacer, Speed, SpeedError};
pub use readings::{Quantity, Readings};
pub use socket::is_timeout;

/// All kinds of sources.
pub static KINDS: &[Kind<dyn SourceConfig>] = &[
    simulator::KIND,
    test_signal::KIND,
    file::KIND,
    pipe::KIND,
    growing_file::KIND,
    lanxi::KIND,
    tcp::KIND,
    udp::KIND,
    nidaqmx::KIND,
    iio::KIND,
    sound_card::KIND,
    modbus::KIND,
    mqtt::KIND,
    opcua::KIND,
];

/// A source silent for so long is NOT OK (s), where its configuration says nothing else.
pub const DATA_DEADLINE_SECS: f64 = 5.0;

/// A line of [`KINDS`].
const fn kind<T>(name: &'static str, help: &'static str, example: &'static str) -> Kind<dyn SourceConfig>
where
    T: SourceConfig + DeserializeOwned + Serialize + JsonSchema + 'static,
{
    Kind::new::<T>(name, help, example, |keys| {
        let (config, shown) = read_keys::<T>(keys)?;
        Ok((Box::new(config), shown))
    })
}

/// What a source may know of the bench that it feeds.
#[derive(Clone, Debug)]
pub struct SourceContext {
    /// The bench.
    pub bench: Arc<Bench>,
    /// Relative paths start here: the folder of the configuration file.
    pub folder: PathBuf,
    /// Ends waiting.
    pub stop: Stop,
    /// A live source without data for so long has failed.
    pub data_deadline: Duration,
    /// What the bench's sources know of its operating point, together.
    pub readings: Readings,
}

impl SourceContext {
    /// For a source of this bench, with the usual deadline.
    pub fn new(bench: Arc<Bench>, folder: PathBuf, stop: Stop) -> Self {
        let data_deadline = Duration::from_secs_f64(DATA_DEADLINE_SECS);
        Self { bench, folder, stop, data_deadline, readings: Readings::default() }
    }

    /// A path of the configuration, seen from where the service runs.
    pub fn resolve(&self, path: &Path) -> PathBuf {
        self.folder.join(path)
    }
}

/// A kind whose code was not compiled; the check of its values has said so before.
#[allow(dead_code, reason = "not used where nothing was left out")]
fn not_in_this_build(kind: &str, feature: &str) -> SourceError {
    SourceError::Peer { peer: kind.to_owned(), message: gearwatch_runtime::kinds::with_feature(feature) }
}

/// Pulls the next packet; `None` at the end.
pub type Pull = Box<dyn FnMut() -> Result<Option<Packet>, SourceError> + Send>;

/// Where a source with a socket puts its packets.
pub struct Sender {
    outlet: Outlet<Packet>,
    taken: Box<dyn Fn(&Packet) + Send + Sync>,
}

impl Sender {
    /// Into this queue; `taken` sees each packet first. It lies on the way of every packet, so it
    /// must not wait.
    pub fn new(outlet: Outlet<Packet>, taken: impl Fn(&Packet) + Send + Sync + 'static) -> Self {
        Self { outlet, taken: Box::new(taken) }
    }

    /// Hands a packet over; never waits for long, since a live source is not held up.
    ///
    /// # Errors
    /// When the service stops: the source returns then.
    pub async fn send(&self, packet: Packet) -> Result<(), Closed> {
        (self.taken)(&packet);
        self.outlet.put(packet).await
    }
}

/// Pushes packets until it ends.
pub type Push = Box<dyn FnOnce(Sender) -> Pin<Box<dyn Future<Output = Result<(), SourceError>> + Send>> + Send>;

/// An opened source.
pub enum Feed {
    /// Called again and again on a thread of its own.
    Pull(Pull),
    /// Run as a task.
    Push(Push),
}

/// Why a source cannot be opened or go on.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A file, pipe or device failed.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// What was read makes no sense.
    #[error("{}: {place}: expected {expected}, found {found}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Line, byte or record.
        place: String,
        /// What would be right.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A reader's own error, which names file and place.
    #[error(transparent)]
    Reader(Box<dyn std::error::Error + Send + Sync>),
    /// An instrument, broker or other machine.
    #[error("{peer}: {message}")]
    Peer {
        /// Its address.
        peer: String,
        /// What went wrong.
        message: String,
    },
    /// Source and bench do not fit.
    #[error("{0}")]
    Bench(String),
}

/// A source as configured: checked without touching the world, then opened, perhaps many times.
pub trait SourceConfig: std::fmt::Debug + Send + Sync {
    /// What is wrong with the values, one sentence each; opens nothing.
    fn problems(&self) -> Vec<String> {
        Vec::new()
    }

    /// Why it cannot serve a bench, whatever else is right; opens nothing.
    fn refuses(&self, _bench: &Bench) -> Option<String> {
        None
    }

    /// Time goes on whether or not anybody listens. A live source is never held up: under overload
    /// whole windows are shed and counted, and it is opened again after an error. One that is not
    /// live waits, loses nothing, and ends at its first error.
    fn is_live(&self) -> bool;

    /// What a recording shows before anything of it is judged; `None` where looking would take
    /// something away, or nothing can be read.
    fn look(&self, _folder: &std::path::Path) -> Option<Look> {
        None
    }

    /// Opens it; called again after an error of a live source.
    ///
    /// # Errors
    /// When it cannot be opened.
    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError>;
}
