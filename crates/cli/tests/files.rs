//! `gearwatch info` and `gearwatch convert` as a user runs them.

use std::path::Path;
use std::process::{Command, Output};

fn gearwatch(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gearwatch")).current_dir(folder).args(args).output().expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn table(rows: usize) -> String {
    let mut out = String::from("a1,a2\n");
    for i in 0..rows {
        out.push_str(&format!("{},{}\n", i % 100, i % 7));
    }
    out
}

/// CSV to MCAP to UFF, each with the same samples by `info`.
#[test]
fn conform_a_table_becomes_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("t.csv"), table(5000)).unwrap();
    let done = gearwatch(
        folder.path(),
        &["convert", "t.csv", "t.mcap", "--sample-rate", "1000", "--unit", "g", "--motor-speed", "25"],
    );
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(done.stdout.is_empty());
    let said = gearwatch(folder.path(), &["info", "t.mcap", "--format", "json"]);
    let json: serde_json::Value = serde_json::from_slice(&said.stdout).unwrap();
    assert_eq!(json["format"], "MCAP");
    assert_eq!(json["channels"]["a1"]["samples"], 5000);
    assert_eq!(json["channels"]["a2"]["unit"], "g");
    assert_eq!(json["operating_points"]["motor_speed_hz"][0], 25.0);
    for form in ["binary", "text"] {
        let done = gearwatch(folder.path(), &["convert", "t.mcap", "t.uff", "--uff", form, "--force"]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        let said = gearwatch(folder.path(), &["info", "t.uff", "--format", "json"]);
        let uff: serde_json::Value = serde_json::from_slice(&said.stdout).unwrap();
        assert_eq!(uff["channels"]["a1"]["rms"], json["channels"]["a1"]["rms"]);
    }
    // What is in it is tested where it is written.
    let done = gearwatch(folder.path(), &["convert", "t.mcap", "t.parquet"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let table = std::fs::read(folder.path().join("t.parquet")).unwrap();
    assert!(table.starts_with(b"PAR1") && table.ends_with(b"PAR1"));
}

/// Usage errors and bad input: exit 3, a message with the file, nothing on stdout, no half-written
/// file.
#[test]
fn conform_bad_input_exits_with_3_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("t.csv"), table(100) + "1,oops\n").unwrap();
    std::fs::write(folder.path().join("empty.mcap"), b"").unwrap();
    std::fs::write(folder.path().join("bench.toml"), "format = \"gearwatch-bench/1\"\nnam = \"x\"\n").unwrap();
    for (args, wanted) in [
        (&["info", "missing.mcap"][..], "missing.mcap: cannot be read"),
        (&["info", "."], "a directory is not supported"),
        (&["info", "empty.mcap"], "empty.mcap: holds no vibration data"),
        (&["info", "bench.toml"], "line 2: unknown key \"nam\"; did you mean \"name\"?"),
        (&["convert", "t.csv", "t.mcap"], "--sample-rate"),
        (&["convert", "t.csv", "t.mcap", "--sample-rate", "10"], "line 102"),
        (
            &["convert", "t.csv", "t.xyz", "--sample-rate", "10"],
            "must end in .mcap, .uff, .csv, .wav, .mat, .tdms or .parquet",
        ),
        (&["convert", "t.csv", "new.mcap", "--sample-rate", "0"], "--sample-rate"),
    ] {
        let out = gearwatch(folder.path(), args);
        assert_eq!(out.status.code(), Some(3), "{args:?}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains(wanted), "{args:?}: {}", text(&out.stderr));
    }
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 3, "{left:?}");
}

/// An existing file is kept unless the user says otherwise.
#[test]
fn conform_convert_does_not_overwrite() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("t.csv"), table(100)).unwrap();
    std::fs::write(folder.path().join("t.mcap"), b"precious").unwrap();
    let args = ["convert", "t.csv", "t.mcap", "--sample-rate", "10", "--unit", "g"];
    let out = gearwatch(folder.path(), &args);
    assert_eq!(out.status.code(), Some(3));
    assert!(text(&out.stderr).contains("--force"), "{}", text(&out.stderr));
    assert_eq!(std::fs::read(folder.path().join("t.mcap")).unwrap(), b"precious");
}

/// A folder without a log was not examined, and is not called whole.
#[test]
fn regress_doctor_does_not_call_an_empty_folder_whole() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("recording.csv"), table(10)).unwrap();
    let done = gearwatch(folder.path(), &["doctor", "."]);
    assert_eq!(done.status.code(), Some(1));
    assert!(done.stdout.is_empty() && text(&done.stderr).contains("holds no log file"), "{}", text(&done.stderr));
}

/// Three files with a channel each are one recording, in which each channel is called as its file;
/// files that cannot be one are refused with what differs.
#[test]
fn regress_one_channel_files_are_joined() {
    let folder = tempfile::tempdir().unwrap();
    let column = |rows: usize, step: usize| -> String {
        std::iter::once("v\n".to_owned()).chain((0..rows).map(|i| format!("{}\n", step * i % 97))).collect()
    };
    for (name, rows, step) in [("a1", 5000, 1), ("a2", 5000, 2), ("a3", 5000, 3), ("short", 4999, 1)] {
        std::fs::write(folder.path().join(format!("{name}.csv")), column(rows, step)).unwrap();
    }
    let said = ["--sample-rate", "1000", "--unit", "g", "--motor-speed", "25"];
    let join = |files: &[&str]| {
        let fixed = ["convert", "a1.csv", "all.mcap", "--join"];
        gearwatch(folder.path(), &[&fixed, files, &said[..]].concat())
    };
    let done = join(&["a2.csv", "a3.csv"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let said = gearwatch(folder.path(), &["info", "all.mcap", "--format", "json"]);
    let json: serde_json::Value = serde_json::from_slice(&said.stdout).unwrap();
    for (name, step) in [("a1", 1), ("a2", 2), ("a3", 3)] {
        let channel = &json["channels"][name];
        assert_eq!((&channel["samples"], &channel["unit"]), (&5000.into(), &"g".into()), "{json}");
        let squares: usize = (0..5000).map(|i| (step * i % 97_usize).pow(2)).sum();
        let rms = (squares as f64 / 5000.0).sqrt();
        assert!((channel["rms"].as_f64().unwrap() / rms - 1.0).abs() < 1e-9, "{name}: {channel}");
    }
    assert_eq!(json["operating_points"]["count"], 1);
    std::fs::remove_file(folder.path().join("all.mcap")).unwrap();
    let refused = join(&["short.csv"]);
    assert_eq!(refused.status.code(), Some(3));
    assert!(text(&refused.stderr).contains("has 4999 samples"), "{}", text(&refused.stderr));
    std::fs::write(folder.path().join("a2.csv.toml"), "sample_rate_hz = 500.0\n").unwrap();
    let refused =
        gearwatch(folder.path(), &["convert", "a1.csv", "all.mcap", "--join", "a3.csv", "a2.csv", "--unit", "g"]);
    assert_eq!(refused.status.code(), Some(3), "{}", text(&refused.stderr));
    assert!(!folder.path().join("all.mcap").exists());
}
