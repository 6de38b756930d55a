//! Exit codes and forms of `diagnose`.

use super::fixture::{Bench, output, stderr, stdout, text};

/// The code and the printed result of a diagnosis.
fn diagnose(bench: &Bench, recording: &std::path::Path, further: &[&str]) -> (Option<i32>, String) {
    let (file, baseline) = (bench.path("bench.toml"), bench.path("baseline.json"));
    let fixed = ["diagnose", text(recording), "--bench", text(&file), "--baseline", text(&baseline)];
    let output = output(&[&fixed, further].concat());
    (output.status.code(), stdout(&output))
}

#[test]
fn conform_exit_codes_of_a_diagnosis() {
    let bench = Bench::new();
    bench.baseline();
    let healthy = bench.healthy();
    assert_eq!(diagnose(&bench, &healthy, &[]).0, Some(0));
    let warning = bench.faulty("warning.mcap", [0.0, 5.0, 0.0, 0.0, 0.0]);
    let critical = bench.faulty("critical.mcap", [0.0, 5.0, 0.0, 0.0, 25.0]);
    assert_eq!(diagnose(&bench, &warning, &[]).0, Some(1));
    assert_eq!(diagnose(&bench, &critical, &[]).0, Some(2));
    // Of several recordings the worst counts.
    assert_eq!(diagnose(&bench, &healthy, &[text(&critical), text(&warning)]).0, Some(2));
    // Without a baseline nothing is known.
    let without = output(&["diagnose", text(&healthy), "--bench", text(&bench.path("bench.toml"))]);
    assert_eq!(without.status.code(), Some(3));
    assert!(stdout(&without).contains("unknown (no baseline)"), "{}", stdout(&without));
}

#[test]
fn conform_forms_of_a_diagnosis() {
    let bench = Bench::new();
    bench.baseline();
    let recording = bench.faulty("critical.mcap", [0.0, 5.0, 0.0, 0.0, 25.0]);
    let (_, table) = diagnose(&bench, &recording, &[]);
    assert!(table.contains("stage1 at acc_1: alarm"), "{table}");
    assert!(!table.contains('\u{1b}'), "no colours into a pipe");
    let (code, json) = diagnose(&bench, &recording, &["--format", "json"]);
    assert_eq!(code, Some(2));
    let objects: Vec<serde_json::Value> = json.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(objects.len(), 2);
    assert_eq!(objects[0]["rank_2x"], "II");
    assert_eq!(objects[0]["rank_5x"], "V");
    // 23 windows of 12 s, averaged.
    assert_eq!(objects[0]["windows"], 23);
    let (_, csv) = diagnose(&bench, &recording, &["--format", "csv"]);
    let mut reader = csv::Reader::from_reader(csv.as_bytes());
    let column = reader.headers().unwrap().iter().position(|name| name == "rank_5x").unwrap();
    let rows: Vec<csv::StringRecord> = reader.records().collect::<Result<_, _>>().unwrap();
    assert!(rows.len() == 2 && rows.iter().all(|row| &row[column] == "V"), "{csv}");
    let (code, nagios) = diagnose(&bench, &recording, &["--format", "nagios"]);
    assert_eq!(code, Some(2));
    assert_eq!(nagios.lines().count(), 1, "{nagios}");
    assert!(nagios.starts_with("GEARWATCH CRITICAL - stage1 acc_"), "{nagios}");
    assert!(nagios.contains("(rank V)|'acc_1/stage1 1x'="), "{nagios}");
}

/// Instrument faults are never taken for a state of the gears: each recording is unknown, and says
/// why.
#[test]
fn conform_instrument_faults_are_unknown() {
    use gearwatch_core::block::{Packet, Samples};
    let bench = Bench::new();
    bench.baseline();
    let spoil = |name: &str, spoiled: fn(usize, f32) -> f32| {
        bench.record(name, "duration_secs = 6.0", |packet| {
            if let Packet::Vibration(block) = packet
                && let Samples::Physical(values) = &mut block.samples
            {
                for (i, value) in values.iter_mut().enumerate() {
                    *value = spoiled(i, *value);
                }
            }
        })
    };
    let cases = [
        ("nan.mcap", (|i, v| if i == 17 { f32::NAN } else { v }) as fn(usize, f32) -> f32, "not_finite"),
        ("inf.mcap", |i, v| if i == 17 { f32::INFINITY } else { v }, "not_finite"),
        ("flat.mcap", |_, _| 0.25, "channel_dead"),
        ("clipped.mcap", |_, v| v.clamp(-0.8, 0.8), "overload"),
    ];
    for (name, spoiled, reason) in cases {
        let (code, table) = diagnose(&bench, &spoil(name, spoiled), &[]);
        assert_eq!(code, Some(3), "{name}: {table}");
        assert!(table.contains(reason), "{name}: {table}");
        assert!(!table.contains("normal\u{1b}") && !table.contains(": normal"), "{name}: {table}");
    }
}

#[test]
fn conform_no_arguments_and_wrong_arguments_are_usage_errors() {
    for args in [&[][..], &["diagnose"], &["no-such-command"], &["replay", "x", "--speed", "fast"]] {
        let output = output(args);
        assert_eq!(output.status.code(), Some(3), "{args:?}: {}", stderr(&output));
        assert!(output.stdout.is_empty());
    }
}
