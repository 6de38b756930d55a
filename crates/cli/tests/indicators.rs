//! `gearwatch indicators` and `gearwatch history` as a user runs them.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

const BENCH: &str = include_str!("../../../examples/indicators/bench.toml");

fn gearwatch(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gearwatch")).current_dir(folder).args(args).output().expect("the binary runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn done(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    text(&output.stdout)
}

fn simulate(folder: &Path, name: &str, seed: &str, more: &[&str]) {
    let args = ["simulate", "bench.toml", "--duration", "4", "--background", "0.02", "--seed", seed, "-o", name];
    done(&gearwatch(folder, &[&args[..], more].concat()));
}

/// A cracked root that 1x to 5x say little of raises FM4 of its gear far above three healthy
/// recordings; RMS stays within a percent. JSON and CSV say the same numbers, and a bearing has its
/// four depths.
#[test]
fn conform_a_cracked_tooth_shows_in_its_gear() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let bearing = "\n[[bearing]]\nname = \"drive end\"\nshaft = \"input\"\norders = { outer = 3.58, inner = 5.42, element = 2.36, cage = 0.4 }\n";
    std::fs::write(path.join("bench.toml"), format!("{BENCH}{bearing}")).unwrap();
    for seed in ["1", "2", "3"] {
        simulate(path, &format!("healthy{seed}.mcap"), seed, &[]);
    }
    simulate(path, "crack.mcap", "9", &["--effect", "root_crack@stage1.pinion:depth_mm=1.5"]);
    let healthy = ["--healthy", "healthy1.mcap", "healthy2.mcap", "healthy3.mcap"];
    let base = ["indicators", "bench.toml", "crack.mcap"];
    let csv = done(&gearwatch(path, &[&base[..], &healthy, &["--csv"]].concat()));
    let json = gearwatch(path, &[&base[..], &healthy, &["--json"]].concat());
    assert!(text(&json.stderr).contains("the kurtogram of crack.mcap proposes"), "{}", text(&json.stderr));
    let rows: Vec<serde_json::Value> =
        done(&json).lines().map(|line| serde_json::from_str(line).expect("an object a line")).collect();
    assert_eq!(rows.len() + 1, csv.lines().count());
    let of = |place: &str, name: &str, field: &str| {
        let row = rows.iter().find(|row| row["place"] == place && row["indicator"] == name);
        row.unwrap_or_else(|| panic!("no {name} at {place:?}"))[field].as_f64().unwrap_or(f64::NAN)
    };
    // Beyond what the table marks.
    assert!(of("stage1.pinion", "fm4", "z") > 4.0, "{}", of("stage1.pinion", "fm4", "z"));
    assert!(of("stage1.pinion", "na4_star", "value") > 10.0 * of("stage1.pinion", "na4", "value"));
    assert!(of("", "rms", "dev_percent").abs() < 1.0);
    assert!(of("drive end.outer", "envelope_depth", "value") > 0.0);
    let table = done(&gearwatch(path, &[&base[..], &healthy].concat()));
    let fm4: BTreeMap<bool, usize> = table.lines().filter(|l| l.contains(" fm4 ")).fold(BTreeMap::new(), |mut n, l| {
        *n.entry(l.contains('!')).or_default() += 1;
        n
    });
    assert!(fm4[&true] >= 1 && fm4.get(&false).copied().unwrap_or(0) >= 1, "{table}");
}

/// What cannot be used exits with 3 and says what and where.
#[test]
fn conform_bad_input_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("bench.toml"), BENCH).unwrap();
    simulate(path, "short.mcap", "1", &[]);
    let twice = format!("{BENCH}\n[[bearing]]\nname = \"x\"\nshaft = \"nowhere\"\nelements = 9\n");
    std::fs::write(path.join("wrong.toml"), twice).unwrap();
    std::fs::create_dir(path.join("empty")).unwrap();
    for (args, wanted) in [
        (&["indicators", "bench.toml", "none.mcap"][..], "none.mcap"),
        (&["indicators", "bench.toml", "short.mcap", "--window", "60"], "no channel has 60 s without a gap"),
        (&["indicators", "bench.toml", "short.mcap", "--window", "nan"], "--window is NaN"),
        (&["indicators", "bench.toml", "short.mcap", "--envelope", "4000:2000"], "expected LOW:HIGH in Hz"),
        (&["indicators", "wrong.toml", "short.mcap"], "bearing \"x\" sits on shaft \"nowhere\""),
        (&["history", "empty"], "holds no log file"),
        (&["history", "short.mcap"], "the logs hold none"),
        (&["history", "short.mcap", "--every", "1y"], "is not a span"),
        (&["history", "short.mcap", "--from", "2026-11-22", "--to", "2026-11-01"], "is not before --to"),
    ] {
        let output = gearwatch(path, args);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{args:?}: {said}");
        assert!(said.contains(wanted), "{args:?}: {said}");
    }
}
