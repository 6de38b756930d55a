//! Logs of the service as recordings: read by the same commands, with the same answers.

use super::fixture::{Bench, output, stderr, stdout, text};

const SIGNAL: &str = "duration_secs = 12.0\nseed = 9\nfault = { after_secs = 0.0, stage = \"stage1\", percent = [0.0, 5.5, 0.0, 0.0, 20.0] }\n";

/// The log of a service over the test signal; `raw` is what it keeps of the samples.
fn log(bench: &Bench, folder: &str, raw: &str) -> String {
    let config = format!(
        "format = \"gearwatch-service/1\"\nservice = {{ self_test = false }}\n\
         [[bench]]\nfile = \"bench.toml\"\nbaseline = \"baseline.json\"\n\
         [[bench.source]]\nkind = \"test_signal\"\nspeed = \"max\"\nfirst_sample_unix_ns = 1000000000\n{SIGNAL}\
         [[sink]]\nkind = \"mcap_log\"\nfolder = \"{folder}\"\n{raw}"
    );
    let done = output(&["run", "--config", text(&bench.write("service.toml", &config))]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let files = std::fs::read_dir(bench.path(folder)).unwrap().map(|entry| entry.unwrap().path());
    let logs: Vec<_> = files.filter(|path| path.extension().is_some_and(|end| end == "mcap")).collect();
    let [log] = &logs[..] else { panic!("one log is expected: {logs:?}") };
    text(log).to_owned()
}

/// A log that keeps all raw data is judged as the recording of the same samples is, line for line, by every command that judges.
#[test]
fn conform_a_log_is_judged_as_its_recording() {
    let bench = Bench::new();
    let baseline = bench.baseline();
    let recording = bench.record("same.mcap", SIGNAL, |_| {});
    let log = log(&bench, "log", "raw = { keep = \"all\" }\n");
    let said = output(&["info", &log]);
    assert_eq!(said.status.code(), Some(0), "{}", stderr(&said));
    for wanted in
        ["log of the service, written by gearwatch-log", "/gear/stage1/rank: 46 messages", "acc_1: 24576 samples"]
    {
        assert!(stdout(&said).contains(wanted), "{wanted:?} is not in {}", stdout(&said));
    }
    let (sheet, normal) = (bench.path("bench.toml"), text(&baseline).to_owned());
    let judge = |command: &[&str], file: &str| {
        let done = output(&[command, &[file, "--bench", text(&sheet), "--baseline", &normal]].concat());
        stdout(&done).replace(file, "FILE")
    };
    for command in [&["diagnose", "--format", "csv"][..], &["diagnose", "--windows"], &["replay"]] {
        let (ours, theirs) = (judge(command, &log), judge(command, text(&recording)));
        assert!(ours.lines().count() > 2, "{command:?}: {ours}");
        assert_eq!(ours, theirs, "{command:?}");
    }
    let parts = bench.path("parts");
    let args = ["batch", &log, "--bench", text(&sheet), "--baseline", &normal, "--out", text(&parts)];
    let done = output(&args);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    assert!(stdout(&done).contains("46 rows"), "{}", stdout(&done));
}

/// A log without raw data is no damaged recording: `info` tells its topics, and commands that need samples say which key keeps them.
#[test]
fn regress_a_log_without_raw_data_is_told_from_a_bad_recording() {
    let bench = Bench::new();
    bench.baseline();
    let log = log(&bench, "log", "");
    let said = output(&["info", &log]);
    assert_eq!(said.status.code(), Some(0), "{}", stderr(&said));
    assert!(stdout(&said).contains("/gear/stage1/rank: 46 messages (gearwatch.Verdict)"), "{}", stdout(&said));
    let done = output(&["diagnose", &log, "--bench", text(&bench.path("bench.toml"))]);
    assert_eq!(done.status.code(), Some(3));
    assert!(stderr(&done).contains("keeps no raw data"), "{}", stderr(&done));
}
