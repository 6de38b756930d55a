//! What goes from the engine to the sinks.

use std::sync::Arc;

use gearwatch_alarm::{Acknowledgement, Alarm};
use gearwatch_core::block::Packet;
use gearwatch_core::verdict::{MachineState, Verdict};
use gearwatch_runtime::queue::Outlet;

use serde::Serialize;

use crate::states::{BenchInstrument, Life};
use gearwatch_log::{Clock, Gap, SpectrumFrame};

/// One thing to be told. Shared between the sinks, so that nothing is copied per sink.
#[derive(Clone, Debug)]
pub enum Event {
    /// A verdict and its JSON object on one line, without the line's end.
    Verdict {
        /// Name of the bench.
        bench: Arc<str>,
        /// The service watches several benches: whatever names no bench elsewhere names it.
        several: bool,
        /// The verdict.
        verdict: Arc<Verdict>,
        /// The same as JSON: what stdout and the log carry, byte for byte.
        line: Arc<str>,
    },
    /// Something is missing.
    Gap {
        /// Name of the bench.
        bench: Arc<str>,
        /// What.
        gap: Gap,
    },
    /// An alarm came, went or grew worse, or somebody has seen it.
    Alarm {
        /// Name of the bench.
        bench: Arc<str>,
        /// How it is now.
        alarm: Alarm,
        /// Who has seen it, where that is what happened.
        seen: Option<Arc<Acknowledgement>>,
    },
    /// How a bench is: about once a second, and once more when the service stops.
    State {
        /// Name of the bench.
        bench: Arc<str>,
        /// How it is.
        state: Arc<BenchState>,
    },
    /// How the clocks stand, at the start and when the wall clock was set.
    Clock(Clock),
    /// What a source delivered; only for sinks that want it.
    Raw(Arc<Packet>),
    /// An order spectrum, now and then; only for sinks that want it.
    Spectrum(Arc<SpectrumFrame>),
}

/// How a bench is, in a few words and figures. `machine` and `instrument` are never better than
/// what is known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BenchState {
    /// When this was so (ns since the epoch).
    pub t_ns: i64,
    /// Whether the service runs.
    pub service: Life,
    /// All that must go on goes on: sources, sinks, self test.
    pub ok: bool,
    /// Worst machine state of the bench's places.
    pub machine: MachineState,
    /// `ok` only if all channels are.
    pub instrument: BenchInstrument,
    /// Motor speed in Hz, `null` where unknown.
    pub motor_speed_hz: Option<f64>,
    /// Torque at the brake in N m, `null` where unknown.
    pub brake_torque_nm: Option<f64>,
    /// Windows judged.
    pub windows_judged: u64,
    /// Windows shed because the workers were too slow.
    pub windows_shed: u64,
    /// Gaps.
    pub gaps: u64,
    /// Alarms that hold.
    pub alarms_active: u64,
    /// Version of the service.
    pub version: &'static str,
}

impl BenchState {
    /// In a way that somebody may want to know of at once.
    pub fn differs_from(&self, other: &Self) -> bool {
        let heart = |state: &Self| (state.service, state.ok, state.machine, state.instrument, state.alarms_active);
        heart(self) != heart(other)
    }
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

    /// Tells all sinks that have room. For what is said again a second later, by somebody who must
    /// never wait.
    pub fn mention(&self, event: Event) {
        let event = Arc::new(event);
        for queue in &self.0 {
            queue.put_if_room(event.clone());
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
