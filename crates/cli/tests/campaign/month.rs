//! Four weeks of a bench at speed, a part of each day: a fault grows from the third week on, is
//! found, acknowledged and reported. Log, levels, the time of a query and the memory of the service
//! are told.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::fixture::{Bench, gearwatch, text};
use crate::soak::{Sample, sample};

const DAYS: i64 = 28;
/// The fault begins here, and grows by so much each day (percent of 1x).
const FIRST: i64 = 14;
const GROWTH: f64 = 1.5;
/// Somebody acknowledges the alarm on this day.
const SEEN: i64 = 24;
/// Of each day that is simulated (s).
const PART_S: f64 = 600.0;
/// The resident set on any day, at its peak, and what the peak may grow by from the first days to
/// the last (KiB).
const MOST_KIB: u64 = 40 * 1024;
const FLAT_KIB: u64 = 1024;

/// Midnight before the first day, in days since the epoch: what is acknowledged bears the clock's
/// time, so that the day of it is today.
fn first_day() -> i64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("after 1970");
    now.as_secs() as i64 / 86_400 - SEEN
}

fn config(first: i64, day: i64, page: &str, speed: &str) -> String {
    let grown = ((day - FIRST).max(0) as f64 * GROWTH).min(20.0);
    let fault = format!(
        "fault = {{ after_secs = 0.0, stage = \"stage1\", percent = [{grown:?}, {:?}, 0.0, 0.0, 0.0] }}",
        0.5 * grown
    );
    let fault = if grown > 0.0 { fault.as_str() } else { "" };
    format!(
        "format = \"gearwatch-service/1\"\n[service]\nself_test = false\n{page}\n\
         [report]\ncustomer = \"A. Customer\"\nbench = \"Bench 3\"\nserial = \"4711\"\nauthor = \"shift A\"\n\
         [[bench]]\nfile = \"rig.toml\"\nlearn_from = {{ kind = \"test_signal\", seed = 1, speed = \"max\", duration_secs = 60.0 }}\n\
         [[bench.source]]\nkind = \"test_signal\"\nseed = {}\n{speed}\nfirst_sample_unix_ns = {}000000000\n{fault}\n\
         [[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\n",
        100 + day,
        (first + day) * 86_400 + 8 * 3600,
    )
}

fn run(bench: &Bench) -> Child {
    let config = bench.path("service.toml");
    let mut command = gearwatch(&["run", "--config", text(&config)]);
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the service runs")
}

/// Acknowledges all alarms as a person would; how many there were.
fn acknowledge(port: u16) -> usize {
    let ask = |request: String| -> Option<String> {
        let mut stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
        stream.write_all(request.as_bytes()).ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        answer.split_once("\r\n\r\n").map(|(_, body)| body.to_owned())
    };
    let head = format!("HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n");
    let until = Instant::now() + Duration::from_secs(60);
    while Instant::now() < until {
        let status = ask(format!("GET /api/snapshot {head}\r\n"))
            .and_then(|body| serde_json::from_str::<serde_json::Value>(&body).ok());
        let alarms = status.map(|s| s["benches"][0]["alarms"].clone()).unwrap_or_default();
        let open: Vec<String> = alarms
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(|a| a["id"].as_str().map(|id| id.replace('/', "%2F")))
            .collect();
        if open.is_empty() {
            std::thread::sleep(Duration::from_millis(200));
            continue;
        }
        let body = r#"{"who": "shift A", "why": "wear of the pinion; the spare part is ordered"}"#;
        for id in &open {
            ask(format!(
                "POST /api/alarms/{id}/acknowledge {head}Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
                body.len()
            ));
        }
        return open.len();
    }
    0
}

fn size(folder: &Path, end: &str) -> u64 {
    let files = std::fs::read_dir(folder).expect("a folder").flatten();
    files
        .filter(|f| f.file_name().to_string_lossy().ends_with(end))
        .filter_map(|f| f.metadata().ok())
        .map(|m| m.len())
        .sum()
}

