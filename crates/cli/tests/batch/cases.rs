//! Many cases: one row each, the answer of `gearwatch explain`.

use std::fs;

use crate::archive::{duckdb, names};
use crate::fixture::{BENCH, Bench, gearwatch, stderr, stdout};

/// Two cases and one that cannot be read: two rows, which hold what `gearwatch explain` says; the
/// second run knows them.
#[test]
fn conform_many_cases_give_a_row_each() {
    let bench = Bench::new();
    for (number, change) in [(1, 0.0), (2, 30.0)] {
        fs::create_dir_all(bench.path(&format!("cases/{number}/recordings"))).unwrap();
        fs::create_dir_all(bench.path(&format!("cases/{number}/reference"))).unwrap();
        bench.write(&format!("cases/{number}/bench.toml"), BENCH);
        for (folder, percent) in [("recordings", change), ("reference", 0.0)] {
            for seed in [1, 2] {
                let fault = format!(
                    "fault = {{ after_secs = 0.0, stage = \"stage1\", percent = [{percent:?}, 0.0, 0.0, 0.0, 0.0] }}"
                );
                let keys = format!("duration_secs = 6.0\nseed = {number}{}{seed}\n{fault}", folder.len());
                bench.record(&format!("cases/{number}/{folder}/{seed}.mcap"), &keys, |_| {});
            }
        }
    }
    fs::create_dir_all(bench.path("cases/3/recordings")).unwrap();
    bench.write("cases/3/bench.toml", &BENCH.replace("teeth", "tooths"));
    bench.write("cases/3/recordings/1.mcap", "no recording");
    let batch = || {
        let mut command = gearwatch(&["batch", "--cases", "cases", "--out", "answers"]);
        command.current_dir(bench.path("")).output().unwrap()
    };
    let first = batch();
    assert_eq!(first.status.code(), Some(3), "{}", stderr(&first));
    assert!(
        stderr(&first).contains("passed over: cases/3: ") && stderr(&first).contains("tooths"),
        "{}",
        stderr(&first)
    );
    assert!(
        stdout(&first).contains("2 cases worked (2 rows), 0 known from before, 1 passed over"),
        "{}",
        stdout(&first)
    );
    assert!(stdout(&batch()).contains("0 cases worked (0 rows), 2 known from before"));
    assert_eq!(names(&bench.path("answers")), ["part-00001-of-00001.parquet"]);
    for number in [1, 2] {
        let case = format!("cases/{number}");
        let mut one = gearwatch(&["explain", "bench.toml", "recordings", "--reference", "reference"]);
        let answer: serde_json::Value =
            serde_json::from_str(&stdout(&one.current_dir(bench.path(&case)).output().unwrap())).unwrap();
        let part = bench.path("answers/part-00001-of-00001.parquet");
        let query = format!("select status, explanation from '{}' where \"case\" = '{case}'", part.to_str().unwrap());
        let Some(row) = duckdb(&query) else { return };
        let (status, explanation) = row.trim().split_once('\t').unwrap();
        assert_eq!(answer["status"], status);
        assert_eq!(serde_json::from_str::<serde_json::Value>(explanation).unwrap(), answer, "{case}");
    }
}
