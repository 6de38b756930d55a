//! Logs of the service as recordings: read by the same commands, with the same answers.

use super::fixture::{Bench, output, stderr, stdout, text};

const SIGNAL: &str = "duration_secs = 12.0\nseed = 9\nfault = { after_secs = 0.0, stage = \"stage1\", percent = [0.0, 5.5, 0.0, 0.0, 20.0] }\n";

/// The log of a service over the test signal; `raw` is what it keeps of the samples.
fn log(bench: &Bench, folder: &str, raw: &str) -> String {
    log_of(bench, folder, raw, SIGNAL)
}

fn log_of(bench: &Bench, folder: &str, raw: &str, signal: &str) -> String {
    let config = format!(
        "format = \"gearwatch-service/1\"\nservice = {{ self_test = false }}\n\
         [[bench]]\nfile = \"bench.toml\"\nbaseline = \"baseline.json\"\n\
         [[bench.source]]\nkind = \"test_signal\"\nspeed = \"max\"\nfirst_sample_unix_ns = 1000000000\n{signal}\
         [[sink]]\nkind = \"mcap_log\"\nfolder = \"{folder}\"\n{raw}"
    );
    let done = output(&["run", "--config", text(&bench.write("service.toml", &config))]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let files = std::fs::read_dir(bench.path(folder)).unwrap().map(|entry| entry.unwrap().path());
    let logs: Vec<_> = files.filter(|path| path.extension().is_some_and(|end| end == "mcap")).collect();
    let [log] = &logs[..] else { panic!("one log is expected: {logs:?}") };
    text(log).to_owned()
}

/// A log that keeps all raw data is judged as the recording of the same samples is, line for line,
/// by every command that judges.
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

/// A log without raw data is no damaged recording: `info` tells its topics, and commands that need
/// samples say which key keeps them.
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

/// What a service keeps around a deviation is a recording of its own: every command that reads
/// recordings reads it.
#[test]
fn conform_raw_data_around_deviations_are_read_as_a_recording() {
    let bench = Bench::new();
    let baseline = bench.baseline();
    let signal = SIGNAL.replace("after_secs = 0.0", "after_secs = 8.0");
    let raw = "raw = { keep = \"around_deviations\", level = 4, before_secs = 2.0, after_secs = 1.0, buffer_bytes = 67108864 }\n";
    let log = log_of(&bench, "log", raw, &signal);
    let said = stdout(&output(&["info", &log]));
    let samples = said.split("acc_1: ").nth(1).and_then(|rest| rest.split(" samples").next());
    let samples: u64 = samples.and_then(|number| number.parse().ok()).unwrap_or_else(|| panic!("{said}"));
    // 4 s of 12 deviate; 2 s before them belong to it, and a window and a block of a second may
    // reach further.
    assert!((4 * 2048..=9 * 2048).contains(&samples), "{samples} of 24576 samples: {said}");
    let (sheet, normal) = (bench.path("bench.toml"), text(&baseline).to_owned());
    let with = ["--bench", text(&sheet), "--baseline", &normal];
    // The torque was stated once, long before: without it nothing could be compared. A mean over
    // the change itself is not resolved.
    let judged = output(&[&["diagnose", &log], &with[..]].concat());
    assert!(stdout(&judged).contains("10.0 N m; baseline 5.00 Hz, 10.0 N m"), "{}{}", stdout(&judged), stderr(&judged));
    let windows = output(&[&["diagnose", "--windows", &log], &with[..]].concat());
    assert!(stdout(&windows).contains("\"rank_5x\":\"V\""), "{}{}", stdout(&windows), stderr(&windows));
    let replayed = output(&[&["replay", &log], &with[..]].concat());
    assert!(stdout(&replayed).contains("\"rank_5x\":\"V\""), "{}", stdout(&replayed));
    let parts = bench.path("parts");
    let done = output(&[&["batch", &log], &with[..], &["--out", text(&parts)]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
}

/// Verdicts of several benches in one log lie on topics of their own, which name the bench; their
/// lines name it too.
#[test]
fn conform_topics_of_several_benches_name_the_bench() {
    let bench = Bench::new();
    bench.write("north.toml", &super::fixture::BENCH.replace("\"small\"", "\"north\""));
    let of = |file: &str| {
        format!(
            "[[bench]]\nfile = \"{file}\"\n[[bench.source]]\nkind = \"test_signal\"\nspeed = \"max\"\nduration_secs = 4.0\n"
        )
    };
    let config = format!(
        "format = \"gearwatch-service/1\"\nservice = {{ self_test = false }}\n{}{}[[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\n",
        of("bench.toml"),
        of("north.toml")
    );
    let done = output(&["run", "--config", text(&bench.write("service.toml", &config))]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let mut topics = std::collections::BTreeMap::new();
    for file in std::fs::read_dir(bench.path("log")).unwrap().map(|entry| entry.unwrap().path()) {
        if file.extension().is_some_and(|end| end == "mcap") {
            let bytes = std::fs::read(file).unwrap();
            for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
                if message.channel.topic.starts_with("/gear/") {
                    let line: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
                    assert_eq!(message.channel.topic, format!("/gear/{}/stage1/rank", line["bench"].as_str().unwrap()));
                    *topics.entry(message.channel.topic.clone()).or_insert(0) += 1;
                }
            }
        }
    }
    assert_eq!(
        topics.keys().map(String::as_str).collect::<Vec<_>>(),
        ["/gear/north/stage1/rank", "/gear/small/stage1/rank"]
    );
    assert!(topics.values().all(|&count| count > 4), "{topics:?}");
}
