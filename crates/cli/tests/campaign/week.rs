//! A week in hours: the test signal at many times its speed, with rotation, reloads of right and
//! wrong configurations, clients, brokers that hang up and are killed, a disk that hangs, is slow,
//! is full and fails, and somebody who sets the clock. What must hold is asked all the time, not
//! only in the end.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use gearwatch_daemon::snapshot::{SinkSnapshot, Snapshot};

use crate::fixture::{Bench, gearwatch, text};
use crate::server::Server;
use crate::service::{Moments, configure, ended_within, figure, log_of, signal, status, wait_for};
use crate::soak::{ask_page, flaky_broker};

mod account;

use account::Account;

/// The test signal runs so many times as fast as real time: a week takes 70 minutes.
/// `GEARWATCH_TIMES` makes it another.
const TIMES: u64 = 144;
/// Where `ok` is said, what was judged so long ago is durable: the two seconds of the promise, and
/// what an answer takes on a busy machine.
const DURABLE_WITHIN: Duration = Duration::from_secs(4);
/// A result of the log is a verdict or one of the few other records; a status counts both while
/// they are under way. At so many times real time.
const UNDER_WAY: u64 = 300;
/// When a trouble is over, all is right again within this time.
const RIGHT_AGAIN: Duration = Duration::from_secs(30);

/// The service, which does not outlive a test that fails.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The library that makes trouble; `None` where there is no C compiler.
fn library(bench: &Bench) -> Option<PathBuf> {
    let (source, library) = (bench.write("trouble.c", include_str!("week/trouble.c")), bench.path("trouble.so"));
    let built =
        Command::new("cc").args(["-O1", "-shared", "-fPIC", "-o", text(&library), text(&source), "-ldl"]).status();
    built.is_ok_and(|status| status.success()).then_some(library)
}

/// What was seen from outside.
#[derive(Default, Debug)]
struct Seen {
    looks: u64,
    looks_ok: u64,
    /// Looks by trouble at which the service said that something is wrong.
    told: BTreeMap<&'static str, u64>,
    reloads: u64,
    refused: u64,
    clients: u64,
    brokers_killed: u64,
    most_waiting_secs: f64,
}

/// Remembers what was judged and durable when, and checks each answer by it.
#[derive(Default)]
struct Watcher {
    /// When, windows judged, and highest number that was durable.
    past: Vec<(Instant, u64, u64)>,
    /// Number before the first result of this start, at least.
    base: Option<u64>,
    pub uptime_secs: f64,
    /// Results that may be under way.
    under_way: u64,
}

impl Watcher {
    fn look(&mut self, snapshot: &Snapshot, trouble: &'static str, seen: &mut Seen) {
        let Some(log) = log_of(snapshot) else { return };
        let (now, durable) = (Instant::now(), figure(log, "durable_seq").unwrap_or(0));
        let judged: u64 = snapshot.benches.iter().map(|bench| bench.windows_judged).sum();
        if snapshot.uptime_secs < self.uptime_secs {
            // A reload counts from zero, and its log goes on behind what may have been lost.
            self.past.clear();
            self.base = None;
        }
        self.uptime_secs = snapshot.uptime_secs;
        let before = self.past.last().map_or(0, |past| past.2);
        assert!(durable >= before, "{trouble}: {durable} results are durable, and {before} were");
        seen.looks += 1;
        seen.looks_ok += u64::from(log.ok);
        *seen.told.entry(trouble).or_default() += u64::from(!log.ok);
        let waiting = log.figures.iter().find(|(name, _)| name == "waiting_secs").map_or(0.0, |(_, value)| *value);
        seen.most_waiting_secs = seen.most_waiting_secs.max(waiting);
        assert!(!log.ok || waiting <= 2.0, "{trouble}: ok, and something waits for {waiting} s: {log:?}");
        if durable > 0 && self.base.is_none() {
            self.base = Some(durable.saturating_sub(judged + self.under_way));
        }
        self.past.push((now, judged, durable));
        let old = self.past.iter().rposition(|(at, ..)| now.duration_since(*at) > DURABLE_WITHIN);
        if let Some(old) = old {
            let (_, judged_then, durable_then) = self.past[old];
            // Much was judged before that moment and since, and nothing of it has become durable.
            assert!(
                !log.ok || durable > durable_then || judged == judged_then,
                "{trouble}: ok, and for {DURABLE_WITHIN:?} nothing has become durable: {log:?}"
            );
            // All that was judged by then is durable now, or was shed and counted.
            let unlogged = figure(log, "unlogged_records").unwrap_or(0);
            assert!(
                !log.ok || self.base.is_none_or(|base| durable + unlogged >= base + judged_then),
                "{trouble}: ok, {judged_then} windows were judged {DURABLE_WITHIN:?} ago, and from {:?} to {durable} is durable: {log:?}",
                self.base
            );
            self.past.drain(..old);
        }
    }
}

