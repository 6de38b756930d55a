//! Bad input: said with its place, exit code 3, and nothing half-written under a final name.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use gearwatch_core::block::Packet;

use crate::archive::{Archive, duckdb, names};
use crate::fixture::{stderr, stdout, text};

fn refused(output: &Output, says: &[&str]) {
    let message = stderr(output);
    assert_eq!(output.status.code(), Some(3), "{message}");
    assert!(!message.contains("panicked"), "{message}");
    for part in says {
        assert!(message.contains(part), "{part:?} is not said in: {message}");
    }
}

fn rate(packet: &mut Packet, sample_rate_hz: f64) {
    if let Packet::Vibration(block) = packet {
        block.sample_rate_hz = sample_rate_hz;
    }
}

/// Before anything is worked: nothing is made.
#[test]
fn conform_lists_and_shards_that_cannot_be() {
    let archive = Archive::new(2, 3.0);
    let with = |lines: &str| {
        archive.bench.write("list.txt", lines);
        archive.batch("out", &[]).output().unwrap()
    };
    refused(&with("recordings/000.mcap\nrecordings/7.mcap\n"), &["list.txt: 1 of 2", "recordings/7.mcap (line 2)"]);
    refused(&with("recordings/000.mcap\n./recordings/../recordings/000.mcap\n"), &["line 2", "line 1", "once"]);
    refused(&with("# nothing yet\n"), &["empty"]);
    archive.bench.write("list.txt", "recordings/000.mcap\n");
    for (shard, says) in [("11/10", "1/10 to 10/10"), ("0/10", "1/10 to 10/10"), ("3", "such as 3/10")] {
        refused(&archive.batch("out", &["--shard", shard]).output().unwrap(), &[shard, says]);
    }
    let mut slurm = archive.batch("out", &[]);
    slurm.envs([("SLURM_ARRAY_TASK_ID", "3"), ("SLURM_ARRAY_TASK_MIN", "3"), ("SLURM_ARRAY_TASK_MAX", "3")]);
    refused(&slurm.output().unwrap(), &["give --shard I/N"]);
    refused(&archive.batch("out", &["--cases"]).output().unwrap(), &["--cases"]);
    assert!(!archive.bench.path("out").exists(), "nothing is made");
}

/// Damaged recordings and other sample rates are passed over and named; the rest is in the part,
/// which is the same in the next run.
#[test]
fn conform_damaged_recordings_and_other_rates_are_passed_over() {
    let archive = Archive::new(3, 3.0);
    let bench = &archive.bench;
    bench.write("recordings/noise.mcap", "this is no recording");
    let whole = std::fs::read(bench.path("recordings/000.mcap")).unwrap();
    std::fs::write(bench.path("recordings/cut.mcap"), &whole[..whole.len() / 2]).unwrap();
    std::fs::copy(bench.path("recordings/001.mcap"), bench.path("recordings/copy.mcap")).unwrap();
    bench.record("recordings/fast.mcap", "duration_secs = 3.0\nseed = 1", |packet| rate(packet, 4096.0));
    bench.record("recordings/mixed.mcap", "duration_secs = 3.0\nseed = 1", |packet| {
        let later = matches!(packet, Packet::Vibration(block) if block.first_sample_index > 3000);
        rate(packet, if later { 1024.0 } else { 2048.0 });
    });
    bench.record("recordings/short.mcap", "duration_secs = 0.5\nseed = 1", |_| {});
    let list: Vec<String> = names(&bench.path("recordings")).iter().map(|name| format!("recordings/{name}")).collect();
    bench.write("list.txt", &list.join("\n"));

    let output = archive.batch("out", &[]).output().unwrap();
    let says = [
        "passed over: recordings/noise.mcap",
        "passed over: recordings/cut.mcap",
        "passed over: recordings/fast.mcap: channel \"acc_1\", sample 0: sampled at 4096 Hz, expected 2048 Hz",
        "passed over: recordings/mixed.mcap: channel",
        "sampled at 1024 Hz",
        "nothing to judge: recordings/short.mcap",
        "same content: recordings/001.mcap and recordings/copy.mcap",
    ];
    refused(&output, &says);
    // 3 s in windows of 1 s, every half second: 5 windows of two channels, of four recordings.
    assert!(
        stdout(&output).contains(" 5 recordings worked (40 rows), 0 known from before, 4 passed over"),
        "{}",
        stdout(&output)
    );
    assert_eq!(names(&bench.path("out")), ["part-00001-of-00001.parquet"]);
    let part = std::fs::read(bench.path("out/part-00001-of-00001.parquet")).unwrap();
    refused(&archive.batch("out", &[]).output().unwrap(), &says[..4]);
    assert!(std::fs::read(bench.path("out/part-00001-of-00001.parquet")).unwrap() == part, "the same bytes again");

    let output = archive.batch("any", &["--any-rate"]).output().unwrap();
    assert!(stdout(&output).contains(" 2 passed over"), "{}", stdout(&output));
}

