//! Shards: their union is the whole, a killed one goes on, done work is known.

use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::archive::{Archive, difference, names};
use crate::fixture::{stderr, stdout, text};

/// Three shards under `xargs`, one of them killed and run again, give the rows of one run of
/// everything.
#[test]
fn conform_shards_and_a_kill_give_the_rows_of_one_run() {
    let archive = Archive::new(12, 6.0);
    let whole = archive.batch("whole", &[]).output().unwrap();
    assert!(whole.status.success(), "{}", stderr(&whole));
    assert!(stdout(&whole).starts_with("shard 1/1: 12 recordings worked ("), "{}", stdout(&whole));

    let mut child = archive.batch("shards", &["--shard", "2/3", "--jobs", "1"]).stdout(Stdio::null()).spawn().unwrap();
    let begin = Instant::now();
    let pieces = || names(&archive.bench.path("shards")).into_iter().find(|name| name.starts_with(".part-00002"));
    // A piece of the shard is done, and not all of them: 12 recordings in three shards.
    let some = || pieces().map_or(0, |folder| names(&archive.bench.path("shards").join(folder)).len());
    while begin.elapsed() < Duration::from_secs(20) && !archive.bench.path("shards").is_dir() {}
    while begin.elapsed() < Duration::from_secs(20) && some() < 2 {}
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!archive.bench.path("shards/part-00002-of-00003.parquet").exists(), "killed too late");

    let script = format!(
        "seq 3 | xargs -P 2 -I {{}} {} batch --bench bench.toml --baseline baseline.json --manifest list.txt \
         --out shards --shard {{}}/3 --jobs 1",
        archive.batch("", &[]).get_program().to_str().unwrap()
    );
    let mut xargs = std::process::Command::new("sh");
    let xargs = xargs.args(["-c", &script]).current_dir(archive.bench.path("")).output().unwrap();
    assert!(xargs.status.success(), "{}", stderr(&xargs));
    let said = stdout(&xargs);
    let second = said.lines().find(|line| line.starts_with("shard 2/3")).unwrap();
    assert!(!second.contains(" 0 known from before"), "a killed shard goes on where it was: {second}");
    let parts: Vec<String> = (1..=3).map(|k| format!("part-{k:05}-of-00003.parquet")).collect();
    assert_eq!(names(&archive.bench.path("shards")), parts, "whole parts, and nothing else");
    if let Some((different, rows)) = difference(&archive.bench.path("shards"), &archive.bench.path("whole")) {
        assert_eq!(different, "0");
        // 6 s in windows of 1 s, every half second: 11 windows of two channels.
        assert_eq!(rows, (12 * 11 * 2).to_string());
    }

    // Again: nothing to do. One recording changed: one recording worked. A sidecar file changes
    // what is read.
    let again = |expected: &str| {
        let output = archive.batch("whole", &[]).output().unwrap();
        assert!(stdout(&output).contains(expected), "{}", stdout(&output));
    };
    again(" 0 recordings worked (0 rows), 12 known from before");
    archive.bench.record("recordings/005.mcap", "duration_secs = 6.0\nseed = 99", |_| {});
    again(" 1 recordings worked (22 rows), 11 known from before");
    archive.bench.write("recordings/004.mcap.toml", "brake_torque_nm = 10.0\n");
    again(" 1 recordings worked (22 rows), 11 known from before");
    again(" 12 known from before");
}

/// What the rows say, and where they come from.
#[test]
fn conform_rows_name_their_origin() {
    let archive = Archive::new(4, 4.0);
    assert!(archive.batch("out", &[]).output().unwrap().status.success());
    let parts = format!("'{}/*.parquet'", text(&archive.bench.path("out")));
    let query = format!(
        "select distinct file, length(file_sha256), sidecar_sha256, length(baseline_sha256), version, sample_rate_hz,
         max(level_2x) over (partition by file) from {parts} order by file"
    );
    let Some(answer) = crate::archive::duckdb(&query) else { return };
    let version = env!("CARGO_PKG_VERSION");
    let rows: Vec<&str> = answer.lines().collect();
    assert_eq!(rows.len(), 4, "{answer}");
    assert_eq!(rows[3], format!("recordings/003.mcap\t64\t\t64\t{version}\t2048.0\t5"), "a fault of 20 % is rank V");
    assert!(rows[0].ends_with("\t0"), "{answer}");
}
