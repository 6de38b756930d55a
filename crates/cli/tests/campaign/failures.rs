//! Every task of the service is killed once by a panic: it is back within a second, or the process ends and says so; and who looks from outside never sees
//! a service that is all right and does nothing.

use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::fixture::{Bench, gearwatch, text};
use crate::service::{configure, ended_within, figure, log_of, signal, status, wait_for};

/// What the outside sees after a task was killed.
enum Seen {
    /// Ended with this code, after so long.
    Ended(Option<i32>, Duration),
    /// Works again, after so long; said that it was not all right meanwhile.
    Back(Duration, bool),
    /// Neither.
    Neither,
}

/// Windows judged, durable records, lines on stdout.
fn progress(bench: &Bench, lines: &AtomicU64) -> Option<[u64; 3]> {
    let snapshot = status(bench)?;
    let durable = log_of(&snapshot).and_then(|log| figure(log, "durable_seq"));
    snapshot.ok.then(|| [snapshot.benches[0].windows_judged, durable.unwrap_or(0), lines.load(Ordering::Relaxed)])
}

fn kill_task(point: &str) -> Seen {
    let bench = Bench::new();
    let page = "[[sink]]\nkind = \"stdout\"\n";
    let config = configure(&bench, &bench.path("log"), "20.0", page);
    let service =
        std::fs::read_to_string(&config).unwrap().replace("workers = 2", "workers = 2, page = \"127.0.0.1:0\"");
    std::fs::write(&config, service).unwrap();
    let trigger = bench.path("trigger");
    let mut child = gearwatch(&["run", "--config", text(&config)])
        .env("GEARWATCH_FAIL", format!("{point}={}", text(&trigger)))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let lines = Arc::new(AtomicU64::new(0));
    let (counted, stdout) = (lines.clone(), child.stdout.take().unwrap());
    std::thread::spawn(move || {
        for _ in BufReader::new(stdout).lines().map_while(Result::ok) {
            counted.fetch_add(1, Ordering::Relaxed);
        }
    });
    let running = || progress(&bench, &lines).filter(|all| all.iter().all(|&count| count > 20));
    wait_for(Duration::from_secs(20), running).expect("the service runs");
    std::fs::write(&trigger, "").unwrap();
    let begin = Instant::now();
    wait_for(Duration::from_secs(10), || (!trigger.exists()).then_some(())).expect("the point is passed");
    let killed = Instant::now();
    assert!(killed - begin < Duration::from_secs(5));
    let before = progress(&bench, &lines);
    let mut said_so = before.is_none();
    let seen = wait_for(Duration::from_secs(5), || {
        if let Some(status) = child.try_wait().unwrap() {
            return Some(Seen::Ended(status.code(), killed.elapsed()));
        }
        let now = progress(&bench, &lines);
        said_so |= now.is_none();
        let later = now?.iter().zip(before.unwrap_or([0; 3])).all(|(now, before)| *now > before);
        // The page and the socket are asked for by the status itself; the rest must have gone on.
        (later && killed.elapsed() > Duration::from_millis(250)).then(|| Seen::Back(killed.elapsed(), said_so))
    });
    if child.try_wait().unwrap().is_none() {
        signal(&child, "TERM");
        ended_within(&mut child, Duration::from_secs(5));
    }
    seen.unwrap_or(Seen::Neither)
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
        "log",
        "page",
        "status",
        "main",
    ];
    for point in points {
        let seen = kill_task(point);
        match seen {
            Seen::Ended(code, after) => {
                println!("{point}: exit {code:?} after {after:.2?}");
                assert_ne!(code, Some(0), "{point}");
                assert!(after < Duration::from_secs(2), "{point}: seen after {after:?}");
            }
            // Half a second of backoff, a fifth until the next look, and the machine's own time.
            Seen::Back(after, said_so) => {
                println!("{point}: back after {after:.2?}, not ok meanwhile: {said_so}");
                assert!(after < Duration::from_millis(1500), "{point}: back after {after:?}");
            }
            Seen::Neither => panic!("{point}: neither back nor ended"),
        }
    }
}
