//! What commands write: never over what they read, never over what is there without leave, and
//! never half.

mod small;

use std::path::Path;
use std::process::Output;

use small::{BENCH, gearwatch, text};

fn stderr(output: &Output) -> String {
    text(&output.stderr)
}

/// A folder with a bench, a table, and names of them by links of both kinds.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("bench.toml"), BENCH).unwrap();
    std::fs::write(path("rec.csv"), "a\n".to_owned() + &"1.5\n-1.5\n".repeat(2000)).unwrap();
    std::fs::write(path("rec.csv.toml"), "sample_rate_hz = 1000.0\nunit = \"g\"\n").unwrap();
    std::fs::write(path("scenario.toml"), "format = \"gearwatch-scenario/1\"\nduration_s = 0.2\n").unwrap();
    std::fs::write(path("one.json"), "{}").unwrap();
    for (link, of) in [("html", "rec.csv"), ("mcap", "rec.csv"), ("parquet", "rec.csv"), ("svg", "scenario.toml")] {
        std::os::unix::fs::symlink(of, path(&format!("soft.{link}"))).unwrap();
        std::fs::hard_link(path(of), path(&format!("hard.{link}"))).unwrap();
    }
    std::fs::create_dir(path("answer")).unwrap();
    std::os::unix::fs::symlink("../bench.toml", path("answer/bench.toml")).unwrap();
    std::os::unix::fs::symlink("rec.csv.toml", path("sidecar.mcap")).unwrap();
    folder
}

/// The content of every file, links followed.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap())
        .filter(|entry| entry.path().is_file())
        .map(|entry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap()))
        .collect();
    all.sort();
    all
}

/// Every command that writes, with each of its inputs named as output: by its own name, through a
/// symbolic and through a hard link, and the sidecar file. `--force` does not help.
#[test]
fn regress_no_output_overwrites_what_is_read() {
    let folder = folder();
    let before = contents(folder.path());
    let cases: &[&[&str]] = &[
        &["convert", "rec.csv", "soft.mcap"],
        &["convert", "rec.csv", "./hard.mcap"],
        &["convert", "rec.csv", "sidecar.mcap"],
        &["diagnose", "rec.csv", "--bench", "bench.toml", "--report", "rec.csv"],
        &["diagnose", "rec.csv", "--bench", "bench.toml", "--report", "soft.html"],
        &["diagnose", "rec.csv", "--bench", "bench.toml", "--report", "bench.toml"],
        &["baseline", "learn", "rec.csv", "--bench", "bench.toml", "-o", "rec.csv"],
        &["baseline", "learn", "rec.csv", "--bench", "bench.toml", "-o", "bench.toml"],
        &["baseline", "merge", "one.json", "rec.csv", "-o", "one.json"],
        &["simulate", "bench.toml", "--scenario", "scenario.toml", "--plot", "soft.svg"],
        &["simulate", "bench.toml", "--scenario", "scenario.toml", "--plot", "hard.svg"],
        &["signatures", "bench.toml", "--out", "bench.toml"],
        &["sweep", "bench.toml", "rec.csv", "--out", "rec.csv"],
        &["sweep", "bench.toml", "rec.csv", "--out", "hard.parquet"],
        &["layout", "bench.toml", "-o", "bench.toml"],
        &["explain", "bench.toml", "rec.csv", "--out", "answer"],
        &["explain", "bench.toml", "rec.csv", "--report", "hard.html"],
        &["recover", "rec.csv", "-o", "soft.mcap"],
    ];
    for args in cases {
        let done = gearwatch(folder.path(), &[args, &["--force"][..]].concat());
        let wanted = if args[0] == "recover" { 1 } else { 3 };
        assert_eq!(done.status.code(), Some(wanted), "{args:?}: {}", stderr(&done));
        assert!(stderr(&done).contains("which this command reads"), "{args:?}: {}", stderr(&done));
        assert_eq!(contents(folder.path()), before, "{args:?}");
    }
}

