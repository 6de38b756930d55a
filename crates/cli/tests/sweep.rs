//! `gearwatch sweep` as a user runs it.

use std::path::Path;
use std::process::{Command, Output};

fn gearwatch(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gearwatch")).current_dir(folder).args(args).output().expect("the binary runs")
}

fn column(line: &str, head: &str, name: &str) -> String {
    let at = head.split(',').position(|column| column == name).expect("a column");
    line.split(',').nth(at).expect("a field").to_owned()
}

/// Two speeds, healthy and worn: a row a case, speed, channel and stage; wear shows at its own
/// stage alone; the same with one thread and two, and with the same simulation read from a
/// recording.
#[test]
fn conform_a_sweep_sets_cases_side_by_side() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let sweep = |more: &[&str]| {
        let done = gearwatch(folder, &[&["sweep", "paper-rig", "--out", "s.csv", "--force"][..], more].concat());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        std::fs::read_to_string(folder.join("s.csv")).expect("a table")
    };
    let case = ["--case", "worn=tooth_wear@stage1:depth_um=20", "--speeds", "20,30", "--duration", "3"];
    let one = sweep(&[&case[..], &["--jobs", "1", "--plot", "s.html"]].concat());
    assert_eq!(one, sweep(&[&case[..], &["--jobs", "2"]].concat()));
    let (head, rows) = one.split_once('\n').expect("lines");
    let rows: Vec<&str> = rows.lines().collect();
    assert_eq!(rows.len(), 2 * 2 * 2 * 2);
    let level = |case: &str, stage: &str| -> f64 {
        let of = |row: &&&str| {
            column(row, head, "case") == case
                && column(row, head, "stage") == stage
                && column(row, head, "channel") == "acc_1"
        };
        let row = rows.iter().rfind(of).expect("a row");
        column(row, head, "amp_2x").parse().expect("a number")
    };
    assert!((level("worn", "stage1") / level("normal", "stage1") - 1.0).abs() > 0.1);
    assert!((level("worn", "stage2") / level("normal", "stage2") - 1.0).abs() < 0.1);
    assert!(
        std::fs::read_to_string(folder.join("s.html")).expect("pictures").matches("<svg").count() >= 2 * (2 + 2 * 7)
    );

    let done = gearwatch(folder, &["simulate", "paper-rig", "--duration", "3", "--speed", "30", "-o", "r.mcap"]);
    assert!(done.status.success());
    let read = sweep(&["r.mcap"]);
    let (_, recorded) = read.split_once('\n').expect("lines");
    let simulated: Vec<&&str> = rows.iter().filter(|row| row.starts_with("normal") && row.contains(",8.42")).collect();
    assert_eq!(recorded.lines().count(), simulated.len());
    for (recorded, simulated) in recorded.lines().zip(simulated) {
        let value = |row: &str| -> f64 { column(row, head, "rms").parse().expect("a number") };
        assert!((value(recorded) / value(simulated) - 1.0).abs() < 1e-6, "{recorded}\n{simulated}");
    }
}

/// What is wrong is said before the work, with exit code 3.
#[test]
fn conform_a_sweep_says_what_is_wrong() {
    let folder = tempfile::tempdir().expect("a folder");
    for (args, wanted) in [
        (&["sweep", "paper-rig", "--out", "s.txt"][..], ".parquet or .csv"),
        (&["sweep", "paper-rig", "--speeds", "40:10:5"], "no reasonable number"),
        (&["sweep", "paper-rig", "--case", "worn"], "expected NAME=EFFECT"),
        (&["sweep", "paper-rig", "--case", "a=nothing@stage1", "--duration", "2"], "nothing"),
        (&["sweep", "nobench"], "no such file"),
        (&["sweep", "paper-rig", "missing.mcap"], "missing.mcap: cannot be read"),
    ] {
        let done = gearwatch(folder.path(), args);
        let said = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(3), "{args:?}: {said}");
        assert!(said.contains(wanted), "{args:?}: {said}");
    }
}
