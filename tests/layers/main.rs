//! The crates may only look downward: core ← sim ← explain, core ← io, then runtime, sources, log,
//! history, daemon, cli.

mod comments;
mod knots;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
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
    ("gearwatch-drivers", &["gearwatch-core", "gearwatch-io", "gearwatch-daemon", "tokio", "clap"]),
    (
        "gearwatch-alarm",
        &["gearwatch-io", "gearwatch-runtime", "gearwatch-log", "gearwatch-daemon", "tokio", "mcap", "clap"],
    ),
    (
        "gearwatch-runtime",
        &["gearwatch-alarm", "gearwatch-log", "gearwatch-sim", "gearwatch-sources", "gearwatch-daemon", "axum", "clap"],
    ),
    (
        "gearwatch-log",
        &[
            "gearwatch-history",
            "gearwatch-sim",
            "gearwatch-sources",
            "gearwatch-daemon",
            "gearwatch-testkit",
            "axum",
            "clap",
        ],
    ),
    (
        "gearwatch-history",
        &["gearwatch-sim", "gearwatch-sources", "gearwatch-daemon", "gearwatch-testkit", "tokio", "axum", "clap"],
    ),
    (
        "gearwatch-sources",
        &[
            "gearwatch-alarm",
            "gearwatch-log",
            "gearwatch-history",
            "gearwatch-daemon",
            "gearwatch-emulate",
            "gearwatch-testkit",
            "axum",
            "clap",
        ],
    ),
    ("gearwatch-daemon", &["clap", "rusqlite", "gearwatch-drivers", "gearwatch-emulate", "gearwatch-testkit"]),
    ("gearwatch-emulate", &["gearwatch-daemon", "gearwatch-log", "gearwatch-history", "clap", "gearwatch-testkit"]),
    ("gearwatch-batch", &["gearwatch-daemon", "tokio", "clap"]),
    (
        "gearwatch-report",
        &["gearwatch-core", "gearwatch-sim", "gearwatch-io", "gearwatch-explain", "gearwatch-daemon", "clap"],
    ),
    ("gearwatch", &["realfft", "rustfft", "gearwatch-testkit"]),
];

fn metadata() -> serde_json::Value {
    let out = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .output()
        .expect("cargo metadata runs");
    serde_json::from_slice(&out.stdout).expect("cargo metadata prints JSON")
}

fn direct_dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let json = metadata();
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

/// All Rust files of a package, as one text.
fn sources(folder: &Path) -> String {
    let (mut out, mut folders) = (String::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("source folder") {
            let path = entry.expect("entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                out.push_str(&std::fs::read_to_string(path).expect("source file"));
            }
        }
    }
    out
}

/// The word `name`, not as a part of another one.
fn names(text: &str, name: &str) -> bool {
    let part = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(name).any(|(at, _)| !text[..at].ends_with(part) && !text[at + name.len()..].starts_with(part))
}

/// A dependency that no file names is compiled for nothing.
#[test]
fn conform_every_dependency_is_used() {
    let json = metadata();
    let mut unused = Vec::new();
    for package in json["packages"].as_array().expect("packages") {
        let manifest = Path::new(package["manifest_path"].as_str().expect("a path"));
        let text = sources(manifest.parent().expect("a folder"));
        for dependency in package["dependencies"].as_array().expect("dependencies") {
            let name = dependency["rename"].as_str().or(dependency["name"].as_str()).expect("a name");
            // The whole program is a dependency of the tests for its features alone.
            let for_features = package["name"] == "gearwatch-tests" && name == "gearwatch";
            if !for_features && !names(&text, &name.replace('-', "_")) {
                unused.push(format!("{}: {name}", package["name"]));
            }
        }
    }
    assert!(unused.is_empty(), "{unused:#?}");
    assert!(names("use a_b::c;", "a_b") && !names("use a_bc::c;", "a_b"));
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
    for name in ["core", "alarm", "check", "sim", "explain"] {
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
