//! `gearwatch signatures` and what matches verdicts with its table, as a user runs them.

use std::path::Path;
use std::process::{Command, Output};

fn gearwatch(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gearwatch"))
        .current_dir(folder)
        .args(args)
        .env("GEARWATCH_LOG", "warn")
        .output()
        .expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn succeed(folder: &Path, args: &[&str]) -> String {
    let done = gearwatch(folder, args);
    assert!(done.status.code().is_some_and(|code| code < 3), "{args:?}: {}", text(&done.stderr));
    text(&done.stdout)
}

/// The table of a bench is written, checked when it is read, and names the fault that a recording
/// of the same bench was simulated with.
#[test]
fn conform_verdicts_are_matched_with_the_table_of_the_bench() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let shipped = gearwatch_sim::shipped::BENCHES.iter().find(|shipped| shipped.name == "single-pair").unwrap();
    std::fs::write(path.join("bench.toml"), shipped.text).unwrap();

    let said = succeed(path, &["signatures", "bench.toml", "--out", "table.json"]);
    assert!(said.contains("broken_total") && said.contains("of the paper's table 4"), "{said}");
    // The tables have heads, and lines that a terminal holds.
    assert_eq!(said.lines().filter(|line| line.starts_with("  state ") && line.ends_with("5x")).count(), 2, "{said}");
    assert!(
        said.lines().filter(|line| line.starts_with("  compound_")).all(|line| line.chars().count() < 110),
        "{said}"
    );

    succeed(path, &["simulate", "bench.toml", "--duration", "40", "-o", "normal.mcap"]);
    let broken = "tooth_breakage@stage1.pinion:fraction=1.0";
    succeed(
        path,
        &["simulate", "bench.toml", "--effect", broken, "--duration", "20", "--seed", "2", "-o", "broken.mcap"],
    );
    succeed(path, &["baseline", "learn", "normal.mcap", "--bench", "bench.toml", "-o", "normal.json"]);
    let diagnose = ["diagnose", "broken.mcap", "-b", "bench.toml", "-n", "normal.json", "--format", "json"];
    let with_table = succeed(path, &[&diagnose[..], &["--signatures", "table.json"]].concat());
    assert!(with_table.contains("broken_"), "{with_table}");
    assert_ne!(with_table, succeed(path, &diagnose), "the table makes no difference");

    // A table that was changed, and one of another bench, are refused.
    let table = std::fs::read_to_string(path.join("table.json")).unwrap();
    std::fs::write(path.join("changed.json"), table.replacen("0.1", "0.2", 1)).unwrap();
    std::fs::write(path.join("other.toml"), shipped.text.replace("teeth = 57", "teeth = 59")).unwrap();
    for (bench, table, wanted) in [
        ("bench.toml", "changed.json", "checksum"),
        ("other.toml", "table.json", "other content"),
        ("bench.toml", "none.json", "none.json"),
        ("bench.toml", "bench.toml", "not a signature file"),
    ] {
        let done = gearwatch(path, &["diagnose", "broken.mcap", "-b", bench, "--signatures", table]);
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(3), "{said}");
        assert!(said.contains(wanted), "{table}: {said}");
    }
}
