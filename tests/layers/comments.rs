//! Comments wrap at 100 columns, so that they can be read beside each other and in a review.

use std::path::{Path, PathBuf};

const COLUMNS: usize = 100;

/// Rust files below a folder, those of builds excepted.
fn files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("the folder is there").flatten() {
        let path = entry.path();
        match path.is_dir() {
            true if entry.file_name() != "target" => files(&path, out),
            false if path.extension().is_some_and(|e| e == "rs") => out.push(path),
            _ => {}
        }
    }
}

/// Numbers of the comment lines that are longer, pictures and tables excepted.
fn longer(text: &str) -> Vec<usize> {
    let mut picture = false;
    let mut out = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let Some(comment) = line.trim_start().strip_prefix("//") else { continue };
        let words = comment.trim_start_matches(['/', '!']).trim_start();
        picture ^= words.starts_with("```");
        if !picture && !words.starts_with('|') && line.chars().count() > COLUMNS {
            out.push(k + 1);
        }
    }
    out
}

#[test]
fn conform_comments_wrap_at_a_hundred_columns() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the workspace");
    let mut all = Vec::new();
    ["crates", "tests", "fuzz"].iter().for_each(|folder| files(&root.join(folder), &mut all));
    assert!(all.len() > 100, "{} files", all.len());
    let found: Vec<String> = all
        .iter()
        .flat_map(|path| {
            let text = std::fs::read_to_string(path).expect("a source file is text");
            longer(&text).into_iter().map(move |line| format!("{}:{line}", path.display()))
        })
        .collect();
    assert!(found.is_empty(), "comments longer than {COLUMNS} columns: {found:#?}");
}

#[test]
fn analytic_long_comments_are_found() {
    let long = "x".repeat(COLUMNS);
    let text = format!(
        "/// {long}\n//! ```text\n//! {long}\n//! ```\n// | {long} |\nlet s = \"{long}\"; // {long}\n    // {long}\n"
    );
    assert_eq!(longer(&text), [1, 7]);
}
