//! What the pages on security point to is there.

use std::collections::BTreeSet;
use std::path::Path;

use gearwatch_core::verdict::{Code, InstrumentState};

use crate::page;

/// Texts between backticks.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.lines().flat_map(|line| line.split('`').skip(1).step_by(2))
}

/// A folder of the repository and a name in it, or a recipe of `just`: each is there.
#[test]
fn conform_what_the_security_pages_point_to_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let justfile = page("justfile");
    let recipe = |name: &str| justfile.lines().any(|line| line.split([' ', ':']).next() == Some(name));
    let (mut missing, mut seen) = (Vec::new(), 0);
    for name in [
        "SECURITY.md",
        "docs/security.md",
        "docs/reliability.md",
        "docs/reliability-method.md",
        "docs/reliability-evidence.md",
    ] {
        for text in quoted(&page(name)) {
            let first = text.split(' ').next().unwrap_or_default();
            let (kind, there) = match text.strip_prefix("just ") {
                Some(rest) => (true, recipe(rest.split(' ').next().unwrap_or_default())),
                None => (
                    ["crates/", "packaging/", "fuzz/", "supply-chain/", ".ci/"]
                        .iter()
                        .any(|folder| first.starts_with(folder)),
                    root.join(first).exists(),
                ),
            };
            seen += usize::from(kind);
            // The first key comes with the first release (SECURITY.md).
            if kind && !there && first != "packaging/allowed_signers" {
                missing.push(format!("{name}: {text}"));
            }
        }
    }
    assert!(seen > 40, "only {seen} were found");
    assert!(missing.is_empty(), "{missing:#?}");
}

/// Every row of the tables of duties says by what it is met, or that it is open.
#[test]
fn conform_every_duty_has_its_answer() {
    let text = page("docs/security.md");
    let from = text.find("## Cyber Resilience Act").unwrap();
    let rows: Vec<&str> =
        text[from..].lines().filter(|line| line.starts_with('|') && !line.starts_with("|---")).collect();
    assert!(rows.len() > 60, "{} rows", rows.len());
    for row in rows {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        assert_eq!(cells.len(), 3, "{row}");
        assert!(cells.iter().skip(1).all(|cell| !cell.is_empty()), "{row}");
    }
}

/// Each state of the instrument has one signal of NE 107, and the table names no state that there
/// is not.
#[test]
fn conform_each_instrument_state_has_its_ne_107_signal() {
    let text = page("docs/security.md");
    let from = text.find("## NAMUR NE 107").unwrap();
    let mut named = BTreeSet::new();
    for row in text[from..].lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        assert!(["good", "F", "C", "S", "M"].contains(&cells[1]), "{row}");
        let code = quoted(cells[0]).next().unwrap();
        // What is no state of the instrument says what it is.
        if !cells[0].ends_with(')') {
            assert!(named.insert(code.to_owned()), "{code} twice");
        }
    }
    let all: BTreeSet<String> = InstrumentState::ALL.iter().map(|state| state.code().to_owned()).collect();
    assert_eq!(named, all);
}
