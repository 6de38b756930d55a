//! The clocks, which the log is given and never reads itself.

use std::time::Duration;

use gearwatch_core::block::UnixNanos;

/// Both clocks, read together.
#[derive(Clone, Copy, Debug)]
pub struct Now {
    /// Wall clock (ns since the epoch): for labels only.
    pub wall_ns: UnixNanos,
    /// Monotonic clock, since the service started.
    pub mono: Duration,
}
