//! Emulated instruments: they play the simulator or a recording as the real ones would, and misbehave on demand as the real ones do.
//!
//! For tests, and for people without the hardware (`gearwatch emulate`). The service does not depend on this crate.

mod frames;
mod lanxi;
mod material;
mod trouble;
mod wire;

pub use frames::{FrameSender, SendError};
pub use lanxi::{Instrument, InstrumentConfig, Stats};
pub use material::{Channel, Material, Open, open_source};
pub use trouble::{Incident, Plan, TroubleConfig};
