//! All that runs: built in order, looked after, ended in order.

use std::net::SocketAddr;
use std::sync::{Arc, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use gearwatch_alarm::MAINTENANCE;
use gearwatch_core::verdict::MachineState;
use gearwatch_history::Store;
use gearwatch_log::{AlarmRecord, Gap};
use gearwatch_runtime::queue::WhenFull;
use gearwatch_runtime::stop::Stop;
use gearwatch_sources::SourceContext;
use tokio::runtime::{Handle, Runtime};
use tokio::sync::watch;

use super::clock::ClockWatch;
use super::context::log_context;
use super::draining::SinkState;
use super::feeding::SourceState;
use super::notify::Notifier;
use super::opening::{self, Opened, RunningSink};
use super::watching::{Ends, RunningBench, start_bench};
use super::{Again, Reload, ReloadError, Service, ServiceError, Summary, edge, viewing};
use crate::engine::Pool;
use crate::event::{BenchState, Event, Fanout};
use crate::selftest::SelfTest;
use crate::sink::{Remembered, SinkContext};
use crate::snapshot::{SinkSnapshot, Snapshot};
use crate::states::{BenchInstrument, Life, SelfTestState};
use crate::web::{self, Hub};
use gearwatch_runtime::clock::now_unix_ns;

/// How often the service looks after its parts.
const TICK: Duration = Duration::from_millis(20);
/// How often load is measured and pages are told.
const LOAD_PERIOD: Duration = Duration::from_secs(1);
/// How often the status and the metrics are renewed: what goes wrong shows within a second even if
/// the first look misses it.
const SNAPSHOT_PERIOD: Duration = Duration::from_millis(200);

/// What takes over.
pub(super) struct Next {
    pub(super) service: Box<Service>,
    pub(super) carried: Carried,
}

/// What a configuration leaves to the next one.
#[derive(Clone, Default)]
pub(super) struct Carried {
    /// Alarms that stand.
    pub(super) alarms: Vec<AlarmRecord>,
    /// When its sources were told to stop (ns since the epoch); none at the first start.
    pub(super) unwatched_since_ns: Option<i64>,
}

/// All that runs.
pub(super) struct Running {
    started: Instant,
    self_test: Option<SelfTest>,
    hub: Arc<Hub>,
    snapshots: watch::Sender<Arc<Snapshot>>,
    clock: ClockWatch,
    notifier: Notifier,
    edge: tokio::task::JoinSet<()>,
    runtime: Handle,
    pool: Pool,
    fanout: Fanout,
    /// The sinks that want to know how the benches are.
    states: Fanout,
    benches: Vec<RunningBench>,
    sinks: Vec<RunningSink>,
    drain_secs: f64,
    /// Address of the page.
    page: Option<SocketAddr>,
    ends_with_sinks: bool,
    /// Ends the sources; a child of the signal that the service was given.
    sources_stop: Stop,
    /// Ends sinks that wait for something.
    sinks_stop: Stop,
}

impl Running {
    /// `carried` is what the configuration before this one left.
    pub(super) fn start(
        service: Service,
        runtime: &Runtime,
        stop: &Stop,
        carried: Carried,
    ) -> Result<Self, ServiceError> {
        let Service { mut config, benches, page, ends_with_sinks } = service;
        let sinks_stop = Stop::default();
        let log_context = Arc::new(log_context(&config, &benches));
        let pool = Pool::start(config.service.worker_count())?;
        let policies: Vec<WhenFull> = config.sinks.iter().map(|entry| config.when_full(entry)).collect();
        let several = benches.len() > 1;
        let logged = config.sinks.iter().find_map(|entry| entry.config.log_folder());
        let past = logged.map(|folder| Store::new(config.folder.join(folder)));
        let remembered = Remembered::default();
        remembered.put(carried.alarms);
        let shared = SinkContext {
            folder: config.folder.clone(),
            stop: sinks_stop.clone(),
            log_context,
            remembered: remembered.clone(),
            ..SinkContext::default()
        };
        let entries = std::mem::take(&mut config.sinks).into_iter().zip(policies).collect();
        let Opened { sinks, fanout, raw, states, spectra } = opening::open(entries, &shared, runtime.handle())?;
        let hub = Arc::new(Hub::default());
        let views = viewing::start(&hub, spectra, several)?;
        let shown = page.is_some().then_some(&hub);
        let sources_stop = stop.child();
        let mut running = Vec::new();
        let mut alarms = remembered.take();
        for (watched, bench) in benches.into_iter().zip(config.benches) {
            let context = SourceContext::new(watched.bench.clone(), config.folder.clone(), sources_stop.clone());
            let sizes = (config.service.packet_queue, config.service.windows_per_worker);
            let label = several.then(|| watched.name.clone());
            let ends = Ends { fanout: &fanout, raw: &raw, page: shown, views: &views, label };
            let of_bench = |alarm: &mut AlarmRecord| alarm.bench == *watched.name;
            let ours = alarms.extract_if(.., of_bench).map(|alarm| alarm.alarm).collect();
            running.push(start_bench(watched, bench, (sizes, ours), context, &pool, ends, runtime.handle())?);
        }
        if let Some(since) = carried.unwatched_since_ns {
            let gap = Gap::reload(since, now_unix_ns());
            for bench in &running {
                fanout.tell(Event::Gap { bench: bench.name.clone(), gap: gap.clone() });
            }
        }
        for AlarmRecord { bench, alarm, .. } in alarms {
            tracing::warn!(bench, alarm = alarm.id, "an alarm stands at a bench that the configuration does not name");
        }
        let self_test = if config.service.self_test { Some(SelfTest::start(&pool)?) } else { None };
        let (snapshots, seen) = watch::channel(Arc::new(Snapshot::default()));
        let ends = web::Ends { hub: hub.clone(), acknowledge: acknowledge(&running, &fanout), past };
        let status_socket = config.service.status_socket.as_ref().map(|path| config.folder.join(path));
        let edge = edge::start(page, ends, status_socket, &seen, runtime.handle());
        let notifier = Notifier::new();
        notifier.ready();
        Ok(Self {
            started: Instant::now(),
            self_test,
            hub,
            snapshots,
            clock: ClockWatch::new(),
            notifier,
            edge,
            runtime: runtime.handle().clone(),
            pool,
            fanout,
            states,
            benches: running,
            sinks,
            drain_secs: config.service.drain_secs,
            page: config.service.page,
            ends_with_sinks,
            sources_stop,
            sinks_stop,
        })
    }

    /// Looks after everything until the end, and ends it in order: sources, lanes, sinks.
    pub(super) fn until_end(mut self, stop: &Stop, reload: &Reload, again: &Again) -> (Summary, Option<Next>) {
        let mut last_load = Instant::now();
        let mut last_snapshot = last_load;
        let mut died = Vec::new();
        let mut building: Option<JoinHandle<Result<Service, ReloadError>>> = None;
        let mut next = None;
        while !stop.is_given() && !self.benches.iter().all(|bench| bench.lane.is_finished()) {
            std::thread::sleep(TICK);
            died.extend(self.benches.iter().filter(|b| b.lane.has_died()).map(|b| format!("bench {:?}", b.name)));
            if self.pool.has_died() {
                died.push("a worker thread".to_owned());
            }
            if !died.is_empty() || self.nobody_listens() {
                break;
            }
            if reload.take() && building.is_none() {
                let (again, held) = (again.clone(), self.page);
                let again = move || {
                    let service = again()?;
                    service.try_out(held)?;
                    Ok(service)
                };
                let builder = std::thread::Builder::new().name("gw-reload".to_owned());
                building = builder.spawn(again).map_err(|e| tracing::error!("no reload: {e}")).ok();
            }
            if building.as_ref().is_some_and(JoinHandle::is_finished) {
                next = building.take().and_then(built);
                if next.is_some() {
                    break;
                }
            }
            let now = Instant::now();
            gearwatch_runtime::fail::point("main");
            let mono_ns = u64::try_from(now.duration_since(self.started).as_nanos()).unwrap_or(u64::MAX);
            if let Some(clock) = self.clock.look(now_unix_ns(), mono_ns) {
                self.fanout.mention(Event::Clock(clock));
            }
            if let Some(self_test) = &mut self.self_test {
                self_test.tick(now);
            }
            let self_test = self.self_test_state(now);
            let benches = &self.benches;
            let stalled = || self.sinks.iter().any(|sink| sink.monitor.is_stalled());
            self.notifier.tick(now, || benches.iter().map(RunningBench::progress).collect(), self_test, stalled);
            if now.duration_since(last_load) >= LOAD_PERIOD {
                last_load = now;
                self.look_at_load(now);
                self.hub.status(&self.snapshots.borrow().to_page());
                self.tell_states(Life::Running);
            }
            if now.duration_since(last_snapshot) >= SNAPSHOT_PERIOD {
                last_snapshot = now;
                self.publish(now);
            }
        }
        let stopped = stop.is_given();
        if next.is_none() {
            self.notifier.stopping();
        }
        let stopped_ns = now_unix_ns();
        self.sources_stop.now();
        for bench in &self.benches {
            bench.packets.close();
        }
        // What runs to its end by itself may take its time; what is told to stop may not.
        let reloading = next.is_some();
        let deadline = |stop: &Stop, since: &mut Option<Instant>| {
            let since = *since.get_or_insert_with(Instant::now);
            (stop.is_given() || reloading) && since.elapsed().as_secs_f64() >= self.drain_secs
        };
        let mut since = None;
        while died.is_empty() && !self.benches.iter().all(|b| b.lane.is_finished()) && !deadline(stop, &mut since) {
            std::thread::sleep(TICK / 4);
        }
        // Instruments are taken back to idle; the next configuration may want the same ones.
        let closed = |bench: &RunningBench| bench.live_threads.iter().all(JoinHandle::is_finished);
        while !self.benches.iter().all(closed) && !deadline(stop, &mut since) {
            std::thread::sleep(TICK / 4);
        }
        self.tell_states(Life::Stopped);
        self.fanout.close();
        while !self.sinks.iter().all(|sink| sink.thread.is_finished()) && !deadline(stop, &mut since) {
            if !stop.is_given() && !reloading {
                since = None;
            }
            std::thread::sleep(TICK / 4);
        }
        self.sinks_stop.now();
        // The next configuration may want the same address.
        self.runtime.block_on(self.edge.shutdown());
        let next = next.map(|service| {
            let carried = Carried { alarms: self.alarms(), unwatched_since_ns: Some(stopped_ns) };
            Next { service, carried }
        });
        (self.summary(stopped, died), next)
    }

    /// Alarms that stand, for the next configuration.
    fn alarms(&self) -> Vec<AlarmRecord> {
        let of_bench = |bench: &RunningBench| {
            let health = bench.health.lock().unwrap_or_else(PoisonError::into_inner);
            health.alarms().map(|alarm| AlarmRecord::new(&bench.name, alarm, None)).collect::<Vec<_>>()
        };
        self.benches.iter().flat_map(of_bench).collect()
    }

    /// Tells the sinks how all benches are.
    fn tell_states(&self, service: Life) {
        let snapshot = self.snapshots.borrow();
        let runs = service == Life::Running;
        for bench in &snapshot.benches {
            let state = BenchState {
                t_ns: now_unix_ns(),
                service,
                ok: snapshot.ok && runs,
                // Nobody watches a bench whose service has stopped.
                machine: if runs { bench.machine } else { MachineState::Unknown },
                instrument: if runs { bench.instrument } else { BenchInstrument::Stopped },
                motor_speed_hz: bench.motor_speed_hz,
                brake_torque_nm: bench.brake_torque_nm,
                windows_judged: bench.windows_judged,
                windows_shed: bench.windows_shed,
                gaps: bench.gaps,
                alarms_active: bench.alarms.iter().filter(|alarm| alarm.active).count() as u64,
                version: env!("CARGO_PKG_VERSION"),
            };
            self.states.mention(Event::State { bench: bench.name.as_str().into(), state: Arc::new(state) });
        }
    }

    fn self_test_state(&self, now: Instant) -> SelfTestState {
        // One that is switched off by the configuration is not wrong.
        self.self_test.as_ref().map_or(SelfTestState::Right, |self_test| self_test.state(now))
    }

    /// Tells observers how all is.
    fn publish(&mut self, now: Instant) {
        let self_test = self.self_test_state(now);
        let benches: Vec<_> = self.benches.iter().map(RunningBench::snapshot).collect();
        let sinks: Vec<_> = self.sinks.iter().map(|sink| sink.monitor.snapshot()).collect();
        let sources_ok = benches.iter().flat_map(|bench| &bench.sources).all(|source| source.state.is_good());
        self.tell_changes(&sinks);
        let sinks_ok = sinks.iter().all(|sink| sink.ok);
        let snapshot = Arc::new(Snapshot {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            uptime_secs: now.duration_since(self.started).as_secs_f64(),
            ok: sources_ok && sinks_ok && self_test.is_good(),
            self_test,
            load: self.pool.load().latest(),
            benches,
            sinks,
        });
        self.snapshots.send_replace(snapshot);
    }

    /// Says on stderr which sinks are no longer all right, and which are again.
    fn tell_changes(&mut self, sinks: &[SinkSnapshot]) {
        for (running, now) in self.sinks.iter_mut().zip(sinks) {
            match (std::mem::replace(&mut running.was_ok, now.ok), now.ok) {
                (true, false) => tracing::error!(sink = now.name, "it is not all right: {}", now.detail),
                (false, true) => tracing::info!(sink = now.name, "it is all right again"),
                _ => {}
            }
        }
    }

    fn nobody_listens(&self) -> bool {
        self.ends_with_sinks && self.sinks.iter().all(|sink| sink.monitor.state() == SinkState::Disabled)
    }

    fn look_at_load(&self, now: Instant) {
        let shed = self.benches.iter().map(|b| b.lane.counters().shed()).sum();
        let measured = self.pool.load().measure(now, shed);
        if measured.warn && self.benches.iter().any(|b| b.lane.counters().shed() > 0) {
            tracing::warn!(
                load_percent = (measured.load * 100.0).round(),
                windows_shed = shed,
                "the workers were overloaded ten times in a row: lengthen the hop, or give more workers"
            );
        }
    }

    fn summary(self, stopped: bool, mut died: Vec<String>) -> Summary {
        let mut summary = Summary { stopped, ..Summary::default() };
        for bench in self.benches {
            for source in &bench.sources {
                if let SourceState::Failed { error } = source.state() {
                    summary.failed.push(format!("source {:?}: {error}", source.name));
                }
            }
            let counters = bench.lane.counters();
            summary.judged += counters.judged();
            summary.windows_lost += counters.shed() + counters.failed();
            if bench.lane.is_finished()
                && let Err(e) = bench.lane.join()
            {
                died.push(format!("bench {:?}: {e}", bench.name));
            }
        }
        for sink in &self.sinks {
            if sink.must_finish && (!sink.thread.is_finished() || sink.monitor.has_end_failed()) {
                summary.unfinished.push(sink.monitor.name.clone());
            }
            let waiting = u64::from(!sink.thread.is_finished());
            let lost = sink.monitor.counters.dropped().max(waiting);
            if lost > 0 && sink.monitor.state() != SinkState::Disabled {
                summary.events_lost.push((sink.monitor.name.clone(), lost));
            }
        }
        summary.died = died;
        summary
    }
}

/// The new service, if it could be built; says how it went.
fn built(building: JoinHandle<Result<Service, ReloadError>>) -> Option<Box<Service>> {
    match building.join().unwrap_or(Err(ReloadError::Panicked)) {
        Ok(service) => {
            tracing::info!("the new configuration is good and takes over");
            Some(Box::new(service))
        }
        Err(e) => {
            tracing::error!("the new configuration is not used, the old one goes on: {e}");
            None
        }
    }
}

/// Acknowledges alarms of all benches, and tells the sinks; an id is `<bench>/<stage>@<channel>`.
fn acknowledge(benches: &[RunningBench], sinks: &Fanout) -> web::Acknowledge {
    let all: Vec<_> = benches.iter().map(|bench| (bench.name.clone(), bench.health.clone())).collect();
    let sinks = sinks.clone();
    Arc::new(move |id, seen| {
        let found = all.iter().find_map(|(bench, health)| {
            let id = id.strip_prefix(&**bench)?.strip_prefix('/')?;
            let mut health = health.lock().unwrap_or_else(PoisonError::into_inner);
            let alarm = if id == MAINTENANCE { health.maintain(&seen)? } else { health.acknowledge(id, &seen)? };
            Some((bench.clone(), alarm))
        });
        let Some((bench, alarm)) = found else { return false };
        tracing::info!(bench = &*bench, alarm = alarm.id, who = seen.who, from = seen.from, "alarm acknowledged");
        sinks.tell(Event::Alarm { bench, alarm, seen: Some(Arc::new(seen)) });
        true
    })
}