/// Every command that writes keeps a file that is there, and replaces it with `--force`; a link
/// stays a link.
#[test]
fn regress_what_exists_is_replaced_only_by_force() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("elsewhere")).unwrap();
    let cases: &[(&[&str], &str)] = &[
        (&["convert", "rec.csv", "out.mcap"], "out.mcap"),
        (&["simulate", "bench.toml", "--scenario", "scenario.toml", "-o", "out.mcap"], "out.mcap"),
        (&["simulate", "bench.toml", "--scenario", "scenario.toml", "--plot", "out.svg"], "out.svg"),
        (&["layout", "bench.toml", "-o", "out.json"], "out.json"),
        (&["signatures", "bench.toml", "--out", "out.json"], "out.json"),
        (&["signatures", "bench.toml", "--report", "out.html"], "out.html"),
        (&["sweep", "bench.toml", "--duration", "2", "--out", "out.csv"], "out.csv"),
        (&["sweep", "bench.toml", "--duration", "2", "--plot", "out.html"], "out.html"),
    ];
    for (args, name) in cases {
        std::fs::write(path("elsewhere/precious"), "precious").unwrap();
        std::os::unix::fs::symlink("elsewhere/precious", path(name)).unwrap();
        let done = gearwatch(folder.path(), args);
        assert_eq!(done.status.code(), Some(3), "{args:?}: {}", stderr(&done));
        assert!(stderr(&done).contains("exists already; --force overwrites it"), "{args:?}: {}", stderr(&done));
        assert_eq!(std::fs::read(path("elsewhere/precious")).unwrap(), b"precious", "{args:?}");
        let done = gearwatch(folder.path(), &[args, &["--force"][..]].concat());
        assert_eq!(done.status.code(), Some(0), "{args:?}: {}", stderr(&done));
        assert!(path(name).symlink_metadata().unwrap().is_symlink(), "{args:?}");
        assert!(std::fs::read(path("elsewhere/precious")).unwrap().len() > 100, "{args:?}");
        assert_eq!(std::fs::read_dir(path("elsewhere")).unwrap().count(), 1, "{args:?}: something is left beside it");
        std::fs::remove_file(path(name)).unwrap();
    }
}

/// Manual pages, pictures of modes and the parts of a batch keep what is there too.
#[test]
fn regress_pages_and_parts_are_replaced_only_by_force() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("pages")).unwrap();
    std::fs::create_dir(path("parts")).unwrap();
    let part = "parts/part-00001-of-00001.parquet";
    let cases: &[(&[&str], &str)] = &[
        (&["man", "--folder", "pages"], "pages/gearwatch-run.1"),
        (&["modes", "bench.toml", "--plot", "out.html"], "out.html"),
        (&["batch", "rec.csv", "--bench", "bench.toml", "--any-rate", "--out", "parts"], part),
    ];
    for (args, name) in cases {
        std::fs::write(path(name), "precious").unwrap();
        let done = gearwatch(folder.path(), args);
        assert_eq!(done.status.code(), Some(3), "{args:?}: {}", stderr(&done));
        assert!(stderr(&done).contains("exists already"), "{args:?}: {}", stderr(&done));
        assert_eq!(std::fs::read(path(name)).unwrap(), b"precious", "{args:?}");
        let done = gearwatch(folder.path(), &[args, &["--force"][..]].concat());
        assert!(matches!(done.status.code(), Some(0 | 3)), "{args:?}: {}", stderr(&done));
        assert_ne!(std::fs::read(path(name)).unwrap(), b"precious", "{args:?}: {}", stderr(&done));
    }
    // No page is written where one of them would be refused.
    std::fs::remove_file(path("pages/gearwatch.1")).unwrap();
    assert_eq!(gearwatch(folder.path(), &["man", "--folder", "pages"]).status.code(), Some(3));
    assert!(!path("pages/gearwatch.1").exists());
}

/// A pipe or a device is no place for a file that is written beside and renamed: as root that would
/// replace `/dev/null`.
#[test]
fn regress_devices_and_folders_are_not_replaced() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("out.mcap")).unwrap();
    for (args, wanted) in [
        (["layout", "bench.toml", "-o", "/dev/null"], "is a device"),
        (["layout", "bench.toml", "-o", "answer"], "is a directory"),
    ] {
        let done = gearwatch(folder.path(), &[&args[..], &["--force"]].concat());
        assert_eq!(done.status.code(), Some(3), "{args:?}");
        assert!(stderr(&done).contains(wanted), "{args:?}: {}", stderr(&done));
    }
    let done = gearwatch(folder.path(), &["convert", "rec.csv", "out.mcap", "--force"]);
    assert!(stderr(&done).contains("is a directory"), "{}", stderr(&done));
}
