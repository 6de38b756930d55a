//! Every task of the service is killed once by a panic: it is back within a second, or the process
//! ends and says so; and who looks from outside never sees a service that is all right and does
//! nothing.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::fixture::{Bench, gearwatch, text};
use crate::server::{Server, free_port};
use crate::service::{configure, ended_within, figure, log_of, signal, status, wait_for};

/// A task that died works again within this: half a second of backoff, a fifth until the next look,
/// and the machine's own time.
const BACK: Duration = Duration::from_millis(1500);

/// A machine that cannot bring a few bytes to its disk within this stands still, and the service
/// with it.
const STANDS_STILL: Duration = Duration::from_secs(1);

/// What the outside sees after a task was killed.
enum Seen {
    /// Ended with this code, after so long.
    Ended(Option<i32>, Duration),
    /// Works again, after so long; said that it was not all right meanwhile.
    Back(Duration, bool),
    /// Neither; what it did before and last.
    Neither(String),
    /// Neither, while the machine stood still for so long.
    Stalled(Duration),
}

/// How long the machine stood still at most: a thread brings a few bytes to the disk again and
/// again.
struct Stalls {
    most: Arc<Mutex<Duration>>,
    begun: Arc<Mutex<Instant>>,
    ends: Arc<AtomicBool>,
}

impl Stalls {
    fn watch(file: PathBuf) -> Self {
        let of = Self {
            most: Arc::new(Mutex::new(Duration::ZERO)),
            begun: Arc::new(Mutex::new(Instant::now())),
            ends: Arc::new(AtomicBool::new(false)),
        };
        let (most, begun, ends) = (of.most.clone(), of.begun.clone(), of.ends.clone());
        std::thread::spawn(move || {
            while !ends.load(Ordering::Relaxed) {
                let begin = Instant::now();
                *begun.lock().unwrap() = begin;
                let written = File::create(&file).and_then(|mut file| file.write_all(b"beat").and(file.sync_all()));
                // The folder of a test that has ended is gone.
                if written.is_err() {
                    break;
                }
                std::thread::sleep(Duration::from_millis(20));
                let mut most = most.lock().unwrap();
                *most = most.max(begin.elapsed());
            }
        });
        of
    }

    /// Until now; what still lasts counts.
    fn most(&self) -> Duration {
        let lasts = self.begun.lock().unwrap().elapsed();
        self.most.lock().unwrap().max(lasts)
    }
}

impl Drop for Stalls {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
    }
}

/// What must go on: windows judged, durable records, letters that a broker confirmed, lines on
/// stdout and spectra at the page.
fn progress(bench: &Bench, counted: &[Arc<AtomicU64>]) -> Option<Vec<u64>> {
    let snapshot = status(bench)?;
    let mut all = vec![snapshot.benches.first()?.windows_judged];
    all.push(log_of(&snapshot).and_then(|log| figure(log, "durable_seq")).unwrap_or(0));
    let broker = snapshot.sinks.iter().find(|sink| sink.name == "mqtt");
    all.extend(broker.map(|broker| figure(broker, "confirmed").unwrap_or(0)));
    all.extend(counted.iter().map(|count| count.load(Ordering::Relaxed)));
    snapshot.ok.then_some(all)
}

/// Counts the lines that begin like this, in a thread of its own.
fn count_lines(from: impl Read + Send + 'static, beginning: &'static str) -> Arc<AtomicU64> {
    let count = Arc::new(AtomicU64::new(0));
    let counted = count.clone();
    std::thread::spawn(move || {
        let lines = BufReader::new(from).lines().map_while(Result::ok);
        lines.filter(|line| line.starts_with(beginning)).for_each(|_| {
            counted.fetch_add(1, Ordering::Relaxed);
        });
    });
    count
}

