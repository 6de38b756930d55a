//! The crates may only look downward: core ← sim ← explain, core ← io, then daemon, then cli.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// For each crate: what it must never depend on directly, siblings and outside crates alike.
const FORBIDDEN: &[(&str, &[&str])] = &[
    (
        "gearwatch-core",
        &["gearwatch-sim", "gearwatch-io", "gearwatch-explain", "gearwatch-daemon", "tokio", "mcap", "clap"],
    ),
    ("gearwatch-sim", &["gearwatch-io", "gearwatch-explain", "gearwatch-daemon", "tokio", "mcap", "clap"]),
    (
        "gearwatch-check",
        &["gearwatch-sim", "gearwatch-io", "gearwatch-explain", "gearwatch-daemon", "tokio", "mcap", "clap"],
    ),
    ("gearwatch-io", &["gearwatch-sim", "gearwatch-explain", "gearwatch-daemon", "tokio", "clap"]),
    ("gearwatch-explain", &["gearwatch-io", "gearwatch-daemon", "tokio", "mcap", "clap"]),
    ("gearwatch-daemon", &["clap"]),
    ("gearwatch-batch", &["gearwatch-daemon", "tokio", "clap"]),
    (
        "gearwatch-report",
        &["gearwatch-core", "gearwatch-sim", "gearwatch-io", "gearwatch-explain", "gearwatch-daemon", "clap"],
    ),
    ("gearwatch", &["realfft", "rustfft"]),
];

fn direct_dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let out = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .output()
        .expect("cargo metadata runs");
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).expect("cargo metadata prints JSON");
    let packages = json["packages"].as_array().expect("packages");
    packages
        .iter()
        .map(|p| {
            let deps = p["dependencies"].as_array().expect("dependencies").iter();
            let normal = deps.filter(|d| d["kind"].is_null()).map(|d| d["name"].as_str().unwrap().to_owned());
            (p["name"].as_str().unwrap().to_owned(), normal.collect())
        })
        .collect()
}

#[test]
fn conform_no_crate_looks_upward() {
    let dependencies = direct_dependencies();
    for (name, forbidden) in FORBIDDEN {
        let has = dependencies.get(*name).unwrap_or_else(|| panic!("the workspace has no crate {name}"));
        for dependency in *forbidden {
            assert!(!has.contains(*dependency), "{name} must not depend on {dependency}");
        }
    }
}

/// The pure crates read no clock, open no file and start no thread.
#[test]
fn conform_pure_crates_touch_no_outside_world() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("workspace root");
    for name in ["core", "check", "sim", "explain"] {
        let mut folders = vec![root.join("crates").join(name).join("src")];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(&folder).expect("source folder") {
                let path = entry.expect("entry").path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.extension().is_some_and(|e| e == "rs") {
                    let text = std::fs::read_to_string(&path).expect("source file");
                    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
                    for word in
                        ["std::fs", "std::net", "std::thread", "SystemTime", "Instant::now", "HashMap", "HashSet"]
                    {
                        assert!(!code.contains(word), "{} uses {word}", path.display());
                    }
                }
            }
        }
    }
}
