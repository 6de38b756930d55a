//! Emulated instruments: they play the simulator or a recording as the real ones would, and
//! misbehave on demand as the real ones do.
//!
//! For tests, and for people without the hardware (`gearwatch emulate`). The service does not
//! depend on this crate.
//!
//! ```text
//! a source of gearwatch-sources ─► Material ─┬─► Instrument: LAN-XI over HTTP and TCP ─► source `lanxi`
//!                                  Plan ─────┴─► FrameSender: frames over TCP or UDP  ─► sources `tcp`, `udp`
//!                                  troubles
//! ```
//!
//! ```
//! use std::path::{Path, PathBuf};
//! use std::sync::Arc;
//!
//! use gearwatch_emulate::{Instrument, InstrumentConfig, open_source};
//! use gearwatch_runtime::stop::Stop;
//! use gearwatch_sources::SourceContext;
//!
//! let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
//! let bench = r#"
//! format = "gearwatch-bench/1"
//! name = "small"
//! motor = { speed_hz = 30.0 }
//! shaft = [{ name = "input" }, { name = "output" }]
//! stage = [{ name = "stage1", pinion = { teeth = 23 }, wheel = { teeth = 41 } }]
//! sensor = [{ name = "acc_1", shaft = "input" }]
//! tacho = { shaft = "input" }
//! "#;
//! let bench = gearwatch_io::bench_file::parse(bench, Path::new("small"))?;
//! let context = SourceContext::new(Arc::new(bench), PathBuf::new(), Stop::default());
//! let played = open_source("test_signal", toml::from_str("speed = \"max\"")?, context)?;
//! let instrument = Instrument::start(InstrumentConfig::default(), played, runtime.handle())?;
//! assert!(instrument.address().ip().is_loopback());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod frames;
mod lanxi;
mod material;
mod trouble;
mod wire;

pub use frames::{FrameSender, SendError};
pub use lanxi::{Instrument, InstrumentConfig, Stats};
pub use material::{Channel, Material, Open, open_source};
pub use trouble::{Incident, Plan, TroubleConfig};
