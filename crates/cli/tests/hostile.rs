//! Files and names that were made to do harm: pipes and devices in place of files, escape
//! sequences, values beyond all bounds.

mod small;

use std::path::Path;
use std::process::Command;

use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};
use small::{BENCH, gearwatch, text};

fn refused(folder: &Path, args: &[&str], wanted: &str) {
    let done = gearwatch(folder, args);
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(3), "{args:?}: {said}");
    assert!(said.contains(wanted) && !said.contains("panicked"), "{args:?}: {wanted:?} is not in: {said}");
}

/// A pipe in place of a file would wait for its writer for ever, and a device such as `/dev/zero`
/// has no end.
#[test]
fn regress_only_regular_files_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("bench.toml"), BENCH).unwrap();
    std::fs::write(path("rec.csv"), "a\n".to_owned() + &"1\n".repeat(500)).unwrap();
    std::fs::write(path("other.csv"), "a\n".to_owned() + &"1\n".repeat(500)).unwrap();
    assert!(Command::new("mkfifo").arg(path("pipe.mcap")).status().unwrap().success());
    std::os::unix::fs::symlink("/dev/zero", path("zero.toml")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", path("zero.json")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", path("zero.csv")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", path("rec.csv.toml")).unwrap();
    std::os::unix::fs::symlink("pipe.mcap", path("other.csv.toml")).unwrap();
    refused(folder.path(), &["info", "pipe.mcap"], "a pipe is not supported; recordings are read from regular files");
    refused(folder.path(), &["info", "zero.csv"], "a device is not supported");
    refused(folder.path(), &["info", "rec.csv"], "it is a device, not a regular file");
    refused(folder.path(), &["info", "other.csv"], "it is a pipe, not a regular file");
    refused(folder.path(), &["info", "zero.toml"], "it is a device, not a regular file");
    refused(folder.path(), &["info", "zero.json"], "a device is not supported");
    for option in ["--baseline", "--signatures"] {
        let args = ["diagnose", "rec.csv", "--bench", "bench.toml", option, "zero.json"];
        refused(folder.path(), &args, "it is a device, not a regular file");
    }
    let args = ["simulate", "bench.toml", "--scenario", "zero.toml", "-o", "a.mcap"];
    refused(folder.path(), &args, "it is a device, not a regular file");
}

/// The service's files, and those of its log: none of them is waited for, and none is without end.
#[test]
fn regress_the_service_and_its_log_read_regular_files_only() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("bench.toml"), BENCH).unwrap();
    std::fs::create_dir(path("log")).unwrap();
    for pipe in ["pipe.toml", "pipe", "log/gearwatch-00000001-000000000001-20261121T024000Z.mcap"] {
        assert!(Command::new("mkfifo").arg(path(pipe)).status().unwrap().success());
    }
    std::os::unix::fs::symlink("/dev/zero", path("zero.toml")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", path("zero")).unwrap();
    for (name, what) in [("pipe.toml", "it is a pipe"), ("zero.toml", "it is a device")] {
        refused(folder.path(), &["config", "check", name], what);
        refused(folder.path(), &["run", "--config", name], what);
    }
    for (name, what) in [("pipe", "it is a pipe"), ("zero", "it is a device")] {
        let sink = format!("kind = \"nats\"\nuser = \"a\"\nsecret_file = \"{name}\"\nspool = \"spool\"\n");
        let service = format!(
            "format = \"gearwatch-service/1\"\n[[bench]]\nfile = \"bench.toml\"\n[[bench.source]]\nkind = \"test_signal\"\n[[sink]]\n{sink}"
        );
        std::fs::write(path("service.toml"), service).unwrap();
        refused(folder.path(), &["config", "check", "service.toml"], what);
        let done = gearwatch(folder.path(), &["recover", name, "-o", "new.mcap"]);
        assert_eq!(done.status.code(), Some(1), "{name}: {}", text(&done.stderr));
        assert!(text(&done.stderr).contains(what), "{name}: {}", text(&done.stderr));
    }
    let done = gearwatch(folder.path(), &["doctor", "log"]);
    assert_ne!(done.status.code(), Some(0), "{}", text(&done.stdout));
}

/// A pipe that is asked for is read: `-` is standard input.
#[test]
fn conform_standard_input_is_read_where_it_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("t.csv"), "a\n".to_owned() + &"1\n-1\n".repeat(500)).unwrap();
    let done = Command::new(env!("CARGO_BIN_EXE_gearwatch"))
        .args(["info", "-", "--sample-rate", "100", "--unit", "g"])
        .stdin(std::fs::File::open(folder.path().join("t.csv")).unwrap())
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("1000 samples at 100"), "{}", text(&done.stdout));
}

