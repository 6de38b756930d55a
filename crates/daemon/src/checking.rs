//! The check of a bench whose sources run, by their first windows. Recordings are looked at by
//! [`gearwatch_sources::look()`] before anything starts.

use std::sync::Arc;
use std::thread::JoinHandle;

use gearwatch_check::{self as check, Checked, Look, Severity};
use gearwatch_core::bench::Bench;
use gearwatch_core::doubts::Doubts;
use gearwatch_core::window::Window;

/// From so long after the last window that is looked at the judging thread waits for the answer (ns
/// of the windows' own time): it is there by then, and every run of the same windows says so at the
/// same one.
const ANSWER_AFTER_NS: u64 = 20_000_000_000;

/// Looks at the first windows of a running source, asks on a thread of its own, and tells the
/// verdicts from then on.
#[derive(Debug)]
pub struct Examiner {
    bench: Arc<Bench>,
    doubts: Doubts,
    stage: Stage,
}

#[derive(Debug)]
enum Stage {
    Looking(Box<Look>),
    /// Since a window that began at `since` (ns since the epoch).
    Asking {
        answer: JoinHandle<Checked>,
        since: i64,
    },
    Done,
}

impl Examiner {
    /// For a bench whose verdicts carry these doubts.
    pub fn new(bench: Arc<Bench>, doubts: Doubts) -> Self {
        let look = Look::of_service(&bench);
        Self { bench, doubts, stage: Stage::Looking(Box::new(look)) }
    }

    /// Takes in a window; hands the answer over when it is there.
    pub fn push(&mut self, window: &Window) -> Option<Checked> {
        match &mut self.stage {
            Stage::Looking(look) => {
                look.push_window(window, self.bench.tacho.as_ref().map(|tacho| tacho.shaft.as_str()));
                if look.is_full() {
                    let (bench, look) = (self.bench.clone(), std::mem::take(&mut **look));
                    let asking = std::thread::Builder::new().name("gw-check".to_owned());
                    self.stage = match asking.spawn(move || check::check(&bench, &[look], None)) {
                        Ok(answer) => Stage::Asking { answer, since: window.t0 },
                        // Without a thread there is no check, and nothing else is the worse for it.
                        Err(_) => Stage::Done,
                    };
                }
                None
            }
            // Either way: a clock that is set back must not put the answer off.
            Stage::Asking { since, .. } if window.t0.abs_diff(*since) < ANSWER_AFTER_NS => None,
            Stage::Asking { .. } => {
                let Stage::Asking { answer, .. } = std::mem::replace(&mut self.stage, Stage::Done) else { return None };
                // A check that panicked is told by the thread itself; the bench is watched all the
                // same.
                let checked = answer.join().ok()?;
                self.doubts.set(&checked.doubts(""));
                Some(checked)
            }
            Stage::Done => None,
        }
    }
}

/// Tells what a check found in the log of the service.
pub fn tell(bench: &str, checked: &Checked) {
    for finding in &checked.findings {
        match finding.severity {
            Severity::Wrong => tracing::error!(bench, "wrong: {finding}"),
            Severity::Doubtful => tracing::warn!(bench, "doubtful: {finding}"),
            Severity::Note => tracing::info!(bench, "{finding}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use gearwatch_core::bench::Bench;
    use gearwatch_core::block::{OperatingPoint, Quality};
    use gearwatch_core::doubts::Doubts;
    use gearwatch_core::window::{Window, WindowPulses};
    use gearwatch_sim::shipped;

    use super::Examiner;

    const RATE: f64 = 1000.0;
    const CHANNELS: usize = 64;

    fn bench() -> Bench {
        let mut bench = shipped::bench("paper-rig").expect("a shipped bench");
        bench.acquisition.sample_rate_hz = RATE;
        let like = bench.sensors[0].clone();
        bench.sensors = (1..=CHANNELS)
            .map(|i| {
                let mut sensor = like.clone();
                sensor.name = format!("acc_{i}");
                sensor
            })
            .collect();
        bench
    }

    /// Second `number` of a channel.
    fn window(bench: &Bench, channel: usize, number: u64) -> Window {
        let t0 = number as i64 * 1_000_000_000;
        Window {
            channel,
            sensor: bench.sensors[channel].name.as_str().into(),
            unit: bench.sensors[channel].unit.as_str().into(),
            number,
            first_sample_index: number * RATE as u64,
            t0,
            sample_rate_hz: RATE,
            samples: (0..RATE as usize).map(|n| (n as f64 * 0.37).sin()).collect(),
            operating_point: OperatingPoint {
                t: t0,
                motor_speed_hz: 30.0,
                brake_torque_nm: 100.0,
                temperature_c: f64::NAN,
            },
            clock_trouble: false,
            pulses: WindowPulses::default(),
            quality: Quality::GOOD,
        }
    }

    /// The answer is waited for 20 s after the look, whatever the number of channels; 20 windows of
    /// 64 channels are a third of a second.
    #[test]
    fn regress_many_channels_do_not_shorten_the_time_for_the_answer() {
        let bench = Arc::new(bench());
        let mut examiner = Examiner::new(bench.clone(), Doubts::default());
        let mut answered = None;
        for number in 0..60 {
            for channel in 0..CHANNELS {
                if examiner.push(&window(&bench, channel, number)).is_some() {
                    answered.get_or_insert(number);
                }
            }
        }
        // The look holds 30 s, the last of them complete with the window of second 29.
        assert_eq!(answered, Some(49));
    }
}
