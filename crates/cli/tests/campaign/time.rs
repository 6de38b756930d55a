//! Time plays tricks: the wall clock is set, the machine has been up for 400 days, counters come
//! near 2³². Ranks do not change by a byte.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use gearwatch_core::block::Packet;

use crate::fixture::{Bench, gearwatch, output, stdout, text};
use crate::service::files;

/// Preloaded, it makes the wall clock what a file says; the monotonic one stays.
const FAKETIME: &str = "/usr/lib/x86_64-linux-gnu/faketime/libfaketimeMT.so.1";

/// A service that watches some seconds of the test signal, at ten times the speed, and ends by
/// itself.
fn short_run(bench: &Bench, name: &str) -> std::path::PathBuf {
    bench.baseline();
    bench.write(
        &format!("{name}.toml"),
        &format!(
            "format = \"gearwatch-service/1\"\nservice = {{ workers = 2, self_test = false }}\n\
             [[bench]]\nfile = \"bench.toml\"\nbaseline = \"baseline.json\"\n\
             [[bench.source]]\nkind = \"test_signal\"\nspeed = 4.0\nduration_secs = 20.0\nfirst_sample_unix_ns = 1000000000\n\
             [[sink]]\nkind = \"stdout\"\n[[sink]]\nkind = \"mcap_log\"\nfolder = \"log-{name}\"\n"
        ),
    )
}

fn lines(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    stdout(output)
}

/// Steps in `/clock`: every record but the first of the run.
fn steps(folder: &Path) -> Vec<i64> {
    let mut steps = Vec::new();
    for (_, bytes) in files(folder) {
        for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
            if message.channel.topic == "/clock" {
                let object: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
                if object["clock_epoch"].as_u64().unwrap() > 0 {
                    steps.push(object["step_ns"].as_i64().unwrap());
                }
            }
        }
    }
    steps
}

#[test]
fn conform_a_wall_clock_that_is_set_changes_no_rank() {
    if !Path::new(FAKETIME).exists() {
        eprintln!("skipped: {FAKETIME} is not there (package libfaketime)");
        return;
    }
    let bench = Bench::new();
    let expected = lines(&output(&["run", "--config", text(&short_run(&bench, "plain"))]));
    assert_eq!(steps(&bench.path("log-plain")), Vec::<i64>::new());
    let config = short_run(&bench, "stepped");
    let stamp = bench.write("faketime", "+0");
    let child = gearwatch(&["run", "--config", text(&config)])
        .env("LD_PRELOAD", FAKETIME)
        .env("FAKETIME_TIMESTAMP_FILE", &stamp)
        .env("FAKETIME_NO_CACHE", "1")
        .env("FAKETIME_DONT_FAKE_MONOTONIC", "1")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // An hour forward, a day back, a leap second, 1970 and 2038; the run takes five seconds.
    let shifts = [3600, -86_400, -86_401, -1_500_000_000, 400_000_000];
    for shift in shifts {
        std::thread::sleep(Duration::from_millis(800));
        let next = bench.path("faketime.next");
        std::fs::write(&next, format!("{shift:+}")).unwrap();
        std::fs::rename(&next, &stamp).unwrap();
    }
    let stepped = child.wait_with_output().unwrap();
    let got = lines(&stepped);
    // The stopped clock of a busy machine may shed windows; what is there is byte for byte the
    // same.
    assert!(got == expected, "{} bytes, {} expected", got.len(), expected.len());
    let mut before = 0;
    let wanted: Vec<i64> = shifts.iter().map(|&shift| shift - std::mem::replace(&mut before, shift)).collect();
    let seen: Vec<i64> = steps(&bench.path("log-stepped")).iter().map(|&ns| (ns as f64 / 1e9).round() as i64).collect();
    assert_eq!(seen, wanted, "one clock record a step");
}

#[test]
fn conform_four_hundred_days_of_uptime_change_no_rank() {
    let bench = Bench::new();
    let config = short_run(&bench, "plain");
    let expected = lines(&output(&["run", "--config", text(&config)]));
    let days = (400 * 86_400).to_string();
    let namespace = ["-T", "--monotonic", &days, "--boottime", &days];
    if !Command::new("unshare").args(namespace).arg("true").output().is_ok_and(|o| o.status.success()) {
        eprintln!("skipped: a time namespace needs root");
        return;
    }
    let binary = std::env::var_os("GEARWATCH_BINARY").unwrap_or(env!("CARGO_BIN_EXE_gearwatch").into());
    let config = short_run(&bench, "old");
    let old = Command::new("unshare").args(namespace).arg(binary).args(["run", "--config", text(&config)]).output();
    assert!(lines(&old.unwrap()) == expected);
}

/// Sample counters that cross 2³² and 2⁵³ in the middle of a recording: but for the counter itself
/// every line is the same.
#[test]
fn conform_counters_may_cross_their_borders() {
    let bench = Bench::new();
    let (file, baseline) = (bench.path("bench.toml"), bench.baseline());
    let windows = |name: &str, start: u64| {
        let recording = bench.record(name, "duration_secs = 12.0\nseed = 9", |packet| {
            if let Packet::Vibration(block) = packet {
                block.first_sample_index += start;
            }
        });
        let all = ["diagnose", text(&recording), "--windows", "--bench", text(&file), "--baseline", text(&baseline)];
        let said = stdout(&output(&all));
        let objects = said.lines().map(|line| {
            let mut object: serde_json::Value = serde_json::from_str(line).unwrap();
            let index = object["first_sample_index"].as_u64().unwrap();
            object["first_sample_index"] = (index - start).into();
            object
        });
        objects.collect::<Vec<_>>()
    };
    let expected = windows("zero.mcap", 0);
    assert_eq!(expected.len(), 46);
    for (name, start) in
        [("u32.mcap", (1_u64 << 32) - 9000), ("f64.mcap", (1 << 53) - 9000), ("f32.mcap", (1 << 24) - 9000)]
    {
        assert!(windows(name, start) == expected, "{name}");
    }
}
