//! SIGTERM and SIGINT at random moments: exit 0 within 3 s, and every file of the log has its
//! footer and its index.

use std::time::{Duration, Instant};

use crate::fixture::Bench;
use crate::service::{Moments, configure, ended_within, files, rounds, said, signal, start};

#[test]
fn conform_stops_leave_a_closed_log() {
    let all = rounds(8);
    let bench = Bench::new();
    let mut moments = Moments::new(5);
    let (mut longest, mut verdicts, mut too_early) = (Duration::ZERO, 0, 0);
    for round in 0..all {
        let folder = bench.path(&format!("log-{round}"));
        let speed = if round % 4 < 2 { "100.0" } else { "\"max\"" };
        let config = configure(&bench, &folder, speed, "rotate_bytes = 65536");
        let mut child = start(&config);
        std::thread::sleep(moments.between(Duration::from_millis(30), Duration::from_millis(1200)));
        let begin = Instant::now();
        signal(&child, if round % 2 == 0 { "TERM" } else { "INT" });
        let status = ended_within(&mut child, Duration::from_secs(3));
        let status = status.unwrap_or_else(|| panic!("round {round}: still there after 3 s"));
        longest = longest.max(begin.elapsed());
        if status.code().is_none() && !folder.exists() {
            // The program was not loaded yet: the system's own way to end, and nothing was begun.
            too_early += 1;
            continue;
        }
        assert_eq!(status.code(), Some(0), "round {round}: {}", said(&mut child));
        if !folder.exists() {
            continue;
        }
        let health = gearwatch_log::doctor(&folder).unwrap();
        assert!(health.is_whole() && !health.in_use, "round {round}: {health:?}");
        for (name, bytes) in files(&folder) {
            let summary = mcap::Summary::read(&bytes).unwrap();
            let summary = summary.unwrap_or_else(|| panic!("round {round}: {name} has no index"));
            verdicts += summary.stats.map_or(0, |stats| stats.message_count);
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }
    println!("{all} stops, longest {longest:.2?}, {verdicts} messages, {too_early} before the program was loaded");
    assert!(verdicts > 20 * all, "too little was logged to mean anything: {verdicts}");
}
