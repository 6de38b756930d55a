//! Recordings to work through, and parts side by side.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use crate::fixture::{Bench, gearwatch, text};

/// A bench with a baseline, so many short recordings, and `list.txt`, a manifest of them.
pub struct Archive {
    pub bench: Bench,
}

impl Archive {
    /// Recordings of so many seconds; each fourth has a fault.
    pub fn new(recordings: usize, seconds: f64) -> Self {
        let bench = Bench::new();
        bench.baseline();
        std::fs::create_dir(bench.path("recordings")).unwrap();
        let mut list = String::from("# made by a test\n");
        for number in 0..recordings {
            let fault = if number % 4 == 3 {
                "fault = { after_secs = 0.0, stage = \"stage1\", percent = [0.0, 20.0, 0.0, 0.0, 0.0] }"
            } else {
                ""
            };
            let name = format!("recordings/{number:03}.mcap");
            bench.record(&name, &format!("duration_secs = {seconds:?}\nseed = {number}\n{fault}"), |_| {});
            writeln!(list, "{name}").unwrap();
        }
        bench.write("list.txt", &list);
        Self { bench }
    }

    /// `gearwatch batch` of the manifest, in the archive's folder.
    pub fn batch(&self, out: &str, more: &[&str]) -> Command {
        let mut command = gearwatch(&["batch", "--bench", "bench.toml", "--baseline", "baseline.json", "--out", out]);
        command.args(["--manifest", "list.txt"]).args(more).current_dir(self.bench.path(""));
        command
    }
}

/// Files in a folder by name, without those that end in `.lock`.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.retain(|name| !name.ends_with(".lock"));
    names.sort();
    names
}

/// Python with these modules; `None`, said, where it is not there.
pub fn python(modules: &str) -> Option<&'static str> {
    let python = "python3";
    let there = Command::new(python).args(["-c", &format!("import {modules}")]).output();
    if there.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    eprintln!("skipped: needs python3 with {modules}");
    None
}

/// What DuckDB answers to a query, one line a row, fields with tabs between; `None` where it is not
/// there.
pub fn duckdb(query: &str) -> Option<String> {
    let python = python("duckdb")?;
    let program = "import sys, duckdb\nfor row in duckdb.sql(sys.argv[1]).fetchall(): print(*row, sep='\\t')";
    let output = Command::new(python).args(["-c", program, query]).output().unwrap();
    assert!(output.status.success(), "{query}\n{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

/// Rows that only one of two sets of parts has, and how many there are in the first.
pub fn difference(a: &Path, b: &Path) -> Option<(String, String)> {
    let (a, b) = (format!("'{}/*.parquet'", text(a)), format!("'{}/*.parquet'", text(b)));
    let only = |x: &str, y: &str| format!("(select * from {x} except all select * from {y})");
    let query = format!("select count(*) from (from {} union all from {})", only(&a, &b), only(&b, &a));
    Some((duckdb(&query)?.trim().to_owned(), duckdb(&format!("select count(*) from {a}"))?.trim().to_owned()))
}
