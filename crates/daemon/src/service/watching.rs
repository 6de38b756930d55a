//! A bench that runs: its sources, its lane, its health, and how it is seen from outside.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use gearwatch_alarm::{Alarm, ChannelHealth, Health};
use gearwatch_core::block::Packet;
use gearwatch_core::train::Train;
use gearwatch_core::verdict::MachineState;
use gearwatch_runtime::queue::{self, Inlet, WhenFull};
use gearwatch_sources::SourceContext;
use tokio::runtime::Handle;

use super::feeding::{self, SourceMonitor};
use super::notify::LaneProgress;
use super::{ServiceError, telling, viewing};
use crate::bench::WatchedBench;
use crate::checking::Examiner;
use crate::config::BenchConfig;
use crate::engine::{Lane, LaneHandle, Overloaded, Pool};
use crate::event::Fanout;
use crate::snapshot::{AlarmSnapshot, BenchSnapshot, PlaceSnapshot, worst};
use crate::states::BenchInstrument;
use crate::web::Hub;

/// A bench that runs.
pub(super) struct RunningBench {
    pub(super) name: Arc<str>,
    /// Motor speed / input-shaft speed.
    motor_order: f64,
    pub(super) packets: Inlet<Packet>,
    pub(super) lane: LaneHandle,
    pub(super) sources: Vec<Arc<SourceMonitor>>,
    pub(super) live_threads: Vec<JoinHandle<()>>,
    pub(super) health: Arc<Mutex<Health>>,
    /// A source was missing when the state was published last.
    silent: AtomicBool,
}

/// Where a bench's verdicts go.
pub(super) struct Ends<'a> {
    pub(super) fanout: &'a Fanout,
    pub(super) raw: &'a Fanout,
    /// Where verdicts are kept for a page, where there is one.
    pub(super) page: Option<&'a Arc<Hub>>,
    pub(super) views: &'a viewing::Views,
    pub(super) label: Option<Arc<str>>,
}

/// Starts a bench: its lane, and a thread a source.
pub(super) fn start_bench(
    watched: WatchedBench,
    config: BenchConfig,
    ((packet_queue, windows_per_worker), alarms): ((usize, usize), Vec<Alarm>),
    context: SourceContext,
    pool: &Pool,
    ends: Ends<'_>,
    runtime: &Handle,
) -> Result<RunningBench, ServiceError> {
    let (outlet, packets) = queue::bounded(packet_queue, WhenFull::Block);
    let live = config.sources.iter().any(|source| source.config.is_live());
    let overloaded = if live { Overloaded::Shed } else { Overloaded::Wait };
    let lane = Lane { pipeline: watched.pipeline, overloaded, windows_per_worker };
    let mut health = Health::new(config.alarm).with_ranks(config.pipeline.rank);
    for alarm in alarms {
        tracing::warn!(bench = &*watched.name, alarm = alarm.id, "an alarm of before the start stands");
        let (stages, sensors) = (&watched.bench.stages, &watched.bench.sensors);
        let is_watched =
            stages.iter().any(|s| s.name == alarm.stage) && sensors.iter().any(|s| s.name == alarm.channel);
        health.restore(alarm, is_watched);
    }
    let health = Arc::new(Mutex::new(health));
    let mut teller = telling::Teller::new(
        watched.name.clone(),
        ends.label,
        ends.fanout.clone(),
        health.clone(),
        ends.page.cloned(),
        ends.views.of(watched.name.clone(), Train::new(&watched.bench)),
        lane.pipeline.judging().signatures().clone(),
    )
    .examined_by(
        (!watched.checked).then(|| Examiner::new(watched.bench.clone(), lane.pipeline.judging().doubts().clone())),
    );
    let lane = lane.start(pool, packets.clone(), move |told| teller.tell(told))?;
    let (mut sources, mut live_threads) = (Vec::new(), Vec::new());
    for entry in config.sources {
        let outlet = outlet.branch(if entry.config.is_live() { WhenFull::DropNewest } else { WhenFull::Block });
        let monitor = Arc::new(SourceMonitor::new(&entry, outlet.counters().clone()));
        sources.push(monitor.clone());
        let data_deadline = Duration::from_secs_f64(entry.data_deadline_secs);
        let context = SourceContext { data_deadline, ..context.clone() };
        let (live, raw, runtime) = (entry.config.is_live(), ends.raw.clone(), runtime.clone());
        let thread = std::thread::Builder::new()
            .name("gw-source".to_owned())
            .spawn(move || feeding::feed(&entry, &context, &outlet, &monitor, (&raw, &runtime)))?;
        // A source that is not live may wait in a read for ever; it has nothing to close.
        live_threads.extend(live.then_some(thread));
    }
    let motor_order = Train::new(&watched.bench).motor_order;
    Ok(RunningBench {
        name: watched.name,
        motor_order,
        packets,
        lane,
        sources,
        live_threads,
        health,
        silent: AtomicBool::new(false),
    })
}

