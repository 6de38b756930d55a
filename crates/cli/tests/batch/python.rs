//! The example script reads what gearwatch writes; DuckDB and DataFusion answer the queries of the
//! documentation.

use std::path::Path;
use std::process::Command;

use crate::archive::{Archive, names, python};
use crate::fixture::{gearwatch, stderr, text};

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/python");

fn run(script: &str, args: &[&str], folder: &Path) -> String {
    let output = Command::new("python3").arg(format!("{EXAMPLES}/{script}")).args(args).current_dir(folder).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{script}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A log of the service, a baseline and the parts of a batch, through the script of `examples/`.
#[test]
fn conform_the_script_plots_ranks_from_a_log() {
    if python("mcap, zstandard, lz4, pyarrow, duckdb, matplotlib").is_none() {
        return;
    }
    let archive = Archive::new(4, 4.0);
    assert!(archive.batch("ranks", &[]).output().unwrap().status.success());
    let config = "format = \"gearwatch-service/1\"\nservice = { workers = 1, self_test = false }\n\
        [[bench]]\nfile = \"bench.toml\"\nbaseline = \"baseline.json\"\n[[bench.source]]\nkind = \"test_signal\"\nspeed = \"max\"\n\
        duration_secs = 30.0\nfault = { after_secs = 10.0, stage = \"stage1\", percent = [0.0, 25.0, 0.0, 0.0, 0.0] }\n\
        [[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\n";
    let config = archive.bench.write("service.toml", config);
    let service = gearwatch(&["run", "--config", text(&config)]).output().unwrap();
    assert!(service.status.success(), "{}", stderr(&service));
    let log = archive.bench.path("log");
    let logs = names(&log).into_iter().filter(|name| name.ends_with(".mcap")).map(|name| format!("log/{name}"));
    let mut args: Vec<String> = logs.collect();
    args.extend(
        ["--baseline", "baseline.json", "--parts", "ranks/*.parquet", "--plot", "ranks.png"].map(str::to_owned),
    );
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let said = run("ranks.py", &args, &archive.bench.path(""));
    // 30 s in windows of 1 s, every half second: 59 windows of two channels.
    assert!(said.starts_with("118 verdicts of 1 stage(s)"), "{said}");
    assert!(said.contains("recordings/003.mcap") && said.contains("channels acc_1, acc_2"), "{said}");
    let picture = std::fs::read(archive.bench.path("ranks.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG") && picture.len() > 5000, "{} bytes", picture.len());
}

/// The query of `docs/batch.md` for DataFusion; DuckDB says the same.
#[test]
fn conform_datafusion_and_duckdb_agree() {
    if python("datafusion, duckdb").is_none() {
        return;
    }
    let archive = Archive::new(4, 4.0);
    assert!(archive.batch("ranks", &["--shard", "1/2"]).output().unwrap().status.success());
    assert!(archive.batch("ranks", &["--shard", "2/2"]).output().unwrap().status.success());
    let said = run("datafusion_ranks.py", &["ranks"], &archive.bench.path(""));
    let query = "select channel, rank_2x, count(*) as windows from 'ranks/*.parquet' group by all order by all";
    let program = "import sys, duckdb\nfor row in duckdb.sql(sys.argv[1]).fetchall(): print(*row)";
    let output = Command::new("python3").args(["-c", program, query]).current_dir(archive.bench.path("")).output();
    let expected = String::from_utf8(output.unwrap().stdout).unwrap();
    assert!(!expected.is_empty());
    assert_eq!(said, expected);
}
