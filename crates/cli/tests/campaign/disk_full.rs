//! A full disk: ranks go on, the state says so within a second, logging goes on by itself, and what
//! was not logged is counted exactly.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use gearwatch_log::{Cause, Gap};

use crate::fixture::{Bench, gearwatch, text};
use crate::service::{configure, ended_within, files, log_of, said, signal, start, status, wait_for};
use gearwatch_testkit::log::content;

/// A small file system in memory; gone with the value.
struct SmallDisk(PathBuf);

impl SmallDisk {
    /// `None` where mounting is not allowed.
    fn new(folder: PathBuf, size: &str) -> Option<Self> {
        std::fs::create_dir_all(&folder).ok()?;
        let options = format!("size={size}");
        let mount = Command::new("mount").args(["-t", "tmpfs", "-o", &options, "tmpfs", text(&folder)]).output();
        mount.is_ok_and(|output| output.status.success()).then_some(Self(folder))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").args(["-l", text(&self.0)]).status();
    }
}

fn condition(bench: &Bench) -> Option<(bool, bool, String)> {
    let snapshot = status(bench)?;
    let log = log_of(&snapshot)?;
    Some((snapshot.ok, log.ok, log.detail.clone()))
}

/// How long the service gets to say how its log is.
const LIMIT: Duration = Duration::from_secs(10);

/// Waits until the log says that it is written; how long that took.
fn log_goes_on(bench: &Bench) -> Duration {
    let begin = Instant::now();
    let good = |(_, ok, detail): (bool, bool, String)| (ok && detail.contains("gearwatch-")).then_some(());
    wait_for(LIMIT, || condition(bench).and_then(good)).expect("the log says that it is written");
    begin.elapsed()
}

/// Waits until the log and the whole service say that the disk is full; how long that took.
fn full_disk_is_told(bench: &Bench) -> Duration {
    let begin = Instant::now();
    let full = |(all, ok, detail): (bool, bool, String)| (!all && !ok && detail.contains("\"full\"")).then_some(());
    wait_for(LIMIT, || condition(bench).and_then(full)).expect("the state says that the disk is full");
    begin.elapsed()
}

fn fill(place: &Path) {
    // Writes until nothing more goes in; what fails is the point.
    let _ = Command::new("dd").args(["if=/dev/zero", &format!("of={}", text(place)), "bs=4096"]).output();
}

#[test]
fn conform_a_full_disk_is_told_and_counted() {
    let bench = Bench::new();
    let Some(disk) = SmallDisk::new(bench.path("disk"), "3m") else {
        eprintln!("skipped: mounting a small file system needs root");
        return;
    };
    let folder = disk.0.join("log");
    let further = "group_ms = 50\nqueue_records = 64\n[[sink]]\nkind = \"stdout\"";
    let config = configure(&bench, &folder, "20.0", further);
    let mut child =
        gearwatch(&["run", "--config", text(&config)]).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let lines = Arc::new(AtomicU64::new(0));
    let counted = lines.clone();
    let stdout = child.stdout.take().unwrap();
    let reader = std::thread::spawn(move || {
        for _ in BufReader::new(stdout).lines().map_while(Result::ok) {
            counted.fetch_add(1, Ordering::Relaxed);
        }
    });
    log_goes_on(&bench);

    fill(&disk.0.join("ballast"));
    let told = full_disk_is_told(&bench);
    let before = lines.load(Ordering::Relaxed);
    std::thread::sleep(Duration::from_secs(3));
    let during = lines.load(Ordering::Relaxed) - before;
    std::fs::remove_file(disk.0.join("ballast")).unwrap();
    let resumed = log_goes_on(&bench);
    std::thread::sleep(Duration::from_secs(1));
    signal(&child, "TERM");
    assert_eq!(ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()), Some(0));
    reader.join().unwrap();

    let lines = lines.load(Ordering::Relaxed);
    let content = content(&files(&folder));
    // Windows are counted under their sensor and stage; spectra that found no room are counted too,
    // under a name of their own.
    let of_windows = |gap: &&Gap| gap.cause == Cause::LogQueueFull && gap.channel.contains('/');
    let unlogged: u64 = content.gaps.iter().filter(of_windows).map(|gap| gap.count).sum();
    let logged = content.verdicts.len() as u64;
    println!(
        "full disk: told after {told:.2?}, {during} ranks meanwhile, resumed after {resumed:.2?}; {lines} lines = {logged} logged + {unlogged} counted as unlogged"
    );
    // 2 channels, 2 windows a second, 20 times the speed: 80 a second; a busy machine may shed
    // some.
    assert!(during > 60, "ranks did not go on: {during}");
    assert!(told <= Duration::from_secs(1), "{told:?}");
    assert!(resumed <= Duration::from_secs(5), "{resumed:?}");
    assert!(unlogged > 0, "nothing was shed: the disk was not full for long enough to test anything");
    assert_eq!(lines, logged + unlogged);
}

/// Told to stop while the disk is full: it ends in time, and says by its exit code and in words
/// that its log is not whole.
#[test]
fn conform_a_log_that_could_not_be_closed_is_told_by_the_exit_code() {
    let bench = Bench::new();
    let Some(disk) = SmallDisk::new(bench.path("disk"), "1m") else {
        eprintln!("skipped: mounting a small file system needs root");
        return;
    };
    let folder = disk.0.join("log");
    let config = configure(&bench, &folder, "20.0", "group_ms = 50\n");
    let mut child = start(&config);
    log_goes_on(&bench);
    fill(&disk.0.join("ballast"));
    full_disk_is_told(&bench);
    signal(&child, "TERM");
    let code = ended_within(&mut child, Duration::from_secs(5)).expect("it ends in time").code();
    let words = said(&mut child);
    assert_eq!(code, Some(3), "{words}");
    assert!(words.contains("log"), "{words}");
}