/// What `gearwatch check` refuses is passed over with its sentence, and what it doubts stands
/// beside each row.
#[test]
fn regress_a_batch_checks_each_recording() {
    let archive = Archive::new(1, 3.0);
    let bench = &archive.bench;
    // Twice the true rate: the lines say so.
    bench.record("recordings/fast.mcap", "duration_secs = 20.0\nseed = 1", |packet| rate(packet, 4096.0));
    bench.record("recordings/unstated.mcap", "duration_secs = 3.0\nseed = 2", |packet| {
        if let Packet::OperatingPoint(point) = packet {
            point.brake_torque_nm = f64::NAN;
        }
    });
    bench.write("list.txt", "recordings/000.mcap\nrecordings/fast.mcap\nrecordings/unstated.mcap\n");
    let output = archive.batch("out", &["--any-rate"]).output().unwrap();
    refused(&output, &["passed over: recordings/fast.mcap: ", "[sample_rate]"]);
    assert!(stdout(&output).contains(" 2 recordings worked (20 rows), 0 known from before, 1 passed over"));
    let parts = bench.path("out/part-00001-of-00001.parquet");
    let query = format!("select file, doubts, count(*) from '{}' group by all order by all", text(&parts));
    if let Some(rows) = duckdb(&query) {
        let expected = ["recordings/000.mcap\t\t10", "recordings/unstated.mcap\ttorque_missing\t10"];
        assert_eq!(rows.lines().collect::<Vec<_>>(), expected);
    }
}

/// Two processes with one shard and one output, two numbers of shards in one output.
#[test]
fn conform_one_output_has_one_owner_and_one_number_of_shards() {
    let archive = Archive::new(8, 20.0);
    let both = [0, 1].map(|_| {
        let mut command = archive.batch("out", &["--shard", "1/2", "--jobs", "1"]);
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    });
    let ended: Vec<Output> = both.into_iter().map(|child| child.wait_with_output().unwrap()).collect();
    let (done, refusals): (Vec<_>, Vec<_>) = ended.iter().partition(|output| output.status.success());
    assert_eq!((done.len(), refusals.len()), (1, 1), "{}", ended.iter().map(stderr).collect::<String>());
    refused(refusals[0], &["part-00001-of-00002.parquet", "another process is working this shard"]);
    let output = archive.batch("out", &["--shard", "1/3"]).output().unwrap();
    refused(&output, &["part-00001-of-00002.parquet is one of 2 shards", "this run makes 3"]);
    assert_eq!(names(&archive.bench.path("out")), ["part-00001-of-00002.parquet"]);
}

/// A small file system in memory; gone with the value.
struct SmallDisk(PathBuf);

impl SmallDisk {
    /// `None`, said, where mounting is not allowed.
    fn new(folder: &Path, size: &str) -> Option<Self> {
        std::fs::create_dir_all(folder).unwrap();
        let options = format!("size={size}");
        let mount = Command::new("mount").args(["-t", "tmpfs", "-o", &options, "tmpfs", text(folder)]).output();
        if mount.is_ok_and(|output| output.status.success()) {
            return Some(Self(folder.to_owned()));
        }
        eprintln!("skipped: mounting a small file system needs root");
        None
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").args(["-l", text(&self.0)]).status();
    }
}

/// The disk becomes full at every place that there is; with space the same command goes on and
/// gives what it gives elsewhere.
#[test]
fn conform_a_full_disk_leaves_nothing_half_written() {
    let archive = Archive::new(6, 4.0);
    let Some(disk) = SmallDisk::new(&archive.bench.path("out"), "1m") else { return };
    let elsewhere = archive.batch("elsewhere", &[]).output().unwrap();
    assert!(elsewhere.status.success(), "{}", stderr(&elsewhere));
    let part = "part-00001-of-00001.parquet";
    let expected = std::fs::read(archive.bench.path("elsewhere").join(part)).unwrap();
    let mut failed = 0;
    // Ever more of the disk is free, page by page, until all has room.
    for free_kib in (4..).step_by(24) {
        let stone = disk.0.join("stone");
        std::fs::write(&stone, vec![0; (1024 - free_kib) * 1024]).unwrap();
        let output = archive.batch("out", &["--jobs", "1"]).output().unwrap();
        std::fs::remove_file(&stone).unwrap();
        if output.status.success() {
            break;
        }
        failed += 1;
        refused(&output, &["what was finished is kept", "No space left on device"]);
        assert!(!disk.0.join(part).exists(), "no part with {free_kib} KiB free");
        for piece in names(&disk.0).iter().filter(|name| name.starts_with('.')).flat_map(|p| names(&disk.0.join(p))) {
            assert!(!piece.starts_with(".unfinished"), "{piece} is left");
        }
    }
    assert!(failed >= 3, "the disk was full {failed} times");
    assert_eq!(names(&disk.0), [part]);
    assert!(std::fs::read(disk.0.join(part)).unwrap() == expected, "not the rows of a run with room");
}
