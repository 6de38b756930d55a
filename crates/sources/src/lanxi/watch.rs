//! What the stream does not tell: overload, common-mode overload and cable faults, and that
//! somebody ended the measurement.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use gearwatch_core::block::Quality;
use serde_json::Value;

use super::rest::{CallError, Rest, last_update_tag};
use crate::SourceError;

/// The instrument answers at a change; without one the question is asked anew after this time.
const LONG_POLL: Duration = Duration::from_secs(2);
/// No more than so many questions, however often the state changes.
const SHORTEST_ROUND: Duration = Duration::from_millis(100);
/// So often a question may fail before that is told.
const FAILURES_TOLD: u32 = 3;

/// Asks on a thread of its own, so that a web server that hangs never holds up the stream.
pub(super) struct Watch(Arc<Shared>);

struct Shared {
    /// By signal, in the order of the inputs.
    status: Mutex<Vec<Quality>>,
    ended: Mutex<Option<String>>,
    stop: AtomicBool,
}

impl Watch {
    /// Watches these inputs, in this order.
    pub(super) fn start(rest: Rest, inputs: Vec<u16>) -> Result<Self, SourceError> {
        let shared = Arc::new(Shared {
            status: Mutex::new(vec![Quality::GOOD; inputs.len()]),
            ended: Mutex::new(None),
            stop: AtomicBool::new(false),
        });
        let (seen, address) = (shared.clone(), rest.address.clone());
        std::thread::Builder::new()
            .name("gw-lanxi".to_owned())
            .spawn(move || seen.run(&rest, &inputs))
            .map_err(|e| SourceError::Peer { peer: address, message: format!("no thread to watch it: {e}") })?;
        Ok(Self(shared))
    }

    /// What is wrong with each signal now.
    pub(super) fn status(&self) -> Vec<Quality> {
        lock(&self.0.status).clone()
    }

    /// Why the measurement does not go on, if somebody ended it.
    pub(super) fn ended(&self) -> Option<String> {
        lock(&self.0.ended).clone()
    }

    /// Asks no more. The last question may still be under way.
    pub(super) fn end(&self) {
        self.0.stop.store(true, Ordering::Release);
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.end();
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    fn run(&self, rest: &Rest, inputs: &[u16]) {
        let (mut tag, mut failures) = (0, 0);
        while !self.stop.load(Ordering::Acquire) {
            let began = Instant::now();
            match rest.on_change(tag, LONG_POLL) {
                Ok(state) => {
                    (tag, failures) = (last_update_tag(&state), 0);
                    self.take(&state, inputs);
                }
                // Nothing changed, which is how it should be.
                Err(CallError::Away(_)) if began.elapsed() >= LONG_POLL => failures = 0,
                Err(CallError::Stopping) => return,
                Err(e) => {
                    failures += 1;
                    if failures == FAILURES_TOLD {
                        tracing::warn!(instrument = rest.address, "overload and cable faults are not seen: {e}");
                    }
                    std::thread::sleep(SHORTEST_ROUND.saturating_mul(1 << failures.min(4)));
                }
            }
            std::thread::sleep(SHORTEST_ROUND.saturating_sub(began.elapsed()));
        }
    }

    fn take(&self, state: &Value, inputs: &[u16]) {
        let module = state["moduleState"].as_str().unwrap_or_default();
        if !module.is_empty() && module != "RecorderRecording" && !self.stop.load(Ordering::Acquire) {
            let ended = format!("it does not measure any more: its state is {module}; somebody else may use it");
            lock(&self.ended).get_or_insert(ended);
        }
        let channels = &state["recordingStatus"]["channelStatus"];
        let of = |&input: &u16| channel_quality(&channels[usize::from(input) - 1]);
        *lock(&self.status) = inputs.iter().map(of).collect();
    }
}

/// `curr`: it holds now; `prev`: it was, earlier in the measurement.
fn channel_quality(status: &Value) -> Quality {
    let now = |key: &str| status[key] == "curr";
    let mut quality = Quality::GOOD;
    if now("anol") || now("cmol") {
        quality |= Quality::OVERLOAD;
    }
    if now("cf") {
        quality |= Quality::SENSOR_FAULT;
    }
    quality
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_current_faults_count_and_past_ones_do_not() {
        let of = |anol: &str, cmol: &str, cf: &str| {
            channel_quality(&serde_json::json!({ "anol": anol, "cmol": cmol, "cf": cf }))
        };
        assert_eq!(of("none", "prev", "prev"), Quality::GOOD);
        assert_eq!(of("curr", "none", "none"), Quality::OVERLOAD);
        assert_eq!(of("none", "curr", "curr"), Quality::OVERLOAD | Quality::SENSOR_FAULT);
        assert_eq!(channel_quality(&Value::Null), Quality::GOOD);
    }
}
