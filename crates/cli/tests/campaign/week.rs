//! A week in hours: the test signal at many times its speed, with rotation, reloads of right and wrong configurations, clients, brokers that hang up and
//! are killed, a disk that hangs, is slow, is full and fails, and somebody who sets the clock. What must hold is asked all the time, not only in the end.

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

/// The test signal runs so many times as fast as real time: a week takes 70 minutes. `GEARWATCH_TIMES` makes it another.
const TIMES: u64 = 144;
/// Where `ok` is said, what was judged so long ago is durable: the two seconds of the promise, and what an answer takes on a busy machine.
const DURABLE_WITHIN: Duration = Duration::from_secs(4);
/// A result of the log is a verdict or one of the few other records; a status counts both while they are under way. At so many times real time.
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

#[test]
#[ignore = "an hour and more; `just campaign-week`"]
fn conform_a_week_of_trouble_is_told_and_survived() {
    let number = |key: &str| std::env::var(key).ok().and_then(|text| text.parse::<u64>().ok());
    let times = number("GEARWATCH_TIMES").unwrap_or(TIMES);
    let secs = number("GEARWATCH_SOAK_SECS").unwrap_or(7 * 86_400 / times);
    let bench = Bench::new();
    let Some(library) = library(&bench) else { return eprintln!("skipped: there is no C compiler (cc)") };
    let (folder, trouble) = (bench.path("log"), bench.path("trouble"));
    std::fs::create_dir(&trouble).unwrap();
    let page =
        format!("127.0.0.1:{}", std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port());
    let flaky = flaky_broker();
    let mut broker = Server::mosquitto(&bench.path("mosquitto"));
    let further = format!(
        "rotate_bytes = 1048576\n[[sink]]\nkind = \"nats\"\nservers = [\"nats://127.0.0.1:{flaky}\"]\nspool = \"spool\"\nspool_bytes = 4194304\n\
         [[sink]]\nkind = \"mqtt\"\nport = {}\nspool = \"spool-mqtt\"\nspool_bytes = 4194304\n",
        broker.as_ref().map_or(flaky, |broker| broker.port)
    );
    let config = configure(&bench, &folder, &format!("{times}.0"), &further);
    let service = std::fs::read_to_string(&config).unwrap();
    let right = service.replace("workers = 2", &format!("workers = 2, page = \"{page}\""));
    std::fs::write(&config, &right).unwrap();
    let talk = bench.path("talk");
    let child = gearwatch(&["run", "--config", text(&config)])
        .env("LD_PRELOAD", &library)
        .env("TROUBLE", &trouble)
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(&talk).unwrap())
        .spawn()
        .unwrap();
    let mut running = Running(child);
    let child = &mut running.0;
    wait_for(Duration::from_secs(20), || status(&bench)).expect("the service runs");
    let (mut seen, mut watcher, mut moments) = (Seen::default(), Watcher::default(), Moments::new(7));
    watcher.under_way = UNDER_WAY * times.div_ceil(TIMES);
    let begin = Instant::now();
    let troubles = ["hang", "slow", "full", "fail", "clock", "reload", "clients", "taken", "wrong", "broker"];
    let mut account = Account::at(times.div_ceil(TIMES));
    for round in 0.. {
        if begin.elapsed().as_secs() >= secs {
            break;
        }
        let kind = troubles[round % troubles.len()];
        let until = Instant::now() + moments.between(Duration::from_secs(3), Duration::from_secs(7));
        let mut ask = |seen: &mut Seen, kind: &'static str| {
            if let Some(snapshot) = status(&bench) {
                watcher.look(&snapshot, kind, seen);
            }
            std::thread::sleep(Duration::from_millis(50));
        };
        begin_trouble(kind, &trouble, &folder, &moments.between(Duration::ZERO, Duration::from_secs(4)));
        match kind {
            "reload" => {
                let asked = Instant::now();
                signal(child, "HUP");
                seen.reloads += 1;
                let anew = || status(&bench).filter(|now| now.uptime_secs < asked.elapsed().as_secs_f64());
                wait_for(RIGHT_AGAIN, anew).expect("the service answers after a reload");
            }
            "wrong" => {
                let uptime_secs = status(&bench).map_or(0.0, |now| now.uptime_secs);
                std::fs::write(&config, right.replace("rotate_bytes = 1048576", "rotate_bytes = 1")).unwrap();
                signal(child, "HUP");
                while Instant::now() < until {
                    ask(&mut seen, kind);
                }
                std::fs::write(&config, &right).unwrap();
                let goes_on = status(&bench).is_some_and(|now| now.uptime_secs > uptime_secs);
                assert!(goes_on, "a wrong configuration changed the service");
                seen.refused += 1;
            }
            "broker" => {
                if let Some(broker) = &mut broker {
                    broker.kill();
                    seen.brokers_killed += 1;
                }
                while Instant::now() < until {
                    ask(&mut seen, kind);
                }
                if let Some(broker) = &mut broker {
                    broker.restart();
                    let confirmed =
                        || status(&bench).as_ref().and_then(mqtt_of).and_then(|sink| figure(sink, "confirmed"));
                    let before = confirmed();
                    let more = wait_for(RIGHT_AGAIN, || confirmed().filter(|now| Some(*now) > before));
                    assert!(more.is_some(), "the broker is back, and gets nothing");
                }
            }
            "clients" => {
                while Instant::now() < until {
                    seen.clients += 2;
                    ask_page(&page, "/metrics", Duration::from_millis(300));
                    ask_page(&page, "/api/events", Duration::from_millis(300));
                    ask(&mut seen, kind);
                }
            }
            _ => {
                while Instant::now() < until {
                    ask(&mut seen, kind);
                }
            }
        }
        account.go_on(&folder, false);
        for name in ["hang", "slow", "full", "fail"] {
            // The one that is there.
            let _ = std::fs::remove_file(trouble.join(name));
        }
        let right = || status(&bench).filter(|now| log_of(now).is_some_and(|log| log.ok));
        assert!(
            wait_for(RIGHT_AGAIN, right).is_some(),
            "{kind}: not right again: {:?}",
            status(&bench).as_ref().and_then(log_of)
        );
    }
    signal(child, "TERM");
    let ended = ended_within(child, Duration::from_secs(10)).and_then(|status| status.code());
    let said = std::fs::read_to_string(&talk).unwrap();
    assert_eq!(ended, Some(0), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    assert!(seen.refused == 0 || said.contains("rotate_bytes"), "a wrong configuration was not told: {said}");
    account.go_on(&folder, true);
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

/// Somebody removes the file that is written. Between two files there is none for a moment: one that was closed already is put back, since nobody watches over
/// what is finished, and the log does not write to it again.
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
