//! Instruments that are not there: they play the simulator or a recording as the real ones would, and can misbehave as the real ones do.
//!
//! For tests, and for people without the hardware (`gearwatch emulate`). Nothing of the service depends on this.

mod frames;
mod lanxi;
mod material;
mod trouble;
mod wire;

pub use frames::{FrameSender, SendError};
pub use lanxi::{Instrument, InstrumentConfig, Stats};
pub use material::{Channel, Material, Open, open_source};
pub use trouble::{Incident, Plan, TroubleConfig};