/// The service, what surrounds it, and what was seen of both.
struct Week {
    bench: Bench,
    /// Where the log is, and where the library looks for troubles.
    log: PathBuf,
    trouble: PathBuf,
    /// The service's configuration, and its text where it is right.
    config: PathBuf,
    right: String,
    page: String,
    broker: Option<Server>,
    service: Running,
    watcher: Watcher,
    seen: Seen,
}

impl Week {
    /// Starts the service at so many times real time; its messages go to the file `talk`.
    fn start(bench: Bench, library: &Path, times: u64, talk: &Path) -> Self {
        let (log, trouble) = (bench.path("log"), bench.path("trouble"));
        std::fs::create_dir(&trouble).unwrap();
        let page =
            format!("127.0.0.1:{}", std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port());
        let flaky = flaky_broker();
        let broker = Server::mosquitto(&bench.path("mosquitto"));
        let further = format!(
            "rotate_bytes = 1048576\n[[sink]]\nkind = \"nats\"\nservers = [\"nats://127.0.0.1:{flaky}\"]\nspool = \"spool\"\nspool_bytes = 4194304\n\
             [[sink]]\nkind = \"mqtt\"\nport = {}\nspool = \"spool-mqtt\"\nspool_bytes = 4194304\n",
            broker.as_ref().map_or(flaky, |broker| broker.port)
        );
        let config = configure(&bench, &log, &format!("{times}.0"), &further);
        let service = std::fs::read_to_string(&config).unwrap();
        let right = service.replace("workers = 2", &format!("workers = 2, page = \"{page}\""));
        std::fs::write(&config, &right).unwrap();
        let child = gearwatch(&["run", "--config", text(&config)])
            .env("LD_PRELOAD", library)
            .env("TROUBLE", &trouble)
            .stdout(Stdio::null())
            .stderr(std::fs::File::create(talk).unwrap())
            .spawn()
            .unwrap();
        let service = Running(child);
        wait_for(Duration::from_secs(20), || status(&bench)).expect("the service runs");
        let watcher = Watcher { under_way: UNDER_WAY * times.div_ceil(TIMES), ..Watcher::default() };
        Self { bench, log, trouble, config, right, page, broker, service, watcher, seen: Seen::default() }
    }

    fn status(&self) -> Option<Snapshot> {
        status(&self.bench)
    }

    /// Reads the status, checks it, and waits a moment.
    fn look(&mut self, kind: &'static str) {
        if let Some(snapshot) = self.status() {
            self.watcher.look(&snapshot, kind, &mut self.seen);
        }
        std::thread::sleep(Duration::from_millis(50));
    }

    fn look_until(&mut self, until: Instant, kind: &'static str) {
        while Instant::now() < until {
            self.look(kind);
        }
    }

    /// Goes through a trouble that has begun.
    fn endure(&mut self, kind: &'static str, until: Instant) {
        match kind {
            "reload" => self.reload(),
            "wrong" => self.refuse(kind, until),
            "broker" => self.lose_the_broker(kind, until),
            "clients" => {
                while Instant::now() < until {
                    self.seen.clients += 2;
                    ask_page(&self.page, "/metrics", Duration::from_millis(300));
                    ask_page(&self.page, "/api/events", Duration::from_millis(300));
                    self.look(kind);
                }
            }
            _ => self.look_until(until, kind),
        }
    }

    fn reload(&mut self) {
        let asked = Instant::now();
        signal(&self.service.0, "HUP");
        self.seen.reloads += 1;
        let anew = || self.status().filter(|now| now.uptime_secs < asked.elapsed().as_secs_f64());
        wait_for(RIGHT_AGAIN, anew).expect("the service answers after a reload");
    }

    fn refuse(&mut self, kind: &'static str, until: Instant) {
        let uptime_secs = self.status().map_or(0.0, |now| now.uptime_secs);
        std::fs::write(&self.config, self.right.replace("rotate_bytes = 1048576", "rotate_bytes = 1")).unwrap();
        signal(&self.service.0, "HUP");
        self.look_until(until, kind);
        std::fs::write(&self.config, &self.right).unwrap();
        let goes_on = self.status().is_some_and(|now| now.uptime_secs > uptime_secs);
        assert!(goes_on, "a wrong configuration changed the service");
        self.seen.refused += 1;
    }

    fn lose_the_broker(&mut self, kind: &'static str, until: Instant) {
        if let Some(broker) = &mut self.broker {
            broker.kill();
            self.seen.brokers_killed += 1;
        }
        self.look_until(until, kind);
        if let Some(broker) = &mut self.broker {
            broker.restart();
            let confirmed =
                || status(&self.bench).as_ref().and_then(mqtt_of).and_then(|sink| figure(sink, "confirmed"));
            let before = confirmed();
            let more = wait_for(RIGHT_AGAIN, || confirmed().filter(|now| Some(*now) > before));
            assert!(more.is_some(), "the broker is back, and gets nothing");
        }
    }