#[test]
#[ignore = "minutes; `just campaign-month`"]
fn conform_a_month_of_a_growing_fault() {
    let bench = Bench::new();
    let shipped = gearwatch_sim::shipped::BENCHES.iter().find(|shipped| shipped.name == "paper-rig").expect("shipped");
    bench.write("rig.toml", shipped.text);
    let first = first_day();
    let (begin, mut peaks, mut seen) = (Instant::now(), Vec::new(), 0);
    for day in 0..DAYS {
        let speed = format!("speed = \"max\"\nduration_secs = {PART_S:?}");
        bench.write("service.toml", &config(first, day, "", &speed));
        let mut child = run(&bench);
        let mut peak = 0;
        while child.try_wait().expect("a child").is_none() {
            peak = sample(child.id(), begin).map_or(peak, |s: Sample| peak.max(s.peak_kib as u64));
            std::thread::sleep(Duration::from_millis(50));
        }
        peaks.push(peak);
        if day == SEEN {
            let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a port").port();
            bench.write("service.toml", &config(first, day, &format!("page = \"127.0.0.1:{port}\""), "speed = 1.0"));
            let mut child = run(&bench);
            seen = acknowledge(port);
            std::thread::sleep(Duration::from_secs(1));
            crate::service::signal(&child, "TERM");
            child.wait().expect("an end");
        }
    }
    assert!(seen >= 2, "both channels of the stage had an alarm, {seen}");
    let log = bench.path("log");
    let (year, month, day) = gearwatch_core::calendar::civil(first + DAYS);
    let to = format!("{year:04}-{month:02}-{day:02}");
    let timed = |args: &[&str]| {
        let begin = Instant::now();
        let out = gearwatch(args).output().expect("the binary runs");
        (begin.elapsed(), out)
    };
    let (query, history) = timed(&["history", text(&log), "--every", "1d", "--csv"]);
    let table = String::from_utf8_lossy(&history.stdout).into_owned();
    assert!(history.status.success(), "{}", String::from_utf8_lossy(&history.stderr));
    assert_eq!(table.lines().count(), 1 + 4 * DAYS as usize, "a row a day, two stages at two sensors");
    let page = bench.path("week.html");
    let (report, told) = timed(&[
        "report",
        "--weekly",
        text(&log),
        "--to",
        &to,
        "--config",
        text(&bench.path("service.toml")),
        "--out",
        text(&page),
    ]);
    assert!(told.status.success(), "{}", String::from_utf8_lossy(&told.stderr));
    let html = std::fs::read_to_string(&page).expect("the report");
    // Found, seen, reported: the trend, the alarm with its comment, and the people.
    for words in ["shift A", "the spare part is ordered", "A. Customer", "4711", "acknowledged", "stage1@acc_1"] {
        assert!(html.contains(words), "{words}");
    }
    if let Some(keep) = std::env::var_os("GEARWATCH_MONTH") {
        let _ = std::fs::remove_dir_all(&keep);
        let copied = std::process::Command::new("cp").args(["-a", text(&bench.path("."))]).arg(&keep).status();
        assert!(copied.is_ok_and(|status| status.success()));
    }
    let mean = |part: &[u64]| part.iter().sum::<u64>() / part.len() as u64;
    let (early, last) = (mean(&peaks[..5]), mean(&peaks[DAYS as usize - 5..]));
    let most = peaks.iter().copied().max().unwrap_or(0);
    println!(
        "{DAYS} days of {PART_S} s: log {:.1} MB, levels {:.2} MB; history by days in {query:.2?}, weekly report in {report:.2?}; resident set at most {early} KiB in the first days, {last} KiB in the last, {most} KiB on any; {:.0} s in all",
        size(&log, ".mcap") as f64 / 1e6,
        size(&log, ".sqlite") as f64 / 1e6,
        begin.elapsed().as_secs_f64()
    );
    assert!(most < MOST_KIB, "{peaks:?}");
    assert!(last < early + FLAT_KIB, "the service grows with its log: {peaks:?}");
}
