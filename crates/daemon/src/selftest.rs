//! The self test in service: a known signal goes through the same workers as the benches' windows,
//! and must get its known ranks.
//!
//! A worker that computes nonsense, hangs, or has a broken transform is seen within 25 seconds,
//! although all benches may look normal.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use gearwatch_core::block::Packet;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::verdict::Rank;
use gearwatch_runtime::queue::{self, Outlet, WhenFull};
use gearwatch_runtime::stop::Stop;
use gearwatch_sources::{Feed, Pull, SourceContext};

use crate::bench::learn;
use crate::config::Config;
use crate::engine::{Lane, LaneHandle, Overloaded, Pool, Told};
use crate::states::SelfTestState;

/// One known window so often.
const PERIOD: Duration = Duration::from_secs(10);
/// Without a right answer for so long the self test has failed.
const LATE: Duration = Duration::from_secs(25);
/// A tenth of a second of one sensor and its tacho, ten times.
const PACKETS_PER_WINDOW: usize = 20;

/// One stage that meshes at 100 Hz, sampled at 2048 Hz: a window costs a fraction of a millisecond.
const BENCH: &str = r#"
format = "gearwatch-bench/1"
name = "self test"
motor = { speed_hz = 5.0 }
shaft = [{ name = "input" }, { name = "output" }]
stage = [{ name = "stage1", pinion = { teeth = 20 }, wheel = { teeth = 40 } }]
brake = { torque_nm = 10.0 }
sensor = [{ name = "known", shaft = "input" }]
tacho = { shaft = "input" }
acquisition = { sample_rate_hz = 2048.0 }
"#;

/// The normal state, and deviations in the middle of their ranks: the noise shifts none of them.
const SERVICE: &str = r#"
format = "gearwatch-service/1"
[[bench]]
learn_from = { kind = "test_signal", speed = "max", duration_secs = 12.0, noise = 0.005 }
[[bench.source]]
kind = "test_signal"
speed = "max"
noise = 0.005
seed = 2
fault = { after_secs = 0.0, stage = "stage1", percent = [20.0, 0.0, -5.5, 8.5, 2.5] }
"#;

/// Ranks of those deviations.
const RANKS: [Rank; 5] = [Rank::V, Rank::Zero, Rank::II, Rank::III, Rank::I];

/// Why there is no self test.
#[derive(Debug, thiserror::Error)]
#[error("the self test cannot be started: {0}")]
pub struct SelfTestError(String);

#[derive(Debug)]
struct Answers {
    last_right: Option<Instant>,
    last_was_right: bool,
}

/// The known signal on its way.
pub struct SelfTest {
    outlet: Outlet<Packet>,
    lane: LaneHandle,
    pull: Pull,
    started: Instant,
    asked: Option<Instant>,
    answers: Arc<Mutex<Answers>>,
}

impl SelfTest {
    /// Learns what is normal and starts a lane on the pool.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(pool: &Pool) -> Result<Self, SelfTestError> {
        let fail = |e: &dyn std::fmt::Display| SelfTestError(e.to_string());
        let name = PathBuf::from("self test");
        let config = Config::parse(SERVICE, "self test", &name).map_err(|e| fail(&e))?;
        let bench = gearwatch_io::bench_file::parse(BENCH, &name).map_err(|e| fail(&e))?;
        let context = SourceContext::new(Arc::new(bench), PathBuf::new(), Stop::default());
        let mut settings = PipelineConfig::default();
        settings.window.hop_s = settings.window.length_s;
        let plan = |baseline| Pipeline::new(&context.bench, &settings, baseline).map(Arc::new).map_err(|e| fail(&e));
        let [bench] = &config.benches[..] else { return Err(fail(&"one bench")) };
        let (Some(normal), [source]) = (&bench.learn_from, &bench.sources[..]) else { return Err(fail(&"one source")) };
        let baseline = learn(normal, &context, &plan(None)?, settings.window.length_s, 1).map_err(|e| fail(&e))?;
        let Feed::Pull(pull) = source.config.open(&context).map_err(|e| fail(&e))? else {
            return Err(fail(&"a source that is pulled"));
        };
        let answers = Arc::new(Mutex::new(Answers { last_right: None, last_was_right: false }));
        let (outlet, packets) = queue::bounded(4 * PACKETS_PER_WINDOW, WhenFull::DropNewest);
        let lane = Lane { pipeline: plan(Some(baseline))?, overloaded: Overloaded::Wait, windows_per_worker: 1 };
        let told = answers.clone();
        let lane = lane.start(pool, packets, move |what| judge(what, &told)).map_err(|e| fail(&e))?;
        Ok(Self { outlet, lane, pull, started: Instant::now(), asked: None, answers })
    }

    /// Sends the next known window when it is time.
    pub fn tick(&mut self, now: Instant) {
        if self.asked.is_some_and(|asked| now.duration_since(asked) < PERIOD) {
            return;
        }
        // The first time two: the first window waits for the tacho of the second.
        let windows = if self.asked.is_none() { 2 } else { 1 };
        self.asked = Some(now);
        for _ in 0..windows * PACKETS_PER_WINDOW {
            if let Ok(Some(packet)) = (self.pull)() {
                let _ = self.outlet.put_blocking(packet);
            }
        }
    }

    /// Its answer so far.
    pub fn state(&self, now: Instant) -> SelfTestState {
        let answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        let since = answers.last_right.unwrap_or(self.started);
        match answers.last_right {
            _ if self.lane.has_died() => SelfTestState::Wrong,
            _ if now.saturating_duration_since(since) > LATE => SelfTestState::Late,
            Some(_) if answers.last_was_right => SelfTestState::Right,
            Some(_) => SelfTestState::Wrong,
            None => SelfTestState::NotYet,
        }
    }
}

fn judge(what: Told<'_>, answers: &Mutex<Answers>) {
    let right = match what {
        Told::Verdict(verdict) => verdict.harmonics.iter().map(|h| h.rank).eq(RANKS),
        Told::Failed { .. } => false,
        Told::Window(..) | Told::Gap(_) | Told::Shed(_) => return,
    };
    let mut answers = answers.lock().unwrap_or_else(PoisonError::into_inner);
    answers.last_was_right = right;
    if right {
        answers.last_right = Some(Instant::now());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known signal gets its known ranks, and without answers it is late.
    #[test]
    fn conform_the_known_signal_gets_its_known_ranks() {
        let pool = Pool::start(2).unwrap();
        let mut test = SelfTest::start(&pool).unwrap();
        let begin = Instant::now();
        assert_eq!(test.state(begin), SelfTestState::NotYet);
        test.tick(begin);
        while test.state(Instant::now()) == SelfTestState::NotYet && begin.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(2));
        }
        assert_eq!(test.state(Instant::now()), SelfTestState::Right);
        assert_eq!(test.state(Instant::now() + LATE + Duration::from_secs(1)), SelfTestState::Late);
    }
}
