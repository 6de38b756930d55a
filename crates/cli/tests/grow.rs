//! `gearwatch grow` as users run it.

use std::path::Path;
use std::process::{Command, Output};

fn grow(arguments: &[&str], folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gearwatch"));
    let output = command.arg("grow").args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

/// The same seed gives the same bytes, of every file and on standard output.
#[test]
fn conform_the_same_seed_gives_the_same_bytes() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let arguments = [
        ["single-pair", "--effect", "pitting@stage1.pinion"].as_slice(),
        &["--torque", "400", "--hours", "300", "--steps", "3", "--seed", "5"],
        &["--out", "pits.csv", "--plot", "pits.svg", "--record", "pits.mcap", "--record-length", "1"],
    ]
    .concat();
    let said = folders.each_ref().map(|folder| grow(&arguments, folder.path()).stdout);
    assert_eq!(said[0], said[1]);
    for name in ["pits.csv", "pits.svg", "pits.mcap"] {
        let read = |folder: &tempfile::TempDir| std::fs::read(folder.path().join(name)).unwrap();
        assert_eq!(read(&folders[0]), read(&folders[1]), "{name}");
    }
}

/// The table has a row a step, sensor and stage, and its sizes do not fall; the recordings of the
/// steps are found by their names.
#[test]
fn conform_tables_and_recordings_of_all_steps() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [
        ["paper-rig", "--effect", "tooth_wear@stage2", "--hours", "100", "--steps", "2"].as_slice(),
        &["--duty", "30:202:0.5", "--duty", "1200rpm:100:0.5", "--hours-a-day", "8"],
        &["--out", "wear.csv", "--record", "weeks", "--record-length", "1"],
    ]
    .concat();
    grow(&arguments, folder.path());
    let mut table = csv::Reader::from_path(folder.path().join("wear.csv")).unwrap();
    let head = table.headers().unwrap().clone();
    let column = |name: &str| head.iter().position(|column| column == name).unwrap_or_else(|| panic!("{head:?}"));
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 3 * 2 * 2);
    let number = |row: &csv::StringRecord, name: &str| row[column(name)].parse::<f64>().unwrap();
    assert!(rows.windows(2).all(|pair| number(&pair[1], "size") >= number(&pair[0], "size")));
    let last = rows.last().unwrap();
    assert_eq!([number(last, "hours"), number(last, "days")], [100.0, 12.5]);
    assert!(number(last, "amp_1x_m_per_s2") > 0.0 && !last[column("1x_rank")].is_empty());
    for step in 0..3 {
        assert!(folder.path().join(format!("weeks/step-{step:04}.mcap")).is_file());
    }
}

/// What is typed wrong is refused with what would be right.
#[test]
fn conform_wrong_input_is_refused() {
    let refused = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gearwatch"));
        let output = command.arg("grow").args(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(3), "{arguments:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let wear = ["single-pair", "--effect", "tooth_wear@stage1"];
    let with = |more: &[&str]| refused(&[wear.as_slice(), more].concat());
    assert!(with(&["--law", "k=1e-17"]).contains("k_m2_per_n"));
    assert!(with(&["--law", "k_m2_per_n=5"]).contains("usual"));
    assert!(with(&["--duty", "25:60:0.4"]).contains("shares"));
    assert!(with(&["--hours-a-day", "30"]).contains("24"));
    assert!(with(&["--plot", "a.png"]).contains(".svg"));
    assert!(refused(&["planetary-parallel", "--effect", "tooth_wear@planetary"]).contains("planets"));
    assert!(refused(&["single-pair", "--effect", "unbalance@input"]).contains("law of growth"));
}
