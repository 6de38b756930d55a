//! The wall clock, for stamps alone: nothing in the service runs by it.

use std::time::{SystemTime, UNIX_EPOCH};

use gearwatch_core::block::UnixNanos;

/// The wall clock (ns since the epoch; negative before it).
pub fn now_unix_ns() -> UnixNanos {
    let nanos = |since: std::time::Duration| i64::try_from(since.as_nanos()).unwrap_or(i64::MAX);
    match SystemTime::now().duration_since(UNIX_EPOCH) {
        Ok(since) => nanos(since),
        Err(before) => -nanos(before.duration()),
    }
}
