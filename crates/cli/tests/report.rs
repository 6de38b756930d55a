//! Reports as a user gets them.

use std::path::Path;
use std::process::{Command, Output};

fn gearwatch(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gearwatch")).current_dir(folder).args(args).output().expect("the binary runs")
}

/// A worn stage: the report says alarm first, holds its pictures, and loads nothing from anywhere.
#[test]
fn conform_a_diagnosis_can_be_handed_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    std::fs::write(folder.join("bench.toml"), include_str!("../../sim/src/shipped/paper-rig.toml")).expect("written");
    let run = |args: &[&str], codes: &[i32]| {
        let done = gearwatch(folder, args);
        let code = done.status.code();
        assert!(
            code.is_some_and(|c| codes.contains(&c)),
            "{args:?}: {code:?} {}",
            String::from_utf8_lossy(&done.stderr)
        );
    };
    run(&["simulate", "bench.toml", "-o", "normal.mcap", "--duration", "12"], &[0]);
    let worn = ["simulate", "bench.toml", "-o", "worn.mcap", "--duration", "8", "--seed", "2"];
    run(&[&worn[..], &["--effect", "tooth_wear@stage1:depth_um=20"]].concat(), &[0]);
    run(&["baseline", "learn", "normal.mcap", "--bench", "bench.toml", "-o", "normal.json"], &[0]);
    run(&["diagnose", "worn.mcap", "-b", "bench.toml", "-n", "normal.json", "--report", "worn.html"], &[2]);
    let page = std::fs::read_to_string(folder.join("worn.html")).expect("a report");
    assert!(page.contains("class=\"verdict bad\">Alarm: stage1 at acc_1"), "{}", &page[..3000]);
    // A sketch of the train, bars and trends of two stages at two sensors, spectra of two sensors.
    assert_eq!(page.matches("<svg").count(), 1 + 4 + 4 + 2);
    assert!(page.contains("SHA-256") && page.len() < 3_000_000, "{} bytes", page.len());
    assert_eq!(gearwatch_testkit::report::loads(&page), Vec::<String>::new());
    // The curves can be zoomed into: their numbers are in the page, beside the drawings that are
    // printed.
    assert_eq!(page.matches("data-curves=").count(), 4 + 2);
}