/// A text above 64 MiB is refused by its limit.
#[test]
fn regress_texts_have_a_limit() {
    let folder = tempfile::tempdir().unwrap();
    let file = std::fs::File::create(folder.path().join("large.toml")).unwrap();
    file.set_len((64 << 20) + 1).unwrap();
    refused(folder.path(), &["simulate", "large.toml", "-o", "a.mcap"], "above the limit of 64 MiB for a text file");
}

/// Sheets that asked for gigabytes, hours, or ended in a panic.
#[test]
fn regress_benches_beyond_all_bounds_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let stages: String = (0..1000)
        .map(|i| format!("[[shaft]]\nname = \"s{i}\"\n[[stage]]\nname = \"g{i}\"\npinion = {{ teeth = 29 }}\nwheel = {{ teeth = 100 }}\n"))
        .collect();
    let belt = "[belt]\nratio = 1e-300\n";
    for (bench, wanted) in [
        (format!("{BENCH}{stages}"), "there are 1001 [[stage]]; at most 8 are read"),
        (BENCH.replace("teeth = 29", "teeth = 4294967295"), "pinion.teeth is 4294967295; expected 5 to 1000"),
        (format!("{BENCH}{belt}"), "belt.ratio is 1e-300; expected 0.01 to 100"),
        (BENCH.replace("speed_hz = 30.0", "speed_hz = 1e300"), "motor.speed_hz is 1e300"),
        (BENCH.replace("\"small\"", &format!("\"{}\"", "x".repeat(70_000))), "has 70000 characters; expected 1 to 120"),
        (BENCH.replace("\"acc_1\"", "\"a\\u001b[2Jb\""), "has a control character"),
    ] {
        std::fs::write(folder.path().join("bench.toml"), bench).unwrap();
        for command in [&["info", "bench.toml"][..], &["simulate", "bench.toml", "-o", "a.mcap", "--duration", "1"]] {
            refused(folder.path(), command, wanted);
        }
    }
}

/// The name of a case may be of any length: padding beyond 65 535 characters panicked.
#[test]
fn regress_long_names_of_cases_make_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let case = format!("{}=eccentricity@stage1.pinion:runout_um=5", "n".repeat(70_000));
    let done = gearwatch(folder.path(), &["sweep", "single-pair", "--duration", "2", "--case", &case]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr).chars().take(500).collect::<String>());
    assert!(text(&done.stdout).contains("nnn…"));
}

/// Names of files, sensors, units and sessions reach the terminal without their control characters.
#[test]
fn regress_escape_sequences_do_not_reach_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut writer =
        McapWriter::new(std::fs::File::create(path("a\x1b[2J.mcap")).unwrap(), Compression::None, PublishTime::LogTime)
            .unwrap();
    let block = Block {
        sensor: "acc\x1b]0;title\x07".into(),
        t0: 0,
        sample_rate_hz: 100.0,
        first_sample_index: 0,
        unit: "g\u{9b}31m".into(),
        samples: Samples::Physical(vec![1.0; 500]),
        quality: Quality::GOOD,
    };
    writer.write(&Packet::Vibration(block)).unwrap();
    writer.finish().unwrap();
    std::fs::write(path("b.csv"), "a\u{202e}b\x1b[1m,c\n1,2\n1,x\x1b[31m\n").unwrap();
    std::fs::write(path("c.json"), "{\"format\": \"x\\u001b[31m\", \"k\\u009b\": \"v\\u001b\"}").unwrap();
    std::fs::write(path("bench.toml"), BENCH).unwrap();
    for args in [
        &["info", "a\x1b[2J.mcap"][..],
        &["info", "b.csv", "--sample-rate", "10"],
        &["info", "c.json"],
        &["info", "none\x1b[2J.mcap"],
        &["diagnose", "a\x1b[2J.mcap", "--bench", "bench.toml"],
        &["baseline", "show", "c.json"],
        &["signatures", "none\x1b[2J.toml"],
        &["doctor", "none\x1b[2J"],
        &["info", "b.csv", "--sample-rate", "10", "--format", "json"],
    ] {
        let done = gearwatch(folder.path(), args);
        let said = text(&done.stdout) + &text(&done.stderr);
        assert!(!said.is_empty(), "{args:?}");
        let raw = said.chars().find(|c| (c.is_control() && !matches!(c, '\n' | '\t')) || *c == '\u{202e}');
        assert_eq!(raw, None, "{args:?}: {said:?}");
    }
}