/// `None`, with a message, where the machine has not what it takes.
fn kill_task(point: &str) -> Option<Seen> {
    let bench = Bench::new();
    let broker = if point == "sink-broker" { Some(Server::mosquitto(&bench.path("mosquitto"))?) } else { None };
    let mut sinks = "[[sink]]\nkind = \"stdout\"\n".to_owned();
    if let Some(broker) = &broker {
        sinks += &format!("[[sink]]\nkind = \"mqtt\"\nport = {}\nspool = \"spool\"\n", broker.port);
    }
    let config = configure(&bench, &bench.path("log"), "20.0", &sinks);
    let address = format!("127.0.0.1:{}", free_port());
    let service =
        std::fs::read_to_string(&config).unwrap().replace("workers = 2", &format!("workers = 2, page = \"{address}\""));
    std::fs::write(&config, service).unwrap();
    let trigger = bench.path("trigger");
    let mut child = gearwatch(&["run", "--config", text(&config)])
        .env("GEARWATCH_FAIL", format!("{point}={}", text(&trigger)))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut counted = vec![count_lines(child.stdout.take().unwrap(), "{")];
    if point == "view" {
        let viewer = wait_for(Duration::from_secs(20), || TcpStream::connect(&address).ok()).expect("the page answers");
        write!(&viewer, "GET /api/events HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
        counted.push(count_lines(viewer, "event: spectrum"));
    }
    let running = || progress(&bench, &counted).filter(|all| all.iter().all(|&count| count > 3));
    wait_for(Duration::from_secs(30), running).expect("the service runs");
    std::fs::write(&trigger, "").unwrap();
    let begin = Instant::now();
    wait_for(Duration::from_secs(10), || (!trigger.exists()).then_some(())).expect("the point is passed");
    let killed = Instant::now();
    assert!(killed - begin < Duration::from_secs(5));
    let before = progress(&bench, &counted);
    let mut said_so = before.is_none();
    let mut last = None;
    let stalls = Stalls::watch(bench.path("beat"));
    let seen = wait_for(Duration::from_secs(5), || {
        if let Some(status) = child.try_wait().unwrap() {
            return Some(Seen::Ended(status.code(), killed.elapsed()));
        }
        let now = progress(&bench, &counted);
        said_so |= now.is_none();
        last.clone_from(&now);
        let before = before.clone().unwrap_or_default();
        let later = now?.iter().zip(before.iter().chain(std::iter::repeat(&0))).all(|(now, before)| now > before);
        // The page and the socket are asked for by the status itself; the rest must have gone on.
        (later && killed.elapsed() > Duration::from_millis(250)).then(|| Seen::Back(killed.elapsed(), said_so))
    });
    if child.try_wait().unwrap().is_none() {
        signal(&child, "TERM");
        ended_within(&mut child, Duration::from_secs(5));
    }
    Some(seen.unwrap_or_else(|| match stalls.most() {
        stalled if stalled > STANDS_STILL => Seen::Stalled(stalled),
        _ => Seen::Neither(format!("{before:?} when killed, {last:?} at the end")),
    }))
}

#[test]
fn conform_every_task_that_dies_is_back_or_noticed() {
    if !cfg!(debug_assertions) {
        eprintln!("skipped: only builds with debug assertions have points of failure");
        return;
    }
    let points = [
        "source",
        "cut",
        "worker",
        "worker-thread",
        "rank",
        "sink-stdout",
        "sink-mcap_log",
        "sink-broker",
        "view",
        "log",
        "page",
        "status",
        "main",
    ];
    for point in points {
        let Some(mut seen) = kill_task(point) else { continue };
        // The fastest of three tries: what a busy machine adds is not the service's.
        for _ in 0..2 {
            let slow = matches!(&seen, Seen::Back(after, _) if *after >= BACK);
            if !slow && !matches!(&seen, Seen::Stalled(_)) {
                break;
            }
            seen = kill_task(point).unwrap_or(seen);
        }
        match seen {
            Seen::Ended(code, after) => {
                println!("{point}: exit {code:?} after {after:.2?}");
                assert_ne!(code, Some(0), "{point}");
                assert!(after < Duration::from_secs(2), "{point}: seen after {after:?}");
            }
            Seen::Back(after, said_so) => {
                println!("{point}: back after {after:.2?}, not ok meanwhile: {said_so}");
                assert!(after < BACK, "{point}: back after {after:?}");
            }
            Seen::Stalled(stalled) => panic!("{point}: the machine stood still for {stalled:?}"),
            Seen::Neither(counts) => panic!("{point}: neither back nor ended: {counts}"),
        }
    }
}
