//! A day in minutes: the test signal at 144 times its speed through everything at once, with
//! rotation, reloads, lost connections and clients that come and go. Memory does not grow,
//! descriptors and threads stay as many, every window is accounted for.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::fixture::{Bench, gearwatch};
use crate::service::{configure, ended_within, files, signal, status, wait_for};
use gearwatch_testkit::log::content;

/// What `/proc` says of a process.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    secs: f64,
    pub rss_kib: f64,
    /// The most that it was.
    pub peak_kib: f64,
    /// Of it, what belongs to no file.
    heap_kib: f64,
    descriptors: usize,
    threads: usize,
}

/// `None` where the process is just ending.
pub fn sample(pid: u32, begin: Instant) -> Option<Sample> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let field = |name: &str| {
        let line = status.lines().find(|line| line.starts_with(name))?;
        line.split_whitespace().nth(1)?.parse::<f64>().ok()
    };
    Some(Sample {
        secs: begin.elapsed().as_secs_f64(),
        rss_kib: field("VmRSS:")?,
        peak_kib: field("VmHWM:")?,
        heap_kib: field("RssAnon:")?,
        descriptors: std::fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count(),
        threads: field("Threads:")? as usize,
    })
}

/// Median of the slopes of all pairs (Theil, Sen): a single peak does not move it.
pub fn slope(samples: &[Sample]) -> f64 {
    let mut slopes = Vec::new();
    for (i, a) in samples.iter().enumerate() {
        slopes.extend(samples[i + 1..].iter().map(|b| (b.rss_kib - a.rss_kib) / (b.secs - a.secs)));
    }
    slopes.sort_by(f64::total_cmp);
    slopes[slopes.len() / 2]
}

/// A broker that takes a connection and hangs up after a moment, again and again.
pub fn flaky_broker() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            std::thread::sleep(Duration::from_millis(50));
            drop(stream);
        }
    });
    port
}

pub fn ask_page(address: &str, path: &str, listen: Duration) {
    let Ok(mut stream) = TcpStream::connect(address) else { return };
    let _ = stream.set_read_timeout(Some(listen));
    let _ = write!(stream, "GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    let mut buffer = [0; 4096];
    let end = Instant::now() + listen;
    while Instant::now() < end && stream.read(&mut buffer).is_ok_and(|count| count > 0) {}
}

#[test]
#[ignore = "minutes; `just campaign-soak`"]
fn conform_a_day_in_minutes_leaks_nothing() {
    let secs: u64 = std::env::var("GEARWATCH_SOAK_SECS").ok().and_then(|text| text.parse().ok()).unwrap_or(600);
    let bench = Bench::new();
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let page = format!("127.0.0.1:{port}");
    let folder = bench.path("log");
    let broker = flaky_broker();
    let further = format!(
        "rotate_bytes = 1048576\nkeep_bytes = 1073741824\n\
         [[sink]]\nkind = \"nats\"\nservers = [\"nats://127.0.0.1:{broker}\"]\nspool = \"spool\"\nspool_bytes = 4194304\n\
         [[sink]]\nkind = \"mqtt\"\nport = {broker}\nspool = \"spool-mqtt\"\nspool_bytes = 4194304\n"
    );
    let config = configure(&bench, &folder, "144.0", &further);
    let text =
        std::fs::read_to_string(&config).unwrap().replace("workers = 2", &format!("workers = 2, page = \"{page}\""));
    std::fs::write(&config, text).unwrap();
    let talk = bench.path("talk");
    let mut child = gearwatch(&["run", "--config", crate::fixture::text(&config)])
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(&talk).unwrap())
        .spawn()
        .unwrap();
    wait_for(Duration::from_secs(20), || status(&bench)).expect("the service runs");
    let begin = Instant::now();
    let (mut samples, mut reloads, mut clients) = (Vec::new(), 0, 0);
    while begin.elapsed().as_secs() < secs {
        // Six seconds of clients, a reload, and a hundred of them in ten minutes.
        for _ in 0..6 {
            clients += 2;
            ask_page(&page, "/metrics", Duration::from_millis(500));
            ask_page(&page, "/api/events", Duration::from_millis(400));
            status(&bench);
            std::thread::sleep(Duration::from_millis(400));
        }
        // Before each reload all is at the same phase.
        samples.extend(sample(child.id(), begin));
        let asked = Instant::now();
        signal(&child, "HUP");
        reloads += 1;
        let anew = || status(&bench).filter(|now| now.uptime_secs < asked.elapsed().as_secs_f64());
        wait_for(Duration::from_secs(30), anew).expect("the service answers after a reload");
    }
    signal(&child, "TERM");
    assert_eq!(
        ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()),
        Some(0),
        "{}",
        std::fs::read_to_string(&talk).unwrap()
    );

    let health = gearwatch_log::doctor(&folder).unwrap();
    assert!(health.is_whole(), "{:?}", health.missing);
    // Windows follow each other within a run, but for those that a gap record counts.
    let content = content(&files(&folder));
    let shed: u64 = content.gaps.iter().filter(|gap| gap.channel.ends_with(" windows")).map(|gap| gap.count).sum();
    let other: Vec<_> = content.gaps.iter().filter(|gap| !gap.channel.ends_with(" windows")).collect();
    let mut last: BTreeMap<String, u64> = BTreeMap::new();
    let mut holes = 0;
    for data in content.verdicts.values() {
        let object: serde_json::Value = serde_json::from_slice(data).unwrap();
        let window = object["window"].as_u64().unwrap();
        let before = last.insert(object["channel"].as_str().unwrap().to_owned(), window);
        holes += before.filter(|&before| before < window).map_or(0, |before| window - before - 1);
    }
    let settled = &samples[samples.len() / 10..];
    let a_day = |samples: &[Sample]| slope(samples) * 600.0 / 1024.0;
    let per_day = a_day(settled);
    let range = |value: fn(&Sample) -> usize| (settled.iter().map(value).min(), settled.iter().map(value).max());
    let (descriptors, threads) = (range(|s| s.descriptors), range(|s| s.threads));
    println!(
        "{secs} s at x144: {} verdicts in {} files, {reloads} reloads, {clients} clients; RSS {:.1} MiB, of which heap and stacks {:.1} MiB, \
         slope {per_day:.2} MiB a simulated day (first half {:.2}, second half {:.2}); \
         descriptors {descriptors:?}, threads {threads:?}; {holes} windows missing, {shed} counted as shed, other gaps {}",
        content.verdicts.len(),
        health.files.len(),
        settled.last().unwrap().rss_kib / 1024.0,
        settled.last().unwrap().heap_kib / 1024.0,
        a_day(&settled[..settled.len() / 2]),
        a_day(&settled[settled.len() / 2..]),
        other.len(),
    );
    assert!(holes <= shed, "{holes} windows are missing, and {shed} were counted");
    let spread = |(least, most): (Option<usize>, Option<usize>)| most.unwrap() - least.unwrap();
    assert!(spread(descriptors) <= 8, "descriptors {descriptors:?}");
    assert!(spread(threads) <= 2, "threads {threads:?}");
    // Over a short run the slope says little; over minutes it must be small.
    if secs >= 300 {
        assert!(per_day <= 1.0, "{per_day} MiB a simulated day");
    }
}
