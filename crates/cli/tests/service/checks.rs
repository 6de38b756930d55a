//! What is wrong with sheet or recording is refused, what is doubtful stands beside every verdict,
//! and neither is a gear alarm.

use gearwatch_core::block::Packet;

use super::fixture::{BENCH, Bench, output, stderr, stdout, text};

fn diagnose(bench: &Bench, recording: &std::path::Path, further: &[&str]) -> std::process::Output {
    let (file, baseline) = (bench.path("bench.toml"), bench.path("baseline.json"));
    let fixed = ["diagnose", text(recording), "--bench", text(&file), "--baseline", text(&baseline)];
    output(&[&fixed, further].concat())
}

/// Twice the rate on the command line: of an MCAP file it was ignored in silence, of others it made
/// alarms.
#[test]
fn regress_a_wrong_rate_is_refused_and_no_alarm() {
    let bench = Bench::new();
    bench.baseline();
    let recording = bench.healthy();
    let refused = diagnose(&bench, &recording, &["--sample-rate", "4096"]);
    assert_eq!(refused.status.code(), Some(3), "{}", stdout(&refused));
    assert!(stdout(&refused).is_empty() && stderr(&refused).contains("[sample_rate]"), "{}", stderr(&refused));
    let file = bench.path("bench.toml");
    let learn = ["baseline", "learn", text(&recording), "-b", text(&file), "-o", "x.json", "--sample-rate", "4096"];
    let learned = output(&learn);
    assert_eq!(learned.status.code(), Some(3));
    assert!(
        !std::path::Path::new("x.json").exists() && stderr(&learned).contains("[sample_rate]"),
        "{}",
        stderr(&learned)
    );
}

/// A load that is not stated: said in so many words, in each verdict, and by `check`, for people
/// and for programs.
#[test]
fn regress_a_missing_torque_is_said() {
    let bench = Bench::new();
    bench.baseline();
    let recording = bench.record("unstated.mcap", "duration_secs = 12.0\nseed = 9", |packet| {
        if let Packet::OperatingPoint(point) = packet {
            point.brake_torque_nm = f64::NAN;
        }
    });
    let said = diagnose(&bench, &recording, &["--format", "json"]);
    assert_eq!(said.status.code(), Some(3));
    for line in stdout(&said).lines() {
        let object: serde_json::Value = serde_json::from_str(line).unwrap();
        assert_eq!(
            (&object["reason"], &object["doubts"]),
            (&"torque_missing".into(), &"torque_missing".into()),
            "{line}"
        );
    }
    let file = bench.path("bench.toml");
    let checked = output(&["check", text(&file), text(&recording), "--format", "json"]);
    assert_eq!(checked.status.code(), Some(1), "{}", stdout(&checked));
    let object: serde_json::Value = serde_json::from_str(&stdout(&checked)).unwrap();
    assert_eq!((&object["worst"], &object["findings"][0]["id"]), (&"doubtful".into(), &"torque_missing".into()));
    // Looked into, and no doubt from then on.
    bench.write("bench.toml", &format!("{BENCH}check = {{ cleared = [\"torque_missing\"] }}\n"));
    let cleared = output(&["check", text(&file), text(&recording)]);
    assert_eq!(cleared.status.code(), Some(0), "{}", stdout(&cleared));
    let still = diagnose(&bench, &bench.healthy(), &[]);
    assert_eq!(still.status.code(), Some(0), "the baseline is that of the same bench: {}", stderr(&still));
}

/// A recording that is judged by itself, and one that was cut short.
#[test]
fn regress_a_recording_of_the_baseline_and_a_short_one_are_told() {
    let bench = Bench::new();
    let recording = bench.healthy();
    let (file, baseline) = (bench.path("bench.toml"), bench.path("baseline.json"));
    let learned = output(&["baseline", "learn", text(&recording), "-b", text(&file), "-o", text(&baseline)]);
    assert_eq!(learned.status.code(), Some(0), "{}", stderr(&learned));
    let itself = stdout(&diagnose(&bench, &recording, &[]));
    assert!(itself.contains("it is in the baseline itself (healthy.mcap"), "{itself}");
    let short = bench.record("short.mcap", "duration_secs = 14.0\nseed = 8", |_| {});
    let short = stdout(&diagnose(&bench, &short, &[]));
    assert!(short.contains("if it was cut short, its end was not judged"), "{short}");
    assert!(!short.contains("in the baseline itself"), "{short}");
}

/// rpm where people type speeds.
#[test]
fn conform_speeds_may_be_typed_in_rpm() {
    let bench = Bench::new();
    let recording = bench.record("run.mcap", "duration_secs = 12.0\nseed = 9", |_| {});
    let file = bench.write("rpm.toml", &BENCH.replace("speed_hz = 5.0", "speed_rpm = 300.0"));
    let checked = output(&["check", text(&file), text(&recording), "--motor-speed", "300rpm", "--torque", "10"]);
    assert_eq!(checked.status.code(), Some(0), "{}{}", stdout(&checked), stderr(&checked));
    let info = stdout(&output(&["info", text(&file)]));
    assert!(info.contains("motor 5.0000 Hz (300.0 rpm)"), "{info}");
}
