//! What goes from the engine to the sinks.

use std::sync::Arc;

use gearwatch_core::block::Packet;
use gearwatch_core::verdict::Verdict;

use crate::log::Gap;
use crate::queue::Outlet;

/// One thing to be told. Shared between the sinks, so that nothing is copied per sink.
#[derive(Clone, Debug)]
pub enum Event {
    /// A verdict and its JSON object on one line, without the line's end.
    Verdict {
        /// Name of the bench.
        bench: Arc<str>,
        /// The verdict.
        verdict: Arc<Verdict>,
        /// The same as JSON: what stdout and the log carry, byte for byte.
        line: Arc<str>,
    },
    /// Something is missing.
    Gap(Gap),
    /// What a source delivered; only for sinks that want it.
    Raw(Arc<Packet>),
}

/// Hands events to all sinks, each by the policy of its own queue.
#[derive(Clone, Debug, Default)]
pub struct Fanout(Vec<Outlet<Arc<Event>>>);

impl Fanout {
    /// To these queues.
    pub fn new(queues: Vec<Outlet<Arc<Event>>>) -> Self {
        Self(queues)
    }

    /// Tells all sinks. One that is gone counts what it misses itself.
    pub fn tell(&self, event: Event) {
        let event = Arc::new(event);
        for queue in &self.0 {
            let _ = queue.put_blocking(event.clone());
        }
    }

    /// There is nobody to tell.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// No more will be told.
    pub fn close(&self) {
        for queue in &self.0 {
            queue.close();
        }
    }
}
