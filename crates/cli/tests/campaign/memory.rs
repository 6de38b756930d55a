//! The unit's `MemoryMax`, by the kernel that enforces it: a control group made by hand (version 1
//! or 2), where one can be made.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::fixture::{Bench, text};
use crate::kills::judge;
use crate::service::{configure, ended_within, figure, files, log_of, signal, start, status, wait_for};
use gearwatch_testkit::log::content;

/// A control group with a limit on memory; gone with the value.
struct Group {
    folder: PathBuf,
    limit: &'static str,
    usage: &'static str,
    peak: &'static str,
}

impl Group {
    fn new() -> Option<Self> {
        let name = format!("gearwatch-test-{}", std::process::id());
        let old = PathBuf::from("/sys/fs/cgroup/memory").join(&name);
        if std::fs::create_dir(&old).is_ok() {
            let [limit, usage, peak] = ["memory.limit_in_bytes", "memory.usage_in_bytes", "memory.max_usage_in_bytes"];
            return Some(Self { folder: old, limit, usage, peak });
        }
        let new = PathBuf::from("/sys/fs/cgroup").join(name);
        std::fs::create_dir(&new).ok()?;
        let group = Self { folder: new, limit: "memory.max", usage: "memory.current", peak: "memory.peak" };
        group.folder.join(group.limit).exists().then_some(group)
    }

    fn figure(&self, file: &str) -> u64 {
        std::fs::read_to_string(self.folder.join(file)).ok().and_then(|text| text.trim().parse().ok()).unwrap_or(0)
    }

    fn set_limit(&self, bytes: u64) -> bool {
        std::fs::write(self.folder.join(self.limit), bytes.to_string()).is_ok()
    }

    /// Starts the service in it.
    fn start(&self, config: &Path) -> Child {
        let built = env!("CARGO_BIN_EXE_gearwatch").into();
        let binary = std::env::var_os("GEARWATCH_BINARY").unwrap_or(built);
        let mut shell = Command::new("sh");
        shell.args([
            "-c",
            "echo $$ > \"$0\"; exec \"$1\" run --config \"$2\"",
            text(&self.folder.join("cgroup.procs")),
        ]);
        shell.arg(binary).arg(config).env("GEARWATCH_LOG", "warn");
        shell.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir(&self.folder);
    }
}

/// `MemoryMax` of the unit, in bytes.
fn memory_max() -> u64 {
    let unit = include_str!("../../../../packaging/gearwatch.service");
    let value = unit.lines().find_map(|line| line.strip_prefix("MemoryMax=")).unwrap();
    value.strip_suffix('G').unwrap().parse::<u64>().unwrap() << 30
}

/// Under the unit's limit the service stays far below it; where a limit hits, the kernel kills it,
/// and nothing that was acknowledged is lost.
#[test]
fn conform_the_limit_on_memory_holds_and_costs_nothing_that_was_acknowledged() {
    let Some(group) = Group::new() else {
        return eprintln!("skipped: a control group with a limit on memory cannot be made here (root)");
    };
    let bench = Bench::new();
    let folder = bench.path("log");
    let config = configure(&bench, &folder, "100.0", "group_ms = 50\nrotate_bytes = 65536");
    assert!(group.set_limit(memory_max()) && group.figure(group.limit) == memory_max(), "the limit is taken");
    let mut child = group.start(&config);
    let durable = || status(&bench).as_ref().and_then(log_of).and_then(|log| figure(log, "durable_seq"));
    wait_for(Duration::from_secs(30), || durable().filter(|&seq| seq > 500)).expect("it runs and logs");
    let peak = group.figure(group.peak);
    assert!(peak > 0 && peak < memory_max() / 4, "{peak} bytes");
    // The limit follows what is in use, until there is no room: pages of files go first, then the
    // kernel ends the process.
    let mut acknowledged = 0;
    let killed = wait_for(Duration::from_secs(60), || {
        acknowledged = acknowledged.max(durable().unwrap_or(0));
        let usage = group.figure(group.usage);
        group.set_limit(usage.saturating_sub(256 << 10).max(1 << 20));
        child.try_wait().unwrap()
    });
    let killed = killed.expect("the kernel ends what does not fit");
    assert!(!killed.success());
    drop(group);
    let mut child = start(&config);
    wait_for(Duration::from_secs(30), || durable().filter(|&seq| seq > acknowledged)).expect("it goes on behind");
    signal(&child, "TERM");
    assert_eq!(ended_within(&mut child, Duration::from_secs(10)).and_then(|status| status.code()), Some(0));
    let content = content(&files(&folder));
    let (verdicts, tails) = judge("out of memory", &content, |_| acknowledged);
    println!(
        "peak {:.1} MiB of {} MiB; ended by {killed}; {acknowledged} acknowledged, {verdicts} verdicts in the log, {tails} tails",
        peak as f64 / f64::from(1 << 20),
        memory_max() >> 20
    );
    assert!(content.groups.last().is_some_and(|group| group.seq_last >= acknowledged));
}