impl RunningBench {
    pub(super) fn progress(&self) -> LaneProgress {
        let counters = self.lane.counters();
        let done = counters.judged() + counters.failed() + counters.shed();
        LaneProgress {
            waiting: self.packets.len(),
            packets: counters.packets(),
            under_way: counters.cut().saturating_sub(done),
            judged: counters.judged(),
        }
    }

    pub(super) fn snapshot(&self) -> BenchSnapshot {
        let counters = self.lane.counters();
        let samples = counters.samples();
        let sources: Vec<_> = self.sources.iter().map(|source| source.snapshot()).collect();
        let silent = sources.iter().any(|source| source.state.is_silent());
        let mut health = self.health.lock().unwrap_or_else(PoisonError::into_inner);
        if self.silent.swap(silent, Ordering::Relaxed) && !silent {
            health.begin_anew();
        }
        let channels: Vec<_> =
            health.instruments().map(|(channel, state)| (channel.to_owned(), state.code().to_owned())).collect();
        // No data is no good news.
        let not_ok = health.instruments().map(|(_, state)| state).find(|state| *state != ChannelHealth::Ok);
        let instrument = match not_ok {
            _ if silent => BenchInstrument::Silent,
            Some(state) => BenchInstrument::Channel(state),
            None if channels.is_empty() => BenchInstrument::Channel(ChannelHealth::Earning),
            None => BenchInstrument::OK,
        };
        let machine = if silent { MachineState::Unknown } else { worst(health.newest().map(|v| v.machine)) };
        let known = |value: f64| Some(value).filter(|value| value.is_finite());
        let newest = health.newest().next();
        BenchSnapshot {
            name: self.name.to_string(),
            machine,
            instrument,
            motor_speed_hz: newest.and_then(|v| known(v.input_speed_hz.value * self.motor_order)),
            brake_torque_nm: newest.and_then(|v| known(v.brake_torque_nm)),
            windows_cut: counters.cut(),
            windows_judged: counters.judged(),
            windows_shed: counters.shed(),
            windows_failed: counters.failed(),
            samples_in: samples.samples_in,
            samples_missing: samples.samples_missing,
            gaps: samples.gaps,
            sources,
            channels,
            places: health.newest().map(PlaceSnapshot::of).collect(),
            alarms: health.alarms().map(|alarm| self.alarm(alarm)).collect(),
        }
    }

    fn alarm(&self, alarm: &Alarm) -> AlarmSnapshot {
        AlarmSnapshot {
            id: format!("{}/{}", self.name, alarm.id),
            severity: alarm.severity,
            since_ns: alarm.since_ns,
            active: alarm.active,
            acknowledged: alarm.acknowledged,
            stage: alarm.stage.clone(),
            channel: alarm.channel.clone(),
            evidence: alarm.evidence.as_deref().cloned(),
            seen: alarm.seen.as_deref().cloned(),
        }
    }
}
