//! Stopping: signals at any moment, a closed pipe, a reader that does not read.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use super::fixture::{Bench, gearwatch, output, text};

fn signal(child: &Child, name: &str) {
    let sent = std::process::Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

/// Waits for the end; `None` when it takes longer.
fn ended_within(child: &mut Child, limit: Duration) -> Option<i32> {
    let begin = Instant::now();
    while begin.elapsed() < limit {
        if let Some(status) = child.try_wait().unwrap() {
            return Some(status.code().unwrap_or(-1));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    None
}

/// A service that watches the test signal for ever, at this speed.
fn endless(bench: &Bench, speed: &str) -> std::path::PathBuf {
    bench.write(
        "endless.toml",
        &format!(
            "format = \"gearwatch-service/1\"\nservice = {{ workers = 2 }}\n[[bench]]\nfile = \"bench.toml\"\n\
             [[bench.source]]\nkind = \"test_signal\"\nspeed = {speed}\n[[sink]]\nkind = \"stdout\"\n"
        ),
    )
}

/// Twenty moments spread over start and life, both signals, slow and as fast as it can: always exit
/// 0 within 3 s, and every line whole.
#[test]
fn conform_a_signal_at_any_moment_ends_in_order() {
    let bench = Bench::new();
    for (number, name) in ["TERM", "INT"].iter().cycle().take(20).enumerate() {
        let config = endless(&bench, if number % 4 < 2 { "50.0" } else { "\"max\"" });
        let mut child = gearwatch(&["run", "--config", text(&config)])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stdout = child.stdout.take().unwrap();
        let reader = std::thread::spawn(move || {
            let mut all = Vec::new();
            stdout.read_to_end(&mut all).map(|_| all).unwrap()
        });
        // The handlers are set before anything is opened; until then the system's own way to end
        // holds.
        std::thread::sleep(Duration::from_millis(60 + 13 * number as u64));
        signal(&child, name);
        let code = ended_within(&mut child, Duration::from_secs(3));
        assert_eq!(code, Some(0), "signal {name}, number {number}");
        let all = reader.join().unwrap();
        assert!(all.is_empty() || all.ends_with(b"}\n"), "number {number}");
        for line in all.split(|&b| b == b'\n').filter(|line| !line.is_empty()) {
            serde_json::from_slice::<serde_json::Value>(line).unwrap();
        }
    }
}

/// A reader that stops reading cannot hold up the end, and the second signal ends at once.
#[test]
fn conform_a_blocked_pipe_does_not_hold_up_the_end() {
    let bench = Bench::new();
    let config = endless(&bench, "\"max\"");
    for second in [false, true] {
        let mut child = gearwatch(&["run", "--config", text(&config)])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // Long enough to fill the pipe.
        std::thread::sleep(Duration::from_millis(700));
        signal(&child, "TERM");
        if second {
            std::thread::sleep(Duration::from_millis(50));
            signal(&child, "TERM");
            let code = ended_within(&mut child, Duration::from_millis(500));
            assert_eq!(code, Some(128 + 15));
        } else {
            assert!(ended_within(&mut child, Duration::from_secs(3)).is_some(), "it must not wait for the reader");
        }
    }
}

/// `gearwatch run | head -1`: the service goes on without its reader; a replay ends.
#[test]
fn conform_a_closed_pipe_disables_the_sink_and_not_the_service() {
    let bench = Bench::new();
    let config = endless(&bench, "50.0");
    let mut child =
        gearwatch(&["run", "--config", text(&config)]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut first = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut first).unwrap();
    assert!(first.ends_with("}\n"), "{first}");
    std::thread::sleep(Duration::from_millis(400));
    assert!(child.try_wait().unwrap().is_none(), "the service ended with its reader");
    signal(&child, "TERM");
    assert_eq!(ended_within(&mut child, Duration::from_secs(3)), Some(0));
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(said.contains("its reader has gone"), "{said}");

    let recording = bench.healthy();
    let mut child =
        gearwatch(&["replay", text(&recording), "--speed", "1", "--bench", text(&bench.path("bench.toml"))])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut first).unwrap();
    assert_eq!(ended_within(&mut child, Duration::from_secs(5)), Some(0), "a replay without a reader ends");
}

/// A source that fails ends the service with 3, and says why; what it delivered before was judged.
#[test]
fn conform_a_failed_source_is_told_in_the_exit_code() {
    let bench = Bench::new();
    let config = bench.write(
        "missing.toml",
        "format = \"gearwatch-service/1\"\n[[bench]]\nfile = \"bench.toml\"\n\
         [[bench.source]]\nkind = \"file\"\npath = \"not-there.mcap\"\n",
    );
    let output = output(&["run", "--config", text(&config)]);
    assert_eq!(output.status.code(), Some(3));
    assert!(super::fixture::stderr(&output).contains("not-there.mcap"));
}

/// Nobody reads what the service says on stderr: ranks go on all the same, and it still ends in
/// order.
#[test]
fn regress_a_full_stderr_does_not_hold_up_ranks() {
    let bench = Bench::new();
    let config = endless(&bench, "50.0");
    let mut child = gearwatch(&["run", "--config", text(&config)])
        .env("GEARWATCH_LOG", "trace")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It runs, and has read its configuration, when the first line comes.
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    lines.next().unwrap().unwrap();
    // Each bad configuration is told: more talk than a pipe of 64 KiB holds.
    let long = "x".repeat(30_000);
    std::fs::write(&config, format!("format = \"{long}\"")).unwrap();
    for _ in 0..8 {
        signal(&child, "HUP");
        for _ in 0..40 {
            lines.next().unwrap().unwrap();
        }
    }
    signal(&child, "TERM");
    assert_eq!(ended_within(&mut child, Duration::from_secs(3)), Some(0));
}
