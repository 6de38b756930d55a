//! Every parser against bytes that somebody changed: seeded mutations of one small file of each
//! kind. No panic, no endless work, no flood of memory.
//!
//! The normal run spends a moment on each parser; `just campaign-fuzz` a minute
//! (`GEARWATCH_FUZZ_SECS`). A find is written to the temporary folder, named in the message, and
//! belongs into the tests of its parser. The fuzzer that follows coverage (`fuzz/`) begins with the
//! same files: `GEARWATCH_FUZZ_CORPUS` says where to write them.

#![expect(clippy::print_stdout, reason = "tests tell figures")]

#[path = "../service/fixture.rs"]
#[expect(dead_code, reason = "shared with the tests of the service, which use all of it")]
mod fixture;

mod mutate;
mod parsers;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use mutate::Mutator;
use parsers::PARSERS;

/// No parser may take longer for one of these small inputs, on a machine that does much else.
const SLOWEST: Duration = Duration::from_secs(2);

/// A parser and files for it.
struct Target {
    name: &'static str,
    seeds: Vec<Vec<u8>>,
    parse: parsers::Parse,
}

fn lanxi_seed() -> Vec<u8> {
    let hex = "42 4b 14 00 01 00 00 00 00 00 00 00 20 00 00 00 00 00 00 80 00 f1 53 65 11 00 00 00 \
               01 00 00 00 01 00 03 00 01 00 00 ff ff ff 00 00 40 \
               42 4b 14 00 02 00 00 00 00 00 00 00 20 00 00 00 00 00 00 80 00 f1 53 65 08 00 00 00 \
               01 00 01 00 12 00 00 00";
    let one: Vec<u8> = hex.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
    one.repeat(3)
}

fn frames_seed() -> Vec<u8> {
    use gearwatch_io::frames::{Encoding, Frame, Values, encode};
    let mut out = Vec::new();
    for sequence in 0..4 {
        let values = Values::Counts { encoding: Encoding::I16, counts: vec![1, -1, -32768, 32767], scale: 0.5 };
        let frame = Frame {
            stream: 7,
            sequence,
            first_sample: 2 * sequence,
            t0: 100_000_000,
            sample_rate_hz: 2048.0,
            channels: 2,
            quality: 0,
            values,
        };
        encode(&frame, &mut out);
    }
    out
}

/// A log as a killed service leaves it, and one that was closed.
fn logs() -> Vec<Vec<u8>> {
    let bench = fixture::Bench::new();
    let config = bench.write(
        "service.toml",
        "format = \"gearwatch-service/1\"\nservice = { self_test = false }\n[[bench]]\nfile = \"bench.toml\"\n\
         [[bench.source]]\nkind = \"test_signal\"\nspeed = \"max\"\nduration_secs = 3.0\n\
         [[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\nraw = { keep = \"all\" }\n",
    );
    assert_eq!(fixture::output(&["run", "--config", fixture::text(&config)]).status.code(), Some(0));
    let files = std::fs::read_dir(bench.path("log")).unwrap().map(|entry| entry.unwrap().path());
    let closed: Vec<Vec<u8>> =
        files.filter(|p| p.extension().is_some_and(|e| e == "mcap")).map(|p| std::fs::read(p).unwrap()).collect();
    let open = closed.iter().map(|bytes| bytes[..bytes.len() * 2 / 3].to_vec());
    closed.iter().cloned().chain(open).collect()
}

fn targets() -> Vec<Target> {
    let of = |end: &str| -> Vec<Vec<u8>> {
        gearwatch_testkit::files::samples()
            .into_iter()
            .filter(|sample| sample.name.ends_with(end))
            .map(|sample| sample.bytes)
            .collect()
    };
    let logs = logs();
    let home = fixture::Bench::new();
    let baseline = std::fs::read(home.baseline()).unwrap();
    let seeds_of = |name: &str| match name {
        "mcap" | "log" => logs.clone(),
        "gzip" => of(".gz"),
        "csv" | "wav" | "mat" | "tdms" | "uff" => of(&format!(".{name}")),
        "lanxi" => vec![lanxi_seed()],
        "frames" => vec![frames_seed()],
        "bench" => vec![fixture::BENCH.as_bytes().to_vec()],
        "baseline" => vec![baseline.clone()],
        "service" => vec![gearwatch_daemon::config::DEFAULT.as_bytes().to_vec()],
        "letter" => vec![br#"{"resent":false,"kind":"verdict","bench":"b","run":"r","seq":1,"rank_1x":"V"}"#.to_vec()],
        _ => Vec::new(),
    };
    PARSERS.iter().map(|&(name, parse)| Target { name, seeds: seeds_of(name), parse }).collect()
}

/// Most memory that this process has used (MiB).
fn peak_mib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kib| kib.parse::<u64>().ok()).unwrap_or(0) / 1024
}

fn keep(target: &str, input: &[u8]) -> PathBuf {
    let path = std::env::temp_dir().join(format!("gearwatch-fuzz-{target}-{:08x}", input.len()));
    std::fs::write(&path, input).unwrap();
    path
}

fn run(target: &Target, seconds: f64) {
    assert!(!target.seeds.is_empty(), "{}: no seed", target.name);
    for seed in &target.seeds {
        (target.parse)(seed);
    }
    let mut mutator = Mutator::new(target.name);
    let begin = Instant::now();
    let (mut inputs, mut slowest) = (0_u64, Duration::ZERO);
    while begin.elapsed().as_secs_f64() < seconds {
        let input = mutator.change(&target.seeds);
        let start = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| (target.parse)(&input)));
        let took = start.elapsed();
        slowest = slowest.max(took);
        inputs += 1;
        if result.is_err() || took > SLOWEST {
            panic!("{}: input {inputs} in {took:?}: {}", target.name, keep(target.name, &input).display());
        }
    }
    println!("{}: {inputs} inputs, slowest {slowest:.1?}, peak so far {} MiB", target.name, peak_mib());
}

/// Writes the files that a fuzzer begins with, a folder for each parser.
#[test]
#[ignore = "writes files; `just campaign-fuzz-coverage`"]
fn conform_the_seeds_are_read_and_written_for_a_fuzzer() {
    let corpus =
        PathBuf::from(std::env::var_os("GEARWATCH_FUZZ_CORPUS").expect("GEARWATCH_FUZZ_CORPUS names a folder"));
    for target in targets() {
        let folder = corpus.join(target.name);
        std::fs::create_dir_all(&folder).unwrap();
        assert!(!target.seeds.is_empty(), "{}: no seed", target.name);
        for (i, seed) in target.seeds.iter().enumerate() {
            (target.parse)(seed);
            std::fs::write(folder.join(format!("seed-{i}")), seed).unwrap();
        }
    }
}

#[test]
fn conform_changed_bytes_do_no_harm() {
    let seconds = std::env::var("GEARWATCH_FUZZ_SECS").ok().and_then(|text| text.parse().ok()).unwrap_or(0.7);
    for target in targets() {
        run(&target, seconds);
    }
    assert!(peak_mib() < 1024, "{} MiB", peak_mib());
}
