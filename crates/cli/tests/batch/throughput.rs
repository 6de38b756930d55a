//! How fast `batch` is beside the bare reading of the same files, on one thread and on all:
//! `just bench-batch`.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Instant;

use gearwatch_core::source::Source;
use gearwatch_io::OpenOptions;
use mcap::records::Record;

use crate::fixture::gearwatch;
use crate::long::{bench, megabytes, record};

const ROUNDS: usize = 5;

fn seconds(work: impl FnOnce()) -> f64 {
    let begin = Instant::now();
    work();
    begin.elapsed().as_secs_f64()
}

/// All records of a file with the reader of the library, chunks opened, checksums checked, messages
/// not decoded.
fn bare(path: &Path) -> u64 {
    let mut reader = mcap::sans_io::LinearReader::new();
    let mut file = BufReader::new(File::open(path).unwrap());
    let mut messages = 0;
    while let Some(event) = reader.next_event() {
        match event.unwrap() {
            mcap::sans_io::LinearReadEvent::ReadRequest(need) => {
                let count = std::io::Read::read(&mut file, reader.insert(need)).unwrap();
                reader.notify_read(count);
            }
            mcap::sans_io::LinearReadEvent::Record { opcode, data } => {
                messages += u64::from(matches!(mcap::parse_record(opcode, data).unwrap(), Record::Message { .. }));
            }
        }
    }
    messages
}

fn decoded(path: &Path) -> u64 {
    let mut source = gearwatch_io::open(path, &OpenOptions::default()).unwrap();
    let mut packets = 0;
    while source.next_packet().unwrap().is_some() {
        packets += 1;
    }
    packets
}

#[test]
#[ignore = "works a minute, and needs a quiet machine and a release build: just bench-batch"]
fn conform_threads_share_the_work_of_a_batch() {
    let bench = bench();
    let cores = std::thread::available_parallelism().unwrap().get();
    std::fs::create_dir(bench.path("recordings")).unwrap();
    let paths: Vec<PathBuf> =
        (0..4 * cores as u32).map(|k| record(&bench, &format!("recordings/{k}.mcap"), k, 30_000_000)).collect();
    let megabytes: f64 = paths.iter().map(|path| megabytes(path)).sum();
    let batch = |jobs: usize| {
        let _ = std::fs::remove_dir_all(bench.path("out"));
        let mut command = gearwatch(&["batch", "recordings", "--bench", "bench.toml", "--baseline", "baseline.json"]);
        command.args(["--out", "out", "--jobs", &jobs.to_string()]).current_dir(bench.path("")).stdout(Stdio::null());
        seconds(|| assert!(command.status().unwrap().success()))
    };
    let mut rounds: Vec<[f64; 4]> = (0..ROUNDS)
        .map(|_| {
            let read = |how: fn(&Path) -> u64| seconds(|| assert!(paths.iter().map(|path| how(path)).sum::<u64>() > 0));
            [read(bare), read(decoded), batch(1), batch(cores)]
        })
        .collect();
    let mut ratio = |what: &str, of: fn(&[f64; 4]) -> f64| {
        rounds.sort_by(|a, b| of(a).total_cmp(&of(b)));
        let [low, middle, high] = [0, ROUNDS / 2, ROUNDS - 1].map(|k| of(&rounds[k]));
        eprintln!("{what}: {middle:.2} ({low:.2} to {high:.2})");
        middle
    };
    let speedup = ratio(&format!("batch on {cores} threads, times one"), |[_, _, one, all]| one / all);
    ratio("batch on one thread, of the speed of decoding alone", |[_, decoded, one, _]| decoded / one);
    ratio("batch on one thread, of the speed of bare MCAP reading", |[bare, _, one, _]| bare / one);
    ratio("batch on all threads, of the speed of bare MCAP reading", |[bare, _, _, all]| bare / all);
    ratio("bare reading, s", |[bare, ..]| *bare);
    ratio("batch on one thread, s", |[_, _, one, _]| *one);
    eprintln!("{megabytes:.0} MB of two channels at 16384 Hz, {ROUNDS} rounds");
    assert!(speedup > 0.7 * cores as f64, "{speedup:.2} on {cores} cores");
}