    /// Ends the troubles of the disk; the service must be right again soon.
    fn mend(&self, kind: &str) {
        for name in ["hang", "slow", "full", "fail"] {
            // The one that is there.
            let _ = std::fs::remove_file(self.trouble.join(name));
        }
        let right = || self.status().filter(|now| log_of(now).is_some_and(|log| log.ok));
        assert!(
            wait_for(RIGHT_AGAIN, right).is_some(),
            "{kind}: not right again: {:?}",
            self.status().as_ref().and_then(log_of)
        );
    }
}

#[test]
#[ignore = "an hour and more; `just campaign-week`"]
fn conform_a_week_of_trouble_is_told_and_survived() {
    let number = |key: &str| std::env::var(key).ok().and_then(|text| text.parse::<u64>().ok());
    let times = number("GEARWATCH_TIMES").unwrap_or(TIMES);
    let secs = number("GEARWATCH_SOAK_SECS").unwrap_or(7 * 86_400 / times);
    let bench = Bench::new();
    let Some(library) = library(&bench) else { return eprintln!("skipped: there is no C compiler (cc)") };
    let talk = bench.path("talk");
    let mut week = Week::start(bench, &library, times, &talk);
    let mut moments = Moments::new(7);
    let begin = Instant::now();
    let troubles = ["hang", "slow", "full", "fail", "clock", "reload", "clients", "taken", "wrong", "broker"];
    let mut account = Account::at(times.div_ceil(TIMES));
    for round in 0.. {
        if begin.elapsed().as_secs() >= secs {
            break;
        }
        let kind = troubles[round % troubles.len()];
        let until = Instant::now() + moments.between(Duration::from_secs(3), Duration::from_secs(7));
        begin_trouble(kind, &week.trouble, &week.log, &moments.between(Duration::ZERO, Duration::from_secs(4)));
        week.endure(kind, until);
        account.go_on(&week.log, false);
        week.mend(kind);
    }
    signal(&week.service.0, "TERM");
    let ended = ended_within(&mut week.service.0, Duration::from_secs(10)).and_then(|status| status.code());
    let said = std::fs::read_to_string(&talk).unwrap();
    let seen = &week.seen;
    assert_eq!(ended, Some(0), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    assert!(seen.refused == 0 || said.contains("rotate_bytes"), "a wrong configuration was not told: {said}");
    account.go_on(&week.log, true);
    println!(
        "{secs} s at x{times} ({:.1} days): {} verdicts in {} files, {} windows missing, all of them explained; gaps {:?}, {} clock records; {seen:?}",
        (secs * times) as f64 / 86_400.0,
        account.verdicts,
        account.files(),
        account.windows_missing,
        account.counted,
        account.clocks,
    );
    for kind in ["hang", "full", "fail", "taken"] {
        assert!(secs < 90 || seen.told.get(kind).is_some_and(|&told| told > 0), "{kind} was never told: {seen:?}");
    }
    assert!(secs < 90 || account.clocks > 0, "no step of the clock was seen");
}

fn mqtt_of(snapshot: &Snapshot) -> Option<&SinkSnapshot> {
    snapshot.sinks.iter().find(|sink| sink.name == "mqtt")
}

fn begin_trouble(kind: &str, trouble: &Path, folder: &Path, by: &Duration) {
    match kind {
        "hang" | "slow" | "full" | "fail" => std::fs::write(trouble.join(kind), "").unwrap(),
        "clock" => {
            let offset = [3600, -86_400, 401 * 86_400, 0][by.as_secs() as usize % 4];
            std::fs::write(trouble.join("clock"), format!("{offset}\n")).unwrap();
        }
        "taken" => take_away(folder),
        _ => {}
    }
}

/// Somebody removes the file that is written. Between two files there is none for a moment: one
/// that was closed already is put back, since nobody watches over what is finished, and the log
/// does not write to it again.
fn take_away(folder: &Path) {
    let listed = std::fs::read_dir(folder).unwrap().flatten().map(|entry| entry.path());
    let newest = listed.filter(|path| path.extension().is_some_and(|end| end == "mcap")).max();
    let Some(newest) = newest else { return };
    let aside = newest.with_extension("aside");
    // Rotation may have renamed or removed it meanwhile.
    if std::fs::hard_link(&newest, &aside).is_err() {
        return;
    }
    std::fs::remove_file(&newest).unwrap();
    std::thread::sleep(Duration::from_secs(1));
    let closed = mcap::Summary::read(&std::fs::read(&aside).unwrap()).is_ok_and(|summary| summary.is_some());
    if closed {
        std::fs::rename(&aside, &newest).unwrap();
    } else {
        std::fs::remove_file(&aside).unwrap();
    }
}
